#include "client/socket.hpp"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <limits>
#include <memory>
#include <string_view>
#include <utility>

#include "flockstep/client.hpp"

namespace flockstep::client {
namespace {

#ifndef MSG_NOSIGNAL  // systems without it have SO_NOSIGPIPE
constexpr int MSG_NOSIGNAL = 0;
#endif

std::error_code last_error() { return {errno, std::system_category()}; }

void set_flags(int fd) {
  if (fcntl(fd, F_SETFD, FD_CLOEXEC) != 0 || fcntl(fd, F_SETFL, O_NONBLOCK) != 0) throw std::system_error(last_error(), "fcntl");
}

// Milliseconds for poll(), rounded up.
int milliseconds_until(Clock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
  return static_cast<int>(std::clamp<std::int64_t>(left, 0, std::numeric_limits<int>::max()));
}

[[noreturn]] void refuse_connection(const Address& address, const std::error_code& error) {
  const bool nobody_listens = error == std::errc::connection_refused || error == std::errc::no_such_file_or_directory;
  throw Error(ErrorCode::unavailable,
              "no server at " + address.text + ": " +
                  (nobody_listens ? "start one with `python -m flockstep serve RECIPE`" : error.message()));
}

// Connects one socket. Returns an error, or none.
std::error_code connect_one(int fd, const sockaddr* to, socklen_t size, Clock::time_point deadline) {
  set_flags(fd);
  if (::connect(fd, to, size) == 0) return {};
  if (errno != EINPROGRESS && errno != EINTR) return last_error();
  pollfd waited{.fd = fd, .events = POLLOUT, .revents = 0};
  int ready = 0;
  while ((ready = poll(&waited, 1, milliseconds_until(deadline))) < 0 && errno == EINTR) {
  }
  if (ready == 0) return std::make_error_code(std::errc::timed_out);
  int error = 0;
  socklen_t length = sizeof(error);
  if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length) != 0) return last_error();
  return {error, std::system_category()};
}

Descriptor connect_unix(const Address& address, Clock::time_point deadline) {
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::ranges::copy(address.path, to.sun_path);
  Descriptor descriptor(socket(AF_UNIX, SOCK_STREAM, 0));
  if (descriptor.fd() < 0) refuse_connection(address, last_error());
  const std::error_code error = connect_one(descriptor.fd(), reinterpret_cast<const sockaddr*>(&to), sizeof(to), deadline);
  if (error) refuse_connection(address, error);
  return descriptor;
}

