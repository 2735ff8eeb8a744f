"""Formation: environments for training, flights that judge a policy, and flyers to compare with.

.venv/bin/python -m training.formation             # the flyers, straight to the places
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
Kind = Literal["hall", "playground", "warehouse"]

MOST_STEPS: dict[Kind, int] = {"hall": 300, "playground": 400, "warehouse": 1500}
DRONES = 4
STEP_M = 0.15  # of a full action
KINDS: tuple[Kind, ...] = ("hall", "playground", "warehouse")
#: Number of worlds of each kind, for training. A warehouse takes about 20 MB.
WORLDS: dict[Kind, int] = {"playground": 100, "warehouse": 16}
UNSEEN_WAREHOUSES = 16  # of the flights that judge
REPEATS = 6  # of the warehouses in the list, so that about half of the episodes are there
#: Found with the seeds 100 and 101.
NUM_ENVS, STEPS = 128, 6_000_000
SETTINGS: dict[str, Any] = {
    "n_steps": 32,
    "batch_size": 4096,
    "n_epochs": 3,
    "learning_rate": 1e-3,
    "gamma": 0.97,
    "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.7},
}


@dataclass(frozen=True)
class Formations:
    """Episodes of several drones."""

    success: Array
    """(E,) bool: all drones held their places without touching."""
    touched: Array
    """(E,) bool: the episode ended in a contact."""
    error: Array
    """(E,) m: mean distance of the drones from their places, over the steps of the episode; at most 2 m each."""


@functools.cache
def world(kind: Kind, seed: int) -> flockstep.World:
    """Generate a world once: a large playground without waypoints, at which a path may turn back, or a warehouse."""
    if kind == "warehouse":
        return flockstep.World.warehouse(seed)
    playground = flockstep.World.playground(seed, size_m=(28.0, 28.0, 5.25))
    return playground.with_markers(start=playground.start, goal=playground.goal)


def make(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
    """Make the environments for training, in playgrounds and warehouses."""
    playgrounds = [world("playground", seed) for seed in TRAINING_SEEDS[: WORLDS["playground"]]]
    warehouses = [world("warehouse", seed) for seed in TRAINING_SEEDS[: WORLDS["warehouse"]]]
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.FormationConfig(route="path"),
        drones_per_env=DRONES,
        worlds=playgrounds + REPEATS * warehouses,
        random_world=True,
        max_episode_steps=MOST_STEPS["warehouse"],
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
    )


def fly(predict: Predict, flights: int, seed: int, kind: Kind = "hall") -> Formations:
    """Fly one episode in each of several envs; the seeds of worlds and flights begin with this one."""
    keywords: dict[str, Any] = {}
    if kind != "hall":
        count = min(flights, UNSEEN_WAREHOUSES) if kind == "warehouse" else flights
        keywords["worlds"] = [world(kind, each) for each in range(seed, seed + count)]
    envs = flockstep.DroneVectorEnv(
        flights,
        task=flockstep.FormationConfig(route="loop" if kind == "hall" else "path"),
        drones_per_env=DRONES,
        max_episode_steps=MOST_STEPS[kind],
        autoreset_mode="disabled",
        copy=False,
        **keywords,
    )
    observation, _ = envs.reset(seed=seed)
    flying = np.ones(flights, bool)
    success, touched = np.zeros((2, flights), bool)
    summed, steps = np.zeros((2, flights))
    for _ in range(MOST_STEPS[kind]):
        observation, _, terminated, truncated, _ = envs.step(predict(observation))
        error = 2 * np.linalg.norm(observation[:, :3], axis=1).reshape(flights, DRONES).mean(axis=1)
        summed += flying * error
        steps += flying
        ended = flying & (terminated | truncated).reshape(flights, DRONES).any(axis=1)
        success[ended] = envs.batch.success.reshape(flights, DRONES).all(axis=1)[ended]
        touched[ended] = envs.batch.crashed.reshape(flights, DRONES).any(axis=1)[ended]
        flying &= ~ended
        if not flying.any():
            break
    envs.close()
    return Formations(success, touched, summed / steps)


def straight(observation: Array) -> Array:
    """Return the actions of drones that fly straight to their places, and so lag one step behind."""
    return _towards(2 * observation[:, :3])


def ahead(observation: Array) -> Array:
    """Return the actions of drones that fly straight to where their places will be after the step."""
    return _towards(2 * observation[:, :3] + np.sqrt(3) * STEP_M * observation[:, 3:6])


def _towards(way: Array) -> Array:
    return np.asarray(way / np.maximum(np.abs(way).max(axis=1, keepdims=True), STEP_M), np.float32)


#: Drones without a policy, by name.
FLYERS: dict[str, Predict] = {"straight": straight, "ahead": ahead}


def main() -> None:
    """Fly the flyers."""
    for name, flyer in FLYERS.items():
        for kind in KINDS:
            flown = fly(flyer, 200, UNSEEN_SEEDS.start, kind)
            print(
                f"{name}, {kind}s: {flown.success.mean():.1%} of 200 flights succeed, {flown.touched.mean():.1%} "
                f"touch, error {flown.error.mean():.3f} m"
            )


if __name__ == "__main__":
    main()
