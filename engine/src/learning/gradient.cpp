// A Learner learns by the derivatives of the flight ("analytic policy gradients"): the loss of a window of steps is
// differentiated backwards through the equations of flight, the observations and the network.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "batch/simulation.hpp"
#include "flockstep/batch.hpp"
#include "learning/late_commands.hpp"
#include "learning/learner_parts.hpp"
#include "learning/step_pilot.hpp"

namespace flockstep {

using namespace learning;
using dynamics::kLanes, dynamics::Lane, dynamics::Lanes;
using task::kActions;

namespace {

constexpr float kBeta2 = 0.99F;
constexpr std::size_t kMaxWindow = 1 << 22;  // of a window, all rows together: some 2 GB
constexpr float kOvershoot = 0.02F;          // derivative of the loss by each unit of an action beyond its bounds

// The name that begins a task's identity.
std::string task_name(const Task& task) {
  const std::string identity = task.identity();
  return identity.substr(0, identity.find(' '));
}

// The fields that are not at their defaults.
std::string told(const ObservationConfig& config) {
  const ObservationConfig usual;
  std::ostringstream text;
  for_each_field(config, [&](const auto& field, const auto& value) {
    if (value != usual.*field.member) text << (text.tellp() > 0 ? ", " : "") << field.name << '=' << value;
  });
  return text.str();
}

// The tasks' part of a window, and the physics to differentiate.
struct Differentiated {
  Differentiated(Simulation& simulation, int ticks)
      : sim(simulation), task(dynamic_cast<task::FlightGradient*>(simulation.task_state->task.get())), fleet(*simulation.fleet) {
    gradient = std::make_unique<dynamics::StepGradient>(fleet, ticks);
  }

  Simulation& sim;
  task::FlightGradient* task;
  dynamics::Fleet& fleet;
  std::unique_ptr<dynamics::StepGradient> gradient;
  std::vector<float> row;  // scratch: constants of a drone

  void read_numbers(const GradientGroup& group, task::GroupNumbers& numbers) const {
    gradient->read_numbers(sim.state, group.drones, numbers.numbers);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const task::ActionRanges& ranges = task->ranges_of(*sim.context, group.drones[lane]);
      for (std::size_t i = 0; i < kActions; ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        numbers.middle[i][lane] = ranges.middle()[at];
        numbers.down[i][lane] = ranges.down()[at];
        numbers.up[i][lane] = ranges.up()[at];
      }
    }
  }

  // Reads what the drones of a group begin a step with.
  void begin(GradientGroup& group, std::size_t t) {
    task::GradientStep& step = group.steps[t];
    gradient->read(sim.state, group.drones, step.start);
    const std::size_t count = task->num_constants();
    step.constants.resize(count);
    row.resize(count);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      task->write_constants(*sim.context, group.drones[lane], row.data());
      for (std::size_t i = 0; i < count; ++i) step.constants[i][lane] = row[i];
      const float* const last = task->last_actions().data() + kActions * group.drones[lane];
      for (std::size_t i = 0; i < kActions; ++i) step.action_before[i][lane] = last[i];
    }
    if (t == 0 ||
        (fleet.has_parameters() && std::ranges::find(group.steps[t - 1].goes_on, 0.0F) != group.steps[t - 1].goes_on.end())) {
      if (t == 0) group.numbers.clear();
      read_numbers(group, group.numbers.emplace_back());
    }
    group.number_of[t] = group.numbers.size() - 1;
  }

  // Reads where it ended.
  void end(GradientGroup& group, std::size_t t, const float* chosen, std::size_t rows, float weight, float discount) {
    task::GradientStep& step = group.steps[t];
    dynamics::StepGradient::read(sim.state, group.drones, step.after);
    const Outputs& outputs = sim.outputs.now();
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const DroneIndex drone = group.drones[lane];
      const bool is_copy = lane > 0 && drone == group.drones[lane - 1];
      const bool flew = !is_copy && sim.episodes.flying[drone] != 0;
      step.weight[lane] = flew ? weight : 0.0F;
      const bool goes_on = flew && outputs.terminated[drone] == 0 && outputs.truncated[drone] == 0;
      step.goes_on[lane] = goes_on ? 1.0F : 0.0F;
      step.discount[lane] = goes_on ? discount : 0.0F;
      for (std::size_t i = 0; i < kActions; ++i) {
        step.action[i][lane] = std::clamp(chosen[kActions * (drone + rows * t) + i], -1.0F, 1.0F);
      }
      for (std::size_t i = 0; i < row.size(); ++i) row[i] = step.constants[i][lane];
      task->write_results(*sim.context, drone, row.data());
      for (std::size_t i = 0; i < row.size(); ++i) step.constants[i][lane] = row[i];
    }
  }
};

