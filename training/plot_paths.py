"""Pictures of flights: every playground from above and from the side, and an animation with the LiDAR's beams.

.venv/bin/python training/plot_paths.py out/demo/policy.zip --out out/paths
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import matplotlib.pyplot as plt
import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle
from stable_baselines3 import PPO

import flockstep
from evaluate import Flight, Policy, fly, greedy
from tasks import Setup, setup_of

OUTCOME_COLOR = {"success": "tab:green", "crash": "tab:red", "overshoot": "tab:purple", "time-out": "tab:orange"}
MARKER_COLOR = {"start": "tab:red", "waypoint": "gold", "goal": "limegreen"}
TOP, SIDE = (0, 1), (0, 2)  # the axes of a view: x and y, x and z


def draw_world(axes: Axes, world: flockstep.World, view: tuple[int, int]) -> None:
    """Draw room, obstacles and markers as seen along the axis that is not in the view."""
    across, up = view
    for primitive in world.primitives:
        center, half = primitive["center"], primitive["half_extents"]
        if primitive["kind"] in ("cylinder", "sphere") and (view == TOP or primitive["kind"] == "sphere"):
            axes.add_patch(Circle((center[across], center[up]), half[0], color="0.45"))
            continue
        corner = (center[across] - half[across], center[up] - half[up])
        style: dict[str, Any] = {"facecolor": "0.75", "edgecolor": "0.6", "alpha": 0.6}
        if primitive["kind"] == "room":
            style = {"fill": False, "edgecolor": "black", "linewidth": 1.5}
        axes.add_patch(Rectangle(corner, 2 * half[across], 2 * half[up], **style))
    places = [("start", world.start), *(("waypoint", w) for w in world.waypoints), ("goal", world.goal)]
    for kind, place in places:
        axes.add_patch(Circle((place[across], place[up]), world.marker_radius_m, color=MARKER_COLOR[kind], zorder=3))
    low, high = world.bounds
    axes.set_xlim(low[across] - 0.2, high[across] + 0.2)
    axes.set_ylim(low[up] - 0.2, high[up] + 0.2)
    axes.set_aspect("equal")
    axes.set_xlabel("xyz"[across] + " / m")
    axes.set_ylabel("xyz"[up] + " / m")


def plot_flight(world: flockstep.World, flight: Flight, path: Path) -> None:
    """Write a picture of one flight: from above, and from the side."""
    low, high = world.bounds
    size = high - low
    figure, (top, side) = plt.subplots(
        2, 1, figsize=(7, 10), height_ratios=[float(size[1]), float(size[2])], layout="constrained"
    )
    for axes, view in ((top, TOP), (side, SIDE)):
        draw_world(axes, world, view)
        color = OUTCOME_COLOR[flight.outcome]
        axes.plot(flight.trail[:, view[0]], flight.trail[:, view[1]], color=color, linewidth=2, zorder=4)
        axes.plot(*flight.trail[-1, list(view)], "x", color=color, zorder=5)
    figure.suptitle(f"{world.name}: {flight.outcome} after {flight.steps} steps, reward {flight.reward:,.1f}")
    figure.savefig(path, dpi=90)
    plt.close(figure)


def plot_overview(worlds: Sequence[flockstep.World], flights: Sequence[Flight], path: Path) -> None:
    """Write one picture of all flights from above."""
    columns = 4
    rows = -(-len(worlds) // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(4 * columns, 4 * rows), layout="constrained", squeeze=False)
    for axes in grid.flat[len(worlds) :]:
        axes.axis("off")
    for axes, world, flight in zip(grid.flat, worlds, flights, strict=False):
        draw_world(axes, world, TOP)
        axes.plot(flight.trail[:, 0], flight.trail[:, 1], color=OUTCOME_COLOR[flight.outcome], linewidth=2, zorder=4)
        axes.set_title(f"{world.name}: {flight.outcome}")
    figure.savefig(path, dpi=70)
    plt.close(figure)


def animate(
    policy: Policy,
    world: flockstep.World,
    path: Path,
    max_steps: int = 400,
    frames_per_second: int = 30,
    setup: Setup | None = None,
) -> None:
    """Write an animation of one flight from above, with the LiDAR's beams."""
    envs = (setup or Setup()).make(1, worlds=[world], render_mode="rgb_array", autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    frames = [envs.render()]
    for _ in range(max_steps):
        observation, _, terminated, truncated, _ = envs.step(policy(observation))
        frames.append(envs.render())
        if terminated[0] or truncated[0]:
            break
    envs.close()
    pictures = [frame[0] for frame in frames if frame is not None]
    pictures += [pictures[-1]] * frames_per_second  # a second's rest before it starts again
    imageio.imwrite(path, np.stack(pictures), duration=1000 / frames_per_second, loop=0)


def picture_name(world: flockstep.World) -> str:
    """Return the file name of a world's picture."""
    return f"path-{world.name.replace('/', '-')}.png"


@dataclass
class Args:
    """Draw the flights of a trained policy."""

    policy: tyro.conf.Positional[Path]
    """A model saved by training/train_ppo.py (.zip)."""
    worlds: tuple[str, ...] = ()
    """Sets of scenes, scene names or paths. Default: the task's own, for training and validation."""
    out: Path = Path("out/paths")
    """Folder for the pictures."""


def main(args: Args) -> None:
    """Fly, draw, and say where the pictures are."""
    args.out.mkdir(parents=True, exist_ok=True)
    model = PPO.load(args.policy, device="cpu")
    policy, setup = greedy(model), setup_of(model)
    worlds = [world for name in args.worlds or setup.playgrounds for world in flockstep.scenes.load(name)]
    flights = fly(policy, worlds, setup=setup)
    for world, flight in zip(worlds, flights, strict=True):
        plot_flight(world, flight, args.out / picture_name(world))
    plot_overview(worlds, flights, args.out / "paths.png")
    animate(policy, worlds[0], args.out / "flight.gif", setup=setup)
    print(f"{len(worlds)} pictures, paths.png and flight.gif are in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
