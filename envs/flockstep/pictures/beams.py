"""Start and end points of LiDAR beams, for drawing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch
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
