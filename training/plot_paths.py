"""Pictures of flights: every playground from above and from the side, and an animation from behind the drone.

.venv/bin/python -m training.plot_paths out/demo/policy.zip --out out/paths
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import tyro
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image

import flockstep
from flockstep.pictures.relief import SOLID, VIEWS, Relief
from flockstep.task import MARKERS
from training.evaluate import Flight, Policy, fly, greedy
from training.tasks import Setup, env_keywords, load_policy, setup_of

OUTCOME_COLOR = {
    "success": "tab:green",
    "contact": "tab:red",
    "left_area": "tab:purple",
    "bad_state": "black",
    "time": "tab:orange",
    "task": "tab:brown",
}
OBSTACLE_COLOR = tuple(channel / 255 for channel in SOLID)
MARKER_COLOR = {"start": "tab:red", "waypoints": "gold", "goal": "limegreen"}
MARGIN = 0.015  # margin around the world, as a fraction of its size
WORLD_PX = 900  # longer side of a picture's world
CLEAR_M = 0.15  # distance of the cut in front of the path

FRAME_MS, COMMON_COLORS = 35, 96  # per step of the policy; of 256 colours

Pixels = npt.NDArray[np.uint8]


def draw_path(axes: Axes, world: flockstep.World, view: str, flight: Flight, markers: Sequence[str]) -> None:
    """Draw a world, some of its markers and a path in a view of `Relief`, cut just in front of the path."""
    across, up, along, viewer = VIEWS[view]
    trail = flight.trail
    places = [("start", world.start), *(("waypoints", w) for w in world.waypoints), ("goal", world.goal)]
    found = [(kind, place) for kind, place in places if place is not None and kind in markers]
    corners = np.concatenate([world.bounds, trail, *(place[None] for _, place in found)])[:, [across, up]]
    low, high = corners.min(axis=0).astype(float), corners.max(axis=0).astype(float)
    margin = MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    width, height = np.maximum(np.rint(WORLD_PX * (high - low) / (high - low).max()), 1).astype(int).tolist()
    cut_m = viewer * (float((viewer * trail[:, along]).max()) + CLEAR_M)
    picture = Relief(world, view, low, high, (width, height)).picture(cut_m)
    axes.imshow(picture, extent=(low[0], high[0], low[1], high[1]), interpolation="antialiased")
    for kind, place in found:
        radius = max(world.marker_radius_m, margin)
        axes.add_patch(Circle((place[across], place[up]), radius, color=MARKER_COLOR[kind], zorder=3))
    color = OUTCOME_COLOR[flight.outcome]
    axes.plot(trail[:, across], trail[:, up], color=color, linewidth=2, zorder=4)
    if flight.outcome != "success":
        axes.plot(*trail[-1, [across, up]], "x", color=color, zorder=5)
    axes.set_xlabel("xyz"[across] + " / m")
    axes.set_ylabel("xyz"[up] + " / m")


def plot_flight(world: flockstep.World, flight: Flight, path: Path, markers: Sequence[str] = MARKERS) -> None:
    """Write a picture of one flight, from above and from the side."""
    size = np.ptp(np.concatenate([world.bounds, flight.trail]), axis=0)
    ratios = [max(float(size[1] / size[0]), 0.2), max(float(size[2] / size[0]), 0.2)]
    figure, (top, side) = plt.subplots(
        2, 1, figsize=(7, min(1 + 6.3 * sum(ratios), 14)), height_ratios=ratios, layout="constrained"
    )
    draw_path(top, world, "top", flight, markers)
    draw_path(side, world, "side", flight, markers)
    figure.suptitle(f"{world.name}: {flight.outcome} after {flight.steps} steps, reward {flight.reward:,.1f}")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def plot_overview(
    worlds: Sequence[flockstep.World], flights: Sequence[Flight], path: Path, markers: Sequence[str] = MARKERS
) -> None:
    """Write one picture of all flights from above, with a legend if there is a free panel."""
    columns = 4
    rows = -(-len(worlds) // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(4 * columns, 4 * rows), layout="constrained", squeeze=False)
    for axes, world, flight in zip(grid.flat, worlds, flights, strict=False):
        draw_path(axes, world, "top", flight, markers)
        axes.set_title(f"{world.name}\n{flight.outcome}, reward {flight.reward:,.1f}")
        axes.label_outer()
    left = grid.flat[len(worlds) :]
    for axes in left:
        axes.axis("off")
    if len(left):
        dots = {**{kind: MARKER_COLOR[kind] for kind in markers}, "obstacle": OBSTACLE_COLOR}
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
    """Write an animation of one flight from behind the drone, with LiDAR beams, camera frustums and its trail."""
    setup = setup or Setup()
    envs = setup.make(
        1,
        worlds=[world],
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(width_px, width_px * 3 // 4),
    )
    observation, _ = envs.reset(seed=0)
    frames = []
    for step in range(max_steps):
        if step % steps_per_frame == 0:
            frames.extend(envs.render() or ())
        observation, _, terminated, truncated, _ = envs.step(policy(observation))
        if terminated[0] or truncated[0]:
            break
    frames.extend(envs.render() or ())
    envs.close()
    write_gif(path, frames, FRAME_MS * steps_per_frame)


def write_gif(path: Path, frames: Sequence[Pixels], frame_ms: int) -> None:
    """Write an animation that pauses one second at its end; one shared palette makes static parts compress."""
    palette = palette_of(np.stack(frames[:: max(len(frames) // 8, 1)]))
    first, *rest = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [frame_ms] * (len(frames) - 1) + [1000]
    first.save(path, save_all=True, append_images=rest, duration=durations, loop=0, optimize=True)


def palette_of(pixels: Pixels) -> Image.Image:
    """Return an image with 256 palette colours: the most common ones, and a sample of the others for details."""
    colors, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    common = colors[np.argsort(-counts)[:COMMON_COLORS]]
    others = Image.fromarray(colors[None]).quantize(256 - COMMON_COLORS, method=Image.Quantize.MEDIANCUT).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*common.ravel().tolist(), *(others or [])])
    return palette


def markers_of(setup: Setup) -> tuple[str, ...]:
    """Return the world's markers that a task uses."""
    markers: tuple[str, ...] = getattr(env_keywords(setup.task).get("task"), "markers", MARKERS)
    return markers


