"""Checks that runs depend on seeds and actions alone: not on other envs, nor on what callers do with arrays."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from flockstep._core import Batch
from flockstep.task import Task
from flockstep.testing.comparing import arrays_in, assert_same_runs, difference_between, rows_of
from flockstep.testing.runs import Actions, Setup, go_on, rows_per_env, run


def check_determinism(setup: Setup) -> None:
    """Check that the same seed and actions give the same run, in the same env and in a new one."""
    with setup.env() as env, setup.env() as other:
        first = run(env, setup.steps, setup.seed, setup.seed)
        on = run(env, setup.steps // 4, None, setup.seed)
        again = run(env, setup.steps, setup.seed, setup.seed)
        assert_same_runs(first, again, "the same seed and actions should give the same run in the same env")
        on_again = run(env, setup.steps // 4, None, setup.seed)
        assert_same_runs(on, on_again, "runs after a reset without a seed should be equal after equal histories")
        fresh = run(other, setup.steps, setup.seed, setup.seed)
        assert_same_runs(first, fresh, "the same seed and actions should give the same run in a new env")


def check_snapshot(setup: Setup) -> None:
    """Check that an env with `snapshot` and `restore` continues from a snapshot as if nothing had happened since."""
    with setup.env() as env, setup.env() as other:
        if not (callable(getattr(env, "snapshot", None)) and callable(getattr(env, "restore", None))):
            return
        observation, _ = run(env, setup.steps // 2, setup.seed, setup.seed)
        kept = env.snapshot()  # type: ignore[attr-defined]
        first = go_on(env, setup.steps, Actions(env, setup.seed + 1))
        env.restore(kept)  # type: ignore[attr-defined]
        again = go_on(env, setup.steps, Actions(env, setup.seed + 1))
        told = "a run after a snapshot should repeat when the snapshot is restored"
        assert_same_runs((observation, first), (observation, again), told)
        run(other, setup.steps // 4, setup.seed + 1, setup.seed + 2)
        other.restore(kept)  # type: ignore[attr-defined]
        elsewhere = go_on(other, setup.steps, Actions(other, setup.seed + 1))
        assert_same_runs((observation, first), (observation, elsewhere), f"{told}, in another env too")


def check_num_envs(setup: Setup) -> None:
    """Check that env i does the same for any number of envs."""
    n, more = setup.num_envs, 2 * setup.num_envs + 1
    with setup.env(n) as env, setup.env(more) as wide:
        few, many = run(env, setup.steps, setup.seed, setup.seed), run(wide, setup.steps, setup.seed, setup.seed)
    rows = slice(0, len(few[1][0].reward))
    assert_same_runs(
        few,
        (rows_of(many[0], rows), [rows_of(step, rows) for step in many[1]]),
        f"env i of {n} should equal env i of {more}",
    )


def check_seed_offset(setup: Setup) -> None:
    """Check that env i of a batch seeded s does what env 0 of one seeded s + i does."""
    last = setup.num_envs - 1
    with setup.env() as env, setup.env(1) as alone:
        batch = run(env, setup.steps, setup.seed, setup.seed)
        count = rows_per_env(env)
        single = run(alone, setup.steps, setup.seed + last, setup.seed, offset=last * count)
        worlds = getattr(getattr(env.unwrapped, "batch", None), "worlds", ())
    rows = slice(last * count, (last + 1) * count)
    rule = f"env {last} of a batch seeded s should equal env 0 of a batch seeded s + {last}"
    if len(worlds) > 1:
        rule += " (unless envs take several worlds in turn: give one world, random_world=True or skip=('seed_offset',))"
    assert_same_runs(
        (rows_of(batch[0], rows), [rows_of(step, rows) for step in batch[1]]),
        single,
        rule,
    )


def check_ownership(setup: Setup) -> None:
    """Check that the env neither overwrites nor reads returned arrays, changes no arguments and keeps no views."""
    with setup.env() as env, setup.env() as poisoned:
        kept = run(env, setup.steps, setup.seed, setup.seed, keep=True)
        fresh = run(poisoned, setup.steps, setup.seed, setup.seed)
        _check_views(getattr(env.unwrapped, "task", None))
        assert_same_runs(fresh, kept, "a returned array should not be written later")

        actions = Actions(poisoned, setup.seed)
        observation, _ = poisoned.reset(seed=setup.seed)
        _poison(observation)
        mode = poisoned.metadata.get("autoreset_mode")
        for number, expected in enumerate(fresh[1]):
            batch = actions()
            given = copy.deepcopy(batch)
            step = poisoned.step(batch)
            difference = difference_between(batch, given)
            assert difference is None, f"step {number} changed the actions it was given: {difference}"
            ended = step[2] | step[3]
            for name, ours in zip(("observation", "reward", "terminated", "truncated"), step, strict=False):
                difference = difference_between(ours, getattr(expected, name))
                assert difference is None, (
                    f"after a caller wrote into the arrays it was given, {name} of step {number} differs: {difference}"
                )
            for part in step[:4]:
                _poison(part)
            if mode == AutoresetMode.DISABLED and ended.any():
                poisoned.reset(options={"reset_mask": ended.copy()})


def _check_views(task: Any) -> None:
    """Check that a task holds no view of its batch's memory."""
    for name, value in vars(task).items() if isinstance(task, Task) else ():
        for array in arrays_in(value):
            owner: Any = array
            while isinstance(owner, np.ndarray):
                owner = owner.base
            assert not isinstance(owner, Batch), (
                f"{type(task).__name__}.{name} is a view of the batch, which the next step overwrites: keep a copy, "
                f"such as self.{name} = batch.position.copy()"
            )


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
