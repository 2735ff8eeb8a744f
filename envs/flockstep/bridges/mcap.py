"""Record flights as MCAP files with ROS 2 messages, without ROS.

Frames: ``map`` is the world frame of flockstep, and each drone has ``NAME/base_link``, its body frame, and a frame for
each sensor. ROS uses the same axes: x east and forward, y north and left, z up.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from math import floor, isfinite
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from flockstep._core import Batch
from flockstep.bridges.ros_messages import Message, cloud, definition, stamp_of, transform_of, xyz, xyzw
from flockstep.bridges.source import BatchSource, ClientSource, Kind, Source
from flockstep.errors import did_you_mean
from flockstep.recording import actions_of
from flockstep.recordings.capture import arrays_in, contents_of
from flockstep.recordings.mcap_files import ArrayChannels
from flockstep.recordings.moment import Moments
from flockstep.recordings.recording import plain_paths
from flockstep.registration import make_by_id
from flockstep.rotations import rotate
from flockstep.serving import TOKEN_VARIABLE, Stop
from flockstep.vector_env import DroneVectorEnv

#: Message and last part of the topic of each kind of sensor.
_TOPICS: dict[Kind, tuple[str, str]] = {
    "lidar": ("sensor_msgs/PointCloud2", "points"),
    "camera": ("sensor_msgs/CompressedImage", "image/compressed"),
    "imu": ("sensor_msgs/Imu", "data"),
}
#: Metadata by which a ROS 2 player keeps the last message of a topic for subscribers that come later.
_LATCHED = {
    "offered_qos_profiles": "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    "  deadline: {sec: 9223372036, nsec: 854775807}\n  lifespan: {sec: 9223372036, nsec: 854775807}\n  liveliness: 1\n"
    "  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}\n  avoid_ros_namespace_conventions: false\n"
}
#: Rotation to the camera frame from the optical frame, whose x points right, y down and z forward.
_OPTICAL_QUAT = (0.5, -0.5, 0.5, -0.5)
#: Environment that the command flies.
_ENV = "flockstep/LidarNavigation-v0"
#: How often the command reads a server.
_POLLS_HZ = 30


class McapRecorder:
    """Writes drones to an MCAP file: poses, LiDAR scans, camera images and IMU readings as ROS 2 messages.

    Call `write` after each step, and `close` at the end; as a context manager the recorder closes itself. It needs the
    packages mcap and mcap-ros2-support, which the extra ``mcap`` installs.

    >>> with McapRecorder("flight.mcap", envs, rates_hz={"lidar": 10}) as recorder:
    ...     for _ in range(100):
    ...         envs.step(envs.action_space.sample())
    ...         recorder.write()

    - ``/clock``, rosgraph_msgs/Clock: the time of every write.
    - ``/tf``, tf2_msgs/TFMessage: from ``map`` to ``NAME/base_link``.
    - ``/tf_static``, tf2_msgs/TFMessage: from ``NAME/base_link`` to each sensor, once, and again if drones come or go.
    - ``/NAME/odom``, nav_msgs/Odometry: pose, and velocity in the body frame. Kinematic motion has none.
    - ``/NAME/SENSOR/points``, sensor_msgs/PointCloud2: hits of a LiDAR in its frame, without misses.
    - ``/NAME/SENSOR/image/compressed``, sensor_msgs/CompressedImage: JPEG of a camera, in its optical frame.
    - ``/NAME/SENSOR/data``, sensor_msgs/Imu: readings of an IMU in its frame, without orientation.

    Parameters
    ----------
    path
        The file, ``.mcap``. An existing one is replaced.
    source
        A `Batch` or `DroneVectorEnv`, whose first env is recorded, or a `Source` such as `BatchSource` or
        `ClientSource`.
    arrays
        Also write all arrays of a `DroneVectorEnv`, for `flockstep.Recording`: topics ``/flockstep/...``.
    paths
        As in `Recording.writer`, with ``arrays=True``.
    rates_hz
        Messages per second of simulated time, by the name of a sensor, or ``"pose"`` for /tf and odom. Others are
        written at every write. A rate above that of the writes has no effect.
    chunk_bytes
        Uncompressed size of a part of the file. A killed program loses at most the messages of the latest part.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        source: Batch | DroneVectorEnv | Source,
        *,
        rates_hz: Mapping[str, float] | None = None,
        arrays: bool = False,
        paths: Sequence[npt.ArrayLike] = (),
        chunk_bytes: int = 256 * 1024,
    ) -> None:
        if Path(path).suffix != ".mcap":
            raise ValueError(f"path: expected a name that ends with .mcap, got {fspath(path)!r}")
        if isinstance(chunk_bytes, bool) or not isinstance(chunk_bytes, int) or chunk_bytes < 1:
            raise ValueError(f"chunk_bytes: expected an integer >= 1, got {chunk_bytes!r}")
        if arrays and not isinstance(source, DroneVectorEnv):
            raise TypeError(f"source: expected a DroneVectorEnv for arrays=True, got {source!r}")
        batch = source.batch if isinstance(source, DroneVectorEnv) else source
        self.source: Source = BatchSource(batch) if isinstance(batch, Batch) else batch
        if not isinstance(self.source, Source):
            raise TypeError(f"source: expected a Batch, a DroneVectorEnv or a Source, got {source!r}")
        self._rates = dict(rates_hz or {})
        known = ["pose", *self.source.sensors]
        for name, rate in self._rates.items():
            if name not in known:
                hint = did_you_mean(name, known)
                raise ValueError(f"rates_hz: expected names among {', '.join(known)}, got {name!r}{hint}")
            if isinstance(rate, bool) or not isinstance(rate, (int, float, np.number)) or not 0 < rate < float("inf"):
                raise ValueError(f"rates_hz[{name!r}]: expected a number > 0, got {rate!r}")
        if len(plain_paths(paths)) and not arrays:
            raise ValueError(f"paths: expected none without arrays=True, got {len(paths)}")
        _static_transforms(self.source)  # refuses bad names
        try:
            from mcap_ros2.writer import Writer
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"McapRecorder needs {error.name}, which is not installed: pip install mcap mcap-ros2-support",
                name=error.name,
            ) from error
        self._periods: dict[str, int] = {}  # number of the latest message of each name, at its rate
        self._time_s = -1.0
        self._stream = Path(path).open("wb")  # noqa: SIM115 # close() closes it
        self._writer: Any = Writer(self._stream, chunk_size=chunk_bytes)
        self._schemas: dict[str, Any] = {}
        self._drones: list[str] | None = None  # of the latest /tf_static
        self._envs = source if arrays and isinstance(source, DroneVectorEnv) else None
        if self._envs is not None:
            self._moments = Moments(self._envs.batch, pixels=True)
            self._arrays = ArrayChannels(self._writer._writer, contents_of(self._envs, self._moments, paths=paths))

    def write(self, actions: npt.ArrayLike | None = None) -> None:
        """Write the current state and the messages that are due; nothing if no time has passed since the last write.

        ``actions``, which led to this state, are one of the arrays.

        If writing fails or Ctrl-C interrupts it, the file ends as if the program had been killed.

        Raises
        ------
        RuntimeError
            The recorder is closed, or a LiDAR has not scanned yet.
        ValueError
            The source's time is negative, not finite, or goes back.
        """
        if self._writer is None:
            raise RuntimeError("the recorder is closed")
        time_s = float(self.source.time_s())
        if not isfinite(time_s) or time_s < max(self._time_s, 0.0):
            raise ValueError(f"time_s: expected a time >= {max(self._time_s, 0.0):g}, got {time_s:g}")
        if time_s == self._time_s:
            return
        stamp_ns = round(time_s * 1e9)
        drones = list(self.source.drones)
        due = {name: self._period_of(name, time_s) for name in ("pose", *self.source.sensors)}
        due = {name: period for name, period in due.items() if period != self._periods.get(name)}
        messages = list(self._messages(due, stamp_of(stamp_ns)))  # all of them before the first is written
        try:
            if self._envs is not None:
                values, images = self._moments.now()
                values |= arrays_in(self._envs, self._moments, actions)
                self._arrays.write(stamp_ns, values, images)
            for topic, kind, message in messages:
                self._writer.write_message(topic, self._schema(kind, topic), message, stamp_ns)
            self._stream.flush()
        except BaseException:  # half of a message may be in the chunk: keep the chunks before it, without an index
            self._writer = None
            with suppress(OSError):
                self._stream.close()
            raise
        self._time_s, self._drones = time_s, drones
        self._periods |= due

    def close(self) -> None:
        """Write the index and close the file."""
        if self._writer is not None:
            writer, self._writer = self._writer, None
            try:
                writer.finish()
            finally:
                self._stream.close()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _period_of(self, name: str, time_s: float) -> int:
        """Return the number of the period that contains a time; without a rate, another number at every write."""
        rate = self._rates.get(name)
        return self._periods.get(name, 0) + 1 if rate is None else floor(time_s * rate + 1e-6)

    def _schema(self, kind: str, topic: str) -> Any:
        if kind not in self._schemas:
            package, name = kind.split("/")
            self._schemas[kind] = self._writer.register_msgdef(f"{package}/msg/{name}", definition(kind))
        schema = self._schemas[kind]
        if topic == "/tf_static":  # the public call has no metadata
            self._writer._channel_ids[topic] = self._writer._writer.register_channel(topic, "cdr", schema.id, _LATCHED)
        return schema

    def _messages(self, due: Mapping[str, int], stamp: Message) -> Iterable[tuple[str, str, Message]]:
        """Yield topic, kind and content of each message."""
        source = self.source
        yield "/clock", "rosgraph_msgs/Clock", {"clock": stamp}
        if self._drones != list(source.drones):
            static = _static_transforms(source)
            for transform in static:
                transform["header"]["stamp"] = stamp
            yield "/tf_static", "tf2_msgs/TFMessage", {"transforms": static}
        if "pose" in due:
            yield from self._poses(stamp)
        for sensor, kind in source.sensors.items():
            if sensor not in due:
                continue
            message, last = _TOPICS[kind]
            for drone, name in enumerate(source.drones):
                content = self._reading(sensor, kind, drone)
                if content is not None:
                    frame = f"{name}/{sensor}_optical" if kind == "camera" else f"{name}/{sensor}"
                    content["header"] = {"stamp": stamp, "frame_id": frame}
                    yield f"/{name}/{sensor}/{last}", message, content

    def _poses(self, stamp: Message) -> Iterable[tuple[str, str, Message]]:
        """Yield the transforms of the drones, and their odometry if they have velocities."""
        drones = self.source.drones
        position, quat = self.source.poses()
        frames = [f"{name}/base_link" for name in drones]
        transforms = [
            transform_of("map", frame, place, turn, stamp)
            for frame, place, turn in zip(frames, position, quat, strict=True)
        ]
        yield "/tf", "tf2_msgs/TFMessage", {"transforms": transforms}
        velocities = self.source.velocities()
        if velocities is None:
            return
        in_body = rotate(quat, velocities[0], inverse=True)
        for drone, name in enumerate(drones):
            odometry = {
                "header": {"stamp": stamp, "frame_id": "map"},
                "child_frame_id": frames[drone],
                "pose": {"pose": {"position": xyz(position[drone]), "orientation": xyzw(quat[drone])}},
                "twist": {"twist": {"linear": xyz(in_body[drone]), "angular": xyz(velocities[1][drone])}},
            }
            yield f"/{name}/odom", "nav_msgs/Odometry", odometry

    def _reading(self, sensor: str, kind: Kind, drone: int) -> Message | None:
        """Return the content of a sensor's message without its header, or None if there is none."""
        if kind == "lidar":
            return cloud(self.source.points(sensor, drone))
        if kind == "camera":
            image = self.source.jpeg(sensor, drone)
            return None if image is None else {"format": "jpeg", "data": image}
        force, rates = self.source.inertial(sensor, drone)
        # By the definition of the message, -1 says that there is no orientation.
        unknown = [-1.0] + [0.0] * 8
        return {
            "orientation": xyzw((1, 0, 0, 0)),
            "orientation_covariance": unknown,
            "angular_velocity": xyz(rates),
            "linear_acceleration": xyz(force),
        }


