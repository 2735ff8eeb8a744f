"""One env of several drones as a PettingZoo `ParallelEnv`; `flockstep.parallel_env` makes it."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

try:
    from pettingzoo import ParallelEnv
except ImportError as _error:
    _needed = f"flockstep.parallel_env needs PettingZoo: pip install 'flockstep[pettingzoo]' ({_error})"
    raise type(_error)(_needed, name=_error.name) from _error

from flockstep._core import Batch
from flockstep.errors import refuse_masked
from flockstep.pictures.shown import require_render_mode
from flockstep.registration import make_by_id
from flockstep.stepping import Observation
from flockstep.vector_env import DroneVectorEnv

__all__ = ["DroneParallelEnv", "parallel_env"]

_FIXED = ("num_envs", "drones_per_env", "episodes", "autoreset_mode", "copy")


class DroneParallelEnv(ParallelEnv[str, Observation, Any]):  # type: ignore[misc] # PettingZoo ships no types
    """The drones of one env as agents, ``"drone_0"``, ``"drone_1"`` and so on.

    All episodes begin with a reset. An agent whose episode has ended leaves `agents` and does not return before the
    next reset: its drone is inactive. After ``reset(seed=s)`` the drones fly as those of env s of a `DroneVectorEnv`
    with ``episodes="last"`` and seed 0, in the same world.

    Attributes
    ----------
    envs
        The `DroneVectorEnv` of one env.
    batch
        The `Batch` that simulates the drones; `close` releases it.
    possible_agents
        All agents.
    agents
        The agents whose episodes go on.
    state_space
        Space of `state`.
    render_mode
        None, ``"human"`` or ``"rgb_array"``.
    metadata
        Name, render modes and pictures per second, for PettingZoo.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "flockstep",
        "render_modes": DroneVectorEnv.metadata["render_modes"],
        "is_parallelizable": True,
    }

    def __init__(self, envs: DroneVectorEnv) -> None:
        self.envs = envs
        self.render_mode = envs.render_mode
        self.metadata = {**self.metadata, "render_fps": envs.metadata["render_fps"]}
        self.possible_agents = [f"drone_{row}" for row in range(envs.num_envs)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: deepcopy(envs.single_observation_space) for agent in self.possible_agents}
        self.action_spaces = {agent: deepcopy(envs.single_action_space) for agent in self.possible_agents}
        flat: Any = gymnasium.spaces.flatten_space(envs.single_observation_space)
        low, high = np.tile(flat.low, envs.num_envs), np.tile(flat.high, envs.num_envs)
        self.state_space = gymnasium.spaces.Box(low, high, dtype=flat.dtype)
        self._was_reset = False

    @property
    def batch(self) -> Batch:
        """The `Batch`, until `close`."""
        return self.envs.batch

    @property
    def np_random(self) -> np.random.Generator:
        """Random numbers for wrappers such as SuperSuit's ``frame_skip_v0``, seeded by `reset`; flights draw others."""
        return self.envs.np_random

    def observation_space(self, agent: str) -> gymnasium.spaces.Space[Any]:
        """Return the observation space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.spaces.Space[Any]:
        """Return the action space of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin the first episode of ``seed``, or the next one of the current seed. There are no options."""
        del options
        observation, _ = self.envs.reset(seed=seed)
        self.agents = self.possible_agents[:]
        self._was_reset = True
        return self._by_agent(observation, range(len(self.agents))), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly one step with an action of each agent.

        The info of an agent whose episode has ended holds what `DroneVectorEnv` reports; others are empty. If no agent
        is left, a step without actions does nothing and returns empty dicts, as PettingZoo's wrappers expect.

        Raises
        ------
        ValueError
            The action of an agent is missing or not in its space, or another one is given; nothing has changed.
        gymnasium.error.ResetNeeded
            `step` was called before the first `reset`.
        """
        if not self._was_reset:
            raise ResetNeeded("call reset before step")
        if not self.agents and not actions:
            return {}, {}, {}, {}, {}
        rows = [self._row_of(agent) for agent in self.agents]
        observation, reward, terminated, truncated, _ = self.envs.step(self._actions(actions))
        ended = [row for row in rows if terminated[row] or truncated[row]]
        infos: dict[str, dict[str, Any]] = {agent: {} for agent in self.agents}
        if ended:
            report = self.envs.episode_infos(np.array(ended))
            for k, row in enumerate(ended):
                infos[self.possible_agents[row]] = _nth(report, k)
        results = (
            self._by_agent(observation, rows),
            {agent: float(reward[row]) for agent, row in zip(self.agents, rows, strict=True)},
            {agent: bool(terminated[row]) for agent, row in zip(self.agents, rows, strict=True)},
            {agent: bool(truncated[row]) for agent, row in zip(self.agents, rows, strict=True)},
            infos,
        )
        self.agents = [agent for agent, row in zip(self.agents, rows, strict=True) if row not in ended]
        return results

    def state(self) -> npt.NDArray[Any]:
        """Return the observations of all drones as one vector; of drones whose episodes have ended, the last ones."""
        if not self._was_reset:
            raise ResetNeeded("call reset before state")
        rows = self._by_agent(self.envs.observation(), range(self.envs.num_envs)).values()
        flat: list[Any] = [gymnasium.spaces.flatten(self.envs.single_observation_space, row) for row in rows]
        return np.concatenate(flat, dtype=self.state_space.dtype)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the env, (height, width, 3) uint8, or None without a render mode.

        It follows the first agent.
        """
        row = self._row_of(self.agents[0]) if self.agents else 0
        frames = self.envs.render([row])
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Release the batch."""
        self.agents = []
        self._was_reset = False
        self.envs.close()

    def _row_of(self, agent: str) -> int:
        return int(agent.removeprefix("drone_"))

    def _by_agent(self, observation: Observation, rows: Any) -> dict[str, Observation]:
        """Return the rows of an observation by the names of their agents."""
        if isinstance(observation, dict):
            return {self.possible_agents[row]: {name: part[row] for name, part in observation.items()} for row in rows}
        return {self.possible_agents[row]: observation[row] for row in rows}

    def _actions(self, actions: Mapping[str, Any]) -> npt.NDArray[Any]:
        """Return the actions as rows for the engine; those of inactive drones are arbitrary."""
        if not isinstance(actions, Mapping):
            raise TypeError(f"actions: expected a dict by agent, got {type(actions).__name__}")
        expected = f"actions: expected one for each of {', '.join(self.agents)}"
        if not self.agents:
            expected = "actions: expected none, since all episodes are over: call reset"
        for agent in actions:
            if agent not in self.agents:
                why = "whose episode has ended" if agent in self.possible_agents else "which is not an agent"
                raise ValueError(f"{expected}, got one for {agent!r}, {why}")
        for agent in self.agents:
            if agent not in actions:
                raise ValueError(f"{expected}, got none for {agent!r}")
        space = self.envs.single_action_space
        rows = np.zeros((self.envs.num_envs, *(space.shape or ())), space.dtype)
        if isinstance(space, gymnasium.spaces.Discrete):
            rows += space.start
        for agent, action in actions.items():
            refuse_masked(f"actions[{agent!r}]", action)
            given = np.asarray(action)
            if given.shape != rows.shape[1:] or not np.can_cast(given.dtype, rows.dtype, "same_kind"):
                raise ValueError(f"actions[{agent!r}]: expected one in {space}, got {action!r}")
            if isinstance(space, gymnasium.spaces.Discrete) and not space.contains(given.astype(space.dtype)[()]):
                raise ValueError(f"actions[{agent!r}]: expected one in {space}, got {action!r}")
            if not np.isfinite(given).all():
                raise ValueError(f"actions[{agent!r}]: expected finite numbers, got {action!r}")
            rows[self._row_of(agent)] = given
        return rows


