#include "batch/growth.hpp"

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/indices.hpp"
#include "base/pose_access.hpp"
#include "batch/checks.hpp"
#include "batch/flying.hpp"
#include "flockstep/array_visitor.hpp"

namespace flockstep {
namespace {

constexpr std::size_t kMax = BatchConfig::kMaxDrones;

std::string below(std::size_t end) { return "an integer in [0, " + std::to_string(end) + ")"; }

// Drones per env of a batch that needs at least this many. Doubled, so that drones that come one by one rarely move the arrays.
std::size_t grown_drones_per_env(const Simulation& sim, std::size_t needed) {
  const std::size_t most = std::min(kMax / std::max<std::size_t>(sim.num_envs(), 1), max_drones_per_env(sim.config.interaction));
  return std::max(needed, std::min(std::max<std::size_t>(2 * sim.drones_per_env(), 2), most));
}

SpawnPlan plan_of_indices(const Simulation& sim, std::span<const std::int64_t> indices) {
  SpawnPlan plan{sim.num_envs(), sim.drones_per_env(), {indices.begin(), indices.end()}};
  const auto end = static_cast<std::int64_t>(sim.num_drones());
  // An index beyond the end is a new env if each drone has an env, or a new drone of the only env.
  const bool adds_envs = sim.drones_per_env() == 1;
  const bool grows = !sim.task_state && (adds_envs || sim.num_envs() == 1);
  std::int64_t largest = -1;
  for (std::size_t row = 0; row < indices.size(); ++row) {
    const std::int64_t index = indices[row];
    if (index >= 0 && index < (grows ? static_cast<std::int64_t>(kMax) : end)) {
      largest = std::max(largest, index);
      continue;
    }
    std::string expected = below(grows ? kMax : sim.num_drones());
    if (index >= end && sim.task_state) expected += " (a batch with a task cannot grow)";
    if (index >= end && !sim.task_state && !grows) expected += ", or env=... instead of indices for new drones of an env";
    refuse(checks::row_of("indices", row), expected, index);
  }
  if (largest < end) return plan;
  const auto needed = static_cast<std::size_t>(largest) + 1;
  if (adds_envs) {
    plan.num_envs = needed;
  } else {
    plan.drones_per_env = grown_drones_per_env(sim, needed);
  }
  return plan;
}

SpawnPlan plan_of_envs(const Simulation& sim, std::span<const std::int64_t> envs) {
  const std::size_t m = sim.drones_per_env();
  SpawnPlan plan{sim.num_envs(), m, {}};
  std::vector<std::size_t> members(envs.size());             // the chosen slot of each row
  std::vector<std::size_t> next_member(sim.num_envs(), 0U);  // the lowest slot of each env that may be free
  std::size_t needed = m;
  for (std::size_t row = 0; row < envs.size(); ++row) {
    if (envs[row] < 0 || static_cast<std::size_t>(envs[row]) >= sim.num_envs()) {
      refuse(checks::row_of("env", row), below(sim.num_envs()), envs[row]);
    }
    const EnvIndex env(envs[row]);
    std::size_t& member = next_member[env];
    while (member < m && sim.state.active[sim.drone_of(env, member)]) ++member;
    if (member >= m && sim.task_state) {
      refuse(checks::row_of("env", row), "an env with an inactive slot (a batch with a task cannot grow)", envs[row]);
    }
    members[row] = member++;
    needed = std::max(needed, member);
  }
  if (needed > m) plan.drones_per_env = grown_drones_per_env(sim, needed);
  for (std::size_t row = 0; row < envs.size(); ++row) {
    plan.indices.push_back(envs[row] * static_cast<std::int64_t>(plan.drones_per_env) + static_cast<std::int64_t>(members[row]));
  }
  return plan;
}

SpawnPlan plan_of_count(const Simulation& sim, std::size_t count) {
  const FlagArray& active = sim.state.active;
  const std::size_t e = sim.num_envs(), m = sim.drones_per_env();
  SpawnPlan plan{e, m, {}};
  const std::size_t needed = static_cast<std::size_t>(std::ranges::count(active, 1)) + count;
  require(needed <= kMax, "num_drones", "at most " + std::to_string(kMax) + " drones", needed);
  if (needed > sim.num_drones()) {
    require(!sim.task_state, "position", "no more rows than inactive slots (a batch with a task cannot grow)", count);
    if (m == 1) plan.num_envs = needed;
    if (m != 1) plan.drones_per_env = grown_drones_per_env(sim, (needed + e - 1) / e);
  }
  for (std::size_t env = 0; env < plan.num_envs; ++env) {
    for (std::size_t member = 0; member < plan.drones_per_env; ++member) {
      if (plan.indices.size() == count) return plan;
      if (env < e && member < m && active[env * m + member]) continue;
      plan.indices.push_back(static_cast<std::int64_t>(env * plan.drones_per_env + member));
    }
  }
  return plan;
}

// Copies rows to a larger batch. Drone m of env e keeps both numbers.
struct RowCopy {
  std::size_t num_envs, drones_per_env;          // size of the smaller batch
  std::size_t new_num_envs, new_drones_per_env;  // size of the larger batch

