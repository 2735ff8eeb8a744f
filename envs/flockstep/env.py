"""One drone as a plain Gymnasium environment."""

from __future__ import annotations

import inspect
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from flockstep import serialization
from flockstep._core import Batch
from flockstep.errors import refuse_masked
from flockstep.pictures.shown import require_render_mode
from flockstep.stepping import Observation
from flockstep.vector_env import DroneVectorEnv


class DroneEnv(gymnasium.Env[Observation, Any]):
    """A `DroneVectorEnv` of one drone, for `gymnasium.make` and other code that needs a single env.

    Takes the keywords of `DroneVectorEnv` except ``num_envs``, ``drones_per_env``, ``autoreset_mode`` and ``copy``.
    With several worlds the drone stays in the first one, unless ``random_world=True``, which draws one for each
    episode.

    ``gymnasium.make(..., max_episode_steps=n)`` sets the engine's time limit in control steps. Gymnasium also adds its
    `TimeLimit` wrapper, which counts calls of `step` and never ends an episode before the engine does. -1 means no
    limit.

    Attributes
    ----------
    envs
        The `DroneVectorEnv` of one drone.
    batch
        The `Batch` that simulates the drone; `close` releases it.
    observation_space, action_space
        As in `gymnasium.Env`.
    render_mode
        None, ``"human"`` or ``"rgb_array"``.
    metadata
        Render modes and pictures per second, for Gymnasium.
    spec
        The `gymnasium.envs.registration.EnvSpec` that made the env, or None.
    """

    metadata: dict[str, Any] = {key: DroneVectorEnv.metadata[key] for key in ("render_modes", "render_fps")}  # noqa: RUF012

    spec: Any = serialization.PlainSpec()

    def __init__(self, *, render_mode: str | None = None, **kwargs: Any) -> None:
        require_render_mode(render_mode)
        if kwargs.get("drones_per_env", 1) != 1:
            raise TypeError(
                f"drones_per_env: expected 1 for a single env, got {kwargs['drones_per_env']!r}; for several drones "
                "use gymnasium.make_vec or flockstep.DroneVectorEnv"
            )
        if "num_envs" in kwargs:
            raise TypeError("num_envs: gymnasium.make makes one env; for several, use gymnasium.make_vec")
        limit = _limit_of_make()
        if limit is not None:
            kwargs["max_episode_steps"] = max(limit, 0)
        kwargs |= {"drones_per_env": 1, "autoreset_mode": "disabled", "copy": True}
        self.envs = DroneVectorEnv(1, render_mode=render_mode, **kwargs)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.envs.metadata["render_fps"]}
        self.observation_space = self.envs.single_observation_space
        self.action_space = self.envs.single_action_space

    @property
    def batch(self) -> Batch:
        """The `Batch` of one drone, until `close`."""
        return self.envs.batch

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode: the first one of ``seed``, or the next one of the current seed."""
        super().reset(seed=seed)
        observation, _ = self.envs.reset(seed=seed)
        return _only(observation), {}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly one step.

        In every step, the info holds the current values of what `DroneVectorEnv` reports only at the end of an episode.
        """
        refuse_masked("action", action)
        observation, reward, terminated, truncated, _ = self.envs.step(np.asarray(action)[None])
        info = _only_info(self.envs.episode_infos())
        return _only(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture, (height, width, 3) uint8, or None without a render mode."""
        frames = self.envs.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Release the batch."""
        self.envs.close()


def _limit_of_make() -> int | None:
    """Return the time limit in steps if `gymnasium.make` is making a `DroneEnv`; -1 means none.

    `gymnasium.make` keeps ``max_episode_steps`` for its `TimeLimit` wrapper and does not pass it to the env. The engine
    also needs it: it decides at the limit whether an episode is a success, and must not end episodes earlier.
    """
    frame = inspect.currentframe()
    for _ in range(2):  # DroneEnv.__init__ and its caller
        frame = None if frame is None else frame.f_back
    if frame is None or frame.f_code is not gymnasium.make.__code__:
        return None
    given: int | None = frame.f_locals["max_episode_steps"]
    if given is None and "env_spec" in frame.f_locals:
        given = frame.f_locals["env_spec"].max_episode_steps
    return given


def _only_info(infos: dict[str, Any]) -> dict[str, Any]:
    """Return the infos of the one env."""
    return {key: _only_info(value) if isinstance(value, dict) else value[0].item() for key, value in infos.items()}


def _only(observation: Observation) -> Observation:
    """Return the observation of the one env."""
    if isinstance(observation, dict):
        return {key: part[0] for key, part in observation.items()}
    row: npt.NDArray[Any] = observation[0]
    return row
