"""MCAP files as rosbags reads them, which has its own reader and message definitions; matrices by SciPy."""

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

STORE = get_typestore(Stores.ROS2_HUMBLE)
TILT = np.roll(Rotation.from_euler("zyx", [0.4, 0.5, -0.3]).as_quat(), 1)
LOOK = np.roll(Rotation.from_euler("zyx", [-0.7, 0.2, 0.1]).as_quat(), 1)


def read(path):
    """Return {topic: [(time in ns, message), ...]} of a file, of messages of ROS 2."""
    found = {}
    with Reader(path) as reader:
        ours = [each for each in reader.connections if not each.topic.startswith("/flockstep/")]
        for connection, stamp, data in reader.messages(ours):
            found.setdefault(connection.topic, []).append((stamp, STORE.deserialize_cdr(data, connection.msgtype)))
    return found


def vector(message):
    return np.array([message.x, message.y, message.z])


def quaternion(message):
    return np.array([message.w, message.x, message.y, message.z])


def stamp_ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def cloud_of(message):
    """Return the points (N, 3) of a cloud."""
    return np.frombuffer(message.data.tobytes(), "<f4").reshape(message.width, 3)


def matrix_of(place, quat_wxyz):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(np.roll(quat_wxyz, -1)).as_matrix()
    matrix[:3, 3] = place
    return matrix


class Tree:
    """The transforms of a file at one time, as matrices from a frame to its parent."""

    def __init__(self, found, index):
        self.parents = {}
        for topic, at in (("/tf", index), ("/tf_static", 0)):
            for transform in found[topic][at][1].transforms:
                moved = transform.transform
                matrix = matrix_of(vector(moved.translation), quaternion(moved.rotation))
                assert transform.child_frame_id not in self.parents, "a frame has one parent"
                self.parents[transform.child_frame_id] = transform.header.frame_id, matrix

    def to_map(self, frame):
        matrix = np.eye(4)
        for _ in range(len(self.parents) + 1):
            if frame == "map":
                return matrix
            frame, step = self.parents[frame]
            matrix = step @ matrix
        raise AssertionError("a loop")

    def placed(self, frame, points):
        matrix = self.to_map(frame)
        return points @ matrix[:3, :3].T + matrix[:3, 3]


class PlainSource:
    """A source made of plain arrays."""

    def __init__(self):
        self.drones = ["scout"]
        self.sensors = {"top": "lidar", "eye": "camera", "body": "imu"}
        self.now = 1.5

    def time_s(self):
        return self.now

    def poses(self):
        return np.array([[1, 2, 3]]), np.array([[1, 0, 0, 0]])

    def velocities(self):
        return np.array([[4, 5, 6]]), np.array([[7, 8, 9]])

    def mounting(self, sensor, drone):
        return [0, 0, 1], [1, 0, 0, 0]

    def points(self, sensor, drone):
        return np.arange(6, dtype=float).reshape(2, 3)

    def inertial(self, sensor, drone):
        return np.array([1, 2, 3]), np.array([4, 5, 6])

    def jpeg(self, sensor, drone):
        return b"image"
