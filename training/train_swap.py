"""Train drones to exchange places with flockstep.PPO, and judge the last policy.

.venv/bin/python -m training.train_swap             # out/train/swap.zip, takes a few minutes
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import tyro

import flockstep
from training import swap
from training.recipes import Recipe, Verdict, predict_of, train
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args:
    """Options."""

    out: Path = Path("out/train/swap.zip")
    """File of the policy."""
    seed: int = 0
    """Seed of the training."""
    steps: int = swap.STEPS
    """Steps of all drones together."""
    threads: int = 2
    """Threads of the simulator and the learner; the results have the same bits for any number."""
    flights: int = 1000
    """Episodes that judge the policy, for each number of drones; nothing else uses their seeds."""


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
        num_envs=swap.NUM_ENVS,
        settings=swap.SETTINGS,
        make=swap.make,
        judge=judge,
        baseline=lambda: judge(swap.straight, args.flights, UNSEEN_SEEDS.start),
        film={"env": "flockstep/Swap-v0", "steps": swap.MOST_STEPS},
    )


def main(args: Args) -> None:
    """Train, save, judge and print."""
    recipe = recipe_of(args)
    begun = time.perf_counter()
    model = train(recipe, "flockstep", args.seed, args.threads)
    seconds = time.perf_counter() - begun
    args.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(args.out)
    verdict = recipe.judge(predict_of(flockstep.PPO.load(args.out)), args.flights, UNSEEN_SEEDS.start)
    figures = ", ".join(f"{name} {value:.3f}" for name, value in verdict.more.items())
    print(
        f"{model.num_timesteps:,} steps in {seconds:.1f} s; {verdict.success:.1%} of {args.flights:,} swaps of "
        f"{swap.DRONES} drones succeed, {verdict.crashed:.1%} end in a contact, {figures}; {args.out}"
    )


if __name__ == "__main__":
    main(tyro.cli(Args))
