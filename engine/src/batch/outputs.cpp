#include "batch/outputs.hpp"

#include <algorithm>
#include <type_traits>

#include "base/contiguous.hpp"

namespace flockstep {
namespace {

void clear_row(Outputs& outputs, std::size_t env) {
  const std::size_t terms = outputs.reward_terms.size() / outputs.reward.size();
  const auto first_term = static_cast<std::ptrdiff_t>(env * terms);
  outputs.reward[env] = 0.0F;
  std::fill_n(outputs.reward_terms.begin() + first_term, terms, 0.0F);
  std::fill_n(outputs.episode_terms.begin() + first_term, terms, 0.0);
  outputs.terminated[env] = outputs.truncated[env] = outputs.success[env] = outputs.crashed[env] = outputs.bad_state[env] = 0;
  outputs.episode_end[env] = static_cast<std::uint8_t>(EpisodeEnd::none);
  outputs.episode_return[env] = 0.0;
  outputs.episode_length[env] = 0;
}

// Writes a value for each element of a row, given one for all or one for each.
void fill_row(Buffer& buffer, std::size_t env, const std::vector<double>& values) {
  const auto write = [&]<class T>(std::span<T> row) {
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<T>(values.size() == 1 ? values[0] : values[i]);
  };
  switch (buffer.type()) {
    case DType::boolean:
    case DType::uint8:
      return write(buffer.row<std::uint8_t>(env));
    case DType::int32:
      return write(buffer.row<std::int32_t>(env));
    case DType::int64:
      return write(buffer.row<std::int64_t>(env));
    case DType::float32:
      return write(buffer.row<float>(env));
    case DType::float64:
      return write(buffer.row<double>(env));
  }
}

}  // namespace

void OutputSlots::allocate(const TaskSpec& spec, std::size_t num_envs) {
  for (FlagArray& has_final : has_final_) has_final.resize(num_envs);
  for (Outputs& slot : slots_) {
    for (const Field& field : spec.observation) {
      slot.observation.emplace_back(field, num_envs);
      slot.final_observation.emplace_back(field, num_envs);
    }
    for_each_field(slot, [&](const auto& field, auto& array) {
      if constexpr (!std::is_same_v<std::remove_cvref_t<decltype(array)>, std::vector<Buffer>>) {
        const void* const its = &array;
        const bool is_of_terms = its == &slot.reward_terms || its == &slot.episode_terms;
        array.resize(num_envs * (is_of_terms ? spec.reward_terms.size() : 1));
      }
      static_cast<void>(field);
    });
  }
}

void OutputSlots::turn_and_copy() {
  const Outputs& from = now();
  turn();
  now() = from;  // into arrays of the same size: nothing is allocated, and views of them stay
  has_final_[current_] = has_final_[1 - current_];
}

void OutputSlots::clear(std::size_t env) { clear_row(now(), env); }

void OutputSlots::carry_over(std::size_t env) {
  const Outputs& from = before();
  Outputs& to = now();
  for (std::size_t i = 0; i < to.observation.size(); ++i) {
    to.observation[i].copy_row(env, from.observation[i]);
    to.final_observation[i].copy_row(env, from.final_observation[i]);
  }
  has_final_[current_][env] = has_final_[1 - current_][env];
  clear_row(to, env);
  to.terminated[env] = from.terminated[env];
  to.truncated[env] = from.truncated[env];
  to.success[env] = from.success[env];
  to.crashed[env] = from.crashed[env];
  to.bad_state[env] = from.bad_state[env];
  to.episode_end[env] = from.episode_end[env];
  to.episode_return[env] = from.episode_return[env];
  const std::size_t terms = to.episode_terms.size() / to.reward.size();
  std::copy_n(from.episode_terms.begin() + static_cast<std::ptrdiff_t>(env * terms), terms,
              to.episode_terms.begin() + static_cast<std::ptrdiff_t>(env * terms));
  to.episode_length[env] = from.episode_length[env];
}

void OutputSlots::keep_final(std::size_t env) {
  Outputs& outputs = now();
  for (std::size_t i = 0; i < outputs.observation.size(); ++i) {
    outputs.final_observation[i].copy_row(env, outputs.observation[i]);
  }
  has_final_[current_][env] = 1;
}

void OutputSlots::forget_final(std::size_t first, std::size_t count) {
  if (!is_any(has_final_[current_].data() + first, count)) return;
  for (std::size_t env = first; env < first + count; ++env) {
    if (has_final_[current_][env]) clear_final(env);
  }
}

void OutputSlots::clear_final(std::size_t env) {
  for (Buffer& buffer : now().final_observation) std::ranges::fill(buffer.row_as_bytes(env), std::byte{0});
  has_final_[current_][env] = 0;
}

void OutputSlots::restored() { std::ranges::fill(has_final_[current_], std::uint8_t{1}); }

void OutputSlots::mark_absent(const TaskSpec& spec, std::size_t env) {
  for (Outputs& slot : slots_) {
    clear_row(slot, env);
    for (Buffer& buffer : slot.final_observation) std::ranges::fill(buffer.row_as_bytes(env), std::byte{0});
    for (std::size_t i = 0; i < spec.observation.size(); ++i) fill_row(slot.observation[i], env, spec.observation[i].absent);
  }
  for (FlagArray& has_final : has_final_) has_final[env] = 0;
}

}  // namespace flockstep
