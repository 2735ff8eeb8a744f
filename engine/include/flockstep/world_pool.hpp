// WorldPool: an endless series of worlds, built ahead of time. Each episode of an env draws one of them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "flockstep/config.hpp"
#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Makes the worlds number 0, 1, 2, ... A number stands for the same world whenever, and however often, it is asked for.
class WorldSource {
 public:
  virtual ~WorldSource() = default;

  // Waits until the world is built. What this throws ends the reset or step that needs the world.
  virtual std::shared_ptr<const World> get(std::int32_t number) = 0;
  // These will be asked for, sooner or later or never: a hint to build them ahead, on threads of the source's own. It may hear of
  // a number more than once. Does not wait.
  virtual void want(std::span<const std::int32_t> numbers) { static_cast<void>(numbers); }
};

// Episode n of an env is flown in world number floor(n * fresh) + floor(u * size), where u in [0, 1) is drawn by the env's seed
// and n. Numbers end at 2^31 - 1: no fresh worlds come then.
struct WorldPool {
  std::shared_ptr<WorldSource> source;
  std::int32_t size = 64;  // how many worlds are drawn from, in [1, 2^24]
  double fresh = 0.0;      // how many new ones take the place of the oldest from one episode to the next, in [0, 2^24]

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API std::int32_t number_of(std::uint64_t seed, std::int64_t episode) const;
};

// Builds all that a batch needs of a world, which costs more than the world itself where there are triangles: for the threads of
// a source. Thread-safe.
FLOCKSTEP_API void build_ahead(const World& world, const BatchConfig& config);

}  // namespace flockstep