  std::size_t rows(Rows kind) const { return kind == Rows::env ? num_envs : num_envs * drones_per_env; }
  std::size_t new_rows(Rows kind) const { return kind == Rows::env ? new_num_envs : new_num_envs * new_drones_per_env; }

  void operator()(std::span<const std::byte> from, std::span<std::byte> to, Rows kind) const {
    if (from.empty()) return;
    const std::size_t width = from.size() / rows(kind);
    if (kind == Rows::env || drones_per_env == new_drones_per_env) {
      std::ranges::copy(from, to.begin());
      return;
    }
    const std::size_t length = drones_per_env * width;
    for (std::size_t env = 0; env < num_envs; ++env) {
      std::copy_n(from.data() + env * length, length, to.data() + env * new_drones_per_env * width);
    }
  }
  template <HasFields Arrays>
  void operator()(const Arrays& from, Arrays& to, Rows kind) const {
    for_each_listed(to, [&](const auto& entry, auto& values) {
      if (entry.info.rows != kind) return;
      (*this)(std::as_bytes(std::span(from.*entry.member)), std::as_writable_bytes(std::span(values)), kind);
    });
  }
};

// Lists the arrays of a sensor.
class ArrayList final : public ArrayVisitor {
 public:
  void bytes(std::string_view, std::span<std::byte> bytes, std::optional<DType>) override { arrays.emplace_back(bytes); }
  void blob(std::string_view, std::string&) override {}

  std::vector<std::span<const std::byte>> arrays;
};

// Copies the arrays of a sensor from such a list. An array whose rows have another width, such as the ranges of a LiDAR with
// other beams, is left out.
class ArrayCopy final : public ArrayVisitor {
 public:
  ArrayCopy(const ArrayList& from, const sensors::Sensor& to, const RowCopy& copy) : from_(from.arrays), to_(to), copy_(copy) {}

  void bytes(std::string_view name, std::span<std::byte> to, std::optional<DType>) override {
    const std::span<const std::byte> from = from_.at(next_++);
    const std::size_t n = copy_.rows(Rows::drone), new_n = copy_.new_rows(Rows::drone);
    const bool has_rows = n > 0 && from.size() % n == 0 && to.size() % new_n == 0 && from.size() / n == to.size() / new_n;
    if (has_rows) {
      copy_(from, to, Rows::drone);
    } else if (from.size() == to.size()) {  // an array of the whole sensor
      std::ranges::copy(from, to.begin());
    }
    if (name == to_.label()) to_.check_bytes(to);  // settings may not suit another resolution
  }
  void blob(std::string_view, std::string&) override {}

