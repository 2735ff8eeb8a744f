// Batches of drones that collide.
#pragma once

#include "base/interrupt.hpp"
#include "batch/contact_groups.hpp"
#include "batch_helpers.hpp"
#include "convex_oracle.hpp"

namespace flockstep::touching {

using namespace testing;

inline constexpr float kReach = 2.5F;  // m, of a hall

inline const DroneModel& met_drone() {
  static const DroneModel model = DroneModel::quadrotor650();
  return model;
}

inline std::shared_ptr<const World> meeting_hall() {
  return make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(kReach + 1, kReach + 1, 1.5F)),
                     primitive(PrimitiveKind::box, {0.5F, 0, 0}, Vec3(0.2F, 0.2F, 1.5F))});
}

struct Many : BatchConfig {
  Many(int envs, int drones, Interaction touched = Interaction::collide) {
    num_envs = envs;
    drones_per_env = drones;
    interaction = touched;
    num_threads = 1;
  }
  Many& by_rotors(OnContact on_contact) {
    dynamics.motion = Motion::rotors;
    dynamics.control = Control::velocity;
    dynamics.on_contact = on_contact;
    dynamics.restitution = 0.6F;
    clock.policy_hz = 10.0F;
    clock.physics_hz = 200.0F;
    return *this;
  }
};

inline oracle::Support hull_of(const Batch& batch, std::size_t drone) {
  const float *const p = batch.state().position.data() + 3 * drone, *const q = batch.state().quat_wxyz.data() + 4 * drone;
  return oracle::hull_at(met_drone(), Vec3(p[0], p[1], p[2]).cast<double>(), Quat(q[0], q[1], q[2], q[3]).cast<double>());
}

inline bool are_apart(const Batch& batch, std::size_t a, std::size_t b) {
  const auto place = [&](std::size_t drone) { return Vec3::Map(batch.state().position.data() + 3 * drone); };
  if ((place(a) - place(b)).norm() > 2.0F * met_drone().radius()) return true;
  return oracle::distance(hull_of(batch, a), hull_of(batch, b)).lower > 0.0;
}

// Pairs of drones that overlap although neither reports it.
inline int unreported_overlaps(const Batch& batch) {
  const auto m = static_cast<std::size_t>(batch.config().drones_per_env),
             n = static_cast<std::size_t>(batch.config().num_drones());
  int count = 0;
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = a + 1; b < n && b / m == a / m; ++b) {
      count += !are_apart(batch, a, b) && !batch.state().contact.inside[a] && !batch.state().contact.inside[b];
    }
  }
  return count;
}

inline Pose any_pose(Random& random, bool level) {
  return {Vec3(random.within(-kReach, kReach), random.within(-kReach, kReach), random.within(-0.8F, 0.8F)),
          level ? Quat(Eigen::AngleAxisf(random.within(-3, 3), Vec3::UnitZ())) : random.rotation()};
}

inline void put(const Pose& pose, std::size_t drone, std::vector<float>& position, std::vector<float>& quat) {
  std::copy_n(pose.position.data(), 3, position.begin() + static_cast<std::ptrdiff_t>(3 * drone));
  const std::array q{pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z()};
  std::copy_n(q.begin(), 4, quat.begin() + static_cast<std::ptrdiff_t>(4 * drone));
}

// Places all drones apart from each other.
inline void scatter(Batch& batch, Random& random, bool level) {
  const auto m = static_cast<std::size_t>(batch.config().drones_per_env),
             n = static_cast<std::size_t>(batch.config().num_drones());
  for (std::size_t drone = 0; drone < n; ++drone) {
    const std::int64_t row = static_cast<std::int64_t>(drone);
    for (int attempt = 0; attempt < 1000; ++attempt) {
      std::vector<float> position(3), quat(4);
      put(any_pose(random, level), 0, position, quat);
      batch.set_pose({&row, 1}, position, quat);
      bool is_apart = true;
      for (std::size_t other = drone / m * m; other < drone && is_apart; ++other) is_apart = are_apart(batch, drone, other);
      if (is_apart) break;
    }
  }
}

struct Targets {
  std::vector<float> position, quat;
};

inline Targets any_targets(const Batch& batch, Random& random, float length) {
  const auto n = static_cast<std::size_t>(batch.config().num_drones());
  Targets targets{std::vector<float>(3 * n), std::vector<float>(4 * n)};
  for (std::size_t drone = 0; drone < n; ++drone) {
    const float *const p = batch.state().position.data() + 3 * drone, *const q = batch.state().quat_wxyz.data() + 4 * drone;
    Pose pose{Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
    if (random.within(0, 1) < 0.8F) pose.position += random.point(length);
    if (random.within(0, 1) < 0.5F)
      pose.rotation =
          (pose.rotation * Quat(Eigen::AngleAxisf(random.within(-0.5F, 0.5F), random.direction().normalized()))).normalized();
    put(pose, drone, targets.position, targets.quat);
  }
  return targets;
}

// A batch whose drone of[i] does what drone i of another one does; -1: it has no such drone.
struct Copy {
  Batch& batch;
  std::vector<int> of;
};

inline std::vector<int> in_order(int count) {
  std::vector<int> of(static_cast<std::size_t>(count));
  std::iota(of.begin(), of.end(), 0);
  return of;
}

// Takes the rows of an array that a copy has.
inline std::vector<float> rows_for(const Copy& copy, const std::vector<float>& rows, std::size_t columns) {
  std::vector<float> taken(columns * static_cast<std::size_t>(copy.batch.config().num_drones()));
  for (std::size_t i = 0; i < copy.of.size(); ++i) {
    if (copy.of[i] < 0) continue;
    std::copy_n(rows.data() + columns * i, columns, taken.data() + columns * static_cast<std::size_t>(copy.of[i]));
  }
  return taken;
}

// Gives a copy the poses of a batch.
inline void place(const Batch& batch, const Copy& copy) {
  copy.batch.set_pose(rows_for(copy, batch.state().position, 3), rows_for(copy, batch.state().quat_wxyz, 4));
}

// Checks that the drones of a copy have the same state, except the numbers of drones that they touched.
inline void expect_same(const Batch& batch, const Copy& copy) {
  const auto n = copy.of.size();
  for_each_array(batch.state(), [&](const std::string& name, const auto& array) {
    if (array.size() % n != 0 || array.empty() || name == "drone") return;
    for_each_array(copy.batch.state(), [&](const std::string& other_name, const auto& other) {
      if (other_name != name) return;
      const std::size_t width = array.size() / n;
      for (std::size_t i = 0; i < n; ++i) {
        if (copy.of[i] < 0) continue;
        EXPECT_TRUE(same_bits(std::span(array).subspan(width * i, width),
                              std::span(other).subspan(width * static_cast<std::size_t>(copy.of[i]), width)))
            << name << " of drone " << i;
      }
    });
  });
}

inline std::vector<Many> kinds_of_contacts(int envs, int drones) {
  return {Many(envs, drones), Many(envs, drones).by_rotors(OnContact::bounce),
          Many(envs, drones).by_rotors(OnContact::terminate)};
}

}  // namespace flockstep::touching
