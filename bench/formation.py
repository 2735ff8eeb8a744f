"""Formation: trained policies and straight flyers, in halls, playgrounds and warehouses.

The last policy of each training is judged, in worlds and episodes that nothing else uses. Three trainings.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import flockstep
from training import formation
from training.recipes import Verdict, predict_of, train
from training.tasks import UNSEEN_SEEDS
from training.train_formation import Args, judge, recipe_of

SEEDS = (0, 1, 2)
FLIGHTS = 500  # of each kind

Measured = tuple[str, float, str, int]  # name, value, unit, runs


def measure() -> Iterator[Measured]:
    for name, flyer in formation.FLYERS.items():
        yield from figures(name, judge(flyer, FLIGHTS, UNSEEN_SEEDS.start))
    for seed in SEEDS:
        recipe = recipe_of(Args())
        begun = time.perf_counter()
        model: flockstep.PPO = train(recipe, "flockstep", seed, 2)
        seconds = time.perf_counter() - begun
        yield from figures(f"trained/{seed}", judge(predict_of(model), FLIGHTS, UNSEEN_SEEDS.start))
        yield f"formation/trained/{seed}/training_s", seconds, "s", 1


def figures(name: str, verdict: Verdict) -> Iterator[Measured]:
    for what, value in verdict.more.items():
        yield f"formation/{name}/{what}", value, "m" if what.endswith("_m") else "1", FLIGHTS
