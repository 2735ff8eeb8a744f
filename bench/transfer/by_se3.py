"""RotorPy's SE(3) controller, with its own gains, for flights.py; it runs once per tick."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from flights import FLIGHTS, State, speed_of
from of_rotorpy import OURS, THEIRS, numbers_of
from rotorpy.controllers.quadrotor_control import BatchedSE3Control
from rotorpy.vehicles.multirotor import BatchedMultirotorParams
from scipy.spatial.transform import Rotation


def known(drone: str, simulator: Any) -> Any:
    """Return the parameters that the controller knows: those of the drone that it flies, and the gains of RotorPy's."""
    numbers = numbers_of(drone)
    if not hasattr(simulator, "batch"):
        return numbers
    data = simulator.batch.drone.to_dict()
    rotors, hovering = data["rotors"], simulator.speeds_radps[1]
    factor = simulator.thrust(hovering) / hovering**2
    return {
        **numbers,
        "mass": data["mass_kg"],
        **dict(zip(("Ixx", "Iyy", "Izz"), data["inertia_kgm2"], strict=True)),
        "rotor_pos": {f"r{i}": np.array(rotors["position_m"][i]) for i in THEIRS},
        "k_eta": factor,
        "k_m": factor * rotors["torque_ratio_m"],
    }


class Controller:
    """Follows the target, with the heading of the start."""

    def __init__(self, drone: str, simulator: Any, target: Any, start: State) -> None:
        torch.set_num_threads(1)
        device = torch.device("cpu")
        params = BatchedMultirotorParams([known(drone, simulator)] * FLIGHTS, FLIGHTS, device)
        self.control = BatchedSE3Control(params, FLIGHTS, device)
        self.simulator, self.target = simulator, target
        self.yaw = np.arctan2(start.rotation[:, 1, 0], start.rotation[:, 0, 0])

    def __call__(self, state: State, time_s: float) -> None:
        """Fly a tick."""

        def tensors(**values: Any) -> Any:
            return {name: torch.tensor(value).double() for name, value in values.items()}

        x, v, a = self.target.at(time_s)
        q = Rotation.from_matrix(state.rotation).as_quat()
        now = tensors(x=state.position, v=state.velocity, q=q, w=state.rates)
        flat = tensors(x=x, x_dot=v, x_ddot=a, yaw=self.yaw, yaw_dot=0 * self.yaw)
        thrusts = self.control.update(time_s, now, flat)["cmd_motor_thrusts"].numpy()[:, OURS]
        self.simulator.fly_speeds(speed_of(self.simulator, thrusts))
