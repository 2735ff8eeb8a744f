"""Resets and steps of a vector env over a batch: seeds and masks, infos and copies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from numbers import Real
from typing import Any, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv

from flockstep.errors import ClosedError, refuse_masked

Array: TypeAlias = npt.NDArray[Any]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
#: An array, or a dict of arrays if the task observes several fields.
Observation: TypeAlias = Array | dict[str, Array]

#: A batch's values about episodes, in addition to their reward terms.
_OF_EPISODES = ("episode_return", "episode_length", "success", "crashed", "bad_state", "episode_end")

#: Autoreset modes by the names that the engine gives them.
AUTORESET_MODES = {
    "next_step": AutoresetMode.NEXT_STEP,
    "same_step": AutoresetMode.SAME_STEP,
    "disabled": AutoresetMode.DISABLED,
}


class SteppedBatch(Protocol):
    """The part of a `Batch` that a vector env needs. Its arrays have N rows, one for each row of the actions."""

    def reset(self, seeds: npt.NDArray[np.uint64] | None = None, mask: BoolArray | None = None) -> None:
        """Begin new episodes, with seeds (E,) or none, in the envs of the mask (E,) or in all.

        If the episodes of an env's drones end separately, the mask may be (N,) if there are no seeds.
        """

    def step(self, actions: npt.ArrayLike) -> None:
        """Fly one step."""

    @property
    def observation(self) -> Any:
        """Observations: an array (N, ...) or a dict of such arrays."""

    @property
    def reward(self) -> Any:
        """Rewards (N,) float32."""

    @property
    def terminated(self) -> Any:
        """Flags (N,)."""

    @property
    def truncated(self) -> Any:
        """Flags (N,)."""

    @property
    def final_observation(self) -> Any:
        """Last observations of episodes that ended in this step, like `observation`."""

    @property
    def episode_terms(self) -> Any:
        """Sums of the reward terms (N, terms). The batch also has the other arrays of episodes, (N,) each."""


class SteppedEnv(Protocol):
    """The part of a vector env that these functions need."""

    num_envs: int
    num_groups: int
    _rows_per_env: int
    _ends_rows: bool  # the episodes of the rows of an env end separately
    _reward_terms: list[str]
    autoreset_mode: AutoresetMode
    copy: bool
    reward_scale: float
    closed: bool
    np_random: np.random.Generator
    _seeded: bool
    _np_random_seed: Any

    @property
    def batch(self) -> SteppedBatch:
        """The batch."""

    def episode_infos(self, indices: npt.NDArray[np.intp] | None = None) -> dict[str, Any]:
        """Return the episode statistics of the envs."""

    def final_observations(self, indices: npt.NDArray[np.intp]) -> list[Observation]:
        """Return the last observations of ended episodes."""

    def _last_infos(self, ended: npt.NDArray[np.intp]) -> dict[str, Any]:
        """Return the episode statistics of ``ended``: all envs whose episode ended in the last step."""

    def _finished(self) -> BoolArray | None:
        """Return a mask of the rows that did not fly in the last step, with episodes="last", otherwise None."""


def reset(env: SteppedEnv, seed: int | Sequence[int] | None, options: Mapping[str, Any] | None) -> BoolArray | None:
    """Begin new episodes and return the mask of the envs (E,) or drones (N,) for which they begin, or None for all."""
    require_open(env)
    mask = reset_mask(env, options, of_drones=env._ends_rows and seed is None)
    seeds = seeds_of(env, seed)
    if seeds is None and not env._seeded:
        if mask is not None and not mask.all():
            raise ResetNeeded("the first reset must be of all envs or come with a seed")
        seeds = seeds_of(env, int(env.np_random.integers(1 << 62)))
    if seeds is not None and not env._seeded and mask is not None and not mask.all():
        env.batch.reset(seeds)  # also reset the envs outside the mask: every env must have a state
    env.batch.reset(seeds, mask)
    env._seeded = not env.closed
    return mask


def step(env: SteppedEnv, actions: npt.ArrayLike) -> None:
    """Fly one step."""
    if not env._seeded:
        require_open(env)
        raise ResetNeeded("call reset before step")
    env.batch.step(actions)


def results(env: SteppedEnv) -> tuple[Observation, Array, BoolArray, BoolArray, dict[str, Any]]:
    """Return what the step of an env returns."""
    batch = env.batch
    observation = batch.observation
    reward = batch.reward if env.reward_scale == 1 else scaled_reward(env)
    terminated, truncated = batch.terminated, batch.truncated
    ended = terminated | truncated
    infos = infos_of(env, ended) if np.count_nonzero(ended) else {}
    finished = env._finished()
    if finished is not None and np.count_nonzero(finished):
        infos |= _masked({"finished": finished}, finished)
    if env.copy:
        return returned(env, observation), reward.copy(), terminated.copy(), truncated.copy(), infos
    return observation, reward, terminated, truncated, infos


def scaled_reward(env: SteppedEnv) -> npt.NDArray[np.float32]:
    """Return the last step's rewards (N,) times the env's scale."""
    reward: npt.NDArray[np.float32] = env.batch.reward
    return reward if env.reward_scale == 1 else np.multiply(reward, env.reward_scale, dtype=np.float32)


def returned(env: SteppedEnv, observation: Observation) -> Observation:
    """Return an observation, copied if the env copies."""
    if not env.copy:
        return observation
    if isinstance(observation, dict):
        return {key: part.copy() for key, part in observation.items()}
    return observation.copy()


def episode_infos(
    env: SteppedEnv, indices: npt.NDArray[np.intp] | slice | None, task_infos: Mapping[str, Array]
) -> dict[str, Any]:
    """Return the episode statistics of the rows ``indices`` and those of the task.

    They are new arrays if ``indices`` is an array, or None for all rows; views if it is a slice.
    """
    batch, rows = env.batch, slice(None) if indices is None else indices
    report = {name: getattr(batch, name)[rows] for name in _OF_EPISODES}
    report["episode_terms"] = dict(zip(env._reward_terms, batch.episode_terms[rows].T, strict=True))
    report.update((name, values[rows]) for name, values in task_infos.items())
    return deepcopy(report) if indices is None else report


def final_observations(env: SteppedEnv, indices: npt.NDArray[np.intp]) -> list[Observation]:
    """Return the last observation of the episode that ended in each of the envs ``indices``, as new arrays."""
    final = env.batch.final_observation
    if not isinstance(final, dict):
        return list(final[indices])
    parts = {name: rows[indices] for name, rows in final.items()}
    return [{name: rows[i, ...] for name, rows in parts.items()} for i in range(len(indices))]


def ends(env: SteppedEnv, indices: npt.NDArray[np.intp], seconds: float) -> list[dict[str, Any]]:
    """Return the infos of the episodes that ended in the envs ``indices``, in the form of Stable-Baselines3.

    ``seconds`` is the time since the env was made, the ``t`` of each ``episode``.
    """
    report = _lists(env.episode_infos(indices))
    total, length, success = (report.pop(name) for name in ("episode_return", "episode_length", "success"))
    final, truncated = env.final_observations(indices), env.batch.truncated[indices].tolist()
    return [
        {
            "terminal_observation": final[k],
            "TimeLimit.truncated": truncated[k],
            "is_success": success[k],
            "episode": {"r": total[k], "l": length[k], "t": seconds},
            **{name: _nth(value, k) for name, value in report.items()},
        }
        for k in range(len(indices))
    ]


def infos_of(env: SteppedEnv, ended: BoolArray) -> dict[str, Any]:
    """Return the infos of a step in which episodes have ended."""
    indices = np.flatnonzero(ended)

    def spread(report: dict[str, Any]) -> dict[str, Any]:
        """Scatter the values to rows of all envs, with 0 elsewhere."""
        arrays: dict[str, Any] = {}
        for name, values in report.items():
            if isinstance(values, dict):  # the reward terms, which share one type
                rows = np.zeros((len(values), env.num_envs))
                rows[:, indices] = list(values.values())
                arrays[name] = _masked(dict(zip(values, rows, strict=True)), ended)
            else:
                arrays[name] = np.zeros(env.num_envs, values.dtype)
                arrays[name][indices] = values
        return arrays

    infos = _masked(spread(env._last_infos(indices)), ended)
    if env.autoreset_mode is not AutoresetMode.SAME_STEP:
        return infos
    final_obs = np.full(env.num_envs, None, dtype=object)
    for index, row in zip(indices.tolist(), env.final_observations(indices), strict=True):
        final_obs[index] = row
    return {"final_obs": final_obs, "_final_obs": ended, "final_info": infos, "_final_info": ended}


def require_open(env: SteppedEnv) -> None:
    """Raise ClosedError, which is a RuntimeError, if the env is closed."""
    if env.closed:
        raise ClosedError("this env is closed")


def require_reward_scale(scale: Any) -> float:
    """Return the scale of the rewards, or raise ValueError."""
    if not (isinstance(scale, Real) and 0 < float(scale) < np.inf):
        raise ValueError(f"reward_scale: expected a finite number above 0, got {scale!r}")
    return float(scale)


def seeds_of(env: SteppedEnv, seed: int | Sequence[int] | None) -> npt.NDArray[np.uint64] | None:
    """Return the seeds (E,) of an env's reset, or None, and seed its `np_random`."""
    if seed is None:
        return None
    refuse_masked("seed", seed)
    if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer, Sequence, np.ndarray)):
        raise TypeError(f"seed: expected an integer, {env.num_groups} integers or None, got {seed!r}")
    if isinstance(seed, (int, np.integer)):
        first = int(seed)
        if not 0 <= first <= (1 << 64) - env.num_groups:
            raise ValueError(f"seed: expected a number from 0 to 2**64 - num_envs, got {first}")
        _seed_np_random(env, first)
        seeds: npt.NDArray[np.uint64] = np.arange(env.num_groups, dtype=np.uint64) + np.uint64(first)
        return seeds
    if len(seed) != env.num_groups:
        raise ValueError(f"seed: expected one integer or {env.num_groups} of them, one per env, got {len(seed)}")
    for s in seed:
        if not isinstance(s, (int, np.integer)) or isinstance(s, bool) or not 0 <= int(s) < 1 << 64:
            raise ValueError(f"seed: expected integers from 0 to 2**64 - 1, got {s!r}")
    _seed_np_random(env, int(seed[0]))
    env._np_random_seed = tuple(int(s) for s in seed)  # like SyncVectorEnv
    return np.array(seed, dtype=np.uint64)


