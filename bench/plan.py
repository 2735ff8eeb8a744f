"""Cost of planning with defaults: from start to goal in every bundled world and twenty of each generator."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

import flockstep
from timing import Measured, Median

GENERATORS = ("office", "warehouse", "forest", "city", "playground")
SEEDS = 20


def worlds() -> Iterator[tuple[str, Callable[[], flockstep.World]]]:
    for name in flockstep.scenes.names():
        yield name, lambda name=name: flockstep.World.load(name)  # type: ignore[misc]
    for generator in GENERATORS:
        make = getattr(flockstep.World, generator)
        for seed in range(SEEDS):
            yield f"{generator}/{seed}", lambda make=make, seed=seed: make(seed)  # type: ignore[misc]


def measure() -> Iterator[Measured]:
    """Measure the processor time of the first plan in each world, including its preparation, and the path length."""
    seconds: dict[str, list[float]] = {}
    for name, make in worlds():
        world = make()
        goals = np.array([*world.waypoints, world.goal])
        before = time.process_time()
        path = flockstep.plan(world, world.start, goals, progress=False)
        took = time.process_time() - before
        assert path is not None, f"{name}: expected a path, got none"
        legs = np.diff(path.astype(float), axis=0)
        yield f"plan/{name}/cpu_seconds", took, "s", 1
        yield f"plan/{name}/length_m", float(np.linalg.norm(legs, axis=1).sum()), "m", 1
        seconds.setdefault(name.split("/")[0] if name.split("/")[1].isdigit() else "bundled", []).append(took)
    for kind, times in seconds.items():
        yield f"plan/{kind}/median_cpu_seconds", Median(times), "s", len(times)
        yield f"plan/{kind}/most_cpu_seconds", max(times), "s", len(times)