// The derivative of a number of a drone's command by that of its action.
float slope_of(const task::GroupNumbers& numbers, const task::GradientStep& step, std::size_t i, std::size_t lane) {
  return step.action[i][lane] > 0.0F ? numbers.up[i][lane] : numbers.down[i][lane];
}

// Writes the commands that were flown in the ticks of a step, the mean of several. Drones that did not fly get that of their
// action.
void write_commands(const LateCommands& late, const GradientGroup& group, std::size_t t, task::TickCommands& to) {
  const task::GroupNumbers& numbers = group.numbers[group.number_of[t]];
  std::ranges::fill(to.command, Lanes<kActions>{});
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    bool flew = false;
    late.for_each_part(group.drones[lane], t, to.command.size(),
                       [&](std::size_t tick, float share, const LateCommands::Stretch& stretch) {
                         for (std::size_t i = 0; i < kActions; ++i) to.command[tick][i][lane] += share * stretch.command[i];
                         flew = true;
                       });
    for (std::size_t i = 0; !flew && i < kActions; ++i) {
      const float command = numbers.middle[i][lane] + slope_of(numbers, group.steps[t], i, lane) * group.steps[t].action[i][lane];
      for (Lanes<kActions>& of_tick : to.command) of_tick[i][lane] = command;
    }
  }
}

// Adds the derivatives by these commands to those by the commands that steps of the window sent.
void add_to_sent(const LateCommands& late, GradientGroup& group, std::size_t t, const task::TickCommands& flown) {
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    late.for_each_part(group.drones[lane], t, flown.d_command.size(),
                       [&](std::size_t tick, float share, const LateCommands::Stretch& stretch) {
                         if (stretch.sent == LateCommands::kBefore) return;
                         Lanes<kActions>& sent = group.d_sent[static_cast<std::size_t>(stretch.sent)];
                         for (std::size_t i = 0; i < kActions; ++i) sent[i][lane] += share * flown.d_command[tick][i][lane];
                       });
  }
}

}  // namespace

void GradientConfig::validate() const { check_fields(*this, ""); }

void Learner::require_derivatives(const GradientConfig& config, const Batch& batch) const {
  const SingleCaller::Call call(parts_->callers);
  config.validate();
  const Parts& parts = *parts_;
  const Simulation& sim = *batch.sim_;
  const auto* const flight = sim.task_state ? dynamic_cast<task::FlightGradient*>(sim.task_state->task.get()) : nullptr;
  require(flight != nullptr, "task", "hover, track or race, whose losses have derivatives",
          sim.task_state ? task_name(*sim.task_state->task) : "none");
  flight->require_derivatives();
  require(sim.config.observed.is_off(), "observed", "observations without history, past actions, delay and age",
          told(sim.config.observed));
  require(sim.config.privileged.empty(), "privileged", "none", sim.config.privileged.empty() ? "" : sim.config.privileged[0]);
  require(sim.config.episode.frame_skip == 1, "frame_skip", "1", sim.config.episode.frame_skip);
  require(!sim.controller, "controller", "the built-in one, which has derivatives", "another");
  dynamics::StepGradient::require_derivatives(*sim.fleet);
  parts.require_fits(batch, sim.num_drones());
  require(!parts.config.is_discrete && parts.action_size() == kActions, "batch", "a task with four numbers as an action",
          parts.action_size());
  require(parts.config.features == Features::flat || parts.config.features == Features::point, "features",
          "\"flat\" or \"point\", which have derivatives",
          EnumNames<Features>::kNames[static_cast<std::size_t>(parts.config.features)]);
  require(!parts.rollout.config.normalize_observations, "normalize_observations", "False", "True");
  require(static_cast<std::size_t>(config.horizon) * sim.num_drones() <= kMaxWindow, "horizon",
          "at most " + std::to_string(kMaxWindow) + " steps, horizon times envs",
          static_cast<std::size_t>(config.horizon) * sim.num_drones());
}

