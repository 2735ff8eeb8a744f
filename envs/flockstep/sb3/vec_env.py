"""A `DroneVectorEnv` as a `VecEnv` of Stable-Baselines3."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from flockstep import stepping
from flockstep._core import NativeTask
from flockstep.registration import make_same_step
from flockstep.stepping import Observation
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv


def make_vec(
    env: str | Task | type[Task] | NativeTask | DroneVectorEnv = "flockstep/LidarNavigation-v0",
    num_envs: int = 1,
    **kwargs: Any,
) -> DroneVecEnv:
    """Return a Stable-Baselines3 `VecEnv`.

    Parameters
    ----------
    env
        A Gymnasium id of this package, your own `Task` (an object, or its class) or `NativeTask`, or a finished
        `DroneVectorEnv` with same-step autoreset (then without ``num_envs`` and keywords). A task can also be given as
        ``task=``, as for `DroneVectorEnv`.
    num_envs
        Number of envs. Each has one drone unless ``drones_per_env`` is larger.
    **kwargs
        Keywords of `DroneVectorEnv`, except ``autoreset_mode`` and ``copy``.
    """
    if isinstance(env, DroneVectorEnv):
        if num_envs not in (1, env.num_envs, env.num_groups) or kwargs:
            raise TypeError("make_vec: expected no num_envs or keywords with an env that exists already")
        return DroneVecEnv(env)
    return DroneVecEnv(make_same_step("make_vec", env, num_envs, **kwargs))


#: Info of a finished row; all such rows share it.
_FINISHED = {"finished": True}


class DroneVecEnv(VecEnv):
    """A `DroneVectorEnv` with the `VecEnv` interface of Stable-Baselines3.

    Observations are views of two alternating buffers, so the previous observation is still intact when
    Stable-Baselines3 stores it. Rewards are new arrays, because Stable-Baselines3 writes into them. All envs whose
    episode continues share one empty info dict; do not write into it.

    Infos at the end of an episode are ``terminal_observation``, ``TimeLimit.truncated``, ``is_success``, and
    ``episode`` in the format of `Monitor`: return ``r``, length ``l``, and ``t``, seconds since this object was made.
    Further infos are ``episode_end``, a value of `EpisodeEnd`; ``crashed``; ``bad_state``; ``episode_terms``, the sum
    of each reward term by name; and the values that a `Task` names in its ``info_names``. `LogTerms` logs means of the
    terms and of chosen infos. With ``episodes="last"`` a finished row has the info ``finished``, reward 0, the
    observation of an absent drone, and is not done again.
    """

    _options_of_all: dict[str, Any] | None = None  # for the next reset

    def __init__(self, env: DroneVectorEnv) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"env: expected same-step autoreset (autoreset_mode='same_step'), got {env.autoreset_mode}"
            )
        self.env = env
        self._batch = env.batch
        self._actions: npt.NDArray[Any] | None = None
        self._created = time.perf_counter()
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata["render_fps"] = env.metadata["render_fps"]

    def reset(self) -> Observation:
        """Begin new episodes with the seeds given to `seed` since the last reset, and return the observation."""
        seeds = [seed for seed in self._seeds if seed is not None][: self.env.num_groups]  # one for each env
        options = self._options_of_all
        self._reset_options()  # even if the env rejects them
        observation, _ = self.env.reset(seed=seeds or None, options=options)
        self._reset_seeds()
        return observation

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set the options of the next `reset`, in the format of `DroneVectorEnv.reset`.

        Raises
        ------
        ValueError
            A list with a non-empty dict: the envs share one reset.
        """
        if isinstance(options, list):
            if any(options):
                raise ValueError("options: expected one dict, since the envs share a reset, got a list of them")
            options = None
        super().set_options(options)
        self._options_of_all = options or None

    def _reset_options(self) -> None:
        super()._reset_options()
        self._options_of_all = None

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Fly one step and return observation, reward, done and infos."""
        assert self._actions is not None, "call step_async before step_wait"
        batch = self._batch
        batch.step(self._actions)
        self.env._flown(self._actions)
        truncated = batch.truncated
        done = batch.terminated | truncated
        going_on: dict[str, Any] = {}
        infos = [going_on] * self.num_envs
        finished = self.env._finished()
        if finished is not None:
            for row in np.flatnonzero(finished).tolist():
                infos[row] = _FINISHED
        if np.count_nonzero(done):
            seconds = round(time.perf_counter() - self._created, 6)
            ended = np.flatnonzero(done)
            for row, info in zip(ended.tolist(), stepping.ends(self.env, ended, seconds), strict=True):
                infos[row] = info
        return self.env.observation(), self.env.scaled_reward().copy(), done, infos

    def _waiting(self) -> npt.NDArray[np.bool_]:
        return self.env._waiting()

    def close(self) -> None:
        """Close the env."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the env for each index: its rows if it has N rows, otherwise the same value."""
        values = self.env.get_attr(attr_name)
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the env. All drones share it, so ``indices`` must select all of them."""
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise ValueError(f"{attr_name}: the drones share it, so it cannot be set for some of them")
        self.env.set_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the env once and return the result for each index."""
        values = self.env.call(method_name, *method_args, **method_kwargs)
        return [values[i] for i in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return True only for `Monitor`, whose values are already in the infos."""
        return [issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Return a picture of each env, (height, width, 3) uint8."""
        return self.env.render() or [None] * self.num_envs
