"""Train a quadrotor to race with flockstep.PPO, and judge the last policy: the recipe of the board.

.venv/bin/python -m training.train_race                    # out/train/race.zip, takes less than a minute
.venv/bin/python -m training.train_race --unseen           # on generated tracks, and judged on others
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from training import train_recipe
from training.recipes import RECIPES


@dataclass
class Args(train_recipe.Args):
    """Options."""

    out: Path = Path("out/train/race.zip")
    """File of the policy."""
    unseen: bool = False
    """Train on generated tracks instead of the figure-8."""


def main(args: Args) -> None:
    """Train, save, judge and print."""
    recipe = RECIPES["race_unseen" if args.unseen else "race"]
    train_recipe.run(recipe, args, "flights of three laps")


if __name__ == "__main__":
    main(tyro.cli(Args))
