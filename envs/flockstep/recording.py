"""A film of a flight."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import gymnasium
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import NativeTask
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv


def record(
    path: str | PathLike[str],
    policy: Any = None,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    *,
    steps: int = 400,
    seed: int = 0,
    render_view: str | npt.ArrayLike = "third_person",
    fps: int = 20,
    **kwargs: Any,
) -> int:
    """Fly one drone and write a film of it, until its first episode ends.

    Needs imageio with ffmpeg, as the extra ``sb3`` brings it.

    Parameters
    ----------
    path
        Of the film: ``.mp4`` or ``.gif``.
    policy
        A model of Stable-Baselines3, whose deterministic policy flies, or a function from observations (1, ...) to
        actions (1, ...). None: random actions.
    env
        A Gymnasium id, a `Task` (an object, or its class) or a `NativeTask`.
    steps
        The film ends after so many steps at the latest.
    seed
        Of the episode, and of random actions.
    render_view
        As `DroneVectorEnv` takes it; so are ``render_size`` and ``render_camera``.
    fps
        Pictures per second of the film; there is one of each step, and one before. With ``frame_skip=k`` a step flies k
        times as far: 20 / k shows it at the usual speed.
    **kwargs
        Further keywords of `DroneVectorEnv`, such as ``worlds``.

    Returns
    -------
    int
        How many pictures the film has.
    """
    if Path(path).suffix.lower() not in (".mp4", ".gif"):
        raise ValueError(f"path: expected a name that ends with .mp4 or .gif, got {fspath(path)!r}")
    if steps < 1:
        raise ValueError(f"steps: expected an integer >= 1, got {steps}")
    try:
        import imageio.v2 as imageio
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "record needs imageio: pip install 'imageio[ffmpeg]' pillow", name="imageio"
        ) from error
    kwargs |= {"autoreset_mode": "disabled", "render_mode": "rgb_array", "render_view": render_view}
    envs = DroneVectorEnv(1, task=env, **kwargs) if not isinstance(env, str) else gymnasium.make_vec(env, 1, **kwargs)
    if not isinstance(envs, DroneVectorEnv):
        raise TypeError(f"env: expected an id of this package, {env!r} is a {type(envs).__name__}")
    act = actions_of(policy, envs.action_space, seed)
    observation, _ = envs.reset(seed=seed)
    is_gif = Path(path).suffix.lower() == ".gif"
    # By default imageio makes the sides multiples of 16; the codec needs even ones.
    settings = {"duration": 1000 / fps, "loop": 0} if is_gif else {"fps": fps, "quality": 8, "macro_block_size": 2}
    pictures = 0
    film: Any  # as imageio types its writers, they cannot append
    with imageio.get_writer(Path(path), **settings) as film:
        for step in range(steps + 1):
            if step > 0:
                observation, _, terminated, truncated, _ = envs.step(act(observation))
            frames = envs.render()
            assert frames is not None
            film.append_data(frames[0])
            pictures += 1
            if step > 0 and (terminated[0] or truncated[0]):
                break
    envs.close()
    return pictures


def actions_of(policy: Any, action_space: spaces.Space[Any], seed: int) -> Callable[[Any], Any]:
    """Return the function from observations to actions that a policy is: a model, a function, None for random ones."""
    if policy is None:
        action_space.seed(seed)
        return lambda observation: action_space.sample()
    if hasattr(policy, "predict"):
        return lambda observation: policy.predict(observation, deterministic=True)[0]
    if not callable(policy):
        raise TypeError(f"policy: expected a model with predict, a function or None, got {policy!r}")
    function: Callable[[Any], Any] = policy
    return function
