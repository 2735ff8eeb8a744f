"""Film drones that exchange their places, seen from above.

.venv/bin/python -m tools.swap_film        # docs/swap.webp, with the policy policies/swap.zip

Neither training nor evaluation uses the filmed episode. The film is as fast as the flight.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tyro
from PIL import Image, ImageDraw

import flockstep
from tools.film import save_film, write_captions
from training import swap
from training.tasks import UNSEEN_SEEDS

Array = npt.NDArray[Any]

STEP_MS = 100
HOLD_MS = 1500  # the last picture
FINER = 2  # supersampling factor, for smooth edges
MARGIN_M = 1.0
GROUND, INK = (250, 250, 250), (20, 20, 20)


@dataclass
class Args:
    """Options."""

    policy: Path = Path("policies/swap.zip")
    """A model saved by `flockstep.PPO`."""
    seed: int = UNSEEN_SEEDS.stop - 1
    """Seed of the episode."""
    drones: int = 16
    """Number of drones."""
    out: Path = Path("docs/swap.webp")
    """The film."""
    size_px: int = 400
    """Width and height of the film."""
    quality: int = 60
    """Quality of the pictures, 0 to 100."""


def fly(model: flockstep.PPO, args: Args) -> tuple[Array, Array, float]:
    """Fly one episode; return the positions (T, M, 2), the goals (M, 2) and the radius of a drone, all in m."""
    envs = flockstep.DroneVectorEnv(
        1,
        task=flockstep.SwapConfig(),
        drones_per_env=args.drones,
        max_episode_steps=swap.MOST_STEPS,
        autoreset_mode="disabled",
    )
    observation, _ = envs.reset(seed=args.seed)
    goals = envs.batch.task_state["goal"][:, :2].copy()
    positions = [envs.batch.position[:, :2].copy()]
    ended = False
    while not ended:
        observation, _, terminated, truncated, _ = envs.step(model.predict(observation, deterministic=True)[0])
        positions.append(envs.batch.position[:, :2].copy())
        ended = bool((terminated | truncated).any())
    print(f"{args.drones} drones: {'all at their goals' if envs.batch.success.all() else 'not all at their goals'}")
    radius = float(np.linalg.norm(envs.batch.drone.hull[:, :2], axis=1).max())
    envs.close()
    return np.array(positions), goals, radius


def pictures(positions: Array, goals: Array, radius: float, size_px: int) -> Iterator[Image.Image]:
    """Draw drones as discs with trails, and their goals as rings, one picture for each step."""
    reach = np.abs(goals).max() + radius + MARGIN_M
    scale = FINER * size_px / (2 * reach)
    colors = [colorsys.hsv_to_rgb(m / len(goals), 0.75, 0.85) for m in range(len(goals))]
    inks = [tuple(int(255 * part) for part in color) for color in colors]

    def pixels(points: Array) -> Array:
        return FINER * size_px / 2 + scale * points * [1, -1]

    for step in range(len(positions)):
        picture = Image.new("RGB", (FINER * size_px,) * 2, GROUND)
        draw = ImageDraw.Draw(picture)
        for goal, ink in zip(pixels(goals), inks, strict=True):
            draw.circle(tuple(goal), scale * 0.3, outline=ink, width=FINER)
        for m, ink in enumerate(inks):
            trail = [tuple(point) for point in pixels(positions[: step + 1, m])]
            draw.line(trail, fill=ink, width=FINER)
            draw.circle(trail[-1], scale * radius, fill=ink)
        picture = picture.reduce(FINER)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s", INK)])
        yield picture


def main(args: Args) -> None:
    """Fly and write the film."""
    film = list(pictures(*fly(flockstep.PPO.load(args.policy), args), args.size_px))
    durations = [*[STEP_MS] * (len(film) - 1), HOLD_MS]
    save_film(args.out, film, durations, args.quality)


if __name__ == "__main__":
    main(tyro.cli(Args))
