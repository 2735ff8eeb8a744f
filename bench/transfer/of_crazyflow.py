"""Crazyflow, for flights.py.

Its quaternions are x y z w, its speeds rpm, its rotors front right, rear right, rear left, front left.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from crazyflow.dynamics import load_params
from crazyflow.sim import Sim
from flights import FLIGHTS, TICKS_HZ, State
from scipy.spatial.transform import Rotation

THEIRS, OURS = [0, 3, 1, 2], [0, 2, 3, 1]  # our rotor of each of theirs, and back
RPM = 60 / (2 * np.pi)


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
