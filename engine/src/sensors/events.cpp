#include "sensors/events.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "base/check_fields.hpp"
#include "base/require.hpp"

namespace flockstep {

void EventPixels::validate() const { check_fields(*this, "camera.event_pixels."); }

}  // namespace flockstep

namespace flockstep::sensors {
namespace {

constexpr float kMinThreshold = 0.01F;
constexpr float kMaxCount = 255.0F;  // events of one image; the others follow
constexpr float kLongAgo = 1e6F;     // s
constexpr float kFar = 1e6F;         // largest reference, if a leak outruns the counts

// v2e's logarithm: linear up to a grey value of 20, so that dark pixels do not answer each level.
std::vector<float> make_log() {
  constexpr double kLinear = 20.0;
  std::vector<float> result;
  for (int grey = 0; grey < 256; ++grey) {
    result.push_back(static_cast<float>(grey <= kLinear ? grey * std::log(kLinear) / kLinear : std::log(grey)));
  }
  return result;
}

}  // namespace

Events::Events(const EventPixels& model, std::size_t pixels, ImageLayout layout, const std::string& label,
               const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones)
    : model_(model),
      pixels_(pixels),
      across_(layout == ImageLayout::hwc ? 2 : 1),
      apart_(layout == ImageLayout::hwc ? 1 : pixels),
      tick_s_(clock.dt_s()),
      stream_(stream_named("events of " + label)),
      drones_per_env_(drones_per_env),
      log_(make_log()),
      taken_(num_drones, Taken::none),
      elapsed_s_(num_drones),
      tick_(num_drones, kNone),
      reference_(num_drones * pixels_) {
  if (model_.threshold_std > 0.0F) {
    on_.resize(reference_.size(), model_.threshold);
    off_.resize(reference_.size(), model_.threshold);
  }
  if (model_.refractory_s > 0.0F) idle_s_.resize(reference_.size(), kLongAgo);
}

void Events::take(DroneIndex drone, const State& state) {
  const std::int64_t tick = state.tick[drone / drones_per_env_];
  if (tick_[drone] == tick) return;
  taken_[drone] = tick_[drone] == kNone ? Taken::first : Taken::next;
  elapsed_s_[drone] = static_cast<float>(static_cast<double>(tick - tick_[drone]) * tick_s_);
  tick_[drone] = tick;
}

// Draw k of an image is for pixels 2k and 2k + 1, two words each. Thresholds have the numbers of tick 0, when no image has
// events.
PhiloxInput Events::input(DroneIndex drone, const State& state, std::int64_t tick) const {
  const auto first = static_cast<std::uint32_t>(static_cast<std::uint64_t>(tick) * ((pixels_ + 1) / 2));
  return input_of_draw(state, RandomKey::of(drone, drones_per_env_), stream_, first);
}

void Events::begin(DroneIndex drone, const State& state, const std::uint8_t* grey, std::uint8_t* events) {
  std::fill_n(events, 2 * pixels_, std::uint8_t{0});
  const std::size_t at = drone * pixels_;
  for (std::size_t i = 0; i < pixels_; ++i) reference_[at + i] = log_[grey[i]];
  if (!idle_s_.empty()) std::fill_n(&idle_s_[at], pixels_, kLongAgo);
  if (on_.empty()) return;
  PhiloxInput draw = input(drone, state, 0);
  for (std::size_t i = 0; i < pixels_; ++i) {
    const auto words = philox4x32(draw.counter, draw.key);
    const std::size_t half = i % 2 * 2;
    const auto normal = normal_pair({words[half], words[half + 1], 0, 0});
    on_[at + i] = std::max(model_.threshold + model_.threshold_std * normal[0], kMinThreshold);
    off_[at + i] = std::max(model_.threshold + model_.threshold_std * normal[1], kMinThreshold);
    draw.counter[0] += static_cast<std::uint32_t>(i % 2);
  }
}

// Returns how many of `count` events, evenly spaced until the image, keep the refractory time between them.
float Events::allowed(float count, float elapsed_s, float& idle_s) const {
  constexpr float kRounding = 1e-4F;  // of a spacing
  const float spacing = elapsed_s / count;
  const float first = std::max(std::ceil((model_.refractory_s - idle_s) / spacing - kRounding), 1.0F);
  const float every = std::max(std::ceil(model_.refractory_s / spacing - kRounding), 1.0F);
  idle_s = std::min(idle_s + elapsed_s, kLongAgo);
  if (!(first <= count)) return 0.0F;
  const float events = 1.0F + std::floor((count - first) / every);
  idle_s = std::max(elapsed_s - (first + (events - 1.0F) * every) * spacing, 0.0F);
  return events;
}

void Events::write(DroneIndex drone, const State& state, const std::uint8_t* grey, std::uint8_t* events) {
  const Taken taken = std::exchange(taken_[drone], Taken::none);
  if (taken == Taken::none) return;
  if (taken == Taken::first) return begin(drone, state, grey, events);
  const std::size_t at = drone * pixels_;
  const float elapsed_s = elapsed_s_[drone], leak = model_.leak_hz * elapsed_s, shots = 0.5F * model_.shot_hz * elapsed_s;
  PhiloxInput draw = input(drone, state, tick_[drone]);
  std::array<std::uint32_t, 4> words{};
  for (std::size_t i = 0; i < pixels_; ++i) {
    float& reference = reference_[at + i];
    const float on = on_.empty() ? model_.threshold : on_[at + i], off = off_.empty() ? model_.threshold : off_[at + i];
    reference = std::clamp(reference - leak * on, -kFar, kFar);
    const float change = log_[grey[i]] - reference;
    const float threshold = change > 0.0F ? on : off;
    float count = std::min(std::floor(std::abs(change) / threshold), kMaxCount);
    if (!idle_s_.empty()) {
      float& idle_s = idle_s_[at + i];
      if (count > 0.0F) {
        count = allowed(count, elapsed_s, idle_s);
      } else {
        idle_s = std::min(idle_s + elapsed_s, kLongAgo);
      }
    }
    reference += std::copysign(count * threshold, change);
    std::array<float, 2> counts{change > 0.0F ? count : 0.0F, change > 0.0F ? 0.0F : count};
    if (shots > 0.0F) {
      if (i % 2 == 0) {
        words = philox4x32(draw.counter, draw.key);
        ++draw.counter[0];
      }
      for (std::size_t polarity = 0; polarity < 2; ++polarity) {
        counts[polarity] += std::floor(shots + uniform01(words[i % 2 * 2 + polarity]));
      }
    }
    for (std::size_t polarity = 0; polarity < 2; ++polarity) {
      events[i * across_ + polarity * apart_] = static_cast<std::uint8_t>(std::min(counts[polarity], kMaxCount));
    }
  }
}

void Events::visit(ArrayVisitor& visitor) {
  visitor.array("event_tick", tick_);
  visitor.array("event_reference", reference_);
  visitor.array("event_threshold_on", on_);
  visitor.array("event_threshold_off", off_);
  visitor.array("event_idle_s", idle_s_);
}

void Events::check() const {
  const auto within = [](std::span<const float> values, float least, float most, const char* name) {
    for (const float value : values) require(value >= least && value <= most, name, "a number within its limits", value);
  };
  within(reference_, -2.0F * kFar, 2.0F * kFar, "snapshot: event_reference");
  for (const auto* thresholds : {&on_, &off_}) within(*thresholds, kMinThreshold, 100.0F, "snapshot: event_threshold");
  within(idle_s_, 0.0F, kLongAgo, "snapshot: event_idle_s");
  for (const std::int64_t tick : tick_) {
    require(tick >= kNone && tick < std::int64_t{1} << 62, "snapshot: event_tick", "a number in [-1, 2^62)", tick);
  }
}

}  // namespace flockstep::sensors
