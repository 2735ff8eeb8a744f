#include "client/link.hpp"

namespace flockstep::client {

Connection::Connection(const Options& options) : link_(std::make_shared<detail::Link>(options)) { link_->introduce(); }

const ServerInfo& Connection::server() const { return link_->server(); }
bool Connection::is_open() const { return link_->is_open(); }

}  // namespace flockstep::client
