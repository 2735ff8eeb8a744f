"""RotorPy: its classical vehicle, and the batched one on PyTorch."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import torch
from rotorpy.learning.quadrotor_environments import QuadrotorEnv
from rotorpy.vehicles.crazyflie_params import quad_params as usual
from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams, Multirotor

from peers import rate
from peers.cases import DRONES, PHYSICS_HZ, POLICY_HZ, Flown, Quadrotor


def fly(case: Quadrotor) -> Flown:
    torch.set_num_threads(1)
    numbers = {
        **{"mass": case.mass_kg, "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0},
        **dict(zip(("Ixx", "Iyy", "Izz"), case.inertia_kgm2, strict=True)),
        **{f"c_D{axis}": case.quadratic_drag for axis in "xyz"},
        "num_rotors": 4,
        "rotor_pos": {f"r{i}": np.array(place) for i, place in enumerate(case.position_m)},
        "rotor_directions": -np.array(case.spin),
        **{"rotor_speed_min": 0.0, "rotor_speed_max": 1e4, "k_eta": case.thrust_n},
        "k_m": case.thrust_n * case.torque_ratio_m,
        **{"k_d": 0.0, "k_z": 0.0, "k_h": 0.0, "k_flap": 0.0},
        **{"tau_m": case.lag_s, "motor_noise_std": 0.0},
    }
    found = Flown(version("rotorpy"))
    rest = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0, 0, 1]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, case.hover_radps),
    }
    for name, settings in (("usual tolerance", None), ("tolerance 1e-10", {"rtol": 1e-10, "atol": 1e-10})):
        one = Multirotor(numbers, rest, integrator_kwargs=settings and {"method": "RK45", **settings})
        state = dict(rest)
        for told in case.told_radps:
            state = one.step(state, {"cmd_motor_speeds": np.array(told)}, 1 / POLICY_HZ)
        x, y, z, w = state["q"]
        found.flights[f"lag, quadratic drag: RK45, {name}"] = [*state["x"], w, x, y, z]
    hover = {"cmd_motor_speeds": np.full(4, case.hover_radps)}
    single = Multirotor(numbers, rest)
    found.simulator["RK45, 2 ms, one drone"] = rate(lambda: single.step(rest, hover, 1 / PHYSICS_HZ), 1)

    begin = {name: torch.tensor(np.tile(value, (DRONES, 1))).double() for name, value in rest.items()}
    params = BatchedMultirotorParams([numbers] * DRONES, DRONES, torch.device("cpu"))
    many = BatchedMultirotor(params, DRONES, begin, torch.device("cpu"), integrator="rk4")
    told_all = {"cmd_motor_speeds": torch.full((DRONES, 4), case.hover_radps).double()}
    found.simulator["rk4 in PyTorch, 2 ms, rotor speeds"] = rate(
        lambda: many.step(begin, told_all, 1 / PHYSICS_HZ), DRONES
    )
    # One step of 10 ms is its own default, and cheaper than five of 2 ms.
    begin["rotor_speeds"] = torch.full((DRONES, 4), 1788.53).double()
    envs = QuadrotorEnv(DRONES, begin, control_mode="cmd_ctbr", quad_params=usual, sim_rate=POLICY_HZ)
    envs.reset()
    action = np.zeros((DRONES, 4))
    found.environment["hover, body rates, one tick of 10 ms"] = rate(lambda: envs.step(action), DRONES)
    return found
