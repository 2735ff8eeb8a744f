"""Flights of the tasks Hover and Track by a policy or by only the controller, with distances to the target point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

import flockstep
from flockstep.rotations import rotate

Array = npt.NDArray[Any]
Name = Literal["hover", "track"]
#: A function of observations (N, ...) and the envs that returns actions (N, 4).
Pilot = Callable[[Array, flockstep.DroneVectorEnv], Array]

POLICY_HZ: dict[Name, float] = {"hover": 50.0, "track": 100.0}
LASTS_S: dict[Name, int] = {"hover": 6, "track": 10}
CLOSE_M = 0.05


def make(task: Name, num_envs: int, /, **keywords: Any) -> flockstep.DroneVectorEnv:
    """Return the envs of a task as reported; keywords may change them."""
    config = flockstep.HoverConfig() if task == "hover" else flockstep.TrackConfig()
    return flockstep.DroneVectorEnv(num_envs, **{"task": config, "policy_hz": POLICY_HZ[task], **keywords})


@dataclass(frozen=True)
class Flights:
    """Several flights of a task, all of the same length."""

    task: Name
    distance_m: Array
    """(T, N) distance to the point after each step; NaN once a flight has ended as a crash."""

    @property
    def crashed(self) -> Array:
        """(N,) bool: flights that ended as a crash."""
        return np.isnan(self.distance_m[-1])

    @property
    def error_m(self) -> Array:
        """(N,) m, NaN for a crash. Hover: mean distance of the last second. Track: root mean square of the flight."""
        if self.task == "hover":
            return np.asarray(self.distance_m[-round(POLICY_HZ[self.task]) :].mean(0))
        return np.asarray(np.sqrt((self.distance_m**2).mean(0)))

    @property
    def close_rate(self) -> float:
        """Return the share of all flights with an error of at most 5 cm; a crash counts as a miss."""
        return float((self.error_m <= CLOSE_M).mean())

    @property
    def median_error_m(self) -> float:
        """Return the median error in m of the flights without a crash; infinite if all crashed."""
        return float("inf") if self.crashed.all() else float(np.nanmedian(self.error_m))

    def summary(self) -> str:
        """Return a one-line summary."""
        return (
            f"{self.close_rate:.1%} within {100 * CLOSE_M:g} cm, {self.crashed.mean():.1%} crashed, "
            f"error of the others {100 * self.median_error_m:.1f} cm (median)"
        )


def fly(name: Name, pilot: Pilot, num_flights: int, seed: int, **keywords: Any) -> Flights:
    """Fly one flight for each of the seeds that begin with this one.

    Parameters
    ----------
    name, pilot, num_flights, seed
        Task, pilot, number of parallel flights, and first seed.
    **keywords
        Keywords of `DroneVectorEnv`, such as ``drone``, or ``task`` for another configuration.
    """
    steps = round(LASTS_S[name] * POLICY_HZ[name])
    # The last step's observation also counts: only a crash ends an episode before it.
    envs = make(name, num_flights, max_episode_steps=steps + 1, copy=False, **keywords)
    observation, _ = envs.reset(seed=seed)
    distance = np.full((steps, num_flights), np.nan)
    flying = np.ones(num_flights, bool)
    for step in range(steps):
        observation, _, terminated, _, _ = envs.step(pilot(np.asarray(observation), envs))
        flying &= ~terminated
        distance[step, flying] = np.linalg.norm(np.asarray(observation)[flying, :3], axis=1)
    return Flights(name, distance)


def greedy(model: BaseAlgorithm) -> Pilot:
    """Return a model's policy without exploration."""

    def act(observation: Array, envs: flockstep.DroneVectorEnv) -> Array:
        del envs
        with torch.no_grad():
            return np.asarray(model.predict(observation, deterministic=True)[0])

    return act


def position_control() -> Pilot:
    """Return the controller cascade as a pilot that commands the point's position; the env's control is "position"."""

    def act(observation: Array, envs: flockstep.DroneVectorEnv) -> Array:
        actions = np.zeros((len(observation), 4), np.float32)
        actions[:, :3] = np.clip(rotate(envs.batch.quat_wxyz, observation[:, :3]), -1, 1)
        return actions

    return act


def velocity_control(task: flockstep.TrackConfig, point: int, gain: float, towards: int = 0) -> Pilot:
    """Return the controller cascade as a pilot that commands a path's velocity; the env's control is "velocity".

    The velocity is the path's at the observed point ``point``, plus ``gain`` (1/s) times the offset to the observed
    point ``towards``; point 0 is the path's current position.
    """

    def act(observation: Array, envs: flockstep.DroneVectorEnv) -> Array:
        here, next_one, aim = (observation[:, 3 * i : 3 * i + 3] for i in (point, point + 1, towards))
        velocity = rotate(envs.batch.quat_wxyz, (next_one - here) / task.ahead_s + gain * aim)
        missing_yaw = np.arctan2(observation[:, -2], observation[:, -1])
        dynamics = envs.batch.dynamics
        yaw_rate = 2 * missing_yaw / np.radians(dynamics.max_yaw_rate_dps)
        return np.clip(np.column_stack([velocity / dynamics.max_speed_mps, yaw_rate]), -1, 1).astype(np.float32)

    return act