 private:
  const std::vector<std::span<const std::byte>>& from_;
  std::size_t next_ = 0;
  const sensors::Sensor& to_;
  const RowCopy& copy_;
};

void copy_sensor(sensors::Sensor& from, sensors::Sensor& to, const RowCopy& copy) {
  ArrayList list;
  from.visit(list);
  ArrayCopy arrays(list, to, copy);
  to.visit(arrays);
  to.restored();
}

void copy_camera(sensors::Camera& from, sensors::Camera& to, const RowCopy& copy) {
  copy_sensor(from, to, copy);
  if (from.config().width_px == to.config().width_px && from.config().height_px == to.config().height_px) {
    ArrayList list;
    from.visit_images(list);
    ArrayCopy images(list, to, copy);
    to.visit_images(images);
    return;
  }
  for (std::size_t i = 0; i < copy.new_rows(Rows::drone); ++i) to.mark_stale(DroneIndex(i));
}

}  // namespace

std::size_t max_drones_per_env(Interaction interaction) { return interaction == Interaction::none ? kMax : kMaxBodies; }

SpawnPlan plan_spawn(const Simulation& sim, std::span<const std::int64_t> indices, std::span<const std::int64_t> envs,
                     std::size_t count) {
  if (!indices.empty()) return plan_of_indices(sim, indices);
  if (!envs.empty()) return plan_of_envs(sim, envs);
  return plan_of_count(sim, count);
}

std::shared_ptr<Simulation> resized(Simulation& sim, BatchConfig config) {
  config.num_threads = sim.workers.num_threads();  // the renderer has memory for these; the default may have changed meanwhile
  const auto next =
      std::make_shared<Simulation>(std::move(config), sim.worlds, nullptr, sim.drone_model, std::span<const std::int32_t>());
  next->cameras.prepare(next->workers);  // take_over() brings the renderer
  const RowCopy copy{sim.num_envs(), sim.drones_per_env(), next->num_envs(), next->drones_per_env()};
  // Envs come first: the gusts of a new slot depend on the seed and the episode of its env.
  State& state = next->state;
  copy(sim.state, state, Rows::env);
  for (std::size_t i = 0; i < next->num_drones(); ++i) {
    const DroneIndex drone(i);
    const EnvIndex env = next->env_of(drone);
    if (env < sim.num_envs()) {
      if (next->fleet) next->fleet->begin_parameters(state, drone);
      place_at_start(*next, drone);
    }
    state.active[drone] = 0;
  }
  if (sim.bodies) next->bodies->copy(*sim.bodies);
  next->lights.copy(sim.lights);
  next->suite.pose().assume_truth(state);
  copy(sim.state, state, Rows::drone);
  copy(sim.state.contact, state.contact, Rows::drone);
  copy(sim.state.flight, state.flight, Rows::drone);
  copy(sim.state.parameters, state.parameters, Rows::drone);
  if (next->fleet) next->fleet->restored(state);
  for (auto from = sim.suite.begin(), to = next->suite.begin(); from != sim.suite.end(); ++from, ++to) {
    copy_sensor(**from, **to, copy);
  }
  for (std::size_t i = 0; i < sim.suite.lidars().size(); ++i) {
    const sensors::Lidar& from = *sim.suite.lidars()[i];
    sensors::Lidar& to = *next->suite.lidars()[i];
    to.set_has_scanned(from.has_scanned() && sim.config.lidars[i].rows() == next->config.lidars[i].rows() &&
                       sim.config.lidars[i].columns() == next->config.lidars[i].columns());
  }
  for (std::size_t i = 0; i < sim.cameras.size(); ++i) copy_camera(sim.cameras[i], next->cameras[i], copy);
  next->move_lines.copy(sim.move_lines);
  next->embree_use_before = sim.embree_use_of_lidars();
  next->rebuild_schedule();
  return next;
}

namespace checks {

void can_grow(const CallLock& lock, std::string_view call) {
  if (lock.num_calls() == 1) return;
  throw std::logic_error(std::string(call) + "() would move the arrays of the Batch within another call on it");
}

void has_no_task(const Simulation& sim, std::string_view field, int got) {
  require(!sim.task_state, field, "None for a batch with a task (its observations have a fixed shape)", got);
}

void concerns_all(const Simulation& sim, DroneMask mask, std::string_view field) {
  for (std::size_t i = 0; i < sim.num_drones(); ++i) {
    if (mask.selects(DroneIndex(i))) continue;
    refuse("mask", "all drones with " + std::string(field) + ", which they have in common",
           "none for drone " + std::to_string(i));
  }
}

}  // namespace checks
}  // namespace flockstep
