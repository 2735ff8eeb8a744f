"""Checks of an env's interface: spaces, values, errors, pictures, closing."""

from __future__ import annotations

from collections.abc import Sequence
from traceback import walk_tb
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flockstep.pictures.top_view import TopView
from flockstep.task import Task
from flockstep.testing.runs import Actions, AnyVectorEnv, Setup, rows_per_env


def check_spaces(setup: Setup) -> None:
    """Check batched spaces, metadata and autoreset mode."""
    with setup.env() as env, setup.env() as other:
        assert isinstance(env, VectorEnv), f"expected a gymnasium.vector.VectorEnv, got {type(env).__name__}"
        expected_rows = setup.num_envs * rows_per_env(env)
        assert env.num_envs == expected_rows, f"num_envs: expected {setup.num_envs}, got {env.num_envs}"
        for kind in ("observation", "action"):
            single, batched = getattr(env, f"single_{kind}_space", None), getattr(env, f"{kind}_space", None)
            assert isinstance(single, spaces.Space), f"single_{kind}_space: expected a space, got {single!r}"
            expected = batch_space(single, env.num_envs)
            assert batched == expected, (
                f"{kind}_space: expected batch_space(single_{kind}_space) {expected}, got {batched}"
            )
        mode = env.metadata.get("autoreset_mode")
        assert isinstance(mode, AutoresetMode), (
            f"metadata['autoreset_mode']: expected a gymnasium.vector.AutoresetMode, got {mode!r}"
        )
        own = getattr(env.unwrapped, "autoreset_mode", mode)
        assert own == mode, f"the attribute autoreset_mode is {own!r}, but metadata['autoreset_mode'] is {mode!r}"
        assert env.metadata is not other.metadata, (
            "two envs share one metadata dict, so each overwrites the autoreset mode of the other: "
            "copy the class's dict in __init__"
        )
        modes = env.metadata.get("render_modes", [])
        assert env.render_mode is None or env.render_mode in modes, (
            f"render_mode {env.render_mode!r} is not among metadata['render_modes'] {modes}"
        )


def check_values(setup: Setup) -> None:
    """Check types, shapes and dtypes of the results of reset and step."""
    with setup.env() as env:
        returned = env.reset(seed=setup.seed)
        assert isinstance(returned, tuple) and len(returned) == 2, "reset: expected a tuple (observation, infos)"
        check_observation(env, returned[0], "reset")
        check_infos(env, returned[1], "reset")
        actions = Actions(env, setup.seed)
        for number in range(setup.steps):
            result = env.step(actions())
            place = f"step {number}"
            assert isinstance(result, tuple) and len(result) == 5, (
                f"{place}: expected a tuple (observation, reward, terminated, truncated, infos)"
            )
            observation, reward, terminated, truncated, infos = result
            check_observation(env, observation, place)
            assert isinstance(reward, np.ndarray) and reward.dtype in (np.float32, np.float64), (
                f"{place}: reward: expected a float32 or float64 array, got {getattr(reward, 'dtype', type(reward))}"
            )
            assert reward.shape == (env.num_envs,), (
                f"{place}: reward: expected shape ({env.num_envs},), got {reward.shape}"
            )
            bad = np.flatnonzero(~np.isfinite(reward))
            assert not len(bad), (
                f"{place}: reward: expected finite numbers, got {reward[bad[0]]} in env {bad[0]}; "
                f"{len(bad)} of {len(reward)} are not"
            )
            for name, flags in (("terminated", terminated), ("truncated", truncated)):
                assert isinstance(flags, np.ndarray) and flags.dtype == np.bool_, (
                    f"{place}: {name}: expected a bool array, got {getattr(flags, 'dtype', type(flags))}"
                )
                assert flags.shape == (env.num_envs,), (
                    f"{place}: {name}: expected shape ({env.num_envs},), got {flags.shape}"
                )
            check_infos(env, infos, place)
            ended = terminated | truncated
            if env.metadata.get("autoreset_mode") == AutoresetMode.DISABLED and ended.any():
                env.reset(options={"reset_mask": ended.copy()})


def check_observation(env: AnyVectorEnv, observation: Any, place: str) -> None:
    """Check an observation against its space."""
    space = env.observation_space
    _check_arrays(space, observation, f"{place}: observation")
    check_contained(space, observation, f"{place}: observation", batched=True)


def check_contained(space: spaces.Space[Any], observation: Any, place: str, batched: bool = False) -> None:
    """Check that an observation is in a space; report the first number outside its bounds."""
    if isinstance(space, spaces.Dict) and isinstance(observation, dict) and observation.keys() == space.keys():
        for key, part in space.items():
            check_contained(part, observation[key], f"{place}[{key!r}]", batched)
    elif isinstance(space, spaces.Box) and isinstance(observation, np.ndarray) and observation.shape == space.shape:
        beyond = np.argwhere(~((observation >= space.low) & (observation <= space.high)))  # includes NaN
        if len(beyond):
            at = tuple(beyond[0].tolist())
            env, index = (at[:1], at[1:]) if batched else ((), at)
            where = [f" in env {i}" for i in env] + [f" at index {list(index)}" for _ in index[:1]]
            raise AssertionError(
                f"{place} is not in the observation space: expected numbers in [{space.low[at]}, {space.high[at]}], "
                f"got {observation[at]}{''.join(where)}; {len(beyond)} of {observation.size} lie outside"
            )
    assert space.contains(observation), f"{place} is not in the observation space {space}"


