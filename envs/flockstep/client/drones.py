"""The operations of a server on one drone, and on a sensor of all drones; each returns a call, which a client sends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import CameraConfig, LidarConfig
from flockstep.client import protocol as pb
from flockstep.client import readers
from flockstep.client.call import Call, Subscription, call, floats, nothing, quaternion
from flockstep.client.changes import CameraChanges, LidarChanges
from flockstep.client.configs import change_json, config_of
from flockstep.client.forms import Awaits, Waits, operation, stream
from flockstep.client.results import (
    Angles,
    CameraData,
    Impact,
    LidarData,
    Rotation,
)

if TYPE_CHECKING:
    from typing_extensions import Unpack

_Format: TypeAlias = Literal["jpeg", "png", "raw"]


class SensorOperations:
    """The operations that change sensors: of a drone, or with a client of all drones."""

    index: int = -1  # all drones

    @operation
    def set_lidar_config(self, /, lidar: str = "", **fields: Unpack[LidarChanges]) -> Call[None]:
        """Change a LiDAR of this drone, or of all drones.

        If ``channels`` or ``beams`` is given, everything that is given changes for all drones, and arrays have other
        shapes.

        Parameters
        ----------
        lidar
            Name of the LiDAR. Default: the first.
        **fields
            Fields of `LidarConfig` that change.
        """
        text = change_json(LidarConfig, LidarChanges, fields)
        return call("set_lidar_config", nothing, drone=self.index, lidar=lidar, config_json=text)

    @operation
    def set_camera_config(self, /, camera: str = "", **fields: Unpack[CameraChanges]) -> Call[None]:
        """Change a camera of this drone, or of all drones.

        If ``width_px`` or ``height_px`` is given, everything that is given changes for all drones, and arrays have
        other shapes. If one field of view is given, the other is set for square pixels.

        Parameters
        ----------
        camera
            Name of the camera. Default: the only camera.
        **fields
            Fields of `CameraConfig` that change.
        """
        text = change_json(CameraConfig, CameraChanges, fields)
        return call("set_camera_config", nothing, drone=self.index, camera=camera, config_json=text)


class DroneOperations(SensorOperations):
    """The operations of a drone."""

    def __init__(self, client: Any, index: int, env: int | None = None, owner: int | None = None) -> None:
        self._client = client
        self.index = index
        self.env = env
        self.owner = owner

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.index}>"

    def _call(self, call: Call[Any]) -> Any:
        return self._client._call(call)

    def _subscribe(self, subscription: Subscription[Any]) -> Any:
        return self._client._subscribe(subscription)

    @operation
    def get_location(self) -> Call[npt.NDArray[np.float32]]:
        """Return the location (3,) in m, world frame."""
        return call("get_location", readers.location, drone=self.index)

    @operation
    def set_location(self, location: npt.ArrayLike, *, teleport: bool = False) -> Call[Impact]:
        """Move the drone in a straight line, until it touches something.

        Parameters
        ----------
        location
            (3,) m, world frame.
        teleport
            Place the drone there without a collision check.
        """
        return call("set_location", readers.impact, drone=self.index, location=location, teleport=teleport)

    @operation
    def get_rotation(self) -> Call[Rotation]:
        """Return the rotation from body to world."""
        return call("get_rotation", readers.rotation, drone=self.index)

    @operation
    def set_rotation(self, rotation: npt.ArrayLike | Angles, *, teleport: bool = False) -> Call[Impact]:
        """Turn the drone, until it touches something.

        Parameters
        ----------
        rotation
            A quaternion (w, x, y, z) of any length above 0, or `Angles`.
        teleport
            Turn without a collision check.
        """
        return call("set_rotation", readers.impact, drone=self.index, teleport=teleport, **_rotation(rotation))

    @operation
    def set_location_and_rotation(
        self, location: npt.ArrayLike, rotation: npt.ArrayLike | Angles, *, teleport: bool = False
    ) -> Call[Impact]:
        """Move and turn the drone, until it touches something. See `set_location` and `set_rotation`."""
        return call(
            "set_location_and_rotation",
            readers.impact,
            drone=self.index,
            location=location,
            teleport=teleport,
            **_rotation(rotation),
        )

    @operation
    def get_camera_data(
        self, camera: str = "", *, format: _Format = "jpeg", quality: int = 90, output: str = ""
    ) -> Call[CameraData]:
        """Return the image of a camera.

        A camera in the capture mode ``"on_demand"`` renders now; in the other modes, only if its frame is stale.

        Parameters
        ----------
        camera
            Name of the camera. Default: the only camera.
        format
            ``"jpeg"`` or ``"png"``: a file; ``"raw"``: the pixels.
        quality
            Quality of a JPEG file, 1 to 100.
        output
            Name of an output of the camera, such as ``"depth"``; a file can hold only ``"rgb"`` or ``"grey"``. Default:
            ``"rgb"``, or ``"grey"`` if there is no colour.
        """
        return _get_camera_data(self.index, camera, format, quality, output)

    @operation
    def get_lidar_data(self, lidar: str = "", *, directions: bool = True) -> Call[LidarData]:
        """Scan now and return the result.

        Parameters
        ----------
        lidar
            Name of the LiDAR. Default: the first.
        directions
            Return the directions of the beams, too. They change only with the settings, and if ``turn_deg`` is set.
        """
        return _get_lidar_data(self.index, lidar, directions)

    @operation
    def get_lidar_config(self, lidar: str = "") -> Call[LidarConfig]:
        """Return the settings of a LiDAR. Default: the first."""
        return call("get_lidar_config", config_of(LidarConfig), drone=self.index, lidar=lidar)

    @operation
    def get_camera_config(self, camera: str = "") -> Call[CameraConfig]:
        """Return the settings of a camera. Default: the only camera."""
        return call("get_camera_config", config_of(CameraConfig), drone=self.index, camera=camera)

    @operation
    def get_move_line_visible(self) -> Call[bool]:
        """Return whether the line of the drone's past positions is drawn."""
        return call("get_move_line_visible", readers.visible, drone=self.index)

    @operation
    def set_move_line_visible(self, visible: bool) -> Call[None]:
        """Draw the line of the drone's past positions into the RGB images that the server returns, or stop that."""
        return call("set_move_line_visible", nothing, drone=self.index, visible=visible)

    @operation
    def get_beams_visible(self) -> Call[bool]:
        """Return whether the beams of the drone's LiDARs are drawn."""
        return call("get_beams_visible", readers.visible, drone=self.index)

    @operation
    def set_beams_visible(self, visible: bool) -> Call[None]:
        """Draw the beams of the drone's LiDARs into the RGB images that the server returns, or stop that."""
        return call("set_beams_visible", nothing, drone=self.index, visible=visible)

    @operation
    def set_command(self, command: npt.ArrayLike, *, control: str = "") -> Call[None]:
        """Set the command that later steps fly.

        Parameters
        ----------
        command
            Four numbers, or one for each rotor, whose meaning depends on ``control``; see `DynamicsConfig`.
        control
            Name of the control, such as ``"velocity"``. Default: that of the batch.
        """
        row = floats("command", command, -1)[None]
        return call("set_command", nothing, command=row, control=control, drone=self.index)

    @operation
    def claim(self) -> Call[None]:
        """Claim the drone for this client; see the client's ``claim``."""
        return call("claim", nothing, drones=[self.index])

    @operation
    def release(self) -> Call[None]:
        """End this client's claim of the drone."""
        return call("release", nothing, drones=[self.index])

    @operation
    def remove(self) -> Call[None]:
        """Remove the drone from the simulation."""
        return call("remove_drone", nothing, drone=self.index)

    @stream
    def subscribe_camera(
        self,
        camera: str = "",
        *,
        format: _Format = "jpeg",
        quality: int = 90,
        output: str = "",
        rate_hz: float = 30.0,
        only_new: bool = False,
    ) -> Subscription[CameraData]:
        """Receive images again and again. See `get_camera_data` and the client's ``subscribe_arrays``."""
        call = _get_camera_data(self.index, camera, format, quality, output)
        return Subscription(call, rate_hz, only_new)

    @stream
    def subscribe_lidar(
        self, lidar: str = "", *, directions: bool = True, rate_hz: float = 30.0, only_new: bool = False
    ) -> Subscription[LidarData]:
        """Receive scans again and again. See `get_lidar_data` and the client's ``subscribe_arrays``."""
        return Subscription(_get_lidar_data(self.index, lidar, directions), rate_hz, only_new)


