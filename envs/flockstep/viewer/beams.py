"""Where LiDAR beams begin and end, to be drawn."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch
from flockstep.task import rotate

Points = npt.NDArray[np.float64]


def beams_of(batch: Batch, drone: int) -> tuple[Points, Points, npt.NDArray[np.bool_]]:
    """Return where the beams of one drone begin (3,) m and end (K, 3) m, world frame, and which hit something (K,).

    One that hits nothing ends at the LiDAR's range. Without a LiDAR there are none.
    """
    position = np.asarray(batch.position[drone], float)
    ranges = np.asarray(batch.lidar_ranges[drone], float).ravel()
    hit = np.isfinite(ranges)
    if not len(ranges):
        return position, np.zeros((0, 3)), hit
    quat_wxyz = np.asarray(batch.quat_wxyz[drone], float)
    lidar = batch.lidar_config_of(drone)
    directions = rotate(quat_wxyz, np.asarray(batch.lidar_directions[drone], float).reshape(-1, 3))
    origin = position + rotate(quat_wxyz, np.asarray(lidar.offset_m, float))
    return origin, origin + directions * np.where(hit, ranges, lidar.max_range_m)[:, None], hit
