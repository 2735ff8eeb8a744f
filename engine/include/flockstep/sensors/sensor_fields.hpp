// Fields that all sensors share, the mounting pose and the rate, and names with which a make_sensor() is declared.
#pragma once

#include "flockstep/fields.hpp"

namespace flockstep {

// Description of `offset_m`.
inline constexpr FieldInfo kMountOffset{
    .about = "Position of the sensor (x, y, z) in the body frame.", .unit = "m", .limits = within(100)};

// Description of `quat_wxyz`.
inline constexpr FieldInfo kMountRotation{
    .about = "Rotation (w, x, y, z) from the sensor's frame to the body frame; normalised if it is close to a unit quaternion.",
    .form = Form::unit_quaternion};

// Description of `rate_hz`.
inline constexpr FieldInfo kSensorRate{
    .about =
        "Readings per second of simulated time; it has to divide the ticks per second of the `ClockConfig`. None: one "
        "reading after every control step.",
    .unit = "Hz",
    .limits = above(0)};

namespace sensors {
class BlockSensor;
struct SensorSetup;
}  // namespace sensors

}  // namespace flockstep
