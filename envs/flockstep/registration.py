"""Gymnasium ids of this package's environments and of your own tasks."""

from __future__ import annotations

from os import PathLike, fspath
from typing import Any

import gymnasium

from flockstep._core import NativeTask, NavigationConfig, engine_tasks, time_limit
from flockstep.keywords import by_config
from flockstep.serialization import to_plain
from flockstep.task import Task
from flockstep.vector_env import OWN_KEYWORDS, DroneVectorEnv

_NO_DEFAULTS = ("num_envs", "autoreset_mode", "copy")  # set by the code that makes the environments


def register() -> None:
    """Register the environments with Gymnasium, once; done by ``import flockstep``."""
    if "flockstep/LidarNavigation-v0" in gymnasium.registry:
        return
    flights = {name.capitalize(): config() for name, config in engine_tasks.items() if name != "navigation"}
    navigation = {"LidarNavigation": "goal", "CameraNavigation": "blob", "CameraPixels": "pixels"}
    for name, task in flights.items():
        _register(f"flockstep/{name}-v0", {"task": task}, _limit_of(task))
    for name, observation in navigation.items():
        limit = _limit_of(NavigationConfig.observing(observation))
        _register(f"flockstep/{name}-v0", {"observation": observation}, limit)


def _limit_of(task: Any) -> int:
    """Return a task's default time limit in steps; 0 means none."""
    if isinstance(task, type):
        limit = getattr(task, "max_episode_steps", 0)
        return limit if isinstance(limit, int) else 0  # other values are rejected when an environment is made
    return time_limit(task)


def _register(env_id: str, keywords: dict[str, Any], limit: int) -> None:
    """Register an environment. The spec holds its time limit, which `DroneEnv` and `DroneVectorEnv` apply."""
    gymnasium.register(
        id=env_id,
        entry_point="flockstep.env:DroneEnv",
        vector_entry_point="flockstep.vector_env:DroneVectorEnv",
        max_episode_steps=limit if limit > 0 else None,
        kwargs=to_plain(keywords),
    )


def make_by_id(env_id: str, num_envs: int, **keywords: Any) -> DroneVectorEnv:
    """Call `gymnasium.make_vec`. A ``task`` among the keywords brings its own time limit, which replaces the id's.

    Raises
    ------
    TypeError
        The id is not one of this package.
    """
    if "task" in keywords:
        keywords.setdefault("max_episode_steps", None)
    made = gymnasium.make_vec(env_id, num_envs, **keywords)
    if not isinstance(made, DroneVectorEnv):
        made.close()
        raise TypeError(f"env: expected an id of this package, {env_id!r} is a {type(made).__name__}")
    return made


def make_any(env: str | Task | type[Task] | NativeTask, num_envs: int, **keywords: Any) -> DroneVectorEnv:
    """Make an env by its id or from a task."""
    if isinstance(env, str):
        return make_by_id(env, num_envs, **keywords)
    return DroneVectorEnv(num_envs, task=env, **keywords)


def make_same_step(
    caller: str,
    env: str | Task | type[Task] | NativeTask,
    num_envs: int,
    *,
    ends_stay: bool = False,
    watch: bool = False,
    **keywords: Any,
) -> DroneVectorEnv:
    """Make an env by its id or from a task, with same-step autoreset and without copies.

    With ``ends_stay`` envs stay where their episodes end instead, until they are reset, and return copies. With
    ``watch`` a view shows them at the speed of flight, and this waits until its page is open.

    Raises
    ------
    TypeError
        The keywords choose either of these.
    """
    own = [name for name in ("autoreset_mode", "copy") if name in keywords]
    if own:
        mode = "disabled" if ends_stay else "same-step"
        raise TypeError(f"{caller}: {' and '.join(own)} cannot be chosen: it needs {mode} autoreset")
    keywords |= {"autoreset_mode": "disabled"} if ends_stay else {"autoreset_mode": "same_step", "copy": False}
    made = make_any(env, num_envs, **keywords)
    if watch:
        from flockstep.viewer import view  # it imports vector envs

        try:
            view(made, real_time=True).wait()
        except BaseException:
            made.close()
            raise
    return made


def register_task(env_id: str, task: type[Task] | str | PathLike[str], **defaults: Any) -> None:
    """Register your own task with Gymnasium, so that `gymnasium.make_vec` can make its environments.

    >>> flockstep.register_task("mine/ReachHeight-v0", ReachHeight, worlds="hall.json", frame_skip=2)
    >>> envs = gymnasium.make_vec("mine/ReachHeight-v0", num_envs=64, frame_skip=4)  # in the hall, by 4 steps

    Parameters
    ----------
    env_id
        The id, such as ``"mine/ReachHeight-v0"``.
    task
        A subclass of `Task`, of which each environment gets its own instance, or the path of a shared library with a
        C++ task, as for `NativeTask`.
    **defaults
        Default keywords of `DroneVectorEnv` for its environments; keywords of `gymnasium.make_vec` or `gymnasium.make`
        override them. ``num_envs``, ``autoreset_mode`` and ``copy`` are not allowed.

    Raises
    ------
    ValueError
        The library cannot be loaded, or exports no task.
    TypeError
        The task is neither, or a default is not a keyword. Values are checked when an environment is made.
    """
    is_task = issubclass(task, Task) if isinstance(task, type) else isinstance(task, (str, PathLike))
    if not is_task:
        hint = ": give its class, so that each environment gets a task of its own" if isinstance(task, Task) else ""
        raise TypeError(f"task: expected a subclass of flockstep.Task or the path of a library, got {task!r}{hint}")
    refused = [name for name in defaults if name in _NO_DEFAULTS]
    if refused:
        raise TypeError(f"register_task: expected no defaults for {', '.join(_NO_DEFAULTS)}, got {', '.join(refused)}")
    description = task if isinstance(task, type) else NativeTask(fspath(task))
    fields = {name: value for name, value in defaults.items() if name not in OWN_KEYWORDS}
    by_config(fields, description, OWN_KEYWORDS)  # rejects unknown keywords
    limit = defaults.get("max_episode_steps")
    if limit is None:
        limit = _limit_of(description)
    if isinstance(limit, int) and limit > 0:
        defaults.pop("max_episode_steps", None)  # the spec holds it
    else:
        limit = 0
    _register(env_id, {**defaults, "task": description}, limit)
