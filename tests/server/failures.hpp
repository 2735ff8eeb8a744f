// Failures of a client, and replies that scripted servers give.
#pragma once

#include <chrono>
#include <random>

#include "flockstep/client.hpp"
#include "random.hpp"
#include "scripted_server.hpp"

namespace flockstep::failures {

using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::ErrorCode;
using client::GameModeController;
using client::later;
using namespace testing;

struct Failure {
  ErrorCode code = {};
  std::string text = "no error";
};

// Returns the error of a call.
template <class Call>
Failure failure(const Call& call) {
  try {
    call();
  } catch (const client::Error& error) {
    return {.code = error.code(), .text = error.what()};
  }
  return {};
}

inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

inline protocol::Impact impact() {
  return {.hit = true,
          .fraction = 0.5F,
          .location = protocol::Vector3{.x = 1, .y = 2, .z = 3},
          .rotation = protocol::Quaternion{.w = 1},
          .point = protocol::Vector3{.x = 4},
          .normal = protocol::Vector3{.z = 1}};
}

inline const std::vector<float> kRanges{1.0F, std::numeric_limits<float>::infinity()};
inline const std::vector<float> kDirections{1, 0, 0, 0, 1, 0};

inline void add_scan(protocol::FrameWriter& writer) {
  writer.add("ranges", std::span<const float>(kRanges), {1, 2});
  writer.add("directions", std::span<const float>(kDirections), {1, 2, 3});
}
inline protocol::LidarData scan() { return {.origin = protocol::Vector3{.x = 1}, .rotation = protocol::Quaternion{.w = 1}}; }

}  // namespace flockstep::failures
