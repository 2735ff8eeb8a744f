"""Flying what was trained."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flockstep import scenes
from flockstep._core import EpisodeEnd, NativeTask
from flockstep.recording import actions_of
from flockstep.sb3.vec_env import DroneVecEnv, make_vec
from flockstep.scenes import WorldsLike
from flockstep.task import Task


@dataclass(frozen=True)
class Evaluation:
    """How the episodes of a policy ended, and means over them."""

    episodes: int
    """Number of episodes."""
    success_rate: float
    """Share of successful episodes, in [0, 1]: ``ends["success"]``."""
    ends: dict[str, float]
    """Share of the episodes that ended for each reason, by the name of the `EpisodeEnd`; they sum to 1."""
    episode_return: float
    """Sum of the rewards, unscaled."""
    episode_length: float
    """Flown steps."""
    episode_terms: dict[str, float]
    """Sum of each of the reward's terms, by its name."""
    infos: dict[str, float]
    """What a `Task` names in its ``info_names``."""


def evaluate(
    model: Any,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    episodes: int = 100,
    seed: int = 0,
    **kwargs: Any,
) -> Evaluation:
    """Fly a policy for some episodes; return how they ended, and means of everything else that episodes report.

    >>> flockstep.sb3.evaluate(None, "flockstep/Hover-v0").ends  # random actions
    {'success': 0.0, 'contact': 0.21, 'left_area': 0.79, 'bad_state': 0.0, 'time': 0.0, 'task': 0.0}

    Parameters
    ----------
    model
        A trained model, such as a `PPO`, whose deterministic policy flies; or a function from observations (N, ...) to
        actions (N, ...), or None for random actions.
    env
        What it flies, as `make_vec` takes it.
    episodes
        How many: the first one of as many envs, which fly at once.
    seed
        Of the first env; the others have those that follow. With ``PPO(seed=s)`` the training has begun with s, s + 1
        and so on: take others, or the policy may know the very episodes.
    **kwargs
        Further keywords of `DroneVectorEnv`, such as ``worlds``, which the envs take in turn.
    """
    envs = make_vec(env, _count(episodes), **kwargs)
    names = [] if not isinstance(envs.env.task, Task) else envs.env.task.info_names
    ends = _first_episodes(model, envs, "evaluate", seed)
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
    **kwargs: Any,
) -> dict[str, float]:
    """Fly a policy in each of some worlds; return the share of episodes that succeeded.

    Parameters
    ----------
    model, env, seed, **kwargs
        As `evaluate` takes them.
    worlds
        Scenes, sets of them, worlds, or a list of these. Default: those that a `Task` declares, else the seven
        playgrounds, the five of ``"train"`` and the two of ``"validation"``.
    episodes
        In each world. Where every episode begins alike, as with the built-in tasks unless ``random_start=True``, more
        than one tell no more.

    Returns
    -------
    dict
        From the name of each world to its share in [0, 1].
    """
    if worlds is None:
        worlds = getattr(kwargs.get("task", env), "worlds", None) or ("train", "validation")
    loaded = scenes.load(worlds)
    envs = make_vec(env, len(loaded) * _count(episodes), worlds=loaded, **kwargs)
    by_world: dict[str, list[bool]] = defaultdict(list)
    for k, end in enumerate(_first_episodes(model, envs, "success_rates", seed)):
        by_world[loaded[k % len(loaded)].name].append(end["is_success"])
    return {name: _mean(successes) for name, successes in by_world.items()}


def _first_episodes(model: Any, envs: DroneVecEnv, caller: str, seed: int) -> list[dict[str, Any]]:
    """Fly until every env has ended an episode; return the infos of these first ends, and close the envs."""
    act = actions_of(model, envs.env, caller, seed)
    envs.seed(seed)
    observation: Any = envs.reset()
    ends: list[dict[str, Any] | None] = [None] * envs.num_envs
    while None in ends:
        observation, _, done, infos = envs.step(act(observation))
        for i in np.flatnonzero(done):
            if ends[i] is None:  # an env that is done goes on with another episode, which does not count
                ends[i] = infos[i]
    envs.close()
    return [end for end in ends if end is not None]


def _count(episodes: Any) -> int:
    if not isinstance(episodes, (int, np.integer)) or isinstance(episodes, bool) or episodes < 1:
        raise ValueError(f"episodes: expected an integer >= 1, got {episodes!r}")
    return int(episodes)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
