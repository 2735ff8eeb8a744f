"""Drones whose sensors a recorder reads: those of a batch, or of a server."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, TypeVar, runtime_checkable

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
        half = np.radians(float(lidar.turn_deg[index])) / 2 if config.turn_deg else 0.0
        turn = np.array([np.cos(half), 0, 0, np.sin(half)])
        if self._directions.get((sensor, index), (None,))[0] != config:
            quat = np.asarray(config.quat_wxyz, np.float64)
            directions = rotate(quat, lidar.directions[index].astype(np.float64), inverse=True)
            self._directions[sensor, index] = config, rotate(turn, directions, inverse=True)
        ranges = lidar.ranges[index]
        is_hit = np.isfinite(ranges)
        points = rotate(turn, ranges[is_hit][:, None] * self._directions[sensor, index][1][is_hit])
        return points.astype(np.float32)

    def inertial(self, sensor: str, drone: int) -> tuple[Array, Array]:
        """Return the latest specific force and angular velocity in the sensor's frame."""
        readings, index = self.batch.sensor(sensor), self._indices[drone]
        return readings["accelerometer"][index], readings["gyroscope"][index]

    def jpeg(self, sensor: str, drone: int) -> bytes | None:
        """Return a camera's latest image as a JPEG file, or None if it is stale."""
        index, camera = self._indices[drone], self.batch.camera(sensor)
        return None if camera.frame_step[index] < 0 else camera.jpeg(index, self._quality)


if TYPE_CHECKING:
    from flockstep.client import Client, TimedArrays

T = TypeVar("T")

_HAS_COLOURS = {"rgb", "grey"}


