"""Train a recipe with flockstep.PPO, and judge the last policy: the common part of the commands of single tasks."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import flockstep
from training.recipes import Recipe, predict_of, train
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args:
    """Options."""

    out: Path
    """File of the policy."""
    seed: int = 0
    """Seed of the training."""
    threads: int = 2
    """Threads of the simulator and the learner; the results have the same bits for any number."""
    flights: int = 1000
    """Episodes that judge the policy, of each kind; nothing else uses their seeds."""


def run(recipe: Recipe, args: Args, flights: str) -> None:
    """Train, save, judge and print; ``flights`` names the episodes that judge."""
    begun = time.perf_counter()
    model = train(recipe, "flockstep", args.seed, args.threads)
    seconds = time.perf_counter() - begun
    args.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(args.out)
    verdict = recipe.judge(predict_of(flockstep.PPO.load(args.out)), args.flights, UNSEEN_SEEDS.start)
    figures = "".join(f", {name} {value:.3f}" for name, value in verdict.more.items())
    print(
        f"{model.num_timesteps:,} steps in {seconds:.1f} s; {verdict.success:.1%} of {args.flights:,} {flights} "
        f"succeed, {verdict.crashed:.1%} end in a contact{figures}; {args.out}"
    )
