"""Checks that the same seeds and actions give the same run, independent of the other envs."""

from __future__ import annotations

from flockstep.testing.comparing import assert_same_runs, rows_of
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
