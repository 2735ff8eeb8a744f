// Downwash of mixed fleets, against its equations in double precision.
#include "dynamics/downwash.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

#include "dynamics/fleet.hpp"
#include "flight_inputs.hpp"
#include "flight_state.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using dynamics::Downwash;
using dynamics::Fleet;
using testing::Random;
using WideVec = Eigen::Vector3d;

constexpr std::size_t kWashEnvs = 6, kWashMembers = 10, kWashDrones = kWashEnvs * kWashMembers;
const ClockConfig kWashClock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = {}};

DynamicsConfig with_downwash() {
  DynamicsConfig config;
  config.motion = Motion::rotors;
  config.control = Control::rotor_speeds;
  config.downwash = true;
  return config;
}

struct WashSwarm {
  explicit WashSwarm(std::uint32_t seed) : state(testing::flight_state(kWashEnvs, kWashMembers)) {
    const std::vector<Airframe> frames = testing::different_airframes();
    Random random(seed);
    for (std::size_t drone = 0; drone < kWashDrones; ++drone) {
      index.push_back(static_cast<std::int32_t>(drone % frames.size()));
      const Vec3 at = random.point(1.5F), axis = random.point(1.0F);
      std::copy_n(at.data(), 3, state.position.data() + 3 * drone);
      const Quat q(Eigen::AngleAxisf(random.within(-0.6F, 0.6F), axis.normalized()));
      const std::array<float, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
      std::copy_n(wxyz.data(), 4, state.quat_wxyz.data() + 4 * drone);
      const Airframe& frame = frames[static_cast<std::size_t>(index.back())];
      for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
        state.flight.rotor_speed[kRotors * drone + rotor] = static_cast<float>(frame.hover_speed()) * random.within(0.8F, 1.2F);
      }
      state.active[drone] = drone % 7 != 3;
    }
    fleet.emplace(frames, index, with_downwash(), kWashClock, kWashMembers);
  }

  void update() {
    std::vector<DroneIndex> drones;
    for (std::size_t drone = 0; drone < kWashDrones; ++drone) {
      if (state.active[drone]) drones.emplace_back(drone);
    }
    Downwash().update(*fleet, state, drones);
  }

  double load(std::size_t drone) const {
    const Airframe& frame = fleet->airframe_of(DroneIndex(drone));
    double thrust = 0.0;
    for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
      thrust += frame.thrust_at(static_cast<double>(state.flight.rotor_speed[kRotors * drone + rotor]));
    }
    return frame.radius_m > 0.0 ? thrust / area(frame) : 0.0;
  }
  static double area(const Airframe& frame) { return 4.0 * std::numbers::pi * frame.radius_m * frame.radius_m; }
  WideVec up(std::size_t drone) const { return rotation(drone) * WideVec::UnitZ(); }
  Eigen::Quaterniond rotation(std::size_t drone) const { return pose_of(state, DroneIndex(drone)).rotation.cast<double>(); }
  WideVec position(std::size_t drone) const { return position_of(state, DroneIndex(drone)).cast<double>(); }

  // The share of its thrust that a rotor keeps.
  double share(std::size_t drone, std::size_t rotor) const {
    const Airframe& frame = fleet->airframe_of(DroneIndex(drone));
    if (frame.radius_m == 0.0) return 1.0;
    const WideVec hub = position(drone) + rotation(drone) * WideVec(frame.position_m[rotor].data());
    double lost2 = 0.0;
    for (std::size_t other = drone / kWashMembers * kWashMembers; other < (drone / kWashMembers + 1) * kWashMembers; ++other) {
      if (other == drone || !state.active[other]) continue;
      const Airframe& source = fleet->airframe_of(DroneIndex(other));
      double length = 0.0;
      for (const auto& a : source.position_m) {
        for (const auto& b : source.position_m) length = std::max(length, (WideVec(a.data()) - WideVec(b.data())).norm());
      }
      WideVec center = WideVec::Zero();
      for (const auto& a : source.position_m) center += WideVec(a.data()) / 4.0;
      const WideVec at = (hub - position(other) - rotation(other) * center) / length;
      const double s = -at.dot(up(other)), q = (at + s * up(other)).norm(), x = q / (0.07668 * (s + 5.817));
      const double bell = std::pow(1.0 + (std::sqrt(2.0) - 1.0) * x * x, -2.0);
      const double cut = std::max(bell * 49.0 - 1.0, 0.0) / 48.0 * std::clamp(s, 0.0, 1.0) * std::clamp(3.0 - s / 10.0, 0.0, 1.0);
      if (s <= 0.0) continue;
      const double hover = frame.mass_kg * kGravity / area(frame);
      const double lost =
          0.4 * 10.11 / (s + 5.817) * cut * std::max(up(drone).dot(up(other)), 0.0) * std::sqrt(load(other) / hover);
      lost2 += std::min(lost * lost, 1.0);
    }
    return 1.0 - std::min(std::sqrt(lost2), 0.5);
  }

  State state;
  std::vector<std::int32_t> index;
  std::optional<Fleet> fleet;
};

TEST(Downwash, OfMixedFleetsFollowsItsEquations) {
  std::size_t lose = 0;
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    WashSwarm swarm(seed);
    swarm.update();
    for (std::size_t drone = 0; drone < kWashDrones; ++drone) {
      for (std::size_t rotor = 0; rotor < kRotors; ++rotor) {
        const float found = swarm.fleet->thrust_share[kRotors * drone + rotor];
        const double expected = swarm.state.active[drone] ? swarm.share(drone, rotor) : 1.0;
        ASSERT_NEAR(static_cast<double>(found), expected, 2e-5) << drone << ' ' << rotor;
        lose += expected < 0.95 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(lose, 300U);
}

TEST(Downwash, LeavesAnEnvOfOneActiveDroneWithoutWash) {
  WashSwarm swarm(5);
  swarm.update();
  const auto is_still = [&](float share) { return share == 1.0F; };
  ASSERT_FALSE(std::ranges::all_of(swarm.fleet->thrust_share, is_still));
  for (std::size_t drone = 0; drone < kWashDrones; ++drone) swarm.state.active[drone] = drone % kWashMembers == 4;
  swarm.update();
  for (std::size_t drone = 4; drone < kWashDrones; drone += kWashMembers) {
    EXPECT_TRUE(is_still(swarm.fleet->thrust_share[kRotors * drone]));
  }
}

TEST(Downwash, IsOffForSingleDronesAndWithoutARotorRadius) {
  std::vector<Airframe> frames = testing::different_airframes();
  frames.resize(1);
  EXPECT_FALSE(Fleet(frames, std::vector<std::int32_t>(4), with_downwash(), kWashClock, 1).physics.downwash);
  EXPECT_TRUE(Fleet(frames, std::vector<std::int32_t>(4), with_downwash(), kWashClock, 2).physics.downwash);
  frames[0].radius_m = 0.0;
  const Fleet without(frames, std::vector<std::int32_t>(4), with_downwash(), kWashClock, 2);
  EXPECT_FALSE(without.physics.downwash);
  EXPECT_TRUE(without.thrust_share.empty());
}

}  // namespace
}  // namespace flockstep
