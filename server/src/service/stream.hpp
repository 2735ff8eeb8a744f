// Stream: the bytes of a connection, over TCP or a Unix socket, with or without TLS. It is one type, so that the compiler makes
// one WebSocket of it.
#pragma once

// clang-format off: Boost 1.74 uses std::exchange without its header
#include <utility>
#include <boost/asio.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
// clang-format on

#include <optional>

namespace flockstep::server {

namespace asio = boost::asio;
namespace beast = boost::beast;

class Stream {
 public:
  using executor_type = asio::strand<asio::io_context::executor_type>;
  using Socket = asio::basic_stream_socket<asio::generic::stream_protocol, executor_type>;

  // tls: null without TLS.
  Stream(Socket socket, asio::ssl::context* tls) : socket_(std::move(socket)) {
    if (tls != nullptr) tls_.emplace(socket_, *tls);
  }

  executor_type get_executor() noexcept { return socket_.get_executor(); }
  Socket& socket() { return socket_; }
  bool has_tls() const { return tls_.has_value(); }
  void close() {
    beast::error_code ignored;
    socket_.close(ignored);
  }

  template <class Handler>
  void async_tls_handshake(Handler&& handler) {
    tls_->async_handshake(asio::ssl::stream_base::server, std::forward<Handler>(handler));
  }
  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (tls_) return tls_->async_read_some(buffers, std::forward<Handler>(handler));
    socket_.async_read_some(buffers, std::forward<Handler>(handler));
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (tls_) return tls_->async_write_some(buffers, std::forward<Handler>(handler));
    socket_.async_write_some(buffers, std::forward<Handler>(handler));
  }

  // The end of a WebSocket.
  template <class Handler>
  friend void async_teardown(beast::role_type role, Stream& stream, Handler&& handler) {
    if (stream.tls_) return beast::async_teardown(role, *stream.tls_, std::forward<Handler>(handler));
    beast::websocket::async_teardown(role, stream.socket_, std::forward<Handler>(handler));
  }
  friend void beast_close_socket(Stream& stream) { stream.close(); }

 private:
  Socket socket_;
  std::optional<asio::ssl::stream<Socket&>> tls_;
};

}  // namespace flockstep::server
