// Rows: numbers of kLanes drones that follow each other, as arrays have them, to lanes and back.
#pragma once

#include "dynamics/flight.hpp"

namespace flockstep::dynamics {

// rows: (kLanes, 3) or (kLanes, 4).
void load_rows(const float* rows, Lanes<3>& lanes);
void load_rows(const float* rows, Lanes<4>& lanes);
void store_rows(const Lanes<3>& lanes, float* rows);
void store_rows(const Lanes<4>& lanes, float* rows);

// position + way, and what float32 rounds off of it.
void add(const Lanes<3>& position, const Lanes<3>& way, Lanes<3>& sum, Lanes<3>& rest);

}  // namespace flockstep::dynamics
