// The members of Batch that concern bodies.
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "base/in_world.hpp"
#include "base/pose_access.hpp"
#include "base/require.hpp"
#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "batch/task_context.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

constexpr float kMaxBodySpeed = 1e4F;  // m/s
constexpr float kMaxBodyTurn = 1e3F;   // rad/s

bodies::BodyTable& table_of(Simulation& sim) {
  if (!sim.bodies) throw std::invalid_argument("this batch has no slots for bodies: make it with max_bodies=1 or more");
  return *sim.bodies;
}

// The values of a call, one row per body or per env; an empty span leaves the value unchanged.
struct BodyRows {
  std::span<const float> position, quat_wxyz, velocity, angular_velocity;

  void check_sizes(std::size_t rows) const {
    if (!position.empty()) checks::size(position.size(), 3 * rows, "position");
    if (!quat_wxyz.empty()) checks::size(quat_wxyz.size(), 4 * rows, "quat_wxyz");
    if (!velocity.empty()) checks::size(velocity.size(), 3 * rows, "velocity");
    if (!angular_velocity.empty()) checks::size(angular_velocity.size(), 3 * rows, "angular_velocity");
  }

  // Checks one row. `where` says in messages to which body it belongs.
  void check(std::size_t row, const std::string& where, const ClockConfig& clock) const {
    const auto check_vector = [&](std::span<const float> values, const char* field, double most, const char* unit) {
      for (std::size_t i = 3 * row; i < 3 * row + 3 && !values.empty(); ++i) {
        if (std::abs(static_cast<double>(values[i])) <= most) continue;
        std::ostringstream expected;
        expected << "finite numbers within +-" << most << ' ' << unit;
        refuse(field + where, expected.str(), values[i]);
      }
    };
    check_vector(position, "position", kMaxCoordinate, "m");
    check_vector(velocity, "velocity", static_cast<double>(kMaxBodySpeed), "m/s");
    check_vector(angular_velocity, "angular_velocity", static_cast<double>(kMaxBodyTurn), "rad/s");
    if (!angular_velocity.empty()) {
      checks::turn_within_ticks(static_cast<double>(Vec3::Map(angular_velocity.data() + 3 * row).norm()), clock, where);
    }
    if (!quat_wxyz.empty()) checks::unit_quaternion(quat_wxyz.data() + 4 * row, [&] { return "quat_wxyz" + where; });
  }

  Pose pose(std::size_t row, const Pose& now) const { return given_pose(now, row, position, quat_wxyz); }
  Velocity turning(std::size_t row, Velocity now) const {
    if (!velocity.empty()) now.linear = Vec3::Map(velocity.data() + 3 * row);
    if (!angular_velocity.empty()) now.angular = Vec3::Map(angular_velocity.data() + 3 * row);
    return now;
  }
  bool has_pose() const { return !position.empty() || !quat_wxyz.empty(); }
  bool has_velocity() const { return !velocity.empty() || !angular_velocity.empty(); }
};

Pose pose_of_body(const State& state, std::size_t row) {
  return load_pose(state.bodies.position.data() + 3 * row, state.bodies.quat_wxyz.data() + 4 * row);
}
Velocity velocity_of_body(const State& state, std::size_t row) {
  return {Vec3::Map(state.bodies.velocity.data() + 3 * row), Vec3::Map(state.bodies.angular_velocity.data() + 3 * row)};
}

std::string text_of(std::size_t env, std::size_t body) {
  return " of body " + std::to_string(body) + " in env " + std::to_string(env);
}

// Calls f(env, body, row) for each selected active body.
template <class F>
void for_each_body(const Simulation& sim, std::span<const std::uint8_t> mask, const F& f) {
  const std::size_t per_env = sim.bodies->per_env();
  for (std::size_t row = 0; row < sim.state.bodies.active.size(); ++row) {
    if (sim.state.bodies.active[row] && (mask.empty() || mask[row])) f(EnvIndex(row / per_env), row % per_env, row);
  }
}

// Changes bodies after checking all rows that belong to selected ones.
void change(Simulation& sim, const BodyRows& rows, std::span<const std::uint8_t> mask) {
  bodies::BodyTable& table = table_of(sim);
  const std::size_t count = sim.state.bodies.active.size();
  if (!mask.empty()) checks::size(mask.size(), count, "mask");
  rows.check_sizes(count);
  for_each_body(sim, mask,
                [&](EnvIndex env, std::size_t body, std::size_t row) { rows.check(row, text_of(env, body), sim.config.clock); });
  for_each_body(sim, mask, [&](EnvIndex env, std::size_t body, std::size_t row) {
    if (rows.has_pose()) table.set_pose(env, body, rows.pose(row, pose_of_body(sim.state, row)));
    if (rows.has_velocity()) table.set_velocity(env, body, rows.turning(row, velocity_of_body(sim.state, row)));
  });
}

}  // namespace

Batch::Bodies Batch::bodies() { return Bodies(*this); }
const Batch::Bodies Batch::bodies() const { return Bodies(const_cast<Batch&>(*this)); }

