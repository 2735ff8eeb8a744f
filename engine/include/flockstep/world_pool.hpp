// WorldPool: an endless series of worlds, built ahead of time. Each episode of an env draws one of them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "flockstep/config.hpp"
#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Makes the worlds 0, 1, 2, ... Every request for a number must return the same world.
class WorldSource {
 public:
  virtual ~WorldSource() = default;

  // Returns a world and waits until it is built. An exception ends the reset or step that needs the world.
  virtual std::shared_ptr<const World> get(std::int32_t number) = 0;
  // Announces worlds that may be requested later, so that the source can build them ahead on its own threads. A number may be
  // announced more than once. Does not wait.
  virtual void want(std::span<const std::int32_t> numbers) { static_cast<void>(numbers); }
};

// Episode n of an env is flown in world floor(n * fresh) + floor(u * size), with u in [0, 1) drawn from the env's seed and n.
// World numbers end at 2^31 - 1; no fresh worlds follow after that.
struct WorldPool {
  std::shared_ptr<WorldSource> source;  // makes the worlds
  std::int32_t size = 64;               // number of worlds to draw from, in [1, 2^24]
  double fresh = 0.0;                   // number of new worlds that replace the oldest per episode, in [0, 2^24]

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API std::int32_t number_of(std::uint64_t seed,
                                       std::int64_t episode) const;  // number of the world that an episode is flown in
};

// Builds all data that a batch needs for a world. With triangles this costs more than making the world, so a source should call
// it on its own threads. Thread-safe.
FLOCKSTEP_API void build_ahead(const World& world, const BatchConfig& config);

}  // namespace flockstep
