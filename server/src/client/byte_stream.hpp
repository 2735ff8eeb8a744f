// ByteStream: the asynchronous stream of Asio that lies under TLS and WebSocket here. Its operations wait in a Pump, which does
// them when it is told that the socket is ready. So a thread that waits for a reply needs no other system calls than poll() and
// recvmsg().
#pragma once

// clang-format off: Boost 1.74 uses std::exchange without its header
#include <utility>
#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
// clang-format on

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <system_error>
#include <type_traits>

#include "client/socket.hpp"

namespace flockstep::client {

namespace asio = boost::asio;
namespace beast = boost::beast;

class Pump {
 public:
  explicit Pump(Socket socket) : socket_(std::move(socket)) {}

  asio::io_context& context() { return context_; }
  Socket& socket() { return socket_; }
  bool wants_to_write() const { return write_ != nullptr; }

  // Does all that is possible now. may_read: whether the socket may have bytes to read.
  void run(bool may_read) {
    may_read_ |= may_read;
    do {
      while (try_write() || try_read()) {
      }
    } while (running_ > (read_ != nullptr ? 1 : 0) + (write_ != nullptr ? 1 : 0) && context_.poll() > 0);
  }
  // Count the operations in progress, such as the handshake or the sending of a message. Each one waits in one place: here, or in
  // the queue of the context, which costs a system call to look at.
  void begin() { ++running_; }
  void end() { --running_; }
  // Ends the operations in progress.
  void cancel() {
    for (std::unique_ptr<Operation>* const slot : {&read_, &write_}) {
      if (const auto operation = std::exchange(*slot, nullptr)) operation->complete(asio::error::operation_aborted, 0);
    }
    context_.poll();
  }

  template <class Buffers, class Handler>
  void start_read(const Buffers& buffers, Handler handler) {
    read_ = std::make_unique<OperationOf<Handler>>(buffers, std::move(handler));
  }
  template <class Buffers, class Handler>
  void start_write(const Buffers& buffers, Handler handler) {
    write_ = std::make_unique<OperationOf<Handler>>(buffers, std::move(handler));
  }

 private:
  class Operation {
   public:
    Operation() = default;
    virtual ~Operation() = default;
    Operation(const Operation&) = delete;
    Operation& operator=(const Operation&) = delete;
    virtual void complete(beast::error_code error, std::size_t size) = 0;
    std::span<const iovec> parts() const { return {parts_.data(), count_}; }
    std::size_t size() const { return size_; }

   protected:
    template <class Buffers>
    void take(const Buffers& buffers) {
      for (auto at = asio::buffer_sequence_begin(buffers); at != asio::buffer_sequence_end(buffers) && count_ < parts_.size();
           ++at) {
        using Part = std::conditional_t<std::is_convertible_v<Buffers, asio::mutable_buffer> ||
                                            asio::is_mutable_buffer_sequence<Buffers>::value,
                                        asio::mutable_buffer, asio::const_buffer>;
        const Part part = *at;
        if (part.size() == 0) continue;
        parts_[count_++] = {.iov_base = const_cast<void*>(static_cast<const void*>(part.data())), .iov_len = part.size()};
        size_ += part.size();
      }
    }

   private:
    std::array<iovec, 8> parts_{};
    std::size_t count_ = 0, size_ = 0;
  };
  template <class Handler>
  class OperationOf final : public Operation {
   public:
    template <class Buffers>
    OperationOf(const Buffers& buffers, Handler handler) : handler_(std::move(handler)) {
      this->take(buffers);
    }
    void complete(beast::error_code error, std::size_t size) override { handler_(error, size); }

   private:
    Handler handler_;
  };

  bool try_write() {
    if (write_ == nullptr) return false;
    std::error_code error;
    const auto size = write_->size() == 0 ? std::optional<std::size_t>(0) : socket_.write(write_->parts(), error);
    if (!size && !error) return false;
    const auto operation = std::exchange(write_, nullptr);
    operation->complete(code(error), size.value_or(0));
    return true;
  }
  bool try_read() {
    if (read_ == nullptr || !(may_read_ || read_->size() == 0)) return false;
    std::error_code error;
    const auto size = read_->size() == 0 ? std::optional<std::size_t>(0) : socket_.read(read_->parts(), error);
    may_read_ = size.has_value() && *size == read_->size();  // fewer: there were no more
    if (!size && !error) return false;
    const bool is_end = size == std::size_t{0} && read_->size() > 0;
    const auto operation = std::exchange(read_, nullptr);
    operation->complete(is_end ? beast::error_code(asio::error::eof) : code(error), size.value_or(0));
    return true;
  }
  static beast::error_code code(const std::error_code& error) { return {error.value(), boost::system::system_category()}; }

  asio::io_context context_{1};
  asio::executor_work_guard<asio::io_context::executor_type> work_{context_.get_executor()};
  Socket socket_;
  std::unique_ptr<Operation> read_, write_;
  bool may_read_ = false;
  int running_ = 0;
};

class ByteStream {
 public:
  using executor_type = asio::io_context::executor_type;
  using lowest_layer_type = ByteStream;

  explicit ByteStream(Pump& pump) : pump_(&pump) {}
  executor_type get_executor() noexcept { return pump_->context().get_executor(); }
  ByteStream& lowest_layer() { return *this; }
  const ByteStream& lowest_layer() const { return *this; }

  template <class Buffers, class Token>
  auto async_read_some(const Buffers& buffers, Token&& token) {
    return asio::async_initiate<Token, void(beast::error_code, std::size_t)>(
        [pump = pump_](auto handler, const Buffers& into) { pump->start_read(into, std::move(handler)); }, token, buffers);
  }
  template <class Buffers, class Token>
  auto async_write_some(const Buffers& buffers, Token&& token) {
    return asio::async_initiate<Token, void(beast::error_code, std::size_t)>(
        [pump = pump_](auto handler, const Buffers& from) { pump->start_write(from, std::move(handler)); }, token, buffers);
  }

  // The socket closes with the Pump.
  friend void teardown(beast::role_type, ByteStream&, beast::error_code& error) { error = {}; }
  template <class Handler>
  friend void async_teardown(beast::role_type, ByteStream& stream, Handler&& handler) {
    asio::post(stream.get_executor(), beast::bind_front_handler(std::forward<Handler>(handler), beast::error_code()));
  }
  friend void beast_close_socket(ByteStream&) {}

 private:
  Pump* pump_;
};

}  // namespace flockstep::client
