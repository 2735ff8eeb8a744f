"""Flies policies and controllers in any simulator, and prints their errors.

Arguments: a module with a `Simulator`, its drone, a policy or a controller, the folder of the policies, and folders
with more packages. It runs in the Python of the simulator, which may lack flockstep: policies are the headers of
`flockstep.export`, compiled, and observations are computed here, in NumPy, as the comments in the headers describe
them. The world is x east, y north, z up, the body x forward, y left, z up; rotors are in flockstep's order: front
right, rear left, front left, rear right.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

Array = Any
FLIGHTS, TICKS_HZ = 100, 500
HOVER_S, TRACK_S = 6.0, 10.0
POINT = np.array([0.0, 0.0, 50.0])  # m, far from any floor
MAX_RATE_RADPS = np.radians([600.0, 600.0, 200.0])  # of a body rate action of 1
OWNERS = {"se3": "rotorpy", "mellinger": "crazyflow"}  # the simulators that the controllers are from
PATH_M, SPEED_MPS, AHEAD_S, POINTS = 1.0, 1.5, 0.1, 5  # of Track


@dataclass
class State:
    """States of N drones."""

    position: Array  # (N, 3) m
    velocity: Array  # (N, 3) m/s, in the world
    rotation: Array  # (N, 3, 3) body to world
    rates: Array  # (N, 3) rad/s, in the body
    speeds: Array  # (N, 4) rad/s


class Simulator(Protocol):
    """The interface that ours.py, of_rotorpy.py and of_crazyflow.py have as `Simulator(drone, start, control, hz)`."""

    mass_kg: float
    speeds_radps: tuple[float, float, float]  # slowest, hovering, fastest

    def state(self) -> State: ...
    def thrust(self, speed: Any) -> Any:
        """Return the thrust of a rotor, N, at a speed."""

    def fly_speeds(self, speeds: Array) -> None:
        """Fly 1 / hz by rotor speeds (N, 4)."""

    def fly_rates(self, thrust: Array, rates: Array) -> None:
        """Fly 1 / hz by thrust (N,) in N and body rates (N, 3), by the simulator's own rate controller."""


def speed_of(simulator: Simulator, thrust: Array) -> Array:
    """Return the speeds at which rotors have these thrusts."""
    slowest, _, fastest = simulator.speeds_radps
    table = np.linspace(slowest, fastest, 20_001)
    return np.interp(thrust, simulator.thrust(table), table)


