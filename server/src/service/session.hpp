// Session: a client's connection. Requests come in and replies go out as WebSocket messages, over TCP, TLS or a Unix socket.
#pragma once

// clang-format off: Boost 1.74 uses std::exchange without its header
#include <utility>
#include <boost/asio.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
// clang-format on

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "service/call.hpp"
#include "service/service.hpp"
#include "service/workload.hpp"

namespace flockstep::server {

namespace asio = boost::asio;
namespace beast = boost::beast;

// The step after a transfer of bytes, called once. It is one type, so that sockets and TLS are compiled once, and not for each
// operation that waits for them: those took half of the compiler's time for this folder.
class Then {
 public:
  template <class Handler>
    requires(!std::is_same_v<std::remove_cvref_t<Handler>, Then>)
  explicit Then(Handler&& handler) : next_(std::make_unique<Of<std::remove_cvref_t<Handler>>>(std::forward<Handler>(handler))) {}

  void operator()(beast::error_code error, std::size_t bytes = 0) { next_->call(next_, error, bytes); }
  // Lets a thread of Asio go on with it without waking another, as what Beast passes on does.
  friend bool asio_handler_is_continuation(Then*) { return true; }

 private:
  struct Next {
    virtual ~Next() = default;
    // Frees the memory first, as Asio asks: the handler may begin the next operation.
    virtual void call(std::unique_ptr<Next>& self, beast::error_code error, std::size_t bytes) = 0;
  };
  template <class Handler>
  struct Of final : Next {
    explicit Of(Handler new_handler) : handler(std::move(new_handler)) {}
    void call(std::unique_ptr<Next>& self, beast::error_code error, std::size_t bytes) override {
      Handler moved = std::move(handler);
      self.reset();
      moved(error, bytes);
    }
    Handler handler;
  };

  std::unique_ptr<Next> next_;
};

// Likewise, what follows the wait of a timer.
inline void after(asio::steady_timer& timer, std::function<void(beast::error_code)> then) { timer.async_wait(std::move(then)); }

// The bytes of a connection, over TCP or a Unix socket, with or without TLS. It is one type, so that the compiler makes one
// WebSocket of it.
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
    read(first_of<asio::mutable_buffer, 1>(buffers)[0], Then(std::forward<Handler>(handler)));
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    write(first_of<asio::const_buffer, kWritten>(buffers), Then(std::forward<Handler>(handler)));
  }

  // The end of a WebSocket.
  template <class Handler>
  friend void async_teardown(beast::role_type role, Stream& stream, Handler&& handler) {
    stream.tear_down(role, Then(std::forward<Handler>(handler)));
  }
  friend void beast_close_socket(Stream& stream) { stream.close(); }

 private:
  static constexpr std::size_t kWritten = 4;  // buffers: the head of a frame and the parts of a message
  using Written = std::array<asio::const_buffer, kWritten>;

  // Returns the first buffers that are not empty. An operation that transfers some bytes need not transfer all.
  template <class Buffer, std::size_t kCount, class Buffers>
  static std::array<Buffer, kCount> first_of(const Buffers& buffers) {
    std::array<Buffer, kCount> first;
    std::size_t count = 0;
    const auto end = asio::buffer_sequence_end(buffers);
    for (auto at = asio::buffer_sequence_begin(buffers); at != end && count < kCount; ++at) {
      if (const Buffer buffer = *at; buffer.size() > 0) first[count++] = buffer;
    }
    return first;
  }

  void read(const asio::mutable_buffer& buffer, Then&& then);
  void write(const Written& buffers, Then&& then);
  void tear_down(beast::role_type role, Then&& then);
  // Sends what it can of the announced message without waiting, if these are the first buffers of its frame.
  void send_ahead(const Written& buffers);

  Socket socket_;
  std::optional<asio::ssl::stream<Socket&>> tls_;
  std::array<asio::const_buffer, 2> announced_{};
  std::size_t ahead_ = 0;  // bytes that were sent, but not yet by async_write_some()
};

namespace websocket = beast::websocket;

// Data that the sessions of a server share.
struct Sessions {
  Service& service;
  const ServerConfig& config;
  Workload& workload;
  std::atomic<int> count{0};     // connections
  std::atomic<int> num_open{0};  // those whose Hello was answered, until the last operation of the client ends
};

