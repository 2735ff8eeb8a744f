"""Gymnasium spaces from a task's declarations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces


class Field(Protocol):
    """A declared array: that of the engine, or of a server."""

    @property
    def name(self) -> str:
        """Name of the array."""

    @property
    def dtype(self) -> str:
        """NumPy name of the type."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one row."""

    @property
    def low(self) -> Any:
        """Minimum: a number, or an array of ``shape``."""

    @property
    def high(self) -> Any:
        """Maximum: a number, or an array of ``shape``."""


class TaskSpec(Protocol):
    """Action and observations of a task."""

    @property
    def action(self) -> Field:
        """One row of the actions."""

    @property
    def observation(self) -> Sequence[Field]:
        """Fields of the observation."""


def observation_space(spec: TaskSpec) -> spaces.Space[Any]:
    """Return the space of one env's observation: a Box, or a Dict of Boxes if there are several fields."""
    boxes: dict[str, spaces.Space[Any]] = {field.name: _box(field) for field in spec.observation}
    return spaces.Dict(boxes) if len(boxes) > 1 else next(iter(boxes.values()))


def action_space(spec: TaskSpec) -> spaces.Space[Any]:
    """Return the space of one env's action: a Discrete for integers, a Box for floats."""
    field = spec.action
    if field.dtype.startswith("int"):
        return spaces.Discrete(int(field.high) - int(field.low) + 1, start=int(field.low))
    return _box(field)


def _box(field: Field) -> spaces.Box:
    dtype = np.dtype(field.dtype)
    low, high = (np.broadcast_to(bound, field.shape).astype(dtype) for bound in (field.low, field.high))
    return spaces.Box(low, high, dtype=dtype.type)
