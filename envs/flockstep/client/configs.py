"""Configurations in messages: JSON objects of their fields."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from flockstep._core import BodyConfig, BodyMotion, World
from flockstep.client import protocol_pb2 as pb
from flockstep.client.frames import Arrays

_GLB_URI = "data:model/gltf-binary;base64,"  # begins a mesh in JSON


def body_json(body: BodyConfig) -> str:
    """Return the configuration of a body as JSON."""
    if not isinstance(body, BodyConfig):
        raise TypeError(f"body: expected a flockstep.BodyConfig, got {body!r}")
    return json.dumps(_plain(body))


def body_configs(reply: pb.Reply, arrays: Arrays) -> list[list[BodyConfig | None]]:
    """Return the configurations of bodies in a reply."""
    known = [*map(_body, reply.body_configs.config_json)]
    return [[None if number < 0 else known[number] for number in row] for row in arrays["config"]]


def _plain(value: Any) -> Any:
    """Return a configuration as JSON values."""
    if isinstance(value, (BodyConfig, BodyMotion)):
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
    return BodyConfig(**{**fields, "motion": BodyMotion(**fields["motion"])})
