"""Estimates the numbers of an airframe that no data sheet has."""

from __future__ import annotations

import math
from typing import Any

AIR_KGM3 = 1.225


def estimate_airframe(
    *,
    mass_kg: float,
    wheelbase_m: float,
    propeller_m: float,
    max_thrust_n: float,
    max_speed_radps: float | None = None,
    height_m: float | None = None,
    brushed: bool = False,
    name: str = "estimated",
) -> dict[str, Any]:
    """Return the content of a drone file, with estimates for what a data sheet of a quadrotor leaves out.

    `DroneModel.from_dict` makes a drone of it. Replace an estimate if you know better. In brackets: the factor within
    which the estimates for the bundled airframes are right.

    - **Inertia** (1.5): a flat disc of the wheelbase, m r² / 4 about x and y and m r² / 2 about z. MRS's simulator
      (ctu-mrs/mrs_multirotor_simulator) uses a cylinder of this radius.
    - **Torque ratio** (2): 0.21 times the propeller's radius, as MRS's simulator has it (0.07 · 3 · r).
    - **Lag** (2): 30 ms for brushless motors, as MRS's simulator has it; 33 and 40 ms were identified on racers of five
      inches (rl-tools, TU Delft). 100 ms for brushed ones: 72 to 145 ms were published for the Crazyflie.
    - **Fastest speed** (2): from a thrust of 0.15 times air density, revolutions per second squared and diameter to the
      power of four; this coefficient is 0.10 to 0.24 for all bundled airframes but one.
    - **Size**: the propellers' tips; a third of the wheelbase high.

    Parameters
    ----------
    mass_kg
        Mass in flight, kg: with battery.
    wheelbase_m
        Diagonal distance of two rotors, m. They are at the corners of a square.
    propeller_m
        Diameter of a propeller, m: 0.0254 times inches.
    max_thrust_n
        Thrust of one rotor at full throttle, N: 0.00981 times grams.
    max_speed_radps
        Rotor speed at that thrust, rad/s: 0.1047 times rpm. None: estimated.
    height_m
        Height of the body, m. None: estimated.
    brushed
        True for brushed motors, as of a Crazyflie 2.
    name
        Name of the airframe.

    Raises
    ------
    ValueError
        A number is not finite and positive, or neighbouring propellers overlap.
    """
    given = {"mass_kg": mass_kg, "wheelbase_m": wheelbase_m, "propeller_m": propeller_m, "max_thrust_n": max_thrust_n}
    for field, value in {**given, "max_speed_radps": max_speed_radps, "height_m": height_m}.items():
        if value is not None and not 0 < value < math.inf:
            raise ValueError(f"{field}: expected a finite number > 0, got {value!r}")
    side_m = wheelbase_m / math.sqrt(2)
    if propeller_m > side_m:
        raise ValueError(
            f"propeller_m: expected at most {side_m:.3g}, so that propellers do not overlap, got {propeller_m!r}"
        )
    if max_speed_radps is None:
        max_speed_radps = 2 * math.pi * math.sqrt(max_thrust_n / (0.15 * AIR_KGM3 * propeller_m**4))
    disc = mass_kg * (wheelbase_m / 2) ** 2
    arm, width = side_m / 2, side_m + propeller_m
    return {
        "flockstep_drone": 1,
        "name": name,
        "mass_kg": mass_kg,
        "inertia_kgm2": [disc / 4, disc / 4, disc / 2],
        "size_m": [width, width, height_m or wheelbase_m / 3],
        "rotors": {
            "position_m": [[arm, -arm, 0], [-arm, arm, 0], [arm, arm, 0], [-arm, -arm, 0]],
            "spin": ["ccw", "ccw", "cw", "cw"],
            "max_thrust_n": max_thrust_n,
            "max_speed_radps": max_speed_radps,
            "torque_ratio_m": 0.21 * propeller_m / 2,
            "lag_s": 0.1 if brushed else 0.03,
            "radius_m": propeller_m / 2,
        },
    }
