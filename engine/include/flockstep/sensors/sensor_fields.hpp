// Fields that sensors share, the mounting pose, the rate, the delay and the time of a drift, and names with which a make_sensor()
// is declared.
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
                                           "Readings per second of simulated time, which divide the ticks of the `ClockConfig`. "
                                           "None: one after every control step.",
                                       .unit = "Hz",
                                       .limits = above(0)};

// Description of `latency_s`.
inline constexpr FieldInfo kSensorLatency{
    .about =
        "Time after which a reading arrives, rounded up to ticks. An episode's first arrives "
        "at once.",
    .unit = "s",
    .limits = between(0, 1)};

// Description of `jitter_s`.
inline constexpr FieldInfo kSensorJitter{.about =
                                             "Greatest further delay, drawn for each reading. The newest one that has arrived "
                                             "holds.",
                                         .unit = "s",
                                         .limits = between(0, 1)};

// Description of `loss`.
inline constexpr FieldInfo kSensorLoss{
    .about = "Probability that a reading is lost. The one before it holds. An episode's first is never lost.",
    .limits = between(0, 1)};

// Description of `drift_time_s`.
inline constexpr FieldInfo kDriftTime{.about = "Correlation time of the drift.", .unit = "s", .limits = between(0.001, 1e6)};

namespace sensors {
class BlockSensor;
struct SensorSetup;
}  // namespace sensors

}  // namespace flockstep
