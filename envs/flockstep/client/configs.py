"""Configurations in messages: JSON objects of their fields."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, TypeVar

import numpy as np

from flockstep._core import BodyConfig, World
from flockstep.client import protocol as pb
from flockstep.client.frames import Arrays
from flockstep.errors import did_you_mean

_T = TypeVar("_T")
_GLB_URI = "data:model/gltf-binary;base64,"  # begins a mesh in JSON


def change_json(kind: type[Any], known: type[Any], fields: Mapping[str, Any]) -> str:
    """Return fields of a configuration as JSON; empty if there are none. What is None does not change.

    Raises
    ------
    TypeError
        ``known``, a `TypedDict`, has no such field, or the value has another type.
    """
    names, config = known.__annotations__, kind()
    for name in fields:
        if name not in names:
            raise TypeError(f"{name}: expected a field of {kind.__name__}{did_you_mean(name, names)}")
    changes = {name: value for name, value in fields.items() if value is not None}
    for name, value in changes.items():
        setattr(config, name, value)  # which checks its type
        changes[name] = value = _plain(value)
        parts = np.ravel([*value.values()] if isinstance(value, dict) else value)
        if not all(isfinite(part) for part in parts if isinstance(part, (int, float))):
            raise ValueError(f"{name}: expected finite numbers, got {value}")
    return json.dumps(changes) if changes else ""


def config_of(kind: type[_T]) -> Callable[[pb.Reply, Arrays], _T]:
    """Return a reader of a configuration in a reply."""
    return lambda reply, arrays: _made(kind, json.loads(reply.config.config_json))


def body_json(body: BodyConfig) -> str:
    """Return the configuration of a body as JSON."""
    if not isinstance(body, BodyConfig):
        raise TypeError(f"body: expected a flockstep.BodyConfig, got {body!r}")
    return json.dumps(_plain(body))


def body_configs(reply: pb.Reply, arrays: Arrays) -> list[list[BodyConfig | None]]:
    """Return the configurations of bodies in a reply."""
    known = [*map(_body, reply.configs.config_json)]
    return [[None if number < 0 else known[number] for number in row] for row in arrays["config"]]


def _made(kind: type[_T], fields: dict[str, Any]) -> _T:
    """Return a configuration with these fields, of which some may be configurations."""
    default = kind()
    parts = {name: type(getattr(default, name)) for name, value in fields.items() if isinstance(value, dict)}
    return kind(**fields | {name: _made(part, fields[name]) for name, part in parts.items()})


def _plain(value: Any) -> Any:
    """Return a configuration as JSON values."""
    if hasattr(type(value), "__match_args__"):
        return {name: _plain(getattr(value, name)) for name in type(value).__match_args__}
    if isinstance(value, World):
        return _GLB_URI + base64.b64encode(value.to_glb()).decode()
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _body(text: str) -> BodyConfig:
    fields = json.loads(text)
    if (mesh := fields.get("mesh")) is not None:
        fields["mesh"] = World.from_glb(base64.b64decode(mesh.removeprefix(_GLB_URI)))
    return _made(BodyConfig, fields)