def picture_name(world: flockstep.World) -> str:
    """Return the file name of a world's picture."""
    return f"path-{world.name.replace('/', '-')}.png"


@dataclass
class Args:
    """Options for drawing the flights of a trained policy."""

    policy: tyro.conf.Positional[Path]
    """A model saved by training/train_ppo.py (.zip). Loading it runs code from the file: load only
    policies you trust."""
    worlds: tuple[str, ...] = ()
    """Sets of scenes, scene names or paths. Default: the task's own, for training and validation."""
    out: Path = Path("out/paths")
    """Folder for the pictures."""
    animated: str | None = None
    """Scene name or path of the animated world. Default: the first of the worlds."""
    width_px: int = 640
    """Width of the animation."""
    steps_per_frame: int = 2
    """Steps per frame of the animation."""


def main(args: Args) -> None:
    """Fly, draw, and print the location of the pictures."""
    args.out.mkdir(parents=True, exist_ok=True)
    model = load_policy(args.policy)
    policy, setup = greedy(model), setup_of(model)
    worlds = [world for name in args.worlds or setup.playgrounds for world in flockstep.scenes.load(name)]
    flights = fly(policy, worlds, setup=setup)
    for world, flight in zip(worlds, flights, strict=True):
        plot_flight(world, flight, args.out / picture_name(world), markers_of(setup))
    plot_overview(worlds, flights, args.out / "paths.png", markers_of(setup))
    shown = flockstep.scenes.load(args.animated)[0] if args.animated else worlds[0]
    animate(policy, shown, args.out / "flight.gif", 400, setup, args.width_px, args.steps_per_frame)
    print(f"{len(worlds)} pictures, paths.png and flight.gif are in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
