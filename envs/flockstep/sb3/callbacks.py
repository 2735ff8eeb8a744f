"""Callbacks of a training: its progress on a terminal or in a file, and the reward terms of its episodes in its log."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any, TextIO

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from flockstep.errors import did_you_mean
from flockstep.learning import progress_of
from flockstep.progress_line import ProgressLine


class Progress(BaseCallback):
    """Prints the steps, the time and the success rate of a training.

    On a terminal it keeps one line up to date. In a file, a pipe or a notebook it prints a line at every interval and
    one at the end. The progress bar of Stable-Baselines3 (``progress_bar=True``) shows nothing there until the end.

    Parameters
    ----------
    interval_s
        Seconds between two lines in a file. A terminal is updated every 0.2 s.
    stream
        Output stream. Default: standard error, so that results on standard output stay separate.

    Raises
    ------
    ValueError
        ``interval_s`` is negative or NaN.

    Examples
    --------
    >>> model.learn(300_000, callback=flockstep.sb3.Progress())
    """

    def __init__(self, interval_s: float = 10.0, stream: TextIO | None = None) -> None:
        super().__init__()
        if not interval_s >= 0:
            raise ValueError(f"interval_s: expected seconds >= 0, got {interval_s!r}")
        self._interval_s = interval_s
        self._stream = stream

    def _on_training_start(self) -> None:
        self._progress = ProgressLine(self._interval_s, self._stream)
        self._first = self.model.num_timesteps

    def _on_step(self) -> bool:
        if self._progress.is_due:
            self._progress.show(self._line())
        return True

    def _on_training_end(self) -> None:
        self._progress.show(self._line(), is_last=True)

    def _line(self) -> str:
        return progress_of(self.model, self._progress.seconds, self._first)


class LogTerms(BaseCallback):
    """Logs means over the episodes that ended in a rollout, to TensorBoard and the other log outputs.

    ``terms/NAME`` is the unscaled sum of a reward term over an episode. ``infos/NAME`` is a value that a `Task` reports
    by its ``info_names``. Stable-Baselines3 itself logs the success rate as ``rollout/success_rate``.

    Parameters
    ----------
    info_names
        Names of the infos to log in addition to the terms, as a sequence such as ``("laps",)``.

    Examples
    --------
    >>> model.learn(300_000, callback=flockstep.sb3.LogTerms())
    """

    def __init__(self, info_names: Iterable[str] = ()) -> None:
        super().__init__()
        if isinstance(info_names, str):
            raise TypeError(f"info_names: expected a sequence of names, such as ({info_names!r},), got {info_names!r}")
        self._info_names = tuple(info_names)
        self._values: dict[str, list[float]] = defaultdict(list)

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode_terms" in info:
                self._note("terms", info["episode_terms"])
                missing = [name for name in self._info_names if name not in info]
                if missing:
                    known = [name for name, value in info.items() if isinstance(value, Real)]
                    hint = did_you_mean(missing[0], known)
                    raise ValueError(f"info_names: expected some of {', '.join(known)}, got {missing[0]!r}{hint}")
                self._note("infos", {name: info[name] for name in self._info_names})
        return True

    def _note(self, group: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            self._values[f"{group}/{name}"].append(float(value))

    def _on_rollout_end(self) -> None:
        for key, values in self._values.items():
            self.logger.record(key, float(np.mean(values)))
        self._values.clear()
