"""Keep a policy for `flockstep.policies`: `.venv/bin/python -m tools.keep_policy out/board/race-seed0.zip race`.

The policy is written to policies/NAME.zip, without the moments of Adam: they are two thirds of a model, and only a
training that goes on needs them. It may be a model of Stable-Baselines3. Loading one runs code from its file: keep only
policies you trust.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

import flockstep
from training.tasks import load_policy


@dataclass
class Args:
    """Options of keeping a policy."""

    model: tyro.conf.Positional[Path]
    """A saved model."""
    name: tyro.conf.Positional[str]
    """Its name: that of a row of flockstep.trainings.TRAININGS, if it flies like one."""
    out: Path = Path("policies")
    """Folder to write to."""


def main(args: Args) -> None:
    """Read, shorten and write the model."""
    model: Any = load_policy(args.model)
    if not isinstance(model, flockstep.PPO):
        model = flockstep.PPO.from_sb3(model)
    nothing = np.zeros_like(model.learner.parameters)
    model.learner.set_adam(nothing, nothing, 0)
    model.save(args.out / args.name)


if __name__ == "__main__":
    main(tyro.cli(Args))
