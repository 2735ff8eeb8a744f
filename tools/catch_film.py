"""Watch a quadrotor learn to catch itself: train Hover, and film one throw with policies from during the training.

.venv/bin/python -m tools.catch_film                # catch.mp4, catch.gif and catch.png in out/catch/
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tyro
from PIL import Image
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.depth_canvas import Color
from flockstep.pictures.drawing import Drawing
from flockstep.pictures.stage import Stage
from flockstep.registration import make_by_id
from flockstep.rotations import rotate
from flockstep.sb3 import Progress
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS, Training, judge, train
from flockstep.trainings.flyers import CLOSE_M
from tools.film import ALARM, FINER, FPS, INK, PATH, POINT, Flight, flown, smooth, tiled, write_captions, write_film
from training.board import LEARNED, TimeLimit, verdict_on

Array = npt.NDArray[Any]

HZ, LASTS_S = 50.0, 6.0  # of Hover
SHOWN = (0.0, 1 / 6, 1 / 2)  # fractions of the training's steps; the fourth policy is the last one
THROWS = 100  # number of throws; the one with the most tilt is filmed, caught or not

GIF_FPS, GIF_WIDTH_PX = 6.25, 560
FROM = np.array([-0.71, -0.41, 0.57])  # unit vector towards the viewer
NEAR_M, APART_M = 0.42, 0.9  # minimum distance of the viewer; maximum drone-point distance with both in view
SMOOTH_S = 0.1  # smoothing of the viewer's motion
SHEET_S, SHEET_WIDTH_PX = (0.0, 0.3, 0.8, 2.0, 6.0), 2000  # times of flight in catch.png; its width


@dataclass
class Args:
    """Options for training, flying and filming."""

    out: Path = Path("out/catch")
    """Folder for the films, the picture and the policy."""
    seed: int = 0
    """Seed of the training."""
    total_steps: int | None = None
    """Step budget of the training; default: the row's."""
    max_minutes: float | None = None
    """Time limit of the training. Default: none; the training ends after its steps."""
    flights: int = 1000
    """Number of other throws to evaluate each policy."""
    width_px: int = 1280
    """Width of the film; its height is 9/16 of that."""
    film_s: float = LASTS_S
    """Filmed time of the flight."""


@dataclass
class Moment:
    """The policy at one moment of a training."""

    steps: int
    seconds: float
    parameters: Array
    """Of its networks."""


class Keeper(BaseCallback):
    """Stores the policy before each update."""

    def __init__(self) -> None:
        super().__init__()
        self.moments: list[Moment] = []

    def _on_training_start(self) -> None:
        self._begun = time.perf_counter()

    def _on_rollout_start(self) -> None:
        self._keep()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._keep()

    def _keep(self) -> None:
        seconds = time.perf_counter() - self._begun
        self.moments.append(Moment(self.num_timesteps, seconds, self.model.learner.parameters))


def learn(recipe: Training, seed: int, max_minutes: float | None = None) -> tuple[flockstep.PPO, list[Moment]]:
    """Train; return the model, and the policies to show, of which it is the last."""
    keeper = Keeper()
    model = train(recipe, "flockstep", seed, 0, [keeper, TimeLimit(max_minutes), Progress()])
    steps = np.array([moment.steps for moment in keeper.moments])
    shown = [keeper.moments[int(np.abs(steps - share * steps[-1]).argmin())] for share in SHOWN]
    return model, [*shown, keeper.moments[-1]]


def most_tilted(seeds: range) -> int:
    """Return the seed of the throw with the most initial tilt."""
    envs = make_by_id("flockstep/Hover-v0", len(seeds))
    envs.reset(seed=seeds.start)
    up = rotate(envs.batch.quat_wxyz, np.array([0.0, 0.0, 1.0]))
    return seeds[int(up[:, 2].argmin())]


