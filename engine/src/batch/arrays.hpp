// The arrays of a batch, listed once: for allocation, snapshots and copying.
#pragma once

#include <cstddef>

#include "flockstep/config.hpp"
#include "flockstep/state.hpp"
#include "task/navigation.hpp"

namespace flockstep {

// Each calls f(array, columns) for every array of the struct; it holds N * columns values.

template <class S, class F>
void for_each_array(S& s, std::size_t rays, const F& f) {
  f(s.position, 3U);
  f(s.quat_wxyz, 4U);
  f(s.contact.hit, 1U);
  f(s.contact.inside, 1U);
  f(s.contact.fraction, 1U);
  f(s.contact.point, 3U);
  f(s.contact.normal, 3U);
  f(s.lidar_ranges, rays);
  f(s.sensed_position, 3U);
  f(s.sensed_quat_wxyz, 4U);
  f(s.active, 1U);
  f(s.world_index, 1U);
  f(s.seed, 1U);
  f(s.episode, 1U);
  f(s.scans, 1U);
}

template <class F>
void for_each_navigation_array(auto& n, const F& f) {
  f(n.goal_index, 1U);
  f(n.last_distance, 1U);
  f(n.last_action, 1U);
  f(n.step, 1U);
  f(n.time_limit, 1U);
  f(n.episode_return, 1U);
  f(n.begun, 1U);
  f(n.done, 1U);
}

// Calls f(member, columns) with pointers to members, so that two Outputs can be walked together.
template <class F>
void for_each_output(std::size_t observation_size, std::size_t image_size, const F& f) {
  f(&Outputs::observation, observation_size);
  f(&Outputs::final_observation, observation_size);
  f(&Outputs::image, image_size);
  f(&Outputs::final_image, image_size);
  f(&Outputs::reward, 1U);
  f(&Outputs::reward_terms, static_cast<std::size_t>(kNumRewardTerms));
  f(&Outputs::terminated, 1U);
  f(&Outputs::truncated, 1U);
  f(&Outputs::success, 1U);
  f(&Outputs::crashed, 1U);
  f(&Outputs::episode_return, 1U);
  f(&Outputs::episode_length, 1U);
}

}  // namespace flockstep
