"""Environments as a learner steps them: engine tasks, Gymnasium vector envs, and VecEnvs of Stable-Baselines3."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from flockstep import stepping
from flockstep._core import Learner
from flockstep.errors import real_array
from flockstep.learning.networks import actor_space, ends_in
from flockstep.vector_env import DroneVectorEnv

Array = npt.NDArray[Any]


@dataclass
class Episode:
    """An episode that has ended."""

    total: float
    """Sum of the rewards, unscaled."""
    length: int
    """Number of steps."""
    success: float | None
    """1 or 0, or None if the environment does not say."""


@dataclass
class Stepped:
    """Results of a step, for callbacks."""

    rewards: Array
    dones: Array
    infos: list[dict[str, Any]]
    episodes: list[Episode] = field(default_factory=list)


class Source:
    """Steps R rows for a learner."""

    rows: int
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]

    def seed(self, seed: int) -> None:
        """Seed a ``VecEnv``, which uses the seed at its next reset; other environments get theirs from `reset`."""

    def reset(self, seed: int | None) -> None:
        """Begin new episodes. The seed is not for a ``VecEnv``, whose user may have seeded it after `seed`."""
        raise NotImplementedError

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Let the learner act once, and give it the results."""
        raise NotImplementedError

    def observation(self, learner: Learner) -> Array:
        """Return the current observations, (R, k) float32."""
        raise NotImplementedError

    def resume(self) -> None:
        """Go on with the current episodes of the environment, such as those of a snapshot.

        Raises
        ------
        ValueError
            The environment does not return its current observations without a step or a reset.
        """
        raise ValueError(
            "force_reset=False: expected a DroneVectorEnv, which keeps its current observations, after reset() or "
            "restore(); other environments begin new episodes"
        )


