"""Swap: policies trained with 16 drones, and straight flyers, each with 2 to 32 drones.

The last policy of each training is judged, in episodes that nothing else uses. Three trainings.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import flockstep
from training import swap
from training.recipes import Verdict, predict_of, train
from training.tasks import UNSEEN_SEEDS
from training.train_swap import Args, judge, recipe_of

SEEDS = (0, 1, 2)
FLIGHTS = 1000

Measured = tuple[str, float, str, int]  # name, value, unit, runs


def measure() -> Iterator[Measured]:
    yield from figures("straight", judge(swap.straight, FLIGHTS, UNSEEN_SEEDS.start))
    for seed in SEEDS:
        recipe = recipe_of(Args())
        begun = time.perf_counter()
        model: flockstep.PPO = train(recipe, "flockstep", seed, 2)
        seconds = time.perf_counter() - begun
        yield from figures(f"trained/{seed}", judge(predict_of(model), FLIGHTS, UNSEEN_SEEDS.start))
        yield f"swap/trained/{seed}/training_s", seconds, "s", 1


def figures(name: str, verdict: Verdict) -> Iterator[Measured]:
    for what, value in verdict.more.items():
        yield f"swap/{name}/{what}", value, "s" if what == "seconds" else "1", FLIGHTS
