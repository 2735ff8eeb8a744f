"""Crazyflow's Mellinger controller, that of the Crazyflie's firmware, for flights.py.

It controls position at 100 Hz and attitude at 500 Hz.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from crazyflow.control import parametrize
from crazyflow.control.mellinger import attitude2force_torque, force_torque2rotor_vel, state2attitude
from flights import FLIGHTS, State
from of_crazyflow import OURS, RPM
from scipy.spatial.transform import Rotation

DRONE = "cf2x_L250"  # whose data our crazyflie has


class Controller:
    """Follows the target, with the heading of the start."""

    def __init__(self, drone: str, simulator: Any, target: Any, start: State) -> None:
        del drone
        functions = (state2attitude, attitude2force_torque, force_torque2rotor_vel)
        self.position, self.attitude, self.mixer = (parametrize(function, DRONE) for function in functions)
        self.simulator, self.target = simulator, target
        yaw = np.arctan2(start.rotation[:, 1, 0], start.rotation[:, 0, 0])
        self.heading = Rotation.from_euler("z", yaw[:, None]).as_quat().reshape(FLIGHTS, 4)
        self.steps, self.sums, self.turned, self.before = 0, None, None, None

    def __call__(self, state: State, time_s: float) -> None:
        """Fly a tick."""
        quat = Rotation.from_matrix(state.rotation).as_quat()
        if self.steps % 5 == 0:
            x, v, a = self.target.at(time_s)
            told = np.concatenate([x, v, a, self.heading, np.zeros((FLIGHTS, 3))], axis=1)
            self.told, self.sums = self.position(state.position, quat, state.velocity, told, self.sums, 100)
        force, torque, self.turned = self.attitude(quat, state.rates, self.told, self.before, self.turned, 500)
        self.before, self.steps = state.rates.copy(), self.steps + 1
        speeds = np.asarray(self.mixer(force, torque))[:, OURS] / RPM
        self.simulator.fly_speeds(speeds)
