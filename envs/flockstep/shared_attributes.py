"""Attributes and methods of a vector env for wrappers that expect one env per row."""

from __future__ import annotations

from typing import Any

import numpy as np

from flockstep.errors import did_you_mean
from flockstep.task import Task
from flockstep.task_declarations import settable_names


class SharedAttributes:
    """The calls ``call``, ``get_attr`` and ``set_attr`` of Gymnasium, for envs that share one object."""

    num_envs: int
    task: Any

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of this env or its `Task` once, or read an attribute, and return the result for each env."""
        value = getattr(self._owner_of(name), name)
        return self._per_env(value(*args, **kwargs) if callable(value) else value)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of this env or its `Task` for each env: its rows if it has N rows, otherwise N copies."""
        return self._per_env(getattr(self._owner_of(name), name))

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of this env, or of its `Task` if only the task has it. All drones share it.

        Raises
        ------
        ValueError
            A list or tuple does not hold the same value N times.
        AttributeError
            Neither has the attribute, or it is only read when an env is made, such as a task's ``reward_terms``.
        """
        if isinstance(values, (list, tuple)):
            if len(values) != self.num_envs or any(value != values[0] for value in values):
                raise ValueError(f"{name}: expected one value, or {self.num_envs} equal values: the envs share it")
            values = values[0]
        owner = self._owner_of(name)
        settable = ["reward_scale"]
        if isinstance(self.task, Task):
            settable += sorted(settable_names(self.task))
        if not hasattr(owner, name) or (owner is self.task and name not in settable):
            expected = f"the name of an attribute that can be set ({', '.join(settable)})"
            raise AttributeError(f"set_attr: expected {expected}, got {name!r}{did_you_mean(name, settable)}")
        setattr(owner, name, values)

    def _owner_of(self, name: str) -> Any:
        """Return the task if only it has the attribute, otherwise this env."""
        is_of_task = not hasattr(self, name) and isinstance(self.task, Task) and hasattr(self.task, name)
        return self.task if is_of_task else self

    def _per_env(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, (np.ndarray, list, tuple)) and len(value) == self.num_envs:
            return tuple(value)
        return (value,) * self.num_envs
