// EnvLights: the lights of envs that do not show the light of their world.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"
#include "flockstep/world.hpp"

namespace flockstep::sensors {

// Copies of worlds in the lights of envs are made when they are needed. Envs with equal lights in one world share a copy.
class EnvLights {
 public:
  using Worlds = std::vector<std::shared_ptr<const World>>;

  // worlds: by slot; must outlive this object. draws: set() may be called by several threads, for different envs.
  EnvLights(const Worlds& worlds, std::size_t num_envs, bool draws);

  // True if no env has ever had its own light. The other members then need not be called.
  bool empty() const { return envs_.empty(); }

  void set(EnvIndex env, const Light& light);  // light: as in a World, with a unit direction
  void clear(EnvIndex env);                    // the env shows the light of its world again

  // Returns the world of a slot in the light of the env. Thread-safe.
  std::shared_ptr<const World> world(EnvIndex env, std::size_t slot);

  void free_unused();  // copies that no env uses any more, between frames

  void copy(const EnvLights& other);            // the lights of a smaller batch
  void take_worlds(EnvLights& other) noexcept;  // the copies of a batch that is used no more

  // A snapshot holds the lights, as one blob.
  void visit(ArrayVisitor& visitor);
  // Throws std::invalid_argument if the restored lights are not valid, or what `check` throws for one of them.
  void restored(const std::function<void(const Light&)>& check);

 private:
  using Values = std::array<float, sizeof(Light) / sizeof(float)>;
  using Key = std::pair<const World*, Values>;
  struct Copy {
    std::shared_ptr<const World> base;  // keeps the address in the key
    std::shared_ptr<const World> world;
  };
  struct Env {
    std::optional<Light> light;
    std::shared_ptr<const Copy> copy;  // the last one that it has shown
  };

  void drop(Env& env);

  const Worlds& worlds_;
  std::size_t num_envs_;
  std::vector<Env> envs_;  // (E,), or empty
  std::mutex mutex_;
  std::map<Key, std::shared_ptr<const Copy>> copies_;
  bool may_have_unused_ = false;
  std::string blob_;  // during a snapshot
};

}  // namespace flockstep::sensors
