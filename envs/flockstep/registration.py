"""The ids under which Gymnasium knows the environments of this package, and those of tasks of your own."""

from __future__ import annotations

from os import PathLike, fspath

import gymnasium

from flockstep._core import NativeTask
from flockstep.plain import to_plain
from flockstep.task import Task


def register() -> None:
    """Register the environments with Gymnasium; done by ``import flockstep``.

    No ``max_episode_steps`` here: the engine counts the steps itself, so that the time limit is one keyword for
    `gymnasium.make_vec` and no `TimeLimit` wrapper is needed around a single environment.
    """
    for task, observation in (("LidarNavigation", "goal"), ("CameraNavigation", "blob"), ("CameraPixels", "pixels")):
        if f"flockstep/{task}-v0" not in gymnasium.registry:
            gymnasium.register(
                id=f"flockstep/{task}-v0",
                entry_point="flockstep.env:DroneEnv",
                vector_entry_point="flockstep.vector_env:DroneVectorEnv",
                kwargs={"observation": observation},
            )


def register_task(env_id: str, task: type[Task] | str | PathLike[str]) -> None:
    """Register a task of your own with Gymnasium: `gymnasium.make_vec` makes its environments from then on.

    Parameters
    ----------
    env_id
        Such as ``"mine/ReachHeight-v0"``.
    task
        A subclass of `Task`, which is made anew for each environment, or the path of a shared library with a task in
        C++, as `NativeTask` takes it.

    Raises
    ------
    ValueError
        The library cannot be loaded, or exports no task.
    """
    gymnasium.register(
        id=env_id,
        entry_point="flockstep.env:DroneEnv",
        vector_entry_point="flockstep.vector_env:DroneVectorEnv",
        kwargs={"task": to_plain(task if isinstance(task, type) else NativeTask(fspath(task)))},
    )
