"""The list of checks, and the function that runs them."""

from __future__ import annotations

from collections.abc import Callable, Collection

from flockstep.errors import did_you_mean
from flockstep.testing.episodes import check_autoreset, check_reset_mask
from flockstep.testing.interface import check_bad_actions, check_close, check_render, check_spaces, check_values
from flockstep.testing.repeating import (
    check_determinism,
    check_num_envs,
    check_ownership,
    check_seed_offset,
    check_snapshot,
)
from flockstep.testing.runs import MakeEnv, Setup


def check_vector_env(
    make_env: MakeEnv,
    *,
    num_envs: int = 4,
    steps: int = 100,
    seed: int = 123,
    skip: Collection[str] = (),
) -> None:
    """Check that a vector environment follows Gymnasium's rules.

    Parameters
    ----------
    make_env
        A function that makes a new env with the given number of sub-envs, identical on every call. Its episodes should
        be short: at least one must end within ``steps`` steps of random actions, otherwise autoreset cannot be checked.
    num_envs
        Number of sub-envs to check with, at least 2. An env whose ``num_groups`` is this number may have several rows
        for each.
    steps
        Number of steps in each compared run.
    seed
        Seed of the resets and of the random actions.
    skip
        Names of checks in `CHECKS` to skip:

        - ``spaces``: batched spaces, metadata, autoreset mode
        - ``values``: types, shapes and dtypes of the results of reset and step, infos with their masks
        - ``determinism``: the same seed and actions give the same run, in the same env and in a new one; without a seed
          a reset starts the next episodes, identical after identical histories
        - ``ownership``: the env neither overwrites nor reads returned arrays, arguments are not changed, a `Task` keeps
          no views of its batch
        - ``snapshot``: an env with ``snapshot`` and ``restore`` continues from a snapshot as if nothing had happened
          since
        - ``num_envs``: env i does the same for any number of envs
        - ``seed_offset``: env i of a batch seeded s does what env 0 of one seeded s + i does (skip this if the envs of
          a batch differ by design)
        - ``autoreset``: the end of an episode follows the env's autoreset mode
        - ``reset_mask``: ``options={"reset_mask": ...}`` resets exactly the masked envs (only with autoreset disabled,
          or if the env has snapshots)
        - ``bad_actions``: actions of a wrong length, or not finite in a `Box`, raise an error
        - ``render``: in the mode ``rgb_array`` there is a frame per env; without a mode, `Task.draw` works in the view
          from above
        - ``close``: closing twice is allowed

    Raises
    ------
    AssertionError
        The env breaks a rule; the message says which one, and how.
    ValueError
        ``skip`` contains an unknown name, or there are fewer than two envs.
    """
    unknown = sorted(set(skip) - set(CHECKS))
    if unknown:
        hint = did_you_mean(unknown[0], CHECKS)
        raise ValueError(f"skip: expected some of {', '.join(CHECKS)}, got {unknown[0]!r}{hint}")
    if num_envs < 2:
        raise ValueError(f"num_envs: expected at least 2, got {num_envs}")
    setup = Setup(make_env, num_envs, steps, seed)
    for name, check in CHECKS.items():
        if name not in skip:
            check(setup)


#: The checks by name, in running order.
CHECKS: dict[str, Callable[[Setup], None]] = {
    "spaces": check_spaces,
    "values": check_values,
    "determinism": check_determinism,
    "ownership": check_ownership,
    "snapshot": check_snapshot,
    "num_envs": check_num_envs,
    "seed_offset": check_seed_offset,
    "autoreset": check_autoreset,
    "reset_mask": check_reset_mask,
    "bad_actions": check_bad_actions,
    "render": check_render,
    "close": check_close,
}
