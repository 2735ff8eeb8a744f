"""Checks of the names that a task declares, and the spaces of its arrays."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from flockstep._core import _renamed
from flockstep.task import _PROVIDED, Task, _name

#: Attributes that a subclass may declare and methods that it may override.
_DECLARED = tuple(name for name in Task.__annotations__ if name not in _PROVIDED and not name.startswith("_"))
_METHODS = tuple(name for name, value in vars(Task).items() if inspect.isfunction(value) and not name.startswith("_"))


def settable_names(task: Task) -> set[str]:
    """Return the public attributes of a task that may be set between steps: ``step_m`` and those that `Task` lacks."""
    return {
        name
        for name in dir(task)
        if not name.startswith("_")
        and (name == "step_m" or not (hasattr(Task, name) or name in Task.__annotations__))
        and not callable(inspect.getattr_static(task, name))
    }


def names_in(task: Task, field: str) -> tuple[str, ...]:
    """Return a field that holds names. Raises an error if it is not a sequence of names or holds a duplicate."""
    names = getattr(task, field)
    if isinstance(names, str):
        raise TypeError(f"{_name(task)}.{field}: expected a tuple of names, got {names!r}: write ({names!r},)")
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"{_name(task)}.{field}: expected a tuple of names, got {names!r}")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{_name(task)}.{field}: expected different names, got {twice!r} twice")
    return tuple(names)


def refuse_misspelt(task: Task) -> None:
    """Raise TypeError if a public name of a task resembles a member of `Task` that its class does not define.

    Names that begin with an underscore and attributes that are set in `setup` are not checked.
    """
    own: dict[str, Any] = {}
    for kind in type(task).__mro__[::-1]:
        if kind not in Task.__mro__:
            own.update(vars(kind))
    own.update(vars(task))
    for name, value in own.items():
        if name.startswith("_") or hasattr(Task, name) or name in Task.__annotations__:
            continue
        value = getattr(value, "__func__", value)  # for static and class methods
        if isinstance(value, type) or (hasattr(value, "__get__") and not inspect.isroutine(value)):
            continue  # nested classes and properties
        known = _METHODS if callable(value) else _DECLARED
        meant = next((other for other in known if other not in own and _is_near(name, value, other)), None)
        if meant is not None:
            raise TypeError(
                f"{_name(task)}.{name} resembles a name of Task. Did you mean {meant!r}? If not, begin it with "
                "an underscore; an attribute may be set in setup instead"
            )


def _is_near(name: str, value: Any, meant: str) -> bool:
    """Return whether a name differs from the intended one only in case, underscores, a plural or a typing error."""
    if callable(value):
        needed = len(inspect.signature(getattr(Task, meant)).parameters)
        if _letters(name) == _letters(meant):
            return True
        if needed < 2 or needed != _count_parameters(value):
            return False  # it could not be called in place of the other method
    elif _has_words_of(name, meant) or _OTHER_NAMES.get(name) == meant:
        return True
    elif meant == "step_m" or name.strip("_").count("_") > meant.count("_"):
        return _letters(name) == _letters(meant)  # lidar_m or step_ms may be a quantity with its unit
    a, b = (_letters(text).removesuffix("s") for text in (name, meant))
    # A word that begins with another letter is another word: flight is no misspelt light.
    return sorted(a) == sorted(b) or (a[:1] == b[:1] and difflib.SequenceMatcher(None, a, b).ratio() > 0.88)


#: Names that other packages, or earlier versions, give to attributes of tasks.
_OTHER_NAMES = _renamed | dict.fromkeys(
    ("episode_length", "max_episode_length", "max_ep_len", "time_limit", "horizon"), "max_episode_steps"
)


def _has_words_of(name: str, meant: str) -> bool:
    """Return whether a name leaves out or shortens words of the intended one, as in max_steps and max_ep_steps."""
    words, known = name.lower().split("_"), meant.split("_")
    if len(words) < 2 or not (known[0].startswith(words[0]) and known[-1].startswith(words[-1])):
        return False
    left = iter(known)
    return all(len(word) > 1 and any(other.startswith(word) for other in left) for word in words)


def _count_parameters(function: Any) -> int | None:
    try:
        return len(inspect.signature(function).parameters)
    except ValueError:  # raised for some builtins
        return None


def _letters(name: str) -> str:
    return name.replace("_", "").lower()


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