Descriptor connect_tcp(const Address& address, Clock::time_point deadline) {
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (const int failure = getaddrinfo(address.host.c_str(), address.port.c_str(), &hints, &found); failure != 0) {
    throw Error(ErrorCode::unavailable, "no server at " + address.text + ": " + gai_strerror(failure));
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> list(found, freeaddrinfo);
  std::error_code error = std::make_error_code(std::errc::host_unreachable);
  for (const addrinfo* to = list.get(); to != nullptr; to = to->ai_next) {
    Descriptor descriptor(socket(to->ai_family, to->ai_socktype, to->ai_protocol));
    if (descriptor.fd() < 0) {
      error = last_error();
      continue;
    }
    error = connect_one(descriptor.fd(), to->ai_addr, to->ai_addrlen, deadline);
    if (error) continue;
    const int on = 1;
    setsockopt(descriptor.fd(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    setsockopt(descriptor.fd(), SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
    return descriptor;
  }
  refuse_connection(address, error);
}

template <class Call>
std::optional<std::size_t> transfer(const Call& call, std::error_code& error) {
  for (;;) {
    const ssize_t size = call();
    if (size >= 0) return static_cast<std::size_t>(size);
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) error = last_error();
    return std::nullopt;
  }
}

msghdr message_of(std::span<const iovec> parts) {
  msghdr message{};
  message.msg_iov = const_cast<iovec*>(parts.data());  // which sendmsg() and recvmsg() leave unchanged
  message.msg_iovlen = parts.size();
  return message;
}

}  // namespace

Descriptor::~Descriptor() {
  if (fd_ >= 0) close(fd_);
}
Descriptor::Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

Waker::Waker() {
  std::array<int, 2> ends{};
  if (pipe(ends.data()) != 0) throw std::system_error(last_error(), "pipe");
  read_ = Descriptor(ends[0]);
  write_ = Descriptor(ends[1]);
  for (const int fd : ends) set_flags(fd);
}
void Waker::wake() {
  const char byte = 0;
  static_cast<void>(!::write(write_.fd(), &byte, 1));  // a full pipe wakes, too
}
void Waker::clear() {
  std::array<char, 64> bytes{};
  while (::read(read_.fd(), bytes.data(), bytes.size()) > 0) {
  }
}

Address Address::parse(const std::string& text) {
  const auto refuse = [&] {
    throw Error(ErrorCode::invalid_argument, "address: expected HOST:PORT, [HOST]:PORT or unix:PATH, got \"" + text + '"');
  };
  Address address{.text = text, .host = {}, .port = {}, .path = {}};
  constexpr std::string_view kUnix = "unix:";
  if (text.starts_with(kUnix)) {
    address.path = text.substr(kUnix.size());
    if (address.path.empty() || address.path.find('\0') != std::string::npos) refuse();
    if (address.path.size() >= sizeof(sockaddr_un::sun_path)) {
      throw Error(ErrorCode::invalid_argument, "address: expected a path below " + std::to_string(sizeof(sockaddr_un::sun_path)) +
                                                   " bytes, got " + std::to_string(address.path.size()));
    }
    return address;
  }
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) refuse();
  address.host = text.substr(0, colon);
  address.port = text.substr(colon + 1);
  if (address.host.starts_with('[') && address.host.ends_with(']')) {
    address.host = address.host.substr(1, address.host.size() - 2);
  } else if (address.host.find(':') != std::string::npos) {
    refuse();
  }
  unsigned port = 0;
  const char* const end = address.port.data() + address.port.size();
  const auto [last, failure] = std::from_chars(address.port.data(), end, port);
  constexpr unsigned kLastPort = 65535;
  if (address.host.empty() || failure != std::errc() || last != end || port == 0 || port > kLastPort) refuse();
  return address;
}

Socket::Socket(const Address& address, Clock::time_point deadline)
    : descriptor_(address.host.empty() ? connect_unix(address, deadline) : connect_tcp(address, deadline)) {
#ifdef SO_NOSIGPIPE
  const int on = 1;
  setsockopt(descriptor_.fd(), SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof(on));
#endif
}

std::optional<std::size_t> Socket::read(std::span<const iovec> parts, std::error_code& error) {
  msghdr message = message_of(parts);
  return transfer([&] { return recvmsg(descriptor_.fd(), &message, 0); }, error);
}

std::optional<std::size_t> Socket::write(std::span<const iovec> parts, std::error_code& error) {
  const msghdr message = message_of(parts);
  return transfer([&] { return sendmsg(descriptor_.fd(), &message, MSG_NOSIGNAL); }, error);
}

bool Socket::wait(bool for_write, Waker& waker, Clock::time_point deadline) const {
  const auto events = static_cast<short>(for_write ? POLLIN | POLLOUT : POLLIN);
  std::array<pollfd, 2> waited{pollfd{.fd = descriptor_.fd(), .events = events, .revents = 0},
                               pollfd{.fd = waker.fd(), .events = POLLIN, .revents = 0}};
  if (poll(waited.data(), waited.size(), milliseconds_until(deadline)) <= 0) return false;  // a signal: the caller waits again
  if (waited[1].revents != 0) waker.clear();
  return (waited[0].revents & ~POLLOUT) != 0;
}

void Socket::shut_down() { ::shutdown(descriptor_.fd(), SHUT_RDWR); }

}  // namespace flockstep::client
