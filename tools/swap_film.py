"""Film drones that exchange their places.

.venv/bin/python -m tools.swap_film        # docs/swap.webp, with the policy policies/swap.zip

Neither training nor evaluation uses the filmed episodes. The film is as fast as the flights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from PIL import Image

import flockstep
from tools.film import write_captions
from training import swap
from training.tasks import UNSEEN_SEEDS

STEP_MS = 100
HOLD_MS = 1500  # the last picture
INK = (20, 20, 20)
VIEW = ((0.0, -7.9, 11.9), (0.0, -0.9, 6.0))  # m, from where to where the camera looks


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
    width_px: int = 480
    """Width of the film; its height is 3/4 of that."""
    quality: int = 30
    """Quality of the pictures, 0 to 100."""


def pictures(model: flockstep.PPO, args: Args) -> Iterator[Image.Image]:
    """Fly one episode and yield a picture before the first step and after each one."""
    envs = flockstep.DroneVectorEnv(
        1,
        task=flockstep.SwapConfig(),
        drones_per_env=args.drones,
        max_episode_steps=swap.MOST_STEPS,
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view=VIEW,
        render_size=(2 * args.width_px, 2 * (args.width_px * 3 // 4)),
    )
    observation, _ = envs.reset(seed=args.seed)
    ended = False
    step = 0
    while True:
        frames = envs.render([0])
        assert frames is not None
        picture = Image.fromarray(frames[0]).reduce(2)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s", INK)])
        yield picture
        if ended:
            break
        observation, _, terminated, truncated, _ = envs.step(model.predict(observation, deterministic=True)[0])
        ended = bool((terminated | truncated).any())
        step += 1
    print(f"{args.drones} drones: {'all at their goals' if envs.batch.success.all() else 'not all at their goals'}")
    envs.close()


def main(args: Args) -> None:
    """Fly and write the film."""
    film = list(pictures(flockstep.PPO.load(args.policy), args))
    durations = [*[STEP_MS] * (len(film) - 1), HOLD_MS]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    film[0].save(
        args.out, save_all=True, append_images=film[1:], duration=durations, loop=0, quality=args.quality, method=6
    )
    print(f"{args.out}: {len(film)} pictures, {args.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(tyro.cli(Args))
