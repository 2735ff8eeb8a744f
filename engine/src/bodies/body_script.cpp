#include "bodies/body_script.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "base/random.hpp"

namespace flockstep::bodies {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr Stream kEpisodeStream = stream_named("body episode");
constexpr Stream kWalkStream = stream_named("body random walk");

Eigen::Vector3d vector_of(const std::array<float, 3>& values) { return {values[0], values[1], values[2]}; }

Quat times(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) { return (a * b).normalized().cast<float>(); }

bool moves_ever(const BodyMotion& motion) {
  switch (motion.kind) {
    case BodyMotionKind::velocity:
      return !vector_of(motion.velocity_mps).isZero(0.0) || !vector_of(motion.turn_rate_dps).isZero(0.0);
    case BodyMotionKind::waypoints:
      return motion.speed_mps > 0.0F;
    case BodyMotionKind::orbit:
      return true;
    case BodyMotionKind::hinge:
      return motion.angle_deg != 0.0F;
    case BodyMotionKind::slider:
      return !vector_of(motion.travel_m).isZero(0.0);
    default:
      return motion.box_min_m != motion.box_max_m;
  }
}

}  // namespace

// Random settings of an episode.
struct BodyScript::Draws {
  double phase;   // phase of the script
  double factor;  // factor of the speed
};

// A swing from 0 to 1 and back.
struct BodyScript::Wave {
  double value;
  double rate;  // 1/s
};

BodyScript::BodyScript(const BodyConfig& config)
    : motion_(config.motion),
      first_{Vec3(config.position_m[0], config.position_m[1], config.position_m[2]),
             Quat(config.quat_wxyz[0], config.quat_wxyz[1], config.quat_wxyz[2], config.quat_wxyz[3]).normalized()},
      moves_(moves_ever(motion_)) {
  if (motion_.kind == BodyMotionKind::waypoints) route_ = Route(motion_);
}

Moment BodyScript::at(double time_s, const ScriptKey& key) const {
  const Draws draws = draws_of(key);
  const double time = draws.factor * time_s;  // s, script time
  Moment moment{first_, {}};
  switch (motion_.kind) {
    case BodyMotionKind::velocity: {
      const Eigen::Vector3d velocity = vector_of(motion_.velocity_mps), rate = kDegree * vector_of(motion_.turn_rate_dps);
      moment.pose.position = (first_.position.cast<double>() + time * velocity).cast<float>();
      const double angle = rate.norm() * time;
      if (angle != 0.0) {
        moment.pose.rotation =
            times(first_.rotation.cast<double>(), Eigen::Quaterniond(Eigen::AngleAxisd(angle, rate.normalized())));
      }
      moment.velocity = {velocity.cast<float>(), rate.cast<float>()};
      break;
    }
    case BodyMotionKind::waypoints:
      return on_route(time_s, draws);
    case BodyMotionKind::orbit:
      moment = turned(kTurn * turns_at(time, draws.phase), kTurn / static_cast<double>(motion_.period_s));
      break;
    case BodyMotionKind::hinge: {
      const double angle = kDegree * static_cast<double>(motion_.angle_deg);
      const Wave wave = wave_at(time, draws.phase);
      moment = turned(angle * wave.value, angle * wave.rate);
      break;
    }
    case BodyMotionKind::slider: {
      const Eigen::Vector3d travel = vector_of(motion_.travel_m);
      const Wave wave = wave_at(time, draws.phase);
      moment.pose.position = (first_.position.cast<double>() + wave.value * travel).cast<float>();
      moment.velocity.linear = (wave.rate * travel).cast<float>();
      break;
    }
    case BodyMotionKind::random_walk:
      moment = walking(time, draws.phase, key);
      break;
  }
  if (draws.factor != 1.0) {
    moment.velocity.linear = (draws.factor * moment.velocity.linear.cast<double>()).cast<float>();
    moment.velocity.angular = (draws.factor * moment.velocity.angular.cast<double>()).cast<float>();
  }
  return moment;
}

BodyScript::Reach BodyScript::within(double time_s) const {
  const double time = time_s * (1.0 + static_cast<double>(motion_.speed_spread));  // s, script time at its fastest
  const double turns = std::min(time / static_cast<double>(motion_.period_s), 1e6);
  const double arc = std::min(std::numbers::pi, std::numbers::pi * turns);  // half the turn of a circle
  const Eigen::Vector3d axis = vector_of(motion_.axis).normalized();
  const double radius = axis.cross(first_.position.cast<double>() - vector_of(motion_.center_m)).norm();
  switch (motion_.kind) {
    case BodyMotionKind::velocity:
      return {kDegree * vector_of(motion_.turn_rate_dps).norm() * time, 0.0};
    case BodyMotionKind::waypoints:
      return {0.0, route_.bend(time * static_cast<double>(motion_.speed_mps))};
    case BodyMotionKind::orbit:
      return {kTurn * turns, radius * (1.0 - std::cos(arc))};
    case BodyMotionKind::hinge: {
      const double angle = std::abs(kDegree * static_cast<double>(motion_.angle_deg));
      const double turn = std::min(angle, angle * std::numbers::pi * turns);
      // The chord's, and that the turn is not uniform.
      return {turn, radius * (1.0 - std::cos(turn / 2.0) + angle / 2.0 * std::min(1.0, arc * arc / 2.0))};
    }
    case BodyMotionKind::slider:
      return {0.0, vector_of(motion_.travel_m).norm() / 2.0 * std::min(2.0, arc * arc / 2.0)};
    default:
      return {0.0, (vector_of(motion_.box_max_m) - vector_of(motion_.box_min_m)).norm() * std::min(1.0, turns / 2.0)};
  }
}