class ClientSource:
    """Drones of a server as a `Source`. Drones that are spawned later join, and removed ones leave.

    `time_s` reads the poses and velocities of all drones, of one moment, in one request. A scan or an image is a
    separate request, and the LiDAR scans then. If the drone has moved in between, the points of the scan are still
    where the beams hit. The readings of an IMU are one request for all drones. Mountings are read when a drone appears.
    Images of cameras without the outputs rgb and grey are left out.

    >>> with flockstep.connect() as client, McapRecorder("flight.mcap", ClientSource(client)) as recorder:
    ...     while True:
    ...         recorder.write()
    ...         time.sleep(0.05)

    Parameters
    ----------
    client
        A `Client`, which the source does not close.
    drones
        Indices of the drones. None: all active drones. Drones of several envs are all placed in the frame ``map``.
    clock
        ``"real"``: seconds since the first `time_s`, also while simulated time stands still. ``"simulated"``: the
        simulated time of the server's steps, which steps of its program and single motions do not advance.
    jpeg_quality
        From 1 to 100.
    """

    def __init__(
        self,
        client: Client,
        drones: Iterable[int] | None = None,
        *,
        clock: Literal["real", "simulated"] = "real",
        jpeg_quality: int = 90,
    ) -> None:
        self._chosen = None if drones is None else {int(drone) for drone in drones}
        if self._chosen is not None and (not self._chosen or min(self._chosen) < 0):
            raise ValueError(f"drones: expected at least one index, each >= 0, got {sorted(self._chosen)}")
        if clock not in ("real", "simulated"):
            raise ValueError(f"clock: expected 'real' or 'simulated', got {clock!r}")
        if not 1 <= jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality: expected an integer in [1, 100], got {jpeg_quality}")
        self.client = client
        self._is_real = clock == "real"
        self._quality = jpeg_quality
        named: list[tuple[str, Kind]] = [(lidar, "lidar") for lidar in client.info.lidars]
        named += [(camera, "camera") for camera in client.info.cameras]
        named += [(imu, "imu") for imu in client.info.imu_configs]
        self.sensors = dict(named)
        if len(self.sensors) != len(named):
            raise ValueError(f"sensors: expected different names, got {[name for name, _ in named]}")
        self._settings: dict[int, dict[str, Any]] = {}  # of each sensor, by the index of the drone
        self._inertial: dict[str, TimedArrays] = {}  # of each IMU, since the last time_s
        self._start_s: float | None = None
        self._read()

    def time_s(self) -> float:
        """Read the drones, and return their time."""
        self._read()
        if not self._is_real:
            return self._moment.time.time_s
        if self._start_s is None:
            self._start_s = self._read_s
        return self._read_s - self._start_s

    def _read(self) -> None:
        names = ["active", "position", "quat_wxyz"]
        if self.client.info.flies_by_rotors:
            names += ["velocity", "angular_velocity"]
        moment = self.client.get_arrays(names)
        self._read_s = time.monotonic()
        active = np.flatnonzero(moment["active"]).tolist()
        chosen = [drone for drone in active if self._chosen is None or drone in self._chosen]
        settings = {drone: self._settings.get(drone) or self._read_settings(drone) for drone in chosen}
        self._settings = {drone: found for drone, found in settings.items() if found is not None}
        self._indices = list(self._settings)
        self.drones = [f"drone{index}" for index in self._indices]
        self._moment: TimedArrays = moment
        self._inertial.clear()

    def poses(self) -> tuple[Array, Array]:
        """Return position and quat_wxyz."""
        return self._moment["position"][self._indices], self._moment["quat_wxyz"][self._indices]

    def velocities(self) -> tuple[Array, Array] | None:
        """Return velocity and angular velocity; None if the motion is kinematic."""
        if "velocity" not in self._moment:
            return None
        return self._moment["velocity"][self._indices], self._moment["angular_velocity"][self._indices]

    def mounting(self, sensor: str, drone: int) -> tuple[npt.ArrayLike, npt.ArrayLike]:
        """Return position and rotation of a sensor in the body frame."""
        if sensor in self.client.info.imu_configs:
            imu = self.client.info.imu_configs[sensor]
            return imu.offset_m, imu.quat_wxyz
        settings = self._settings[self._indices[drone]][sensor]
        return settings.offset_m, settings.quat_wxyz

    def points(self, sensor: str, drone: int) -> Array:
        """Scan, and return the hits in the sensor's frame; none if the drone has been removed."""
        index = self._indices[drone]
        scan = _unless_removed(lambda: self.client.drone(index).get_lidar_data(sensor))
        if scan is None or scan.directions is None:
            return np.empty((0, 3), np.float32)
        is_hit = np.isfinite(scan.ranges)
        beams = scan.ranges[is_hit][:, None] * scan.directions[is_hit].astype(np.float64)
        placed = scan.origin + rotate(scan.quat_wxyz, beams)
        position, quat = (array[drone].astype(np.float64) for array in self.poses())
        in_body = rotate(quat, placed - position, inverse=True)
        offset_m, mounting = (np.asarray(part, np.float64) for part in self.mounting(sensor, drone))
        return rotate(mounting, in_body - offset_m, inverse=True).astype(np.float32)

    def inertial(self, sensor: str, drone: int) -> tuple[Array, Array]:
        """Return the latest specific force and angular velocity in the sensor's frame."""
        if sensor not in self._inertial:
            self._inertial[sensor] = self.client.get_arrays(["accelerometer", "gyroscope"], sensor=sensor)
        readings, index = self._inertial[sensor], self._indices[drone]
        return readings["accelerometer"][index], readings["gyroscope"][index]

    def jpeg(self, sensor: str, drone: int) -> bytes | None:
        """Return a camera's image as a JPEG file; None without colours, or if the drone has been removed."""
        index = self._indices[drone]
        if not _HAS_COLOURS & set(self._settings[index][sensor].outputs):
            return None
        remote = self.client.drone(index)
        image = _unless_removed(lambda: remote.get_camera_data(sensor, quality=self._quality))
        return None if image is None else bytes(image)

    def _read_settings(self, index: int) -> dict[str, Any] | None:
        """Return the settings of a drone's sensors by name; None if it has been removed."""
        drone = self.client.drone(index)
        read = {"lidar": drone.get_lidar_config, "camera": drone.get_camera_config}
        return _unless_removed(
            lambda: {sensor: read[kind](sensor) for sensor, kind in self.sensors.items() if kind in read}
        )


def _unless_removed(request: Callable[[], T]) -> T | None:
    """Return the result of a request for a drone, or None if the drone has been removed."""
    from flockstep.client import ServerError  # needs the extra packages of the client

    try:
        return request()
    except ServerError as error:
        if error.code != "NOT_FOUND":
            raise
        return None
