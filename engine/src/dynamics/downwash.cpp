#include "dynamics/downwash.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/pose_access.hpp"
#include "dynamics/fleet.hpp"

namespace flockstep::dynamics {
namespace {

// The jet, in lengths of WashNumbers::length; see the header.
constexpr float kSpeed = 10.11F;                               // B
constexpr float kSpread = 0.07668F;                            // S
constexpr float kOrigin = -5.817F;                             // s0
constexpr float kShape = std::numbers::sqrt2_v<float> - 1.0F;  // gives half the velocity at x = 1
constexpr float kGrown = 1.0F, kFades = 20.0F, kEnd = 30.0F;   // s
constexpr float kEdge = 1.0F / 49.0F;                          // fraction of the velocity on the axis
constexpr float kEdgeSpread = 0.29184F;                        // radius of the edge per (s - s0): x = sqrt(6 / kShape)

constexpr float kLoss = 0.4F;     // k
constexpr float kMaxLoss = 0.5F;  // the first order holds for slow washes only
constexpr float kUnit =
    1.0F / static_cast<float>(std::int64_t{1} << 40);  // unit of Member::lost2: a millionth of the thrust, squared

}  // namespace

WashNumbers::WashNumbers(const Airframe& frame) {
  if (frame.radius_m == 0.0) return;
  const auto distance = [](const Airframe::Triple& a, const Airframe::Triple& b) {
    return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  };
  Airframe::Triple mean{};
  for (const Airframe::Triple& hub : frame.position_m) {
    for (std::size_t axis = 0; axis < 3; ++axis) mean[axis] += hub[axis] / static_cast<double>(frame.num_rotors());
  }
  double longest = 0.0, farthest = 0.0;
  for (const Airframe::Triple& hub : frame.position_m) {
    farthest = std::max(farthest, distance(hub, mean));
    for (const Airframe::Triple& other : frame.position_m) longest = std::max(longest, distance(hub, other));
  }
  constexpr double kMinArea = 1e-12;  // m^2, for float32
  const double area =
      std::max(static_cast<double>(frame.num_rotors()) * std::numbers::pi * frame.radius_m * frame.radius_m, kMinArea);
  center = Eigen::Vector3d::Map(mean.data()).cast<float>();
  length = static_cast<float>(longest);
  reach = static_cast<float>(farthest);
  load_per_thrust = static_cast<float>(1.0 / area);
  hover_load = static_cast<float>(frame.mass_kg * kGravity / area);
}

void Downwash::update(Fleet& fleet, const State& state, std::span<const DroneIndex> drones) {
  if (!fleet.physics.downwash) return;
  while (!drones.empty()) {
    const std::size_t env = fleet.env_of(drones.front());
    update_env(fleet, state, env);
    while (!drones.empty() && fleet.env_of(drones.front()) == env) drones = drones.subspan(1);
  }
}

void Downwash::update_env(Fleet& fleet, const State& state, std::size_t env) {
  members_.clear();
  farthest_ = 0.0F;
  for (std::size_t i = 0; i < fleet.drones_per_env; ++i) {
    const DroneIndex drone(env * fleet.drones_per_env + i);
    if (!state.active[drone]) continue;
    Member& member = members_.emplace_back();
    const std::size_t row = fleet.airframe_row(drone);
    const Pose pose = pose_of(state, drone);
    const Mat3 rotation = pose.rotation.toRotationMatrix();
    member.drone = drone;
    member.numbers = &fleet.wash[row];
    member.center = pose.position + rotation * member.numbers->center;
    member.up = rotation.col(2);
    const auto& [c0, c1, c2] = fleet.numbers[row].known_thrust;
    float thrust = 0.0F;
    for (std::size_t rotor = 0; rotor < fleet.airframes[row].num_rotors(); ++rotor) {
      const float speed = state.flight.rotor_speed[fleet.num_rotors() * drone + rotor];
      thrust += std::max(c0 + (c1 + c2 * speed) * speed, 0.0F);
    }
    member.load = thrust * member.numbers->load_per_thrust;
    farthest_ = std::max(farthest_, member.numbers->reach);
  }
  std::ranges::sort(members_, {}, [](const Member& member) { return member.center.x(); });
  const std::size_t count = members_.size();
  for (std::vector<float>* const values : {&x_, &y_, &z_}) values->resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    x_[i] = members_[i].center.x();
    y_[i] = members_[i].center.y();
    z_[i] = members_[i].center.z();
  }
  near_.resize(count);
  for (const Member& source : members_) {
    if (source.load != 0.0F) add_wash(source, fleet, state);
  }
  for (const Member& member : members_) {
    for (std::size_t rotor = 0; rotor < fleet.num_rotors(); ++rotor) {
      const float lost = std::sqrt(static_cast<float>(member.lost2[rotor]) * kUnit);
      fleet.thrust_share[fleet.num_rotors() * member.drone + rotor] = 1.0F - std::min(lost, kMaxLoss);
    }
  }
}

