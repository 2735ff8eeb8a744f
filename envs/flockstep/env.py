"""One drone as a plain Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from flockstep import plain
from flockstep.vector_env import DroneVectorEnv, Observation


class DroneEnv(gymnasium.Env[Observation, Any]):
    """A `DroneVectorEnv` of one drone, for `gymnasium.make` and whoever wants a single env.

    Takes the keywords of `DroneVectorEnv` except ``num_envs``, ``autoreset_mode`` and ``copy``. With several worlds the
    drone stays in the first, unless ``random_world=True`` draws one for each episode.

    ``gymnasium.make(..., max_episode_steps=n)`` is Gymnasium's own wrapper around it: it cuts off an episode after n
    calls of `step`, whose info is as whole as at an end of the engine's. A limit beyond the task's own needs
    ``DroneEnv(max_episode_steps=n)``, which Gymnasium cannot pass on.
    """

    metadata: dict[str, Any] = {key: DroneVectorEnv.metadata[key] for key in ("render_modes", "render_fps")}  # noqa: RUF012

    spec: Any = plain.PlainSpec()

    def __init__(self, *, render_mode: str | None = None, **kwargs: Any) -> None:
        self.envs = DroneVectorEnv(1, autoreset_mode="disabled", copy=True, render_mode=render_mode, **kwargs)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.envs.metadata["render_fps"]}
        self.observation_space = self.envs.single_observation_space
        self.action_space = self.envs.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode: the first one of ``seed``, or the next one of the present seed."""
        super().reset(seed=seed)
        observation, _ = self.envs.reset(seed=seed)
        return _only(observation), {}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly one step. The info has what `DroneVectorEnv` reports of an episode that ended, in every step: so far."""
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


def _only_info(infos: dict[str, Any]) -> dict[str, Any]:
    """Return the infos of the one env."""
    return {key: _only_info(value) if isinstance(value, dict) else value[0].item() for key, value in infos.items()}


def _only(observation: Observation) -> Observation:
    """Return the observation of the one env."""
    if isinstance(observation, dict):
        return {key: part[0] for key, part in observation.items()}
    row: npt.NDArray[Any] = observation[0]
    return row
