"""Path planning through a world, with a progress display."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep import _core
from flockstep.scenes import WorldLike
from flockstep.task import DroneLike

_PATIENCE_S = 2.0  # shorter searches show nothing
_LINES_S = 10.0  # interval between lines in a file
_BAR = 30  # characters


def plan(
    world: WorldLike,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    drone: DroneLike | None = None,
    cell_m: float = 0.1,
    progress: bool = True,
) -> npt.NDArray[np.float32] | None:
    """Return a short path (P, 3) m from ``start`` (3,) through ``goals`` (K, 3) in order, or None if there is none.

    Every leg is straight and free of contact for a level drone that faces +x, so `Batch.move` can fly it. Most paths
    are within 1 % of the shortest one.

    Parameters
    ----------
    world
        A `World`, or the name or path of one. Its solid objects are the obstacles.
    start, goals
        World frame, m.
    drone
        A `DroneModel`, or the name or path of one. Its hull must fit through. Default: the 650-class quadrotor.
    cell_m
        Spacing in m of the finest grid that is searched. A gap is found if it leaves about one spacing of room on each
        side of the drone. Coarser grids are searched first; the finest one is searched only if they have no path or if
        its search is small.
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
    """Shows the progress of a search: nothing at first, then a bar on a terminal or lines in a file."""

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
        """Remove the bar."""
        if self._is_bar_shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
