// Socket: a connected socket that does not block, over TCP or a Unix socket. Waker: ends another thread's wait for a socket.
#pragma once

#include <sys/uio.h>

#include <chrono>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <system_error>

namespace flockstep::client {

using Clock = std::chrono::steady_clock;

// Owns a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  ~Descriptor();
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  int fd() const { return fd_; }

 private:
  int fd_;
};

class Waker {
 public:
  Waker();
  void wake();
  void clear();
  int fd() const { return read_.fd(); }

 private:
  Descriptor read_, write_;
};

// Address of a server: "HOST:PORT", "[HOST]:PORT" or "unix:PATH".
struct Address {
  std::string text;
  std::string host;  // empty for a Unix socket
  std::string port;
  std::string path;  // a Unix socket's

  // Throws Error if the text is no address.
  static Address parse(const std::string& text);
};

class Socket {
 public:
  // Connects. Throws Error if there is no server, or none answers before the deadline.
  Socket(const Address& address, Clock::time_point deadline);

  // Reads or writes what is possible now. Returns the number of bytes, or nothing if the call would block; 0 from read() is the
  // end of the stream.
  std::optional<std::size_t> read(std::span<const iovec> parts, std::error_code& error);
  std::optional<std::size_t> write(std::span<const iovec> parts, std::error_code& error);

  // Waits until the socket can be read, or written if `for_write`, or the waker wakes, or the deadline has passed. Returns
  // whether it can be read or has an error.
  bool wait(bool for_write, Waker& waker, Clock::time_point deadline) const;

  // Ends the connection. Threads that wait() return.
  void shut_down();

 private:
  Descriptor descriptor_;
};

}  // namespace flockstep::client
