"""Steps of drones that sense and collide with each other, relative to drones that do neither.

One thread, in processor time. The variants that are compared alternate.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import flockstep
from compare_rows import scene
from timing import RUNS, Measured, Median, in_turns, median_ratio, timed

STEPS = 40
GROUPS = {
    "8 drones in each of 512 envs": (512, 8, 10.0),
    "1,000 drones in one env": (1, 1000, 60.0),
}  # E, M, side of a hall in m
INTERACTIONS = ("none", "sense", "collide", "both")


def hall(side_m: float) -> flockstep.World:
    """Return an empty hall."""
    half = side_m / 2
    markers = {"start": [0, 0, 1.5], "goal": [half - 1, half - 1, 1.5]}
    world: flockstep.World = scene(flockstep, room={"min": [-half, -half, 0], "max": [half, half, 4]}, markers=markers)
    return world


def measure() -> Iterator[Measured]:
    for name, (envs, drones, side_m) in GROUPS.items():
        for motion in ("kinematic", "rotors"):
            yield from steps(f"contact_groups/{name}/{motion}", envs, drones, hall(side_m), motion)


def steps(name: str, envs: int, drones: int, world: flockstep.World, motion: str) -> Iterator[Measured]:
    """Move drones with a LiDAR to and fro around random places; those of one env are apart when they begin."""
    random = np.random.default_rng(0)
    side = world.bounds[1][0] - world.bounds[0][0] - 2
    rows = int(np.ceil(np.sqrt(drones)))
    cell = side / rows
    number = np.arange(envs * drones) % drones
    places = np.stack([number % rows, number // rows, np.zeros(len(number))], 1) * cell + cell / 2 - side / 2
    places[:, :2] += random.uniform(-1, 1, (len(number), 2)) * max(cell - 1.2, 0) / 2
    places[:, 2] = random.uniform(0.5, 3.5, len(number))
    batches: dict[str, flockstep.Batch] = {}
    for interaction in INTERACTIONS:
        batches[interaction] = make(world, envs * drones, drones, motion, interaction)
    batches["separate"] = make(world, envs * drones, 1, motion, "none")
    timers = {}
    for each, batch in batches.items():
        calls = itertools.cycle([call_of(batch, motion, places, i) for i in range(STEPS)])
        timers[each] = timed(
            lambda batch=batch, calls=calls: (next(calls)(), batch.sense()),
            STEPS,
            before=lambda batch=batch: batch.set_pose(places),
        )
    times = in_turns(timers, warm_up=True)
    for each, seconds in times.items():
        yield f"{name}/{each}/us_per_step", 1e6 * Median(seconds) / len(number), "µs", RUNS
        yield f"{name}/{each}/ratio_to_separate", median_ratio(seconds, times["separate"]), "1", RUNS
    yield f"{name}/both/share_in_contact", float((batches["both"].contact.drone >= 0).mean()), "1", 1


def make(world: flockstep.World, drones: int, per_env: int, motion: str, interaction: str) -> flockstep.Batch:
    """Make a batch whose drones have the default LiDAR."""
    by_rotors = flockstep.DynamicsConfig(motion="rotors", control="velocity", on_contact="bounce")
    settings: dict[str, Any] = {"drones_per_env": per_env, "interaction": interaction, "num_threads": 1}
    settings |= {"dynamics": by_rotors} if motion == "rotors" else {}
    return flockstep.Batch([world], drones, lidar=flockstep.LidarConfig(), **settings)


def call_of(batch: flockstep.Batch, motion: str, places: Any, number: int) -> Callable[[], object]:
    """Return a step to a place at most 0.3 m away, or at most 3 m/s fast."""
    random = np.random.default_rng(number)
    way = random.uniform(-1, 1, places.shape)
    if motion == "rotors":
        command = np.concatenate([3 * way, np.zeros((len(way), 1))], 1)
        return lambda: batch.fly(command)
    target = places + 0.3 * way
    return lambda: batch.move(target)
