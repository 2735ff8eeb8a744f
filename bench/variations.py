"""Steps of Hover with drones that differ beside the same drones alike: one thread, processor time, taken in turns."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np

import flockstep
from flockstep.variations import presets
from timing import Measured, Median, in_turns, median_ratio, timed

DRONES, RUNS, STEPS = 1024, 9, 100
BODY = {"mass_scale": (0.8, 1.2), "stretch": (0.9, 1.1), "thrust_scale": (0.9, 1.1), "torque_scale": (0.75, 1.25)}
LAGS = {"lag_up_scale": (0.7, 1.3), "lag_down_scale": (0.7, 1.3), "rate_gain_scale": (0.8, 1.2)}
QUADROTORS = [name for name in flockstep.DroneModel.names() if flockstep.DroneModel.load(name).num_rotors == 4]
KINDS: dict[str, dict[str, Any]] = {
    "alike": {},
    "constants": {"variations": flockstep.vary(mass_scale=1.1, thrust_scale=1.1, rate_gain_scale=0.9)},
    "drawn": {"variations": flockstep.vary(**BODY, **LAGS)},
    "airframes": {"airframes": QUADROTORS},
    "gusts": {"wind": flockstep.WindConfig(gusts="dryden")},
    "everything": {"variations": presets["sim2real"], "airframes": QUADROTORS},
}


def stepping(keywords: dict[str, Any]) -> Any:
    """Return a call that steps Hover under small random actions."""
    envs = gymnasium.make_vec("flockstep/Hover-v0", DRONES, num_threads=1, **keywords)
    envs.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (DRONES, 4)).astype(np.float32)
    return lambda: envs.step(actions)


def measure() -> Iterator[Measured]:
    """Time the kinds in turns, and find the memory of a drone that differs."""
    timers = {kind: timed(stepping(keywords), STEPS) for kind, keywords in KINDS.items()}
    times = in_turns(timers, RUNS, warm_up=True)
    for kind, taken in times.items():
        yield f"variations/{kind}/step", 1e6 * Median(taken) / DRONES, "us", RUNS
        yield f"variations/{kind}/relative_speed", median_ratio(times["alike"], taken), "1", RUNS
    yield "variations/bytes_of_a_drone", bytes_of_a_drone(), "1", 1


def bytes_of_a_drone(drones: int = 200_000) -> float:
    """Return the memory that a drone needs more if it differs."""

    def used(keywords: dict[str, Any]) -> float:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        world = flockstep.World.load("arena/hall")
        batch = flockstep.Batch(
            world, drones, dynamics=flockstep.DynamicsConfig(motion="rotors", control="body_rates"), **keywords
        )
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert batch.num_drones == drones
        return 1024.0 * (after - before) / drones

    used({"drone": "crazyflie"})  # the peak of a batch of drones alike, whose memory the next one takes first
    return used({"drone": "crazyflie", **KINDS["drawn"]})
