"""SideBySide: several environments with equal spaces as one, so that a policy learns from all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from flockstep.sb3 import DroneVecEnv

Array = npt.NDArray[Any]


class SideBySide(VecEnv):
    """The rows of the first environment, then those of the second, and so on. Observations are one array."""

    def __init__(self, envs: Sequence[DroneVecEnv]) -> None:
        self.envs = tuple(envs)
        first = self.envs[0]
        for env in self.envs:
            for name in ("observation_space", "action_space"):
                own, expected = getattr(env, name), getattr(first, name)
                if own != expected:
                    raise ValueError(f"envs: expected the {name} of the first, {expected}, got {own}")
        self._splits = np.cumsum([env.num_envs for env in self.envs])
        self._actions: list[Array] = []
        super().__init__(int(self._splits[-1]), first.observation_space, first.action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed of the first row at the next reset; the other rows have the following ones."""
        firsts = [0, *self._splits[:-1].tolist()]
        pairs = zip(self.envs, firsts, strict=True)
        return [own for env, first in pairs for own in env.seed(None if seed is None else seed + first)]

    def reset(self) -> Array:
        """Begin episodes in all environments."""
        return np.concatenate([env.reset() for env in self.envs])

    def step_async(self, actions: Array) -> None:
        """Take the actions of the next step."""
        self._actions = np.split(actions, self._splits[:-1])

    def step_wait(self) -> Any:
        """Step all environments."""
        stepped = [env.step(own) for env, own in zip(self.envs, self._actions, strict=True)]
        observation, reward, done = (np.concatenate([each[i] for each in stepped]) for i in range(3))
        return observation, reward, done, [info for each in stepped for info in each[3]]

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each row."""
        every = [value for env in self.envs for value in env.get_attr(attr_name)]
        return [every[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of all environments."""
        for env in self.envs:
            env.set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of all environments."""
        return [result for env in self.envs for result in env.env_method(method_name, *args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each row."""
        return [False] * self.num_envs
