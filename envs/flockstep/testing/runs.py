"""Runs of an env under random actions, for comparison."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from flockstep._core import Batch

Array: TypeAlias = npt.NDArray[Any]
AnyVectorEnv: TypeAlias = VectorEnv[Any, Any, Any]
MakeEnv: TypeAlias = Callable[[int], AnyVectorEnv]


@dataclass
class Setup:
    """Settings of the checks: the function that makes an env, the number of envs, the length of runs and the seed."""

    make_env: MakeEnv
    num_envs: int
    steps: int
    seed: int

    @contextmanager
    def env(self, num_envs: int | None = None) -> Iterator[AnyVectorEnv]:
        """Make an env and close it at the end."""
        env = self.make_env(self.num_envs if num_envs is None else num_envs)
        try:
            yield env
        finally:
            env.close()


def rows_per_env(env: AnyVectorEnv) -> int:
    """Return the number of rows per env: several if ``num_groups`` groups consecutive rows into one env."""
    groups = int(getattr(env.unwrapped, "num_groups", env.num_envs))
    assert groups > 0 and env.num_envs % groups == 0, (
        f"num_groups: expected a divisor of num_envs ({env.num_envs}), got {groups}"
    )
    return env.num_envs // groups


@dataclass
class Step:
    """The results of one step; every field has a row per env."""

    observation: Any
    reward: Array
    terminated: Array
    truncated: Array
    infos: dict[str, Any]
    before: dict[str, Array]
    """The motion of the drones before the step, by the names of the batch's arrays, if the env has a `Batch`."""

    @property
    def ended(self) -> Array:
        """Mask of the ended episodes, (N,) bool."""
        ended: Array = self.terminated | self.truncated
        return ended


class Actions:
    """Random actions that depend only on the seed, the env's index and the number of previous calls.

    With ``offset``, env i gets the actions of env i + offset.
    """

    def __init__(self, env: AnyVectorEnv, seed: int, offset: int = 0) -> None:
        self._spaces = [copy.deepcopy(env.single_action_space) for _ in range(env.num_envs)]
        for index, space in enumerate(self._spaces):
            space.seed(seed + index + offset)
        self._single = env.single_action_space

    def __call__(self) -> Any:
        """Return the next actions of all envs."""
        samples = [space.sample() for space in self._spaces]
        return _stack(samples)


def _stack(samples: Sequence[Any]) -> Any:
    if isinstance(samples[0], dict):
        return {key: _stack([sample[key] for sample in samples]) for key in samples[0]}
    if isinstance(samples[0], tuple):
        return tuple(_stack(part) for part in zip(*samples, strict=True))
    return np.stack(samples)


def run(
    env: AnyVectorEnv, steps: int, seed: int | None, action_seed: int, offset: int = 0, keep: bool = False
) -> tuple[Any, list[Step]]:
    """Reset and step with random actions; return copies, or with ``keep`` the original arrays."""
    own: Callable[[Any], Any] = (lambda x: x) if keep else copy.deepcopy
    observation = own(env.reset(seed=seed)[0])
    return observation, go_on(env, steps, Actions(env, action_seed, offset), own)


def go_on(env: AnyVectorEnv, steps: int, actions: Actions, own: Callable[[Any], Any] = copy.deepcopy) -> list[Step]:
    """Continue stepping an env; with autoreset disabled, also reset the ended episodes."""
    mode = env.metadata.get("autoreset_mode")
    history = []
    for _ in range(steps):
        before = _motion(env)
        observation, reward, terminated, truncated, infos = own(env.step(actions()))
        step = Step(observation, reward, terminated, truncated, infos, before)
        history.append(step)
        if mode == AutoresetMode.DISABLED and step.ended.any():
            env.reset(options={"reset_mask": step.ended.copy()})
    return history


def _motion(env: AnyVectorEnv) -> dict[str, Array]:
    """Return copies of the arrays of a batch that a reset has to set, with a row for each row of the env."""
    batch = getattr(env.unwrapped, "batch", None)
    if not isinstance(batch, Batch):
        return {}
    names = ("position", "rotation", "velocity", "angular_velocity", "rotor_speed")  # kinematic drones have two of them
    arrays = {name: getattr(batch, name, None) for name in names}
    return {name: np.array(array).reshape(env.num_envs, -1) for name, array in arrays.items() if array is not None}
