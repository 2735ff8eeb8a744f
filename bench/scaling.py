"""Gains by threads: rates of environments, frames and trainings with 1, 2, 4, ... threads."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace

import compare_rows
import flockstep
from timing import Call, Measured, Median, in_turns, timed

RUNS = 5
#: Recipes of the board whose environments are stepped, and the number of drones.
STEPPED = {"lidar": 4096, "hover": 4096, "race": 4096, "forest": 512}
RENDERED = {"playground/camera-train-1": 1024, "indoor/office": 1024}
#: Trainings of the board, with the share of their steps that is trained.
TRAINED = {"hover": 4, "lidar": 4, "lidar_rotors": 8, "race": 16}


def measure() -> Iterator[Measured]:
    """Return rates by number of threads, up to one per processor."""
    from flockstep.trainings.learning import make
    from training.board import TRAININGS, training_seconds

    processors = len(os.sched_getaffinity(0))
    threads = sorted({1 << k for k in range(processors.bit_length())} & set(range(1, processors)) | {processors})
    for name, num_envs in STEPPED.items():
        calls = {n: compare_rows.stepped(make(TRAININGS[name], num_envs, n), 100) for n in threads}
        yield from rates(f"steps_per_second/{name}{num_envs}", num_envs, calls)
    camera = flockstep.CameraConfig(width_px=64, height_px=64, outputs=("rgb", "depth"))
    for name, count in RENDERED.items():
        world = compare_rows.bundled(name)
        calls = {n: compare_rows.sensing(flockstep, world, count, cameras=[camera], num_threads=n) for n in threads}
        yield from rates(f"frames_per_second/{name.replace('/', '_')}", count, calls)
    for name, share in TRAINED.items():
        recipe = replace(TRAININGS[name], steps=TRAININGS[name].steps // share)
        for n in threads:
            seconds = [training_seconds(recipe, seed, n) for seed in range(100, 103)]
            rate = recipe.steps / Median(seconds)
            yield f"scaling/training_steps_per_second/{name}/threads{n}", rate, "1/s", len(seconds)


def rates(name: str, count: int, calls: dict[int, Call]) -> Iterator[Measured]:
    """Return drones per second by number of threads."""
    timers = {n: timed(call, at_least_s=0.2, clock=time.perf_counter) for n, call in calls.items()}
    for n, seconds in in_turns(timers, RUNS).items():
        yield f"scaling/{name}/threads{n}", count / Median(seconds), "1/s", RUNS
