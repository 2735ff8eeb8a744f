"""Print the progress of a training to a terminal or a file."""

from __future__ import annotations

from typing import TextIO

from stable_baselines3.common.callbacks import BaseCallback

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