// All handlers run in the strand of the stream.
class Session final : public Client, public std::enable_shared_from_this<Session> {
 public:
  // tls: null without TLS.
  Session(Sessions& sessions, Stream::Socket socket, asio::ssl::context* tls);
  ~Session() override;

  void start();
  // Ends the session with a reason, from any thread.
  void stop(const std::string& reason);
  // Ends the connection at once if there was no Hello, from any thread. It then makes room for others.
  void drop();
  bool is_open() const { return is_open_; }  // Hello was answered
  // Ends the connection on this side; the client can still read what was sent, such as the reason. No thread may be in a
  // handler of this object.
  void shut_down() {
    beast::error_code ignored;
    socket_.next_layer().socket().shutdown(asio::socket_base::shutdown_send, ignored);
    subscriptions_.clear();
    waiting_.clear();
    outbox_.clear();  // calls hold their session
  }
  void deliver(const std::shared_ptr<Call>& call) override;

 private:
  using Timer = asio::steady_timer;

  struct Subscription {
    protocol::Subscribe what;
    Timer timer;
    std::chrono::steady_clock::duration period;
    bool is_pending = false;        // a value is being made, or waits to be sent
    bool is_due = false;            // and the next one should be on its way by now
    std::int64_t last_change = -1;  // change count of the value that was sent last
  };

  // Runs it in the strand of the stream, at once if this thread is in it.
  void in_strand(std::function<void()> part) { asio::dispatch(socket_.get_executor(), std::move(part)); }
  // Reads the HTTP request that begins a WebSocket, and refuses those of web pages if there is no token.
  void read_upgrade();
  void accept();
  void read();
  // Takes what has come of a message; returns false if the session ends.
  bool take_header();
  void take_message();
  void dispatch_next();  // and those after it that are answered at once
  void end_request();    // the request that was being answered
  void open(const std::shared_ptr<Call>& hello);
  void refuse(std::uint64_t id, protocol::Code code, const std::string& text, bool ends);
  void subscribe(const std::shared_ptr<Call>& call, const protocol::Subscribe& subscribe);
  void unsubscribe(const std::shared_ptr<Call>& call, const protocol::Unsubscribe& unsubscribe);
  void wait_for(std::uint64_t id);
  void make_value(std::uint64_t id, Subscription& subscription);
  void send(const std::shared_ptr<Call>& call);
  void write();
  void close(websocket::close_code code, const std::string& reason);
  void end();
  // Runs a part of the session. If it fails, for example without memory, the session ends.
  template <class Part>
  void attempt(const Part& part) {
    try {
      part();
    } catch (const std::exception&) {
      end();
    }
  }
  // Ends the session when nothing has arrived for a while, and sends a ping after half of that time. The timeout of Beast would
  // set a timer of the system at each message.
  void watch();
  std::shared_ptr<Session> self() { return shared_from_this(); }

  Sessions& sessions_;
  websocket::stream<Stream, false> socket_;  // without compression
  beast::flat_buffer buffer_;                // for what comes in
  std::string large_;                        // the beginning of a large message, taken out of the buffer
  beast::http::request<beast::http::empty_body> upgrade_;
  Timer hello_timer_, idle_timer_;
  std::chrono::steady_clock::time_point last_arrival_{};
  std::optional<Workload::Mark> mark_;  // during the handshake of TLS, and while a large message comes in

  std::atomic<bool> is_open_{false};  // Hello was answered
  bool is_ending_ = false;            // no more is read; the connection closes when all is sent
  bool is_closing_ = false;
  bool is_reading_ = false;
  bool is_pinging_ = false;
  bool is_dispatching_ = false;                // dispatch_next() runs
  bool is_busy_ = false;                       // a request is being answered
  std::size_t busy_bytes_ = 0;                 // bytes of its message
  std::size_t unanswered_bytes_ = 0;           // bytes of all requests that came and were not answered
  std::optional<protocol::Request> incoming_;  // header of the message that is coming in
  bool is_skipping_ = false;                   // that message was refused
  std::size_t skipped_ = 0;                    // bytes of it
  std::size_t incoming_bytes_ = 0;             // bytes of the whole message
  std::deque<std::shared_ptr<Call>> waiting_;
  std::deque<std::shared_ptr<Call>> outbox_;  // the first is being written
  std::size_t outbox_bytes_ = 0;
  std::map<std::uint64_t, std::shared_ptr<Subscription>> subscriptions_;
  std::size_t num_values_ = 0;  // values of streams, ended ones too, that are being made
};

}  // namespace flockstep::server
