#include "flockstep/sensors/gps_receiver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "flockstep/pose.hpp"
#include "sensors/noisy_sensor.hpp"
#include "sensors/presets.hpp"
#include "sensors/rows.hpp"

namespace flockstep {

void GpsReceiverConfig::validate() const { check_fields(*this, "gps_receiver."); }

GpsReceiverConfig GpsReceiverConfig::preset(std::string_view product) {
  const std::array presets{
      GpsReceiverConfig{.name = "px4-sih", .drift_std_m = 0.025F, .drift_time_s = 0.46F, .velocity_noise_std_mps = 0.024F},
      GpsReceiverConfig{.name = "consumer",
                        .noise_std_m = 0.1F,
                        .drift_std_m = 1.0F,
                        .drift_time_s = 45.0F,
                        .velocity_noise_std_mps = 0.08F,
                        .vertical_factor = 2.0F,
                        .latency_s = 0.15F},
  };
  return sensors::preset_named(product, presets, "GpsReceiverConfig.preset");
}

namespace sensors {
namespace {

GpsReceiverReadings cleared_gps(const SensorSetup& setup) {
  auto readings = allocated<GpsReceiverReadings>({.num_drones = setup.num_drones});
  if (!setup.has_velocities) readings.velocity.clear();
  return readings;
}

std::array<Drift, 3> drifts_of(const GpsReceiverConfig& config) {
  const auto wander = [&](float factor) {
    return Drift::gauss_markov(factor * config.drift_std_m, config.drift_time_s, factor * config.drift_std_m);
  };
  return {wander(1.0F), wander(1.0F), wander(config.vertical_factor)};
}

class GpsReceiver final : public NoisySensor<GpsReceiverReadings> {
 public:
  GpsReceiver(const GpsReceiverConfig& config, const SensorSetup& setup)
      : NoisySensor("gps_receiver", config.name, config, setup, stream_named("gps noise"), cleared_gps(setup),
                    config.noise_std_m > 0.0F || config.velocity_noise_std_mps > 0.0F || config.outages_per_s > 0.0F,
                    drifts_of(config)),
        config_(config),
        clock_(setup.clock),
        changes_(has_outages() ? setup.num_drones : 0),
        next_change_(changes_.size(), -1) {}

  void begin(DroneIndex drone, const State& state) override {
    NoisySensor::begin(drone, state);
    if (!has_outages()) return;
    changes_[drone] = 0;
    next_change_[drone] = -1;
  }
  void visit(ArrayVisitor& visitor) override {
    NoisySensor::visit(visitor);
    if (!has_outages()) return;
    visitor.array("fix_changes", changes_);
    visitor.array("next_fix_change", next_change_);
  }
  void check() const override {
    NoisySensor::check();
    check_values(changes_, "fix_changes", Values::count);
    check_values(next_change_, "next_fix_change", Values::last_count);
  }

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override {
    const State& state = surroundings.state;
    GpsReceiverReadings& truth = readings_.truth();
    for (const DroneIndex drone : drones) {
      put(position_of(state, drone), truth.position, drone);
      if (!truth.velocity.empty()) put(of_row(state.flight.velocity, drone), truth.velocity, drone);
      truth.fix[drone] = 1;
    }
  }
  void add_errors(std::span<const DroneIndex> drones, const State& state) override {
    if (!has_errors_) return;
    const GpsReceiverReadings& truth = readings_.truth();
    GpsReceiverReadings& noisy = readings_.noisy();
    const Vec3 axes(1.0F, 1.0F, config_.vertical_factor);
    for (const DroneIndex drone : drones) {
      const std::array<float, 10> numbers = normals<10>(state, drone);
      const float* const drift = drifts_.advance(state, drone, std::span(numbers).first<3>());
      noisy.fix[drone] = static_cast<std::uint8_t>(has_fix(state, drone));
      if (noisy.fix[drone] == 0) continue;
      const Vec3 noise = config_.noise_std_m * axes.cwiseProduct(Vec3::Map(numbers.data() + 3));
      put(of_row(truth.position, drone) + Vec3::Map(drift) + noise, noisy.position, drone);
      if (truth.velocity.empty()) continue;
      const Vec3 velocity_noise = config_.velocity_noise_std_mps * axes.cwiseProduct(Vec3::Map(numbers.data() + 6));
      put(of_row(truth.velocity, drone) + velocity_noise, noisy.velocity, drone);
    }
  }

  bool has_outages() const { return config_.outages_per_s > 0.0F; }
  // Advances the fix of a drone, which changes at random ticks, to the current tick. An episode begins with a fix.
  bool has_fix(const State& state, DroneIndex drone) {
    if (!has_outages()) return true;
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    const std::int64_t now = state.tick[key.env];
    std::int64_t& changes = changes_[drone];
    std::int64_t& next = next_change_[drone];
    constexpr std::int64_t kLongest = 10'000'000;  // ticks; after a longer time without a reading, the fix goes on as it was
    if (next < 0 || now - next > kLongest) next = now + ticks_until_change(state, key, changes);
    for (; next <= now; next += ticks_until_change(state, key, changes)) ++changes;
    return changes % 2 == 0;
  }
  std::int64_t ticks_until_change(const State& state, const RandomKey& key, std::int64_t changes) const {
    const auto bits = draw(state, key, stream_named("gps outages"), static_cast<std::uint32_t>(changes), number_);
    const double mean_s =
        changes % 2 == 0 ? 1.0 / static_cast<double>(config_.outages_per_s) : static_cast<double>(config_.outage_s);
    const double seconds = -mean_s * std::log1p(-static_cast<double>(uniform01(bits[0])));
    return static_cast<std::int64_t>(std::clamp(std::ceil(seconds / clock_.dt_s()), 1.0, 1e15));
  }

  GpsReceiverConfig config_;
  ClockConfig clock_;
  std::vector<std::int64_t> changes_;      // (N,) times that the fix was lost or returned; empty if it is never lost
  std::vector<std::int64_t> next_change_;  // (N,) tick of the next one; -1: not drawn yet
};

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const GpsReceiverConfig& config, const SensorSetup& setup) {
  return std::make_unique<GpsReceiver>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