def parallel_env(
    task: Any = "flockstep/LidarNavigation-v0",
    num_drones: int = 2,
    *,
    render_mode: str | None = None,
    **kwargs: Any,
) -> DroneParallelEnv:
    """Return one env of several drones as a PettingZoo `ParallelEnv`.

    Parameters
    ----------
    task
        A Gymnasium id of this package, a task as for `DroneVectorEnv`, or None for the navigation task.
    num_drones
        Number of agents.
    render_mode
        None, or ``"rgb_array"``: `DroneParallelEnv.render` returns a picture.
    **kwargs
        Keywords of `DroneVectorEnv`, except ``num_envs``, ``drones_per_env``, ``episodes``, ``autoreset_mode`` and
        ``copy``. With several worlds the drones stay in the first one, unless ``random_world=True``, which draws one
        for each episode. ``render_view`` is ``"fleet"`` by default.

    Raises
    ------
    TypeError
        A keyword is not allowed.
    ValueError
        A value is out of range; the message names it.
    """
    require_render_mode(render_mode)
    fixed = [name for name in _FIXED if name in kwargs]
    if fixed:
        raise TypeError(f"parallel_env: {' and '.join(fixed)} cannot be chosen: give num_drones")
    if not isinstance(num_drones, (int, np.integer)) or isinstance(num_drones, bool) or num_drones < 1:
        raise ValueError(f"num_drones: expected an integer >= 1, got {num_drones!r}")
    keywords: dict[str, Any] = {"render_view": "fleet", **kwargs, "render_mode": render_mode}
    keywords |= {"drones_per_env": int(num_drones), "episodes": "last", "autoreset_mode": "disabled", "copy": True}
    if isinstance(task, str):
        return DroneParallelEnv(make_by_id(task, 1, **keywords))
    return DroneParallelEnv(DroneVectorEnv(1, task=task, **keywords))


def _nth(report: Mapping[str, Any], k: int) -> dict[str, Any]:
    """Return the infos of one row."""
    return {name: _nth(part, k) if isinstance(part, dict) else part[k].item() for name, part in report.items()}
