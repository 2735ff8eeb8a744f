#include "batch/observation_memory.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "base/dtype.hpp"
#include "base/require.hpp"
#include "batch/checks.hpp"

namespace flockstep {
namespace {

constexpr double kMaxChoices = 256;  // of a discrete action

std::size_t numbers_of(const Field& action) {
  if (is_floating(action.type)) return action.size();
  const double choices = action.high.at(0) - action.low.at(0) + 1.0;
  require(choices <= kMaxChoices, "observed.past_actions", "0 for a task with more than 256 discrete actions", choices);
  return static_cast<std::size_t>(choices);
}

// The field `count` times along its first axis.
Field repeated(Field field, std::size_t count) {
  if (count == 1) return field;
  const auto times = static_cast<std::int64_t>(count);
  if (field.shape.empty()) {
    field.shape = {times};
  } else {
    field.shape[0] *= times;
  }
  for (std::vector<double>* const values : {&field.low, &field.high, &field.absent}) {
    if (values->size() == 1) continue;
    const std::vector<double> once = *values;
    for (std::size_t i = 1; i < count; ++i) values->insert(values->end(), once.begin(), once.end());
  }
  return field;
}

// Adds the numbers of another field to a vector.
void join(Field& field, const Field& more) {
  const std::size_t size = field.size(), more_size = more.size();
  const auto add = [&](std::vector<double>& values, const std::vector<double>& others) {
    if (values.size() == 1) values.assign(size, values[0]);
    for (std::size_t i = 0; i < more_size; ++i) values.push_back(others[others.size() == 1 ? 0 : i]);
  };
  add(field.low, more.low);
  add(field.high, more.high);
  add(field.absent, more.absent);
  field.shape[0] += static_cast<std::int64_t>(more_size);
}

}  // namespace

ObservationMemory::ObservationMemory(const BatchConfig& config, const TaskSpec& of_task, std::size_t rows, std::size_t num_rotors)
    : config_(config.observed),
      privileged_(config.privileged, num_rotors),
      drones_(of_task.row == Row::drone ? 1 : static_cast<std::size_t>(config.drones_per_env)),
      frame_skip_(config.episode.frame_skip),
      step_s_(config.clock.step_s()),
      action_(of_task.action),
      history_(static_cast<std::size_t>(config_.history)),
      past_actions_(static_cast<std::size_t>(config_.past_actions)),
      delay_(steps_in(static_cast<double>(config_.delay_s))),
      max_delay_(steps_in(static_cast<double>(config_.delay_s) + static_cast<double>(config_.jitter_s))),
      size_(history_ + static_cast<std::size_t>(max_delay_)),
      spec_(of_task) {
  const std::vector<Field>& fields = of_task.observation;
  is_joined_ = fields.size() == 1 && fields[0].shape.size() == 1 && is_floating(fields[0].type);
  std::vector<Field> more;
  if (past_actions_ > 0) {
    action_size_ = numbers_of(action_);
    Field past{.name = "past_actions", .shape = {static_cast<std::int64_t>(action_size_)}, .low = {0.0}, .high = {1.0}};
    if (is_floating(action_.type)) {
      past.low = action_.low;
      past.high = action_.high;
      for (double& low : past.low) low = std::min(low, 0.0);
      for (double& high : past.high) high = std::max(high, 0.0);
    }
    more.push_back(repeated(past, past_actions_));
  }
  if (config_.age) {
    const double greatest = static_cast<double>(max_delay_ * frame_skip_) * step_s_;
    more.push_back({.name = "age_s", .shape = {1}, .low = {0.0}, .high = {greatest}});
  }
  require(privileged_.empty() || is_joined_, "privileged", "none unless the task observes a vector of floats",
          config.privileged.size());
  if (!privileged_.empty()) more.push_back(privileged_.field(drones_));
  require(more.empty() || is_joined_ || fields.size() > 1, past_actions_ > 0 ? "observed.past_actions" : "observed.age",
          past_actions_ > 0 ? "0 unless the task observes a vector of floats, or a dict"
                            : "False unless the task observes a vector of floats, or a dict",
          past_actions_ > 0 ? std::to_string(past_actions_) : "True");
  for (Field& field : spec_.observation) field = repeated(std::move(field), history_);
  for (Field& field : more) {
    if (is_joined_) {
      join(spec_.observation[0], field);
    } else {
      spec_.observation.push_back(std::move(field));
    }
  }
  double bytes = 4.0 * static_cast<double>(past_actions_ * action_size_);  // of a row
  for (const Field& field : fields) {
    bytes += static_cast<double>(size_ + 1) * static_cast<double>(field.size() * size_of(field.type));
  }
  checks::memory(bytes * static_cast<double>(rows));
  for (const Field& field : fields) {
    newest_.emplace_back(field, rows);
    ring_.emplace_back(field, rows * size_);
  }
  actions_.resize(rows * past_actions_ * action_size_);
  if (config_.jitter_s == 0.0F) return;
  arrival_.resize(rows * size_);
  arrived_.resize(rows * history_);
}

std::int64_t ObservationMemory::steps_in(double late_s) const {
  constexpr double kTolerance = 1e-3;  // steps: rates and delays are float32
  return static_cast<std::int64_t>(std::ceil(late_s / (step_s_ * static_cast<double>(frame_skip_)) - kTolerance));
}

std::int64_t ObservationMemory::arrived(std::size_t row, std::int64_t number) const {
  const std::int64_t oldest = std::max<std::int64_t>(number - max_delay_, 0);
  for (std::int64_t i = number; i > oldest; --i) {
    if (arrival_[place(row, i)] <= number) return i;
  }
  return oldest;
}

void ObservationMemory::keep_action(std::size_t row, std::int64_t number, const Buffer& actions) {
  float* const to = actions_.data() + (row * past_actions_ + static_cast<std::size_t>(number) % past_actions_) * action_size_;
  with_type(actions.type(), [&]<class T>(T) {
    const std::span<const T> action = actions.row<T>(row);
    if constexpr (std::is_integral_v<T>) {
      const double choice = static_cast<double>(action[0]) - action_.low[0];
      for (std::size_t i = 0; i < action_size_; ++i) to[i] = choice == static_cast<double>(i) ? 1.0F : 0.0F;
    } else {
      for (std::size_t i = 0; i < action_size_; ++i) {
        const double low = action_.low[action_.low.size() == 1 ? 0 : i], high = action_.high[action_.high.size() == 1 ? 0 : i];
        const auto value = static_cast<double>(action[i]);
        to[i] = std::isnan(value) ? 0.0F : static_cast<float>(std::clamp(value, low, high));
      }
    }
  });
}

template <class T>
void ObservationMemory::write_rest(const State& state, std::size_t row, std::int64_t number, float age_s,
                                   std::span<Buffer> observation) const {
  std::size_t field = is_joined_ ? 0 : newest_.size();
  std::size_t at = is_joined_ ? history_ * newest_[0].columns() : 0;
  if (past_actions_ > 0) {
    T* to = observation[field].row<T>(row).data() + at;
    for (std::size_t k = 0; k < past_actions_; ++k, to += action_size_) {
      const std::int64_t action = number - 1 - static_cast<std::int64_t>(k);
      if (action < 0) {
        std::fill_n(to, action_size_, T{0});
        continue;
      }
      const std::size_t from = row * past_actions_ + static_cast<std::size_t>(action) % past_actions_;
      std::copy_n(actions_.data() + from * action_size_, action_size_, to);
    }
    if (is_joined_) at += past_actions_ * action_size_;
    if (!is_joined_) ++field;
  }
  if (config_.age) observation[field].row<T>(row)[at] = static_cast<T>(age_s);
  if (config_.age) ++at;
  for (std::size_t i = 0; i < drones_ && !privileged_.empty(); ++i) {
    privileged_.write(state, DroneIndex(row * drones_ + i), observation[field].row<T>(row).data() + at + i * privileged_.size());
  }
}

void ObservationMemory::show(const State& state, RandomKey key, std::size_t row, std::int64_t steps, const Buffer& actions,
                             std::span<Buffer> observation) {
  const std::int64_t number = (steps + frame_skip_ - 1) / frame_skip_;
  if (past_actions_ > 0 && number > 0) keep_action(row, number - 1, actions);
  for (std::size_t i = 0; i < ring_.size(); ++i) {
    std::ranges::copy(newest_[i].row_as_bytes(row), ring_[i].row_as_bytes(place(row, number)).begin());
  }
  const bool has_jitter = !arrival_.empty();
  if (has_jitter) {
    constexpr Stream kStream = stream_named("observation");
    const auto u = static_cast<double>(uniform01(draw(state, key, kStream, static_cast<std::uint32_t>(number))[0]));
    const double late_s = static_cast<double>(config_.delay_s) + u * static_cast<double>(config_.jitter_s);
    arrival_[place(row, number)] = number == 0 ? 0 : number + steps_in(late_s);
    arrived_[row * history_ + static_cast<std::size_t>(number) % history_] = arrived(row, number);
  }
  std::int64_t newest = 0;
  for (std::size_t k = 0; k < history_; ++k) {
    const std::int64_t then = number - static_cast<std::int64_t>(k);
    std::int64_t shown = std::max<std::int64_t>(then - delay_, 0);
    if (has_jitter) shown = then <= 0 ? 0 : arrived_[row * history_ + static_cast<std::size_t>(then) % history_];
    if (k == 0) newest = shown;
    for (std::size_t i = 0; i < ring_.size(); ++i) {
      const std::size_t size = ring_[i].row_bytes();
      std::memcpy(observation[i].row_as_bytes(row).data() + k * size, ring_[i].row_as_bytes(place(row, shown)).data(), size);
    }
  }
  if (past_actions_ == 0 && !config_.age && privileged_.empty()) return;
  const std::int64_t passed = newest == number ? 0 : steps - newest * frame_skip_;
  const auto age_s = static_cast<float>(static_cast<double>(passed) * step_s_);
  if (is_joined_ && newest_[0].type() == DType::float64) {
    write_rest<double>(state, row, number, age_s, observation);
  } else {
    write_rest<float>(state, row, number, age_s, observation);
  }
}

void ObservationMemory::visit(ArrayVisitor& visitor) {
  for (Buffer& buffer : ring_) visitor.bytes("past_observation", buffer.bytes(), buffer.type());
  visitor.array("past_action", actions_);
  visitor.array("observation_arrival", arrival_);
  visitor.array("arrived_observation", arrived_);
}

void ObservationMemory::check() const {
  const auto are_numbers = [](const std::vector<std::int64_t>& values) {
    return std::ranges::all_of(values, [](std::int64_t value) { return value >= 0; });
  };
  require(are_numbers(arrival_), "snapshot: observation_arrival", "numbers >= 0", "another");
  require(are_numbers(arrived_), "snapshot: arrived_observation", "numbers >= 0", "another");
}

}  // namespace flockstep
