"""Crazyflow and its Mellinger controller, that of the Crazyflie's firmware, for flights.py.

Its quaternions are x y z w, its speeds rpm, its rotors front right, rear right, rear left, front left.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from crazyflow.control import parametrize
from crazyflow.control.mellinger import attitude2force_torque, force_torque2rotor_vel, state2attitude
from crazyflow.dynamics import load_params
from crazyflow.sim import Sim
from flights import FLIGHTS, TICKS_HZ, State
from scipy.spatial.transform import Rotation

THEIRS, OURS = [0, 3, 1, 2], [0, 2, 3, 1]  # our rotor of each of theirs, and back
RPM = 60 / (2 * np.pi)
CONTROLLED = "cf2x_L250"  # whose data our crazyflie has


class Simulator:
    """First principles, by Runge-Kutta steps of 2 ms; for body rates, their rate controller without its levelling."""

    def __init__(self, drone: str, start: State, control: str, hz: float) -> None:
        numbers = load_params("first_principles", drone)
        self.ticks = round(TICKS_HZ / hz)
        self.mass_kg, self._curve = float(numbers["mass"]), np.ravel(numbers["rpm2thrust"])
        table = np.linspace(1.0, 40_000.0, 400_001)
        thrusts = np.polyval(self._curve[::-1], table)
        rising = thrusts > 0
        ends = (numbers["thrust_min"], 9.81 * self.mass_kg / 4, numbers["thrust_max"])
        slowest, hovering, fastest = (
            float(np.interp(float(end), thrusts[rising], table[rising])) / RPM for end in ends
        )
        self.speeds_radps = (slowest, hovering, fastest)
        self.sim = Sim(
            n_worlds=FLIGHTS,
            drone=drone,
            dynamics="first_principles",
            control={"body_rates": "body_rate", "state": "state"}.get(control, "rotor_vel"),
            integrator="rk4",
            freq=TICKS_HZ,
        )
        sim = self.sim
        sim.reset()

        def worlds(values: Any) -> Any:
            return jnp.asarray(values, jnp.float32).reshape(FLIGHTS, 1, -1)

        states = sim.data.states.replace(
            pos=worlds(start.position),
            quat=worlds(Rotation.from_matrix(start.rotation).as_quat()),
            vel=worlds(start.velocity),
            ang_vel=worlds(start.rates),
            rotor_vel=worlds(np.full((FLIGHTS, 4), hovering * RPM)),
        )
        sim.data = sim.data.replace(states=states)
        if control == "body_rates":
            rates = sim.data.controls.body_rate
            params = {**rates.params, **{name: 0 * rates.params[name] for name in ("kR", "ki_m")}}
            controls = sim.data.controls.replace(body_rate=rates.replace(params=params))
            sim.data = sim.data.replace(controls=controls)

    def thrust(self, speed: Any) -> Any:
        return np.polyval(self._curve[::-1], np.asarray(speed) * RPM)

    def state(self) -> State:
        states = self.sim.data.states
        x, v, q, w, rotors = (
            np.asarray(values, float)[:, 0]
            for values in (states.pos, states.vel, states.quat, states.ang_vel, states.rotor_vel)
        )
        finite = np.where(np.isfinite(q).all(axis=1, keepdims=True), q, [0.0, 0.0, 0.0, 1.0])
        return State(x, v, Rotation.from_quat(finite).as_matrix(), w, rotors[:, OURS] / RPM)

    def fly_speeds(self, speeds: Any) -> None:
        told = np.asarray(speeds)[:, THEIRS] * RPM
        self.sim.rotor_vel_control(jnp.asarray(told, jnp.float32)[:, None])
        self.sim.step(self.ticks)

    def fly_rates(self, thrust: Any, rates: Any) -> None:
        told = np.column_stack([rates, thrust])
        self.sim.body_rate_control(jnp.asarray(told, jnp.float32)[:, None])
        self.sim.step(self.ticks)


class Controller:
    """Follows the target, with the heading of the start: its position at 100 Hz, by attitude at 500 Hz."""

    def __init__(self, drone: str, simulator: Any, target: Any, start: State) -> None:
        del drone
        functions = (state2attitude, attitude2force_torque, force_torque2rotor_vel)
        self.position, self.attitude, self.mixer = (parametrize(function, CONTROLLED) for function in functions)
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
