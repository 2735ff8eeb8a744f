// Fields that sensors share, the mounting pose, the rate and the delay, and names with which a make_sensor() is declared.
#pragma once

#include "flockstep/fields.hpp"

namespace flockstep {

// Description of `offset_m`.
inline constexpr FieldInfo kMountOffset{.about = "Position (x, y, z) in the body frame.", .unit = "m", .limits = within(100)};

// Description of `quat_wxyz`.
inline constexpr FieldInfo kMountRotation{.about = "Rotation (w, x, y, z) from sensor to body. A norm near 1 is normalised.",
                                          .form = Form::unit_quaternion};

// Description of `rate_hz`.
inline constexpr FieldInfo kSensorRate{.about =
                                           "Readings per second of simulated time. It must divide the ticks per second of the "
                                           "`ClockConfig`. None: after every control step.",
                                       .unit = "Hz",
                                       .limits = above(0)};

// Description of `latency_s`.
inline constexpr FieldInfo kSensorLatency{.about =
                                              "Time after which a reading arrives, rounded up to ticks. The first one of an "
                                              "episode arrives at once.",
                                          .unit = "s",
                                          .limits = between(0, 1)};

// Description of `jitter_s`.
inline constexpr FieldInfo kSensorJitter{.about =
                                             "Greatest further delay of a reading, drawn for each. The newest one that has "
                                             "arrived holds. An overtaken reading is dropped.",
                                         .unit = "s",
                                         .limits = between(0, 1)};

// Description of `loss`.
inline constexpr FieldInfo kSensorLoss{
    .about = "Probability that a reading is lost. The one before it holds. The first one of an episode is never lost.",
    .limits = between(0, 1)};

namespace sensors {
class BlockSensor;
struct SensorSetup;
}  // namespace sensors

}  // namespace flockstep
