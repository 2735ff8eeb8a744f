"""Move lines in pictures: the recorded paths of drones, see `Batch.set_move_line_visible`."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flockstep._core import Batch
from flockstep.pictures.depth_canvas import Color
from flockstep.pictures.drawing import Canvas

_GREEN: Color = (0, 230, 60)  # as in Batch.picture


def draw_move_lines(canvas: Canvas, batch: Batch, drones: Iterable[int], width_px: int) -> None:
    """Draw the visible move lines of some drones."""
    for drone in drones:
        if not batch.move_line_visible[drone]:
            continue
        path = batch.move_line(drone).astype(float)
        flown = np.isfinite(path[:-1, 0]) & np.isfinite(path[1:, 0])  # not across the gap between two pieces
        canvas.lines(path[:-1][flown], path[1:][flown], _GREEN, width_px=width_px)


def drones_of_env(batch: Batch, drone: int) -> range:
    """Return the drones of the env of a drone."""
    count = batch.drones_per_env
    first = drone // count * count
    return range(first, first + count)
