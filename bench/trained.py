"""Trainings by Stable-Baselines3: the LiDAR, camera and pixel tasks, by `training/train_ppo.py`.

Each seed is trained from scratch. Generated playgrounds choose the model and stop the training. The chosen model then
flies once for the report: the bundled playgrounds, and 100 generated ones that are used for nothing else.
"""

from __future__ import annotations

import dataclasses
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep.trainings import UNSEEN_SEEDS

sys.path.append(str(Path(__file__).resolve().parent.parent))
from training.evaluate import MAX_STEPS, Policy, baselines, fly, fly_routes, greedy, random_policy, summary
from training.tasks import Setup
from training.train_ppo import DEFAULTS, Args, Outcome, train

SEEDS = (0, 1, 2, 3, 4)
UNSEEN_WORLDS = 100
PLACE_STEPS = 1500  # limit for crossing an office or a forest: at least 55 m, 10 cm per step
START_FLIGHTS = 50  # random starts in each spawn box, for camera tasks

Figure = dict[str, Any]


@dataclass(frozen=True)
class Group:
    """Worlds whose success rate is one figure."""

    subject: str  # of the figure, after the training's name
    name: str
    worlds: list[flockstep.World]
    random_start: bool = False
    note: str = ""

    def success_rate(self, policy: Policy, setup: Setup) -> float:
        """Fly every world once."""
        flights = fly(policy, self.worlds, MAX_STEPS, setup=setup, random_start=self.random_start)
        return float(summary(flights)["success_rate"])

    def figure(self, name: str, rate: float) -> Figure:
        """Return the figure of a policy with this name."""
        made = figure(f"train/{name}{self.subject}/{self.name}", rate, "1", len(self.worlds))
        return {**made, "note": self.note} if self.note else made


def figure(name: str, value: float, unit: str, runs: int) -> Figure:
    """Return a figure in the format of bench/run.py."""
    return {"name": name, "value": float(f"{value:.4g}"), "unit": unit, "runs": runs}


def groups(setup: Setup) -> list[Group]:
    """Return all groups of worlds in the report of a task."""
    unseen = setup.generated(UNSEEN_SEEDS, UNSEEN_WORLDS)
    generated = Group("", "unseen_success_rate", unseen, note=setup.generated_note)
    sets = {name: flockstep.scenes.load(name) for name in setup.playgrounds}
    if setup.task == "lidar":
        return [
            Group("", "playgrounds_success_rate", [world for worlds in sets.values() for world in worlds]),
            generated,
        ]
    found = [generated]
    for name, worlds in sets.items():
        subject = f"/{name.replace('-', '_')}"
        found += [
            Group(subject, "success_rate", worlds),
            Group(subject, "random_start_success_rate", worlds * START_FLIGHTS, random_start=True),
        ]
    return found


def baseline_figures(task: str, setup: Setup, flown: Sequence[Group]) -> list[Figure]:
    """Return the figures of baselines without training, in the same worlds."""
    figures = []
    for group in flown:
        for name, rate in baselines(group.worlds, setup, group.random_start).items():
            if name == "random_policy" or not group.random_start:  # the others do not support spawn boxes
                figures.append(group.figure(f"{task}/{name}", rate))
    return figures


def trained(name: str, args: Args, out: Path, flown: Sequence[Group]) -> tuple[Outcome, list[Figure]]:
    """Train from scratch, then fly the reported worlds; return the outcome of the training and its figures."""
    args = dataclasses.replace(args, out=out / name.replace("/", "-"), progress=False)
    print("hyperparameters:", args)
    model, outcome = train(args)
    policy = greedy(model)
    figures = [group.figure(name, group.success_rate(policy, args.setup)) for group in flown]
    figures += [
        figure(f"train/{name}/seconds", outcome.seconds, "s", 1),
        figure(f"train/{name}/evaluation_seconds", outcome.evaluation_seconds, "s", 1),
        figure(f"train/{name}/steps", outcome.steps, "1", 1),
        figure(f"train/{name}/steps_per_second", outcome.steps_per_second, "1/s", 1),
    ]
    if args.frame_skip > 1:
        flown_per_second = args.frame_skip * outcome.steps_per_second
        figures.append(figure(f"train/{name}/flown_steps_per_second", flown_per_second, "1/s", 1))
    for made in figures:
        print(f"  {made['name']}: {made['value']:,.6g} {made['unit']}", flush=True)
    return outcome, figures


