"""Environments as a learner steps them: engine tasks, Gymnasium vector envs, and VecEnvs of Stable-Baselines3."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from flockstep._core import Learner
from flockstep.vector_env import DroneVectorEnv

Array = npt.NDArray[Any]


@dataclass
class Episode:
    """An episode that has ended."""

    total: float
    """Sum of the rewards, unscaled."""
    length: int
    """Number of steps."""
    success: bool | None
    """None if the environment does not say."""


@dataclass
class Stepped:
    """What a callback may read about a step."""

    rewards: Array
    dones: Array
    infos: list[dict[str, Any]]
    episodes: list[Episode] = field(default_factory=list)


class Source:
    """Steps R rows for a learner."""

    rows: int
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        raise NotImplementedError

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Let the learner act once, and give it the results."""
        raise NotImplementedError

    def observation(self, learner: Learner) -> Array:
        """Return the current observations, (R, k) float32."""
        raise NotImplementedError


class EngineSource(Source):
    """A task in C++, whose steps the learner makes within the engine."""

    def __init__(self, env: DroneVectorEnv, vec_env: Any = None) -> None:
        self.env, self.vec_env = env, vec_env
        self.rows = env.num_envs
        self.observation_space, self.action_space = env.single_observation_space, env.single_action_space

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        if self.vec_env is not None:
            if seed is not None:
                self.vec_env.seed(seed)
            self.vec_env.reset()
        else:
            self.env.reset(seed=seed)

    def observation(self, learner: Learner) -> Array:
        """Return the current observations."""
        return learner.read_observation(self.env.batch)

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Fly one step, whose actions are drawn on the threads that fly it."""
        env, batch = self.env, self.env.batch
        was_over = batch.terminated | batch.truncated if env.autoreset_mode is AutoresetMode.NEXT_STEP else None
        learner.fly(t, batch, env.reward_scale)
        if env.trail is not None:
            env.trail.record()
        done = batch.terminated | batch.truncated
        if was_over is not None:
            done &= ~was_over
        stepped = Stepped(env.scaled_reward(), done, [])
        ended = np.flatnonzero(done)
        for row in ended.tolist():
            stepped.episodes.append(
                Episode(float(batch.episode_return[row]), int(batch.episode_length[row]), bool(batch.success[row]))
            )
        if needs_infos:
            going_on: dict[str, Any] = {}
            stepped.infos = [going_on] * self.rows
            if self.vec_env is not None and ended.size:
                self.vec_env.add_ends(stepped.infos, ended, batch.truncated)
            else:
                _add_episodes(stepped.infos, ended, stepped.episodes)
        if env.autoreset_mode is AutoresetMode.DISABLED and ended.size:
            env.reset(options={"reset_mask": done.copy()})
        return stepped


class ArraySource(Source):
    """An environment that takes and returns arrays."""

    _current: Array

    def __init__(self) -> None:
        self._totals = np.zeros(self.rows)
        self._lengths = np.zeros(self.rows, np.int64)
        self._begun = time.perf_counter()

    def observation(self, learner: Learner) -> Array:
        """Return the current observations."""
        del learner
        return self._current

    def flat(self, observation: Any) -> Array:
        """Return observations as rows of numbers; a dict is flattened in the order of its keys."""
        if isinstance(observation, dict):
            names = list(self.observation_space.spaces)  # type: ignore[attr-defined]
            parts = [np.asarray(observation[name], np.float32).reshape(self.rows, -1) for name in names]
            return np.concatenate(parts, axis=1)
        return np.ascontiguousarray(np.asarray(observation, np.float32).reshape(self.rows, -1))

    def actions(self, drawn: Array) -> Array:
        """Return drawn actions as the environment takes them."""
        space = self.action_space
        if isinstance(space, spaces.Discrete):
            return drawn.astype(np.int64) + int(space.start)
        assert isinstance(space, spaces.Box)
        return np.clip(drawn.reshape(self.rows, *space.shape), space.low, space.high).astype(space.dtype)

    def count(self, rewards: Array, dones: Array, successes: Array | None) -> list[Episode]:
        """Count a step, and return the episodes that it ended."""
        self._totals += rewards
        self._lengths += 1
        episodes = []
        for row in np.flatnonzero(dones).tolist():
            success = None if successes is None else bool(successes[row])
            episodes.append(Episode(float(self._totals[row]), int(self._lengths[row]), success))
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

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Step once."""
        actions = self.actions(learner.act(t, self._current))
        observation, rewards, terminated, truncated, infos = self.env.step(actions)
        rewards = np.asarray(rewards, np.float32)
        terminated, truncated = np.asarray(terminated, bool), np.asarray(truncated, bool)
        skipped = self._over.copy()
        done = (terminated | truncated) & ~skipped
        current = self.flat(observation)
        final = current
        if self.mode is AutoresetMode.SAME_STEP and done.any():
            final = self._final(current, infos, done)
        learner.record(t, rewards, terminated & ~skipped, truncated & ~skipped, final, skipped)
        if self.mode is AutoresetMode.NEXT_STEP:
            self._over = done
        elif self.mode is AutoresetMode.DISABLED and done.any():
            current = self.flat(self.env.reset(options={"reset_mask": done})[0])
        self._current = current
        final_infos = infos.get("final_info", infos)
        successes = next((final_infos[name] for name in ("is_success", "success") if name in final_infos), None)
        counted = np.where(skipped, 0.0, rewards)
        self._lengths -= skipped
        stepped = Stepped(rewards, done, [], self.count(counted, done, successes))
        if needs_infos:
            stepped.infos = [{} for _ in range(self.rows)]
            _add_episodes(stepped.infos, np.flatnonzero(done), stepped.episodes)
        return stepped

    def _final(self, current: Array, infos: dict[str, Any], done: Array) -> Array:
        """Return the last observations of the ended episodes, in their rows."""
        final = current.copy()
        rows = np.flatnonzero(done)
        for row in rows.tolist():
            last = infos["final_obs"][row]
            parts = [last[name] for name in self.observation_space.spaces] if isinstance(last, dict) else [last]  # type: ignore[attr-defined]
            final[row] = np.concatenate([np.asarray(part, np.float32).ravel() for part in parts])
        return final


