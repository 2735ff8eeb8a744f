"""Results of operations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import ImuConfig
from flockstep.client.frames import Arrays
from flockstep.errors import did_you_mean

_F32: TypeAlias = npt.NDArray[np.float32]
CaptureMode: TypeAlias = Literal["every_step", "on_movement", "on_demand"]


class Angles(NamedTuple):
    """A rotation as angles in degrees: intrinsic rotations about z (yaw), y (pitch) and x (roll).

    A positive pitch is nose down.
    """

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class Rotation:
    """A rotation from body to world.

    Attributes
    ----------
    quat_wxyz
        Quaternion (w, x, y, z), (4,) float32.
    angles
        The same rotation as `Angles`.
    """

    quat_wxyz: _F32
    angles: Angles


@dataclass(eq=False, slots=True)
class Impact:
    """The end of a motion.

    Attributes
    ----------
    hit
        True if the drone touched something and stopped there.
    fraction
        Fraction of the motion that was flown, 0 to 1.
    location, quat_wxyz
        Pose of the drone afterwards: (3,) m, world frame, and (4,).
    point
        Contact point on the obstacle, (3,) m, world frame, or None without a hit.
    normal
        Unit normal (3,) from the obstacle towards the drone, world frame, or None without a hit.
    """

    hit: bool
    fraction: float
    location: _F32
    quat_wxyz: _F32
    point: _F32 | None
    normal: _F32 | None


@dataclass(frozen=True, eq=False)
class Impacts:
    """The ends of the motions of all N drones. See `Impact`.

    Attributes
    ----------
    time
        `Time` afterwards.
    position, quat_wxyz
        Poses afterwards: (N, 3) m, world frame, and (N, 4).
    hit
        True for drones that touch something, (N,) bool.
    point, normal
        Contact points (N, 3) m and unit normals (N, 3), world frame; valid for drones that touch something.
    """

    time: Time
    position: _F32
    quat_wxyz: _F32
    hit: npt.NDArray[np.bool_]
    point: _F32
    normal: _F32


@dataclass(frozen=True, eq=False)
class CameraData:
    """An image of a drone's camera.

    Attributes
    ----------
    image
        For ``"raw"`` an array of the pixels, (height, width, channels); row 0 is the top. Otherwise the file, as bytes.
    width_px, height_px
        Size in pixels.
    step
        Number of the reading in the episode.
    """

    image: Any
    width_px: int
    height_px: int
    step: int

    def __bytes__(self) -> bytes:
        return bytes(self.image)


@dataclass(frozen=True, eq=False)
class LidarData:
    """A scan of a drone's LiDAR.

    Attributes
    ----------
    ranges
        Distances (channels, beams) in m; inf for a miss.
    directions
        Unit vectors (channels, beams, 3) in the body frame, or None if they were not requested.
    origin
        Origin of the beams, (3,) m, world frame.
    quat_wxyz
        Rotation of the body, (4,).
    """

    ranges: _F32
    directions: _F32 | None
    origin: _F32
    quat_wxyz: _F32


class Time(NamedTuple):
    """The time of a server.

    Attributes
    ----------
    step
        Number of steps of clients and of the server's clock since the server started.
    time_s
        Simulated time of these steps in s.
    num_envs
        Number of envs, E.
    generation
        Number of times that the arrays of the batch changed their shapes, because drones were spawned.
    """

    step: int
    time_s: float
    num_envs: int
    generation: int


class Fps(NamedTuple):
    """The speed of a server over the last seconds.

    Attributes
    ----------
    fps
        Steps per second of wall time.
    real_time_factor
        Simulated time divided by wall time.
    """

    fps: float
    real_time_factor: float


@dataclass(frozen=True, eq=False)
class TimedArrays(Mapping[str, npt.NDArray[Any]]):
    """Arrays of one moment by name: ``arrays["position"]``.

    Attributes
    ----------
    time
        Their `Time`.
    """

    time: Time
    _arrays: Arrays

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


@dataclass(frozen=True, eq=False)
class WorldInfo:
    """A world of the server.

    Attributes
    ----------
    name
        Name of the world.
    content_hash
        Hash of its content; worlds that differ only in their names have the same.
    min, max
        Corners of the box around all geometry, (3,) m.
    start, goal
        Markers, (3,) m, or None.
    """

    name: str
    content_hash: int
    min: _F32
    max: _F32
    start: _F32 | None
    goal: _F32 | None


@dataclass(frozen=True, eq=False)
class Mesh:
    """The geometry of a world as triangles.

    Attributes
    ----------
    vertices
        (V, 3) m, world frame.
    triangles
        Indices of vertices, (T, 3) int32.
    objects
        Object of each triangle, (T,) int32.
    """

    vertices: _F32
    triangles: npt.NDArray[np.int32]
    objects: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points on the surfaces of a world.

    Attributes
    ----------
    points, normals
        (P, 3) m and unit vectors (P, 3), world frame.
    semantic
        Semantic class of each point, (P,) uint16.
    objects
        Object of each point, (P,) int32.
    """

    points: _F32
    normals: _F32
    semantic: npt.NDArray[np.uint16]
    objects: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Boxes:
    """The smallest box around each object of a world.

    Attributes
    ----------
    min, max
        Corners (B, 3) m, world frame.
    materials
        Material of each object, (B,) int32.
    """

    min: _F32
    max: _F32
    materials: npt.NDArray[np.int32]


@dataclass(frozen=True)
class ServerInfo:
    """The server and its batch, as they were when the client connected.

    Attributes
    ----------
    version
        Version of flockstep.
    client
        Number of this client, the ``owner`` of drones that it claims.
    num_envs, drones_per_env
        Number of envs, E, and of drones in each, M.
    generation
        Number of times that the arrays of the batch changed their shapes.
    lidars, cameras, imus
        Names of the sensors of a kind.
    imu_configs
        `ImuConfig` of each IMU by its name.
    flies_by_rotors
        True if drones are simulated with rotors: `fly` and `set_command` move them.
    has_task
        True if the batch has a task: `vector_env` works.
    step_s
        Simulated time of a step in s.
    array_names
        Names for `get_arrays`, without those of sensors.
    array_rows
        Kind of the rows of each of these arrays by its name: ``"drone"``, ``"env"``, ``"task"`` (those of the task's
        outputs) or ``"body"`` (a row for each env, with B bodies).
    bodies_per_env
        Number of slots for bodies in each env, B.
    sensors
        Names of all sensors.
    control
        Meaning of commands that do not name another.
    num_rotors
        Columns of rotor speeds, and of commands of ``"rotor_speeds"`` and ``"rotor_thrusts"``.
    """

    version: str
    client: int
    num_envs: int
    drones_per_env: int
    generation: int
    lidars: tuple[str, ...]
    cameras: tuple[str, ...]
    imus: tuple[str, ...]
    flies_by_rotors: bool
    has_task: bool
    step_s: float
    array_names: tuple[str, ...]
    imu_configs: Mapping[str, ImuConfig]
    array_rows: Mapping[str, str]
    bodies_per_env: int
    sensors: tuple[str, ...]
    control: str
    num_rotors: int

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            hint = did_you_mean(name, type(self).__dataclass_fields__)
            raise AttributeError(f"ServerInfo has no attribute {name!r}{hint}")

    @property
    def num_drones(self) -> int:
        """Number of drones, N = E M: rows of the arrays of drones."""
        return self.num_envs * self.drones_per_env
