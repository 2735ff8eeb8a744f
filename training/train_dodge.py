"""Train a drone to dodge bodies with flockstep.PPO, and judge the last policy.

.venv/bin/python -m training.train_dodge                    # out/train/dodge.zip, takes a few minutes
.venv/bin/python -m training.train_dodge --still            # in the same worlds without bodies, for comparison
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import tyro

from training import dodge, train_recipe
from training.recipes import Recipe, Verdict
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args(train_recipe.Args):
    """Options."""

    out: Path = Path("out/train/dodge.zip")
    """File of the policy."""
    still: bool = False
    """Train in worlds without bodies; the flights that judge have them all the same."""
    steps: int = dodge.STEPS
    """Steps of all drones together."""


def judge(predict: dodge.Predict, flights: int, seed: int) -> Verdict:
    """Fly once in each of several living worlds."""
    flown = dodge.fly(predict, flights, seed)
    figures = {"contacts_per_minute": flown.crashes_per_minute}
    for kind in dodge.WORLDS:
        figures[f"success_in_{kind}s"] = float(flown.success[flown.of(kind)].mean())
    return Verdict(float(flown.success.mean()), float(flown.crashed.mean()), figures)


def recipe_of(args: Args) -> Recipe:
    """Return the recipe of the training."""
    return Recipe(
        steps=args.steps,
        num_envs=dodge.NUM_ENVS,
        settings=dodge.SETTINGS,
        entropy=0.003,
        make=functools.partial(dodge.make, living=not args.still),
        judge=judge,
        baseline=lambda: judge(dodge.straight, args.flights, UNSEEN_SEEDS.start),
        film={"env": "flockstep/Dodge-v0", "steps": dodge.MOST_STEPS},
    )


def main(args: Args) -> None:
    """Train, save, judge and print."""
    train_recipe.run(recipe_of(args), args, "flights")


if __name__ == "__main__":
    main(tyro.cli(Args))
