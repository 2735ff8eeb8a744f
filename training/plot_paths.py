"""Pictures of flights: every playground from above and from the side, and an animation from behind the drone.

.venv/bin/python training/plot_paths.py out/demo/policy.zip --out out/paths
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import tyro
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from PIL import Image
from stable_baselines3 import PPO

import flockstep
from evaluate import Flight, Policy, fly, greedy
from flockstep.viewer.third_person_view import ThirdPersonView
from flockstep.viewer.trail import Trail
from tasks import Setup, setup_of

OUTCOME_COLOR = {"success": "tab:green", "crash": "tab:red", "overshoot": "tab:purple", "time-out": "tab:orange"}
PILLAR_COLOR = "0.45"
MARKER_COLOR = {"start": "tab:red", "waypoint": "gold", "goal": "limegreen"}
TOP, SIDE = (0, 1), (0, 2)  # the axes of a view: x and y, x and z

FRAME_MS, COMMON_COLORS = 35, 96  # of an animation: for a step of the policy; out of 256

Pixels = npt.NDArray[np.uint8]


def draw_world(axes: Axes, world: flockstep.World, view: tuple[int, int]) -> None:
    """Draw room, obstacles and markers as seen along the axis that is not in the view."""
    across, up = view
    for primitive in world.primitives:
        center, half = primitive["center"], primitive["half_extents"]
        if primitive["kind"] in ("cylinder", "sphere") and (view == TOP or primitive["kind"] == "sphere"):
            axes.add_patch(Circle((center[across], center[up]), half[0], color=PILLAR_COLOR))
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
    """Write one picture of all flights from above; where a place is left, it says what the colours mean."""
    columns = 4
    rows = -(-len(worlds) // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(4 * columns, 4 * rows), layout="constrained", squeeze=False)
    for axes, world, flight in zip(grid.flat, worlds, flights, strict=False):
        draw_world(axes, world, TOP)
        axes.plot(flight.trail[:, 0], flight.trail[:, 1], color=OUTCOME_COLOR[flight.outcome], linewidth=2, zorder=4)
        axes.set_title(f"{world.name}: {flight.outcome}")
        axes.label_outer()
    left = grid.flat[len(worlds) :]
    for axes in left:
        axes.axis("off")
    if len(left):
        dots = {**MARKER_COLOR, "pillar": PILLAR_COLOR}
        handles = [Line2D([], [], marker="o", linestyle="", markersize=12, color=c, label=k) for k, c in dots.items()]
        outcomes = [outcome for outcome in OUTCOME_COLOR if any(flight.outcome == outcome for flight in flights)]
        handles += [Line2D([], [], linewidth=2, color=OUTCOME_COLOR[o], label=f"flight: {o}") for o in outcomes]
        left[0].legend(handles=handles, loc="center", fontsize="x-large", frameon=False)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def animate(
    policy: Policy,
    world: flockstep.World,
    path: Path,
    max_steps: int = 400,
    setup: Setup | None = None,
    width_px: int = 640,
    steps_per_frame: int = 2,
) -> None:
    """Write an animation of one flight from behind the drone, with its LiDAR's beams, its cameras' views, its trail."""
    envs = (setup or Setup()).make(1, worlds=[world], autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    trail = Trail(envs.batch)
    cameras = [camera.name for camera in envs.cameras]
    view = ThirdPersonView(envs.batch, cameras, trail, width_px=width_px, height_px=width_px * 3 // 4)
    frames = []
    for step in range(max_steps):
        trail.record()
        if step % steps_per_frame == 0:
            frames.append(view.frame(0))
        observation, _, terminated, truncated, _ = envs.step(policy(observation))
        if terminated[0] or truncated[0]:
            break
    trail.record()
    frames.append(view.frame(0))
    envs.close()
    write_gif(path, frames, FRAME_MS * steps_per_frame)


def write_gif(path: Path, frames: Sequence[Pixels], frame_ms: int) -> None:
    """Write an animation that rests a second at its end; one palette serves all frames, so that what stays is small."""
    palette = palette_of(np.stack(frames[:: max(len(frames) // 8, 1)]))
    first, *rest = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [frame_ms] * (len(frames) - 1) + [1000]
    first.save(path, save_all=True, append_images=rest, duration=durations, loop=0, optimize=True)


def palette_of(pixels: Pixels) -> Image.Image:
    """Return an image with 256 colours: the commonest, and some of all others, so that what is small keeps its own."""
    colors, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    common = colors[np.argsort(-counts)[:COMMON_COLORS]]
    others = Image.fromarray(colors[None]).quantize(256 - COMMON_COLORS, method=Image.Quantize.MEDIANCUT).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*common.ravel().tolist(), *(others or [])])
    return palette


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
    animated: str | None = None
    """A scene name or path, to be animated. Default: the first of the worlds."""
    width_px: int = 640
    """Of the animation."""
    steps_per_frame: int = 2
    """Of the animation."""


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
    shown = flockstep.scenes.load(args.animated)[0] if args.animated else worlds[0]
    animate(policy, shown, args.out / "flight.gif", 400, setup, args.width_px, args.steps_per_frame)
    print(f"{len(worlds)} pictures, paths.png and flight.gif are in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