class EngineSource(Source):
    """A task in C++, whose steps the learner makes within the engine."""

    def __init__(self, env: DroneVectorEnv, vec_env: Any = None) -> None:
        self.env, self.vec_env = env, vec_env
        self.rows = env.num_envs
        self.observation_space, self.action_space = env.single_observation_space, env.single_action_space
        self._made = time.perf_counter()

    def resume(self) -> None:
        """Go on with the current episodes."""
        _require_episodes(self.env)

    def seed(self, seed: int) -> None:
        """Seed the ``VecEnv``, if there is one."""
        if self.vec_env is not None:
            self.vec_env.seed(seed)

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        stepping.require_open(self.env)
        if self.vec_env is not None:
            self.vec_env.reset()
        else:
            self.env.reset(seed=seed)

    def observation(self, learner: Learner) -> Array:
        """Return the current observations."""
        return learner.read_observation(self.env.batch)

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Fly one step, whose actions are drawn on the threads that fly it."""
        env = self.env
        stepping.require_open(env)
        batch = env.batch
        learner.fly(t, batch, env.reward_scale)
        env._flown(lambda: learner.actions[t])  # a copy of the whole rollout: only for a moment that is shown
        done = (batch.terminated | batch.truncated) & batch.flying
        stepped = Stepped(env.scaled_reward().copy() if needs_infos else env.scaled_reward(), done, [])
        ended = np.flatnonzero(done)
        for row in ended.tolist():
            stepped.episodes.append(
                Episode(float(batch.episode_return[row]), int(batch.episode_length[row]), bool(batch.success[row]))
            )
        if needs_infos:
            going_on: dict[str, Any] = {}
            stepped.infos = [going_on] * self.rows
            seconds = round(time.perf_counter() - self._made, 6)
            for row, info in zip(ended.tolist(), stepping.ends(env, ended, seconds) if ended.size else (), strict=True):
                stepped.infos[row] = info
        if env.autoreset_mode is AutoresetMode.DISABLED and ended.size:
            env.reset(options={"reset_mask": done})
        return stepped


class ArraySource(Source):
    """An environment that takes and returns arrays."""

    env: Any
    _current: Array

    def __init__(self) -> None:
        self._totals = np.zeros(self.rows)
        self._lengths = np.zeros(self.rows, np.int64)

    def observation(self, learner: Learner) -> Array:
        """Return the current observations."""
        del learner
        return self._current

    def flat(self, observation: Any) -> Array:
        """Return observations as rows of numbers; a dict is flattened in the order of its space."""
        return flat_rows(self.observation_space, observation, self.rows)

    def actions(self, drawn: Array) -> Array:
        """Return drawn actions as the environment takes them."""
        space = self.action_space
        if isinstance(space, spaces.Discrete):
            return drawn.astype(np.int64) + int(space.start)
        assert isinstance(space, spaces.Box)
        return np.clip(drawn.reshape(self.rows, *space.shape), space.low, space.high).astype(space.dtype, copy=False)

    def waiting(self) -> Array:
        """Return a mask of the rows that will not fly in the next step."""
        env = getattr(self.env, "unwrapped", self.env)
        waiting = getattr(env, "_waiting", None)  # of this package's envs
        return np.zeros(self.rows, bool) if waiting is None else waiting()

    def count(self, rewards: Array, flown: Array, dones: Array) -> list[Episode]:
        """Count a step of the rows that flew, and return the episodes that it ended."""
        self._totals += rewards
        self._lengths += flown
        episodes = []
        for row in np.flatnonzero(dones).tolist():
            episodes.append(Episode(float(self._totals[row]), int(self._lengths[row]), None))
            self._totals[row] = self._lengths[row] = 0
        return episodes


class VectorEnvSource(ArraySource):
    """A Gymnasium vector env, with any autoreset mode."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self.env, self.rows = env, env.num_envs
        self.observation_space, self.action_space = env.single_observation_space, env.single_action_space
        self.mode = AutoresetMode(env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP))
        self._over = np.zeros(self.rows, bool)  # next-step autoreset: rows that the next step only resets
        super().__init__()

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        self._current = self.flat(self.env.reset(seed=seed)[0])
        self._over[:] = False
        self._totals[:] = self._lengths[:] = 0

    def resume(self) -> None:
        """Go on with the current episodes of a `DroneVectorEnv`."""
        env = self.env
        if not isinstance(env, DroneVectorEnv):
            super().resume()
            return
        _require_episodes(env)
        self._current = self.flat(env.observation()).copy()
        is_next_step = self.mode is AutoresetMode.NEXT_STEP
        self._over = env.batch.terminated | env.batch.truncated if is_next_step else np.zeros(self.rows, bool)
        self._totals[:] = np.where(self._over, 0.0, env.batch.episode_return)
        self._lengths[:] = np.where(self._over, 0, env.batch.episode_length)

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Step once."""
        skipped = self._over | self.waiting()
        actions = self.actions(learner.act(t, self._current, skipped))
        observation, rewards, terminated, truncated, infos = self.env.step(actions)
        rewards = _rewards(rewards, self.rows)
        terminated, truncated = np.asarray(terminated, bool), np.asarray(truncated, bool)
        done = (terminated | truncated) & ~skipped
        ended = np.flatnonzero(done)
        current = self.flat(observation)
        last = {row: self._last(observation, infos, row) for row in ended.tolist()}
        final = current
        if self.mode is AutoresetMode.SAME_STEP and ended.size:
            final = current.copy()
            for row, values in last.items():
                final[row] = flat_rows(self.observation_space, values, None)[0]
        learner.record(t, rewards, terminated & ~skipped, truncated & ~skipped, final, skipped)
        if self.mode is AutoresetMode.NEXT_STEP:
            self._over = done
        elif self.mode is AutoresetMode.DISABLED and ended.size:
            current = self.flat(self.env.reset(options={"reset_mask": done})[0])
        self._current = current
        by_row: list[dict[str, Any]] = [{} for _ in range(self.rows)]
        if ended.size or needs_infos:
            by_row = infos_by_row(infos, self.rows)
            for row, info in enumerate(infos_by_row(infos.get("final_info", {}), self.rows)):
                by_row[row].update(info)
        episodes = self.count(np.where(skipped, 0.0, rewards), ~skipped, done)
        for row, episode in zip(ended.tolist(), episodes, strict=True):
            info = by_row[row]
            _read_episode(episode, info)
            info.setdefault("terminal_observation", last[row])
            info.setdefault("TimeLimit.truncated", bool(truncated[row] and not terminated[row]))
            info["episode"] = {"r": episode.total, "l": episode.length, "t": 0.0}
            if episode.success is not None:
                info["is_success"] = episode.success
        return Stepped(rewards, done, by_row if needs_infos else [], episodes)

    def _last(self, observation: Any, infos: Mapping[str, Any], row: int) -> Any:
        """Return the last observation of an ended episode."""
        if self.mode is AutoresetMode.SAME_STEP:
            return infos["final_obs"][row]
        if isinstance(observation, Mapping):
            return {name: np.array(part[row]) for name, part in observation.items()}
        return np.array(observation[row])


class SingleEnvSource(VectorEnvSource):
    """A Gymnasium env."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self.single = env
        super().__init__(SyncVectorEnv([lambda: env], autoreset_mode=AutoresetMode.SAME_STEP))

    def as_vec_env(self) -> Any:
        """Return the env as a ``VecEnv`` of Stable-Baselines3, as its own PPO does."""
        from stable_baselines3.common.monitor import Monitor
        from stable_baselines3.common.vec_env import DummyVecEnv

        return DummyVecEnv([lambda: Monitor(self.single)])


