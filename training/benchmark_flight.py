"""Training figures for `./dev bench flight_train`: Hover, Track, and the LiDAR task with simulated rotors.

.venv/bin/python -m training.benchmark_flight --figures out/bench/train/flight_train.figures

Each seed is trained from scratch. Its model is chosen by separate flights; the reported flights are flown once with the
chosen model. The LiDAR task is trained with kinematic motion, then flown with kinematic motion and with simulated
rotors.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import tyro

import flockstep
from training import train_flight
from training.benchmark import SEEDS, UNSEEN_WORLDS, Figure, figure
from training.evaluate import MAX_STEPS, fly, greedy, summary
from training.flight import Flights, Name
from training.flight import fly as fly_task
from training.flight import greedy as greedy_pilot
from training.tasks import UNSEEN_SEEDS, Setup
from training.train_ppo import DEFAULTS, train


def flight_figures(name: str, flown: Flights) -> list[Figure]:
    """Return the reported figures of some flights."""
    count = len(flown.crashed)
    return [
        figure(f"{name}/close_rate", flown.close_rate, "1", count),
        figure(f"{name}/crash_rate", float(flown.crashed.mean()), "1", count),
        figure(f"{name}/median_error_cm", 100 * flown.median_error_m, "cm", count),
    ]


def trained(task: Name, seeds: tuple[int, ...], out: Path) -> list[Figure]:
    """Train a task with each seed; return its figures, and those of only the controller cascade."""
    figures: list[Figure] = []
    for seed in seeds:
        args = train_flight.Args(task=task, seed=seed, progress=False)
        print("hyperparameters:", args)
        model, outcome = train_flight.train(args)
        folder = out / f"{task}-seed{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "policy.zip")
        flown = fly_task(
            task, greedy_pilot(model), train_flight.REPORTED_FLIGHTS, UNSEEN_SEEDS.start, **train_flight.keywords(args)
        )
        name = f"train/{task}/seed{seed}"
        made = [
            *flight_figures(name, flown),
            figure(f"{name}/seconds", outcome.seconds, "s", 1),
            figure(f"{name}/evaluation_seconds", outcome.evaluation_seconds, "s", 1),
            figure(f"{name}/steps", outcome.steps, "1", 1),
        ]
        for each in made:
            print(f"  {each['name']}: {each['value']:,.6g} {each['unit']}", flush=True)
        figures += made
    return figures + flight_figures(f"train/{task}/controller", train_flight.baseline(train_flight.Args(task=task)))


def by_rotors(seed: int, out: Path) -> list[Figure]:
    """Train the LiDAR task with kinematic motion; fly it with that and with rotors, its steps as velocities."""
    model, _ = train(dataclasses.replace(DEFAULTS["lidar"], seed=seed, out=out / f"lidar-seed{seed}", progress=False))
    policy = greedy(model)
    playgrounds = flockstep.scenes.load("train") + flockstep.scenes.load("validation")
    figures = []
    for group, worlds in (
        ("playgrounds", playgrounds),
        ("unseen", Setup().generated(UNSEEN_SEEDS, UNSEEN_WORLDS)),
    ):
        for motion in ("kinematic", "rotors"):
            flights = fly(policy, worlds, MAX_STEPS, motion=motion)
            rate = float(summary(flights)["success_rate"])
            figures.append(figure(f"train/lidar_by_{motion}/seed{seed}/{group}_success_rate", rate, "1", len(worlds)))
    return figures


@dataclass
class Options:
    """Options for measuring training."""

    seeds: tuple[int, ...] = SEEDS
    """Seeds, each trained from scratch; the LiDAR task uses only the first."""
    out: Path = Path("out/bench/train")
    """Folder for models and logs, with a subfolder for each training."""
    figures: Path = Path("out/bench/train/flight_train.figures")
    """File for the figures."""


def main(options: Options) -> None:
    """Train, fly, and write the figures."""
    figures = trained("hover", options.seeds, options.out) + trained("track", options.seeds, options.out)
    figures += by_rotors(options.seeds[0], options.out)
    options.figures.parent.mkdir(parents=True, exist_ok=True)
    options.figures.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Options))
