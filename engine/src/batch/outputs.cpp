#include "batch/outputs.hpp"

#include <algorithm>
#include <type_traits>

#include "base/dtype.hpp"
#include "base/indices.hpp"

namespace flockstep {
namespace {

void clear_row(Outputs& outputs, std::size_t row) {
  const std::size_t terms = outputs.reward_terms.size() / outputs.reward.size();
  for_each_listed(outputs, [&](const auto& entry, auto& values) {
    const std::size_t width = entry.info.per == Per::term ? terms : 1;
    std::fill_n(values.data() + row * width, width, typename std::remove_reference_t<decltype(values)>::value_type{});
  });
}

// Fills a row with one value for all elements or one for each.
void fill_row(Buffer& buffer, std::size_t row, const std::vector<double>& values) {
  with_type(buffer.type(), [&]<class T>(T) {
    const std::span<T> to = buffer.row<T>(row);
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = static_cast<T>(values.size() == 1 ? values[0] : values[i]);
  });
}

}  // namespace

void OutputSlots::allocate(const TaskSpec& spec, const ArraySizes& sizes) {
  for (FlagArray& has_final : has_final_) has_final.resize(sizes.num_task_rows);
  for (Outputs& slot : slots_) {
    for (const Field& field : spec.observation) {
      slot.observation.emplace_back(field, sizes.num_task_rows);
      slot.final_observation.emplace_back(field, sizes.num_task_rows);
    }
    flockstep::allocate(slot, sizes);
  }
}

void OutputSlots::turn_and_copy() {
  const Outputs& from = now();
  turn();
  now() = from;  // the arrays have the same size: nothing is allocated, and views stay valid
  has_final_[current_] = has_final_[1 - current_];
}

void OutputSlots::clear(std::size_t row) { clear_row(now(), row); }

void OutputSlots::carry_over(std::size_t row) {
  const Outputs& from = before();
  Outputs& to = now();
  for (std::size_t i = 0; i < to.observation.size(); ++i) {
    to.observation[i].copy_row(row, from.observation[i]);
    to.final_observation[i].copy_row(row, from.final_observation[i]);
  }
  has_final_[current_][row] = has_final_[1 - current_][row];
  const std::size_t terms = to.reward_terms.size() / to.reward.size();
  for_each_listed(to, [&](const auto& entry, auto& values) {
    const std::size_t width = entry.info.per == Per::term ? terms : 1;
    std::copy_n((from.*entry.member).data() + row * width, width, values.data() + row * width);
  });
  to.reward[row] = 0.0F;
  std::fill_n(to.reward_terms.data() + row * terms, terms, 0.0F);
}

void OutputSlots::keep_final(std::size_t row) {
  Outputs& outputs = now();
  for (std::size_t i = 0; i < outputs.observation.size(); ++i) {
    outputs.final_observation[i].copy_row(row, outputs.observation[i]);
  }
  has_final_[current_][row] = 1;
}

void OutputSlots::forget_final(std::size_t first, std::size_t count) {
  if (!is_any(has_final_[current_].data() + first, count)) return;
  for (std::size_t row = first; row < first + count; ++row) {
    if (has_final_[current_][row]) clear_final(row);
  }
}

void OutputSlots::clear_final(std::size_t row) {
  for (Buffer& buffer : now().final_observation) std::ranges::fill(buffer.row_as_bytes(row), std::byte{0});
  has_final_[current_][row] = 0;
}

void OutputSlots::restored() { std::ranges::fill(has_final_[current_], std::uint8_t{1}); }

void OutputSlots::rest(const TaskSpec& spec, std::size_t row) {
  clear(row);
  show_absent(spec, row);
}

void OutputSlots::show_absent(const TaskSpec& spec, std::size_t row) {
  for (std::size_t i = 0; i < spec.observation.size(); ++i) fill_row(now().observation[i], row, spec.observation[i].absent);
}

void OutputSlots::mark_absent(const TaskSpec& spec, std::size_t row) {
  for (Outputs& slot : slots_) {
    clear_row(slot, row);
    for (Buffer& buffer : slot.final_observation) std::ranges::fill(buffer.row_as_bytes(row), std::byte{0});
    for (std::size_t i = 0; i < spec.observation.size(); ++i) fill_row(slot.observation[i], row, spec.observation[i].absent);
  }
  for (FlagArray& has_final : has_final_) has_final[row] = 0;
}

}  // namespace flockstep
