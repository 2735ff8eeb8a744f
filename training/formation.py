"""Formation: environments for training, flights that judge a policy, and a flyer to compare with.

.venv/bin/python -m training.formation             # the flyer, straight to the places
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import flockstep
from training.tasks import TRAINING_SEEDS, UNSEEN_SEEDS

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]
Kind = Literal["hall", "playground"]

MOST_STEPS: dict[Kind, int] = {"hall": 300, "playground": 400}
DRONES = 4
KINDS: tuple[Kind, ...] = ("hall", "playground")
NUM_WORLDS = 100  # playgrounds for training
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


def keywords_of(kind: Kind, seeds: range, count: int) -> dict[str, Any]:
    """Return the keywords of environments in halls or playgrounds."""
    if kind == "hall":
        return {"task": flockstep.FormationConfig(), "max_episode_steps": MOST_STEPS[kind]}
    worlds = [flockstep.World.playground(seed) for seed in seeds[:count]]
    task = flockstep.FormationConfig(route="path", shape="column", spacing_m=1.3)
    return {"task": task, "worlds": worlds, "max_episode_steps": MOST_STEPS[kind]}


def make(num_envs: int, threads: int, kind: Kind = "hall") -> flockstep.DroneVectorEnv:
    """Make the environments for training."""
    keywords = keywords_of(kind, TRAINING_SEEDS, NUM_WORLDS)
    return flockstep.DroneVectorEnv(
        num_envs,
        drones_per_env=DRONES,
        random_world=kind != "hall",
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
        **keywords,
    )


def fly(predict: Predict, flights: int, seed: int, kind: Kind = "hall") -> Formations:
    """Fly one episode in each of several envs; the seeds of worlds and flights begin with this one."""
    envs = flockstep.DroneVectorEnv(
        flights,
        drones_per_env=DRONES,
        autoreset_mode="disabled",
        copy=False,
        **keywords_of(kind, range(seed, seed + flights), flights),
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
    """Return the actions of drones that fly straight to their places."""
    offset = 2 * observation[:, :3] / 0.15
    return np.asarray(offset / np.maximum(np.abs(offset).max(axis=1, keepdims=True), 1), np.float32)


def main() -> None:
    """Fly the flyer."""
    for kind in KINDS:
        flown = fly(straight, 200, UNSEEN_SEEDS.start, kind)
        print(
            f"straight, {kind}: {flown.success.mean():.1%} of 200 flights succeed, {flown.touched.mean():.1%} touch, "
            f"error {flown.error.mean():.3f} m"
        )


if __name__ == "__main__":
    main()
