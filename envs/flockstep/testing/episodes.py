"""Checks of episode ends and beginnings: autoreset, and resets with a mask."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import iterate

from flockstep.testing.comparing import arrays_in, difference_between, rows_of
from flockstep.testing.interface import check_contained, check_infos, check_observation
from flockstep.testing.runs import Actions, Array, Setup, Step, rows_per_env, run


def check_autoreset(setup: Setup) -> None:
    """Check that the end of an episode follows the env's autoreset mode."""
    with setup.env() as env:
        mode = env.metadata.get("autoreset_mode")
        _, history = run(env, setup.steps, setup.seed, setup.seed)
    assert any(step.ended.any() for step in history), (
        f"no episode ended within {setup.steps} steps of random actions, so autoreset cannot be checked; "
        "make an env with shorter episodes, or give a larger steps"
    )
    if mode == AutoresetMode.NEXT_STEP:
        _check_next_step(setup, history)
    elif mode == AutoresetMode.SAME_STEP:
        _check_same_step(setup, history)


def _check_next_step(setup: Setup, history: list[Step]) -> None:
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
        actions, others = Actions(env, setup.seed), Actions(env, setup.seed + 1000)
        env.reset(seed=setup.seed)
        other.reset(seed=setup.seed)
        ended = np.zeros(env.num_envs, bool)
        for number in range(setup.steps):
            a, b = actions(), others()
            mixed = _where(ended, b, a)
            result = copy.deepcopy(other.step(mixed))
            difference = difference_between(copy.deepcopy(env.step(a)), result)
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


def _check_same_step(setup: Setup, history: list[Step]) -> None:
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
            difference = difference_between(np.asarray(infos[f"_{key}"]), step.ended)
            assert difference is None, f"step {number}: infos['_{key}'] should be terminated | truncated: {difference}"
        assert isinstance(infos["final_info"], dict), f"step {number}: infos['final_info']: expected a dict"
        final = infos["final_obs"]
        assert isinstance(final, np.ndarray) and final.dtype == object and final.shape == step.ended.shape, (
            f"step {number}: infos['final_obs']: expected an object array with an observation or None for each env"
        )
        now = list(iterate(batched, step.observation))
        for index, ended in enumerate(step.ended):
            if not ended:
                assert final[index] is None, (
                    f"step {number}: infos['final_obs'][{index}]: expected None, since its episode continues"
                )
                continue
            check_contained(single, final[index], f"step {number}: infos['final_obs'][{index}]")
            for last, reset in zip(arrays_in(final[index]), arrays_in(now[index]), strict=True):
                assert not np.shares_memory(last, reset), (
                    f"step {number}: infos['final_obs'][{index}] is a view of the reset observation"
                )


def check_reset_mask(setup: Setup) -> None:
    """Check that a reset with a mask resets exactly the masked envs.

    Gymnasium defines such resets only with autoreset disabled; an env with snapshots is expected to support them
    always.
    """
    with setup.env() as env:
        if env.metadata.get("autoreset_mode") != AutoresetMode.DISABLED and not hasattr(env.unwrapped, "snapshot"):
            return
        observation, _ = env.reset(seed=setup.seed)
        actions = Actions(env, setup.seed)
        result = copy.deepcopy(env.step(actions()))
        observation = result[0]
        count = rows_per_env(env)
        mask = np.zeros(env.num_envs, bool)
        mask[:count] = True
        options = {"reset_mask": mask}
        given = copy.deepcopy(options)
        after, infos = env.reset(options=options)
        assert options.keys() == given.keys() and difference_between(options, given) is None, (
            f"reset changed the options it was given, from {given} to {options}: wrappers read them afterwards"
        )
        check_observation(env, after, "reset with a mask")
        check_infos(env, infos, "reset with a mask")
        rows = slice(count, None)
        difference = difference_between(rows_of(observation, rows), rows_of(after, rows))
        assert difference is None, f"reset with a mask changed the observation of an env outside the mask: {difference}"
        with setup.env() as same:
            same.reset(seed=setup.seed)
            others = Actions(same, setup.seed)
            same.step(others())
            for _ in range(setup.steps):
                batch = actions()
                a, b = copy.deepcopy(env.step(batch)), copy.deepcopy(same.step(batch))
                for name, x, y in zip(("observation", "reward", "terminated", "truncated"), a, b, strict=False):
                    difference = difference_between(rows_of(x, rows), rows_of(y, rows))
                    assert difference is None, (
                        f"after a reset with a mask, {name} of an env outside it differs: {difference}; check "
                        "that a reset writes only the rows of its mask"
                    )
