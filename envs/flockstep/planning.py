"""Paths through a world, and how far a long search is."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep import _core
from flockstep.scenes import WorldLike
from flockstep.task import DroneLike

_PATIENCE_S = 2.0  # a shorter search shows nothing
_LINES_S = 10.0  # between two lines in a file
_BAR = 30  # characters


def plan(
    world: WorldLike,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    drone: DroneLike | None = None,
    cell_m: float = 0.1,
    progress: bool = True,
) -> npt.NDArray[np.float32] | None:
    """Return a short path (P, 3) m from ``start`` (3,) over ``goals`` (K, 3) in their order; None if there is none.

    The drone flies straight from corner to corner, level and facing +x, and touches nothing: `Batch.move` can fly every
    leg. Most paths are within 1 % of the shortest one.

    Parameters
    ----------
    world
        A `World`, or the name or path of one. Its solid objects are in the way.
    start, goals
        World frame, m.
    drone
        A `DroneModel`, or the name or path of one. Its hull flies. Default: the 650-class quadrotor.
    cell_m
        Spacing in m of the finest grid that is searched. A gap is found if it leaves the drone about one spacing of
        room on each side. Coarser grids are searched first; the finest one only if they have no path, or if that search
        is small.
    progress
        Show a progress bar on standard error if the search takes more than 2 s; into a file, a line every 10 s.

    Raises
    ------
    ValueError
        An argument is not finite or has another shape, or ``cell_m`` is so small that the search would take more than
        33,554,432 cells.
    """
    shown = _Progress() if progress else None
    try:
        return _core.plan(world, start, goals, drone, cell_m, shown)
    finally:
        if shown is not None:
            shown.end()


class _Progress:
    """Shows how much of a search is done: nothing at first, then a bar on a terminal or lines in a file."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._next = self._began + _PATIENCE_S
        self._is_bar_shown = False

    def __call__(self, share: float) -> None:
        now = time.monotonic()
        out: Any = sys.stderr
        if now < self._next or out is None:
            return
        text = f"{share:4.0%}, {now - self._began:.0f} s"
        if out.isatty():
            done = round(share * _BAR)
            out.write(f"\rplan [{'#' * done}{'.' * (_BAR - done)}] {text}")
            self._is_bar_shown = True
        else:
            out.write(f"plan: {text.strip()}\n")
            self._next = now + _LINES_S
        out.flush()

    def end(self) -> None:
        """Take the bar away."""
        if self._is_bar_shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
