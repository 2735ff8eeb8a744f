#include "dynamics/parameters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

#include "base/check_fields.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"

namespace flockstep {
namespace {

// Name, limits and field of one float of DroneParameters.
struct ParameterInfo {
  std::string name, field;
  Limits limits;
};

const std::vector<ParameterInfo>& parameter_infos() {
  static const std::vector<ParameterInfo> infos = [] {
    std::vector<ParameterInfo> list;
    const DroneParameters defaults;
    for_each_field(defaults, [&]<class Value>(const auto& field, const Value&) {
      constexpr std::size_t kCount = sizeof(Value) / sizeof(float);
      for (std::size_t i = 0; i < kCount; ++i) {
        const std::string name = field.name;
        list.push_back({kCount == 1 ? name : name + '[' + std::to_string(i) + ']', name, field.info.limits});
      }
    });
    return list;
  }();
  return infos;
}

constexpr std::size_t kFirstRotor = offsetof(DroneParameters, rotor_thrust_scale) / sizeof(float);
constexpr std::size_t kLateRotors = kMaxRotors - kMinRotors;

// Which random number draws a float. Rotors from the fifth on have the second word of the draw of the rotor four before them, so
// that quadrotors draw the numbers that they drew before there were others.
std::pair<std::uint32_t, std::uint32_t> key_of(std::size_t number) {
  const bool is_late = number >= kFirstRotor + kMinRotors && number < kFirstRotor + kMaxRotors;
  const std::size_t key = number < kFirstRotor + kMinRotors ? number : number - kLateRotors;
  return {static_cast<std::uint32_t>(key), is_late ? 1U : 0U};
}

std::string range_of(const Limits& limits) { return expected_number(limits, false); }

}  // namespace

const std::vector<std::string>& parameter_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const ParameterInfo& info : parameter_infos()) list.push_back(info.name);
    return list;
  }();
  return names;
}

void DroneParameters::validate() const { check_fields(*this, "params: "); }

void Variation::validate() const {
  check_fields(*this, "variations.");
  require(low <= high, "variations.low", "at most high (" + std::to_string(high) + ")", low);
  require(law != Law::log_uniform || low > 0.0F, "variations.low", "a number > 0 for law=\"log_uniform\"", low);
  require(law == Law::choice || choices.empty(), "variations.choices", "none unless law is \"choice\"", choices.size());
  require(law != Law::choice || !choices.empty(), "variations.choices", "at least one for law=\"choice\"", "none");
}

namespace dynamics {

Airframe varied(const Airframe& frame, const DroneParameters& p) {
  Airframe made;
  set_varied(frame, p, made);
  return made;
}

void set_varied(const Airframe& frame, const DroneParameters& p, Airframe& made) {
  const auto d = [](float value) { return static_cast<double>(value); };
  made = frame;
  const double body = frame.mass_kg * d(p.mass_scale), load = d(p.payload_kg);
  made.mass_kg = body + load;
  // Second moments of the mass along each axis: an inertia is the sum of the other two.
  const auto& j = frame.inertia_kgm2;
  std::array<double, 3> moment{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double stretch = d(p.stretch[k]);
    moment[k] = 0.5 * (j[(k + 1) % 3] + j[(k + 2) % 3] - j[k]) * d(p.mass_scale) * stretch * stretch;
  }
  const double below = d(p.payload_below_m), reduced = load > 0.0 ? body * load / made.mass_kg : 0.0;
  moment[2] += reduced * below * below;
  for (std::size_t k = 0; k < 3; ++k) made.inertia_kgm2[k] = moment[(k + 1) % 3] + moment[(k + 2) % 3];
  const double sunk = load > 0.0 ? below * load / made.mass_kg : 0.0;  // m, of the centre by the payload
  for (auto& at : made.position_m) {
    for (std::size_t k = 0; k < 3; ++k) at[k] = at[k] * d(p.arm_scale) - d(p.center_m[k]);
    at[2] += sunk;
  }
  for (double& c : made.thrust_n) c *= d(p.thrust_scale);
  made.torque_ratio_m *= d(p.torque_scale);
  made.lag_up_s *= d(p.lag_up_scale);
  made.lag_down_s *= d(p.lag_down_scale);
  made.rotor_lift *= d(p.rotor_drag_scale);
  for (std::size_t k = 0; k < 3; ++k) {
    made.rotor_drag[k] *= d(p.rotor_drag_scale);
    made.linear_drag[k] *= d(p.body_drag_scale);
    made.quadratic_drag[k] *= d(p.body_drag_scale);
  }
}

double normal_quantile(double u) {
  const double q = u - 0.5;
  if (std::abs(q) <= 0.425) {
    const double r = 0.180625 - q * q;
    return q * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179) /
           (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0);
  }
  double r = std::sqrt(-std::log(std::min(u, 1.0 - u)));
  double x = 0.0;
  if (r <= 5.0) {
    r -= 1.6;
    x = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) /
        ((0.12021132975 * r + 0.73700164250) * r + 1.0);
  } else {
    r -= 5.0;
    x = (((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150) /
        ((0.012258202635 * r + 0.24197894225) * r + 1.0);
  }
  return q < 0.0 ? -x : x;
}

void check_parameters(std::span<const float> parameters, const std::string& name) {
  const auto& infos = parameter_infos();
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const ParameterInfo& info = infos[i % kNumParameters];
    if (!info.limits.contain(parameters[i])) refuse(name + info.name, range_of(info.limits), parameters[i]);
  }
}