class VecEnvSource(ArraySource):
    """A VecEnv of Stable-Baselines3."""

    def __init__(self, env: Any) -> None:
        self.env, self.rows = env, env.num_envs
        self.observation_space, self.action_space = env.observation_space, env.action_space
        super().__init__()

    def reset(self, seed: int | None) -> None:
        """Begin new episodes."""
        if seed is not None:
            self.env.seed(seed)
        self._current = self.flat(self.env.reset())
        self._totals[:] = self._lengths[:] = 0

    def step(self, learner: Learner, t: int, needs_infos: bool) -> Stepped:
        """Step once."""
        del needs_infos
        actions = self.actions(learner.act(t, self._current))
        observation, rewards, dones, infos = self.env.step(actions)
        dones = np.asarray(dones, bool)
        truncated = np.array([info.get("TimeLimit.truncated", False) for info in infos], bool) & dones
        current = self.flat(observation)
        final = current.copy() if truncated.any() else current
        for row in np.flatnonzero(truncated).tolist():
            last = infos[row]["terminal_observation"]
            parts = [last[name] for name in self.observation_space.spaces] if isinstance(last, dict) else [last]  # type: ignore[attr-defined]
            final[row] = np.concatenate([np.asarray(part, np.float32).ravel() for part in parts])
        rewards = np.asarray(rewards, np.float32)
        learner.record(t, rewards, dones & ~truncated, truncated, final)
        self._current = current
        episodes = self.count(rewards, dones, None)
        for row, episode in zip(np.flatnonzero(dones).tolist(), episodes, strict=True):
            if "episode" in infos[row]:  # unscaled
                episode.total, episode.length = float(infos[row]["episode"]["r"]), int(infos[row]["episode"]["l"])
            if "is_success" in infos[row]:
                episode.success = bool(infos[row]["is_success"])
        return Stepped(rewards, dones, list(infos), episodes)


def source_of(env: Any) -> Source:
    """Return an environment as a source.

    Raises
    ------
    TypeError
        It is none of the kinds that a learner steps.
    """
    if isinstance(env, str):
        env = gymnasium.make_vec(env, num_envs=1, vectorization_mode="sync")
    if isinstance(env, gymnasium.Env):
        single = env
        env = SyncVectorEnv([lambda: single], autoreset_mode=AutoresetMode.SAME_STEP)
    if isinstance(env, DroneVectorEnv):
        return EngineSource(env) if env._task_calls is None else VectorEnvSource(env)
    if isinstance(env, VectorEnv):
        return VectorEnvSource(env)
    inner = getattr(env, "env", None)
    if type(env).__name__ == "DroneVecEnv" and isinstance(inner, DroneVectorEnv) and inner._task_calls is None:
        return EngineSource(inner, env)
    if all(hasattr(env, name) for name in ("num_envs", "observation_space", "action_space", "step", "reset", "seed")):
        return VecEnvSource(env)
    raise TypeError(f"env: expected a Gymnasium id, env or vector env, or a VecEnv of Stable-Baselines3, got {env!r}")


def _add_episodes(infos: list[dict[str, Any]], rows: npt.NDArray[np.intp], episodes: Sequence[Episode]) -> None:
    for row, episode in zip(rows.tolist(), episodes, strict=True):
        infos[row] = {"episode": {"r": episode.total, "l": episode.length, "t": 0.0}}
        if episode.success is not None:
            infos[row]["is_success"] = episode.success
