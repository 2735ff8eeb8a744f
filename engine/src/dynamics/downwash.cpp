#include "dynamics/downwash.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "base/pose_access.hpp"
#include "dynamics/fleet.hpp"

namespace flockstep::dynamics {
namespace {

// The jet, in lengths of WashNumbers::length; see the header.
constexpr float kSpeed = 10.11F;                                   // B
constexpr float kSpread = 0.07668F;                                // S
constexpr float kOrigin = -5.817F;                                 // s0
constexpr float kShape = std::numbers::sqrt2_v<float> - 1.0F;      // gives half the velocity at x = 1
constexpr float kGrown = 1.0F, kFades = 20.0F, kEnd = 30.0F;       // s
constexpr float kEdge = 1.0F / 49.0F;                              // of the velocity on the axis
constexpr float kEdgeSpread = 0.29184F;                            // radius of the edge per (s - s0): x = sqrt(6 / kShape)

constexpr float kLoss = 0.4F;      // k
constexpr float kMostLoss = 0.5F;  // the first order holds for slow washes only
constexpr float kUnit = 1.0F / static_cast<float>(std::int64_t{1} << 40);  // of Member::lost2: a millionth of the thrust, squared

}  // namespace

WashNumbers::WashNumbers(const Airframe& frame) {
  if (frame.radius_m == 0.0) return;
  const auto distance = [](const Airframe::Triple& a, const Airframe::Triple& b) {
    return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  };
  Airframe::Triple mean{};
  for (const Airframe::Triple& hub : frame.position_m) {
    for (std::size_t axis = 0; axis < 3; ++axis) mean[axis] += hub[axis] / static_cast<double>(kRotors);
  }
  double longest = 0.0, farthest = 0.0;
  for (const Airframe::Triple& hub : frame.position_m) {
    farthest = std::max(farthest, distance(hub, mean));
    for (const Airframe::Triple& other : frame.position_m) longest = std::max(longest, distance(hub, other));
  }
  constexpr double kLeastArea = 1e-12;  // m^2, for float32
  const double area = std::max(static_cast<double>(kRotors) * std::numbers::pi * frame.radius_m * frame.radius_m, kLeastArea);
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
  places_.clear();
  float farthest = 0.0F;
  for (std::size_t i = 0; i < fleet.drones_per_env; ++i) {
    const DroneIndex drone(env * fleet.drones_per_env + i);
    if (!state.active[drone]) continue;
    Member& member = members_.emplace_back();
    const std::size_t row = fleet.airframe_row(drone);
    const AirframeNumbers<float>& numbers = fleet.numbers[row];
    const Pose pose = pose_of(state, drone);
    const Mat3 rotation = pose.rotation.toRotationMatrix();
    member.drone = drone;
    member.numbers = &fleet.wash[row];
    member.center = pose.position + rotation * member.numbers->center;
    member.up = rotation.col(2);
    float thrust = 0.0F;
    for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
      const float speed = state.flight.rotor_speed[kRotors * drone + rotor];
      thrust += std::max(numbers.thrust[0] + (numbers.thrust[1] + numbers.thrust[2] * speed) * speed, 0.0F);
      member.hub[rotor] = pose.position + rotation * Vec3::Map(numbers.position[rotor].data());
    }
    member.load = thrust * member.numbers->load_per_thrust;
    farthest = std::max(farthest, member.numbers->reach);
    places_.push_back({member.center.x(), static_cast<std::uint32_t>(members_.size() - 1)});
  }
  std::ranges::sort(places_, [](const Place& a, const Place& b) { return std::tie(a.x, a.member) < std::tie(b.x, b.member); });
  for (const Member& source : members_) {
    if (source.load == 0.0F) continue;
    // The extent of the jet along x, from a disc at the drone to a wider one at its end
    const float length = source.numbers->length;
    const float slant = std::sqrt(std::max(1.0F - source.up.x() * source.up.x(), 0.0F)) * kEdgeSpread * length;
    const float begin = source.center.x(), end = begin - kEnd * length * source.up.x();
    const float begin_radius = -kOrigin * slant, end_radius = (kEnd - kOrigin) * slant;
    const float least = std::min(begin - begin_radius, end - end_radius) - farthest;
    const float most = std::max(begin + begin_radius, end + end_radius) + farthest;
    for (auto place = std::ranges::lower_bound(places_, least, {}, &Place::x); place != places_.end() && place->x <= most; ++place) {
      if (Member& target = members_[place->member]; &target != &source) add_wash(source, target);
    }
  }
  for (const Member& member : members_) {
    for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
      const float lost = std::sqrt(static_cast<float>(member.lost2[rotor]) * kUnit);
      fleet.thrust_share[kRotors * member.drone + rotor] = 1.0F - std::min(lost, kMostLoss);
    }
  }
}

void Downwash::add_wash(const Member& source, Member& target) const {
  const float length = source.numbers->length, reach = target.numbers->reach;
  const Vec3 apart = target.center - source.center;
  const float along = -apart.dot(source.up);
  if (along <= -reach || along >= kEnd * length + reach) return;
  const float radius = kEdgeSpread * (along + reach - kOrigin * length) + reach;
  if ((apart + along * source.up).squaredNorm() >= radius * radius) return;
  const float axial = source.up.dot(target.up);
  if (axial <= 0.0F || target.numbers->hover_load == 0.0F) return;
  const float loads = source.load / target.numbers->hover_load;
  for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
    const Vec3 at = (target.hub[rotor] - source.center) / length;
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

}  // namespace flockstep::dynamics