class Scene:
    """The hall, the point and the drone, drawn in pictures of one size."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        batch = make_by_id("flockstep/Hover-v0", 1).batch
        world = batch.worlds[0]
        self.point = np.asarray(world.goal, float)
        self._body = Body(batch.drone)
        self._stage = Stage(world, 0.1, size_px, FINER**2, markers=())

    def picture(self, viewer: Array, target: Array, throw: Flight, step: int) -> Image.Image:
        """Return the drone after this many steps, and its path until then."""
        path = throw.position[: step + 1]
        canvas = self._stage.seen_from(viewer, target, [self._body.at(path[-1], throw.quat_wxyz[step])])
        drawing = Drawing(canvas, FINER)
        angle = np.linspace(0, 2 * np.pi, 49)
        ring = CLOSE_M * np.stack([np.cos(angle), np.sin(angle), np.zeros(49)], axis=1)
        for order in ([0, 1, 2], [0, 2, 1], [2, 0, 1]):
            circle = self.point + ring[:, order]
            drawing.lines(circle[:-1], circle[1:], POINT, 1)
        drawing.spheres(self.point, 0.006, POINT)
        if step > 0:
            drawing.lines(path[:-1], path[1:], PATH, 2)
        return Image.fromarray(canvas.rgb)


class Panel:
    """The pictures of one throw, with captions."""

    def __init__(self, scene: Scene, throw: Flight, title: str, below: str) -> None:
        self._scene, self._throw, self._title, self._below = scene, throw, title, below
        self._last = len(throw.position) - 1
        gap = throw.position - scene.point
        self._distance_m = np.linalg.norm(gap, axis=1)
        kept = np.minimum(self._distance_m, APART_M)[:, None]
        # Look between drone and point, from far enough, while both fit into the picture; otherwise follow the drone.
        pad: dict[str, Any] = {"mode": "reflect", "reflect_type": "odd"}  # continues the trend
        target = throw.position - 0.35 * kept * gap / np.maximum(self._distance_m, 1e-9)[:, None]
        self._target = smooth(target, SMOOTH_S * HZ, **pad)
        self._viewer = self._target + smooth(NEAR_M + 1.2 * kept, SMOOTH_S * HZ, **pad) * FROM

    def frame(self, step: int) -> Image.Image:
        """Return the picture after this many steps, or the last one."""
        if step >= self._last:
            return self._end
        return self._captioned(step, f"{100 * self._distance_m[step]:.0f} cm from the point")

    @cached_property
    def _end(self) -> Image.Image:
        if self._throw.lost:
            return self._captioned(self._last, "lost", ALARM)
        status = f"{100 * self._distance_m[-1]:.0f} cm from the point"
        return self._captioned(self._last, status, INK if self._distance_m[-1] <= CLOSE_M else ALARM)

    def _captioned(self, step: int, status: str, color: Color = INK) -> Image.Image:
        picture = self._scene.picture(self._viewer[step], self._target[step], self._throw, step)
        captions = [
            (6, 34, self._title, INK),
            (46, 25, self._below, INK),
            (318, 26, f"{step / HZ:.1f} s: {status}", color),
        ]
        write_captions(picture, captions)
        return picture


def draw(args: Args, model: flockstep.PPO, moments: Sequence[Moment]) -> list[float]:
    """Film one throw with the policies of some moments; return each one's share of other throws held within 5 cm."""
    width = args.width_px // 4 * 2  # width of a panel; codecs need even sizes
    scene = Scene((width, width * 9 // 32 * 2))
    seed = most_tilted(range(UNSEEN_SEEDS.start, UNSEEN_SEEDS.start + THROWS))
    panels, rates = [], []
    for moment in moments:
        model.learner.parameters = moment.parameters
        rates.append(judge(TRAININGS["hover"], model, args.flights, UNSEEN_SEEDS.start).success)
        title = f"after {moment.seconds:.2f} s of training" if moment.steps else "untrained"
        below = f"{moment.steps:,} steps: holds {rates[-1]:.1%} of {args.flights:,} throws"
        panels.append(Panel(scene, flown("hover", model, seed), title, below))
    sheet = tiled([[panel.frame(round(s * HZ)) for s in SHEET_S] for panel in panels])
    sheet.resize((SHEET_WIDTH_PX, SHEET_WIDTH_PX * sheet.height // sheet.width)).save(args.out / "catch.png")
    steps = range(0, round(args.film_s * HZ) + 1, round(HZ / FPS))
    pictures = ([panel.frame(step) for panel in panels] for step in tqdm(steps, "filming", unit=" pictures"))
    write_film(args.out / "catch", (tiled([four[:2], four[2:]]) for four in pictures), GIF_FPS, GIF_WIDTH_PX)
    return rates


def main(args: Args) -> bool:
    """Train, fly, film and print the results; return whether the policy learned to catch the drone."""
    args.out.mkdir(parents=True, exist_ok=True)
    print("Training a quadrotor to catch itself by the thrusts of its rotors ...")
    recipe = TRAININGS["hover_apg"]
    recipe = replace(recipe, steps=args.total_steps or recipe.steps)
    model, moments = learn(recipe, args.seed, args.max_minutes)
    model.save(args.out / "catch.zip")
    rates = draw(args, model, moments)
    last = moments[-1]
    lines = [f"  {m.steps:>9,} steps {m.seconds:>6.2f} s {rate:>8.1%}" for m, rate in zip(moments, rates, strict=True)]
    skill = "catch a quadrotor by the thrusts of its rotors"
    print(f"""
{verdict_on(skill, rates[-1], last.steps, recipe.steps)}:
{last.steps:,} steps in {last.seconds:.2f} seconds. Share of {args.flights:,} held-out throws that it brings to
the point and holds there, within {100 * CLOSE_M:g} cm:
{chr(10).join(lines)}

In {args.out}/
  catch.mp4            a film of one throw, flown by the policies of four moments of the training
  catch.gif            the same, smaller
  catch.png            the same at a glance: a row for each moment
  catch.zip            the policy, for flockstep.APG.load""")
    return rates[-1] >= LEARNED


if __name__ == "__main__":
    sys.exit(not main(tyro.cli(Args)))
