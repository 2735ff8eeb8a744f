// steer_by_keyboard.cpp: steers a drone of a server from a terminal.
//
//   python -m flockstep serve
//   steer_by_keyboard [HOST:PORT]
//
// w and s: forward and back; a and d: left and right; arrows: up, down, and turns; space: stop; q or Ctrl-C: quit.
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <string_view>
#include <vector>

#include "flockstep/client.hpp"

using namespace flockstep;

namespace {

using Motion = std::array<float, 4>;  // forward, left, up in m; turn to the left in rad

volatile std::sig_atomic_t is_ended = 0;

// A terminal that delivers keys at once and without echo, until it goes out of scope.
class RawTerminal {
 public:
  RawTerminal() : is_terminal_(tcgetattr(STDIN_FILENO, &before_) == 0) {
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, [](int) { is_ended = 1; });
    termios raw = before_;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    if (is_terminal_) tcsetattr(STDIN_FILENO, TCSANOW, &raw);
  }
  ~RawTerminal() {
    if (is_terminal_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  RawTerminal(const RawTerminal&) = delete;
  RawTerminal& operator=(const RawTerminal&) = delete;

 private:
  termios before_{};
  bool is_terminal_;
};

// Returns the keys that were pressed within 50 ms. An arrow is three characters.
std::string_view keys(std::array<char, 16>& buffer) {
  pollfd input{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
  if (poll(&input, 1, 50) <= 0) return {};
  const ssize_t size = read(STDIN_FILENO, buffer.data(), buffer.size());
  if (size <= 0) is_ended = 1;  // the input has ended
  return {buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))};
}

// Changes the motion by a key.
void apply(std::string_view key, Motion& motion) {
  constexpr float kStep = 0.25F;
  if (key == "w" || key == "s") motion[0] += key == "w" ? kStep : -kStep;
  if (key == "a" || key == "d") motion[1] += key == "a" ? kStep : -kStep;
  if (key == "\33[A" || key == "\33[B") motion[2] += key == "\33[A" ? kStep : -kStep;
  if (key == "\33[D" || key == "\33[C") motion[3] += key == "\33[D" ? kStep : -kStep;
  if (key == " ") motion = {};
  if (key == "q") is_ended = 1;
}

// Moves a kinematic drone once, relative to its heading.
void move(client::DroneController& drone, const Motion& motion) {
  const client::Vector3 at = drone.get_location();
  const float yaw_deg = drone.get_rotation().angles.yaw_deg, yaw = yaw_deg * 0.01745329F;
  const float x = std::cos(yaw) * motion[0] - std::sin(yaw) * motion[1],
              y = std::sin(yaw) * motion[0] + std::cos(yaw) * motion[1];
  drone.set_location_and_rotation({at[0] + x, at[1] + y, at[2] + motion[2]},
                                  client::Angles{.yaw_deg = yaw_deg + motion[3] * 57.29578F});
}

}  // namespace

int main(int argc, char** argv) try {
  const client::Connection connection({.address = argc > 1 ? argv[1] : "127.0.0.1:41451"});
  client::GameModeController simulation(connection);
  const std::vector<client::Drone> drones = simulation.get_drones();
  client::DroneController drone(connection, drones.empty() ? simulation.spawn_drone().drone : drones.front().drone);
  const bool by_rotors = connection.server().flies_by_rotors;
  if (by_rotors) simulation.set_clock(1.0 / connection.server().step_s);  // as fast as real time
  const RawTerminal terminal;
  Motion motion{};
  std::array<char, 16> buffer{};
  while (is_ended == 0) {
    if (!by_rotors) motion = {};  // each key is one motion; with rotors it changes the velocity
    for (std::string_view pressed = keys(buffer); !pressed.empty();) {
      const std::size_t size = pressed.starts_with("\33[") ? std::min<std::size_t>(3, pressed.size()) : 1;
      apply(pressed.substr(0, size), motion);
      pressed.remove_prefix(size);
    }
    if (by_rotors) {
      drone.set_command(motion, "heading_velocity");
    } else if (motion != Motion{}) {
      move(drone, motion);
    }
    const client::Vector3 at = drone.get_location();
    std::printf("\rat %6.2f %6.2f %6.2f m ", static_cast<double>(at[0]), static_cast<double>(at[1]), static_cast<double>(at[2]));
    std::fflush(stdout);
  }
  std::printf("\n");
} catch (const std::exception& error) {
  std::fprintf(stderr, "\nsteer_by_keyboard: %s\n", error.what());
  return 1;
}