std::vector<std::size_t> parameters_named(const std::string& name, const char* field, std::size_t num_rotors) {
  const auto& infos = parameter_infos();
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    if (name != infos[i].name && name != infos[i].field) continue;
    const bool is_absent = i >= kFirstRotor + num_rotors && i < kFirstRotor + kMaxRotors;
    if (!is_absent) numbers.push_back(i);
    require(!is_absent || name != infos[i].name, field, "a rotor of drones with " + std::to_string(num_rotors), '"' + name + '"');
  }
  if (!numbers.empty()) return numbers;
  std::vector<std::string_view> known;
  for (const ParameterInfo& info : infos) known.push_back(info.name);
  const std::string_view nearest = nearest_name(name, known);
  const std::string hint = nearest.empty() ? "such as \"mass_scale\"" : "such as \"" + std::string(nearest) + '"';
  refuse(field, "a field of DroneParameters, " + hint, '"' + name + '"');
}

const Limits& limits_of_parameter(std::size_t number) { return parameter_infos()[number].limits; }

Variations::Variations(std::span<const Variation> variations, std::span<const Airframe> airframes, const ClockConfig& clock) {
  const auto& infos = parameter_infos();
  const std::size_t num_frames = airframes.size(), num_rotors = most_rotors(airframes);
  for (const Variation& variation : variations) {
    for (const std::size_t number : parameters_named(variation.parameter, "variations.parameter", num_rotors))
      add(variation, number);
  }
  const auto draws_frame = [&](const Entry& entry) { return infos[entry.number].name == "airframe"; };
  if (num_frames > 1 && std::ranges::none_of(entries_, draws_frame)) {
    // The greatest float below the number of airframes, of which the integer part counts.
    const auto last = std::nextafter(static_cast<float>(num_frames), 0.0F);
    add({.parameter = "airframe", .low = 0.0F, .high = last}, infos.size() - 1);
  }
  require(greatest_.airframe < static_cast<float>(std::max<std::size_t>(num_frames, 1)), "variations: airframe",
          "below the number of airframes (" + std::to_string(num_frames) + ")", greatest_.airframe);
  require(greatest_.dead_rotor < static_cast<float>(num_rotors), "variations: dead_rotor",
          "below the number of rotors (" + std::to_string(num_rotors) + ")", greatest_.dead_rotor);
  for (Entry& entry : entries_) {
    if (entry.variation.when != DrawnAt::interval) continue;
    const double steps = std::round(static_cast<double>(entry.variation.interval_s) / clock.step_s());
    entry.interval_ticks = std::max<std::int64_t>(static_cast<std::int64_t>(steps), 1) * clock.substeps();
    has_interval_ = true;
  }
}