def rotation_of(yaw: Array, tilt: Array, about: Array) -> Array:
    """Return rotations (N, 3, 3) by yaw, then by tilt about a horizontal axis at the angle `about`."""
    axis = np.stack([np.cos(about), np.sin(about), 0 * about], axis=1)
    cross = np.cross(np.eye(3), axis[:, None, :])
    c, s = np.cos(tilt)[:, None, None], np.sin(tilt)[:, None, None]
    tilted = c * np.eye(3) + s * -cross + (1 - c) * axis[:, :, None] * axis[:, None, :]
    turned = np.zeros((len(yaw), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(yaw)
    turned[:, 1, 0] = np.sin(yaw)
    turned[:, 0, 1] = -np.sin(yaw)
    turned[:, 2, 2] = 1.0
    return tilted @ turned


class Path8:
    """The figure-8 of Track, from random phases."""

    def __init__(self, random: np.random.Generator) -> None:
        turn = np.linspace(0.0, 2 * np.pi, 100_001)
        around = PATH_M * np.stack([np.cos(turn), np.sin(2 * turn) / 2], axis=1)
        self.rate = 2 * np.pi * SPEED_MPS / np.linalg.norm(np.diff(around, axis=0), axis=1).sum()
        self.phase = random.uniform(0.0, 2 * np.pi, FLIGHTS)

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations."""
        a, w = self.phase + self.rate * time_s, self.rate
        flat = 0.0 * a
        return (
            POINT + PATH_M * np.stack([np.cos(a), np.sin(2 * a) / 2, flat], axis=1),
            PATH_M * w * np.stack([-np.sin(a), np.cos(2 * a), flat], axis=1),
            PATH_M * w**2 * np.stack([-np.cos(a), -2 * np.sin(2 * a), flat], axis=1),
        )


class Still:
    """A point at rest, as Hover has it."""

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        del time_s
        zeros = np.zeros((FLIGHTS, 3))
        return POINT + zeros, zeros, zeros


def begin(task: str) -> tuple[Any, State]:
    """Return the target of a task, and random starts: gentle throws, hard ones as Hover's, or Track's figure-8."""
    random = np.random.default_rng(7)
    offset = random.uniform(-1.0, 1.0, (FLIGHTS, 3))
    speeds = np.full((FLIGHTS, 4), np.nan)  # hovering
    if task == "track":
        target = Path8(random)
        place, velocity, _ = target.at(0.0)
        level = np.tile(np.eye(3), (FLIGHTS, 1, 1))
        return target, State(place + 0.1 * offset, velocity, level, np.zeros((FLIGHTS, 3)), speeds)
    offset_m, speed_mps, tilt = (0.2, 0.5, np.radians(40.0)) if task == "gentle" else (0.5, 2.0, np.radians(90.0))
    yaw, about = random.uniform(-np.pi, np.pi, (2, FLIGHTS))
    direction = random.normal(size=(FLIGHTS, 3))
    direction *= random.uniform(0.0, speed_mps, (FLIGHTS, 1)) / np.linalg.norm(direction, axis=1, keepdims=True)
    rotation = rotation_of(yaw, random.uniform(0.0, tilt, FLIGHTS), about)
    return Still(), State(POINT + offset_m * offset, direction, rotation, np.zeros((FLIGHTS, 3)), speeds)


class Policy:
    """Flies by a compiled header."""

    def __init__(self, name: str, folder: Path, simulator: Simulator, target: Any) -> None:
        told = json.loads((folder / "policies.json").read_text())[name]
        self.library = ctypes.CDLL(str(folder / f"{name}.so"))
        self.simulator, self.target, self.told = simulator, target, told
        self.past = [np.zeros((FLIGHTS, 4), np.float32)] * told["past_actions"]
        self.seen: list[Array] = []

    def observe(self, state: State, time_s: float) -> Array:
        """Return the observations of Hover or Track."""

        def to_body(vectors: Array) -> Array:
            return np.einsum("nij,ni->nj", state.rotation, vectors)

        points = POINTS if self.told["task"] == "track" else 1
        parts = [to_body(self.target.at(time_s + AHEAD_S * i)[0] - state.position) for i in range(points)]
        slowest, hovering, fastest = self.simulator.speeds_radps
        above = state.speeds - hovering
        rotors = np.where(above > 0, above / (fastest - hovering), above / (hovering - slowest))
        parts += [to_body(state.velocity), state.rotation[:, 2, :], state.rates / 10.0, rotors]
        if points > 1:
            ahead = state.rotation[:, :2, 0] / np.linalg.norm(state.rotation[:, :2, 0], axis=1, keepdims=True)
            parts.append(np.stack([-ahead[:, 1], ahead[:, 0]], axis=1))
        now = np.concatenate(parts, axis=1)
        self.seen = [now, *(self.seen or [now] * self.told["history"])][: self.told["history"]]
        return np.ascontiguousarray(np.concatenate([*self.seen, *self.past], axis=1), np.float32)

    def __call__(self, state: State, time_s: float) -> None:
        """Fly a step."""
        observations, actions = self.observe(state, time_s), np.empty((FLIGHTS, 4), np.float32)
        pointer = np.ctypeslib.ndpointer(np.float32, flags="C")
        self.library.act.argtypes = [pointer, pointer]
        for observation, action in zip(observations, actions, strict=True):
            self.library.act(observation, action)
        self.past = [actions, *self.past][: len(self.past)]
        simulator = self.simulator
        least, weight, most = (simulator.thrust(speed) for speed in simulator.speeds_radps)
        wide = np.asarray(actions, float)
        thrusts = np.where(wide > 0, weight + wide * (most - weight), weight + wide * (weight - least))
        if self.told["control"] == "rotor_thrusts":
            simulator.fly_speeds(speed_of(simulator, thrusts))
        else:
            simulator.fly_rates(4 * thrusts[:, 0], wide[:, 1:] * MAX_RATE_RADPS)


def fly(module: str, drone: str, pilot: str, folder: Path) -> dict[str, list[float]]:
    """Return the error of each flight by task: distance in the last second, or root mean square; NaN becomes inf."""
    policies = json.loads((folder / "policies.json").read_text())
    errors = {}
    for task, seconds in (("gentle", HOVER_S), ("hard", HOVER_S), ("track", TRACK_S)):
        told = policies.get(pilot)
        if told is not None and (told["task"] == "track") != (task == "track"):
            continue
        target, start = begin(task)
        hz = told["hz"] if told else TICKS_HZ
        control = told["control"] if told else "rotor_speeds"
        simulator = importlib.import_module(module).Simulator(drone, start, control, hz)
        if told:
            act: Callable[[State, float], None] = Policy(pilot, folder, simulator, target)
        else:
            act = importlib.import_module(f"of_{OWNERS[pilot]}").Controller(drone, simulator, target, start)
        distances = []
        steps = round(seconds * hz)
        for step in range(steps):
            act(simulator.state(), step / hz)
            distances.append(np.linalg.norm(simulator.state().position - target.at((step + 1) / hz)[0], axis=1))
        flown = np.array(distances)
        found = flown[-round(hz) :].mean(axis=0) if task != "track" else np.sqrt((flown**2).mean(axis=0))
        errors[task] = np.where(np.isfinite(found), found, 1e9).tolist()
    return errors


if __name__ == "__main__":
    os.environ["SCIPY_ARRAY_API"] = "1"  # Crazyflow needs it
    module, drone, pilot, folder, *more = sys.argv[1:]
    sys.path += more
    print("\n" + json.dumps(fly(module, drone, pilot, Path(folder))))
