"""RotorPy's batched vehicle and its SE(3) controller, for flights.py.

Its quaternions are x y z w, its rotors front left, front right, rear right, rear left.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import torch
from flights import FLIGHTS, TICKS_HZ, State, speed_of
from rotorpy.controllers.quadrotor_control import BatchedSE3Control
from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams
from scipy.spatial.transform import Rotation

THEIRS, OURS = [2, 0, 3, 1], [1, 3, 0, 2]  # our rotor of each of theirs, and back


def numbers_of(drone: str) -> Any:
    """Return the parameters of a drone of RotorPy, or with another gain of its rate controller: "crazyflie, k_w=20"."""
    name, _, gain = drone.partition(", k_w=")
    numbers = importlib.import_module(f"rotorpy.vehicles.{name}_params").quad_params
    return {**numbers, "k_w": float(gain)} if gain else numbers


class Simulator:
    """Runge-Kutta steps of 2 ms, with their aerodynamics and, for body rates, their rate controller of gain k_w."""

    def __init__(self, drone: str, start: State, control: str, hz: float) -> None:
        torch.set_num_threads(1)
        numbers = numbers_of(drone)
        self.ticks = round(TICKS_HZ / hz)
        self.mass_kg, self._thrust = numbers["mass"], numbers["k_eta"]
        hovering = (9.81 * self.mass_kg / 4 / self._thrust) ** 0.5
        self.speeds_radps = (numbers["rotor_speed_min"], hovering, numbers["rotor_speed_max"])
        values = {
            "x": start.position,
            "v": start.velocity,
            "q": Rotation.from_matrix(start.rotation).as_quat(),
            "w": start.rates,
            "wind": np.zeros((FLIGHTS, 3)),
            "rotor_speeds": np.full((FLIGHTS, 4), hovering),
        }
        self._state = {name: torch.tensor(value).double() for name, value in values.items()}
        device = torch.device("cpu")
        self._vehicle = BatchedMultirotor(
            BatchedMultirotorParams([numbers] * FLIGHTS, FLIGHTS, device),
            FLIGHTS,
            self._state,
            device,
            control_abstraction="cmd_ctbr" if control == "body_rates" else "cmd_motor_speeds",
            integrator="rk4",
        )

    def thrust(self, speed: Any) -> Any:
        return self._thrust * np.square(speed)

    def state(self) -> State:
        x, v, q, w, rotors = (self._state[name].numpy() for name in ("x", "v", "q", "w", "rotor_speeds"))
        finite = np.where(np.isfinite(q).all(axis=1, keepdims=True), q, [0.0, 0.0, 0.0, 1.0])
        return State(x, v, Rotation.from_quat(finite).as_matrix(), w, rotors[:, OURS])

    def _fly(self, told: dict[str, Any]) -> None:
        command = {name: torch.tensor(value).double() for name, value in told.items()}
        for _ in range(self.ticks):
            self._state = self._vehicle.step(self._state, command, 1 / TICKS_HZ)

    def fly_speeds(self, speeds: Any) -> None:
        self._fly({"cmd_motor_speeds": np.asarray(speeds)[:, THEIRS]})

    def fly_rates(self, thrust: Any, rates: Any) -> None:
        self._fly({"cmd_thrust": np.asarray(thrust)[:, None], "cmd_w": rates})


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
    """Follows the target, with the heading of the start, once per tick and with its own gains."""

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
