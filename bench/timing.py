"""Code that the benchmarks share: figures, and calls that take turns, so that a busy moment slows all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

K = TypeVar("K")
Call = Callable[[], object]
Timer = Callable[[], float]
Figure = dict[str, Any]
Measured = tuple[str, float, str, int]  # name, value, unit, runs

RUNS = 7


def figure(name: str, value: float, unit: str, runs: int, **more: Any) -> Figure:
    """Return a figure as bench/table.py reads it."""
    return {"name": name, "value": float(f"{value:.4g}"), "unit": unit, "runs": runs, **more}


def of(measure: Callable[..., Iterable[Measured]], *args: Any) -> Callable[[], list[Figure]]:
    """Return a benchmark whose figures are those that a function measures."""
    return lambda: [figure(*measured) for measured in measure(*args)]


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


def median_ratio(these: Iterable[float], those: Iterable[float]) -> float:
    """Return the median of the ratios of each run."""
    return statistics.median(a / b for a, b in zip(these, those, strict=True))
