"""ROS 2 messages: their definitions, and parts of their contents."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Message: TypeAlias = dict[str, Any]

#: Fields of the ROS 2 messages.
_FIELDS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "sensor_msgs/PointField": (
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\n"
        "uint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count"
    ),
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/PointCloud2": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n"
        "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
}


def definition(kind: str) -> str:
    """Return the definition of a message, followed by those of the messages in it."""
    parts, names = [_FIELDS[kind]], [kind]
    for name in names:
        for line in _FIELDS[name].splitlines():
            inner = line.split()[0].removesuffix("[]")
            if inner in _FIELDS and inner not in names:
                names.append(inner)
                parts.append(f"{'=' * 80}\nMSG: {inner}\n{_FIELDS[inner]}")
    return "\n".join(parts) + "\n"


def stamp_of(stamp_ns: int) -> Message:
    """Return a Time."""
    return {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}


def xyz(vector: npt.ArrayLike) -> Message:
    """Return a Vector3 or Point."""
    return dict(zip("xyz", np.asarray(vector, float).tolist(), strict=True))


def xyzw(quat_wxyz: npt.ArrayLike) -> Message:
    """Return a Quaternion."""
    return dict(zip("wxyz", np.asarray(quat_wxyz, float).tolist(), strict=True))


def transform_of(parent: str, child: str, place: npt.ArrayLike, turn: npt.ArrayLike, stamp: Message) -> Message:
    """Return a TransformStamped: the pose of the frame ``child`` in the frame ``parent``."""
    return {
        "header": {"stamp": stamp, "frame_id": parent},
        "child_frame_id": child,
        "transform": {"translation": xyz(place), "rotation": xyzw(turn)},
    }


def cloud(points: npt.NDArray[Any]) -> Message:
    """Return a PointCloud2 without its header, from points (K, 3); 7 is the number of float32."""
    data = np.ascontiguousarray(points, "<f4")
    return {
        "height": 1,
        "width": len(data),
        "fields": [{"name": "xyz"[i], "offset": 4 * i, "datatype": 7, "count": 1} for i in range(3)],
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * len(data),
        "data": data.tobytes(),
        "is_dense": True,
    }
