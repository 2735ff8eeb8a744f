"""Train a quadrotor to catch itself, then a policy to fly by LiDAR, and draw their flights: `./dev demo`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import imageio.v3 as imageio
import matplotlib.pyplot as plt
import numpy as np
import tyro

import flockstep
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.trail import Trail
from tools import catch_film
from tools.camera_pictures import draw_sheet
from training.evaluate import MAX_STEPS, Flight, baselines, fly, greedy, summary
from training.plot_paths import picture_name, plot_flight, plot_overview
from training.tasks import UNSEEN_SEEDS, Setup
from training.train_ppo import Args as TrainingArgs
from training.train_ppo import Outcome, train

SHOWN = "playground/train-2"  # in flight.mp4 and flight.png
FILM_PX, FILM_FPS, PICTURE_PX = (1280, 720), 25, (1920, 1080)
APART_M = 1.2  # distance between the drones in the picture
UNSEEN_WORLDS = 100


@dataclass
class Args:
    """Options for training, flying and drawing."""

    out: Path = Path("out/demo")
    """Folder for the pictures and the policy."""
    seed: int = 0
    """Seed of the trainings."""
    catch_max_minutes: float = catch_film.Args.max_minutes
    """Time budget of the training to catch itself; the results up to then are shown."""
    total_steps: int = TrainingArgs.total_steps
    """Step budget of the LiDAR training, which stops earlier if the policy flies almost all evaluation worlds."""
    max_minutes: float = 2.0
    """Time budget of the LiDAR training; the results up to then are shown."""


def plot_reward(progress: Path, path: Path) -> None:
    """Write the reward curve of a training's progress.csv."""
    with progress.open() as file:
        rows = [row for row in csv.DictReader(file) if row.get("rollout/ep_rew_mean")]
    steps = [float(row["time/total_timesteps"]) / 1e6 for row in rows]
    figure, reward = plt.subplots(figsize=(8, 4.5), layout="constrained")
    reward.plot(steps, [float(row["rollout/ep_rew_mean"]) for row in rows], color="tab:blue")
    reward.set_xlabel("million steps")
    reward.set_ylabel("mean episode reward", color="tab:blue")
    success = reward.twinx()
    success.plot(steps, [100 * float(row["rollout/success_rate"] or 0) for row in rows], color="tab:green")
    success.set_ylabel("episodes that reach the goal / %", color="tab:green")
    success.set_ylim(0, 100)
    reward.set_title("Training: exploring policy, random playgrounds")
    reward.grid(alpha=0.3)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def plot_exposures(world: flockstep.World, flight: Flight, path: Path) -> None:
    """Write a multiple-exposure picture of one flight: drone positions, the path, and one set of LiDAR beams.

    The viewer is above the middle of the room's wall with the smallest y.
    """
    flown = np.insert(np.cumsum(np.linalg.norm(np.diff(flight.trail, axis=0), axis=1)), 0, 0)
    exposed = flight.trail[np.searchsorted(flown, np.arange(0, flown[-1], APART_M))]
    batch = flockstep.Batch([world], len(exposed), lidar=flockstep.LidarConfig())
    trail = Trail(batch)
    for position in flight.trail:
        batch.set_pose(np.tile(position, (len(exposed), 1)))
        trail.record()
    batch.set_pose(exposed)
    batch.sense()
    low, high = np.asarray(world.bounds, float)
    middle, size = (low + high) / 2, high - low
    place = np.array([middle[0], low[1] + 0.02 * size[1], high[2] - 0.05 * size[2]])
    target = np.array([middle[0], middle[1], low[2] + 0.2 * size[2]])
    view = ThirdPersonView(batch, trail=trail, others=True, place=(place, target), size_px=PICTURE_PX)
    imageio.imwrite(path, view.frame(len(exposed) // 2), optimize=True)


def tell(
    args: Args, outcome: Outcome, flown: int, playgrounds: int, generated: float, untrained: dict[str, float]
) -> None:
    """Print a summary of the results and the locations of the files."""
    time = f"{outcome.seconds / 60:.1f} minutes" if outcome.seconds >= 90 else f"{outcome.seconds:.0f} seconds"
    print(f"""
A policy learned to fly by LiDAR from scratch: {outcome.steps:,} steps in {time}
({outcome.steps_per_second:,.0f} steps/s). It was chosen by evaluations in generated playgrounds, which took another
{outcome.evaluation_seconds:.0f} seconds. On its own, without exploring, it flies from the start to the goal of
{flown} of the {playgrounds} playgrounds that ship without a crash, and of {generated:.0%} of {UNSEEN_WORLDS} generated
ones that it has never seen, where flying straight from marker to marker succeeds in
{untrained["straight_flight"]:.0%}, and random actions in {untrained["random_policy"]:.0%}.

In {args.out}/
  paths.png            its paths through all playgrounds, from above
  path-*.png           each path, from above and from the side
  flight.mp4           a film of one flight from behind the drone, with the LiDAR's beams and the trail
  flight.png           the same flight at a glance: the drone at every {APART_M:g} m
  reward.png           how the reward grew
  camera-sheet.png     what cameras see: every output, at three places of a camera playground
  policy.zip           the policy, for training/evaluate.py and training/plot_paths.py

Next: .venv/bin/python -m training.train_ppo --help""")


def main(args: Args) -> None:
    """Train, fly, draw and print the results."""
    catch_film.main(catch_film.Args(out=args.out, seed=args.seed, max_minutes=args.catch_max_minutes))
    print("\nTraining a policy that flies by LiDAR through playgrounds full of pillars ...")
    model, outcome = train(
        TrainingArgs(
            out=args.out,
            seed=args.seed,
            total_steps=args.total_steps,
            max_minutes=args.max_minutes,
            evaluate_every=100_000,
            evaluation_flights=200,
            generated=400,
        )
    )
    policy = greedy(model)
    worlds = flockstep.scenes.load("train") + flockstep.scenes.load("validation")
    flights = fly(policy, worlds, MAX_STEPS)
    print("Drawing ...")
    for world, flight in zip(worlds, flights, strict=True):
        plot_flight(world, flight, args.out / picture_name(world))
    plot_overview(worlds, flights, args.out / "paths.png")
    shown = next(index for index, world in enumerate(worlds) if world.name == SHOWN)
    plot_exposures(worlds[shown], flights[shown], args.out / "flight.png")
    film = args.out / "flight.mp4"
    flockstep.record(film, policy, worlds=worlds[shown], steps=MAX_STEPS, fps=FILM_FPS, render_size=FILM_PX)
    plot_reward(args.out / "progress.csv", args.out / "reward.png")
    draw_sheet(args.out / "camera-sheet.png", ("raycast",))
    unseen = Setup().generated(UNSEEN_SEEDS, UNSEEN_WORLDS)
    rate, untrained = summary(fly(policy, unseen, MAX_STEPS))["success_rate"], baselines(unseen, Setup())
    tell(args, outcome, sum(flight.outcome == "success" for flight in flights), len(worlds), rate, untrained)


if __name__ == "__main__":
    main(tyro.cli(Args))
