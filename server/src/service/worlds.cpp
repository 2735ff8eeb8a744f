// Operations on worlds, and those of the session.
#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "base/require.hpp"
#include "flockstep/survey.hpp"
#include "service/convert.hpp"
#include "service/service.hpp"

namespace flockstep::server {
namespace {

using protocol::Code;

void add_points(protocol::FrameWriter& writer, const char* name, const std::vector<Vec3>& points) {
  static_assert(sizeof(Vec3) == 3 * sizeof(float));
  writer.add(name, std::span(reinterpret_cast<const float*>(points.data()), 3 * points.size()), {points.size(), std::size_t{3}});
}

}  // namespace

void Service::now(Call&, const protocol::Ping&) {}

void Service::now(Call& call, const protocol::Claim& claim) {
  const std::int64_t count = info()->num_drones();
  const std::scoped_lock lock(owners_mutex_);
  for (const std::int64_t drone : claim.drones) {
    if (drone < 0 || drone >= count) {
      throw Refusal(Code::kNotFound,
                    "drones: expected indices below " + std::to_string(count) + ", got " + std::to_string(drone));
    }
    const auto owner = owners_.find(drone);
    if (owner != owners_.end() && owner->second != call.client->number) {
      throw Refusal(Code::kPermissionDenied,
                    "drone " + std::to_string(drone) + " is claimed by client " + std::to_string(owner->second));
    }
  }
  for (const std::int64_t drone : claim.drones) owners_[drone] = call.client->number;
}

void Service::now(Call& call, const protocol::Release& release) {
  const std::scoped_lock lock(owners_mutex_);
  for (const std::int64_t drone : release.drones) {
    const auto owner = owners_.find(drone);
    if (owner != owners_.end() && owner->second == call.client->number) owners_.erase(owner);
  }
}

void Service::now(Call& call, const protocol::GetFps&) {
  const RateMeter::Rates rates = rate_.rates();
  call.result<protocol::Fps>() = {.fps = rates.fps, .real_time_factor = rates.real_time_factor};
}

void Service::now(Call& call, const protocol::GetWorlds&) {
  auto& worlds = call.result<protocol::Worlds>().worlds;
  follow_program_if_free();
  const auto now = info();
  for (const auto& world : now->worlds) {
    protocol::World& message = worlds.emplace_back();
    message.name = world->name();
    message.content_hash = world->content_hash();
    message.min = message_of(world->bounds().min);
    message.max = message_of(world->bounds().max);
    if (world->markers().start) message.start = message_of(*world->markers().start);
    if (world->markers().goal) message.goal = message_of(*world->markers().goal);
  }
}

void Service::locked(Call& call, const protocol::GetLight& get) {
  if (get.env) require_env(*get.env, "env");
  const Light light = get.env ? batch_.world_of(EnvIndex(*get.env))->light() : world(get.world)->light();
  call.result<protocol::Config>().config_json = json_of(light).dump();
}

void Service::locked(Call& call, const protocol::SetLight& set) {
  const auto changed = [&](Light light) {
    read_json(set.config_json, "light", light);
    return light;
  };
  if (set.envs.empty()) {
    require_may_change(call, std::span<const std::uint8_t>());
    const Light light = changed(world(set.world)->light());
    begin_change();
    batch_.set_light(set.world, {.light = light, .tint = {}});
    refresh_info();
    return;
  }
  const int num_envs = batch_.config().num_envs;
  require(std::ssize(set.envs) <= num_envs, "envs", "at most " + std::to_string(num_envs) + " indices", set.envs.size());
  std::vector<std::uint8_t> envs(static_cast<std::size_t>(num_envs), 0);
  for (const std::int64_t env : set.envs) {
    require_env(env, "envs");
    envs[static_cast<std::size_t>(env)] = 1;
  }
  require_may_change_envs(call, envs);
  std::vector<Light> lights(envs.size());
  for (const std::int64_t env : set.envs)
    lights[static_cast<std::size_t>(env)] = changed(batch_.world_of(EnvIndex(env))->light());
  begin_change();
  if (!set.config_json.empty()) {
    batch_.set_light(lights, envs);
  } else {
    batch_.use_world_light(envs);
  }
}

void Service::require_env(std::int64_t env, const char* field) const {
  const int num_envs = batch_.config().num_envs;
  if (env >= 0 && env < num_envs) return;
  throw Refusal(Code::kNotFound,
                std::string(field) + ": expected an index below " + std::to_string(num_envs) + ", got " + std::to_string(env));
}

void Service::locked(Call& call, const protocol::SetWorld& set) {
  require_env(set.env, "env");
  const auto now = info();
  static_cast<void>(world(set.world));
  const auto env = static_cast<std::size_t>(set.env), members = static_cast<std::size_t>(now->drones_per_env);
  std::vector<std::uint8_t> drones(static_cast<std::size_t>(now->num_drones()), 0),
      envs(static_cast<std::size_t>(now->num_envs), 0);
  std::fill_n(drones.begin() + static_cast<std::ptrdiff_t>(env * members), members, std::uint8_t{1});
  require_may_change(call, drones);
  envs[env] = 1;
  begin_change();
  batch_.set_world(std::vector<std::int32_t>(envs.size(), static_cast<std::int32_t>(set.world)), envs);
}

void Service::aside(Call& call, const protocol::GetMesh& get) {
  std::vector<std::int32_t> objects;
  const TriangleMesh mesh = world(get.world)->mesh(1e-3F, &objects);
  add_points(call.writer, "vertices", mesh.vertices);
  const std::size_t triangles = mesh.triangles.size();
  call.writer.add("triangles", std::span(reinterpret_cast<const std::int32_t*>(mesh.triangles.data()), 3 * triangles),
                  {triangles, std::size_t{3}});
  call.writer.add("objects", std::span<const std::int32_t>(objects), {objects.size()});
}

void Service::aside(Call& call, const protocol::GetPointCloud& get) {
  const PointCloud cloud = point_cloud(*world(get.world), get.spacing_m);
  add_points(call.writer, "points", cloud.points);
  add_points(call.writer, "normals", cloud.normals);
  call.writer.add("semantic", std::span<const std::uint16_t>(cloud.semantic), {cloud.semantic.size()});
  call.writer.add("objects", std::span<const std::int32_t>(cloud.objects), {cloud.objects.size()});
}

void Service::aside(Call& call, const protocol::GetBoxes& get) {
  const ObjectList list = objects(*world(get.world));
  std::vector<Vec3> min, max;
  for (const Aabb& box : list.boxes) {
    min.push_back(box.min);
    max.push_back(box.max);
  }
  add_points(call.writer, "min", min);
  add_points(call.writer, "max", max);
  call.writer.add("materials", std::span<const std::int32_t>(list.materials), {list.materials.size()});
}

}  // namespace flockstep::server
