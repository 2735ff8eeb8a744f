"""Readers of replies: from messages to results."""

from __future__ import annotations

import json
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import ImuConfig
from flockstep.client import protocol as pb
from flockstep.client.frames import Arrays
from flockstep.client.results import (
    Angles,
    Boxes,
    CameraData,
    CaptureMode,
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

_F32: TypeAlias = npt.NDArray[np.float32]


def vector(message: pb.Vector3) -> _F32:
    """Return a vector as an array (3,)."""
    return np.array((message.x, message.y, message.z), np.float32)


def quaternion(message: pb.Quaternion) -> _F32:
    """Return a quaternion as an array (4,)."""
    return np.array((message.w, message.x, message.y, message.z), np.float32)


def server_info(reply: pb.Reply, arrays: Arrays) -> ServerInfo:
    """Return the server info in a reply."""
    welcome = reply.welcome
    return ServerInfo(
        welcome.version,
        welcome.client,
        welcome.num_envs,
        welcome.drones_per_env,
        welcome.generation,
        tuple(welcome.lidars),
        tuple(welcome.cameras),
        tuple(welcome.imus),
        welcome.flies_by_rotors,
        welcome.has_task,
        welcome.step_s,
        tuple(welcome.array_names),
        {
            name: ImuConfig(**json.loads(text))
            for name, text in zip(welcome.imus, welcome.imu_config_json, strict=False)
        },
        dict(zip(welcome.array_names, welcome.array_rows, strict=False)),
        welcome.bodies_per_env,
        tuple(welcome.sensors),
        welcome.control,
        welcome.num_rotors,
    )


def location(reply: pb.Reply, arrays: Arrays) -> _F32:
    """Return the location in a reply."""
    return vector(reply.location)


def rotation(reply: pb.Reply, arrays: Arrays) -> Rotation:
    """Return the rotation in a reply."""
    angles = reply.rotation.angles
    return Rotation(quaternion(reply.rotation.quaternion), Angles(angles.roll_deg, angles.pitch_deg, angles.yaw_deg))


def impact(reply: pb.Reply, arrays: Arrays) -> Impact:
    """Return the impact in a reply."""
    message = reply.impact
    return Impact(
        message.hit,
        message.fraction,
        vector(message.location),
        quaternion(message.rotation),
        vector(message.point) if message.hit else None,
        vector(message.normal) if message.hit else None,
    )


def impacts(reply: pb.Reply, arrays: Arrays) -> Impacts:
    """Return the impacts in a reply."""
    return Impacts(time(reply, arrays), *(arrays[name] for name in ("position", "quat_wxyz", "hit", "point", "normal")))


def camera_data(reply: pb.Reply, arrays: Arrays) -> CameraData:
    """Return the camera data in a reply."""
    data = reply.camera_data
    image = arrays["image"]
    return CameraData(image.tobytes() if image.ndim == 1 else image, data.width_px, data.height_px, data.step)


def lidar_data(reply: pb.Reply, arrays: Arrays) -> LidarData:
    """Return the lidar data in a reply."""
    data = reply.lidar_data
    return LidarData(arrays["ranges"], arrays.get("directions"), vector(data.origin), quaternion(data.rotation))


def capture_mode(reply: pb.Reply, arrays: Arrays) -> CaptureMode:
    """Return the capture mode in a reply."""
    name: Any = pb.CaptureModeName(reply.capture_mode.mode).name.lower()
    mode: CaptureMode = name
    return mode


def visible(reply: pb.Reply, arrays: Arrays) -> bool:
    """Return the move line visible in a reply."""
    return bool(reply.visible.visible)


def time(reply: pb.Reply, arrays: Arrays) -> Time:
    """Return the time in a reply."""
    return Time(reply.time.step, reply.time.time_s, reply.time.num_envs, reply.time.generation)


def timed_arrays(reply: pb.Reply, arrays: Arrays) -> TimedArrays:
    """Return the timed arrays in a reply."""
    return TimedArrays(time(reply, arrays), arrays)


def fps(reply: pb.Reply, arrays: Arrays) -> Fps:
    """Return the fps in a reply."""
    return Fps(reply.fps.fps, reply.fps.real_time_factor)


def snapshot(reply: pb.Reply, arrays: Arrays) -> bytes:
    """Return the snapshot in a reply."""
    return arrays["snapshot"].tobytes()


def worlds(reply: pb.Reply, arrays: Arrays) -> list[WorldInfo]:
    """Return the worlds in a reply."""
    return [
        WorldInfo(
            world.name,
            world.content_hash,
            vector(world.min),
            vector(world.max),
            vector(world.start) if world.HasField("start") else None,
            vector(world.goal) if world.HasField("goal") else None,
        )
        for world in reply.worlds.worlds
    ]


def mesh(reply: pb.Reply, arrays: Arrays) -> Mesh:
    """Return the mesh in a reply."""
    return Mesh(arrays["vertices"], arrays["triangles"], arrays["objects"])


def point_cloud(reply: pb.Reply, arrays: Arrays) -> PointCloud:
    """Return the point cloud in a reply."""
    return PointCloud(arrays["points"], arrays["normals"], arrays["semantic"], arrays["objects"])


def boxes(reply: pb.Reply, arrays: Arrays) -> Boxes:
    """Return the boxes in a reply."""
    return Boxes(arrays["min"], arrays["max"], arrays["materials"])