class VecEnvSource(ArraySource):
    """A VecEnv of Stable-Baselines3."""

    def __init__(self, env: Any) -> None:
        self.env, self.rows = env, env.num_envs
        self.observation_space, self.action_space = env.observation_space, env.action_space
        super().__init__()

    def seed(self, seed: int) -> None:
        """Seed the episodes from the next reset on."""
        self.env.seed(seed)

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        del seed
        self._current = self.flat(self.env.reset())
        self._totals[:] = self._lengths[:] = 0

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Step once."""
        del needs_infos
        skipped = self.waiting()
        actions = self.actions(learner.act(t, self._current, skipped))
        observation, rewards, dones, infos = self.env.step(actions)
        dones = np.asarray(dones, bool)
        is_cut = [info.get("TimeLimit.truncated") and info.get("terminal_observation") is not None for info in infos]
        truncated = np.array(is_cut, bool) & dones
        current = self.flat(observation)
        final = current.copy() if truncated.any() else current
        for row in np.flatnonzero(truncated).tolist():
            final[row] = flat_rows(self.observation_space, infos[row]["terminal_observation"], None)[0]
        rewards = _rewards(rewards, self.rows)
        learner.record(t, rewards, dones & ~truncated, truncated, final, skipped)
        self._current = current
        episodes = self.count(np.where(skipped, 0.0, rewards), ~skipped, dones)
        for row, episode in zip(np.flatnonzero(dones).tolist(), episodes, strict=True):
            _read_episode(episode, infos[row])
        return Stepped(rewards, dones, list(infos), episodes)


def source_of(env: Any) -> Source:
    """Return an environment as a source.

    Raises
    ------
    TypeError
        It is none of the kinds that a learner steps.
    """
    if isinstance(env, str):
        env = gymnasium.make(env)
    if isinstance(env, gymnasium.Env):
        return SingleEnvSource(env)
    if isinstance(env, DroneVectorEnv):
        return EngineSource(env) if _steps_in_engine(env) else VectorEnvSource(env)
    if isinstance(env, VectorEnv):
        return VectorEnvSource(env)
    inner = getattr(env, "env", None)
    is_ours = (type(env).__module__, type(env).__name__) == ("flockstep.sb3.vec_env", "DroneVecEnv")
    if is_ours and isinstance(inner, DroneVectorEnv) and _steps_in_engine(inner):
        return EngineSource(inner, env)
    if all(hasattr(env, name) for name in ("num_envs", "observation_space", "action_space", "step", "reset", "seed")):
        return VecEnvSource(env)
    raise TypeError(f"env: expected a Gymnasium id, env or vector env, or a VecEnv of Stable-Baselines3, got {env!r}")


def _require_episodes(env: DroneVectorEnv) -> None:
    stepping.require_open(env)
    if not env._seeded:
        raise ValueError("force_reset=False: expected a DroneVectorEnv after reset() or restore(), got one before")


def _steps_in_engine(env: DroneVectorEnv) -> bool:
    """Return True if a step needs no Python: the task is in C++, and no subclass replaces what the learner skips."""
    is_plain = type(env).step is DroneVectorEnv.step and type(env).observation is DroneVectorEnv.observation
    return is_plain and env._task_calls is None


def flat_rows(space: spaces.Space[Any], observation: Any, rows: int | None) -> Array:
    """Return observations (R, k); a dict is flattened in the order of its space. rows: None for one observation.

    Raises
    ------
    ValueError
        A part is missing, or has a wrong shape.
    """
    if not isinstance(space, spaces.Dict):
        return _flat("observation", space, observation, rows)
    if not isinstance(observation, Mapping):
        raise ValueError(
            f"observation: expected a dict with {', '.join(space.spaces)}, got {type(observation).__name__}"
        )
    for name in space.spaces:
        if name not in observation:
            raise ValueError(
                f"observation: expected a dict with {', '.join(space.spaces)}, got {', '.join(observation)}"
            )
    parts = [_flat(f"observation[{name!r}]", part, observation[name], rows) for name, part in space.spaces.items()]
    return np.concatenate(parts, axis=1)


def rows_to_act_on(space: spaces.Space[Any], last: int, observation: Any) -> tuple[Array, bool]:
    """Return observations (R, k), or (R, k - last) if they end there, and True if there is a single one."""
    if last and not ends_in(space, observation):
        part = actor_space(space, last)
        space = part if ends_in(part, observation) else space
    values, first = observation, space
    if isinstance(space, spaces.Dict):
        name, first = next(iter(space.spaces.items()))
        values = observation.get(name) if isinstance(observation, Mapping) else None
    assert first.shape is not None
    is_single = np.ndim(values) == len(first.shape)
    rows = None if is_single else len(values) if np.ndim(values) else 0
    return flat_rows(space, observation, rows), is_single


def _flat(name: str, space: spaces.Space[Any], values: Any, rows: int | None) -> Array:
    array = real_array(name, values).astype(np.float32, copy=False)
    assert space.shape is not None
    expected = space.shape if rows is None else (rows, *space.shape)
    if array.shape != expected:
        raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
    return np.ascontiguousarray(array.reshape(1 if rows is None else rows, int(np.prod(space.shape))))


def _rewards(rewards: Any, rows: int) -> Array:
    array = real_array("rewards", rewards).astype(np.float32, copy=False)
    if array.shape != (rows,):
        raise ValueError(f"rewards: expected shape {(rows,)}, got {array.shape}")
    return array


def infos_by_row(infos: Mapping[str, Any], rows: int) -> list[dict[str, Any]]:
    """Return the infos of a Gymnasium vector env as a dict for each row, without those of final steps."""
    by_row: list[dict[str, Any]] = [{} for _ in range(rows)]
    for name, values in infos.items():
        if name.startswith("_") or name in ("final_obs", "final_info"):
            continue
        mask = infos.get(f"_{name}")
        each: Any = infos_by_row(values, rows) if isinstance(values, Mapping) else values
        has_rows = isinstance(each, (list, tuple, np.ndarray)) and len(each) == rows
        for row in range(rows) if mask is None else np.flatnonzero(mask).tolist():
            value = each[row] if has_rows else each
            by_row[row][name] = value.item() if isinstance(value, np.generic) else value
    return by_row


def _read_episode(episode: Episode, info: Mapping[str, Any]) -> None:
    """Replace the counts of an episode by those that the environment reports."""
    reported = info.get("episode")
    if isinstance(reported, Mapping) and {"r", "l"} <= reported.keys():  # as Monitor and RecordEpisodeStatistics do
        episode.total, episode.length = float(reported["r"]), int(reported["l"])
    elif "episode_return" in info:  # as DroneVectorEnv does; without reward_scale
        episode.total, episode.length = float(info["episode_return"]), int(info["episode_length"])
    for name in ("is_success", "success"):
        value = info.get(name)
        if value is not None and np.ndim(value) == 0:
            episode.success = float(value)
            return