void Downwash::add_wash(const Member& source, const Fleet& fleet, const State& state) {
  const float length = source.numbers->length;
  const float cx = source.center.x(), cy = source.center.y(), cz = source.center.z();
  const float ux = source.up.x(), uy = source.up.y(), uz = source.up.z();
  // The jet with a margin for the hubs of the target and for rounding is a cone without its tip.
  const float end = kEnd * length, margin = 1.001F * farthest_ + 0.01F * length;
  const float begin_radius = kEdgeSpread * (margin - kOrigin * length) + margin, end_radius = begin_radius + kEdgeSpread * end;
  // Its extent along x
  const float slant = std::sqrt(std::max(1.0F - ux * ux, 0.0F)), end_x = cx - end * ux;
  const float least = std::min(cx - slant * begin_radius, end_x - slant * end_radius) - margin;
  const float most = std::max(cx + slant * begin_radius, end_x + slant * end_radius) + margin;
  const auto first = static_cast<std::size_t>(std::ranges::lower_bound(x_, least) - x_.begin());
  const auto last = static_cast<std::size_t>(std::ranges::upper_bound(x_, most) - x_.begin());
  for (std::size_t i = first; i < last; ++i) {  // no branches, so that it vectorises
    const float dx = x_[i] - cx, dy = y_[i] - cy, dz = z_[i] - cz;
    const float along = -(dx * ux + dy * uy + dz * uz);
    const float radius = begin_radius + kEdgeSpread * along;
    near_[i] = (along > -margin) & (along < end + margin) & (dx * dx + dy * dy + dz * dz - along * along < radius * radius);
  }
  for (std::size_t i = first; i < last; ++i) {
    Member& target = members_[i];
    if (!near_[i] || &target == &source) continue;
    const float axial = source.up.dot(target.up);
    if (axial <= 0.0F || target.numbers->hover_load == 0.0F) continue;
    const float loads = source.load / target.numbers->hover_load;
    const Pose pose = pose_of(state, target.drone);
    const Mat3 rotation = pose.rotation.toRotationMatrix();
    const std::size_t row = fleet.airframe_row(target.drone);
    for (std::size_t rotor = 0; rotor < fleet.airframes[row].num_rotors(); ++rotor) {
      const Vec3 at =
          (pose.position + rotation * Vec3::Map(fleet.numbers[row].rotors[rotor].position.data()) - source.center) / length;
      const float s = -at.dot(source.up);
      if (s <= 0.0F) continue;
      const float from_origin = s - kOrigin;
      const float x2 = (at + s * source.up).squaredNorm() / (kSpread * kSpread * from_origin * from_origin);
      const float bell = 1.0F / ((1.0F + kShape * x2) * (1.0F + kShape * x2));
      if (bell <= kEdge) continue;
      const float grown = std::min(s / kGrown, 1.0F), left = std::clamp((kEnd - s) / (kEnd - kFades), 0.0F, 1.0F);
      const float speed = kSpeed / from_origin * (bell - kEdge) / (1.0F - kEdge) * grown * left;
      const float lost = kLoss * axial * speed, lost2 = lost * lost * loads;
      target.lost2[rotor] += static_cast<std::int64_t>((lost2 < 1.0F ? lost2 : 1.0F) / kUnit);  // 1 also for NaN
    }
  }
}

}  // namespace flockstep::dynamics
