"""Gains by threads: rates of environments, frames and trainings with 1, 2, 4, ... threads."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import flockstep
from bundled import turned

Figure = dict[str, Any]

RUNS = 5
#: Recipes of the board whose environments are stepped, and the number of drones.
STEPPED = {"lidar": 4096, "hover": 4096, "race": 4096, "forest": 512}
#: Trainings of the board, with the share of their steps that is trained.
TRAINED = {"hover": 4, "lidar": 4, "lidar_rotors": 8, "race": 16}


def measure() -> list[Figure]:
    """Return rates and seconds by number of threads, up to one per processor."""
    from flockstep.trainings import train
    from flockstep.trainings.learning import make
    from training.board import TRAININGS, Clock

    processors = len(os.sched_getaffinity(0))
    threads = sorted({1 << k for k in range(processors.bit_length())} & set(range(1, processors)) | {processors})
    figures: list[Figure] = []
    for name, num_envs in STEPPED.items():
        made = {n: stepping(make(TRAININGS[name], num_envs, n)) for n in threads}
        figures += rates(f"steps_per_second/{name}{num_envs}", num_envs, made)
    for name, num_drones in {"playground/camera-train-1": 1024, "indoor/office": 1024}.items():
        made = {n: rendering(name, num_drones, n) for n in threads}
        figures += rates(f"frames_per_second/{name.replace('/', '_')}", num_drones, made)
    for name, share in TRAINED.items():
        recipe = replace(TRAININGS[name], steps=TRAININGS[name].steps // share)
        for n in threads:
            seconds = []
            for seed in range(100, 103):
                clock = Clock(recipe, judges=False)
                train(recipe, "flockstep", seed, n, [clock])
                seconds.append(clock.training_s)
            rate = recipe.steps / statistics.median(seconds)
            figures.append(figure(f"training_steps_per_second/{name}/threads{n}", rate, len(seconds)))
    return figures


def figure(name: str, value: float, runs: int) -> Figure:
    """Return a figure as bench/table.py reads it."""
    return {"name": f"scaling/{name}", "value": float(f"{value:.4g}"), "unit": "1/s", "runs": runs}


def rates(name: str, count: int, calls: dict[int, Callable[[], object]]) -> list[Figure]:
    """Return drones per second by number of threads; the numbers of threads take turns."""
    times: dict[int, list[float]] = {n: [] for n in calls}
    for _ in range(RUNS):
        for n, call in calls.items():
            times[n].append(seconds_per_call(call))
    return [figure(f"{name}/threads{n}", count / statistics.median(each), RUNS) for n, each in times.items()]


def seconds_per_call(call: Callable[[], object], at_least_s: float = 0.2) -> float:
    """Return the mean time of a call in s."""
    calls, begun = 0, time.perf_counter()
    while (passed := time.perf_counter() - begun) < at_least_s:
        call()
        calls += 1
    return passed / calls


def stepping(envs: flockstep.DroneVectorEnv) -> Callable[[], object]:
    """Return a function that steps the environments with random actions."""
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    for i in range(100):
        envs.step(actions[i % 16])
    turn = iter(range(1 << 60))
    return lambda: envs.step(actions[next(turn) % 16])


def rendering(world: str, num_drones: int, num_threads: int) -> Callable[[], object]:
    """Return a function that renders RGB and depth of 64 x 64 for drones at random free positions."""
    loaded = flockstep.World.load(world)
    camera = flockstep.CameraConfig(width_px=64, height_px=64, outputs=("rgb", "depth"))
    batch = flockstep.Batch([loaded], num_drones, cameras=[camera], num_threads=num_threads)
    batch.set_pose(loaded.free_places(num_drones, seed=0), turned(num_drones))
    return batch.capture
