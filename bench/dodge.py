"""Dodge: policies trained among bodies, policies trained in the same worlds without them, and a straight flyer.

The last policy of each training is judged, in worlds and flights that nothing else uses. Four trainings.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import flockstep
from training import dodge
from training.recipes import Verdict, predict_of, train
from training.tasks import UNSEEN_SEEDS
from training.train_dodge import Args, judge, recipe_of

RUNS = ((False, 0), (False, 1), (False, 2), (True, 0))  # without bodies, seed
FLIGHTS = 1000

Measured = tuple[str, float, str, int]  # name, value, unit, runs


def measure() -> Iterator[Measured]:
    yield from figures("straight", judge(dodge.straight, FLIGHTS, UNSEEN_SEEDS.start), FLIGHTS)
    for still, seed in RUNS:
        recipe = recipe_of(Args(still=still))
        begun = time.perf_counter()
        model: flockstep.PPO = train(recipe, "flockstep", seed, 2)
        seconds = time.perf_counter() - begun
        name = f"{'still' if still else 'living'}/{seed}"
        yield from figures(name, judge(predict_of(model), FLIGHTS, UNSEEN_SEEDS.start), FLIGHTS)
        yield f"dodge/{name}/training_s", seconds, "s", 1


def figures(name: str, verdict: Verdict, flights: int) -> Iterator[Measured]:
    yield f"dodge/{name}/success", verdict.success, "1", flights
    for what, value in verdict.more.items():
        yield f"dodge/{name}/{what}", value, "1/min" if "minute" in what else "1", flights
