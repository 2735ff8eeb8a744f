"""flockstep, for flights.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from flights import FLIGHTS, TICKS_HZ, State

import flockstep
from flockstep.rotations import rotate


def quat_wxyz_of(rotation: Any) -> Any:
    """Return the quaternions of rotations (N, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat()[:, [3, 0, 1, 2]]


class Simulator:
    """A batch in an empty world; the midpoint method at 500 Hz."""

    def __init__(self, drone: str, start: State, control: str, hz: float) -> None:
        model = flockstep.DroneModel.load(drone)
        data = model.to_dict()
        rotors = data["rotors"]
        self.mass_kg, self._curve = data["mass_kg"], rotors["thrust_n"]
        self.speeds_radps = (rotors["min_speed_radps"], model.hover_speed_radps, rotors["max_speed_radps"])
        self.batch = flockstep.Batch(
            [flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-1e3] * 3, "max": [1e3] * 3}})],
            FLIGHTS,
            drone=model,
            dynamics=flockstep.DynamicsConfig(
                motion="rotors", control="body_rates" if control == "body_rates" else "rotor_speeds"
            ),
            clock=flockstep.ClockConfig(policy_hz=hz, physics_hz=TICKS_HZ),
            num_threads=1,
        )
        self.batch.set_pose(start.position, quat_wxyz_of(start.rotation))
        self.batch.set_velocity(start.velocity, start.rates, np.full((FLIGHTS, 4), self.speeds_radps[1]))

    def thrust(self, speed: Any) -> Any:
        return np.polyval(self._curve[::-1], speed)

    def state(self) -> State:
        batch = self.batch
        axes = [rotate(batch.quat_wxyz, np.tile(axis, (FLIGHTS, 1))) for axis in np.eye(3)]
        return State(
            np.array(batch.position, float),
            np.array(batch.velocity, float),
            np.stack(axes, axis=2).astype(float),
            np.array(batch.angular_velocity, float),
            np.array(batch.rotor_speed, float),
        )

    def fly_speeds(self, speeds: Any) -> None:
        self.batch.fly(speeds)

    def fly_rates(self, thrust: Any, rates: Any) -> None:
        self.batch.fly(np.column_stack([thrust / self.mass_kg, rates]))