def _seed_np_random(env: SteppedEnv, seed: int) -> None:
    VectorEnv.reset(cast("VectorEnv[Any, Any, Any]", env), seed=seed)


def reset_mask(env: SteppedEnv, options: Mapping[str, Any] | None, of_drones: bool = False) -> BoolArray | None:
    """Return the mask (E,) of the envs that a reset with these options selects, or None for all.

    With ``of_drones`` it is the mask (N,) of the drones.
    """
    unknown = [name for name in options or () if name != "reset_mask"]
    if unknown:
        raise ValueError(f"options: expected only 'reset_mask', got {', '.join(map(repr, unknown))}")
    mask = None if options is None else options.get("reset_mask")
    if mask is None:
        return None
    refuse_masked("options['reset_mask']", mask)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (env.num_envs,):
        got = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise ValueError(f"options['reset_mask']: expected a bool array of shape ({env.num_envs},), got {got}")
    if not mask.any():
        raise ValueError("options['reset_mask']: expected at least one True")
    if of_drones:
        return mask.copy()
    groups = mask.reshape(env.num_groups, env._rows_per_env)
    split = np.flatnonzero(groups.any(axis=1) != groups.all(axis=1))
    if split.size:
        raise ValueError(
            f"options['reset_mask']: expected all {env._rows_per_env} drones of an env or none, since they begin "
            f"{'with one seed' if env._ends_rows else 'their episodes together'}, got some of env {split[0]}"
        )
    return groups[:, 0].copy()


def _masked(arrays: Mapping[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Return infos in Gymnasium's format, with a mask for each key."""
    infos: dict[str, Any] = {}
    for key, value in arrays.items():
        infos[key], infos[f"_{key}"] = value, mask
    return infos


def _lists(report: dict[str, Any]) -> dict[str, Any]:
    """Return infos as lists."""
    return {name: _lists(part) if isinstance(part, dict) else part.tolist() for name, part in report.items()}


def _nth(value: Any, k: int) -> Any:
    return {name: part[k] for name, part in value.items()} if isinstance(value, dict) else value[k]
