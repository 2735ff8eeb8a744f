"""Film a flight to a goal with rotors: through a forest by depth, or past pillars by LiDAR.

.venv/bin/python -m tools.rotor_film forest         # docs/forest.webp
.venv/bin/python -m tools.rotor_film lidar_rotors   # docs/rotors.webp

The program first trains the policy of the board, some minutes, unless `--policy` names a model that
`flockstep.PPO` saved. Neither training nor evaluation uses the filmed world. The film is as fast as the flight. A
depth image, in which near is bright, is everything that the policy sees of the forest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import tyro
from PIL import Image

import flockstep
from tools.film import write_captions
from training.forest_flight import FAR_M, ForestFlight
from training.recipes import RECIPES, train
from training.rotor_navigation import RotorNavigation
from training.tasks import UNSEEN_SEEDS

Array = npt.NDArray[Any]

STEP_MS = 100  # of both tasks
HOLD_S = 1.0  # the last picture
INSET = 0.3  # width of the depth image, as a share of the film's
INK = (20, 20, 20)
FILMS = {"forest": Path("docs/forest.webp"), "lidar_rotors": Path("docs/rotors.webp")}


@dataclass
class Args:
    """Options for training, flying and filming."""

    name: tyro.conf.Positional[Literal["forest", "lidar_rotors"]]
    """The training."""
    policy: Path | None = None
    """A model saved by `flockstep.PPO`. None: train one."""
    out: Path | None = None
    """The film. None: docs/forest.webp or docs/rotors.webp."""
    seed: int = UNSEEN_SEEDS.stop - 1
    """Seed of the world."""
    threads: int = 2
    """Threads of the training."""
    width_px: int = 480
    """Width of the film; its height is 9/16 of that."""
    quality: int = 30
    """Quality of the pictures, 0 to 100."""
    steps: int = 400
    """Maximum number of filmed steps."""


def depth_picture(depth: Array, width_px: int) -> Image.Image:
    """Return a depth image (H, W), enlarged without smoothing; near is bright."""
    rows, columns = depth.shape
    bright = 255 * (1 - np.log1p(np.minimum(depth, FAR_M)) / np.log1p(FAR_M))
    scale = width_px // columns
    return Image.fromarray(bright.astype(np.uint8)).resize((scale * columns, scale * rows), Image.Resampling.NEAREST)


def pictures(model: flockstep.PPO, args: Args) -> Iterator[Image.Image]:
    """Fly once and yield a picture before the first step and after each one."""
    width = args.width_px // 4 * 4
    is_forest = args.name == "forest"
    envs = flockstep.DroneVectorEnv(
        1,
        task=ForestFlight() if is_forest else RotorNavigation(),
        worlds=flockstep.World.forest(args.seed) if is_forest else flockstep.World.playground(args.seed),
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(2 * width, 2 * width * 9 // 16),
    )
    observation, _ = envs.reset(seed=args.seed)
    ended = False
    for step in range(args.steps + 1):
        frames = envs.render()
        assert frames is not None
        picture = Image.fromarray(frames[0]).reduce(2)
        if is_forest:
            inset = depth_picture(envs.batch.camera().depth[0], round(INSET * width))
            picture.paste(inset, (width - inset.width - 8, 8))
        speed = float(np.linalg.norm(envs.batch.velocity[0]))
        left = float(envs.batch.terms.goal_distance()[0])
        write_captions(picture, [(8, 20, f"{step / 10:.1f} s: {speed:.1f} m/s, {left:.0f} m to the goal", INK)])
        yield picture
        if ended:
            return
        observation, _, terminated, truncated, _ = envs.step(model.predict(observation, deterministic=True)[0])
        ended = bool(terminated[0] | truncated[0])
    envs.close()


def main(args: Args) -> None:
    """Train if necessary, fly, and write the film."""
    if args.policy is None:
        model = train(RECIPES[args.name], "flockstep", 0, args.threads)
    else:
        model = flockstep.PPO.load(args.policy)
    film = list(pictures(model, args))
    durations = [*[STEP_MS] * (len(film) - 1), round(1000 * HOLD_S)]
    out = args.out or FILMS[args.name]
    out.parent.mkdir(parents=True, exist_ok=True)
    film[0].save(out, save_all=True, append_images=film[1:], duration=durations, loop=0, quality=args.quality, method=6)
    print(f"{out}: {len(film)} pictures, {out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(tyro.cli(Args))
