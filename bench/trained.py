"""Trainings by `training/train_ppo.py`: the pixel task, and a policy that is flown by rotors, too.

Each seed is trained from scratch. Generated playgrounds choose the model and stop the training. The chosen model then
flies once for the report: the bundled playgrounds, and 100 generated ones that are used for nothing else.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import flockstep
from flockstep.trainings import UNSEEN_SEEDS
from timing import Figure, Measured, Median, figure

sys.path.append(str(Path(__file__).resolve().parent.parent))
from training.evaluate import MAX_STEPS, baselines, fly, greedy, summary
from training.tasks import Setup
from training.train_ppo import DEFAULTS, Args, train

OUT = Path(__file__).resolve().parent.parent / "out" / "bench" / "train"
SEEDS = (0, 1, 2, 3, 4)
UNSEEN_WORLDS = 100
START_FLIGHTS = 50  # random starts in each spawn box


class Group(NamedTuple):
    """Worlds whose success rate is one figure."""

    name: str
    worlds: list[flockstep.World]
    random_start: bool = False

    def figure(self, who: str, rate: float, note: str) -> Figure:
        """Return the figure of a policy; a note says what generated worlds are like."""
        more = {"note": note} if note and self.name == "unseen_success_rate" else {}
        return figure(f"train/{who}/{self.name}", rate, "1", len(self.worlds), **more)


def groups(setup: Setup) -> Iterator[Group]:
    """Return all groups of worlds in the report of a task."""
    yield Group("unseen_success_rate", setup.generated(UNSEEN_SEEDS, UNSEEN_WORLDS))
    for name in setup.playgrounds:
        worlds, subject = flockstep.scenes.load(name), name.replace("-", "_")
        yield Group(f"{subject}/success_rate", worlds)
        yield Group(f"{subject}/random_start_success_rate", worlds * START_FLIGHTS, random_start=True)


def task_figures(args: Args, seeds: Sequence[int] = SEEDS, out: Path = OUT) -> Iterator[Figure]:
    """Return the figures of all seeds of a task, of flyers without training, and of the time spent in each part."""
    flown, outcomes, note = list(groups(args.setup)), [], args.setup.generated_note
    for seed in seeds:
        name = f"{args.task}/seed{seed}"
        model, outcome = train(dataclasses.replace(args, seed=seed, out=out / f"{args.task}-{seed}", progress=False))
        outcomes.append(outcome)
        for worlds in flown:
            flights = fly(greedy(model), worlds.worlds, MAX_STEPS, setup=args.setup, random_start=worlds.random_start)
            yield worlds.figure(name, summary(flights)["success_rate"], note)
        yield figure(f"train/{name}/seconds", outcome.seconds, "s", 1)
        yield figure(f"train/{name}/evaluation_seconds", outcome.evaluation_seconds, "s", 1)
        yield figure(f"train/{name}/steps", outcome.steps, "1", 1)
        yield figure(f"train/{name}/steps_per_second", outcome.steps_per_second, "1/s", 1)
    for worlds in flown:
        for flyer, rate in baselines(worlds.worlds, args.setup, worlds.random_start).items():
            if flyer == "random_policy" or not worlds.random_start:  # the others do not support spawn boxes
                yield worlds.figure(f"{args.task}/{flyer}", rate, note)
    for part in outcomes[0].seconds_by_part:
        us = Median(1e6 * outcome.seconds_by_part[part] / outcome.steps for outcome in outcomes)
        name = f"train/{args.task}/microseconds_per_step/{part.replace(', ', '_').replace(' ', '_')}"
        yield figure(name, us, "us", len(outcomes))


def pixels() -> Iterator[Figure]:
    return task_figures(DEFAULTS["pixels"])


def by_rotors() -> Iterator[Measured]:
    """Train the LiDAR task with kinematic motion; fly it with that and with rotors, its steps as velocities."""
    policy = greedy(train(dataclasses.replace(DEFAULTS["lidar"], out=OUT / "lidar-0", progress=False))[0])
    bundled = flockstep.scenes.load("train") + flockstep.scenes.load("validation")
    unseen = Setup().generated(UNSEEN_SEEDS, UNSEEN_WORLDS)
    for name, worlds in (("playgrounds", bundled), ("unseen", unseen)):
        for motion in ("kinematic", "rotors"):
            rate = float(summary(fly(policy, worlds, MAX_STEPS, motion=motion))["success_rate"])
            yield f"train/lidar_by_{motion}/seed0/{name}_success_rate", rate, "1", len(worlds)
