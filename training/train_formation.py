"""Train drones to fly in formation with flockstep.PPO, and judge the last policy.

.venv/bin/python -m training.train_formation             # out/train/formation.zip, takes a few minutes
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import tyro

import flockstep
from training import formation
from training.recipes import Recipe, Verdict, predict_of, train
from training.tasks import UNSEEN_SEEDS


@dataclass
class Args:
    """Options."""

    out: Path = Path("out/train/formation.zip")
    """File of the policy."""
    seed: int = 0
    """Seed of the training."""
    steps: int = formation.STEPS
    """Steps of all drones together."""
    threads: int = 2
    """Threads of the simulator and the learner; the results have the same bits for any number."""
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
    recipe = recipe_of(args)
    begun = time.perf_counter()
    model = train(recipe, "flockstep", args.seed, args.threads)
    seconds = time.perf_counter() - begun
    args.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(args.out)
    verdict = recipe.judge(predict_of(flockstep.PPO.load(args.out)), args.flights, UNSEEN_SEEDS.start)
    figures = ", ".join(f"{name} {value:.3f}" for name, value in verdict.more.items())
    print(
        f"{model.num_timesteps:,} steps in {seconds:.1f} s; {verdict.success:.1%} of the flights succeed, "
        f"{verdict.crashed:.1%} end in a contact, {figures}; {args.out}"
    )


if __name__ == "__main__":
    main(tyro.cli(Args))