class Drone(DroneOperations, Waits):
    """A drone of a server. `drone`, `get_drones` and `spawn_drone` make it.

    Attributes
    ----------
    index
        Index in the batch.
    env
        Its env, or None if the object comes from `drone`.
    owner
        Number of the client that had claimed it when the object was made, or 0; None if the object comes from `drone`.
    """


class AsyncDrone(DroneOperations, Awaits):
    """A drone of a server, for asyncio. See `Drone`."""


# --- calls of several operations


def _get_camera_data(drone: int, camera: str, format: _Format, quality: int, output: str) -> Call[CameraData]:
    if format == "jpeg" and not 1 <= quality <= 100:
        raise ValueError(f"quality: expected an integer from 1 to 100, got {quality!r}")
    return call(
        "get_camera_data",
        readers.camera_data,
        drone=drone,
        camera=camera,
        format=format,
        quality=quality,
        output=output,
    )


def _get_lidar_data(drone: int, lidar: str, directions: bool) -> Call[LidarData]:
    return call("get_lidar_data", readers.lidar_data, drone=drone, lidar=lidar, without_directions=not directions)


def _rotation(rotation: npt.ArrayLike | Angles) -> dict[str, Any]:
    if isinstance(rotation, Angles):
        return {"angles": pb.Angles(**rotation._asdict())}
    return {"quaternion": quaternion("rotation", rotation)}
