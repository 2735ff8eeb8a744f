#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "base/hash.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"
#include "fuzz/targets.hpp"

namespace flockstep::fuzz {
namespace {

constexpr int kDrones = 4;
constexpr int kBodies = 3;  // slots of each env

// Reads numbers from the input; 0 after its end.
class Stream {
 public:
  explicit Stream(Bytes input) : left_(input) {}
  bool empty() const { return left_.empty(); }
  template <class T>
  T take() {
    T value{};
    const std::size_t count = std::min(sizeof(T), left_.size());
    if (count > 0) std::memcpy(&value, left_.data(), count);
    left_ = left_.subspan(count);
    return value;
  }
  bool flag() { return take<std::uint8_t>() % 2 == 1; }
  // Usually a sensible number, sometimes arbitrary bits.
  float number(float reach) {
    const auto kind = take<std::uint8_t>();
    if (kind < 16) return take<float>();
    return reach * static_cast<float>(take<std::int16_t>()) / 32768.0F;
  }
  template <class T, class Draw>
  std::vector<T> list(std::size_t count, const Draw& draw) {
    std::vector<T> values(count);
    for (T& value : values) value = static_cast<T>(draw());
    return values;
  }

 private:
  Bytes left_;
};

Batch::Worlds worlds() {
  static const Batch::Worlds all = [] {
    SceneDescription closet;
    closet.primitives = {
        {.kind = PrimitiveKind::room, .center = {1, 1, 0.75F}, .half_extents = {1.25F, 1.25F, 0.75F}},
        {.kind = PrimitiveKind::cylinder, .center = {1.9F, 1.9F, 0.75F}, .half_extents = {0.125F, 0.125F, 0.75F}}};
    closet.markers = {.start = Vec3(1, 1, 0.75F), .waypoints = {{1, 0.5F, 0.75F}}, .goal = Vec3(1, 1.25F, 0.75F)};
    SceneDescription yard;
    yard.mesh.vertices = {{-3, -3, 0}, {3, -3, 0}, {3, 3, 0}, {-3, 3, 0}, {3, 3, 3}};
    yard.mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {1, 2, 4}};
    yard.markers = {.start = Vec3(0, 0, 1), .goal = Vec3(2, 0, 1)};
    return Batch::Worlds{std::make_shared<const World>(closet), std::make_shared<const World>(yard)};
  }();
  return all;
}

std::unique_ptr<Batch> make(bool with_camera) {
  BatchConfig config;
  config.num_envs = kDrones;
  config.num_threads = 1;
  config.lidars = {LidarConfig{.beams = 5}};
  config.pose_sensor = {.position_noise_std_m = 0.01F, .orientation_noise_std_deg = 1.0F};
  config.episode.max_episode_steps = 20;
  BodyConfig slider;
  slider.size_m = {0.2F, 0.4F, 0.3F};
  slider.position_m = {0.3F, 0.3F, 0.5F};
  slider.motion.kind = BodyMotionKind::slider;
  slider.motion.travel_m = {1.5F, 1.5F, 0.2F};
  slider.motion.period_s = 2.0F;
  config.bodies = {slider};
  config.max_bodies = kBodies;
  if (with_camera) config.cameras = {CameraConfig{.width_px = 8, .height_px = 6, .outputs = {.depth = true}}};
  static const DroneModel drone = DroneModel::quadrotor650();  // checked once
  return std::make_unique<Batch>(config, worlds(), make_task(NavigationConfig{.action = ActionKind::displacement_yaw}), drone);
}

// Aborts unless the invariants hold that no input may break.
void require_sane(const Batch& batch) {
  const State& state = batch.state();
  const auto in_world = [](float value) { return is_in_world(value); };
  if (!std::all_of(state.position.begin(), state.position.end(), in_world)) std::abort();
  for (std::size_t i = 0; i < kDrones; ++i) {
    const float* const q = state.quat_wxyz.data() + 4 * i;
    if (!(std::abs(std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3])) - 1.0F) < 0.02F)) std::abort();
  }
  if (!std::all_of(state.bodies.position.begin(), state.bodies.position.end(), in_world)) std::abort();
  for (std::size_t row = 0; row < state.bodies.active.size(); ++row) {
    const float* const q = state.bodies.quat_wxyz.data() + 4 * row;
    if (!(std::abs(std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3])) - 1.0F) < 0.02F)) std::abort();
  }
  for (const float range : batch.lidar().readings().ranges) {
    if (!(range >= 0.0F)) std::abort();
  }
}

