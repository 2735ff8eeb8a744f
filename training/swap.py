"""Swap: environments for training, flights that judge a policy, and a flyer to compare with.

.venv/bin/python -m training.swap                  # the flyer, straight to the goal
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import flockstep
from flockstep.sb3 import DroneVecEnv
from training.side_by_side import SideBySide
from training.tasks import UNSEEN_SEEDS

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]

MOST_STEPS = 300  # of the flights that judge
DRONES = 8  # in each env of the flights that judge
#: Drones that train at once, by their number in an env. Policies that trained with one number failed with others.
TRAINING_DRONES = {2: 128, 4: 128, 8: 128, 16: 384}
#: Numbers of drones of the flights that judge.
JUDGED = (2, 4, 8, 16, 32)
#: Found with the seeds 100 and 101.
STEPS, TRAINING_STEPS = 20_000_000, 150
SETTINGS: dict[str, Any] = {
    "n_steps": 32,
    "batch_size": 4096,
    "n_epochs": 3,
    "learning_rate": 1e-3,
    "gamma": 0.97,
    "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.7},
}


@dataclass(frozen=True)
class Swaps:
    """Episodes of several drones."""

    success: Array
    """(E,) bool: all drones exchanged their places without touching."""
    touched: Array
    """(E,) bool: the episode ended in a contact."""
    seconds: Array
    """(E,) s: the length of the episode."""


def make(_: int, threads: int) -> SideBySide:
    """Make the environments for training: envs of each number of drones."""
    task: dict[str, Any] = {
        "task": flockstep.SwapConfig(),
        "max_episode_steps": TRAINING_STEPS,
        "stagger_first_episode": True,
    }
    return SideBySide(
        [
            DroneVecEnv(
                flockstep.DroneVectorEnv(
                    together // drones,
                    **task,
                    drones_per_env=drones,
                    autoreset_mode="same_step",
                    copy=False,
                    num_threads=threads,
                )
            )
            for drones, together in TRAINING_DRONES.items()
        ]
    )


def fly(predict: Predict, swaps: int, seed: int, drones: int = DRONES) -> Swaps:
    """Fly one episode in each of several envs, whose seeds begin with this one."""
    envs = flockstep.DroneVectorEnv(
        swaps,
        task=flockstep.SwapConfig(),
        drones_per_env=drones,
        max_episode_steps=MOST_STEPS,
        autoreset_mode="disabled",
        copy=False,
    )
    observation, _ = envs.reset(seed=seed)
    flying = np.ones(swaps, bool)
    success, touched = np.zeros((2, swaps), bool)
    steps = np.zeros(swaps)
    for _ in range(MOST_STEPS):
        observation, _, terminated, truncated, _ = envs.step(predict(observation))
        steps += flying
        ended = flying & (terminated | truncated).reshape(swaps, drones).any(axis=1)
        success[ended] = envs.batch.success.reshape(swaps, drones).all(axis=1)[ended]
        touched[ended] = envs.batch.crashed.reshape(swaps, drones).any(axis=1)[ended]
        flying &= ~ended
        if not flying.any():
            break
    policy_hz = envs.batch.clock.policy_hz
    envs.close()
    return Swaps(success, touched, steps / policy_hz)


def straight(observation: Array) -> Array:
    """Return the actions of drones that fly straight to their goals, and slow down within 0.15 m of them."""
    most = np.minimum(observation[:, 2:3] * 10 / 0.15, 1)
    return np.asarray(observation[:, :2] * most, np.float32)


def main() -> None:
    """Fly the flyer."""
    for drones in JUDGED:
        flown = fly(straight, 1000, UNSEEN_SEEDS.start, drones)
        print(f"straight, {drones} drones: {flown.success.mean():.1%} of 1,000 swaps, {flown.touched.mean():.1%} touch")


if __name__ == "__main__":
    main()
