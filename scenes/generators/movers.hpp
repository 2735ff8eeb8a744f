// Movers: bodies that a generator adds to a finished world, on ways that keep clear of it.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "planning/draws.hpp"

namespace flockstep {

class Movers {
 public:
  // The world must outlive the object. attempt: of the world's layout.
  Movers(const World& world, std::uint32_t purpose, std::uint64_t seed, std::uint32_t attempt);

  Draws& draws() { return draws_; }
  const std::vector<BodyConfig>& bodies() const { return bodies_; }

  // Adds a body, with a phase and a speed that each episode draws, if its whole way keeps clear of the world and of the box in
  // which drones start. lift_m: height above the floor at which this is tested, for bodies that touch the floor. margin_m: to the
  // world.
  bool add(BodyConfig body, float lift_m = 0.0F, float margin_m = 0.05F);

  // Straight ways on which bodies go back and forth.
  struct Lines {
    Aabb area;                // m, of the middle of the body
    double least_m, most_m;   // lengths
    bool is_aligned = false;  // only along x and y; the body's x axis then points along the way
    double least_mps = 0.5, most_mps = 1.5;
    bool slides = false;  // half of the bodies swing instead of turning back at full speed
    float lift_m = 0.0F;  // as in add()
  };
  // Adds up to `count` bodies on random straight ways.
  void add_on_lines(const std::vector<BodyConfig>& kinds, int count, const Lines& lines);

 private:
  bool add_on_line(BodyConfig body, const Lines& lines);

  const World& world_;
  Draws draws_;
  std::vector<BodyConfig> bodies_;
};

}  // namespace flockstep
