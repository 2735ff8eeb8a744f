// Events: counts the events of one event camera of every drone, between one image and the next.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/state.hpp"

namespace flockstep::sensors {

class Events {
 public:
  // pixels: of an image. label: of the camera; each label has its own random numbers.
  Events(const EventPixels& model, std::size_t pixels, ImageLayout layout, const std::string& label, const ClockConfig& clock,
         std::size_t drones_per_env, std::size_t num_drones);

  // Memory of a pixel, without its counts.
  static double bytes_of_pixel(const EventPixels& model) {
    return 4.0 + 8.0 * (model.threshold_std > 0.0F) + 4.0 * (model.refractory_s > 0.0F);
  }

  // The next image is a first one, without events.
  void forget(DroneIndex drone) { tick_[drone] = kNone; }
  // An image of the drone is taken at the current tick; write() follows when it is rendered. Of several at one tick, the first
  // has the events.
  void take(DroneIndex drone, const State& state);
  // Writes the events of the image (H, W) that was taken, in the layout of the camera. Does nothing if there is none.
  void write(DroneIndex drone, const State& state, const std::uint8_t* grey, std::uint8_t* events);

  void visit(ArrayVisitor& visitor);
  // Throws std::invalid_argument if restored numbers cannot be used.
  void check() const;

 private:
  static constexpr std::int64_t kNone = -1;
  enum class Taken : std::uint8_t { none, first, next };

  void begin(DroneIndex drone, const State& state, const std::uint8_t* grey, std::uint8_t* events);
  PhiloxInput input(DroneIndex drone, const State& state, std::int64_t tick) const;
  float allowed(float count, float elapsed_s, float& idle_s) const;

  EventPixels model_;
  std::size_t pixels_;
  std::size_t across_, apart_;  // distances between the values of neighbouring pixels, and of the two polarities
  double tick_s_;
  Stream stream_;
  std::size_t drones_per_env_;
  std::vector<float> log_;          // (256,) brightness of a grey value
  std::vector<Taken> taken_;        // (N,)
  std::vector<float> elapsed_s_;    // (N,) time between the image that was taken and the one before it
  std::vector<std::int64_t> tick_;  // (N,) tick of the last image; kNone if there is none
  std::vector<float> reference_;    // (N, H W)
  std::vector<float> on_, off_;     // (N, H W) thresholds; empty without threshold_std
  std::vector<float> idle_s_;       // (N, H W) time since the last event; empty without refractory_s
};

}  // namespace flockstep::sensors
