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

#include <algorithm>
#include <array>
#include <cstddef>
#include <iterator>
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
    beast::error_code ignored;
    if (tls == nullptr) socket_.non_blocking(true, ignored);  // for send_ahead()
  }

  executor_type get_executor() noexcept { return socket_.get_executor(); }
  Socket& socket() { return socket_; }
  bool has_tls() const { return tls_.has_value(); }
  void close() {
    beast::error_code ignored;
    socket_.close(ignored);
  }

  // Announces the parts of the message that is written next. Asio writes at most 64 KiB at once, and its callers return to their
  // queue in between: this stream sends an announced message by one call of the system.
  void announce(const std::array<asio::const_buffer, 2>& parts) { announced_ = parts; }

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
    if (ahead_ == 0 && announced_[0].size() > 0) send_ahead(buffers);
    if (ahead_ == 0) return socket_.async_write_some(buffers, std::forward<Handler>(handler));
    const std::size_t sent = std::min(ahead_, asio::buffer_size(buffers));
    ahead_ -= sent;
    asio::post(get_executor(), beast::bind_front_handler(std::forward<Handler>(handler), beast::error_code(), sent));
  }

  // The end of a WebSocket.
  template <class Handler>
  friend void async_teardown(beast::role_type role, Stream& stream, Handler&& handler) {
    if (stream.tls_) return beast::async_teardown(role, *stream.tls_, std::forward<Handler>(handler));
    beast::websocket::async_teardown(role, stream.socket_, std::forward<Handler>(handler));
  }
  friend void beast_close_socket(Stream& stream) { stream.close(); }

 private:
  // Sends what it can of the announced message without waiting, if these are the first buffers of its frame.
  template <class Buffers>
  void send_ahead(const Buffers& buffers) {
    const auto first = asio::buffer_sequence_begin(buffers), end = asio::buffer_sequence_end(buffers);
    if (first == end || std::next(first) == end || !socket_.non_blocking()) return;
    const asio::const_buffer frame = *first, part = *std::next(first);
    if (part.data() != announced_[0].data()) return;  // a pong, say
    beast::error_code error;                          // such as a full socket: then the usual way waits, or fails too
    ahead_ = socket_.write_some(std::array{frame, announced_[0], announced_[1]}, error);
    announced_ = {};
  }

  Socket socket_;
  std::optional<asio::ssl::stream<Socket&>> tls_;
  std::array<asio::const_buffer, 2> announced_{};
  std::size_t ahead_ = 0;  // bytes that were sent, but not yet by async_write_some()
};

}  // namespace flockstep::server