GradientReport Learner::learn_window(const GradientConfig& config, Batch& batch) {
  const SingleCaller::Call call(parts_->callers);
  require_derivatives(config, batch);
  Parts& parts = *parts_;
  Simulation& sim = *batch.sim_;
  Differentiated flight(sim, config.ticks);

  if (!parts.window) parts.window = std::make_unique<GradientWindow>();
  GradientWindow& window = *parts.window;
  const std::size_t rows = sim.num_drones(), steps = static_cast<std::size_t>(config.horizon);
  const std::size_t stride = parts.input_stride, size = parts.observation_size;
  window.memory.resize(static_cast<std::size_t>(parts.workers.num_threads()));
  window.inputs.resize(steps * rows * stride);
  window.observation.resize(steps * rows * size);
  window.chosen.resize(steps * rows * kActions);
  window.groups.resize((rows + kLanes - 1) / kLanes);
  for (std::size_t g = 0; g < window.groups.size(); ++g) {
    GradientGroup& group = window.groups[g];
    for (std::size_t lane = 0; lane < kLanes; ++lane) group.drones[lane] = DroneIndex(std::min(kLanes * g + lane, rows - 1));
    group.steps.resize(steps);
    group.number_of.resize(steps);
  }
  const TaskSpec& spec = batch.spec();
  const std::vector<std::size_t> fields = by_name(spec.observation);
  parts.make_passes(batch);

  std::optional<LateCommands> late;
  if (!flight.fleet.commands.empty()) late.emplace(flight.fleet, sim.state, rows);

  GradientReport report;
  double weight = 1.0 / static_cast<double>(rows * steps);
  for (std::size_t t = 0; t < steps; ++t) {
    if (late) late->begin_step();
    for (GradientGroup& group : window.groups) flight.begin(group, t);
    Parts::StepPilot pilot(
        parts, window.chosen.data() + t * rows * kActions, spec, fields, [&](Pass& pass, std::size_t from, std::size_t count) {
          const std::size_t first = t * rows + from, out = padded(kActions);
          std::copy_n(pass.inputs(), count * stride, window.inputs.data() + first * stride);
          const float* const means = pass.forward_actor(parts.parameters.data(), parts.transposed.data(), count);
          for (std::size_t i = 0; i < count; ++i) {
            std::copy_n(means + i * out, kActions, window.chosen.data() + (first + i) * kActions);
          }
        });
    for (std::size_t row = 0; row < rows; ++row) {
      write_row(batch.outputs().observation, fields, row, window.observation.data() + (t * rows + row) * size);
    }
    batch.step(pilot);
    pilot.require_finite_observations();
    for (GradientGroup& group : window.groups)
      flight.end(group, t, window.chosen.data(), rows, static_cast<float>(weight),
                 t + 1 < steps ? static_cast<float>(config.gamma) : 0.0F);
    const Outputs& after = batch.outputs();
    for (std::size_t row = 0; row < rows; ++row) {
      if (sim.episodes.flying[row] == 0 || (after.terminated[row] == 0 && after.truncated[row] == 0)) continue;
      ++report.episodes;
      report.successes += after.success[row];
    }
    weight *= config.gamma;
  }
  if (late) late->begin_step();
  require_finite(window.chosen, kActions, "action");

  // Backwards, some rows at a time.
  constexpr std::size_t kGroups = Pass::kRows / kLanes;
  const std::size_t chunks = (window.groups.size() + kGroups - 1) / kGroups;
  if (parts.gradients.size() < chunks) parts.gradients.resize(chunks);
  std::vector<double> losses(chunks);
  const task::Terms terms = flight.task->terms();
  const Control control = sim.config.dynamics.control;
  parts.workers.run(chunks, [&](std::size_t chunk, std::size_t thread) {
    AlignedVector<float>& gradient = parts.gradients[chunk];
    gradient.assign(parts.network.num_padded, 0.0F);
    Pass& pass = parts.passes[thread];
    const std::size_t first = chunk * Pass::kRows, count = std::min(Pass::kRows, rows - first);
    const auto groups =
        std::span(window.groups).subspan(chunk * kGroups, std::min(kGroups, window.groups.size() - chunk * kGroups));
    AlignedVector<float> d_inputs(Pass::kRows * padded(parts.network.actor.front().in));
    std::vector<float> d_row(size);
    AlignedVector<Lane> d_observation(size);
    task::TickCommands flown;
    if (late) {
      flown.command.resize(static_cast<std::size_t>(config.ticks));
      flown.d_command.resize(static_cast<std::size_t>(config.ticks));
    }
    for (GradientGroup& group : groups) {
      group.d_flown = {};
      group.d_action = {};
      if (late) group.d_sent.assign(steps, {});
    }
    for (std::size_t t = steps; t-- > 0;) {
      Interrupt::poll();
      const std::size_t out = padded(kActions);
      for (GradientGroup& group : groups) {
        const task::GradientStep& step = group.steps[t];
        alignas(64) Lanes<4> d_action, d_before;
        const task::GroupNumbers& numbers = group.numbers[group.number_of[t]];
        if (late) write_commands(*late, group, t, flown);
        losses[chunk] += task::pull_back_step(terms, *flight.gradient, control, numbers, step, window.memory[thread],
                                              group.d_flown, d_action, d_before, late ? &flown : nullptr);
        if (late) add_to_sent(*late, group, t, flown);
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
          const std::size_t row = static_cast<std::size_t>(&group - window.groups.data()) * kLanes + lane;
          if (row >= rows) break;
          for (std::size_t i = 0; i < kActions; ++i) {
            const float chosen = window.chosen[kActions * (t * rows + row) + i];
            float d = d_action[i][lane] + (step.goes_on[lane] > 0.5F ? group.d_action[i][lane] : 0.0F);
            if (late) d += slope_of(numbers, step, i, lane) * group.d_sent[t][i][lane];
            // A limited action has the derivative only if it leads back inside.
            if ((chosen > 1.0F && d < 0.0F) || (chosen < -1.0F && d > 0.0F)) d = 0.0F;
            d += kOvershoot * step.weight[lane] * (chosen - step.action[i][lane]);
            pass.actor_gradients()[(row - first) * out + i] = d;
          }
        }
        group.d_action = d_before;
      }
      std::copy_n(window.inputs.data() + (t * rows + first) * stride, count * stride, pass.inputs());
      pass.forward_actor(parts.parameters.data(), parts.transposed.data(), count);
      pass.backward_actor(parts.parameters.data(), count, gradient.data(), d_inputs.data());
      if (t == 0) break;
      for (GradientGroup& group : groups) {
        std::ranges::fill(d_observation, Lane{});
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
          const std::size_t row = static_cast<std::size_t>(&group - window.groups.data()) * kLanes + lane;
          if (row >= rows) break;
          pull_back_inputs(parts.config.features, window.observation.data() + (t * rows + row) * size,
                           d_inputs.data() + (row - first) * padded(parts.network.actor.front().in), parts.actor_size,
                           d_row.data());
          for (std::size_t i = 0; i < parts.actor_size; ++i) d_observation[i][lane] = d_row[i];
        }
        task::pull_back_observation(terms, group.steps[t], std::span(d_observation).first(size), window.memory[thread],
                                    group.d_flown, group.d_action);
      }
    }
  });
  for (std::size_t chunk = 1; chunk < chunks; ++chunk)
    add(parts.gradients[chunk].data(), parts.network.num_padded, parts.gradients[0].data());
  for (const double loss : losses) report.loss += loss;
  double squares = 0.0;
  for (const float value : parts.gradients[0]) squares += static_cast<double>(value) * static_cast<double>(value);
  report.gradient_norm = std::sqrt(squares);
  report.is_finite = std::isfinite(squares) && std::isfinite(report.loss);
  if (!report.is_finite) return report;
  const double time = static_cast<double>(++parts.adam_steps);
  adam({.step_size = static_cast<float>(config.learning_rate / (1.0 - std::pow(0.9, time))),
        .root_of_bias_2 = static_cast<float>(std::sqrt(1.0 - std::pow(static_cast<double>(kBeta2), time))),
        .scale = static_cast<float>(std::min(1.0, config.max_grad_norm / (report.gradient_norm + 1e-6))),
        .beta2 = kBeta2},
       parts.gradients[0].data(), parts.network.num_padded, parts.parameters.data(), parts.adam_m.data(), parts.adam_v.data());
  parts.prepare();
  return report;
}

std::vector<float> Learner::window_gradient() const {
  const SingleCaller::Call call(parts_->callers);
  require(parts_->window != nullptr, "window_gradient", "a window before it", "none");
  return parts_->network.packed(parts_->gradients[0]);
}

}  // namespace flockstep
