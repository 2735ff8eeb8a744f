// Gusts, compared with closed forms of their variances, autocorrelations and spectra.
#include "dynamics/wind.hpp"

#include <complex>

#include "dynamics/downwash.hpp"
#include "dynamics/fleet.hpp"
#include "flight_state.hpp"
#include "random.hpp"

namespace flockstep::dynamics {
namespace {

using namespace testing;

GustNoise noise(Random& random) {
  GustNoise numbers;
  for (float& number : numbers) number = random.normal();
  return numbers;
}

// Returns a long record of the three components, starting from the stationary distribution.
std::array<std::vector<double>, 3> record(const WindConfig& config, double step, int count, unsigned seed) {
  Random random(seed);
  const Wind wind(config, step);
  GustState gust = wind.begin(noise(random));
  std::array<std::vector<double>, 3> values;
  for (int i = 0; i < count; ++i) {
    const Vec3 at = wind.at(gust);
    for (int axis = 0; axis < 3; ++axis) values[static_cast<std::size_t>(axis)].push_back(static_cast<double>(at[axis]));
    gust = wind.next(gust, noise(random));
  }
  return values;
}

double covariance(const std::vector<double>& x, std::size_t lag, double mean) {
  double sum = 0.0;
  for (std::size_t i = 0; i + lag < x.size(); ++i) sum += (x[i] - mean) * (x[i + lag] - mean);
  return sum / static_cast<double>(x.size() - lag);
}

TEST(Wind, WithoutGustsIsItsMean) {
  const Wind wind({.mean_mps = {1, -2, 0.5F}}, 0.02);
  EXPECT_FALSE(wind.has_gusts());
  EXPECT_EQ(wind.at({}), Vec3(1, -2, 0.5F));
}

TEST(Wind, OrnsteinUhlenbeckDecaysInItsTime) {
  const WindConfig config{.mean_mps = {3, 0, 0}, .gusts = Gusts::ornstein_uhlenbeck, .gust_std_mps = 0.7F, .gust_time_s = 0.5F};
  const auto values = record(config, 0.05, 400000, 1);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double mean = axis == 0 ? 3.0 : 0.0;
    for (const std::size_t lag : {0U, 5U, 10U, 20U}) {
      const double expected = 0.49 * std::exp(-0.05 * static_cast<double>(lag) / 0.5);
      EXPECT_NEAR(covariance(values[axis], lag, mean), expected, 0.02) << axis << ", " << lag;
    }
  }
}

// 8785C: with T = L / V, the autocovariance is s^2 e^(-t/T) along the wind, and s^2 e^(-t/T) (1 - t / 2T) across and
// vertically.
TEST(Wind, DrydenHasTheCovarianceOfTheStandard) {
  const WindConfig config{.mean_mps = {4, 3, 0}, .gusts = Gusts::dryden, .wind_at_6m_mps = 8.0F, .height_m = 20.0F};
  const double feet = 20.0 / 0.3048;
  const double shape = 0.177 + 0.000823 * feet;
  const double std_w = 0.8, std_u = std_w / std::pow(shape, 0.4);
  const double time_u = feet / std::pow(shape, 1.2) * 0.3048 / 5.0, time_w = 20.0 / 5.0;
  const double step = 0.5;
  const auto values = record(config, step, 1000000, 2);
  std::vector<double> along, across, up = values[2];
  for (std::size_t i = 0; i < values[0].size(); ++i) {
    const double x = values[0][i] - 4.0, y = values[1][i] - 3.0;
    along.push_back(0.8 * x + 0.6 * y);
    across.push_back(-0.6 * x + 0.8 * y);
  }
  for (const std::size_t lag : {0U, 1U, 4U, 16U, 40U}) {
    const double t = step * static_cast<double>(lag);
    const double tolerance = 0.03;
    EXPECT_NEAR(covariance(along, lag, 0.0) / (std_u * std_u), std::exp(-t / time_u), 2 * tolerance) << lag;
    EXPECT_NEAR(covariance(across, lag, 0.0) / (std_u * std_u), std::exp(-t / time_u) * (1.0 - 0.5 * t / time_u), tolerance)
        << lag;
    EXPECT_NEAR(covariance(up, lag, 0.0) / (std_w * std_w), std::exp(-t / time_w) * (1.0 - 0.5 * t / time_w), tolerance) << lag;
  }
}

// The process is exact for any step size: two short steps equal a long one.
TEST(Wind, DoesNotDependOnTheStep) {
  const WindConfig config{.gusts = Gusts::dryden};
  const auto fine = record(config, 0.25, 800000, 3);
  const auto coarse = record(config, 1.0, 200000, 4);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const std::size_t lag : {0U, 1U, 3U}) {
      const double scale = covariance(coarse[axis], 0, 0.0);
      EXPECT_NEAR(covariance(fine[axis], 4 * lag, 0.0) / scale, covariance(coarse[axis], lag, 0.0) / scale, 0.06);
    }
  }
}

}  // namespace
}  // namespace flockstep::dynamics

namespace flockstep {
namespace {

// -- Downwash of mixed fleets, against its equations in double precision.

using dynamics::Downwash;
using dynamics::Fleet;
using namespace testing;
using WideVec = Eigen::Vector3d;

constexpr std::size_t kWashEnvs = 6, kWashMembers = 10, kWashDrones = kWashEnvs * kWashMembers;
const ClockConfig kWashClock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = {}};

DynamicsConfig with_downwash() { return {.motion = Motion::rotors, .control = Control::rotor_speeds, .downwash = true}; }

struct WashSwarm {
  explicit WashSwarm(std::uint32_t seed) : state(flight_state(kWashEnvs, kWashMembers)) {
    const std::vector<Airframe> frames = different_airframes();
    Random random(seed);
    for (std::size_t drone = 0; drone < kWashDrones; ++drone) {
      index.push_back(static_cast<std::int32_t>(drone % frames.size()));
      const Vec3 at = random.point(1.5F), axis = random.point(1.0F);
      std::copy_n(at.data(), 3, state.position.data() + 3 * drone);
      const Quat q(Eigen::AngleAxisf(random.within(-0.6F, 0.6F), axis.normalized()));
      const std::array<float, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
      std::copy_n(wxyz.data(), 4, state.quat_wxyz.data() + 4 * drone);
      const Airframe& frame = frames[static_cast<std::size_t>(index.back())];
      for (std::size_t rotor = 0; rotor < kMinRotors; ++rotor) {
        state.flight.rotor_speed[kMinRotors * drone + rotor] =
            static_cast<float>(frame.hover_speed()) * random.within(0.8F, 1.2F);
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
    for (std::size_t rotor = 0; rotor < kMinRotors; ++rotor) {
      thrust += frame.thrust_at(static_cast<double>(state.flight.rotor_speed[kMinRotors * drone + rotor]));
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
      for (std::size_t rotor = 0; rotor < kMinRotors; ++rotor) {
        const float found = swarm.fleet->thrust_share[kMinRotors * drone + rotor];
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
    EXPECT_TRUE(is_still(swarm.fleet->thrust_share[kMinRotors * drone]));
  }
}

TEST(Downwash, IsOffForSingleDronesAndWithoutARotorRadius) {
  std::vector<Airframe> frames = different_airframes();
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
