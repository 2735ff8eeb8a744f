"""The way from keywords to a `Recipe`, by the engine's lists of fields."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from copy import copy as copied
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from flockstep import serialization
from flockstep._core import (
    EpisodeConfig,
    NativeTask,
    NavigationConfig,
    PythonTask,
    Recipe,
    _unexpected_keyword,
    batch_keywords,
    engine_tasks,
)
from flockstep.env_keywords import EnvKeywords
from flockstep.errors import did_you_mean
from flockstep.stepping import AUTORESET_MODES
from flockstep.task import Task
from flockstep.task_calls import TaskCalls, native_task

_Config = TypeVar("_Config")

#: Configurations of a recipe by their keywords, such as "clock".
CONFIGS: dict[str, Any] = {
    keyword: type(value)
    for keyword, field in batch_keywords.items()
    if hasattr(value := getattr(Recipe(), field), "_fields")
}

#: Fields of configurations that are keywords of an env. The list only shrinks: a new field goes by its configuration,
#: as in ``dynamics=DynamicsConfig(...)``, or by the task's, as in ``task=...``.
FLAT = frozenset(
    """
    action ahead_s autoreset_mode body_drag cap_episodes cap_rise_mps cap_success change_weight close_m close_weight
    color control controller_hz crash_weight downwash episodes frame_skip friction gate_weight gates_ahead
    goal_distance_m goal_radius_m goal_weight ground_effect gyroscopic hold_m hold_s hold_weight integrator jitter_m
    laps leader_speed_mps loop_radius_m max_acceleration_mps2 max_distance_m max_episode_steps max_rate_dps
    max_speed_mps max_thrust_to_weight max_tilt_deg max_yaw_rate_dps miss_m motion near_m near_weight neighbors
    observation_scale on_contact path physics_hz place_weight points policy_hz progress_weight radius_m random_start
    random_world rates_weight restitution reward rotor_drag rotor_lag route shape sight_m size_m spacing_m
    speed_cap_mps speed_mps speed_weight spin_weight stagger_first_episode start start_offset_m start_rate_dps
    start_speed_mps start_tilt_deg start_yaw_deg step_m time_weight wind yaw yaw_step_deg yaw_weight
    """.split()  # noqa: SIM905 # one name a line would be a page
)


@dataclass
class Routed:
    """The parts of an env. The last two are None for tasks of the engine, which a recipe describes completely."""

    recipe: Recipe
    task: Any  # the given task, with its fields set by keywords
    own_task: NativeTask | PythonTask | None  # what `Batch` takes for it
    calls: TaskCalls | None


def route(task: Any, observation: str, keywords: Mapping[str, Any], own: Iterable[str]) -> Routed:
    """Return the recipe that a task and keywords describe; ``own`` are further names that the caller takes.

    The task sets the defaults. A configuration among the keywords replaces its own one, and fields are set in these.

    Raises
    ------
    TypeError
        A name is not a keyword, it belongs to another task, or a field has one value by itself and another one in its
        configuration.
    """
    flat = by_config(keywords, task, own)
    if task is not None and observation != "goal":
        if isinstance(task, NavigationConfig):
            raise TypeError("observation: the NavigationConfig has its own: set NavigationConfig.observation")
        raise TypeError("observation: a keyword of the navigation task, but another task is given")
    fields = flat.pop("task", {})
    if task is None:
        recipe = Recipe(_changed(NavigationConfig.observing(observation), fields))
    elif type(task) in engine_tasks.values():
        task = type(task)(**{name: getattr(task, name) for name in type(task).__match_args__} | fields)
        recipe = Recipe(task)
    elif isinstance(task, Task):
        _refuse_keywords_on(task, own)
        recipe = Recipe(f"{type(task).__module__}/{type(task).__qualname__}")
        recipe._set(**{name: getattr(task, name) for name in batch_keywords if hasattr(Task, name)})
        if task.drone is not None:
            recipe.drone = task.drone
        said = {name: getattr(task, name) for name in EpisodeConfig.__match_args__ if hasattr(Task, name)}
        recipe.episode = EpisodeConfig(**{**said, "max_episode_steps": None})  # the task's own limit
    elif isinstance(task, NativeTask):
        recipe = Recipe(task)
    else:
        kinds = ", ".join(config.__name__ for config in engine_tasks.values())
        hint = ". gymnasium.make_vec makes an env of an id" if isinstance(task, str) else ""
        raise TypeError(f"task: expected a flockstep.Task, a NativeTask or one of {kinds}, got {task!r}{hint}")
    recipe._set(**{name: value for name, value in keywords.items() if name in batch_keywords})
    for name, config in flat.items():
        _set_fields(recipe, name, config, keywords.get(name))
    if not isinstance(task, Task):
        return Routed(recipe, task, task if isinstance(task, NativeTask) else None, None)
    if recipe.episode.max_episode_steps is not None:
        task.max_episode_steps = recipe.episode.max_episode_steps
    return Routed(recipe, task, *native_task(task))


def by_config(keywords: Mapping[str, Any], task: Any, own: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Group those keywords that are fields by the keyword of their configuration, or by ``"task"``.

    Raises
    ------
    TypeError
        A name is not a keyword, or it belongs to another task.
    """
    kind: Any = NavigationConfig if task is None else type(task)
    configs: dict[str, Any] = {**CONFIGS, "task": kind} if kind in engine_tasks.values() else CONFIGS
    chosen: dict[str, dict[str, Any]] = {}
    for name, value in keywords.items():
        if name in batch_keywords:
            continue
        owner = next((key for key, config in configs.items() if name in config.__match_args__), None)
        if owner is not None and name in FLAT:
            chosen.setdefault(owner, {})[name] = value
            continue
        if owner is not None and name not in own:
            advice = f"give it as {owner}=flockstep.{configs[owner].__name__}({name}=...)"
            raise TypeError(f"{name}: a field of a configuration: {advice}")
        others = [title for title, config in engine_tasks.items() if name in config.__match_args__ and name in FLAT]
        if others:
            *first, last = others
            tasks = f"{', '.join(first)} and {last} tasks" if first else f"{last} task"
            raise TypeError(f"{name}: a keyword of the {tasks}, but another task is given")
        fields = (field for config in configs.values() for field in config.__match_args__ if field in FLAT)
        known = [] if name == "seed" else [*own, *batch_keywords, *fields]
        text = _unexpected_keyword("DroneVectorEnv.__init__", name, known)
        raise TypeError(f"{text}: pass it to reset(seed=...)" if name == "seed" else text)
    return chosen