void fly(Batch& batch) {
  for (int step = 0; step < 3; ++step) batch.step(std::vector<float>(4 * kDrones, 0.5F));
  require_sane(batch);
}

constexpr std::size_t kHeaderWords = 5;
constexpr std::size_t kHeaderBytes = 8 * kHeaderWords;

// Updates the checksum of a snapshot. The header has five words, and the last is the hash of everything else.
void mend_checksum(std::string& blob) {
  std::array<std::uint64_t, kHeaderWords> header{};
  std::memcpy(header.data(), blob.data(), kHeaderBytes);
  header[3] = blob.size() - kHeaderBytes;
  header[4] = 0;
  Hash hash;
  hash.add(std::as_bytes(std::span<const std::uint64_t>(header)));
  hash.add(std::string_view(blob).substr(kHeaderBytes));
  header[4] = hash.value();
  std::memcpy(blob.data(), header.data(), kHeaderBytes);
}

}  // namespace

// Every seven bytes are an edit: position, kind of edit, and four bytes of data.
void snapshot(Bytes input) {
  static const std::unique_ptr<Batch> batch = make(true);
  static const std::string good = [] {
    batch->reset(std::vector<std::uint64_t>{1, 2, 3, 4});
    fly(*batch);
    batch->set_light(Light{.fog_visibility_m = 4.0F}, std::vector<std::uint8_t>{0, 1, 1, 0});
    return batch->snapshot();
  }();
  batch->restore(good);
  Stream stream(input);
  std::string blob = good;
  while (!stream.empty() && blob.size() > kHeaderBytes) {
    const std::size_t at = kHeaderBytes + stream.take<std::uint16_t>() % (blob.size() - kHeaderBytes);
    const auto what = stream.take<std::uint8_t>();
    const auto value = stream.take<std::uint32_t>();
    if (what < 200) {
      std::memcpy(blob.data() + at, &value, what % 2 == 0 ? 1 : std::min(sizeof(value), blob.size() - at));
    } else if (what < 230) {
      blob.erase(at, std::min<std::size_t>(value % 64, blob.size() - at));
    } else {
      blob.insert(at, value % 64, static_cast<char>(what));
    }
  }
  mend_checksum(blob);
  try {
    batch->restore(blob);
  } catch (const std::invalid_argument&) {
    if (batch->snapshot() != good) std::abort();  // a refused snapshot must not change the batch
    return;
  }
  require_sane(*batch);
  try {
    fly(*batch);
  } catch (const std::logic_error&) {  // no episode has started
  }
}

