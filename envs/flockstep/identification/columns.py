"""The columns of a flight log: their names in CSV files, and what Crazyflies call them."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

#: Most rotors of an airframe.
MOST_ROTORS = 8
#: Rotors of our order that the motors of a Crazyflie are: front right, rear right, rear left, front left.
_CRAZYFLIE_ROTORS = (1, 4, 2, 3)
_G = 9.81
_DEG = math.pi / 180


class Column(NamedTuple):
    """A column's name in flockstep, and the factor to its unit."""

    name: str
    factor: float


def _axes(name: str, unit: str) -> list[str]:
    return [f"{name}_{axis}_{unit}" for axis in "xyz"]


#: Columns of three numbers, by what they measure.
GYRO = _axes("gyro", "radps")
ACCELEROMETER = _axes("accelerometer", "mps2")
POSITION = _axes("position", "m")
VELOCITY = _axes("velocity", "mps")
#: Of the centre in the world frame, without gravity.
ACCELERATION = _axes("acceleration", "mps2")
ATTITUDE = ["roll_rad", "pitch_rad", "yaw_rad"]
#: Rotor commands from 0 to 1, in the order of the airframe. A duty cycle acts times the battery's voltage.
MOTORS = [f"motor_{k + 1}" for k in range(MOST_ROTORS)]
DUTIES = [f"duty_{k + 1}" for k in range(MOST_ROTORS)]
NAMES = [
    *("time_s", *MOTORS, *DUTIES, "battery_v"),
    *(*GYRO, *ACCELEROMETER, *POSITION, *VELOCITY, *ACCELERATION, *ATTITUDE),
]

_CRAZYFLIE = {
    "pm.vbatMV": Column("battery_v", 1e-3),
    "pm.vbat": Column("battery_v", 1.0),
    "stateEstimate.roll": Column("roll_rad", _DEG),
    "stateEstimate.pitch": Column("pitch_rad", -_DEG),  # the firmware's is nose up
    "stateEstimate.yaw": Column("yaw_rad", _DEG),
    **{f"motor.m{k + 1}": Column(f"motor_{rotor}", 1 / 65535) for k, rotor in enumerate(_CRAZYFLIE_ROTORS)},
    **{f"pwm.m{k + 1}_pwm": Column(f"duty_{rotor}", 1 / 65535) for k, rotor in enumerate(_CRAZYFLIE_ROTORS)},
    **{f"gyro.{axis}": Column(name, _DEG) for axis, name in zip("xyz", GYRO, strict=True)},
    **{f"acc.{axis}": Column(name, _G) for axis, name in zip("xyz", ACCELEROMETER, strict=True)},
    **{f"stateEstimate.{axis}": Column(name, 1.0) for axis, name in zip("xyz", POSITION, strict=True)},
    **{f"stateEstimate.v{axis}": Column(name, 1.0) for axis, name in zip("xyz", VELOCITY, strict=True)},
    **{f"stateEstimate.a{axis}": Column(name, _G) for axis, name in zip("xyz", ACCELERATION, strict=True)},
}


def column_of(name: str) -> Column | None:
    """Return the column that a name in a file means, or None for columns that are not used."""
    name = name.strip()
    if name in NAMES:
        return Column(name, 1.0)
    return _CRAZYFLIE.get(name)


def rotors_of(names: set[str], kind: str) -> int:
    """Return how many motors, or duties, a log has without a gap from the first on."""
    found = {int(name.rpartition("_")[2]) for name in names if re.fullmatch(rf"{kind}_\d", name)}
    return next(k for k in range(MOST_ROTORS + 1) if k + 1 not in found)
