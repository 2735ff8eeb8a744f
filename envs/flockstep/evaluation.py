"""Evaluate trained policies."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flockstep import scenes, stepping
from flockstep._core import EpisodeEnd, NativeTask
from flockstep.progress_line import ProgressLine
from flockstep.recording import actions_of
from flockstep.recordings import Capture
from flockstep.recordings.recording import require_saveable
from flockstep.registration import make_same_step
from flockstep.scenes import WorldsLike
from flockstep.task import Task

if TYPE_CHECKING:
    from typing import Literal

_MOST_RECORDED = 64  # envs


@dataclass(frozen=True)
class Evaluation:
    """How a policy's episodes ended, as shares, and the means of what they reported."""

    episodes: int
    """Number of episodes that counted: one of each drone."""
    success_rate: float
    """Share of successful episodes, in [0, 1]: ``ends["success"]``."""
    ends: dict[str, float]
    """Share of the episodes that ended for each reason, by the name of the `EpisodeEnd`; they sum to 1."""
    episode_return: float
    """Sum of the rewards, unscaled."""
    episode_length: float
    """Number of control steps."""
    episode_terms: dict[str, float]
    """Sum of each reward term, by name."""
    infos: dict[str, float]
    """Mean of each value that a `Task` lists in its ``info_names``."""


def evaluate(
    model: Any,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    episodes: int = 100,
    seed: int = 0,
    *,
    drone_episodes: Literal["team", "each", "last"] | None = None,
    record: str | PathLike[str] | None = None,
    **kwargs: Any,
) -> Evaluation:
    """Fly a policy for some episodes; return how often each kind of end occurred, and the means of all other values.

    Each env has one drone, unless the task's default is another or you pass ``drones_per_env``. A policy that learned
    with other drones needs the same keywords about drones here as in its training.

    >>> flockstep.evaluate(None, "flockstep/Hover-v0").ends  # random actions
    {'success': 0.0, 'contact': 0.21, 'left_area': 0.79, 'bad_state': 0.0, 'time': 0.0, 'task': 0.0, 'teammate': 0.0}

    Parameters
    ----------
    model
        A model of `flockstep.PPO`, Stable-Baselines3 or sb3-contrib, flown deterministically; a function from
        observations (N, ...) to actions (N, ...); or None for random actions. Recurrent models keep their state from
        step to step and forget it where an episode begins.
    env
        A Gymnasium id of this package, your own `Task` (an object, or its class) or `NativeTask`.
    episodes
        Number of envs that fly in parallel. The first episode of each counts; with several drones in each env, the
        first episode of each drone.
    seed
        Seed of the first env; the others use the following numbers. Training with ``PPO(seed=s)`` began with s, s + 1
        and so on. Choose other seeds, otherwise you may evaluate on training episodes.
    drone_episodes
        How the episodes of an env's drones belong together: the keyword ``episodes`` of `DroneVectorEnv`. Default: that
        of a `Task`, otherwise ``"team"``.
    record
        A file ``.html`` or ``.mcap`` for a `Recording` of the episodes, of the first 64 envs. The results stay the
        same. Not with ``drone_episodes="each"``.
    **kwargs
        Further keywords of `DroneVectorEnv`, such as ``through``. Several ``worlds`` are assigned to the envs in turn.
    """
    keywords: dict[str, Any] = {**kwargs, **_mode(drone_episodes)}
    if record is not None:
        require_saveable(record)
    envs = make_same_step("evaluate", env, _count(episodes), ends_stay=record is not None, **keywords)
    if record is not None and envs.recipe.episode.episodes == "each" and envs.drones_per_env > 1:
        raise ValueError("record: expected None with drone_episodes='each', whose drones begin again while others fly")
    names = envs.task.info_names if isinstance(envs.task, Task) else []
    capture = None if record is None else Capture(envs, num_envs=_MOST_RECORDED)
    ends = first_episodes(model, envs, "evaluate", seed, capture=capture)
    if capture is not None and record is not None:
        capture.recording().save(record)
    return Evaluation(
        episodes=len(ends),
        success_rate=_mean(end["is_success"] for end in ends),
        ends={
            reason.name: _mean(end["episode_end"] == reason for end in ends)
            for reason in EpisodeEnd
            if reason is not EpisodeEnd.none
        },
        episode_return=_mean(end["episode"]["r"] for end in ends),
        episode_length=_mean(end["episode"]["l"] for end in ends),
        episode_terms={name: _mean(end["episode_terms"][name] for end in ends) for name in ends[0]["episode_terms"]},
        infos={name: _mean(end[name] for end in ends) for name in names},
    )