void calls(Bytes input) {
  Stream stream(input);
  const std::unique_ptr<Batch> batch = make(stream.flag());
  const auto small = [&](int most) { return stream.take<std::int8_t>() % most; };  // may be negative
  const auto position = [&] { return stream.list<float>(3 * kDrones, [&] { return stream.number(3.0F); }); };
  const auto rotation = [&] {
    int i = 0;
    return stream.list<float>(4 * kDrones, [&] { return i++ % 4 == 0 ? 1.0F : stream.number(0.1F); });
  };
  const auto mask = [&] { return stream.list<std::uint8_t>(kDrones, [&] { return stream.flag(); }); };
  const auto seeds = [&] { return stream.list<std::uint64_t>(kDrones, [&] { return stream.take<std::uint64_t>(); }); };
  const auto optional = [&](float reach) { return stream.flag() ? std::optional(stream.number(reach)) : std::nullopt; };
  std::string kept;
  std::int64_t kept_drone = 0;
  for (int call = 0; call < 64 && !stream.empty(); ++call) {
    try {
      switch (stream.take<std::uint8_t>() % 21) {
        case 0:
        case 1:
        case 2:
          batch->step(stream.list<float>(4 * kDrones, [&] { return stream.number(2.0F); }));
          break;
        case 3: {
          const std::vector<std::uint64_t> chosen = stream.flag() ? std::vector<std::uint64_t>() : seeds();
          batch->reset(chosen, mask());
          break;
        }
        case 4:
        case 5: {
          // Separate statements, because the evaluation order of arguments is unspecified.
          const std::vector<float> to = position();
          const std::vector<float> turn = rotation();
          if (stream.flag()) {
            batch->set_pose(to, turn, mask());
          } else {
            batch->move(to, turn, mask());
          }
          break;
        }
        case 6:
          batch->sense(mask());
          break;
        case 7:
          kept_drone = small(5);
          batch->spawn(std::vector<std::int64_t>{kept_drone}, {}, {}, std::vector<std::int32_t>{small(3)});
          break;
        case 8:
          batch->remove(std::vector<std::int64_t>{small(5)});
          break;
        case 9: {
          const auto worlds = stream.list<std::int32_t>(kDrones, [&] { return small(3); });
          batch->set_world(worlds, mask());
          break;
        }
        case 10: {
          const LidarChange change{.max_range_m = optional(50.0F), .hfov_deg = optional(400.0F), .vfov_deg = optional(200.0F)};
          batch->lidar().set(change, mask());
          break;
        }
        case 11:
          kept = batch->snapshot();
          break;
        case 12:
          batch->restore(kept);
          break;
        case 13: {
          const std::vector<std::uint64_t> chosen = seeds();
          batch->seed(chosen, mask());
          break;
        }
        case 14:
          batch->camera(0).capture(mask());
          break;
        case 15: {
          BodyConfig body;
          body.shape = static_cast<BodyShape>(stream.take<std::uint8_t>() % EnumNames<BodyShape>::kNames.size());
          for (float& size : body.size_m) size = stream.number(1.0F);
          if (stream.flag()) body.size_m[1] = body.size_m[2] = body.size_m[0];
          BodyMotion& motion = body.motion;
          motion.kind = static_cast<BodyMotionKind>(stream.take<std::uint8_t>() % EnumNames<BodyMotionKind>::kNames.size());
          motion.route = static_cast<BodyRoute>(stream.take<std::uint8_t>() % EnumNames<BodyRoute>::kNames.size());
          motion.points_m.resize(stream.take<std::uint8_t>() % 4U);
          for (auto& point : motion.points_m) {
            for (float& value : point) value = stream.number(3.0F);
          }
          for (auto* const vector : {&motion.velocity_mps, &motion.center_m, &motion.axis, &motion.travel_m, &motion.box_max_m}) {
            for (float& value : *vector) value = stream.number(3.0F);
          }
          for (float* const value : {&motion.speed_mps, &motion.corner_radius_m, &motion.period_s, &motion.phase}) {
            *value = stream.number(2.0F);
          }
          const std::vector<float> at = stream.flag() ? position() : std::vector<float>();
          batch->bodies().spawn(body, at, {}, {}, {}, mask());
          break;
        }
        case 20: {
          std::vector<Light> lights(stream.flag() ? 1U : kDrones);
          for (Light& light : lights) {
            for (float& value : light.sun_direction) value = stream.number(2.0F);
            light.fog_visibility_m = stream.number(8.0F);
          }
          if (stream.flag()) {
            batch->set_light(lights, mask());
          } else {
            batch->use_world_light(mask());
          }
          break;
        }
        case 16:
          batch->bodies().remove(stream.list<std::uint8_t>(kDrones * kBodies, [&] { return stream.flag(); }));
          break;
        case 17:
        case 18: {
          const auto to = stream.list<float>(3 * kDrones * kBodies, [&] { return stream.number(3.0F); });
          const auto mask_of_bodies = stream.list<std::uint8_t>(kDrones * kBodies, [&] { return stream.flag(); });
          if (stream.flag()) {
            batch->bodies().set_pose(to, {}, mask_of_bodies);
          } else {
            batch->bodies().set_velocity(to, to, mask_of_bodies);
          }
          break;
        }
        default: {
          const CameraChange change{.hfov_deg = optional(200.0F), .vfov_deg = optional(200.0F)};  // braces evaluate in order
          batch->camera(0).set(change, mask());
          break;
        }
      }
    } catch (const std::logic_error&) {  // includes std::invalid_argument
    }
    require_sane(*batch);
  }
}

}  // namespace flockstep::fuzz
