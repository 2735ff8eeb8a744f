"""Write a trained policy for programs without Python: a C header, or an ONNX file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from gymnasium import spaces

from flockstep import stepping
from flockstep._core import DynamicsConfig, __version__
from flockstep.learning.actor import Actor, actor_of, parts_of, size_of
from flockstep.learning.c_header import c_header
from flockstep.learning.onnx_file import onnx_file
from flockstep.vector_env import DroneVectorEnv


def export(model: Any, path: str | PathLike[str], *, env: Any = None) -> None:
    """Write the policy of a model as a C header or an ONNX file: its deterministic actions, as `predict` returns them.

    A ``.h`` is C99 that needs only ``math.h`` and no memory but the stack. ``policy.h`` has the functions
    ``policy_act``, which computes an action, and ``policy_self_test``, which repeats some of Python's. A comment lists
    the numbers of an observation and of an action, with their units. ``.onnx`` needs the package onnx, and takes rows
    of observations.

    >>> flockstep.export(model, "policy.h")

    Parameters
    ----------
    model
        A model of `flockstep.PPO`, `flockstep.APG` or Stable-Baselines3 whose policy consists of fully connected
        layers.
    path
        The file. What stands before ``.h`` begins all names in it.
    env
        The environment of the training, by default the model's own. The comment describes a `DroneVectorEnv`, also
        within wrappers, and a ``VecNormalize`` becomes part of the policy.

    Raises
    ------
    ValueError, TypeError
        The policy has another part, such as images or memory, which the message names, or the path another ending.
    """
    target = Path(fspath(path))
    name = target.stem
    if target.suffix not in (".h", ".onnx"):
        raise ValueError(f"path: expected a file that ends in .h or .onnx, got {target.name!r}")
    if target.suffix == ".h" and not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise ValueError(f"path: expected a name of letters, digits and _ before .h, got {target.name!r}")
    actor = actor_of(model, env)
    if env is not None and not _fits(model, env):
        raise ValueError(f"env: expected an environment with the observations and actions of the model, got {env!r}")
    if isinstance(env, DroneVectorEnv):
        stepping.require_open(env)
    words = [*_words(actor, _drones_of(model.env if env is None else env))]
    content = c_header(actor, name, words).encode() if target.suffix == ".h" else onnx_file(actor, name, words)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content)


def _drones_of(env: Any) -> DroneVectorEnv | None:
    """Return the environment within wrappers, or None if it is of another kind or closed."""
    while env is not None and not isinstance(env, DroneVectorEnv):
        inner = getattr(env, "venv", None) or getattr(env, "env", None) or getattr(env, "envs", None)
        env = inner[0] if isinstance(inner, (list, tuple)) and inner else inner  # of a DummyVecEnv
    return env if hasattr(env, "batch") else None


def _fits(model: Any, env: Any) -> bool:
    names = ("observation_space", "action_space")
    return all(getattr(env, f"single_{name}", getattr(env, name, None)) == getattr(model, name) for name in names)


def _words(actor: Actor, drones: DroneVectorEnv | None) -> Iterator[str]:
    """Yield lines about the numbers of observations and actions."""
    yield f"Written by flockstep {__version__}."
    yield ""
    yield f"Observation: {actor.observation_size} numbers."
    known = None if drones is None else _task_of(drones)
    if drones is None or known is None:
        first = 0
        for name, part in parts_of(actor.observation_space):
            size = size_of(part)
            yield f"  {_range(first, size):>9}  {name or 'observation'}, shape {part.shape}"
            first += size
    else:
        yield from _observed(actor, drones, known)
    yield ""
    yield f"Action: {actor.action_space}."
    if drones is None or known is None:
        return
    yield known._words["action"]
    dynamics, drone = drones.recipe.dynamics, drones.batch.drone
    hz = drones.recipe.clock.policy_hz
    others = len(drones.batch.airframes) - 1
    name = f"{drone.name}, the first of {others + 1} airframes" if others > 0 else drone.name
    yield f"Drone {name}, control {str(dynamics.control)!r}, {hz:g} actions per second."
    words = f"{known._words['observed']} {known._words['observation']} {known._words['action']}"
    told = {name: getattr(known, name) for name in known.__match_args__ if f"``{name}``" in words}
    if drone.num_rotors and str(dynamics.control) != "pose":
        rotors = ", ".join(f"{name} {_number(value)}" for name, value in drone.to_dict()["rotors"].items())
        yield f"Rotors: {rotors}. Hovering at {drone.hover_speed_radps:g} rad/s."
        told |= {name: getattr(dynamics, name) for name in DynamicsConfig.__match_args__ if name.startswith("max_")}
    yield ", ".join(f"{name} {_number(value)}" for name, value in told.items())
    for lidar in drones.lidars[:1]:
        beams = f"{lidar.channels} x {lidar.beams} beams over {lidar.hfov_deg:g} degrees"
        yield f"LiDAR: {beams}, up to {lidar.max_range_m:g} m."
    yield "Body axes: x forward, y left, z up."


def _number(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _task_of(drones: DroneVectorEnv) -> Any:
    """Return the configuration of a task of the engine, or None for a task of the user's own."""
    task = drones.recipe.task
    return task if hasattr(task, "_words") else None


def _observed(actor: Actor, drones: DroneVectorEnv, task: Any) -> Iterator[str]:
    observed = drones.recipe.observed
    past = observed.past_actions * size_of(actor.action_space)
    if isinstance(actor.action_space, spaces.Discrete):
        past = observed.past_actions * int(actor.action_space.n)
    size = (actor.observation_size - past - bool(observed.age)) // observed.history
    yield f"{task._words['observed']}"
    rows = [(numbers, text) for numbers, text in task._words["observation"] if _is_observed(task, numbers)]
    rotors = drones.batch.drone.num_rotors
    counts = [rotors if "each rotor" in text else _count(task, numbers) for numbers, text in rows]
    unknown = counts.count(None)
    rest = (size - sum(count or 0 for count in counts)) // max(unknown, 1)
    counts = [rest if count is None else count for count in counts]
    first = 0
    for count, (numbers, text) in zip(counts, rows, strict=True):
        where = _range(first, count or 0) if sum(count or 0 for count in counts) == size else numbers.split(",")[0]
        yield f"  {where:>9}  {text}"
        first += count or 0
    if observed.history > 1:
        yield f"  {_range(size, size * (observed.history - 1)):>9}  the same of earlier steps, the newest first"
    first = size * observed.history
    if past:
        yield f"  {_range(first, past):>9}  the last {observed.past_actions} actions, the newest first; at first 0"
    if observed.age:
        yield f"  {_range(first + past, 1):>9}  age of the newest observation, s"
    if observed.delay_s or observed.jitter_s:
        yield f"In training they were {observed.delay_s:g} s late, and up to {observed.jitter_s:g} s more."


def _is_observed(task: Any, numbers: str) -> bool:
    choice = re.search(r'"(\w+)"', numbers)
    return not choice or choice[1] == task.observation


def _count(task: Any, numbers: str) -> int | None:
    """Return how many numbers a row of words stands for, or None for those of beams."""
    found = re.match(r"(\d+)(?: for each of ``(\w+)``)?", numbers)
    return int(found[1]) * (int(getattr(task, found[2])) if found[2] else 1) if found else None


def _range(first: int, count: int) -> str:
    return f"[{first}]" if count == 1 else f"[{first}..{first + count - 1}]"
