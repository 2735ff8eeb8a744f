"""A checker for Gymnasium vector environments, which Gymnasium itself does not have.

>>> check_vector_env(lambda n: gymnasium.make_vec("flockstep/LidarNavigation-v0", n, max_episode_steps=20))
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate

Array: TypeAlias = npt.NDArray[Any]
AnyVectorEnv: TypeAlias = VectorEnv[Any, Any, Any]
MakeEnv: TypeAlias = Callable[[int], AnyVectorEnv]


def check_vector_env(
    make_env: MakeEnv,
    *,
    num_envs: int = 4,
    steps: int = 100,
    seed: int = 123,
    skip: Collection[str] = (),
) -> None:
    """Check that a vector environment keeps to Gymnasium's rules.

    Parameters
    ----------
    make_env
        Makes a new env with the given number of sub-envs, alike on every call. Its episodes should be short: at least
        one must end within ``steps`` steps of random actions, or its autoreset cannot be checked.
    num_envs
        Number of sub-envs to check with, at least 2.
    steps
        Length of the runs that are compared.
    seed
        Of the resets and of the random actions.
    skip
        Names of checks to leave out, of `CHECKS`:

        - ``spaces``: batched spaces, metadata, autoreset mode
        - ``values``: types, shapes and dtypes of what reset and step return, infos with their masks
        - ``determinism``: the same seed and actions give the same run, in the same env and in a new one; without a seed
          a reset goes on with new episodes, alike for alike histories
        - ``num_envs``: env i does the same whatever the number of envs
        - ``seed_offset``: env i of a batch seeded s does what env 0 of one seeded s + i does (not so where the envs
          of a batch differ by design)
        - ``autoreset``: what the env's autoreset mode promises about the end of an episode
        - ``reset_mask``: ``options={"reset_mask": ...}`` resets the masked envs and no others (with autoreset disabled)
        - ``ownership``: returned arrays are neither written again nor read back, arguments are not changed
        - ``bad_actions``: actions of a wrong length, or not finite in a `Box`, raise
        - ``render``: in the mode ``rgb_array``, a frame per env
        - ``close``: closing twice is allowed

    Raises
    ------
    AssertionError
        The env breaks a rule; the message says which, and how.
    ValueError
        A name in ``skip`` that does not exist, or fewer than two envs.
    """
    unknown = set(skip) - set(CHECKS)
    if unknown:
        raise ValueError(f"skip: unknown {', '.join(sorted(unknown))}; expected some of {', '.join(CHECKS)}")
    if num_envs < 2:
        raise ValueError(f"num_envs: expected at least 2, got {num_envs}")
    setup = _Setup(make_env, num_envs, steps, seed)
    for name, check in CHECKS.items():
        if name not in skip:
            check(setup)


@dataclass
class _Setup:
    make_env: MakeEnv
    num_envs: int
    steps: int
    seed: int

    @contextmanager
    def env(self, num_envs: int | None = None) -> Iterator[AnyVectorEnv]:
        env = self.make_env(self.num_envs if num_envs is None else num_envs)
        try:
            yield env
        finally:
            env.close()


@dataclass
class _Step:
    """What one step returned; every field has a row per env."""

    observation: Any
    reward: Array
    terminated: Array
    truncated: Array
    infos: dict[str, Any]

    @property
    def ended(self) -> Array:
        ended: Array = self.terminated | self.truncated
        return ended


class _Actions:
    """Random actions that depend on nothing but the index of the env and how many came before.

    With ``offset``, env i gets the actions of env i + offset.
    """

    def __init__(self, env: AnyVectorEnv, seed: int, offset: int = 0) -> None:
        self._spaces = [copy.deepcopy(env.single_action_space) for _ in range(env.num_envs)]
        for index, space in enumerate(self._spaces):
            space.seed(seed + index + offset)
        self._single = env.single_action_space

    def __call__(self) -> Any:
        samples = [space.sample() for space in self._spaces]
        return _stack(samples)


def _stack(samples: Sequence[Any]) -> Any:
    if isinstance(samples[0], dict):
        return {key: _stack([sample[key] for sample in samples]) for key in samples[0]}
    if isinstance(samples[0], tuple):
        return tuple(_stack(part) for part in zip(*samples, strict=True))
    return np.stack(samples)


def _run(
    env: AnyVectorEnv, steps: int, seed: int | None, action_seed: int, offset: int = 0, keep: bool = False
) -> tuple[Any, list[_Step]]:
    """Reset and step with random actions; return copies, or with ``keep`` the very arrays that came."""
    own: Callable[[Any], Any] = (lambda x: x) if keep else copy.deepcopy
    actions = _Actions(env, action_seed, offset)
    observation = own(env.reset(seed=seed)[0])
    mode = env.metadata.get("autoreset_mode")
    history = []
    for _ in range(steps):
        step = _Step(*own(env.step(actions())))
        history.append(step)
        if mode == AutoresetMode.DISABLED and step.ended.any():
            env.reset(options={"reset_mask": step.ended.copy()})
    return observation, history


# ------------------------------------------------------------------------------------------------------ comparing


def _difference(a: Any, b: Any) -> str | None:
    """Return where two values differ in type, shape or bits, or None."""
    if type(a) is not type(b):
        return f"{type(a).__name__} against {type(b).__name__}"
    if isinstance(a, dict):
        if a.keys() != b.keys():
            return f"keys {sorted(a)} against {sorted(b)}"
        return next((f"[{key!r}] {d}" for key in a if (d := _difference(a[key], b[key]))), None)
    if isinstance(a, (tuple, list)):
        if len(a) != len(b):
            return f"length {len(a)} against {len(b)}"
        return next((f"[{i}] {d}" for i, (x, y) in enumerate(zip(a, b, strict=True)) if (d := _difference(x, y))), None)
    if isinstance(a, np.ndarray):
        if a.dtype != b.dtype or a.shape != b.shape:
            return f"{a.dtype} {a.shape} against {b.dtype} {b.shape}"
        if a.dtype == object:
            return _difference(a.tolist(), b.tolist())
        if np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"):
            return None
        rows = np.flatnonzero((a != b).reshape(len(a), -1).any(axis=1)) if a.ndim else [0]
        return f"rows {list(rows)[:5]}: {a[rows[0]] if a.ndim else a} against {b[rows[0]] if b.ndim else b}"
    return None if bool(a == b) or (a != a and b != b) else f"{a!r} against {b!r}"


def _rows(value: Any, rows: slice) -> Any:
    """Return the rows of some envs of anything that has a row per env."""
    if isinstance(value, _Step):
        return _Step(*(_rows(getattr(value, field.name), rows) for field in fields(_Step)))
    if isinstance(value, dict):
        return {key: _rows(part, rows) for key, part in value.items()}
    if isinstance(value, tuple):
        return tuple(_rows(part, rows) for part in value)
    return value[rows]


def _compare_runs(first: tuple[Any, list[_Step]], second: tuple[Any, list[_Step]], rule: str) -> None:
    difference = _difference(first[0], second[0])
    assert difference is None, f"{rule}, but the observations of the reset differ: {difference}"
    for number, (a, b) in enumerate(zip(first[1], second[1], strict=True)):
        for name in ("observation", "reward", "terminated", "truncated"):
            difference = _difference(getattr(a, name), getattr(b, name))
            assert difference is None, f"{rule}, but {name} of step {number} differs: {difference}"
        difference = _difference(_masked(a.infos), _masked(b.infos))
        assert difference is None, f"{rule}, but the infos of step {number} differ: {difference}"


def _masked(infos: dict[str, Any]) -> dict[str, Any]:
    """Return the infos without what no env has: entries whose mask is False everywhere, and values outside the mask."""
    kept: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_"):
            continue
        mask = infos.get(f"_{key}")
        if mask is not None and not np.any(mask):
            continue
        if isinstance(value, dict):
            value = _masked(value)
        elif mask is not None and isinstance(value, np.ndarray):
            value = [part if has else None for part, has in zip(value, mask, strict=True)]
        kept[key] = value
    return kept


# -------------------------------------------------------------------------------------------------------- checks


def _check_spaces(setup: _Setup) -> None:
    with setup.env() as env, setup.env() as other:
        assert isinstance(env, VectorEnv), f"expected a gymnasium.vector.VectorEnv, got {type(env).__name__}"
        assert env.num_envs == setup.num_envs, f"asked for {setup.num_envs} envs, num_envs is {env.num_envs}"
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
            "two envs share one metadata dict: what one writes into it (its autoreset mode) is read by the other; "
            "copy the class's dict per instance"
        )
        modes = env.metadata.get("render_modes", [])
        assert env.render_mode is None or env.render_mode in modes, (
            f"render_mode {env.render_mode!r} is not among metadata['render_modes'] {modes}"
        )


def _check_values(setup: _Setup) -> None:
    with setup.env() as env:
        returned = env.reset(seed=setup.seed)
        assert isinstance(returned, tuple) and len(returned) == 2, "reset: expected a tuple (observation, infos)"
        _check_observation(env, returned[0], "reset")
        _check_infos(env, returned[1], "reset")
        actions = _Actions(env, setup.seed)
        for number in range(setup.steps):
            result = env.step(actions())
            place = f"step {number}"
            assert isinstance(result, tuple) and len(result) == 5, (
                f"{place}: expected a tuple (observation, reward, terminated, truncated, infos)"
            )
            observation, reward, terminated, truncated, infos = result
            _check_observation(env, observation, place)
            assert isinstance(reward, np.ndarray) and reward.dtype in (np.float32, np.float64), (
                f"{place}: reward: expected a float32 or float64 array, got {getattr(reward, 'dtype', type(reward))}"
            )
            assert reward.shape == (env.num_envs,), (
                f"{place}: reward: expected shape ({env.num_envs},), got {reward.shape}"
            )
            assert np.isfinite(reward).all(), f"{place}: reward: expected finite numbers, got {reward}"
            for name, flags in (("terminated", terminated), ("truncated", truncated)):
                assert isinstance(flags, np.ndarray) and flags.dtype == np.bool_, (
                    f"{place}: {name}: expected a bool array, got {getattr(flags, 'dtype', type(flags))}"
                )
                assert flags.shape == (env.num_envs,), (
                    f"{place}: {name}: expected shape ({env.num_envs},), got {flags.shape}"
                )
            _check_infos(env, infos, place)
            ended = terminated | truncated
            if env.metadata.get("autoreset_mode") == AutoresetMode.DISABLED and ended.any():
                env.reset(options={"reset_mask": ended.copy()})


def _check_observation(env: AnyVectorEnv, observation: Any, place: str) -> None:
    space = env.observation_space
    _check_arrays(space, observation, f"{place}: observation")
    assert space.contains(observation), f"{place}: the observation is not in the observation space: {observation}"


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


def _check_infos(env: AnyVectorEnv, infos: Any, place: str) -> None:
    assert isinstance(infos, dict), f"{place}: infos: expected a dict, got {type(infos).__name__}"
    for key, value in infos.items():
        where = f"{place}: infos[{key!r}]"
        if isinstance(value, dict):
            _check_infos(env, value, where)
            continue
        assert isinstance(value, np.ndarray) and len(np.atleast_1d(value)) == env.num_envs and value.ndim > 0, (
            f"{where}: expected a dict or an array of length {env.num_envs}, got {value!r}"
        )
        if key.startswith("_"):
            assert value.dtype == np.bool_, f"{where}: expected a mask of dtype bool, got {value.dtype}"
            assert key[1:] in infos, f"{where}: a mask of nothing, infos has no {key[1:]!r}"
    assert "episode" not in infos, (
        f"{place}: infos['episode']: this key belongs to RecordEpisodeStatistics, which raises if it is taken"
    )


def _check_determinism(setup: _Setup) -> None:
    with setup.env() as env, setup.env() as other:
        first = _run(env, setup.steps, setup.seed, setup.seed)
        on = _run(env, setup.steps // 4, None, setup.seed)
        again = _run(env, setup.steps, setup.seed, setup.seed)
        _compare_runs(first, again, "the same seed and actions should give the same run in the same env")
        on_again = _run(env, setup.steps // 4, None, setup.seed)
        _compare_runs(on, on_again, "the runs after a reset without a seed should be alike after alike histories")
        fresh = _run(other, setup.steps, setup.seed, setup.seed)
        _compare_runs(first, fresh, "the same seed and actions should give the same run in a new env")


def _check_num_envs(setup: _Setup) -> None:
    n, more = setup.num_envs, 2 * setup.num_envs + 1
    with setup.env(n) as env, setup.env(more) as wide:
        few, many = _run(env, setup.steps, setup.seed, setup.seed), _run(wide, setup.steps, setup.seed, setup.seed)
    rows = slice(0, n)
    _compare_runs(
        few,
        (_rows(many[0], rows), [_rows(step, rows) for step in many[1]]),
        f"env i of {n} should do what env i of {more} does",
    )


def _check_seed_offset(setup: _Setup) -> None:
    last = setup.num_envs - 1
    with setup.env() as env, setup.env(1) as alone:
        batch = _run(env, setup.steps, setup.seed, setup.seed)
        single = _run(alone, setup.steps, setup.seed + last, setup.seed, offset=last)
    rows = slice(last, last + 1)
    _compare_runs(
        (_rows(batch[0], rows), [_rows(step, rows) for step in batch[1]]),
        single,
        f"env {last} of a batch seeded s should do what env 0 of a batch seeded s + {last} does",
    )


def _check_autoreset(setup: _Setup) -> None:
    with setup.env() as env:
        mode = env.metadata.get("autoreset_mode")
        _, history = _run(env, setup.steps, setup.seed, setup.seed)
    assert any(step.ended.any() for step in history), (
        f"no episode ended within {setup.steps} steps of random actions, so autoreset cannot be checked; "
        "make an env with shorter episodes, or take more steps"
    )
    if mode == AutoresetMode.NEXT_STEP:
        _check_next_step(setup, history)
    elif mode == AutoresetMode.SAME_STEP:
        _check_same_step(setup, history)


def _check_next_step(setup: _Setup, history: list[_Step]) -> None:
    for number, (before, step) in enumerate(pairwise(history), start=1):
        after_end = before.ended
        assert not step.reward[after_end].any(), (
            f"step {number}: with next-step autoreset the reward of the step after an episode's end should be 0, "
            f"got {step.reward[after_end]}"
        )
        assert not step.ended[after_end].any(), (
            f"step {number}: with next-step autoreset the flags of the step after an episode's end should be False"
        )
    with setup.env() as env, setup.env() as other:
        actions, others = _Actions(env, setup.seed), _Actions(env, setup.seed + 1000)
        env.reset(seed=setup.seed)
        other.reset(seed=setup.seed)
        ended = np.zeros(setup.num_envs, bool)
        for number in range(setup.steps):
            a, b = actions(), others()
            mixed = _where(ended, b, a)
            result = copy.deepcopy(other.step(mixed))
            difference = _difference(copy.deepcopy(env.step(a)), result)
            assert difference is None, (
                f"step {number}: with next-step autoreset the action of the step after an episode's end should be "
                f"ignored, but another action gave another result: {difference}"
            )
            ended = result[2] | result[3]


def _where(mask: Array, a: Any, b: Any) -> Any:
    if isinstance(a, dict):
        return {key: _where(mask, a[key], b[key]) for key in a}
    if isinstance(a, tuple):
        return tuple(_where(mask, x, y) for x, y in zip(a, b, strict=True))
    return np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b).astype(a.dtype)


def _check_same_step(setup: _Setup, history: list[_Step]) -> None:
    with setup.env() as env:
        single = env.single_observation_space
        batched = env.observation_space
    for number, step in enumerate(history):
        if not step.ended.any():
            continue
        infos = step.infos
        for key in ("final_obs", "final_info"):
            assert key in infos and f"_{key}" in infos, (
                f"step {number}: an episode ended with same-step autoreset, but infos has no {key!r} and '_{key}': "
                f"{sorted(infos)}"
            )
            difference = _difference(np.asarray(infos[f"_{key}"]), step.ended)
            assert difference is None, f"step {number}: infos['_{key}'] should be terminated | truncated: {difference}"
        assert isinstance(infos["final_info"], dict), f"step {number}: infos['final_info']: expected a dict"
        final = infos["final_obs"]
        assert isinstance(final, np.ndarray) and final.dtype == object and final.shape == step.ended.shape, (
            f"step {number}: infos['final_obs']: expected an object array with an observation or None for each env"
        )
        now = list(iterate(batched, step.observation))
        for index, ended in enumerate(step.ended):
            if not ended:
                assert final[index] is None, f"step {number}: infos['final_obs'][{index}]: expected None, it goes on"
                continue
            assert single.contains(final[index]), (
                f"step {number}: infos['final_obs'][{index}] is not in the single observation space: {final[index]}"
            )
            for last, reset in zip(_leaves(final[index]), _leaves(now[index]), strict=True):
                assert not np.shares_memory(last, reset), (
                    f"step {number}: infos['final_obs'][{index}] is a view of the reset observation"
                )


def _check_reset_mask(setup: _Setup) -> None:
    with setup.env() as env:
        if env.metadata.get("autoreset_mode") != AutoresetMode.DISABLED:
            return
        observation, _ = env.reset(seed=setup.seed)
        actions = _Actions(env, setup.seed)
        result = copy.deepcopy(env.step(actions()))
        observation = result[0]
        mask = np.zeros(setup.num_envs, bool)
        mask[0] = True
        options = {"reset_mask": mask, "other": 1}
        given = copy.deepcopy(options)
        after, infos = env.reset(options=options)
        assert options.keys() == given.keys() and _difference(options, given) is None, (
            f"reset changed the options it was given, from {given} to {options}: wrappers read them afterwards"
        )
        _check_observation(env, after, "reset with a mask")
        _check_infos(env, infos, "reset with a mask")
        rows = slice(1, None)
        difference = _difference(_rows(observation, rows), _rows(after, rows))
        assert difference is None, f"reset with a mask changed the observation of an env outside the mask: {difference}"
        with setup.env() as same:
            same.reset(seed=setup.seed)
            others = _Actions(same, setup.seed)
            same.step(others())
            env.action_space.seed(0)
            batch = actions()
            a, b = copy.deepcopy(env.step(batch)), copy.deepcopy(same.step(batch))
            for name, x, y in zip(("observation", "reward", "terminated", "truncated"), a, b, strict=False):
                difference = _difference(_rows(x, rows), _rows(y, rows))
                assert difference is None, (
                    f"after a reset with a mask, {name} of an env outside it differs: {difference}"
                )


def _check_ownership(setup: _Setup) -> None:
    with setup.env() as env, setup.env() as poisoned:
        kept = _run(env, setup.steps, setup.seed, setup.seed, keep=True)
        fresh = _run(poisoned, setup.steps, setup.seed, setup.seed)
        _compare_runs(fresh, kept, "an array that was returned should not be written again")

        actions = _Actions(poisoned, setup.seed)
        observation, _ = poisoned.reset(seed=setup.seed)
        _poison(observation)
        mode = poisoned.metadata.get("autoreset_mode")
        for number, expected in enumerate(fresh[1]):
            batch = actions()
            given = copy.deepcopy(batch)
            step = poisoned.step(batch)
            difference = _difference(batch, given)
            assert difference is None, f"step {number} changed the actions it was given: {difference}"
            ended = step[2] | step[3]
            for name, ours in zip(("observation", "reward", "terminated", "truncated"), step, strict=False):
                difference = _difference(ours, getattr(expected, name))
                assert difference is None, (
                    f"after a caller wrote into the arrays it was given, {name} of step {number} differs: {difference}"
                )
            for part in step[:4]:
                _poison(part)
            if mode == AutoresetMode.DISABLED and ended.any():
                poisoned.reset(options={"reset_mask": ended.copy()})


def _leaves(value: Any) -> list[Array]:
    """Return the arrays in a dict or tuple of arrays, or in an array alone."""
    if isinstance(value, dict):
        return [leaf for key in sorted(value) for leaf in _leaves(value[key])]
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in _leaves(part)]
    return [value] if isinstance(value, np.ndarray) else []


def _poison(value: Any) -> None:
    if isinstance(value, dict):
        for part in value.values():
            _poison(part)
    elif isinstance(value, tuple):
        for part in value:
            _poison(part)
    elif isinstance(value, np.ndarray) and value.dtype != object:
        assert value.flags.writeable, "a returned array is read-only; callers may write into what they are given"
        value[...] = np.nan if value.dtype.kind == "f" else 1


def _check_bad_actions(setup: _Setup) -> None:
    with setup.env() as env, setup.env(setup.num_envs + 1) as wider:
        env.reset(seed=setup.seed)
        _assert_raises(env, _Actions(wider, setup.seed)(), f"actions for {setup.num_envs + 1} envs")
        space = env.single_action_space
        if isinstance(space, spaces.Box) and space.dtype in (np.float32, np.float64):
            for value in (np.nan, np.inf):
                actions = _Actions(env, setup.seed)()
                actions[0] = value
                _assert_raises(env, actions, f"actions with {value}")


def _assert_raises(env: AnyVectorEnv, actions: Any, what: str) -> None:
    try:
        env.step(actions)
    except Exception:
        return
    raise AssertionError(f"step took {what} without an error")


def _check_render(setup: _Setup) -> None:
    with setup.env() as env:
        if env.render_mode != "rgb_array":
            return
        env.reset(seed=setup.seed)
        frames = env.render()
        assert isinstance(frames, Sequence), f"render: expected a tuple or list of frames, got {type(frames).__name__}"
        assert len(frames) == env.num_envs, f"render: expected {env.num_envs} frames, got {len(frames)}"
        for frame in frames:
            assert isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.shape[2:] == (3,), (
                f"render: expected uint8 frames (height, width, 3), got {getattr(frame, 'dtype', type(frame))} "
                f"{getattr(frame, 'shape', '')}"
            )


def _check_close(setup: _Setup) -> None:
    env = setup.make_env(setup.num_envs)
    env.reset(seed=setup.seed)
    env.close()
    assert env.closed, "after close, closed should be True"
    try:
        env.close()
    except Exception as error:
        raise AssertionError(f"closing twice should be allowed, but raised {error!r}") from error


#: The checks by name, in the order they run.
CHECKS: dict[str, Callable[[_Setup], None]] = {
    "spaces": _check_spaces,
    "values": _check_values,
    "determinism": _check_determinism,
    "num_envs": _check_num_envs,
    "seed_offset": _check_seed_offset,
    "autoreset": _check_autoreset,
    "reset_mask": _check_reset_mask,
    "ownership": _check_ownership,
    "bad_actions": _check_bad_actions,
    "render": _check_render,
    "close": _check_close,
}
