// StepPilot: lets a Learner choose the actions of a batch within its step.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numeric>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/dtype.hpp"
#include "base/finite.hpp"
#include "flockstep/pilot.hpp"
#include "flockstep/task.hpp"
#include "learning/learner_parts.hpp"

namespace flockstep {
namespace learning {

// Appends a row of a field, as numbers.
inline void append_row(const Buffer& field, std::size_t row, float*& to) {
  with_type(field.type(), [&]<class T>(T) {
    for (const T value : field.row<T>(row)) *to++ = static_cast<float>(value);
  });
}

// Writes the fields of a row in the given order.
inline void write_row(const std::vector<Buffer>& observation, const std::vector<std::size_t>& fields, std::size_t row,
                      float* to) {
  for (const std::size_t field : fields) append_row(observation[field], row, to);
}

// Returns the fields in the order of their names, which is that of Gymnasium's dict spaces.
inline std::vector<std::size_t> by_name(const std::vector<Field>& fields) {
  std::vector<std::size_t> order(fields.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return fields[a].name < fields[b].name; });
  return order;
}

}  // namespace learning

// Chooses the actions of a step within a step of a batch.
class Learner::Parts::StepPilot : public Pilot {
 public:
  // choose(pass, first row, rows) writes the actions of rows, whose inputs are those of the pass, to `chosen`, (R, action_size).
  using Choose = std::function<void(Pass&, std::size_t, std::size_t)>;
  StepPilot(Parts& parts, const float* chosen, const TaskSpec& spec, const std::vector<std::size_t>& fields, Choose choose)
      : parts_(parts),
        chosen_(chosen),
        choose_(std::move(choose)),
        fields_(fields),
        low_(spec.action.low),
        high_(spec.action.high) {}

  void act(const PilotedRows& rows, Buffer& actions) override {
    Pass& pass = parts_.passes[rows.thread];
    std::vector<float> observation(parts_.observation_size), normalised;
    for (std::size_t from = rows.first; from < rows.first + rows.count; from += Pass::kRows) {
      const std::size_t count = std::min(Pass::kRows, rows.first + rows.count - from);
      for (std::size_t i = 0; i < count; ++i) {
        learning::write_row(rows.observation, fields_, from + i, observation.data());
        if (!are_finite(observation)) {
          note_bad(from + i);
          std::fill(observation.begin(), observation.end(), 0.0F);
        }
        parts_.write_inputs(observation, normalised, pass.inputs() + i * parts_.input_stride);
      }
      choose_(pass, from, count);
      for (std::size_t i = 0; i < count; ++i) write_action(from + i, actions);
    }
  }

  // Throws NotFiniteError if an observation was not finite; its row then flew the action for zeros.
  void require_finite_observations() const {
    if (bad_row_ == kNoRow) return;
    throw NotFiniteError("observation: expected finite numbers, got others in row " + std::to_string(bad_row_));
  }

 private:
  static constexpr std::size_t kNoRow = SIZE_MAX;

  // Keeps the lowest row whose observation is not finite.
  void note_bad(std::size_t row) {
    std::size_t known = bad_row_.load();
    while (row < known && !bad_row_.compare_exchange_weak(known, row)) {
    }
  }

  void write_action(std::size_t row, Buffer& actions) const {
    const float* const drawn = chosen_ + row * parts_.action_size();
    with_type(actions.type(), [&]<class T>(T) {
      if constexpr (std::is_floating_point_v<T>) {
        limit(drawn, actions.row<T>(row));
      } else {
        actions.row<T>(row)[0] = static_cast<T>(low_[0] + static_cast<double>(*drawn));
      }
    });
  }

  // Writes an action, limited to the bounds. NaN becomes the lower bound; fly() refuses it after the step.
  template <class T>
  void limit(const float* drawn, std::span<T> action) const {
    for (std::size_t i = 0; i < action.size(); ++i) {
      const T low = static_cast<T>(low_[low_.size() == 1 ? 0 : i]), high = static_cast<T>(high_[high_.size() == 1 ? 0 : i]);
      const T value = static_cast<T>(drawn[i]);
      action[i] = value > low ? std::min(value, high) : low;
    }
  }

  Parts& parts_;
  const float* chosen_;
  Choose choose_;
  std::atomic<std::size_t> bad_row_{kNoRow};
  const std::vector<std::size_t>& fields_;  // indices of the observation's fields, in the order of their names
  const std::vector<double>&low_, &high_;   // bounds: one for an action, or one for each of its values
};

}  // namespace flockstep
