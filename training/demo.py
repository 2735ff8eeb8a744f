"""Train a quadrotor to catch itself, then a policy to fly by LiDAR, and draw their flights: `./dev demo`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import imageio.v3 as imageio
import matplotlib.pyplot as plt
import numpy as np
import tyro

import flockstep
from flockstep.pictures.lines import Trail
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.sb3 import Progress
from flockstep.trainings import UNSEEN_SEEDS, train
from flockstep.viewer import page
from tools import catch_film
from tools.stills import draw_sheet
from training.board import CURVE_FLIGHTS, LEARNED, TRAININGS, Clock, TimeLimit, verdict_on
from training.evaluate import MAX_STEPS, Flight, baselines, fly, greedy, summary
from training.plot_paths import picture_name, plot_flight, plot_overview
from training.tasks import Setup

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
    total_steps: int = TRAININGS["lidar"].steps
    """Steps of the LiDAR training."""
    max_minutes: float | None = None
    """Time limit of each of the two trainings. Default: none; they end after their steps."""


def plot_curve(clock: Clock, path: Path) -> None:
    """Draw the reward and the success during training, over steps and seconds."""
    steps, seconds, reward = np.array(clock.rewards).T
    evaluated, _, success = np.array([(0, 0.0, 0.0), *clock.curve]).T
    figure, (above, below) = plt.subplots(2, figsize=(8, 6.5), sharex=True, layout="constrained")
    above.plot(steps / 1e3, reward, color="tab:blue")
    above.axhline(0, color="0.6", linewidth=1)
    above.set(ylabel="reward of an episode")
    above.annotate("mean of 100 episodes, with exploration", (0.98, 0.15), xycoords="axes fraction", ha="right")
    below.plot(evaluated / 1e3, 100 * success, color="tab:green", marker="o", markersize=4, clip_on=False)
    below.set(
        xlabel="thousand steps", ylabel="flights that reach the goal / %", xlim=(0, steps[-1] / 1e3), ylim=(0, 101)
    )
    label = f"{CURVE_FLIGHTS} playgrounds that it does not train in, without exploration"
    below.annotate(label, (0.98, 0.15), xycoords="axes fraction", ha="right")
    pace = seconds[-1] / steps[-1] * 1e3
    above.secondary_xaxis("top", functions=(lambda k: k * pace, lambda s: s / pace)).set_xlabel("seconds of training")
    figure.suptitle("flockstep.PPO learns to fly by LiDAR")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
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


def print_summary(
    args: Args, clock: Clock, flights: Sequence[Flight], generated: float, untrained: dict[str, float]
) -> None:
    """Print a summary of the results and the locations of the files."""
    arrived = sum(flight.outcome == "success" for flight in flights)
    shown = next(flight for flight in flights if flight.world == SHOWN)
    print(f"""
{verdict_on("fly by LiDAR", generated, clock.num_timesteps, args.total_steps)}:
{clock.num_timesteps:,} steps in {clock.training_s:.0f} seconds, without the flights for the curve. Without exploring,
it reaches the goal of {arrived} of the {len(flights)} bundled playgrounds without a crash, and of {generated:.0%} of
{UNSEEN_WORLDS} generated ones that it has never seen. There, flying straight from marker to marker succeeds in
{untrained["straight_flight"]:.0%}, and random actions in {untrained["random_policy"]:.0%}.

In {args.out}/
  paths.png            its paths through all playgrounds, from above
  path-*.png           each path, from above and from the side
  flight.mp4           a film of one flight ({shown.outcome}) from behind the drone, with the LiDAR's beams
  flight.html          the same flight in a browser, from any side; only if ./dev had Node.js to build this page
  flight.png           the same flight at a glance: the drone at every {APART_M:g} m
  curve.png            how reward and success grew, over steps and seconds
  camera-sheet.png     what cameras see: every output, at three places of a camera playground
  policy.zip           the policy, for training/evaluate.py and training/plot_paths.py

Next: ./dev board hover, or .venv/bin/python -m training.train_ppo --help for Stable-Baselines3""")


def main(args: Args) -> None:
    """Train, fly, draw and print the results."""
    caught = catch_film.main(catch_film.Args(out=args.out, seed=args.seed, max_minutes=args.max_minutes))
    print("\nTraining a policy that flies by LiDAR through playgrounds full of pillars ...")
    recipe = replace(TRAININGS["lidar"], steps=args.total_steps)
    clock = Clock(recipe, judges=True)
    model = train(recipe, "flockstep", args.seed, 0, [clock, TimeLimit(args.max_minutes), Progress()])
    model.save(args.out / "policy.zip")
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
    if page.is_built():
        flockstep.record(args.out / "flight.html", policy, worlds=worlds[shown], steps=MAX_STEPS)
    plot_curve(clock, args.out / "curve.png")
    draw_sheet(args.out / "camera-sheet.png")
    unseen = Setup().generated(UNSEEN_SEEDS, UNSEEN_WORLDS)
    rate, untrained = summary(fly(policy, unseen, MAX_STEPS))["success_rate"], baselines(unseen, Setup())
    print_summary(args, clock, flights, rate, untrained)
    if not (caught and rate >= LEARNED):
        sys.exit("\nNot everything was learned: see FAILED above.")


if __name__ == "__main__":
    main(tyro.cli(Args))
