// MoveLineState: the drones whose lines pictures show. A move line is the path that a drone has flown.
#pragma once

#include "flockstep/arrays.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

// Flags of the lines of a batch.
struct MoveLineState {
  FlagArray move_line_visible, beams_visible;

  static constexpr auto fields() {
    using C = MoveLineState;
    return field_list(array("move_line_visible", &C::move_line_visible,
                            {.values = Values::flag,
                             .writer = "set_move_line_visible(), remove()",
                             .about = "True if the drone's path is recorded and shown in pictures"}),
                      array("beams_visible", &C::beams_visible,
                            {.values = Values::flag,
                             .writer = "set_beams_visible(), remove()",
                             .about = "True if pictures show the beams of the drone's LiDARs"}));
  }
};

}  // namespace flockstep
