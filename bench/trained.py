"""Trainings by Stable-Baselines3 of the camera and pixel tasks, by `training/train_ppo.py`.

Each seed is trained from scratch. Generated playgrounds choose the model and stop the training. The chosen model then
flies once for the report: the bundled playgrounds, and 100 generated ones that are used for nothing else.
"""

from __future__ import annotations

import dataclasses
import statistics
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import flockstep
from flockstep.trainings import UNSEEN_SEEDS
from timing import Figure, figure

sys.path.append(str(Path(__file__).resolve().parent.parent))
from training.evaluate import MAX_STEPS, baselines, fly, greedy, summary
from training.tasks import Setup
from training.train_ppo import DEFAULTS, Args, Outcome, train

SEEDS = (0, 1, 2, 3, 4)
UNSEEN_WORLDS = 100
START_FLIGHTS = 50  # random starts in each spawn box


@dataclass(frozen=True)
class Group:
    """Worlds whose success rate is one figure."""

    name: str
    worlds: list[flockstep.World]
    random_start: bool = False
    note: str = ""

    def figure(self, who: str, rate: float) -> Figure:
        """Return the figure of a policy."""
        more = {"note": self.note} if self.note else {}
        return figure(f"train/{who}/{self.name}", rate, "1", len(self.worlds), **more)


def groups(setup: Setup) -> Iterator[Group]:
    """Return all groups of worlds in the report of a task."""
    unseen = setup.generated(UNSEEN_SEEDS, UNSEEN_WORLDS)
    yield Group("unseen_success_rate", unseen, note=setup.generated_note)
    for name in setup.playgrounds:
        worlds, subject = flockstep.scenes.load(name), name.replace("-", "_")
        yield Group(f"{subject}/success_rate", worlds)
        yield Group(f"{subject}/random_start_success_rate", worlds * START_FLIGHTS, random_start=True)


def trained(args: Args, out: Path, flown: Sequence[Group]) -> tuple[Outcome, list[Figure]]:
    """Train from scratch, then fly the reported worlds; return the outcome of the training and its figures."""
    name = f"{args.task}/seed{args.seed}"
    args = dataclasses.replace(args, out=out / name.replace("/", "-"), progress=False)
    print("hyperparameters:", args)
    model, outcome = train(args)
    figures = []
    for group in flown:
        flights = fly(greedy(model), group.worlds, MAX_STEPS, setup=args.setup, random_start=group.random_start)
        figures.append(group.figure(name, summary(flights)["success_rate"]))
    rate = outcome.steps_per_second
    figures += [
        figure(f"train/{name}/seconds", outcome.seconds, "s", 1),
        figure(f"train/{name}/evaluation_seconds", outcome.evaluation_seconds, "s", 1),
        figure(f"train/{name}/steps", outcome.steps, "1", 1),
        figure(f"train/{name}/steps_per_second", rate, "1/s", 1),
        figure(f"train/{name}/flown_steps_per_second", args.frame_skip * rate, "1/s", 1),
    ]
    for made in figures:
        print(f"  {made['name']}: {made['value']:,.6g} {made['unit']}", flush=True)
    return outcome, figures


def task_figures(args: Args, seeds: Sequence[int], out: Path) -> list[Figure]:
    """Return the figures of all seeds of a task, of flyers without training, and of the time spent in each part."""
    flown = list(groups(args.setup))
    runs = [trained(dataclasses.replace(args, seed=seed), out, flown) for seed in seeds]
    figures = [made for _, each in runs for made in each]
    for group in flown:
        for name, rate in baselines(group.worlds, args.setup, group.random_start).items():
            if name == "random_policy" or not group.random_start:  # the others do not support spawn boxes
                figures.append(group.figure(f"{args.task}/{name}", rate))
    for part in runs[0][0].seconds_by_part:
        shares = [1e6 * outcome.seconds_by_part[part] / outcome.steps for outcome, _ in runs]
        name = f"train/{args.task}/microseconds_per_step/{part.replace(', ', '_').replace(' ', '_')}"
        figures.append(figure(name, statistics.median(shares), "us", len(shares)))
    return figures


def measure(task: str, out: Path) -> list[Figure]:
    """Return the figures of the task "camera" or "pixels"; `out` gets a folder for each training."""
    return task_figures(DEFAULTS[task], SEEDS, out)
