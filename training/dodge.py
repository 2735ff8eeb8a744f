"""Dodge: environments for training, flights that judge a policy, and a flyer to compare with.

.venv/bin/python -m training.dodge                  # the flyer, straight to the goal
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import flockstep
from training.tasks import TRAINING_SEEDS, UNSEEN_SEEDS

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]
Kind = Literal["playground", "warehouse"]

MOST_STEPS = 400
#: Number of worlds of each kind, for training. A warehouse takes about 20 MB.
WORLDS: dict[Kind, int] = {"playground": 200, "warehouse": 16}
UNSEEN_WAREHOUSES = 16  # of the flights that judge
REPEATS = 12  # of the warehouses in the list, so that about half of the episodes are there
#: Found with the seeds 100 and 101.
NUM_ENVS, STEPS = 512, 24_000_000
SETTINGS: dict[str, Any] = {
    "n_steps": 32,
    "batch_size": 2048,
    "n_epochs": 4,
    "learning_rate": 1e-3,
    "gamma": 0.99,
    "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.7},
}


@dataclass(frozen=True)
class Dodge:
    """Flights to one goal each."""

    success: Array
    """(N,) bool: reached the goal."""
    crashed: Array
    """(N,) bool: touched something."""
    minutes: float
    """Time of all flights together."""
    by_body: Array
    """(N,) bool: touched a body."""

    def of(self, kind: Kind) -> Array:
        """Return which flights were in worlds of a kind: (N,) bool."""
        return (np.arange(len(self.success)) % 2 == 0) == (kind == "playground")

    @property
    def crashes_per_minute(self) -> float:
        """Return the number of contacts per minute of flight."""
        return float(self.crashed.sum() / self.minutes)


@functools.cache
def world(kind: Kind, seed: int) -> flockstep.World:
    """Generate a world with bodies once."""
    return flockstep.World.load(f"living_{kind}/seed-{seed}")


@functools.cache
def still(living: flockstep.World) -> flockstep.World:
    """Return a world without its bodies."""
    return living.with_bodies([])


def worlds(seeds: range, counts: dict[Kind, int]) -> list[flockstep.World]:
    """Return worlds of all kinds, from the first of these seeds."""
    return [world(kind, seed) for kind, count in counts.items() for seed in seeds[:count]]


def make(num_envs: int, threads: int, *, living: bool = True) -> flockstep.DroneVectorEnv:
    """Make the environments for training, in living worlds or in the same worlds without bodies."""
    made = worlds(TRAINING_SEEDS, {"playground": WORLDS["playground"]})
    made += REPEATS * worlds(TRAINING_SEEDS, {"warehouse": WORLDS["warehouse"]})
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.DodgeConfig(),
        worlds=made if living else [still(each) for each in made],
        random_world=True,
        max_episode_steps=MOST_STEPS,
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
    )


def fly(predict: Predict, flights: int, seed: int) -> Dodge:
    """Fly in living worlds, half of the flights in warehouses; the seeds of worlds and flights begin with this one."""
    warehouses = min(UNSEEN_WAREHOUSES, flights // 2)
    made = worlds(range(seed, seed + flights), {"playground": flights // 2, "warehouse": warehouses})
    half = flights - flights // 2  # every other flight is in a warehouse
    index = np.empty(flights, int)
    index[0::2] = np.arange(half) % (flights // 2)
    index[1::2] = flights // 2 + np.arange(flights // 2) % warehouses
    envs = flockstep.DroneVectorEnv(
        flights,
        task=flockstep.DodgeConfig(),
        worlds=[made[world_index] for world_index in index],
        max_episode_steps=MOST_STEPS,
        autoreset_mode="disabled",
        copy=False,
    )
    observation, _ = envs.reset(seed=seed)
    flying = np.ones(flights, bool)
    success, crashed, by_body = np.zeros((3, flights), bool)
    steps = 0
    for _ in range(MOST_STEPS):
        observation, _, terminated, truncated, _ = envs.step(predict(observation))
        steps += int(flying.sum())
        ended = flying & (terminated | truncated)
        success[ended] = envs.batch.success[ended]
        crashed[ended] = envs.batch.crashed[ended]
        by_body[ended] = envs.batch.crashed[ended] & (envs.batch.contact.body[ended] >= 0)
        flying &= ~ended
        if not flying.any():
            break
    policy_hz = envs.batch.clock.policy_hz
    envs.close()
    return Dodge(success, crashed, steps / policy_hz / 60, by_body)


def straight(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the goal."""
    return np.asarray(observation[:, :2], np.float32)


def main() -> None:
    """Fly the flyer."""
    flown = fly(straight, 1000, UNSEEN_SEEDS.start)
    print(
        f"straight: {flown.success.mean():.1%} of 1,000 flights succeed, {flown.crashed.mean():.1%} end in a contact "
        f"({flown.by_body.mean():.1%} with a body), {flown.crashes_per_minute:.2f} contacts per minute"
    )


if __name__ == "__main__":
    main()
