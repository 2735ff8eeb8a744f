"""Watch a quadrotor follow a figure-8: with the bundled policy and, from the same start, with only the controller.

.venv/bin/python -m tools.track_film                # track.mp4, track.gif and track.png in out/track/
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
import tyro
from PIL import Image
from tqdm import tqdm

from flockstep.pictures.body import Body
from flockstep.pictures.drawing import Drawing
from flockstep.pictures.stage import Stage
from flockstep.registration import make_by_id
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS, Flyer, Verdict, judge
from flockstep.trainings.flyers import CLOSE_M, velocity_control
from tools.film import ALARM, FINER, FPS, INK, PATH, POINT, Flight, flown, tiled, write_captions, write_film
from training.tasks import load_policy

Array = npt.NDArray[Any]

HZ, LASTS_S = 100.0, 10.0  # of Track
GIF_FPS, GIF_WIDTH_PX = 12.5, 800
FROM_M = np.array([0.0, -1.45, 1.15])  # viewer, relative to the middle of the path
TOWARDS_M = np.array([0.0, -0.05, 0.0])  # target of the view


@dataclass
class Args:
    """Options for flying and filming."""

    policy: Path = Path("policies/track.zip")
    """A model saved by flockstep/trainings. Loading it runs code from the file: load only
    policies you trust."""
    out: Path = Path("out/track")
    """Folder for the films and the picture."""
    seed: int = UNSEEN_SEEDS.start
    """Seed of the filmed flight: it sets the start on the path and the distance from it."""
    flights: int = 1000
    """Number of other flights to evaluate both."""
    width_px: int = 1280
    """Width of the film; its height is 3/4 of that."""
    film_s: float = LASTS_S
    """Filmed time of the flight."""


def controller() -> Flyer:
    """Return the best controller among the baselines of the training.

    Its command is the path's velocity 0.6 s ahead, plus a correction towards the path's position at that time.
    """
    return velocity_control(point=6, gain=1.0, towards=6)


class Scene:
    """The hall, the path and the drone, drawn in pictures of one size."""

    def __init__(self, path: Array, size_px: tuple[int, int]) -> None:
        batch = make_by_id("flockstep/Track-v0", 1).batch
        world = batch.worlds[0]
        self._body = Body(batch.drone)
        middle = np.asarray(world.goal, float)
        self._stage = Stage(world, 0.1, size_px, FINER**2, markers=())
        self._path = path
        self._view = (middle + FROM_M, middle + TOWARDS_M)

    def picture(self, flight: Flight, step: int) -> Image.Image:
        """Return the drone after this many steps, its trail, the point, and the line between them."""
        trail = flight.position[: step + 1]
        canvas = self._stage.seen_from(*self._view, [self._body.at(trail[-1], flight.quat_wxyz[step])])
        drawing = Drawing(canvas, FINER)
        drawing.lines(self._path[:-1], self._path[1:], POINT, 1.5)
        if step > 0:
            drawing.lines(trail[:-1], trail[1:], PATH, 2.5)
        drawing.lines(trail[-1], flight.point[step], ALARM, 2)
        drawing.spheres(flight.point[step], 0.02, POINT)
        return Image.fromarray(canvas.rgb)


class Panel:
    """The pictures of one flight, with captions."""

    def __init__(self, scene: Scene, flight: Flight, title: str, below: str) -> None:
        self._scene, self._flight, self._title, self._below = scene, flight, title, below
        self._distance_m = np.linalg.norm(flight.point - flight.position, axis=1)
        flown_m = self._distance_m[1:]  # without the start, which the pilot does not control
        self._error_m = np.sqrt(np.cumsum(flown_m**2) / np.arange(1, len(flown_m) + 1))

    def frame(self, step: int) -> Image.Image:
        """Return the picture after this many steps, or the last one."""
        step = min(step, len(self._distance_m) - 1)
        picture = self._scene.picture(self._flight, step)
        status, color = f"{step / HZ:.1f} s: {100 * self._distance_m[step]:.0f} cm from the point", INK
        if step > 0:
            status += f", root mean square so far {100 * self._error_m[step - 1]:.1f} cm"
        if self._flight.lost and step == len(self._distance_m) - 1:
            status, color = f"{step / HZ:.1f} s: lost", ALARM
        write_captions(picture, [(3, 17, self._title, INK), (23, 14, self._below, INK), (218, 14, status, color)])
        return picture


def error_m(verdict: Verdict) -> float:
    """Return the median error of the flights without a crash; infinite if all crashed."""
    return verdict.more.get("median_error_m", float("inf"))


def draw(args: Args, pilots: Sequence[tuple[str, Any]]) -> list[str]:
    """Film one flight by each of two pilots; return summaries of their other flights."""
    width = args.width_px // 16 * 16  # makes heights even
    flights = [flown("track", pilot, args.seed) for _, pilot in pilots]
    path = max((flight.point for flight in flights), key=len)  # all share it; a lost flight is shorter
    scene = Scene(path, (width, width * 3 // 8))
    panels, summaries = [], []
    for flight, (title, pilot) in zip(flights, pilots, strict=True):
        others = judge(TRAININGS["track"], pilot, args.flights, UNSEEN_SEEDS.start)
        below = f"{args.flights:,} flights: root mean square {100 * error_m(others):.1f} cm (median)"
        panels.append(Panel(scene, flight, title, below))
        summaries.append(
            f"{title:<18} {others.success:.1%} within {100 * CLOSE_M:g} cm, {others.crashed:.1%} crashed"
            f", error of the others {100 * error_m(others):.1f} cm (median)"
        )
    steps = range(0, round(args.film_s * HZ) + 1, round(HZ / FPS))
    frames = (tiled([[panel.frame(step)] for panel in panels]) for step in tqdm(steps, "filming", unit=" pictures"))
    write_film(args.out / "track", frames, GIF_FPS, GIF_WIDTH_PX)
    tiled([[panel.frame(steps[-1])] for panel in panels]).save(args.out / "track.png")
    return summaries


def main(args: Args) -> None:
    """Fly, film and print the results."""
    args.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)  # more are slower for a small network
    summaries = draw(args, [("learned policy", load_policy(args.policy)), ("controller alone", controller())])
    print(f"""
{args.flights:,} flights of {LASTS_S:g} s along a figure-8, by the policy and by the controller alone:
{chr(10).join(f"  {line}" for line in summaries)}

In {args.out}/
  track.mp4            a film of one flight, by both from the same start
  track.gif            the same, smaller
  track.png            its end: where both have flown""")


if __name__ == "__main__":
    main(tyro.cli(Args))