def _check_arrays(space: spaces.Space[Any], value: Any, place: str) -> None:
    if isinstance(space, spaces.Dict):
        assert isinstance(value, dict), f"{place}: expected a dict, got {type(value)}"
        assert value.keys() == space.keys(), f"{place}: expected the keys {sorted(space)}, got {sorted(value)}"
        for key, part in space.items():
            _check_arrays(part, value[key], f"{place}[{key!r}]")
    elif isinstance(space, spaces.Box):
        assert isinstance(value, np.ndarray), f"{place}: expected an array, got {type(value)}"
        assert (value.shape, value.dtype) == (space.shape, space.dtype), (
            f"{place}: expected {space.dtype} {space.shape}, got {value.dtype} {value.shape}"
        )


def check_infos(env: AnyVectorEnv, infos: Any, place: str) -> None:
    """Check that infos hold arrays with a row per env, and that each mask has its values."""
    assert isinstance(infos, dict), f"{place}: infos: expected a dict, got {type(infos).__name__}"
    for key, value in infos.items():
        where = f"{place}: infos[{key!r}]"
        if isinstance(value, dict):
            check_infos(env, value, where)
            continue
        assert isinstance(value, np.ndarray) and len(np.atleast_1d(value)) == env.num_envs and value.ndim > 0, (
            f"{where}: expected a dict or an array of length {env.num_envs}, got {value!r}"
        )
        if key.startswith("_"):
            assert value.dtype == np.bool_, f"{where}: expected a mask of dtype bool, got {value.dtype}"
            assert key[1:] in infos, f"{where}: this mask belongs to no key: infos has no {key[1:]!r}"
    assert "episode" not in infos, f"{place}: infos['episode']: this key is reserved for RecordEpisodeStatistics"


def check_bad_actions(setup: Setup) -> None:
    """Check that actions of a wrong length, or not finite, raise an error."""
    with setup.env() as env, setup.env(setup.num_envs + 1) as wider:
        env.reset(seed=setup.seed)
        _assert_raises(env, Actions(wider, setup.seed)(), f"actions for {setup.num_envs + 1} envs")
        space = env.single_action_space
        if isinstance(space, spaces.Box) and space.dtype in (np.float32, np.float64):
            for value in (np.nan, np.inf):
                actions = Actions(env, setup.seed)()
                actions[0] = value
                _assert_raises(env, actions, f"actions with {value}")


def _assert_raises(env: AnyVectorEnv, actions: Any, what: str) -> None:
    try:
        env.step(actions)
    except Exception:
        return
    raise AssertionError(f"step took {what} without an error")


def check_render(setup: Setup) -> None:
    """Check that there is a frame per env; without a render mode, check that the task's drawing works."""
    with setup.env() as env:
        task = getattr(env.unwrapped, "task", None)
        draws = isinstance(task, Task) and type(task).draw is not Task.draw
        if env.render_mode != "rgb_array" and not draws:
            return
        env.reset(seed=setup.seed)
        try:
            frames = env.render() if env.render_mode == "rgb_array" else _from_above(env)
        except Exception as error:
            code = getattr(type(task).draw, "__code__", None) if isinstance(task, Task) else None
            lines = [line for frame, line in walk_tb(error.__traceback__) if frame.f_code is code]
            what = f"{type(task).__name__}.draw, line {lines[0]}," if lines else "render"
            raise AssertionError(f"{what} raised {error!r} after a reset") from error
        assert isinstance(frames, Sequence), f"render: expected a tuple or list of frames, got {type(frames).__name__}"
        assert len(frames) == env.num_envs, f"render: expected {env.num_envs} frames, got {len(frames)}"
        for frame in frames:
            assert isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.shape[2:] == (3,), (
                f"render: expected uint8 frames (height, width, 3), got {getattr(frame, 'dtype', type(frame))} "
                f"{getattr(frame, 'shape', '')}"
            )


def _from_above(env: AnyVectorEnv) -> list[Any]:
    inner: Any = env.unwrapped
    view = TopView(inner.batch, overlay=inner.task)
    return [view.frame(index) for index in range(env.num_envs)]


def check_close(setup: Setup) -> None:
    """Check that closing twice is allowed."""
    env = setup.make_env(setup.num_envs)
    env.reset(seed=setup.seed)
    env.close()
    assert env.closed, "after close, closed should be True"
    try:
        env.close()
    except Exception as error:
        raise AssertionError(f"closing twice should be allowed, but raised {error!r}") from error
