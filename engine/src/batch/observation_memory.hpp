// ObservationMemory: what the agents of a batch observe if it differs from what their task observes: past observations, past
// actions, and late observations. The observations of an episode are numbered from 0; action i is flown between observations i
// and i + 1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/random.hpp"
#include "dynamics/parameters.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/config.hpp"
#include "flockstep/state.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

class ObservationMemory {
 public:
  // Throws std::invalid_argument if the task's observation or action has no place for what the configuration asks.
  ObservationMemory(const BatchConfig& config, const TaskSpec& of_task, std::size_t rows, std::size_t num_rotors);

  // Specification of the agents' observations: the one of the task with longer observations.
  const TaskSpec& spec() const { return spec_; }
  // Rows that the task writes.
  std::span<Buffer> newest() { return newest_; }

  // Remembers the newest observation of a row, after `steps` control steps of its episode, and the action that led to it. Writes
  // what the agent observes then.
  void show(const State& state, RandomKey key, std::size_t row, std::int64_t steps, const Buffer& actions,
            std::span<Buffer> observation);

  void visit(ArrayVisitor& visitor);
  // Throws std::invalid_argument if restored numbers cannot be used.
  void check() const;

 private:
  // Steps after which an observation arrives that is late by this time.
  std::int64_t steps_in(double late_s) const;
  // The newest observation that has arrived with observation `number`, which is already in the ring.
  std::int64_t arrived(std::size_t row, std::int64_t number) const;
  void keep_action(std::size_t row, std::int64_t number, const Buffer& actions);
  template <class T>
  void write_rest(const State& state, std::size_t row, std::int64_t number, float age_s, std::span<Buffer> observation) const;
  std::size_t place(std::size_t row, std::int64_t number) const { return row * size_ + static_cast<std::size_t>(number) % size_; }

  const ObservationConfig config_;
  const dynamics::ShownParameters privileged_;
  const std::size_t drones_;       // in a row
  const std::int64_t frame_skip_;  // control steps in a step of the env
  const double step_s_;            // s per control step
  const Field action_;
  const std::size_t history_, past_actions_;
  const std::int64_t delay_;      // steps of the env
  const std::int64_t max_delay_;  // with the greatest jitter
  const std::size_t size_;        // observations in the ring of a row
  std::size_t action_size_ = 0;   // numbers in a past action
  bool is_joined_ = false;        // actions and age stand behind the numbers of the only observation
  TaskSpec spec_;

  std::vector<Buffer> newest_;         // (R, ...) fields of the task
  std::vector<Buffer> ring_;           // (R, size, ...) fields of the task
  std::vector<float> actions_;         // (R, past_actions, action_size)
  std::vector<std::int64_t> arrival_;  // (R, size) number of the observation with which each arrives; only with jitter
  std::vector<std::int64_t> arrived_;  // (R, history) what had arrived with the last observations; only with jitter
};

}  // namespace flockstep
