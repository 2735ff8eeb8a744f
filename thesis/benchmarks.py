"""The three benchmarks of chapter 5: drones that move, LiDARs with more beams, and cameras.

A server steps by itself, at most `RATE_HZ` times per second, while each drone has a C++ client that sends one operation
after the other (bench/clients.cpp). A row has the response times and the steps per second, which the thesis calls FPS.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

import flockstep
from server import WORLD, beside, serving
from timing import RUNS, Figure, Measured, figure, in_turns, native, timed

COUNTS = (1, 2, 4, 8, 16, 24, 32, 64, 128)  # drones
CAMERA_COUNTS = COUNTS[:6]
BEAMS = (35, 125, 250, 500, 1000)
MODES = ("every_step", "on_movement", "on_demand")
ENVIRONMENTS = ("simple", "complex")
LOADS = {"still": "image", "moving": "move+image"}  # what bench/clients.cpp calls them
MOVEMENT_S, SCANS_S, CAMERAS_S = 60.0, 30.0, 15.0  # of a row, as in the thesis
RATE_HZ = 1000.0
SAMPLE_S = 0.02  # least time over which one value of the steps per second is measured
POINTS = 60  # of a curve
DRONES = 1024  # in process

Figures = Iterator[Measured | Figure]
Rows = Mapping[str, Callable[[], Figures]]


def movement(seconds: float = MOVEMENT_S) -> Rows:
    """Return the rows of tables 5.2 and 5.3, by the number of drones."""
    return {str(count): partial(loaded, of_lidars(count), count, "move", seconds) for count in COUNTS}


def scans(seconds: float = SCANS_S) -> Rows:
    """Return the rows of tables 5.4 and 5.5, by the numbers of beams and drones."""
    return {
        f"{beams}_{count}": partial(loaded, of_lidars(count, beams), count, "scan", seconds)
        for count, beams in itertools.product(COUNTS, BEAMS)
    }


def cameras(seconds: float = CAMERAS_S) -> Rows:
    """Return the rows of tables 5.6 and 5.7, by mode, motion, environment and drones, and one without a server."""
    rows: dict[str, Callable[[], Figures]] = {
        f"{mode}_{motion}_{environment}_{count}": partial(
            loaded, of_cameras(count, mode, environment), count, LOADS[motion], seconds
        )
        for mode, count, motion, environment in itertools.product(MODES, CAMERA_COUNTS, LOADS, ENVIRONMENTS)
    }
    return {**rows, "in_process": in_process}


def of_lidars(count: int, beams: int = 35) -> dict[str, Any]:
    """Return the recipe of drones in one room with LiDARs."""
    return {**WORLD, "drones_per_env": count, "lidars": [{"beams": beams}]}


def of_cameras(count: int, mode: str, environment: str) -> dict[str, Any]:
    """Return the recipe of drones in one world with cameras."""
    camera = {"width_px": 640, "height_px": 480, "capture_mode": mode}
    return {**WORLD, "worlds": [f"bench/{environment}"], "drones_per_env": count, "cameras": [camera]}


def loaded(recipe: dict[str, Any], count: int, load: str, seconds: float) -> Figures:
    """Load a server of its own for some seconds."""
    with (
        serving(recipe, "--rate-hz", str(RATE_HZ)) as served,
        flockstep.connect(served.address) as client,
        step_rates(client) as samples,
    ):
        begun = time.perf_counter()
        figures = native("clients", served.address, count, load, seconds)
    times = {f["name"]: f["value"] for f in figures}
    curve = [(float(name.removeprefix("curve/")), times.pop(name)) for name in list(times) if name.startswith("curve/")]
    begun += times.pop("connecting")
    samples = [(at - begun, rate) for at, rate in samples if begun + SAMPLE_S < at < begun + seconds]
    for name, value in times.items():
        yield name, value, "1" if name == "requests" else "ms", 1
    yield figure("over_time", times["mean"], "ms", 1, curve=curve)
    rates = np.array([rate for _, rate in samples])
    yield "rate_samples", len(rates), "1", 1
    for what in ("mean", "std", "min", "max", "p5", "p25", "p75", "p95"):
        value = np.percentile(rates, int(what[1:])) if what[0] == "p" else getattr(rates, what)()
        yield f"rate_{what}", float(value), "1/s", 1
    means = [part.mean(axis=0) for part in np.array_split(np.array(samples), min(POINTS, len(samples)))]
    yield figure("rate_over_time", rates.mean(), "1/s", 1, curve=np.round(means, 3).tolist())


@contextlib.contextmanager
def step_rates(client: flockstep.client.Client) -> Iterator[list[tuple[float, float]]]:
    """Collect the steps per second of a server while the block runs, each with its time.

    A value is measured over `SAMPLE_S` and at least one step.
    """
    samples: list[tuple[float, float]] = []
    at = time.perf_counter()
    step = client.get_arrays(["tick"]).time.step

    def sample() -> None:
        nonlocal at, step
        time.sleep(SAMPLE_S)
        while (now := client.get_arrays(["tick"]).time.step) == step:
            time.sleep(SAMPLE_S / 10)
        before, at = at, time.perf_counter()
        samples.append((at, (now - step) / (at - before)))
        step = now

    with beside(sample):
        yield samples


def in_process(drones: int = DRONES) -> Figures:
    """Time images of 64 x 64 pixels without a server, on one thread, for drones that stand and drones that move."""
    timers = {}
    for environment, mode in itertools.product(ENVIRONMENTS, MODES):
        world = flockstep.World.load(f"bench/{environment}")
        camera = flockstep.CameraConfig(width_px=64, height_px=64, capture_mode=mode)
        batch = flockstep.Batch([world], drones, cameras=[camera], num_threads=1)
        places = world.free_places(drones, seed=0)
        batch.set_pose(places)
        read = batch.capture if mode == "on_demand" else batch.sense
        random = np.random.default_rng(0)
        moves = itertools.cycle([places + random.uniform(-0.1, 0.1, places.shape) for _ in range(8)])
        for motion, before in (("still", None), ("moving", lambda batch=batch, moves=moves: batch.move(next(moves)))):
            timers[f"{mode}_{motion}_{environment}"] = timed(read, before=before)
    for name, seconds in in_turns(timers, RUNS, warm_up=True).items():
        yield name, drones / float(np.median(seconds)), "1/s", RUNS
