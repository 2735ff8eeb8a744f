"""Let ArduPilot fly the drones of a batch: its JSON interface over UDP, in lockstep.

ArduPilot's simulation (SITL) sends one servo packet per frame and waits for the answer, one line of JSON with the state
after that frame. Vectors and quaternions of the answer are in ArduPilot's frames: north, east, down for the world, and
forward, right, down for the body.
"""

from __future__ import annotations

import argparse
import json
import selectors
import socket
import struct
import warnings
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, DroneModel, Recipe, World
from flockstep.rotations import rotate

#: ArduPilot's instance i uses the UDP port of instance 0 plus 10 i.
PORTS_PER_INSTANCE = 10

#: Channels of a servo packet, by its first number.
_CHANNELS = {18458: 16, 29569: 32}
_HEADER = struct.Struct("<HHI")  # magic, frame_rate, frame_count
_UP_MPS2 = np.array([0, 0, 9.81])  # an accelerometer at rest
_LONGEST = _HEADER.size + 2 * max(_CHANNELS.values())
#: Signs of x and y of the motors 1 to 4 of ArduPilot's frame QUAD X, in our body frame, and their spins.
_QUAD_X = (((1, -1), "ccw"), ((-1, 1), "ccw"), ((1, 1), "cw"), ((-1, -1), "cw"))
_QUAD_X_NAMES = ("front right", "rear left", "front left", "rear right")


class ServoPacket(NamedTuple):
    """A servo packet of ArduPilot."""

    frame_rate: int
    frame_count: int
    pwm: tuple[int, ...]

    @staticmethod
    def parse(data: bytes) -> ServoPacket | None:
        """Return the packet of a datagram, or None if it is not one."""
        if len(data) < _HEADER.size:
            return None
        magic, frame_rate, frame_count = _HEADER.unpack_from(data)
        channels = _CHANNELS.get(magic)
        if channels is None or frame_rate == 0 or len(data) != _HEADER.size + 2 * channels:
            return None
        return ServoPacket(frame_rate, frame_count, struct.unpack_from(f"<{channels}H", data, _HEADER.size))


def ned(enu: Sequence[float]) -> list[float]:
    """Return a world vector (east, north, up) as north, east, down."""
    east, north, up = enu
    return [north, east, -up]


def frd(flu: Sequence[float]) -> list[float]:
    """Return a body vector (forward, left, up) as forward, right, down."""
    forward, left, up = flu
    return [forward, -left, -up]


def ned_frd_quat(quat_wxyz: Sequence[float]) -> list[float]:
    """Return the rotation from forward, right, down to north, east, down of a drone.

    It is P q F: F turns the body's axes by half a turn about x, and P the world's by half a turn about (1, 1, 0).
    """
    w, x, y, z = quat_wxyz
    half = 0.5**0.5
    return [half * (w + z), half * (x + y), half * (x - y), half * (w - z)]


