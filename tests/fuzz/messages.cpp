// Messages of clients to a server, without sockets.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <memory>
#include <protozero/exception.hpp>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "base/in_world.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"
#include "fuzz/targets.hpp"
#include "service/service.hpp"
#include "service/workload.hpp"

namespace flockstep::fuzz {
namespace {

Batch::Worlds small_worlds() {
  static const Batch::Worlds all = [] {
    SceneDescription closet;
    closet.primitives = {
        {.kind = PrimitiveKind::room, .center = {1, 1, 0.75F}, .half_extents = {1.25F, 1.25F, 0.75F}},
        {.kind = PrimitiveKind::cylinder, .center = {1.9F, 1.9F, 0.75F}, .half_extents = {0.125F, 0.125F, 0.75F}}};
    closet.markers = {.start = Vec3(1, 1, 0.75F), .waypoints = {{1, 0.5F, 0.75F}}, .goal = Vec3(1, 1.25F, 0.75F)};
    SceneDescription yard;
    yard.mesh.vertices = {{-3, -3, 0}, {3, -3, 0}, {3, 3, 0}, {-3, 3, 0}};
    yard.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    yard.markers = {.start = Vec3(0, 0, 1), .goal = Vec3(2, 0, 1)};
    return Batch::Worlds{std::make_shared<const World>(closet), std::make_shared<const World>(yard)};
  }();
  return all;
}

std::unique_ptr<Batch> make_batch(std::uint8_t kind) {
  BatchConfig config;
  config.num_threads = 1;
  config.num_envs = 2;
  config.drones_per_env = kind % 3 == 0 ? 0 : 2;
  config.max_bodies = (kind & 64) != 0 ? 2 : 0;
  config.lidars = {LidarConfig{.beams = 5}};
  config.cameras = {CameraConfig{.width_px = 8, .height_px = 6, .capture_mode = CaptureMode::on_demand}};
  if (kind % 3 == 2) config.dynamics = {.motion = Motion::rotors, .control = Control::velocity};
  std::unique_ptr<Task> task;
  if (kind % 3 == 1) {
    config.drones_per_env = 1;
    config.episode.max_episode_steps = 20;
    task = make_task(NavigationConfig{.action = ActionKind::displacement_yaw});
  }
  return std::make_unique<Batch>(config, small_worlds(), std::move(task),
                                 kind % 3 == 2 ? DroneModel::load("t650") : DroneModel::quadrotor650());
}

// Collects replies, which must be messages themselves.
class Collector final : public server::Client {
 public:
  void deliver(const std::shared_ptr<server::Call>& call) override {
    ++count;
    const std::string bytes = call->writer.header() + call->writer.values();
    protocol::Reply reply;
    protocol::read_header(bytes, reply);
    if (reply.id != call->request.id || std::holds_alternative<std::monostate>(reply.result)) std::abort();
    static_cast<void>(protocol::read_arrays(bytes, reply.arrays));
  }
  int count = 0;
};

// Sizes that are allowed, but take too long for a fuzzer.
bool is_small(const protocol::Request& request) {
  // Sensors of any size: a configuration without numbers of more than two digits, and without exponents.
  const auto has_large = [](const std::string& text) {
    int digits = 0;  // in a row
    return std::ranges::any_of(text, [&](char c) {
      if (digits > 0 && (c == 'e' || c == 'E')) return true;
      digits = c >= '0' && c <= '9' ? digits + 1 : 0;
      return digits == 3;
    });
  };
  if (const auto* const set = std::get_if<protocol::SetLidarConfig>(&request.operation)) return !has_large(set->config_json);
  if (const auto* const set = std::get_if<protocol::SetCameraConfig>(&request.operation)) return !has_large(set->config_json);
  if (const auto* const get = std::get_if<protocol::GetPointCloud>(&request.operation)) return !(get->spacing_m < 0.1F);
  if (const auto* const fly = std::get_if<protocol::Fly>(&request.operation)) return fly->ticks <= 200;
  return true;
}

void require_in_world(const Batch& batch) {
  const State& state = batch.state();
  const auto in_world = [](float value) { return is_in_world(value); };
  if (!std::all_of(state.position.begin(), state.position.end(), in_world)) std::abort();
  if (!std::all_of(state.bodies.position.begin(), state.bodies.position.end(), in_world)) std::abort();
}

}  // namespace

void messages(Bytes input) {
  if (input.empty()) return;
  const std::unique_ptr<Batch> batch = make_batch(input[0]);
  const ServerConfig config{.ownership = input[0] >= 128};
  server::Workload workload;
  std::deque<std::function<void()>> later;
  const auto post = [&later](std::function<void()> work) { later.push_back(std::move(work)); };
  const auto run_posted = [&later] {
    while (!later.empty()) {
      const std::function<void()> work = std::move(later.front());
      later.pop_front();
      work();
    }
  };
  server::Service service(*batch, config, post, post, post, workload);
  const std::shared_ptr<Collector> clients[] = {std::make_shared<Collector>(), std::make_shared<Collector>()};
  clients[0]->number = 1;
  clients[1]->number = 2;
  std::string_view left(reinterpret_cast<const char*>(input.data()) + 1, input.size() - 1);
  int asked = 0;
  while (left.size() > 3) {
    std::uint16_t size = 0;
    std::memcpy(&size, left.data(), sizeof(size));
    const auto client = clients[static_cast<unsigned char>(left[2]) % 2];
    left.remove_prefix(3);
    const auto call = std::make_shared<server::Call>();
    call->client = client;
    call->bytes = left.substr(0, size);
    left.remove_prefix(std::min<std::size_t>(size, left.size()));
    try {
      const std::size_t header = protocol::header_size<protocol::Request>(call->bytes);
      if (call->bytes.size() < sizeof(std::uint32_t) + header) continue;
      protocol::read_header(call->bytes, call->request);
      const std::size_t arrays = protocol::bytes_of(std::span<const protocol::Array>(call->request.arrays));
      if (arrays > service.max_array_bytes(call->request) || call->bytes.size() != sizeof(std::uint32_t) + header + arrays)
        continue;
    } catch (const std::invalid_argument&) {
      continue;
    } catch (const protozero::exception&) {
      continue;
    }
    if (!is_small(call->request)) continue;
    ++asked;
    service.answer(call);
    run_posted();
    require_in_world(*batch);
  }
  service.leave(clients[0]);
  service.leave(clients[1]);
  run_posted();
  service.drop_calls();
  if (clients[0]->count + clients[1]->count > asked) std::abort();
}

}  // namespace flockstep::fuzz