def _set_fields(recipe: Recipe, name: str, fields: Mapping[str, Any], given: Any) -> None:
    """Set fields of a recipe's configuration; ``given`` is the configuration among the keywords, or None."""
    config, default = _changed(getattr(recipe, name), fields), CONFIGS[name]()
    for field in fields if given is not None else ():
        said, value = getattr(given, field), getattr(config, field)
        if said not in (value, getattr(default, field)):
            raise TypeError(f"{field}: expected one value, got {field}={value!r} and {name}.{field}={said!r}")
    setattr(recipe, name, config)


def keywords_of(recipe: Recipe, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keywords that make an env of a recipe, with some of them changed."""
    given: dict[str, Any] = {"num_envs": recipe.num_envs, "worlds": recipe.worlds, "drone": recipe.drone}
    if recipe.task is not None:
        given["task"] = _registered(recipe.task) if isinstance(recipe.task, str) else recipe.task
    given |= {keyword: getattr(recipe, field) for keyword, field in batch_keywords.items()}
    rest = dict(changes)
    if "autoreset_mode" in rest:
        rest["autoreset_mode"] = autoreset_name(rest["autoreset_mode"])
    for name in CONFIGS.keys() - changes.keys():
        fields = {field: rest.pop(field) for field in CONFIGS[name].__match_args__ if field in FLAT and field in rest}
        given[name] = _changed(given[name], fields)
    return {**given, **rest}


def _registered(env_id: str) -> Any:
    """Return the task that is registered with Gymnasium under an id."""
    spec = gymnasium.registry.get(env_id)
    if spec is None or "task" not in spec.kwargs:
        raise ValueError(
            f"task.name: expected an id registered by flockstep.register_task (import the module that registers it), "
            f"got {env_id!r}{did_you_mean(env_id, gymnasium.registry)}"
        )
    return serialization.from_plain(spec.kwargs["task"])


def names_of_worlds(worlds: Any) -> list[str]:
    """Return the names or paths of worlds; an empty list for worlds given as objects, which a recipe cannot name."""
    listed = [worlds] if isinstance(worlds, (str, PathLike)) else worlds
    are_names = isinstance(listed, Sequence) and all(isinstance(name, (str, PathLike)) for name in listed)
    return [fspath(name) for name in listed] if are_names else []


def _changed(config: _Config, fields: Mapping[str, Any]) -> _Config:
    """Return a copy of a configuration with some fields changed; the engine checks the fields together."""
    copy = copied(config)
    for name, value in fields.items():
        setattr(copy, name, value)
    return copy


def _refuse_keywords_on(task: Task, own: Iterable[str]) -> None:
    """Raise TypeError if a task's class sets a keyword of the env that envs do not read from tasks."""
    kind = type(task)
    config_of = {field: name for name in CONFIGS if hasattr(Task, name) for field in CONFIGS[name].__match_args__}
    keywords = {*config_of, *batch_keywords, *EpisodeConfig.__match_args__, *own}
    keywords -= {"task", "observation", "copy", "episode"}  # useless on a class, or too common as names
    for name in sorted(name for name in keywords if not hasattr(Task, name)):
        value = inspect.getattr_static(kind, name, None)
        if value is None or callable(value) or hasattr(value, "__get__"):  # own methods and properties
            continue
        config = config_of.get(name)
        said: Any = None if config is None else getattr(getattr(task, config), name, None)
        if said is not None and np.array_equal(said, value):
            continue  # another name for the same value of the configuration
        advice = "give it to the env"
        if config is not None:
            advice = f"write {config} = flockstep.{CONFIGS[config].__name__}({name}=...), or give it to the env"
        raise TypeError(f"{kind.__name__}.{name}: envs do not read it from a task: {advice}")


def require_count(name: str, value: Any) -> int:
    """Return a number of envs or drones. Raises ValueError if it is not an integer >= 1."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
        advice = ""
        if isinstance(value, str) and name == "num_envs":
            advice = f"; for an env by its id, call gymnasium.make_vec({value!r}, num_envs=...)"
        raise ValueError(f"{name}: expected an integer >= 1, got {value!r}{advice}")
    return int(value)


def autoreset_name(mode: str | AutoresetMode) -> str:
    """Return the engine's name of an autoreset mode."""
    if mode in tuple(AutoresetMode) or mode in tuple(member.value for member in AutoresetMode):
        mode = AutoresetMode(mode)  # Gymnasium's own members and their values, such as "SameStep"
        return next(name for name, member in AUTORESET_MODES.items() if member is mode)
    if mode not in AUTORESET_MODES:
        hint = did_you_mean(mode, AUTORESET_MODES)
        raise ValueError(
            f"autoreset_mode: expected {', '.join(map(repr, AUTORESET_MODES))} or an AutoresetMode, got {mode!r}{hint}"
        )
    return mode


def show_keywords(env: type) -> tuple[str, ...]:
    """Show the fields among the keywords of an env in its signature and docstring; return the names of the others."""
    init: Any = env.__init__  # type: ignore[misc] # of the class, on purpose
    own = len(inspect.signature(init).parameters) - 1
    init.__signature__, _ = with_keywords(inspect.signature(init), EnvKeywords)
    add_parameters(env, EnvKeywords, before="Attributes")
    return tuple(init.__signature__.parameters)[1:own]


def add_parameters(cls: type, listed: type, before: str) -> None:
    """Add the parameters that another class documents to a docstring, in front of a section."""
    if cls.__doc__ and listed.__doc__:  # neither with python -OO
        head, found, rest = inspect.cleandoc(cls.__doc__).partition(f"\n\n{before}\n-")
        about = inspect.cleandoc(listed.__doc__).partition("----------\n")[2]
        cls.__doc__ = f"{head}\n{about}{found}{rest}"


def add_fields(cls: type, config: type[Any], before: str) -> None:
    """Add the fields of a configuration to a docstring, in front of a parameter, unless it describes them itself."""
    if not cls.__doc__:  # with python -OO
        return
    doc = inspect.cleandoc(cls.__doc__)
    head, found, rest = doc.partition(f"\n{before}\n    ")
    about = [f"\n{f['name']}\n    {f['about']}" for f in config._fields if f"\n{f['name']}\n    " not in doc]
    cls.__doc__ = head + "".join(about) + found + rest


def with_keywords(signature: inspect.Signature, keywords: type[Any]) -> tuple[inspect.Signature, str]:
    """Return a signature with the keywords of a `TypedDict` in place of its last parameter, and their descriptions."""
    *own, _ = signature.parameters.values()
    named = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind.__forward_arg__)
        for name, kind in keywords.__annotations__.items()
    ]
    about = (keywords.__doc__ or "").partition("----------\n")[2].rstrip()  # empty with python -OO
    return signature.replace(parameters=[*own, *named]), about
