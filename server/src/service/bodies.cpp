// Operations on the bodies of envs.
#include <algorithm>
#include <cstddef>
#include <cstdint>
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

std::span<const float> values_of(const std::optional<std::vector<float>>& array) {
  return array ? std::span<const float>(*array) : std::span<const float>();
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
  const auto position = call.array<float>("position", {envs, 3});
  const auto quat = call.array<float>("quat_wxyz", {envs, 4});
  const auto velocity = call.array<float>("velocity", {envs, 3});
  const auto angular_velocity = call.array<float>("angular_velocity", {envs, 3});
  const std::vector<std::uint8_t> mask = call.flags("mask", {envs}).value_or(std::vector<std::uint8_t>());
  require(!spawn.config_json.empty(), "config_json", "a JSON object with the fields of a BodyConfig", "nothing");
  BodyConfig config;
  read_json(spawn.config_json, "config_json", config);
  require_may_change_envs(call, mask);
  begin_change();
  const std::vector<std::int64_t> slots =
      batch_.bodies().spawn(config, values_of(position), values_of(quat), values_of(velocity), values_of(angular_velocity), mask);
  call.writer.add("slot", std::span<const std::int64_t>(slots), {slots.size()});
  write_time(call);
}

void Service::locked(Call& call, const protocol::RemoveBodies&) {
  require_bodies();
  const std::vector<std::uint8_t> mask = body_mask(call);
  require_may_change_envs(call, mask);
  begin_change();
  batch_.bodies().remove(mask);
  write_time(call);
}

void Service::locked(Call& call, const protocol::SetBodyPoses&) {
  require_bodies();
  const auto envs = std::int64_t{batch_.config().num_envs}, bodies = static_cast<std::int64_t>(batch_.bodies().per_env());
  const auto position = call.array<float>("position", {envs, bodies, 3});
  const auto quat = call.array<float>("quat_wxyz", {envs, bodies, 4});
  const std::vector<std::uint8_t> mask = body_mask(call);
  require_may_change_envs(call, mask);
  begin_change();
  batch_.bodies().set_pose(values_of(position), values_of(quat), mask);
  write_time(call);
}

void Service::locked(Call& call, const protocol::SetBodyVelocities&) {
  require_bodies();
  const auto envs = std::int64_t{batch_.config().num_envs}, bodies = static_cast<std::int64_t>(batch_.bodies().per_env());
  const auto velocity = call.array<float>("velocity", {envs, bodies, 3});
  const auto angular_velocity = call.array<float>("angular_velocity", {envs, bodies, 3});
  const std::vector<std::uint8_t> mask = body_mask(call);
  require_may_change_envs(call, mask);
  begin_change();
  batch_.bodies().set_velocity(values_of(velocity), values_of(angular_velocity), mask);
  write_time(call);
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
