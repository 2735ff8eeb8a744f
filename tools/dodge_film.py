"""Film flights of Dodge in a playground and a warehouse with bodies that move.

.venv/bin/python -m tools.dodge_film        # docs/dodge.webp, with the policy policies/dodge.zip

Neither training nor evaluation uses the filmed worlds. The film is as fast as the flights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from PIL import Image

import flockstep
from tools.film import save_film, write_captions
from training.tasks import UNSEEN_SEEDS

STEP_MS = 100
HOLD_MS = 1000  # the last picture of a flight
INK = (20, 20, 20)


@dataclass
class Args:
    """Options."""

    policy: Path = Path("policies/dodge.zip")
    """A model saved by `flockstep.PPO`."""
    seed: int = UNSEEN_SEEDS.stop - 1
    """Seed of the worlds and the flights."""
    out: Path = Path("docs/dodge.webp")
    """The film."""
    width_px: int = 400
    """Width of the film; its height is 9/16 of that."""
    quality: int = 30
    """Quality of the pictures, 0 to 100."""
    steps: int = 120
    """Maximum number of steps of a flight."""


def pictures(model: flockstep.PPO, world: str, args: Args) -> Iterator[Image.Image]:
    """Fly once and yield a picture before the first step and after each one."""
    height = args.width_px * 9 // 16
    envs = flockstep.DroneVectorEnv(
        1,
        task=flockstep.DodgeConfig(),
        worlds=flockstep.World.load(f"{world}/seed-{args.seed}"),
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(2 * args.width_px, 2 * height),
    )
    observation, _ = envs.reset(seed=args.seed)
    ended = False
    for step in range(args.steps + 1):
        frames = envs.render()
        assert frames is not None
        picture = Image.fromarray(frames[0]).reduce(2)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s", INK)])
        yield picture
        if ended:
            break
        observation, _, terminated, truncated, _ = envs.step(model.predict(observation, deterministic=True)[0])
        ended = bool(terminated[0] | truncated[0])
    print(f"{world}: {'at the goal' if envs.batch.success[0] else 'not at the goal'}")
    envs.close()


def main(args: Args) -> None:
    """Fly and write the film."""
    model = flockstep.PPO.load(args.policy)
    film: list[Image.Image] = []
    durations: list[int] = []
    for world in ("living_playground", "living_warehouse"):
        flight = list(pictures(model, world, args))
        film += flight
        durations += [*[STEP_MS] * (len(flight) - 1), HOLD_MS]
    save_film(args.out, film, durations, args.quality)


if __name__ == "__main__":
    main(tyro.cli(Args))
