"""Film a drone that follows a car through the streets of a living city.

.venv/bin/python -m tools.street_film       # docs/street.webp

The controller is one line: it commands the place where the car was a while ago, some metres above the street. The
engine would stop the drone at what it hits. The film is as fast as the flight.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import tyro
from PIL import Image

import flockstep
from tools.film import INK, save_film, write_captions

STEP_MS = 100


@dataclass
class Args:
    """Options."""

    world: str = "living_city/seed-3"
    """The city."""
    car: int = 4
    """Number of the body to follow."""
    behind_s: float = 1.2
    """Time after which the drone passes where the car was."""
    above_m: float = 2.8
    """Height above the street."""
    seconds: float = 9.0
    """Length of the film."""
    seed: int = 0
    """Seed of the episode."""
    out: Path = Path("docs/street.webp")
    """The film."""
    width_px: int = 480
    """Width of the film; its height is 9/16 of that."""
    quality: int = 34
    """Quality of the pictures, 0 to 100."""


def pictures(args: Args) -> Iterator[Image.Image]:
    """Fly and yield a picture before the first step and after each one."""
    height = args.width_px * 9 // 16
    envs = flockstep.DroneVectorEnv(
        1,
        worlds=flockstep.World.load(args.world),
        max_episode_steps=100_000,
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(2 * args.width_px, 2 * height),
    )
    envs.reset(seed=args.seed)
    batch = envs.batch

    def car() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        place = batch.bodies.position[0, args.car] + np.array([0, 0, args.above_m], np.float32)
        return place[None], batch.bodies.quat_wxyz[0, args.car].copy()[None]

    way = [car()]
    batch.set_pose(*way[0])
    while len(way) * STEP_MS < 1000 * args.behind_s:  # the car drives off
        batch.move(*way[0])
        way.append(car())
    speed, touched = 0.0, False
    for step in range(round(1000 * args.seconds / STEP_MS) + 1):
        frames = envs.render()
        assert frames is not None
        picture = Image.fromarray(frames[0]).reduce(2)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s, {speed:.1f} m/s", INK)])
        yield picture
        before = batch.position[0].copy()
        batch.move(*way[step])
        way.append(car())
        speed = float(np.linalg.norm(batch.position[0] - before)) * 1000 / STEP_MS
        touched |= bool(batch.contact.hit[0])
    print("the drone touched something" if touched else "the drone touched nothing")
    envs.close()


def main(args: Args) -> None:
    """Fly and write the film."""
    film = list(pictures(args))
    save_film(args.out, film, [STEP_MS] * len(film), args.quality)


if __name__ == "__main__":
    main(tyro.cli(Args))