def state_line(
    timestamp_s: float,
    position: npt.ArrayLike,
    quat_wxyz: npt.ArrayLike,
    velocity: npt.ArrayLike,
    angular_velocity: npt.ArrayLike,
    acceleration: npt.ArrayLike,
) -> bytes:
    """Return the answer to a servo packet, from one drone's state in the frames of a batch.

    ArduPilot searches the text for each key and reads the number behind it, so the text has no spaces.
    """
    quat = np.asarray(quat_wxyz, float)
    force = rotate(quat, np.asarray(acceleration, float) + _UP_MPS2, inverse=True)
    state = {
        "timestamp": timestamp_s,
        "imu": {"gyro": frd(_floats(angular_velocity)), "accel_body": frd(force.tolist())},
        "position": ned(_floats(position)),
        "quaternion": ned_frd_quat(quat.tolist()),
        "velocity": ned(_floats(velocity)),
    }
    return b"\n" + json.dumps(state, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _floats(values: npt.ArrayLike) -> list[float]:
    floats: list[float] = np.asarray(values, float).tolist()
    return floats


def rotors_of_quad_x(drone: DroneModel, whose: str = "ArduPilot's frame QUAD X") -> list[int]:
    """Return the rotor of an airframe for each of the motors 1 to 4 of ArduPilot's frame QUAD X.

    ``whose`` names the frame in messages.

    Raises
    ------
    ValueError
        The drone has no airframe, or its rotors are not at the corners of an X, or they spin otherwise.
    """
    rotors = drone.to_dict().get("rotors")
    if rotors is None:
        raise ValueError("drone: expected one with an airframe, got a hull only")
    if len(rotors["spin"]) != 4:
        raise ValueError(f"drone: expected a quadrotor, for {whose}, got {len(rotors['spin'])} rotors")
    corners = [(float(np.sign(x)), float(np.sign(y))) for x, y, _ in rotors["position_m"]]
    found = []
    for motor, (corner, spin) in enumerate(_QUAD_X):
        at = [rotor for rotor, sign in enumerate(corners) if sign == corner]
        where = f"drone: expected {whose}, with motor {motor + 1} {_QUAD_X_NAMES[motor]}, {spin}"
        if len(at) != 1:
            raise ValueError(f"{where}; got {len(at)} rotors there")
        if rotors["spin"][at[0]] != spin:
            raise ValueError(f"{where}; got {rotors['spin'][at[0]]}")
        found.append(at[0])
    return found


@dataclass
class PacketCounts:
    """Counts of the packets that one port received.

    Parameters
    ----------
    flown
        Packets that advanced the physics by one frame.
    repeated
        Packets with the frame number of the previous one. They got the previous answer again.
    lost
        Frame numbers that were skipped.
    late
        Duplicates of an earlier packet that arrived after a newer one. They were ignored.
    restarts
        Times that the frame number went back: the drone returned to its start.
    bad
        Datagrams that are not servo packets. They were ignored.
    foreign
        Packets from another host than the first one. They were ignored.
    unfit
        Packets with a frame rate that the physics cannot follow. They were ignored.
    """

    flown: int = 0
    repeated: int = 0
    lost: int = 0
    late: int = 0
    restarts: int = 0
    bad: int = 0
    foreign: int = 0
    unfit: int = 0


@dataclass
class _Link:
    """The port of one drone."""

    drone: int
    socket: socket.socket
    counts: PacketCounts = field(default_factory=PacketCounts)
    peer: tuple[str, int] | None = None
    #: Frame number of the last flown packet, and the answer to it.
    frame_count: int | None = None
    answer: bytes = b""
    #: Ticks flown since the controller started.
    ticks: int = 0
    #: The next packet and its ticks; the other drones of the env have not sent theirs yet.
    pending: ServoPacket | None = None
    pending_ticks: int = 0
    recent: deque[bytes] = field(default_factory=lambda: deque(maxlen=8))
    is_rate_reported: bool = False


class ArduPilotBridge:
    """Answers ArduPilot's JSON interface for every drone of a batch.

    Drone d listens on UDP port ``port + 10 d``, the port of ArduPilot's instance d. Each servo packet advances the
    drone's env by one frame of 1 / ``frame_rate`` s. If an env has several drones, it waits until each of them has a
    packet. A drone begins at the pose that it has when the bridge is made, at rest and with its rotors stopped. It
    returns to that pose when its controller restarts. The bridge reads no sensors: ArduPilot gets the exact state and
    adds the errors of its simulated sensors.

    A pulse of 1000 us or less stops a motor, and 2000 us is full speed. In between, the command is linear: in speed
    with ``control="rotor_speeds"``, in thrust with ``control="rotor_thrusts"``.

    Parameters
    ----------
    batch
        The drones. The batch needs ``motion="rotors"``, ``control="rotor_speeds"`` or ``"rotor_thrusts"``,
        ``on_contact="stop"`` or ``"bounce"``, and an airframe that fits ArduPilot's frame QUAD X.
    address
        IPv4 address to listen on. The default accepts only this machine.
    port
        UDP port of the first drone. 0: any free ports; see `ports`.

    Raises
    ------
    ValueError
        The batch or an argument does not fit.
    OSError
        A port cannot be opened.
    """

    def __init__(self, batch: Batch, *, address: str = "127.0.0.1", port: int = 9002) -> None:
        dynamics = batch.dynamics
        if dynamics.motion != "rotors" or dynamics.control not in ("rotor_speeds", "rotor_thrusts"):
            raise ValueError(
                'batch: expected motion="rotors" and control="rotor_speeds" or "rotor_thrusts", '
                f'got motion="{dynamics.motion}" and control="{dynamics.control}"'
            )
        if dynamics.on_contact == "terminate":
            raise ValueError(
                'batch: expected on_contact="stop" or "bounce", because drones start on the ground, got "terminate"'
            )
        last = 65535 - PORTS_PER_INSTANCE * (batch.num_drones - 1)
        if isinstance(port, bool) or not isinstance(port, (int, np.integer)) or not 0 <= port <= last:
            raise ValueError(f"port: expected an integer in [0, {last}], got {port!r}")
        self.batch = batch
        self._rotors = rotors_of_quad_x(batch.drone)
        is_speed = dynamics.control == "rotor_speeds"
        self._full = batch.drone.to_dict()["rotors"]["max_speed_radps"] if is_speed else batch.drone.max_thrust_n
        self._physics_hz = batch.clock.physics_hz or 0.0
        self._start = batch.position.copy(), batch.quat_wxyz.copy()
        self._command = np.zeros((batch.num_drones, batch.num_rotors), np.float32)
        self._selector = selectors.DefaultSelector()
        self._links: list[_Link] = []
        try:
            for drone in range(batch.num_drones):
                self._links.append(_Link(drone, _opened(address, port + PORTS_PER_INSTANCE * drone if port else 0)))
                self._selector.register(self._links[drone].socket, selectors.EVENT_READ, self._links[drone])
        except BaseException:
            self.close()
            raise
        self._to_start(np.ones(batch.num_drones, bool))

    @property
    def ports(self) -> list[int]:
        """UDP port of each drone."""
        return [link.socket.getsockname()[1] for link in self._links]

    @property
    def counts(self) -> list[PacketCounts]:
        """Counts of the packets for each drone."""
        return [link.counts for link in self._links]

    def exchange(self, timeout_s: float | None = None) -> list[int]:
        """Wait for packets, fly them and answer; return the envs that flew.

        Parameters
        ----------
        timeout_s
            Longest time to wait, in seconds of real time. None: wait until a packet arrives.
        """
        flown = []
        for key, _ in self._selector.select(timeout_s):
            link: _Link = key.data
            if self._receive(link):
                env = link.drone // self.batch.drones_per_env
                if self._fly(env):
                    flown.append(env)
        return flown

    def serve(self) -> None:
        """Answer until an exception, such as that of Ctrl-C."""
        while True:
            self.exchange(0.5)

    def close(self) -> None:
        """Close the ports."""
        self._selector.close()
        for link in self._links:
            link.socket.close()

    def __enter__(self) -> ArduPilotBridge:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _receive(self, link: _Link) -> bool:
        """Read one datagram; return whether it is the next packet to fly."""
        try:
            data, peer = link.socket.recvfrom(_LONGEST + 1)
        except OSError:  # nothing to read, or an earlier answer did not reach its port
            return False
        packet = ServoPacket.parse(data)
        if packet is None:
            link.counts.bad += 1
            return False
        if link.peer is not None and link.peer[0] != peer[0]:
            link.counts.foreign += 1
            return False
        link.peer = peer  # a restarted controller has another port
        if link.pending is not None and packet.frame_count == link.pending.frame_count:
            link.counts.repeated += 1  # its answer follows when the env flies
            return False
        if packet.frame_count == link.frame_count:
            link.counts.repeated += 1
            self._answer(link)
            return False
        ticks = self._ticks_of(link, packet.frame_rate)
        if ticks is None:
            link.counts.unfit += 1
            return False
        if link.frame_count is not None:
            if packet.frame_count > link.frame_count:
                if link.pending is None:
                    link.counts.lost += packet.frame_count - link.frame_count - 1
            elif data in link.recent:  # a second identical packet passes: a controller that restarted sends again
                link.recent.remove(data)
                link.counts.late += 1
                return False
            else:
                link.counts.restarts += 1
                link.frame_count, link.ticks, link.is_rate_reported = None, 0, False
                self._to_start(np.arange(self.batch.num_drones) == link.drone)
        link.recent.append(data)
        link.pending, link.pending_ticks = packet, ticks
        return True

    def _ticks_of(self, link: _Link, frame_rate: int) -> int | None:
        """Return the ticks of a frame. If the physics cannot follow, return None, and warn once per start."""
        ticks = round(self._physics_hz / frame_rate)
        others = [other for other in self._env_links(link) if other.pending is not None and other is not link]
        if ticks < 1 or abs(ticks * frame_rate - self._physics_hz) > 1e-6 * self._physics_hz:
            expected = f"a divisor of the batch's physics_hz, {self._physics_hz:g}"
        elif any(other.pending_ticks != ticks for other in others):
            expected = "the rate of the other drones of the env"
        else:
            return ticks
        if not link.is_rate_reported:
            link.is_rate_reported = True
            warnings.warn(
                f"frame_rate: expected {expected}, got {frame_rate}: drone {link.drone} does not answer. Set "
                "ArduPilot's SIM_RATE_HZ, or physics_hz of the ClockConfig",
                RuntimeWarning,
                stacklevel=4,
            )
        return None

    def _env_links(self, link: _Link) -> list[_Link]:
        per_env = self.batch.drones_per_env
        first = link.drone // per_env * per_env
        return self._links[first : first + per_env]

    def _fly(self, env: int) -> bool:
        """Fly one frame of an env if every drone has a packet; return whether it flew."""
        links = self._env_links(self._links[env * self.batch.drones_per_env])
        if any(link.pending is None for link in links):
            return False
        mask = np.zeros(self.batch.num_drones, bool)
        for link in links:
            assert link.pending is not None
            pulses = np.array(link.pending.pwm[:4], float)
            self._command[link.drone, self._rotors] = np.clip((pulses - 1000) / 1000, 0, 1) * self._full
            mask[link.drone] = True
        self.batch.fly(self._command, ticks=links[0].pending_ticks, mask=mask)
        for link in links:
            assert link.pending is not None
            link.counts.flown += 1
            link.ticks += link.pending_ticks
            link.frame_count, link.pending = link.pending.frame_count, None
            batch, drone = self.batch, link.drone
            link.answer = state_line(
                link.ticks / self._physics_hz,
                batch.position[drone],
                batch.quat_wxyz[drone],
                batch.velocity[drone],
                batch.angular_velocity[drone],
                batch.acceleration[drone],
            )
            self._answer(link)
        return True

    def _answer(self, link: _Link) -> None:
        assert link.peer is not None
        with suppress(OSError):  # the controller is gone, or sends again
            link.socket.sendto(link.answer, link.peer)

    def _to_start(self, mask: npt.NDArray[np.bool_]) -> None:
        position, quat_wxyz = self._start
        self.batch.set_pose(position, quat_wxyz, mask)
        self.batch.set_velocity(rotor_speed=np.zeros((self.batch.num_drones, self.batch.num_rotors)), mask=mask)


def _opened(address: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setblocking(False)
        opened.bind((address, port))
    except OSError as error:
        opened.close()
        raise OSError(error.errno, f"cannot listen on UDP port {port} of {address!r}: {error.strerror}") from error
    return opened


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``ardupilot``."""
    parser.add_argument("recipe", nargs="?", type=Path, metavar="RECIPE", help="JSON file of a recipe to fly")
    parser.add_argument("--world", help="name or file of the world; default: the recipe's, or playground/train-1")
    parser.add_argument("--drone", help="name or file of the airframe; default: the recipe's, or x500")
    parser.add_argument("--drones", type=int, help="number of drones, each with a port; default: the recipe's, or 1")
    text = "ticks per second, a multiple of ArduPilot's SIM_RATE_HZ; default: the recipe's, or 1200"
    parser.add_argument("--physics-hz", type=float, help=text)
    text = "where drones start; default: on the ground below the world's start marker"
    parser.add_argument("--start", type=float, nargs=3, metavar=("X", "Y", "Z"), help=text)
    parser.add_argument("--address", default="127.0.0.1", help="IPv4 address to listen on; default: %(default)s")
    parser.add_argument("--port", type=int, default=9002, help="UDP port of the first drone; default: %(default)s")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    try:
        batch = _batch_of(arguments)
        bridge = ArduPilotBridge(batch, address=arguments.address, port=arguments.port)
    except (OSError, ValueError) as error:
        raise SystemExit(f"flockstep ardupilot: {error}") from error
    with bridge:
        ports = ", ".join(map(str, bridge.ports))
        print(
            f"{batch.num_drones} x {batch.drone.name} in {batch.world_of(0).name}, {batch.clock.physics_hz:g} Hz; "
            f"waiting for ArduPilot on UDP port {ports} of {arguments.address}. Ctrl-C ends.",
            flush=True,
        )
        try:
            bridge.serve()
        except KeyboardInterrupt:
            for port, counts in zip(bridge.ports, bridge.counts, strict=True):
                print(f"\nport {port}: {counts}")


def _batch_of(arguments: argparse.Namespace) -> Batch:
    """Return the batch that the arguments of the command describe, with the drones at their start."""
    if arguments.recipe is None:
        recipe = Recipe()
        recipe.worlds, recipe.drone, recipe.num_envs = ["playground/train-1"], "x500", 1
    else:
        recipe = Recipe.from_json(arguments.recipe.read_text(encoding="utf-8"))
        recipe.task = None
    if arguments.world is not None:
        recipe.worlds = [arguments.world]
    if arguments.drone is not None:
        recipe.drone = arguments.drone
    if arguments.drones is not None:
        recipe.num_envs, recipe.drones_per_env = arguments.drones, 1
    clock, dynamics = recipe.clock, recipe.dynamics  # copies
    if arguments.physics_hz is not None or arguments.recipe is None:
        clock.physics_hz = arguments.physics_hz or 1200.0
    dynamics.motion = "rotors"
    if dynamics.control != "rotor_thrusts":
        dynamics.control = "rotor_speeds"
    if dynamics.on_contact == "terminate":
        dynamics.on_contact = "stop"
    recipe.clock, recipe.dynamics = clock, dynamics
    batch = Batch.from_recipe(recipe, allow_files=True)
    starts = [arguments.start or _ground_start(batch.world_of(i), batch.drone) for i in range(batch.num_drones)]
    apart = 2 * float(np.ptp(batch.drone.hull[:, 1]))  # the drones of an env stand side by side
    batch.set_pose(starts + np.outer(np.arange(batch.num_drones) % batch.drones_per_env, [0, apart, 0]))
    return batch


def _ground_start(world: World, drone: DroneModel) -> list[float]:
    """Return a place on the ground below the start marker, or below the middle of a world without one."""
    low, high = world.bounds.astype(float)
    above = (low + high) / 2 if world.start is None else world.start.astype(float)
    drop = float(world.raycast([above], [[0, 0, -1]], float(high[2] - low[2]) + 1)["t_hit"][0])
    if not np.isfinite(drop):
        raise ValueError(f"start: expected ground below {above.tolist()} in {world.name}, got none: give --start X Y Z")
    return [float(above[0]), float(above[1]), float(above[2]) - drop - float(drone.hull[:, 2].min()) + 2e-3]
