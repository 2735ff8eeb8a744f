// Operations on the bodies of envs.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/require.hpp"
#include "flockstep/body.hpp"
#include "service/convert.hpp"
#include "service/service.hpp"

namespace flockstep::server {
namespace {

// Returns an array of the request, empty if it has none of this name.
std::vector<float> numbers(const Call& call, const char* name, const std::vector<std::int64_t>& shape) {
  return call.array<float>(name, shape).value_or(std::vector<float>());
}

}  // namespace

void Service::require_bodies() const {
  if (batch_.bodies().per_env() == 0) {
    throw std::invalid_argument("the batch of this server has no slots for bodies: make it with max_bodies=1 or more");
  }
}

std::vector<std::uint8_t> Service::body_mask(const Call& call) const {
  const auto envs = static_cast<std::size_t>(batch_.config().num_envs), per_env = batch_.bodies().per_env();
  const auto is_of_envs = [](const protocol::Array& array) { return array.name == "mask" && array.shape.size() == 1; };
  if (!std::ranges::any_of(call.request.arrays, is_of_envs)) {
    return call.flags("mask", {static_cast<std::int64_t>(envs), static_cast<std::int64_t>(per_env)})
        .value_or(std::vector<std::uint8_t>());
  }
  const auto of_envs = call.flags("mask", {static_cast<std::int64_t>(envs)});
  std::vector<std::uint8_t> mask(envs * per_env);
  for (std::size_t row = 0; row < mask.size(); ++row) mask[row] = (*of_envs)[row / per_env];
  return mask;
}

void Service::require_may_change_envs(const Call& call, std::span<const std::uint8_t> mask) const {
  if (mask.empty()) return require_may_change(call, mask);
  const auto envs = static_cast<std::size_t>(batch_.config().num_envs);
  const auto members = static_cast<std::size_t>(batch_.config().drones_per_env);
  const std::size_t per_env = mask.size() / envs;
  std::vector<std::uint8_t> drones(envs * members);
  for (std::size_t row = 0; row < mask.size(); ++row) {
    if (mask[row] != 0) std::fill_n(drones.begin() + static_cast<std::ptrdiff_t>(row / per_env * members), members, 1);
  }
  if (!drones.empty()) require_may_change(call, drones);
}

void Service::locked(Call& call, const protocol::SpawnBodies& spawn) {
  require_bodies();
  const std::int64_t envs = batch_.config().num_envs;
  const auto position = numbers(call, "position", {envs, 3});
  const auto quat = numbers(call, "quat_wxyz", {envs, 4});
  const auto velocity = numbers(call, "velocity", {envs, 3});
  const auto angular_velocity = numbers(call, "angular_velocity", {envs, 3});
  const std::vector<std::uint8_t> mask = call.flags("mask", {envs}).value_or(std::vector<std::uint8_t>());
  require(!spawn.config_json.empty(), "config_json", "a JSON object with the fields of a BodyConfig", "nothing");
  BodyConfig config;
  read_json(spawn.config_json, "config_json", config);
  require_may_change_envs(call, mask);
  begin_change();
  const std::vector<std::int64_t> slots = batch_.bodies().spawn(config, position, quat, velocity, angular_velocity, mask);
  call.writer.add("slot", std::span<const std::int64_t>(slots), {slots.size()});
  write_time(call);
}

void Service::change_bodies(Call& call, const std::function<void(std::span<const std::uint8_t> mask)>& change) {
  require_bodies();
  const std::vector<std::uint8_t> mask = body_mask(call);
  require_may_change_envs(call, mask);
  begin_change();
  change(mask);
  write_time(call);
}

std::vector<float> Service::body_rows(const Call& call, const char* name, std::int64_t columns) const {
  require_bodies();
  const auto envs = std::int64_t{batch_.config().num_envs}, bodies = static_cast<std::int64_t>(batch_.bodies().per_env());
  return numbers(call, name, {envs, bodies, columns});
}

void Service::locked(Call& call, const protocol::RemoveBodies&) {
  change_bodies(call, [&](std::span<const std::uint8_t> mask) { batch_.bodies().remove(mask); });
}

void Service::locked(Call& call, const protocol::SetBodyPoses&) {
  const auto position = body_rows(call, "position", 3), quat = body_rows(call, "quat_wxyz", 4);
  change_bodies(call, [&](std::span<const std::uint8_t> mask) { batch_.bodies().set_pose(position, quat, mask); });
}

void Service::locked(Call& call, const protocol::SetBodyVelocities&) {
  const auto velocity = body_rows(call, "velocity", 3), angular_velocity = body_rows(call, "angular_velocity", 3);
  change_bodies(call,
                [&](std::span<const std::uint8_t> mask) { batch_.bodies().set_velocity(velocity, angular_velocity, mask); });
}

void Service::locked(Call& call, const protocol::GetBodyConfigs& get) {
  require_bodies();
  const std::int64_t num_envs = batch_.config().num_envs;
  require(std::ssize(get.envs) <= num_envs, "envs", "at most " + std::to_string(num_envs) + " indices", get.envs.size());
  std::vector<std::int64_t> envs = get.envs;
  for (std::int64_t env = 0; get.envs.empty() && env < num_envs; ++env) envs.push_back(env);
  auto& result = call.result<protocol::Configs>();
  std::map<const BodyConfig*, std::int32_t> known;
  std::map<std::string, std::int32_t> numbered;
  const auto number_of = [&](const BodyConfig* config) {
    if (config == nullptr) return -1;
    const auto [entry, is_new] = known.try_emplace(config, 0);
    if (!is_new) return entry->second;
    const auto [text, is_other] = numbered.try_emplace(json_of(*config).dump(), static_cast<std::int32_t>(numbered.size()));
    if (is_other) result.config_json.push_back(text->first);
    return entry->second = text->second;
  };
  std::vector<std::int32_t> numbers;
  const std::size_t per_env = batch_.bodies().per_env();
  for (const std::int64_t env : envs) {
    for (std::size_t body = 0; body < per_env; ++body) {
      numbers.push_back(number_of(batch_.bodies().config(EnvIndex(env), body)));
    }
  }
  call.writer.add("config", std::span<const std::int32_t>(numbers), {envs.size(), per_env});
}

}  // namespace flockstep::server
