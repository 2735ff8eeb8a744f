"""Callbacks of a training: those of Stable-Baselines3, and functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flockstep.learning.sources import Stepped


def progress_of(model: Any, seconds: float, first: int = 0) -> str:
    """Return the steps, the time and the success rate of a training that began at step ``first``, in a line."""
    steps, total = model.num_timesteps, model._total_timesteps
    share = min(steps / total, 1.0)  # training completes its last rollout
    line = f"{steps:,} of {total:,} steps ({share:.0%}), {seconds:.0f} s"
    line += f", {(steps - first) / max(seconds, 1e-9):,.0f} steps/s"
    successes = model.ep_success_buffer
    return f"{line}, success rate {np.mean(successes):.2f}" if successes else line


class Callbacks:
    """Calls the callbacks of a training.

    A callback is a function of ``(locals, globals)`` that returns False to stop, or an object with the methods of
    ``BaseCallback``: ``init_callback``, ``on_training_start`` and so on. ``locals`` holds self, rewards,
    dones and infos.
    """

    def __init__(self, given: Any, model: Any) -> None:
        listed = [] if given is None else list(given) if isinstance(given, (list, tuple)) else [given]
        self._model = model
        self._functions: list[Callable[[dict[str, Any], dict[str, Any]], bool]] = []
        self._objects: list[Any] = []
        for callback in listed:
            if hasattr(callback, "init_callback"):
                callback.init_callback(model)
                self._objects.append(callback)
            elif callable(callback):
                self._functions.append(callback)
            else:
                raise TypeError(f"callback: expected a BaseCallback, a function or a list of them, got {callback!r}")
        self._locals: dict[str, Any] = {}

    @property
    def need_infos(self) -> bool:
        """True if a callback may read infos."""
        return bool(self._functions) or any(getattr(each, "need_infos", True) for each in self._objects)

    def start(self, local: dict[str, Any], global_: dict[str, Any]) -> None:
        """Call ``on_training_start``."""
        for callback in self._objects:
            callback.on_training_start(local, global_)

    def start_rollout(self) -> None:
        """Call ``on_rollout_start``."""
        for callback in self._objects:
            callback.on_rollout_start()

    def step(self, stepped: Stepped) -> bool:
        """Call ``on_step`` and the functions; return False if one of them stops the training."""
        if not self.need_infos:
            return all(_goes_on(callback.on_step()) for callback in self._objects)
        self._locals = {
            "self": self._model,
            "rewards": stepped.rewards,
            "dones": stepped.dones,
            "infos": stepped.infos,
        }
        goes_on = True
        for callback in self._objects:
            callback.update_locals(self._locals)
            goes_on &= _goes_on(callback.on_step())
        for function in self._functions:
            goes_on &= _goes_on(function(self._locals, globals()))
        return goes_on

    def end_rollout(self) -> None:
        """Call ``on_rollout_end``."""
        for callback in self._objects:
            if self._locals:
                callback.update_locals(self._locals)
            callback.on_rollout_end()

    def end(self) -> None:
        """Call ``on_training_end``."""
        for callback in self._objects:
            callback.on_training_end()


def _goes_on(answer: Any) -> bool:
    """Return False for any false value except None, such as NumPy's."""
    return answer is None or bool(answer)
