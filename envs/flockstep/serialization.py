"""Convert the arguments of environments to JSON values, so that ``env.spec.to_json()`` is complete.

A configuration becomes ``{"flockstep.LidarConfig": {"beams": 20, ...}}``; worlds, drones and tasks get the same form.
The environments accept either form.
"""

from __future__ import annotations

import dataclasses
import importlib
import sys
from enum import Enum
from os import PathLike, fspath
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from flockstep import _core
from flockstep._core import DroneModel, NativeTask, World
from flockstep.drone_mesh import DroneMesh

_PREFIX = "flockstep."
_CONFIGS: tuple[Any, ...] = tuple(item for item in vars(_core).values() if hasattr(item, "_fields"))
#: Other objects, which convert themselves.
_OBJECTS: dict[str, Any] = {kind.__name__: kind for kind in (World, DroneModel, DroneMesh)}


def to_plain(value: Any) -> Any:
    """Return a value with all objects of this package converted to plain form; other values are unchanged."""
    if isinstance(value, _CONFIGS):
        return _tagged(type(value).__name__, {name: getattr(value, name) for name in type(value).__match_args__})
    for kind, item in _OBJECTS.items():
        if isinstance(value, item):
            return _tagged(kind, value.to_dict())
    if isinstance(value, NativeTask):
        return _tagged("NativeTask", value.path)
    if isinstance(value, type) and _found(value.__module__, value.__qualname__) is value:
        return _tagged("Task", f"{value.__module__}:{value.__qualname__}")
    if isinstance(value, dict):
        return {key: to_plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(part) for part in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    return fspath(value) if isinstance(value, PathLike) else value


class PlainSpec:
    """Descriptor for the attribute ``spec`` of an env: Gymnasium's spec with the arguments in plain form."""

    def __get__(self, env: Any, owner: type) -> EnvSpec | None:
        return None if env is None else env.__dict__.get("_spec")

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        env._spec = None if spec is None else dataclasses.replace(spec, kwargs=to_plain(spec.kwargs))


def _tagged(kind: str, value: Any) -> dict[str, Any]:
    return {_PREFIX + kind: to_plain(value)}


def from_plain(value: Any) -> Any:
    """Invert `to_plain`; other values are returned unchanged."""
    if isinstance(value, list):
        return [from_plain(part) for part in value]
    if isinstance(value, tuple):
        return tuple(from_plain(part) for part in value)
    if not isinstance(value, dict) or len(value) != 1:
        return value
    (key, content), *_ = value.items()
    if not isinstance(key, str) or not key.startswith(_PREFIX):
        return value
    kind = key.removeprefix(_PREFIX)
    by_name = {config.__name__: config for config in _CONFIGS}
    if kind in by_name:
        return by_name[kind](**{name: from_plain(part) for name, part in content.items()})
    if kind in _OBJECTS:
        return _OBJECTS[kind].from_dict(content)
    if kind == "NativeTask":
        return NativeTask(content)
    if kind == "Task":
        module, _, name = content.partition(":")
        importlib.import_module(module)
        found = _found(module, name)
        if found is None:
            raise ValueError(f"task: expected a class of the module {module!r}, got {name!r}")
        return found
    kinds = [*by_name, *_OBJECTS, "NativeTask", "Task"]
    raise ValueError(f"expected one of {', '.join(kinds)}, got {key!r}")


def _found(module: str, name: str) -> Any:
    """Return the object of this name in an imported module, or None."""
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return found
