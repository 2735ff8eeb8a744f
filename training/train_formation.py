"""Train drones to fly in formation with flockstep.PPO, and judge the last policy.

.venv/bin/python -m training.train_formation             # out/train/formation.zip, takes a few minutes
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from training import formation, train_recipe
from training.recipes import Recipe, Verdict
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args(train_recipe.Args):
    """Options."""

    out: Path = Path("out/train/formation.zip")
    """File of the policy."""
    steps: int = formation.STEPS
    """Steps of all drones together."""
    flights: int = 500
    """Episodes of each kind that judge the policy; nothing else uses their seeds."""


def judge(predict: formation.Predict, flights: int, seed: int) -> Verdict:
    """Fly episodes of each kind; the verdict is the mean over the kinds."""
    figures = {}
    for kind in formation.KINDS:
        flown = formation.fly(predict, flights, seed, kind)
        figures[f"{kind}_success"] = float(flown.success.mean())
        figures[f"{kind}_touched"] = float(flown.touched.mean())
        figures[f"{kind}_error_m"] = float(flown.error.mean())
    success, touched = (
        sum(figures[f"{kind}_{what}"] for kind in formation.KINDS) / len(formation.KINDS)
        for what in ("success", "touched")
    )
    return Verdict(success, touched, figures)


def recipe_of(args: Args) -> Recipe:
    """Return the recipe of the training."""
    return Recipe(
        steps=args.steps,
        num_envs=formation.NUM_ENVS,
        settings=formation.SETTINGS,
        make=formation.make,
        judge=judge,
        baseline=lambda: judge(formation.ahead, args.flights, UNSEEN_SEEDS.start),
        film={"env": "flockstep/Formation-v0", "steps": 300},
    )


def main(args: Args) -> None:
    """Train, save, judge and print."""
    train_recipe.run(recipe_of(args), args, "flights of each kind")


if __name__ == "__main__":
    main(tyro.cli(Args))
