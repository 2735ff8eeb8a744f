"""One line about something that takes long, on a terminal or in a file."""

from __future__ import annotations

import sys
import time
from typing import TextIO

_TERMINAL_S = 0.2
_INTERVAL_S = 10.0


class ProgressLine:
    """Keeps one line up to date on a terminal; in a file, a pipe or a notebook it prints a line at every interval.

    Parameters
    ----------
    interval_s
        Seconds between two lines in a file, 10 by default. A terminal is updated every 0.2 s.
    stream
        Output stream. Default: standard error, so that results on standard output stay separate.
    """

    def __init__(self, interval_s: float | None = None, stream: TextIO | None = None) -> None:
        self._out = sys.stderr if stream is None else stream
        self._rewrites = self._out.isatty()
        self._period_s = _TERMINAL_S if self._rewrites else _INTERVAL_S if interval_s is None else interval_s
        self.began = self._printed = time.monotonic()

    @property
    def is_due(self) -> bool:
        """True if it is time for the next line."""
        return time.monotonic() - self._printed >= self._period_s

    @property
    def seconds(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.began

    def show(self, text: str, *, is_last: bool = False) -> None:
        """Print the line."""
        self._printed = time.monotonic()
        if self._rewrites:
            self._out.write(f"\r{text}\x1b[K" + "\n" * is_last)
        else:
            self._out.write(f"{text}\n")
        self._out.flush()

    def clear(self) -> None:
        """Remove the line from a terminal, so that results take its place."""
        if self._rewrites:
            self._out.write("\r\x1b[K")
            self._out.flush()
