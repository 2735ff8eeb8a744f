"""Ray RLlib: `configure` sets the environments of a configuration; each runner flies a vector environment.

>>> from ray.rllib.algorithms.ppo import PPOConfig
>>> config = flockstep.rllib.configure(PPOConfig(), "flockstep/LidarNavigation-v0", num_envs=64, seed=7)
>>> algorithm = config.env_runners(num_env_runners=4).build_algo()

RLlib seeds its runner w with ``seed + w``, and Gymnasium seeds env i of a vector environment with its seed + i:
runners of 64 envs would share 63 of them with the next runner. Here the seeds of runner w begin at
``seed + (w - 1) * num_envs``, so all runners together fly the episodes of a single vector environment with the same
total number of envs. A runner that RLlib restarts begins its first episodes again. The runners of an evaluation have
other seeds, and every evaluation flies the same episodes.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from copy import deepcopy
from typing import Any, TypeVar

try:
    import gymnasium
    import ray
    from packaging.requirements import Requirement
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
    from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
except ImportError as _error:
    _needed = "flockstep.rllib needs Ray RLlib and PyTorch: pip install 'flockstep[rllib]' in a separate environment"
    raise type(_error)(f"{_needed} ({_error})", name=_error.name) from _error

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper

from flockstep.registration import make_by_id
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv

__all__ = ["DroneEnvRunner", "DroneEnvs", "configure"]

_Config = TypeVar("_Config", bound=AlgorithmConfig)

_FIRST_EVALUATION_SEED = 1 << 30  # added to the seed for the runners of an evaluation
_FIXED = ("num_envs", "autoreset_mode", "copy")  # RLlib keeps rows and expects next-step autoreset


def _check_gymnasium() -> None:
    """Refuse a Gymnasium other than the one that this version of Ray requires."""
    for line in importlib.metadata.requires("ray") or ():
        needed = Requirement(line)
        wanted = needed.marker is None or needed.marker.evaluate({"extra": "rllib"})
        if needed.name == "gymnasium" and wanted and gymnasium.__version__ not in needed.specifier:
            raise ImportError(
                f"flockstep.rllib: Ray {ray.__version__} needs {needed.name}{needed.specifier}, got "
                f"{gymnasium.__version__}: pip install 'flockstep[rllib]' in a separate environment",
                name="gymnasium",
            )


_check_gymnasium()


class DroneEnvs(VectorWrapper):
    """The environments of a runner, for ``config.environment``.

    Parameters
    ----------
    context
        ``env``, the id or task; ``num_envs``, which RLlib adds; and keywords of `DroneVectorEnv`. Without
        ``num_threads`` there are as many threads as CPUs that Ray grants to the runner.
    """

    first_seed: int | None = None
    """Seed of the first env; set by `DroneEnvRunner`."""

    def __init__(self, context: Mapping[str, Any]) -> None:
        settings = dict(context)
        env, count = settings.pop("env"), settings.pop("num_envs", None)
        if count is None:
            raise ValueError('gym_env_vectorize_mode: expected "vector_entry_point", which configure sets')
        settings.setdefault("num_threads", _granted_cpus())
        if isinstance(env, str):
            super().__init__(make_by_id(env, count, **settings))
        else:
            super().__init__(DroneVectorEnv(count, task=env, **settings))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes. Any seed is replaced by those of the runner."""
        if seed is not None and self.first_seed is None:
            raise RuntimeError("env_runner_cls: expected DroneEnvRunner or a subclass, which spaces the seeds")
        return self.env.reset(seed=seed if seed is None else self.first_seed, options=options)


class DroneEnvRunner(SingleAgentEnvRunner):  # type: ignore[misc] # Ray is missing where types are checked
    """RLlib's runner, with seeds that no other runner has."""

    def make_env(self) -> None:
        """Make the environments and set their seeds."""
        super().make_env()
        envs: VectorEnv[Any, Any, Any] = self.env
        while not isinstance(envs, DroneEnvs):
            if not isinstance(envs, VectorWrapper):
                raise TypeError(f"env: expected flockstep.rllib.DroneEnvs, got {type(envs).__name__}")
            envs = envs.env  # RLlib has wrappers around it
        if self.config.seed is not None:
            first = int(self.config.seed) + (_FIRST_EVALUATION_SEED if self.config.in_evaluation else 0)
            envs.first_seed = first + max(self.worker_index - 1, 0) * self.num_envs  # runner 0 is in the main process


def configure(
    config: _Config, env: str | Task | type[Task], *, num_envs: int, seed: int = 0, **settings: Any
) -> _Config:
    """Set the environments, the runners and the seed of a configuration of RLlib.

    It makes one env to check the settings, because the errors of runners are hard to find.

    Parameters
    ----------
    config
        A configuration such as ``PPOConfig()``, on RLlib's new API stack. It is changed and returned.
    env
        Id of an environment of single drones, or such a task. If another module registers the id: ``"module:id"``.
    num_envs
        Envs of each runner; ``num_envs_per_env_runner``.
    seed
        Seed of the first env of the first runner; also seeds RLlib.
    **settings
        Keywords of `DroneVectorEnv`; ``env_config``. Without ``num_threads`` a runner uses as many threads as Ray
        grants it CPUs (``num_cpus_per_env_runner``).

    Raises
    ------
    ValueError, TypeError, gymnasium.error.Error
        The number of envs or the seed is out of range, RLlib determines a setting, or the env cannot be made.
    """
    for name, value, least in (("num_envs", num_envs, 1), ("seed", seed, 0)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
            raise ValueError(f"{name}: expected an integer >= {least}, got {value!r}")
    fixed = [name for name in _FIXED if name in settings]
    if fixed:
        raise TypeError(f"configure: {' and '.join(fixed)} cannot be chosen: RLlib determines it")
    envs = DroneEnvs({"env": deepcopy(env), "num_envs": 1, **settings})
    drones = envs.num_envs
    envs.close()
    if drones != 1:
        raise ValueError(f"env: expected one drone in each env, got {drones}: see flockstep.parallel_env")
    config.environment(DroneEnvs, env_config={"env": env, **settings})
    config.env_runners(
        env_runner_cls=DroneEnvRunner,
        gym_env_vectorize_mode="vector_entry_point",
        num_envs_per_env_runner=num_envs,
    )
    config.debugging(seed=seed)
    return config


def _granted_cpus() -> int:
    """Return the CPUs that Ray grants to this process; 0 if Ray did not start it."""
    if not ray.is_initialized():  # otherwise the next line would start a cluster
        return 0
    context = ray.get_runtime_context()
    if context.worker.mode != ray.WORKER_MODE:
        return 0
    return max(int(context.get_assigned_resources().get("CPU", 1)), 1)
