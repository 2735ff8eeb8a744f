"""Flying what was trained."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from gymnasium.vector.utils import batch_space

from flockstep import scenes
from flockstep._core import NativeTask
from flockstep.recording import actions_of
from flockstep.sb3.vec_env import make_vec
from flockstep.scenes import WorldsLike
from flockstep.task import Task


def success_rates(
    model: Any,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    worlds: WorldsLike = ("train", "validation"),
    episodes: int = 1,
    seed: int = 0,
    **kwargs: Any,
) -> dict[str, float]:
    """Fly a policy in each of some worlds; return the share of episodes that succeeded.

    Parameters
    ----------
    model
        A trained model, such as a `PPO`, whose deterministic policy flies; or a function from observations (N, ...) to
        actions (N, ...), or None for random actions.
    env
        What it flies, as `make_vec` takes it.
    worlds
        Scenes, sets of them, worlds, or a list of these. By default the seven playgrounds: the five of ``"train"`` and
        the two of ``"validation"``.
    episodes
        In each world. Where every episode begins alike, as with the built-in tasks unless ``random_start=True``, more
        than one tell no more.
    seed
        Of the first env; the others have those that follow.
    **kwargs
        Further keywords of `DroneVectorEnv`.

    Returns
    -------
    dict
        From the name of each world to its share in [0, 1].
    """
    if episodes < 1:
        raise ValueError(f"episodes: expected an integer >= 1, got {episodes}")
    loaded = scenes.load(worlds)
    envs = make_vec(env, len(loaded) * episodes, worlds=loaded, **kwargs)
    envs.seed(seed)
    act = actions_of(model, batch_space(envs.action_space, envs.num_envs), seed)
    observation: Any = envs.reset()
    outcomes: list[bool | None] = [None] * envs.num_envs
    while None in outcomes:
        observation, _, done, infos = envs.step(act(observation))
        for i in np.flatnonzero(done):
            if outcomes[i] is None:  # an env that is done goes on with another episode, which does not count
                outcomes[i] = infos[i]["is_success"]
    envs.close()
    by_world: dict[str, list[bool]] = defaultdict(list)
    for k, success in enumerate(outcomes):
        by_world[loaded[k % len(loaded)].name].append(bool(success))
    return {name: float(np.mean(successes)) for name, successes in by_world.items()}
