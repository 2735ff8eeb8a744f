"""Drones whose sensors a recorder reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, LidarConfig
from flockstep.rotations import rotate

Array: TypeAlias = npt.NDArray[Any]
Kind: TypeAlias = Literal["lidar", "camera", "imu"]


@runtime_checkable
class Source(Protocol):
    """The drones that a recorder reads. A drone is given by its index in ``drones``; frames and units are a batch's.

    A recorder calls `time_s` first, and then reads the rest of the same moment. Drones come and go only in that call.
    """

    @property
    def drones(self) -> Sequence[str]:
        """Name of each drone."""

    @property
    def sensors(self) -> Mapping[str, Kind]:
        """Kind of each sensor by its name; every drone has all of them."""

    def time_s(self) -> float:
        """Return the simulated time. It never goes back, not even in a new episode."""

    def poses(self) -> tuple[Array, Array]:
        """Return position (N, 3) and quat_wxyz (N, 4)."""

    def velocities(self) -> tuple[Array, Array] | None:
        """Return velocity (N, 3) and angular velocity (N, 3), or None if the drones have none."""

    def mounting(self, sensor: str, drone: int) -> tuple[npt.ArrayLike, npt.ArrayLike]:
        """Return position (3,) m and rotation quat_wxyz (4,) of a sensor in the body frame."""

    def points(self, sensor: str, drone: int) -> Array:
        """Return the hits of a LiDAR's latest scan, (K, 3) m in the sensor's frame, without misses."""

    def inertial(self, sensor: str, drone: int) -> tuple[Array, Array]:
        """Return the latest specific force (3,) m/s^2 and angular velocity (3,) rad/s in the sensor's frame."""

    def jpeg(self, sensor: str, drone: int) -> bytes | None:
        """Return a camera's latest image as a JPEG file, or None if it has none."""


class BatchSource:
    """Drones of a batch as a `Source`. Cameras without the outputs rgb and grey are left out.

    A new episode begins one step after the latest time: time goes on, and the drones jump.

    Parameters
    ----------
    batch
        The batch.
    drones
        Indices of the drones. None: those of the first env. Drones of several envs are all placed in the frame ``map``.
    jpeg_quality
        From 1 to 100.
    """

    def __init__(self, batch: Batch, drones: Sequence[int] | None = None, *, jpeg_quality: int = 90) -> None:
        indices = range(batch.drones_per_env) if drones is None else drones
        self._indices = [int(index) for index in indices]
        if not self._indices or len(set(self._indices)) != len(self._indices):
            raise ValueError(f"drones: expected at least one index, and each only once, got {list(indices)}")
        if not all(0 <= index < batch.num_drones for index in self._indices):
            raise ValueError(f"drones: expected indices in [0, {batch.num_drones}), got {list(indices)}")
        if not 1 <= jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality: expected an integer in [1, 100], got {jpeg_quality}")
        self.batch = batch
        self.drones = [f"drone{index}" for index in self._indices]
        cameras = [camera.name for camera in batch.cameras if {"rgb", "grey"} & set(camera.outputs)]
        named: list[tuple[str, Kind]] = [(lidar.name, "lidar") for lidar in batch.lidars]
        named += [(camera, "camera") for camera in cameras]
        named += [(imu.name, "imu") for imu in batch.imus]
        self.sensors = dict(named)
        if len(self.sensors) != len(named):
            raise ValueError(f"sensors: expected different names, got {[name for name, _ in named]}")
        self._imus = {imu.name: imu for imu in batch.imus}
        self._quality = jpeg_quality
        self._directions: dict[tuple[str, int], tuple[LidarConfig, Array]] = {}
        clock = batch.clock
        self._physics_hz = clock.physics_hz or clock.policy_hz
        self._ticks_per_step = round(self._physics_hz / clock.policy_hz)
        self._envs = sorted({index // batch.drones_per_env for index in self._indices})
        self._ticks = 0
        self._seen = self._clocks()

    def _clocks(self) -> tuple[Array, Array]:
        return self.batch.episode[self._envs].copy(), self.batch.tick[self._envs].copy()

    def time_s(self) -> float:
        """Return the simulated time since the source was made."""
        episode, tick = now = self._clocks()
        episode_before, tick_before = self._seen
        goes_on = (episode == episode_before) & (tick >= tick_before)
        self._ticks += int(np.where(goes_on, tick - tick_before, self._ticks_per_step + tick).max())
        self._seen = now
        return self._ticks / self._physics_hz

    def poses(self) -> tuple[Array, Array]:
        """Return position and quat_wxyz."""
        return self.batch.position[self._indices], self.batch.quat_wxyz[self._indices]

    def velocities(self) -> tuple[Array, Array] | None:
        """Return velocity and angular velocity; None if the motion is kinematic."""
        if self.batch.dynamics.motion == "kinematic":
            return None
        return self.batch.velocity[self._indices], self.batch.angular_velocity[self._indices]

    def mounting(self, sensor: str, drone: int) -> tuple[npt.ArrayLike, npt.ArrayLike]:
        """Return position and rotation of a sensor in the body frame."""
        config: Any = self._imus.get(sensor)
        if config is None:
            is_lidar = self.sensors[sensor] == "lidar"
            owner = self.batch.lidar(sensor) if is_lidar else self.batch.camera(sensor)
            config = owner.config_of(self._indices[drone])
        return config.offset_m, config.quat_wxyz

    def points(self, sensor: str, drone: int) -> Array:
        """Return the hits of a LiDAR's latest scan in the sensor's frame."""
        index, lidar = self._indices[drone], self.batch.lidar(sensor)
        config = lidar.config_of(index)
        if self._directions.get((sensor, index), (None,))[0] != config:
            quat = np.asarray(config.quat_wxyz, np.float64)
            directions = rotate(quat, lidar.directions[index].astype(np.float64), inverse=True)
            self._directions[sensor, index] = config, directions
        ranges = lidar.ranges[index]
        is_hit = np.isfinite(ranges)
        points: Array = ranges[is_hit][:, None] * self._directions[sensor, index][1][is_hit]
        return points.astype(np.float32)

    def inertial(self, sensor: str, drone: int) -> tuple[Array, Array]:
        """Return the latest specific force and angular velocity in the sensor's frame."""
        readings, index = self.batch.sensor(sensor), self._indices[drone]
        return readings["accelerometer"][index], readings["gyroscope"][index]

    def jpeg(self, sensor: str, drone: int) -> bytes | None:
        """Return a camera's latest image as a JPEG file, or None if it is stale."""
        index, camera = self._indices[drone], self.batch.camera(sensor)
        return None if camera.frame_step[index] < 0 else camera.jpeg(index, self._quality)