def success_rates(
    model: Any,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    worlds: WorldsLike | None = None,
    episodes: int = 1,
    seed: int = 0,
    *,
    drone_episodes: Literal["team", "each", "last"] | None = None,
    **kwargs: Any,
) -> dict[str, float]:
    """Fly a policy in several worlds; return the success rate in each.

    Parameters
    ----------
    model, env, seed, drone_episodes, **kwargs
        As for `evaluate`.
    worlds
        Scenes, sets of scenes, worlds, or a list of these. Default: the worlds that a `Task` declares, otherwise the
        seven playgrounds: five in ``"train"`` and two in ``"validation"``.
    episodes
        Number of envs in each world, as for `evaluate`. One is enough if all episodes begin the same way, as in the
        navigation tasks without ``random_start=True``.

    Returns
    -------
    dict
        Success rate in [0, 1] by the name of the world.
    """
    if worlds is None:
        worlds = getattr(kwargs.get("task", env), "worlds", None) or ("train", "validation")
    loaded = scenes.load(worlds)
    keywords = {**kwargs, **_mode(drone_episodes)}
    envs = make_same_step("success_rates", env, len(loaded) * _count(episodes), worlds=loaded, **keywords)
    rows_per_env = envs.num_envs // envs.num_groups
    by_world: dict[str, list[bool]] = defaultdict(list)
    for row, end in enumerate(first_episodes(model, envs, "success_rates", seed)):
        by_world[loaded[row // rows_per_env % len(loaded)].name].append(end["is_success"])
    return {name: _mean(successes) for name, successes in by_world.items()}


def first_episodes(
    model: Any,
    envs: Any,
    caller: str,
    seed: int,
    watch: Callable[[Any, npt.NDArray[np.bool_]], None] | None = None,
    capture: Capture | None = None,
    progress: ProgressLine | None = None,
) -> list[dict[str, Any]]:
    """Fly envs until each row has ended an episode; return the infos of these ends, and close the envs.

    After each step ``watch`` is called with the observation, and a mask (N,) of the rows whose first episode goes on.
    ``progress`` shows how many have ended.
    """
    act = actions_of(model, envs, caller, seed)
    observation, starts = envs.reset(seed=seed)[0], np.ones(envs.num_envs, bool)
    found: list[dict[str, Any] | None] = [None] * envs.num_envs
    going = np.ones(envs.num_envs, bool)
    if capture is not None:
        capture.add()
    while going.any():
        actions = act(observation, starts)
        observation, _, terminated, truncated, _ = envs.step(actions)
        if capture is not None:
            capture.add(actions)
        starts = terminated | truncated
        ended = np.flatnonzero(starts & going)  # later episodes do not count
        for i, end in zip(ended, stepping.ends(envs, ended, 0.0), strict=True):
            found[i] = end
        going &= ~starts
        if watch is not None:
            watch(observation, going)
        if progress is not None and progress.is_due:
            progress.show(f"{int((~going).sum()):,} of {len(going):,} flights have ended, {progress.seconds:.0f} s")
    envs.close()
    if progress is not None:
        progress.clear()
    return [end for end in found if end is not None]


def _mode(drone_episodes: str | None) -> dict[str, Any]:
    return {} if drone_episodes is None else {"episodes": drone_episodes}


def _count(episodes: Any) -> int:
    if not isinstance(episodes, (int, np.integer)) or isinstance(episodes, bool) or episodes < 1:
        hint = f" (drone_episodes={episodes!r} is the env's keyword)" if isinstance(episodes, str) else ""
        raise ValueError(f"episodes: expected an integer >= 1, got {episodes!r}{hint}")
    return int(episodes)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
