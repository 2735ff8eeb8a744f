// Rows: copies the numbers of kLanes consecutive drones between arrays and lanes.
#pragma once

#include "dynamics/flight.hpp"

namespace flockstep::dynamics {

// rows: (kLanes, 3) or (kLanes, 4).
void load_rows(const float* rows, Lanes<3>& lanes);
void load_rows(const float* rows, Lanes<4>& lanes);
void store_rows(const Lanes<3>& lanes, float* rows);
void store_rows(const Lanes<4>& lanes, float* rows);

// Sets position to origin + travelled, and remainder to the rounding error of that sum.
void update_position(Flock& flock);

}  // namespace flockstep::dynamics
