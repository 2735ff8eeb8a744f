"""Lines that pictures show of a batch: LiDAR beams, move lines (`Batch.set_move_line_visible`) and trails."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch
from flockstep.pictures.depth_canvas import Color, DepthCanvas
from flockstep.pictures.drawing import Canvas
from flockstep.pictures.style import Style
from flockstep.rotations import rotate

Points = npt.NDArray[np.float64]


def beams_of(batch: Batch, drone: int) -> tuple[Points, Points, npt.NDArray[np.bool_]]:
    """Return the start (3,) m and ends (K, 3) m of one drone's beams in the world frame, and a hit mask (K,).

    A beam without a hit ends at the LiDAR's range. Without a LiDAR, or before its first scan, there are no beams.
    """
    position = np.asarray(batch.position[drone], float)
    if batch.lidar_name is None:
        return position, np.zeros((0, 3)), np.zeros(0, bool)
    lidar = batch.lidar()
    config = lidar.config_of(drone)
    try:
        ranges = np.asarray(lidar.ranges[drone], float).ravel()
    except RuntimeError:  # no scan yet
        return position, np.zeros((0, 3)), np.zeros(0, bool)
    hit = np.isfinite(ranges)
    quat_wxyz = np.asarray(batch.quat_wxyz[drone], float)
    directions = rotate(quat_wxyz, np.asarray(lidar.directions[drone], float).reshape(-1, 3))
    origin = position + rotate(quat_wxyz, np.asarray(config.offset_m, float))
    return origin, origin + directions * np.where(hit, ranges, config.max_range_m)[:, None], hit


def with_beams(batch: Batch, drone: int, always: bool, others: Iterable[int] = ()) -> list[int]:
    """Return the drones whose beams the picture of a drone shows: this one, if always, and all that are visible."""
    shown = batch.beams_visible & batch.active
    drones = sorted({*drones_of_env(batch, drone), *others} - {drone})
    return [other for other in drones if shown[other]] + ([drone] if always or shown[drone] else [])


def draw_beams(
    canvas: DepthCanvas,
    style: Style,
    origin: Points,
    ends: Points,
    hit: npt.NDArray[np.bool_],
    width_px: int,
    opacity: float = 1.0,
) -> None:
    """Draw beams; one without a hit fades out if the style says so."""
    missing, reaching = ends[~hit], ends[hit]
    parts = len(style.beam_opacity)
    for part, share in enumerate(style.beam_opacity):
        starts, stops = (origin + (missing - origin) * (at / parts) for at in (part, part + 1))
        if part == 0:
            starts = np.concatenate([starts, np.broadcast_to(origin, reaching.shape)])
            stops = np.concatenate([stops, reaching])
        canvas.lines(starts, stops, style.beam, width_px=width_px, opacity=opacity * share)


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


class Trail:
    """The positions of each drone since its episode began: call `record` after every step or reset.

    Parameters
    ----------
    batch
        The batch with the drones to follow.
    max_steps
        Older positions are discarded.
    """

    def __init__(self, batch: Batch, max_steps: int = 2000) -> None:
        self._batch = batch
        self._max_steps = max_steps
        self._positions: list[npt.NDArray[np.float32]] = []
        self._forgotten = 0  # number of discarded positions
        self._first = np.zeros(batch.num_drones, np.int64)  # index of the first position of each drone's episode
        self._episode = self._episodes()

    def _episodes(self) -> npt.NDArray[np.int64]:
        """Return each drone's episode number."""
        episodes = np.repeat(self._batch.episode, self._batch.drones_per_env)
        own = self._batch.own_episodes
        return episodes + own if len(own) else episodes

    def record(self, began: npt.NDArray[np.bool_] | bool = False) -> None:
        """Record the current positions of the drones.

        Parameters
        ----------
        began
            (N,): True for drones whose trail restarts, in addition to those with a new episode number.
        """
        now = self._forgotten + len(self._positions)
        episode = self._episodes()
        self._first[(episode != self._episode) | began] = now
        self._episode = episode
        self._positions.append(self._batch.position.copy())
        forget = max(int(self._first.min()), now + 1 - self._max_steps) - self._forgotten
        if forget > 0:
            del self._positions[:forget]
            self._forgotten += forget

    def of(self, drone: int) -> npt.NDArray[np.float32]:
        """Return the positions (K, 3) of one drone, oldest first."""
        first = max(int(self._first[drone]) - self._forgotten, 0)
        return np.array([positions[drone] for positions in self._positions[first:]], np.float32).reshape(-1, 3)
