"""Client of a flockstep server: `connect` for ordinary programs, `connect_async` for asyncio.

>>> with flockstep.connect("127.0.0.1:41451") as client:
...     drone = client.spawn_drone((2, 4, 2))
...     impact = drone.set_location((6, 4, 2))
...     ranges = drone.get_lidar_data().ranges
"""

try:
    import google.protobuf as _protobuf  # noqa: F401
    import websockets as _websockets  # noqa: F401
except ImportError as _error:
    _needed = f"flockstep.client needs protobuf and websockets: pip install 'flockstep[client]' ({_error})"
    raise type(_error)(_needed, name=_error.name) from _error

from typing import TYPE_CHECKING as _TYPE_CHECKING

from flockstep.client.async_client import AsyncClient, connect_async
from flockstep.client.errors import ServerError
from flockstep.client.operations import AsyncDrone, Drone
from flockstep.client.results import (
    Angles,
    Boxes,
    CameraData,
    Fps,
    Impact,
    Impacts,
    LidarData,
    Mesh,
    PointCloud,
    Rotation,
    ServerInfo,
    Time,
    TimedArrays,
    WorldInfo,
)
from flockstep.client.streams import AsyncStream, Stream
from flockstep.client.sync_client import Client, connect
from flockstep.client.vector_env import RemoteVectorEnv

__all__ = [
    "Angles",
    "AsyncClient",
    "AsyncDrone",
    "AsyncStream",
    "Boxes",
    "CameraData",
    "Client",
    "Drone",
    "Fps",
    "Impact",
    "Impacts",
    "LidarData",
    "Mesh",
    "PointCloud",
    "RemoteVectorEnv",
    "Rotation",
    "ServerError",
    "ServerInfo",
    "Stream",
    "Time",
    "TimedArrays",
    "WorldInfo",
    "connect",
    "connect_async",
]

if not _TYPE_CHECKING:

    def __getattr__(name: str) -> None:
        import flockstep
        from flockstep.errors import did_you_mean

        known = [*__all__, "ServerInfo.imu_configs", *(f"flockstep.{public}" for public in flockstep.__all__)]
        hint = did_you_mean(name, known) or did_you_mean(name.replace("Settings", "Config"), known)  # a former name
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
