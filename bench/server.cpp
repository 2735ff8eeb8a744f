// Times the server from the outside: round trips of the C++ client beside those of a bare echo. Prints a JSON list of figures.
// bench/server.py starts the servers and runs this program:
//
//   server echo                                                answers on a free port, which it prints, until it is killed
//   server round-trips DRONE ARRAYS PORT CALLS (NAME REQUEST REPLY)...
//                      addresses of two servers of flockstep, port of the echo, calls to time, sizes of messages in bytes
//   server encode IMAGES HZ                                    encodes images of 640 x 480 pixels at a rate, until it is killed
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "bench.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/client.hpp"
#include "render/jpeg.hpp"

namespace {

using namespace flockstep;

// Sizes of a request and its reply; the first message on a connection to the echo.
using Sizes = std::array<std::uint32_t, 2>;

// --------------------------------------------------------------------------------------------------------------------- echo

// Owns a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { close(fd_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

void require_system(bool ok, const char* call) {
  if (!ok) throw std::system_error(errno, std::system_category(), call);
}

void send_all(int fd, const char* bytes, std::size_t size) {
  while (size > 0) {
    const ssize_t sent = send(fd, bytes, size, MSG_NOSIGNAL);
    require_system(sent > 0, "send");
    bytes += sent;
    size -= static_cast<std::size_t>(sent);
  }
}

// Returns false at the end of the connection.
bool receive_all(int fd, void* bytes, std::size_t size) {
  const ssize_t got = recv(fd, bytes, size, MSG_WAITALL);
  require_system(got >= 0, "recv");
  return static_cast<std::size_t>(got) == size;
}

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

void disable_delay(int fd) {
  const int on = 1;
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
}

[[noreturn]] void echo() {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = loopback(0);
  socklen_t length = sizeof(address);
  require_system(bind(listener, reinterpret_cast<const sockaddr*>(&address), length) == 0 && listen(listener, 8) == 0 &&
                     getsockname(listener, reinterpret_cast<sockaddr*>(&address), &length) == 0,
                 "listen");
  std::printf("%d\n", ntohs(address.sin_port));
  std::fflush(stdout);
  for (;;) {
    const Descriptor connection(accept(listener, nullptr, nullptr));
    const int fd = connection.fd();
    disable_delay(fd);
    Sizes sizes{};
    if (!receive_all(fd, sizes.data(), sizeof(sizes))) continue;
    std::vector<char> request(sizes[0]), reply(sizes[1], 'x');
    while (receive_all(fd, request.data(), request.size())) send_all(fd, reply.data(), reply.size());
  }
}

// --------------------------------------------------------------------------------------------------------------- round trips

// Times of calls, µs.
using Times = std::vector<double>;

Times time_calls(int calls, const std::function<void()>& call) {
  constexpr int kWarmUp = 50;
  for (int i = 0; i < kWarmUp; ++i) call();
  Times times;
  times.reserve(static_cast<std::size_t>(calls));
  for (int i = 0; i < calls; ++i) times.push_back(1e6 * bench::seconds(call));
  return times;
}

Times time_tcp(int port, const Sizes& sizes, int calls) {
  const Descriptor connection(socket(AF_INET, SOCK_STREAM, 0));
  const int fd = connection.fd();
  const sockaddr_in address = loopback(port);
  require_system(connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0, "connect");
  disable_delay(fd);
  send_all(fd, reinterpret_cast<const char*>(sizes.data()), sizeof(sizes));
  std::vector<char> request(sizes[0], 'x'), reply(sizes[1]);
  return time_calls(calls, [&] {
    send_all(fd, request.data(), request.size());
    receive_all(fd, reply.data(), reply.size());
  });
}

void round_trips(const std::vector<std::string>& arguments) {
  constexpr std::size_t kFixed = 4;
  if (arguments.size() <= kFixed) throw std::invalid_argument("round-trips: expected four arguments and cases");
  const client::Connection to_drone({.address = arguments[0]}), to_arrays({.address = arguments[1]});
  const int port = std::stoi(arguments[2]), calls = std::stoi(arguments[3]);
  client::DroneController drone(to_drone, 0);
  client::GameModeController arrays(to_arrays);
  client::Vector3 location = drone.get_location();
  float step_m = 0.1F;
  const std::map<std::string, std::function<void()>> operations{
      {"set_location",
       [&] {
         location[0] += step_m;
         step_m = -step_m;
         drone.set_location(location);
       }},
      {"get_location", [&] { drone.get_location(); }},
      {"get_lidar_data", [&] { drone.get_lidar_data("", true); }},
      {"get_arrays", [&] { arrays.get_array("ranges", "lidar"); }},
  };
  bench::Figures figures;
  const auto add = [&](const std::string& name, const Times& times) {
    figures.add(name + "/p50", bench::median(times), "us", calls);
  };
  const auto size = [&](std::size_t i) { return static_cast<std::uint32_t>(std::stoul(arguments.at(i))); };
  for (std::size_t i = kFixed; i < arguments.size(); i += 3) {
    const std::string& name = arguments[i];
    const Sizes sizes{size(i + 1), size(i + 2)};
    add(name + "/tcp", time_tcp(port, sizes, calls));
    if (const auto operation = operations.find(name); operation != operations.end()) {
      add(name + "/cpp", time_calls(calls, operation->second));
    }
  }
  figures.print();
}

// ------------------------------------------------------------------------------------------------------------ without a server

constexpr int kQuality = 90;

// Encodes as streams do, to measure their cost for other processes.
[[noreturn]] void encode(int images, double rate_hz) {
  BatchConfig config;
  config.num_envs = 1;
  config.num_threads = 1;
  CameraConfig camera;
  camera.width_px = 640;
  camera.height_px = 480;
  config.cameras = {camera};
  Batch batch(config, {World::load(FLOCKSTEP_SCENES "/playground/train-1.json")});
  batch.sense();
  const std::vector<std::uint8_t> image = batch.camera(0).picture(DroneIndex(0));
  std::puts("encoding");
  std::fflush(stdout);
  const auto start = std::chrono::steady_clock::now();
  for (int round = 1;; ++round) {
    for (int i = 0; i < images; ++i) render::compress_rgb(image.data(), config.cameras[0], kQuality);
    std::this_thread::sleep_until(start + std::chrono::duration<double>(round / rate_hz));
  }
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string command = argc > 1 ? argv[1] : "";
  const std::vector<std::string> arguments(argv + std::min(argc, 2), argv + argc);
  if (command == "echo") {
    echo();
  } else if (command == "round-trips") {
    round_trips(arguments);
  } else if (command == "encode" && arguments.size() == 2) {
    encode(std::stoi(arguments[0]), std::stod(arguments[1]));
  } else {
    throw std::invalid_argument("expected echo, round-trips or encode, got \"" + command + '"');
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "server: %s\n", error.what());
  return 1;
}
