"""Shared code of flight films: a flight step by step, captions, tiled pictures, and the files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

import flockstep
from flockstep.registration import make_by_id
from flockstep.rotations import rotate
from flockstep.trainings import TRAININGS, Flyer
from training.plot_paths import write_gif

Array = npt.NDArray[Any]
Color = tuple[int, int, int]

FPS = 25
GIF_COLORS = 64
FINER = 2  # supersampling factor, for smooth edges
GRID_M = 2.0

PATH, POINT, INK, ALARM = (35, 90, 210), (20, 140, 60), (20, 20, 20), (200, 40, 20)


@dataclass
class Flight:
    """One flight, step by step, beginning with the start."""

    position: Array
    """(T, 3) m."""
    quat_wxyz: Array
    """(T, 4)."""
    point: Array
    """(T, 3) m: target position of the drone."""
    lost: bool
    """True if it ended as a crash: on contact, or too far from the point."""


def flown(name: str, policy: Any, seed: int) -> Flight:
    """Fly Hover or Track once, from a seed, by a model, a function or a `Flyer`."""
    training = TRAININGS[name]
    keywords = {**training.judged(1, seed)[""], **(policy.keywords if isinstance(policy, Flyer) else {})}
    steps = keywords["max_episode_steps"] - 1
    envs = make_by_id(str(training.env), 1, autoreset_mode="disabled", **keywords)
    act = policy.in_envs(envs) if isinstance(policy, Flyer) else getattr(policy, "predict", policy)
    observation, _ = envs.reset(seed=seed)
    lost = False
    states: list[tuple[Array, Array, Array]] = []
    while True:
        position, quat_wxyz = np.array(envs.batch.position[0], float), np.array(envs.batch.quat_wxyz[0], float)
        states.append((position, quat_wxyz, position + rotate(quat_wxyz, np.asarray(observation)[0, :3])))
        if lost or len(states) > steps:
            break
        chosen = act(observation, deterministic=True)[0] if hasattr(policy, "predict") else act(observation)
        observation, _, terminated, _, _ = envs.step(chosen)
        lost = bool(terminated[0])
    positions, quats, points = (np.array(each) for each in zip(*states, strict=True))
    return Flight(positions, quats, points, lost)


Frame = tuple[Image.Image, int]
"""A picture and how long it is shown, in ms."""


@dataclass
class Shot:
    """A flight to film."""

    model: Any
    """The policy."""
    seed: int
    """Seed of the world and the flight."""
    width_px: int
    """Width of the film, or of its main view."""
    film_s: float | None = None
    """Longest filmed time from the start of the flight. None: all of it."""

    def steps(self, step_ms: float, most: float = np.inf) -> int:
        """Return the number of filmed steps, of at most this many."""
        return int(most if self.film_s is None else min(round(1000 * self.film_s / step_ms), most))


@dataclass(frozen=True)
class Film:
    """A row of the table of films."""

    frames: Callable[[Shot], Iterable[Frame]]
    policy: str | None
    """File of the policy. None: train ``training``, if there is one."""
    seed: int
    width_px: int
    quality: int
    film_s: float | None = None
    key_every: int | None = None
    """Pictures between two that do not depend on others, in which faint traces of older ones disappear."""
    training: str | None = None


def save_film(path: Path, frames: Sequence[Frame], quality: int, key_every: int | None = None) -> None:
    """Save a film that repeats forever, and print its size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pictures, durations = zip(*frames, strict=True)
    settings: dict[str, Any] = {"duration": list(durations), "loop": 0, "quality": quality, "method": 6}
    if key_every is not None:
        settings |= {"kmin": key_every - 1, "kmax": key_every, "method": 4}
    pictures[0].save(path, save_all=True, append_images=list(pictures[1:]), **settings)
    print(f"{path}: {len(pictures)} pictures, {path.stat().st_size / 1e6:.2f} MB")


def steps_of(envs: flockstep.DroneVectorEnv, model: Any, seed: int) -> Iterator[tuple[Any, bool]]:
    """Fly one env, which does not reset itself; yield the observation, and whether the flight has ended."""
    observation, _ = envs.reset(seed=seed)
    ended = False
    while not ended:
        yield observation, ended
        observation, _, terminated, truncated, _ = envs.step(model.predict(observation, deterministic=True)[0])
        ended = bool((terminated | truncated).any())
    yield observation, ended


def write_captions(
    picture: Image.Image, lines: Sequence[tuple[float, float, str, Color]], *, edged: bool = True
) -> None:
    """Write lines into a picture: distance from the top and height, both for a width of 640; text; color."""
    pen, unit = ImageDraw.Draw(picture), picture.width / 640
    edge: dict[str, Any] = {"stroke_width": max(round(3 * unit), 1), "stroke_fill": "white"} if edged else {}
    for top, size, text, color in lines:
        font = ImageFont.load_default(max(round(size * unit), 1))
        pen.text((14 * unit, top * unit), text, font=font, fill=color, **edge)


def smooth(rows: Array, sigma: float, **pad: Any) -> Array:
    """Return rows (T, K) smoothed over time, continued beyond the ends by these keywords of `numpy.pad`."""
    half = round(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    padded = np.pad(rows, ((half, half), (0, 0)), **pad)
    return np.stack([np.convolve(column, weights / weights.sum(), "valid") for column in padded.T], axis=1)


def add_floor(builder: flockstep.WorldBuilder, low: Array, high: Array, floor: int, grid: int) -> None:
    """Add a floor (m) with a grid at the height of the lower corner to a world, in these materials."""
    (left, near, z), (right, far, _) = low, high
    x, y, width, length = (left + right) / 2, (near + far) / 2, right - left, far - near
    builder.box((x, y, z - 0.1), (width, length, 0.2), floor)
    for line in np.arange(left + GRID_M / 2, right, GRID_M):
        builder.plane((line, y, z + 0.004), (0.03, length), grid)
    for line in np.arange(near + GRID_M / 2, far, GRID_M):
        builder.plane((x, line, z + 0.004), (width, 0.03), grid)


def tiled(rows: Sequence[Sequence[Image.Image]]) -> Image.Image:
    """Return pictures as one picture with white lines between them."""
    width, height = rows[0][0].size
    whole = Image.new("RGB", (width * len(rows[0]), height * len(rows)))
    pen, line = ImageDraw.Draw(whole), max(width // 160, 1)
    for row, pictures in enumerate(rows):
        for column, picture in enumerate(pictures):
            whole.paste(picture, (column * width, row * height))
            pen.rectangle([column * width, row * height, (column + 1) * width, (row + 1) * height], None, "white", line)
    return whole


def write_film(path: Path, frames: Iterable[Image.Image], gif_fps: float, gif_width_px: int) -> None:
    """Write a film of these frames, and a smaller one for web pages: PATH.mp4 and PATH.gif."""
    small: list[Array] = []
    film: Any  # imageio's own type for writers has no append_data
    with imageio.get_writer(path.with_suffix(".mp4"), fps=FPS, quality=8, macro_block_size=2) as film:
        for index, frame in enumerate(frames):
            film.append_data(np.asarray(frame))
            if index % round(FPS / gif_fps) == 0:
                small.append(np.asarray(frame.resize((gif_width_px, gif_width_px * frame.height // frame.width))))
    colors = np.unique(np.reshape(small[::8], (-1, 3)), axis=0)  # each colour once: the rare ones are the drone's
    palette = Image.fromarray(colors[None]).quantize(GIF_COLORS)
    plain = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in small]
    write_gif(path.with_suffix(".gif"), [np.asarray(frame.convert("RGB")) for frame in plain], round(1000 / gif_fps))