void Variations::add(const Variation& variation, std::size_t number) {
  const ParameterInfo& info = parameter_infos()[number];
  for (const Entry& entry : entries_) {
    require(entry.number != number, "variations", "each parameter at most once", '"' + info.name + "\" twice");
  }
  const auto [key, word] = key_of(number);
  Entry entry{variation, number, key, word};
  for (const Entry& other : entries_) {
    if (variation.group.empty() || other.variation.group != variation.group) continue;
    entry.key = other.key;
    entry.word = other.word;
  }
  float low = variation.low, high = variation.high;
  if (variation.law == Law::choice) {
    low = std::ranges::min(variation.choices);
    high = std::ranges::max(variation.choices);
  }
  for (const float value : {low, high}) {
    if (!info.limits.contain(value)) refuse("variations: " + info.name, range_of(info.limits), value);
  }
  floats_of(least_)[number] = low;
  floats_of(greatest_)[number] = high;
  differ_ |= low < high;
  entries_.push_back(std::move(entry));
}

bool Variations::lists(std::size_t number) const {
  return std::ranges::any_of(entries_, [&](const Entry& entry) { return entry.number == number; });
}

void Variations::draw_entry(const State& state, RandomKey key, const Entry& entry, std::int64_t count,
                            DroneParameters& parameters) const {
  const Variation& v = entry.variation;
  constexpr auto kStream = static_cast<std::uint32_t>(stream_named("drone parameters"));
  const std::int64_t episode = v.when == DrawnAt::start ? 0 : episode_of(state, key);
  constexpr auto kKeys = static_cast<std::uint32_t>(kNumParameters - kLateRotors);
  const std::uint32_t index = entry.key + kKeys * static_cast<std::uint32_t>(count);
  const auto bits = flockstep::draw(state.seed[key.env], episode, kStream, index, key.member)[entry.word];
  const double u = (bits + 0.5) * 0x1p-32;
  const auto low = static_cast<double>(v.low), high = static_cast<double>(v.high);
  double value = low;
  switch (v.law) {
    case Law::uniform:
      value = low + u * (high - low);
      break;
    case Law::log_uniform:
      value = low * std::exp(u * std::log(high / low));
      break;
    case Law::normal:
      value = static_cast<double>(v.mean) + static_cast<double>(v.std) * normal_quantile(u);
      break;
    case Law::choice:
      floats_of(parameters)[entry.number] = v.choices[static_cast<std::size_t>(u * static_cast<double>(v.choices.size()))];
      return;
  }
  floats_of(parameters)[entry.number] = std::clamp(static_cast<float>(value), v.low, v.high);
}

void Variations::begin(const State& state, RandomKey key, DroneParameters& parameters) const {
  parameters = {};
  for (const Entry& entry : entries_) draw_entry(state, key, entry, 0, parameters);
}

bool Variations::redraw(const State& state, RandomKey key, std::int64_t tick, DroneParameters& parameters) const {
  bool has_drawn = false;
  for (const Entry& entry : entries_) {
    if (entry.interval_ticks == 0 || tick == 0 || tick % entry.interval_ticks != 0) continue;
    draw_entry(state, key, entry, tick / entry.interval_ticks, parameters);
    has_drawn = true;
  }
  return has_drawn;
}

ShownParameters::ShownParameters(std::span<const std::string> names, std::size_t num_rotors) {
  const DroneParameters defaults;
  for (const std::string& name : names) {
    for (const std::size_t number : parameters_named(name, "privileged", num_rotors)) {
      require(std::ranges::find(numbers_, number) == numbers_.end(), "privileged", "each parameter at most once",
              '"' + parameter_names()[number] + "\" twice");
      numbers_.push_back(number);
      defaults_.push_back(static_cast<double>(floats_of(defaults)[number]));
    }
  }
}

Field ShownParameters::field(std::size_t drones) const {
  Field field{.name = "privileged", .shape = {static_cast<std::int64_t>(drones * size())}, .low = {}, .high = {}};
  for (std::size_t drone = 0; drone < drones; ++drone) {
    for (std::size_t i = 0; i < size(); ++i) {
      // Parameters are compared with limits as float32.
      const Limits& limits = limits_of_parameter(numbers_[i]);
      field.low.push_back(static_cast<double>(static_cast<float>(limits.least)) - defaults_[i]);
      field.high.push_back(static_cast<double>(static_cast<float>(limits.greatest)) - defaults_[i]);
    }
  }
  return field;
}

}  // namespace dynamics
}  // namespace flockstep