def task_figures(args: Args, seeds: Sequence[int], out: Path) -> list[Figure]:
    """Return the figures of all seeds of a task, of its baselines, and of the time spent in each part."""
    flown = groups(args.setup)
    figures: list[Figure] = []
    outcomes = []
    for seed in seeds:
        outcome, made = trained(f"{args.task}/seed{seed}", dataclasses.replace(args, seed=seed), out, flown)
        outcomes.append(outcome)
        figures += made
    figures += baseline_figures(args.task, args.setup, flown)
    for part in outcomes[0].seconds_by_part:
        shares = [1e6 * outcome.seconds_by_part[part] / outcome.steps for outcome in outcomes]
        name = f"train/{args.task}/microseconds_per_step/{part.replace(', ', '_').replace(' ', '_')}"
        figures.append(figure(name, statistics.median(shares), "us", len(shares)))
    return figures


#: Training settings for the LiDAR task in offices and forests. They were found in trainings with seed 0.
PLACES = {
    "office": dataclasses.replace(
        DEFAULTS["lidar"],
        worlds=("guided_office/seed-0..99",),
        evaluation_worlds=("guided_office/seed-900..999",),
        total_steps=3_000_000,
    ),
    "forest": dataclasses.replace(
        DEFAULTS["lidar"],
        worlds=("forest/seed-0..99",),
        evaluation_worlds=("forest/seed-900..999",),
        total_steps=5_000_000,
        lidar_channels=5,
        lidar_vfov_deg=60.0,
    ),
}
PLACES_SEED = 1
UNSEEN_PLACES = "seed-1000..1099"


def places_figures(out: Path) -> list[Figure]:
    """Return the figures of one training in each kind of place, flown in worlds that nothing else uses."""
    figures: list[Figure] = []
    for name, args in PLACES.items():
        args = dataclasses.replace(
            args,
            generated=0,
            evaluation_flights=100,
            evaluation_steps=PLACE_STEPS,
            max_episode_steps=MAX_STEPS,
            evaluate_every=500_000,
            seed=PLACES_SEED,
        )
        worlds = flockstep.scenes.load(f"{args.worlds[0].split('/')[0]}/{UNSEEN_PLACES}")
        model, outcome = train(dataclasses.replace(args, out=out / name, progress=False))
        flights = fly(greedy(model), worlds, PLACE_STEPS, setup=args.setup)
        random = fly(random_policy(args.setup), worlds, PLACE_STEPS, setup=args.setup)
        straight = [np.stack([world.start, world.goal]) for world in worlds]
        rates = {
            "unseen_success_rate": summary(flights)["success_rate"],
            "unseen_crash_rate": summary(flights)["contact_rate"],
            "random_policy": summary(random)["success_rate"],
            "straight_flight": float(np.mean(fly_routes(worlds, straight))),
        }
        figures += [figure(f"train/{name}/{what}", rate, "1", len(worlds)) for what, rate in rates.items()]
        figures += [
            figure(f"train/{name}/steps", outcome.steps, "1", 1),
            figure(f"train/{name}/seconds", outcome.seconds, "s", 1),
        ]
    return figures


def measure(name: str, out: Path, seeds: Sequence[int] = SEEDS) -> list[Figure]:
    """Return the figures of a benchmark.

    Parameters
    ----------
    name
        train: the LiDAR task; camera_train: the camera task; pixels_train: the task that observes pixels; camera_large:
        the camera task at 640 x 480; places_train: the LiDAR task in offices and forests.
    out
        Folder for models and logs, with a subfolder for each training.
    seeds
        Seeds; camera_large uses only the first, places_train its own.
    """
    task = {"train": "lidar", "camera_train": "camera", "pixels_train": "pixels"}.get(name)
    if name == "places_train":
        return places_figures(out)
    if task is not None:
        return task_figures(DEFAULTS[task], seeds, out)
    args = dataclasses.replace(DEFAULTS["camera"], width_px=640, evaluation_flights=20, seed=seeds[0])
    return trained("camera/640x480", args, out, groups(args.setup))[1]