std::size_t Batch::Bodies::per_env() const { return batch_->sim_->bodies ? batch_->sim_->bodies->per_env() : 0; }

std::vector<std::int64_t> Batch::Bodies::spawn(const BodyConfig& config, std::span<const float> position,
                                               std::span<const float> quat_wxyz, std::span<const float> velocity,
                                               std::span<const float> angular_velocity, EnvMask mask) {
  const CallGuard guard(*batch_->lock_);
  Simulation& sim = *batch_->sim_;
  bodies::BodyTable& table = table_of(sim);
  config.validate();
  checks::body_within_ticks(config, sim.config.clock, sim.hull.radius());
  checks::mask(sim, mask);
  const BodyRows rows{position, quat_wxyz, velocity, angular_velocity};
  rows.check_sizes(sim.num_envs());
  std::vector<std::int64_t> slots(sim.num_envs(), -1);
  for_each_selected(sim, mask, [&](EnvIndex env) {
    rows.check(env, " of env " + std::to_string(env), sim.config.clock);
    const auto active = std::span(sim.state.bodies.active).subspan(table.row_of(env, 0), table.per_env());
    const auto free = std::ranges::find(active, std::uint8_t{0});
    require(free != active.end(), "env " + std::to_string(env),
            "a free slot for the body \"" + config.name + "\" (max_bodies sets their number)",
            std::to_string(table.per_env()) + " bodies");
    slots[env] = free - active.begin();
  });
  const std::int32_t model = table.add_model(config);
  const BodyMotion& motion = config.motion;
  for_each_selected(sim, mask, [&](EnvIndex env) {
    const auto body = static_cast<std::size_t>(slots[env]);
    table.put(env, body, model);
    const bool is_placed = rows.has_pose() || rows.has_velocity();
    if (motion.kind != BodyMotionKind::velocity && !is_placed) return;  // its script moves it
    const std::size_t row = table.row_of(env, body);
    const Pose first = load_pose(config.position_m.data(), config.quat_wxyz.data());
    table.set_pose(env, body, rows.pose(env, {first.position, first.rotation.normalized()}));
    table.set_velocity(env, body, rows.turning(env, velocity_of_body(sim.state, row)));
  });
  return slots;
}

void Batch::Bodies::remove(std::span<const std::uint8_t> mask) {
  const CallGuard guard(*batch_->lock_);
  bodies::BodyTable& table = table_of(*batch_->sim_);
  if (!mask.empty()) checks::size(mask.size(), batch_->sim_->state.bodies.active.size(), "mask");
  for_each_body(*batch_->sim_, mask, [&](EnvIndex env, std::size_t body, std::size_t) { table.remove(env, body); });
}

void Batch::Bodies::set_pose(std::span<const float> position, std::span<const float> quat_wxyz,
                             std::span<const std::uint8_t> mask) {
  const CallGuard guard(*batch_->lock_);
  change(*batch_->sim_, {.position = position, .quat_wxyz = quat_wxyz, .velocity = {}, .angular_velocity = {}}, mask);
}

void Batch::Bodies::set_velocity(std::span<const float> velocity, std::span<const float> angular_velocity,
                                 std::span<const std::uint8_t> mask) {
  const CallGuard guard(*batch_->lock_);
  change(*batch_->sim_, {.position = {}, .quat_wxyz = {}, .velocity = velocity, .angular_velocity = angular_velocity}, mask);
}

const BodyConfig* Batch::Bodies::config(EnvIndex env, std::size_t body) const {
  const CallGuard guard(*batch_->lock_);
  const bodies::BodyTable& table = table_of(*batch_->sim_);
  const std::size_t envs = batch_->sim_->num_envs();
  require(env < envs, "env", "an integer in [0, " + std::to_string(envs) + ")", std::size_t{env});
  require(body < table.per_env(), "body", "an integer in [0, " + std::to_string(table.per_env()) + ")", body);
  const bodies::BodyModel* const model = table.model_of(env, body);
  return model == nullptr ? nullptr : &model->config;
}

bool Batch::is_free(EnvIndex env, const Pose& pose) const {
  const CallGuard guard(*lock_);
  require(env < sim_->num_envs(), "env", "an index below " + std::to_string(sim_->num_envs()), std::size_t{env});
  return touches_nothing(*sim_, env, std::nullopt, pose);
}

void Batch::is_free(std::span<const std::int64_t> drones, std::span<const float> position, std::span<const float> quat_wxyz,
                    std::span<std::uint8_t> out) const {
  const CallGuard guard(*lock_);
  const Simulation& sim = *sim_;
  checks::indices(drones, sim.num_drones(), "rows");
  const std::size_t count = drones.empty() ? sim.num_drones() : drones.size();
  require(!position.empty() || count == 0, "position", "an array", "none");
  checks::poses(position, quat_wxyz, count);
  checks::size(out.size(), count, "out");
  for (std::size_t row = 0; row < count; ++row) {
    const Pose pose = given_pose({}, row, position, quat_wxyz);
    out[row] = sim.context->is_free(DroneIndex(drones.empty() ? row : static_cast<std::size_t>(drones[row])), pose);
  }
}

}  // namespace flockstep