BodyScript::Draws BodyScript::draws_of(const ScriptKey& key) const {
  Draws draws{static_cast<double>(motion_.phase), 1.0};
  if (!motion_.random_phase && motion_.speed_spread == 0.0F) return draws;
  const auto bits = draw(key.seed, key.episode, static_cast<std::uint32_t>(kEpisodeStream), 0, key.body);
  if (motion_.random_phase) draws.phase = static_cast<double>(uniform01(bits[0]));
  draws.factor = 1.0 + static_cast<double>(motion_.speed_spread) * (2.0 * static_cast<double>(uniform01(bits[1])) - 1.0);
  return draws;
}

double BodyScript::turns_at(double time_s, double phase) const {
  const double period = static_cast<double>(motion_.period_s);
  const double turns = std::fmod(time_s, period) / period + phase;
  return turns - std::floor(turns);
}

BodyScript::Wave BodyScript::wave_at(double time_s, double phase) const {
  const double half = std::numbers::pi * turns_at(time_s, phase), sin = std::sin(half), cos = std::cos(half);
  return {sin * sin, kTurn / static_cast<double>(motion_.period_s) * sin * cos};
}

Moment BodyScript::on_route(double time_s, const Draws& draws) const {
  double speed = draws.factor * static_cast<double>(motion_.speed_mps);
  const double length = route_.length();
  double distance = draws.phase * length;
  if (motion_.route == BodyRoute::once) {
    distance += speed * time_s;
    if (distance >= length) {
      distance = length;
      speed = 0.0;
    }
  } else {
    distance = std::fmod(distance + std::fmod(speed * time_s, length), length);
  }
  const Route::Place place = route_.at(distance);
  Moment moment{{place.position.cast<float>(), first_.rotation}, {(speed * place.direction).cast<float>(), Vec3::Zero()}};
  if (motion_.faces_travel) {
    const Eigen::Quaterniond first = first_.rotation.cast<double>();
    const double yaw = std::atan2(place.heading.y(), place.heading.x());
    moment.pose.rotation = times(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())), first);
    moment.velocity.angular = (first.conjugate() * Eigen::Vector3d(0.0, 0.0, speed * place.turn)).cast<float>();
  }
  return moment;
}

Moment BodyScript::turned(double angle, double rate) const {
  const Eigen::Vector3d axis = vector_of(motion_.axis).normalized(), center = vector_of(motion_.center_m);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle, axis)), first = first_.rotation.cast<double>();
  const Eigen::Vector3d arm = turn * (first_.position.cast<double>() - center);
  // The turn leaves its axis where it is, so the body frame sees the axis as at the beginning.
  return {{(center + arm).cast<float>(), times(turn, first)},
          {(rate * axis.cross(arm)).cast<float>(), (rate * (first.conjugate() * axis)).cast<float>()}};
}

Moment BodyScript::walking(double time_s, double phase, const ScriptKey& key) const {
  const double period = static_cast<double>(motion_.period_s);
  const double into = std::fmod(time_s, period);
  const double ways = into / period + phase, done = std::floor(ways);
  const std::int64_t way = std::llround((time_s - into) / period) + static_cast<std::int64_t>(done);
  const Eigen::Vector3d from = point(way, key), to = point(way + 1, key);
  return {{(from + (ways - done) * (to - from)).cast<float>(), first_.rotation},
          {((to - from) / period).cast<float>(), Vec3::Zero()}};
}

Eigen::Vector3d BodyScript::point(std::int64_t number, const ScriptKey& key) const {
  // Numbers above 2^32 continue in the upper bits of the member; bodies have numbers below 2^12.
  static_assert(kMaxBodies <= 1 << 12);
  const auto low = static_cast<std::uint32_t>(number), high = static_cast<std::uint32_t>(number >> 32U) & 0xFFU;
  const auto bits = draw(key.seed, key.episode, static_cast<std::uint32_t>(kWalkStream), low, key.body | (high << 12U));
  Eigen::Vector3d result;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double least = static_cast<double>(motion_.box_min_m[axis]), greatest = static_cast<double>(motion_.box_max_m[axis]);
    result[static_cast<Eigen::Index>(axis)] = least + static_cast<double>(uniform01(bits[axis])) * (greatest - least);
  }
  return result;
}

}  // namespace flockstep::bodies
