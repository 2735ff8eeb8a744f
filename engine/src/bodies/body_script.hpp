// BodyScript: the pose of a body as a function of time.
#pragma once

#include <cstdint>

#include "flockstep/body.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::bodies {

// Key of a body's random numbers in an episode.
struct ScriptKey {
  std::uint64_t seed = 0;    // of the env
  std::int64_t episode = 0;  // number of the episode
  std::uint32_t body = 0;    // number of the body in the env
};

struct Moment {
  Pose pose;
  Velocity velocity;
};

class BodyScript {
 public:
  // The configuration must be valid.
  explicit BodyScript(const BodyConfig& config);

  // True if the pose ever changes.
  bool moves() const { return moves_; }

  // Returns the pose and velocity at a time, in seconds since the episode began. The same arguments always give the same bits.
  // Allocates nothing.
  Moment at(double time_s, const ScriptKey& key) const;

 private:
  BodyMotion motion_;
  Pose first_;  // of the body when an episode begins
  bool moves_ = false;
};

}  // namespace flockstep::bodies
