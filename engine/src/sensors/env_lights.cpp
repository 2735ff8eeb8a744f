#include "sensors/env_lights.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "base/require.hpp"
#include "world/scene_description.hpp"

namespace flockstep::sensors {
namespace {

// The light of one env in a snapshot.
struct SavedLight {
  std::int32_t env;
  Light light;
};
static_assert(sizeof(SavedLight) == sizeof(std::int32_t) + sizeof(Light));

bool is_unused(const auto& copy) { return copy.use_count() == 1; }  // only the table of copies refers to it

}  // namespace

EnvLights::EnvLights(const Worlds& worlds, std::size_t num_envs, bool draws) : worlds_(worlds), num_envs_(num_envs) {
  if (draws) envs_.resize(num_envs);
}

void EnvLights::drop(Env& env) {
  if (!env.copy) return;
  env.copy.reset();
  may_have_unused_ = true;
}

void EnvLights::set(EnvIndex env, const Light& light) {
  const std::lock_guard lock(mutex_);
  if (envs_.empty()) envs_.resize(num_envs_);
  Env& changed = envs_[env];
  if (changed.light && std::bit_cast<Values>(*changed.light) == std::bit_cast<Values>(light)) return;
  changed.light = light;
  drop(changed);
}

void EnvLights::clear(EnvIndex env) {
  const std::lock_guard lock(mutex_);
  if (envs_.empty()) return;
  envs_[env].light.reset();
  drop(envs_[env]);
}

std::shared_ptr<const World> EnvLights::world(EnvIndex env, std::size_t slot) {
  const std::shared_ptr<const World>& base = worlds_[slot];
  if (empty()) return base;
  const std::lock_guard lock(mutex_);
  Env& shown = envs_[env];
  if (!shown.light) return base;
  if (shown.copy && shown.copy->base == base) return shown.copy->world;
  drop(shown);
  std::shared_ptr<const Copy>& copy = copies_[Key(base.get(), std::bit_cast<Values>(*shown.light))];
  if (!copy) {
    copy = std::make_shared<const Copy>(
        Copy{base, std::make_shared<const World>(base, Lighting{.light = *shown.light, .tint = {}})});
  }
  shown.copy = copy;
  return copy->world;
}

void EnvLights::free_unused() {
  const std::lock_guard lock(mutex_);
  if (!std::exchange(may_have_unused_, false)) return;
  std::erase_if(copies_, [](const auto& entry) { return is_unused(entry.second); });
}

void EnvLights::copy(const EnvLights& other) {
  if (other.empty()) return;
  envs_.resize(num_envs_);
  for (std::size_t env = 0; env < other.envs_.size(); ++env) envs_[env] = {.light = other.envs_[env].light, .copy = nullptr};
}

void EnvLights::take_worlds(EnvLights& other) noexcept {
  other.envs_.clear();
  copies_.merge(other.copies_);
  may_have_unused_ = true;
}

void EnvLights::visit(ArrayVisitor& visitor) {
  blob_.clear();
  for (std::size_t env = 0; env < envs_.size(); ++env) {
    if (!envs_[env].light) continue;
    const SavedLight saved{static_cast<std::int32_t>(env), *envs_[env].light};
    blob_.append(reinterpret_cast<const char*>(&saved), sizeof(saved));
  }
  visitor.blob("env_lights", blob_);
}

void EnvLights::restored(const std::function<void(const Light&)>& check) {
  require(blob_.size() % sizeof(SavedLight) == 0, "snapshot: env_lights",
          "a multiple of " + std::to_string(sizeof(SavedLight)) + " bytes", blob_.size());
  std::vector<SavedLight> saved(blob_.size() / sizeof(SavedLight));
  if (!saved.empty()) std::memcpy(saved.data(), blob_.data(), blob_.size());
  std::int32_t next = 0;
  for (SavedLight& entry : saved) {
    require(entry.env >= next && static_cast<std::size_t>(entry.env) < num_envs_, "snapshot: env_lights",
            "ascending envs in [0, " + std::to_string(num_envs_) + ")", entry.env);
    next = entry.env + 1;
    try {
      check_light(entry.light);
      check(entry.light);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(std::string("snapshot: ") + error.what());
    }
  }
  for (std::size_t env = 0; env < envs_.size(); ++env) clear(EnvIndex(env));
  for (const SavedLight& entry : saved) set(EnvIndex(static_cast<std::size_t>(entry.env)), entry.light);
}

}  // namespace flockstep::sensors