def _check_frames(source: Source, static: Sequence[Message]) -> None:
    """Raise ValueError unless all names are names in ROS and all frames have different names."""
    for what, names in (("drones", source.drones), ("sensors", source.sensors)):
        for name in names:
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
                raise ValueError(f"{what}: expected names of letters, digits and _, first a letter, got {name!r}")
    frames = [f"{name}/base_link" for name in source.drones] + [transform["child_frame_id"] for transform in static]
    twice = {frame for frame, count in Counter(frames).items() if count > 1}
    if twice:
        raise ValueError(f"sensors: expected different names of frames, got {sorted(twice)[0]!r} twice")


def _static_transforms(source: Source) -> list[Message]:
    """Return the transforms from each drone to its sensors, without stamps.

    Raises
    ------
    ValueError
        See `_check_frames`.
    """
    transforms = []
    for drone, name in enumerate(source.drones):
        for sensor, kind in source.sensors.items():
            place, turn = source.mounting(sensor, drone)
            frame = f"{name}/{sensor}"
            transforms.append(transform_of(f"{name}/base_link", frame, place, turn, stamp_of(0)))
            if kind == "camera":
                transforms.append(transform_of(frame, f"{frame}_optical", (0, 0, 0), _OPTICAL_QUAT, stamp_of(0)))
    _check_frames(source, transforms)
    return transforms


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``mcap``."""
    parser.add_argument("path", metavar="FILE", help="file to write, .mcap")
    parser.add_argument("recipe", nargs="?", type=Path, metavar="RECIPE", help="JSON file of a recipe to fly")
    text = f"id of the environment to fly without a recipe; default: {_ENV}"
    parser.add_argument("--env", help=text)
    text = "a PPO model of Stable-Baselines3, which runs code from the file; default: random actions"
    parser.add_argument("--policy", metavar="ZIP", help=text)
    text = "simulated time to record, or with --connect real time; default: 10, or with --connect until Ctrl-C"
    parser.add_argument("--seconds", type=float, help=text)
    parser.add_argument("--seed", type=int, help="default: 0")
    text = (
        "messages per second of a sensor, or of the pose: --rate lidar=10; default: one per step, or with --connect "
        f"{_POLLS_HZ}"
    )
    parser.add_argument("--rate", action="append", default=[], metavar="NAME=HZ", help=text)
    text = (
        "record the drones of a server, such as 127.0.0.1:41451; the environment variable "
        f"{TOKEN_VARIABLE} has its token"
    )
    parser.add_argument("--connect", metavar="ADDRESS", help=text)
    text = "PEM file with the certificates to trust, for an address that begins with wss://"
    parser.add_argument("--ca-file", metavar="FILE", help=text)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    try:
        rates = dict(_rate_of(text) for text in arguments.rate)
        if arguments.seconds is not None and not 0 < arguments.seconds < float("inf"):
            raise ValueError(f"seconds: expected a number > 0, got {arguments.seconds:g}")
        if arguments.connect is None:
            _record_env(arguments, rates)
        else:
            _record_server(arguments, rates)
    except (ImportError, OSError, RuntimeError, ValueError, gymnasium.error.Error) as error:
        raise SystemExit(f"flockstep mcap: {error}") from error


def _record_env(arguments: argparse.Namespace, rates: Mapping[str, float]) -> None:
    """Fly and record an environment."""
    if arguments.ca_file is not None:
        raise ValueError("ca-file: expected together with --connect only")
    seconds = 10.0 if arguments.seconds is None else arguments.seconds
    seed = 0 if arguments.seed is None else arguments.seed
    if arguments.recipe is not None:
        text = arguments.recipe.read_text(encoding="utf-8")
        envs = DroneVectorEnv.from_recipe(text, allow_files=True, num_envs=1)
    else:
        envs = make_by_id(arguments.env or _ENV, 1)
    policy = None
    if arguments.policy is not None:
        from stable_baselines3 import PPO

        policy = PPO.load(arguments.policy)
    act = actions_of(policy, envs, "mcap", seed)
    observation, _ = envs.reset(seed=seed)
    starts, ended = np.ones(envs.num_envs, bool), np.zeros(envs.num_envs, bool)
    source = BatchSource(envs.batch)
    with McapRecorder(arguments.path, envs, rates_hz=rates, arrays=True) as recorder:
        recorder.write()
        steps = 0
        stopped = _stopped_by_ctrl_c()
        while not stopped.is_set() and source.time_s() < seconds - 1e-9:
            actions = act(observation, starts)
            observation, _, terminated, truncated, _ = envs.step(actions)
            starts, ended = ended, terminated | truncated  # with next-step autoreset the next step begins the episode
            recorder.write(actions)
            steps += 1
    print(
        f"{arguments.path}: {steps} steps of {', '.join(source.drones)}, sensors {', '.join(source.sensors) or 'none'}"
    )


def _record_server(arguments: argparse.Namespace, rates: Mapping[str, float]) -> None:
    """Record the drones of a server."""
    for name in ("recipe", "env", "policy", "seed"):
        if getattr(arguments, name) is not None:
            raise ValueError(f"{name}: expected none together with --connect, got {getattr(arguments, name)}")
    from flockstep.client import ServerError, connect  # needs the extra packages of the client

    token = os.environ.get(TOKEN_VARIABLE, "")
    try:
        with connect(arguments.connect, token=token, ca_file=arguments.ca_file) as client:
            source = ClientSource(client)
            period_s = 1.0 / max([_POLLS_HZ, *rates.values()])
            seen: set[str] = set()
            writes = 0
            with McapRecorder(arguments.path, source, rates_hz=rates) as recorder:
                print(f"recording {arguments.connect}; Ctrl-C ends it", flush=True)
                stopped = _stopped_by_ctrl_c()
                start = due = time.monotonic()
                while not stopped.is_set() and (arguments.seconds is None or due < start + arguments.seconds):
                    recorder.write()
                    seen.update(source.drones)
                    writes += 1
                    due = max(due + period_s, time.monotonic())
                    stopped.wait(max(0.0, due - time.monotonic()))
    except ServerError as error:
        raise RuntimeError(f"{error.operation}: {error}") from error
    drones = f"{len(seen)} drone{'' if len(seen) == 1 else 's'}"
    print(f"{arguments.path}: {writes} moments, {drones}, sensors {', '.join(source.sensors) or 'none'}")


def _stopped_by_ctrl_c() -> Stop:
    """Return a request that the first Ctrl-C makes, so that it interrupts no write. A second one interrupts."""
    stopped = Stop()

    def stop(number: int, _: object) -> None:
        stopped.set()
        signal.signal(number, signal.default_int_handler)

    signal.signal(signal.SIGINT, stop)
    return stopped


def _rate_of(text: str) -> tuple[str, float]:
    name, _, rate = text.partition("=")
    try:
        return name, float(rate)
    except ValueError:
        raise ValueError(f"rate: expected NAME=HZ, such as lidar=10, got {text!r}") from None
