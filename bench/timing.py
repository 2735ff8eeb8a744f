"""Code that the benchmarks share: figures, and calls that take turns, so that a busy moment slows all of them."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

K = TypeVar("K")
Call = Callable[[], object]
Timer = Callable[[], float]
Figure = dict[str, Any]
Measured = tuple[str, float, str, int]  # name, value, unit, runs

RUNS = 7


class Median(float):
    """The median of some runs, with the least and the greatest; a product or quotient with a number has them, too."""

    least: float
    greatest: float

    def __new__(cls, values: Iterable[float]) -> Median:
        values = list(values)
        made = super().__new__(cls, statistics.median(values))
        made.least, made.greatest = min(values), max(values)
        return made

    def _each(self, change: Callable[[float], float]) -> Median:
        made = super().__new__(Median, change(float(self)))
        made.least, made.greatest = sorted((change(self.least), change(self.greatest)))
        return made

    def __mul__(self, factor: float) -> Median:
        return self._each(lambda value: value * factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Median:
        return self._each(lambda value: value / divisor)

    def __rtruediv__(self, count: float) -> Median:
        return self._each(lambda value: count / value)


def figure(name: str, value: float, unit: str, runs: int, **more: Any) -> Figure:
    """Return a figure as bench/table.py reads it; that of a `Median` has the least and the greatest value, too."""
    ends = {"least": value.least, "greatest": value.greatest} if isinstance(value, Median) else {}
    number, *spread = (float(f"{each:.4g}") for each in (value, *ends.values()))
    return {"name": name, "value": number, "unit": unit, "runs": runs, **dict(zip(ends, spread, strict=True)), **more}


def program(name: str) -> Path:
    """Return the path of a C++ benchmark."""
    return Path(os.environ["FLOCKSTEP_BENCH_DIR"]) / name


def native(name: str, *arguments: object) -> list[Figure]:
    """Run a C++ benchmark and return the figures it prints."""
    command = [program(name), *map(str, arguments)]
    figures: list[Figure] = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return figures


def timed(
    call: Call,
    count: int = 1,
    at_least_s: float = 0.0,
    clock: Callable[[], float] = time.process_time,
    before: Call | None = None,
) -> Timer:
    """Return a function that measures the mean seconds of `count` calls, or of as many as last long enough.

    What `before` does is not counted.
    """

    def measure() -> float:
        if before is not None:
            before()
        calls, elapsed, begun = 0, 0.0, clock()
        while calls == 0 or elapsed < at_least_s:
            for _ in range(count):
                call()
            calls += count
            elapsed = clock() - begun
        return elapsed / calls

    return measure


def in_turns(timers: Mapping[K, Timer], runs: int = RUNS, warm_up: bool = False) -> dict[K, list[float]]:
    """Return the seconds of each, a value for each run; a first run that warms up is not counted."""
    times: dict[K, list[float]] = {name: [] for name in timers}
    for run in range(-warm_up, runs):
        for name, timer in timers.items():
            seconds = timer()
            if run >= 0:
                times[name].append(seconds)
    return times


def median_ratio(these: Iterable[float], those: Iterable[float]) -> Median:
    """Return the median of the ratios of each run."""
    return Median(a / b for a, b in zip(these, those, strict=True))
