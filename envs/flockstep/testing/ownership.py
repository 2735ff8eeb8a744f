"""The check of array ownership."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from flockstep._core import Batch
from flockstep.task import Task
from flockstep.testing.comparing import arrays_in, assert_same_runs, difference_between
from flockstep.testing.runs import Actions, Setup, run


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
