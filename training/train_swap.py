"""Train drones to exchange places with flockstep.PPO, and judge the last policy.

.venv/bin/python -m training.train_swap             # out/train/swap.zip, takes a few minutes
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from training import swap, train_recipe
from training.recipes import Recipe, Verdict
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args(train_recipe.Args):
    """Options."""

    out: Path = Path("out/train/swap.zip")
    """File of the policy."""
    steps: int = swap.STEPS
    """Steps of all drones together."""


def judge(predict: swap.Predict, flights: int, seed: int) -> Verdict:
    """Fly episodes of each number of drones; the verdict is that of `swap.DRONES` drones."""
    flown = {drones: swap.fly(predict, flights, seed, drones) for drones in swap.JUDGED}
    figures = {f"success_of_{drones}": float(swaps.success.mean()) for drones, swaps in flown.items()}
    own = flown[swap.DRONES]
    seconds = own.seconds[own.success]
    figures["seconds"] = float(seconds.mean()) if len(seconds) else float("nan")
    return Verdict(float(own.success.mean()), float(own.touched.mean()), figures)


def recipe_of(args: Args) -> Recipe:
    """Return the recipe of the training."""
    return Recipe(
        steps=args.steps,
        num_envs=sum(swap.TRAINING_DRONES.values()),
        settings=swap.SETTINGS,
        make=swap.make,
        judge=judge,
        baseline=lambda: judge(swap.straight, args.flights, UNSEEN_SEEDS.start),
        film={"env": "flockstep/Swap-v0", "steps": swap.MOST_STEPS},
    )


def main(args: Args) -> None:
    """Train, save, judge and print."""
    train_recipe.run(recipe_of(args), args, f"swaps of {swap.DRONES} drones")


if __name__ == "__main__":
    main(tyro.cli(Args))
