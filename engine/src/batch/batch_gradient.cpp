// The state that a flight changes as one array, and the derivatives of a flown step.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/in_world.hpp"
#include "base/pose_access.hpp"
#include "base/require.hpp"
#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "dynamics/step_gradient.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

static_assert(kFlownNumbers == dynamics::kFlown);

void check_finite(std::span<const float> rows, std::size_t columns, std::string_view field) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!std::isfinite(rows[i])) refuse(checks::row_of(field, i / columns), "finite numbers", rows[i]);
  }
}

void check_quadrotors(const Simulation& sim, std::string_view call) {
  checks::flies_by_rotors(sim, call);
  require(sim.fleet->num_rotors() == dynamics::kRotors, "drone", "quadrotors, whose flight has derivatives",
          "one with " + std::to_string(sim.fleet->num_rotors()) + " rotors");
}

}  // namespace

void Batch::flown(std::span<float> out) const {
  const CallGuard guard(*lock_);
  check_quadrotors(*sim_, "flown");
  checks::size(out.size(), kFlownNumbers * sim_->num_drones(), "out");
  dynamics::for_each_flown(sim_->state, [&](const std::vector<float>& array, std::size_t first, std::size_t columns) {
    for (std::size_t drone = 0; drone < sim_->num_drones(); ++drone) {
      std::copy_n(array.data() + columns * drone, columns, out.data() + kFlownNumbers * drone + first);
    }
  });
}

void Batch::set_flown(std::span<const float> rows) {
  const CallGuard guard(*lock_);
  const std::size_t count = sim_->num_drones();
  checks::not_stepping(*sim_, "set_flown");
  check_quadrotors(*sim_, "set_flown");
  checks::size(rows.size(), kFlownNumbers * count, "flown");
  std::array<std::vector<float>, 7> parts;  // in the order of the arrays
  auto part = parts.begin();
  std::vector<std::uint8_t> differs(count);
  dynamics::for_each_flown(sim_->state, [&](const std::vector<float>& array, std::size_t first, std::size_t columns) {
    for (std::size_t drone = 0; drone < count; ++drone) {
      const std::span<const float> given = rows.subspan(kFlownNumbers * drone + first, columns);
      part->insert(part->end(), given.begin(), given.end());
      if (!std::ranges::equal(given, std::span(array).subspan(columns * drone, columns))) differs[drone] = 1;
    }
    ++part;
  });
  const auto& [position, velocity, quat, turn, integral, speed, command] = parts;
  checks::poses(position, quat, count);
  checks::velocity(velocity, count);
  checks::angular_velocity(*sim_, turn, count);
  check_finite(integral, 3, "integral of the velocity error");
  checks::rotor_speeds(*sim_, speed, {});
  checks::rotor_speeds(*sim_, command, {});
  set_pose(position, quat, DroneMask(differs));
  part = parts.begin();
  dynamics::for_each_flown(sim_->state, [&](std::vector<float>& array, std::size_t, std::size_t columns) {
    for (std::size_t drone = 0; drone < count; ++drone) {
      if (!differs[drone] || !sim_->state.active[drone]) continue;
      std::copy_n(part->data() + columns * drone, columns, array.data() + columns * drone);
    }
    ++part;
  });
}

void Batch::pullback(std::span<const float> before, std::span<const float> command, std::span<const float> d_after, int ticks,
                     std::span<float> d_before, std::span<float> d_command) const {
  using namespace dynamics;
  const CallGuard guard(*lock_);
  Simulation& sim = *sim_;
  const std::size_t count = sim.num_drones();
  check_quadrotors(sim, "pullback");
  require(ticks >= 1 && ticks <= 1000, "ticks", "an integer in [1, 1000]", ticks);
  checks::size(before.size(), kFlown * count, "before");
  checks::size(command.size(), 4 * count, "command");
  checks::size(d_after.size(), kFlown * count, "d_after");
  checks::size(d_before.size(), kFlown * count, "d_before");
  checks::size(d_command.size(), 4 * count, "d_command");
  check_finite(before, kFlown, "before");
  check_finite(command, 4, "command");
  check_finite(d_after, kFlown, "d_after");
  for (std::size_t drone = 0; drone < count; ++drone) {
    checks::unit_quaternion(before.data() + kFlown * drone + 6, [&] { return checks::row_of("before", drone); });
  }
  require(sim.fleet->commands.empty(), "variations", "commands that are never late or lost, because flown has none on their way",
          "action_delay_s, action_jitter_s or action_loss");
  const StepGradient gradient(*sim.fleet, ticks);
  std::vector<TapeMemory<float>> memory(static_cast<std::size_t>(sim.workers.num_threads()));
  sim.workers.run((count + kLanes - 1) / kLanes, [&](std::size_t group, std::size_t thread) {
    LaneDrones drones;
    alignas(64) StepStart start{};
    alignas(64) LaneNumbers numbers;
    alignas(64) FlownLanes d_flown{};
    alignas(64) Lanes<4> given{}, d_given{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) drones[lane] = DroneIndex(std::min(kLanes * group + lane, count - 1));
    gradient.read(sim.state, drones, start);
    gradient.read_numbers(sim.state, drones, numbers);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      for (std::size_t i = 0; i < kFlown; ++i) {
        start.flown[i][lane] = before[kFlown * drones[lane] + i];
        d_flown[i][lane] = d_after[kFlown * drones[lane] + i];
      }
      for (std::size_t i = 0; i < 4; ++i) given[i][lane] = command[4 * drones[lane] + i];
    }
    // Flight sets the integral to 0 if its controller has none.
    for (std::size_t i = 13; !has_integral(gradient.physics.stage) && i < kFlownRotor; ++i) d_flown[i] = {};
    pull_back(gradient, sim.config.dynamics.control, start, numbers, given, memory[thread], d_flown, d_given);
    for (std::size_t lane = 0; lane < kLanes && kLanes * group + lane < count; ++lane) {
      const DroneIndex drone = drones[lane];
      const float is_here = sim.state.active[drone] ? 1.0F : 0.0F;
      for (std::size_t i = 0; i < kFlown; ++i) d_before[kFlown * drone + i] = is_here * d_flown[i][lane];
      for (std::size_t i = 0; i < 4; ++i) d_command[4 * drone + i] = is_here * d_given[i][lane];
    }
  });
}

}  // namespace flockstep
