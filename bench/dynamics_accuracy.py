"""Accuracy of simulated rotor flight, and quality of the controller: `./dev bench dynamics_accuracy`.

The reference is tests/python/support/rigid_body.py: the equations of docs/dynamics.md in double precision.
Unlike times, errors do not depend on the processor, so every machine gives the same figures.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from timing import Measured

sys.path.append(str(Path(__file__).resolve().parent.parent / "tests" / "python" / "support"))
from rigid_body import (  # type: ignore[import-not-found]
    OPEN,
    Body,
    Start,
    angle_between,
    batch_of,
    frame,
    rows_of,
)

DRONES = 64
STEP_HZ = 100  # rate of the commands: rotor speeds, or a target position
FAR_M = np.array([[1000.3, 1000.1, 999.7]], np.float32)


def root_mean_square(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def under_rotor_speeds() -> Iterator[Measured]:
    """Fly one second of random rotor speeds, by frame, integrator and rate, and compare with the reference."""
    for name in ("kingfisher", "x500"):
        data = frame(name)
        drone = flockstep.DroneModel.from_dict(data)
        hover = drone.hover_speed_radps
        random = np.random.default_rng(0)
        told = hover * random.uniform(0.8, 1.2, (STEP_HZ, DRONES, 4))
        limits = data["rotors"]["min_speed_radps"], data["rotors"]["max_speed_radps"]
        told = np.clip(told, *limits).astype(np.float32).astype(float)
        start = Start.random(DRONES, data)
        start.quat_wxyz[:], start.velocity[:], start.rates[:], start.speed[:] = [1, 0, 0, 0], 0, 0, hover
        end = Body([data] * DRONES).fly(start.rows(), told, 1 / STEP_HZ)[-1]
        for integrator in ("midpoint", "rk4"):
            for hz in (20000, 5000, 2000, 1000, 500, 200, 100):
                batch = batch_of(data, DRONES, STEP_HZ, hz, integrator=integrator)
                start.place(batch)
                for command in told:
                    batch.fly(command)
                got = rows_of(batch)
                subject = f"dynamics_accuracy/error/{name}/{integrator}/{hz}"
                away = root_mean_square(np.linalg.norm(got[:, :3] - end[:, :3], axis=1))
                turned = root_mean_square(angle_between(got[:, 3:7], end[:, 3:7]))
                yield f"{subject}/mm", 1e3 * away, "mm", DRONES
                yield f"{subject}/degrees", turned, "°", DRONES
        way = root_mean_square(np.linalg.norm(end[:, :3] - start.position, axis=1))
        turn = float(np.mean(angle_between(end[:, 3:7], start.quat_wxyz)))
        yield f"dynamics_accuracy/way/{name}/m", way, "m", DRONES
        yield f"dynamics_accuracy/way/{name}/degrees", turn, "°", DRONES


def on_a_tour() -> Iterator[Measured]:
    """Fly to six random points in 3 s, by midpoint at 500 Hz and by rk4 at 8,000 Hz; the controller runs at 500 Hz."""
    points = np.random.default_rng(0).uniform(-3, 3, (6, DRONES, 3))
    commands = np.concatenate([points, np.zeros((6, DRONES, 1))], axis=2)
    for name in ("kingfisher", "x500"):
        ends = []
        for integrator, hz in (("midpoint", 500), ("rk4", 8000)):
            batch = flockstep.Batch(
                [OPEN],
                DRONES,
                drone=flockstep.DroneModel.load(name),
                dynamics=flockstep.DynamicsConfig(motion="rotors", control="position", integrator=integrator),
                clock=flockstep.ClockConfig(policy_hz=100, physics_hz=hz, controller_hz=500),
            )
            batch.set_pose(np.zeros((DRONES, 3)))
            for command in commands:
                for _ in range(50):
                    batch.fly(command)
            ends.append(rows_of(batch)[:, :3])
        away = root_mean_square(np.linalg.norm(ends[0] - ends[1], axis=1))
        yield f"dynamics_accuracy/tour/{name}/mm", 1e3 * away, "mm", DRONES


def settling() -> Iterator[Measured]:
    """Fly 1 m to the side, level, from rest, with the position controller at the default rates."""
    for name in flockstep.DroneModel.names():
        batch = batch_of(frame(name), 1, 500, 500, control="position")
        batch.set_pose([[0, 0, 0]])
        way, off = [], []
        for _ in range(10 * 500):
            batch.fly([[1, 0, 0, 0]])
            way.append(float(batch.position[0, 0]))
            off.append(float(np.linalg.norm(batch.position[0] - [1, 0, 0])))
        seconds = np.arange(1, len(way) + 1) / 500
        subject = f"dynamics_accuracy/settling/{name}"
        yield f"{subject}/seconds_to_90_percent", float(seconds[np.argmax(np.array(way) > 0.9)]), "s", 1
        yield f"{subject}/overshoot_percent", 100 * (max(way) - 1), "%", 1
        yield f"{subject}/seconds_to_5_cm", float(seconds[np.flatnonzero(np.array(off) > 0.05)[-1]]), "s", 1


def ten_steps_ahead() -> Iterator[Measured]:
    """Send a drone of the LiDAR task forward by 0.1 m, ten times, from rest, and measure the distance flown."""
    for name in flockstep.DroneModel.names():
        drone = flockstep.DroneModel.load(name)
        for hz in (2, 5, 10, 20):
            envs = flockstep.DroneVectorEnv(
                1, worlds="train", action="displacement", motion="rotors", drone=drone, policy_hz=hz
            )
            envs.reset(seed=0)
            start = envs.batch.position.copy()
            for _ in range(10):
                envs.step(np.float32([[1, 0, 0]]))
            flown = float(np.linalg.norm(envs.batch.position - start))
            envs.close()
            yield f"dynamics_accuracy/ten_steps_ahead/{name}/{hz}/m", flown, "m", 1


def hover_far_out() -> Iterator[Measured]:
    """Hold a point 1 km from the origin along each axis for ten minutes, after one minute to arrive from 0.6 m away.

    In exact arithmetic the point is an equilibrium of the equations, so the measured distance is the error of float32.
    """
    hz = 50
    batch = batch_of(frame(), 1, hz, control="position")
    batch.set_pose(FAR_M + np.float32([0.5, -0.3, 0.2]))
    command = np.concatenate([FAR_M, [[0]]], axis=1)
    places = []
    for step in range(660 * hz):
        batch.fly(command)
        if step >= 60 * hz:
            places.append(batch.position[0].astype(float))
    off = np.array(places) - FAR_M[0]
    subject = "dynamics_accuracy/ten_minutes_at_1_km"
    yield f"{subject}/mean_mm", 1e3 * float(np.linalg.norm(off.mean(axis=0))), "mm", 1
    yield f"{subject}/farthest_mm", 1e3 * float(np.linalg.norm(off, axis=1).max()), "mm", 1


def measure() -> Iterator[Measured]:
    for part in (under_rotor_speeds, on_a_tour, settling, ten_steps_ahead, hover_far_out):
        yield from part()
