// DroneSettings: the run-time settings of a camera or LiDAR, one per drone.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/lidar.hpp"

namespace flockstep::sensors {

// The setting of one drone, as stored in a snapshot. A field of view that is not set is 0.
struct Setting {
  float hfov_deg, vfov_deg;
  float max_range_m;  // m, LiDARs only
  std::array<float, 3> offset_m;
  std::array<float, 4> quat_wxyz;
  RangeErrors errors;  // LiDARs only
};
Setting setting_of(const LidarConfig& config);
Setting setting_of(const CameraConfig& config);
LidarConfig with(LidarConfig config, const Setting& setting);
CameraConfig with(CameraConfig config, const Setting& setting);

// Holds the setting and the optics of each drone. Optics are expensive data computed from the field of view and the width of
// beams, such as a table of rays.
template <class Config, class Optics>
class DroneSettings {
 public:
  using Make = std::function<Optics(const Config&)>;

  // optics_turn: true if the optics also depend on the mounting.
  DroneSettings(const Config& config, std::size_t num_drones, bool optics_turn, Make make)
      : config_(config), optics_turn_(optics_turn), make_(std::move(make)), settings_(num_drones, setting_of(config)) {
    shared_.push_back(std::make_unique<Shared>(setting_of(config), make_(config), num_drones));
    index_.resize(num_drones, 0U);
  }

  std::size_t size() const { return settings_.size(); }
  const Setting& operator[](DroneIndex drone) const { return settings_[drone]; }
  const Optics& optics(DroneIndex drone) const { return shared_[index_[drone]]->optics; }  // its address does not change
  Config config_of(DroneIndex drone) const { return with(config_, settings_[drone]); }

  void set(DroneIndex drone, const Config& config) {
    const Setting setting = setting_of(config);
    const std::size_t index = find_or_make(setting);
    --shared_[index_[drone]]->drones;
    use(drone, index);
    settings_[drone] = setting;
  }

  void visit(std::string_view name, ArrayVisitor& visitor) { visitor.array(name, settings_); }
  // Calls a check of configurations with each setting in `bytes`.
  template <class Check>
  void check_bytes(std::span<const std::byte> bytes, const Check& check) const {
    for (std::size_t at = 0; at < bytes.size(); at += sizeof(Setting)) {
      Setting setting;
      std::memcpy(&setting, bytes.data() + at, sizeof(setting));
      check(with(config_, setting));
    }
  }
  void restored() {
    for (const auto& shared : shared_) shared->drones = 0;
    for (std::size_t i = 0; i < settings_.size(); ++i) use(DroneIndex(i), find_or_make(settings_[i]));
  }

 private:
  // Drones whose optics would be equal share them. An entry that no drone uses is reused for the next optics.
  struct Shared {
    Shared(const Setting& setting_in, Optics optics_in, std::size_t drones_in)
        : setting(setting_in), optics(std::move(optics_in)), drones(drones_in) {}
    Setting setting;
    Optics optics;
    std::size_t drones;
  };

  bool can_share(const Setting& a, const Setting& b) const {
    return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.errors.divergence_mrad == b.errors.divergence_mrad &&
           (!optics_turn_ || a.quat_wxyz == b.quat_wxyz);
  }
  std::size_t find_or_make(const Setting& setting) {
    const auto find = [&](const auto& holds) { return std::ranges::find_if(shared_, holds) - shared_.begin(); };
    auto index = find([&](const auto& shared) { return can_share(shared->setting, setting); });
    if (index == std::ssize(shared_)) {
      auto made = std::make_unique<Shared>(setting, make_(with(config_, setting)), 0);
      index = find([](const auto& shared) { return shared->drones == 0; });
      if (index == std::ssize(shared_)) {
        shared_.push_back(std::move(made));
      } else {
        *shared_[static_cast<std::size_t>(index)] = std::move(*made);
      }
    }
    return static_cast<std::size_t>(index);
  }
  void use(DroneIndex drone, std::size_t index) {
    ++shared_[index]->drones;
    index_[drone] = static_cast<std::uint32_t>(index);
  }

  Config config_;
  bool optics_turn_;
  Make make_;
  std::vector<Setting> settings_;  // (N,)
  std::vector<std::unique_ptr<Shared>> shared_;
  std::vector<std::uint32_t> index_;  // (N,) index into shared_
};

}  // namespace flockstep::sensors
