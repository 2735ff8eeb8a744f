#include "dynamics/lane_group.hpp"

#include <tuple>
#include <type_traits>

namespace flockstep::dynamics {
namespace {

// An array of the state, (N, kColumns), and the lanes of the flock that hold it.
template <class Owner, std::size_t kColumns>
struct FlightArray {
  std::vector<float> Owner::* array;
  Lanes<kColumns> Flock::* loaded;  // lanes that the array is loaded into; null: only stored
  Lanes<kColumns> Flock::* stored;  // lanes that the array is stored from; null: only loaded
};

template <class Owner, std::size_t kColumns>
constexpr FlightArray<Owner, kColumns> moved_array(std::vector<float> Owner::* array, Lanes<kColumns> Flock::* loaded,
                                                   Lanes<kColumns> Flock::* stored) {
  return {array, loaded, stored};
}
template <class Owner, std::size_t kColumns>
constexpr FlightArray<Owner, kColumns> kept_array(std::vector<float> Owner::* array, Lanes<kColumns> Flock::* lanes) {
  return {array, lanes, lanes};
}
template <class Owner, std::size_t kColumns>
constexpr FlightArray<Owner, kColumns> input_array(std::vector<float> Owner::* array, Lanes<kColumns> Flock::* lanes) {
  return {array, lanes, nullptr};
}
template <class Owner, std::size_t kColumns>
constexpr FlightArray<Owner, kColumns> result_array(std::vector<float> Owner::* array, Lanes<kColumns> Flock::* lanes) {
  return {array, nullptr, lanes};
}

// All arrays that flight reads or writes.
constexpr std::tuple kArrays{
    moved_array(&State::position, &Flock::origin, &Flock::position),
    moved_array(&FlightState::remainder, &Flock::travelled, &Flock::remainder),
    kept_array(&State::quat_wxyz, &Flock::rotation),
    kept_array(&FlightState::velocity, &Flock::velocity),
    kept_array(&FlightState::angular_velocity, &Flock::turn),
    kept_array(&FlightState::rotor_speed, &Flock::rotor),
    kept_array(&FlightState::rotor_command, &Flock::rotor_command),
    kept_array(&FlightState::error_integral, &Flock::error_integral),
    input_array(&FlightState::wind, &Flock::wind),
    result_array(&FlightState::acceleration, &Flock::acceleration),
    result_array(&FlightState::angular_acceleration, &Flock::angular_acceleration),
};

template <class Owner>
auto& owner(auto& state) {
  if constexpr (std::is_same_v<Owner, State>) {
    return state;
  } else {
    return state.flight;
  }
}

// Calls f(array, entry) for each entry of kArrays.
template <class AnyState, class F>
void for_each_array(AnyState& state, const F& f) {
  std::apply([&]<class... Owner, std::size_t... kColumns>(
                 const FlightArray<Owner, kColumns>&... entry) { (f(owner<Owner>(state).*entry.array, entry), ...); },
             kArrays);
}

}  // namespace

LaneGroup::LaneGroup(std::span<const DroneIndex>& drones, const DroneRange& own, std::size_t num_rotors)
    : is_row_(own.count >= kLanes), num_rotors_(num_rotors) {
  std::size_t count = 0;
  if (is_row_) {
    const std::size_t first = std::min<std::size_t>(drones[0], own.first + own.count - kLanes);
    for (std::size_t lane = 0; lane < kLanes; ++lane) drones_[lane] = DroneIndex(first + lane);
    for (; count < drones.size() && drones[count] < first + kLanes; ++count) is_listed_[drones[count] - first] = true;
  } else {
    count = std::min(kLanes, drones.size());
    for (std::size_t lane = 0; lane < kLanes; ++lane) drones_[lane] = drones[std::min(lane, count - 1)];
    std::fill_n(is_listed_.begin(), count, true);
  }
  drones = drones.subspan(count);
}

void LaneGroup::load(const State& state, Flock& flock) const {
  for_each_array(state, [&](const auto& array, const auto& entry) {
    if (entry.loaded != nullptr) load(array, flock.*entry.loaded);
  });
}

void LaneGroup::store(const LaneFlags& lanes, Flock& flock, State& state) const {
  const bool is_whole_row = is_row_ && std::ranges::count(lanes, true) == kLanes;
  for_each_array(state, [&](auto& array, const auto& entry) {
    if (entry.stored == nullptr) return;
    auto& values = flock.*entry.stored;
    for (std::size_t lane = 0; !is_whole_row && lane < kLanes; ++lane) {
      if (is_row_ && !lanes[lane]) load(array, lane, values);
      if (!is_row_ && lanes[lane]) store(values, lane, array);
    }
    if (is_row_) store_row(values, array);
  });
}

void LaneGroup::store(std::size_t lane, const Flock& flock, State& state) const {
  for_each_array(state, [&](auto& array, const auto& entry) {
    if (entry.stored != nullptr) store(flock.*entry.stored, lane, array);
  });
}

void LaneGroup::store_accelerations(std::size_t lane, const Flock& flock, State& state) const {
  for_each_array(state, [&](auto& array, const auto& entry) {
    if (entry.loaded == nullptr) store(flock.*entry.stored, lane, array);
  });
}

}  // namespace flockstep::dynamics
