"""Stretches of a log in which a drone flies, sampled uniformly."""

from __future__ import annotations

import re
from collections.abc import Iterable
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flockstep.identification.columns import (
    ACCELERATION,
    ACCELEROMETER,
    ATTITUDE,
    GYRO,
    POSITION,
    VELOCITY,
    rotors_of,
)
from flockstep.identification.reading import Table, read_table

Array = npt.NDArray[np.float64]

GRAVITY = 9.81
#: Voltage of a full LiPo cell: duties act times the battery's voltage over this one.
FULL_V = 4.2
#: Take-off and landing, where the ground carries a part of the weight, are left out.
_EDGE_S = 1.0
#: Motors that stop for longer end a flight, as does a gap between samples.
_PAUSE_S, _GAP_S = 0.5, 0.1
_LEAST_S = 2.0
_LEAST_HZ, _MOST_SAMPLES = 50.0, 10_000_000
#: Of the sum of the commands, below which motors count as stopped.
_STOPPED = 0.02


class Flight(NamedTuple):
    """A flight of n samples at uniform times. What its log lacks is None."""

    name: str
    time_s: Array
    dt_s: float
    #: Samples from the start of the motors that are in free flight; those before only set the rotors' speeds.
    free: slice
    #: (n, rotors), from 0 to 1, each held until the next sample.
    command: Array
    #: (n, 3) rad/s.
    gyro: Array | None
    #: (n, 3) m/s² along the body's axes. From estimates in the world frame only the third column is known.
    specific_force: Array
    #: (n, 3) m, m/s and rad (roll, pitch, yaw).
    position: Array | None
    velocity: Array | None
    attitude: Array | None
    #: The log has no gyroscope, or no pitch: rates are slopes of angles, the pitch is that of the force.
    is_estimated: bool

    @property
    def duration_s(self) -> float:
        """Time in free flight."""
        return float((self.free.stop - self.free.start) * self.dt_s)


def read_flights(paths: Iterable[str | PathLike[str]], rotors: int = 4) -> list[Flight]:
    """Return the flights of some logs, each of which may end with a span of seconds of its clock: ``log@35-65``.

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        A file is not a log, or has no flight of two seconds. The message names the file and the column.
    """
    flights = []
    for given in paths:
        path = fspath(given)
        span = re.fullmatch(r"(.+)@(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)", path)
        first, last = (float(span[2]), float(span[3])) if span else (-np.inf, np.inf)
        found = flights_of(read_table(span[1] if span else path), rotors, first, last)
        flights += [flight._replace(name=f"{Path(path).name}, flight {k + 1}") for k, flight in enumerate(found)]
    return flights


def flights_of(table: Table, rotors: int, first_s: float = -np.inf, last_s: float = np.inf) -> list[Flight]:
    """Return the flights of a table that last two seconds or longer, within a span of its clock."""
    path, columns = table
    time_s = columns["time_s"]
    kind = "motor" if rotors_of(set(columns), "motor") else "duty"
    given = rotors_of(set(columns), kind)
    if given != rotors:
        raise ValueError(f"{path}: {kind}_1 to {kind}_{rotors}: expected {rotors} rotors, got {given}")
    steps = np.diff(time_s)
    if time_s.size < 2 or time_s[-1] - time_s[0] < _LEAST_S:
        raise ValueError(
            f"{path}: time_s: expected at least {_LEAST_S:g} s, got {np.ptp(time_s) if time_s.size else 0:.3g}"
        )
    dt_s = float(np.median(steps))
    if dt_s > 1 / _LEAST_HZ:
        raise ValueError(f"{path}: time_s: expected at least {_LEAST_HZ:g} samples a second, got {1 / dt_s:.3g}")
    command = np.stack([columns[f"{kind}_{k + 1}"] for k in range(rotors)], axis=1)
    for k, moving in enumerate(np.ptp(command, axis=0) > 0):
        if not moving:
            raise ValueError(f"{path}: {kind}_{k + 1}: expected a command that changes, got {command[0, k]:g} always")
    if kind == "duty":
        if "battery_v" not in columns:
            raise ValueError(f"{path}: battery_v: expected this column beside duties, got none")
        command *= columns["battery_v"][:, None] / FULL_V
    flights = []
    for start, stop in _stretches(time_s, command.sum(axis=1) > _STOPPED):
        samples = (time_s[stop - 1] - time_s[start]) / dt_s
        if samples > _MOST_SAMPLES:
            raise ValueError(f"{path}: time_s: expected even times, at most {_MOST_SAMPLES}, got {samples:.3g}")
        grid = np.arange(time_s[start], time_s[stop - 1], dt_s)
        inside = (grid >= max(first_s, grid[0] + _EDGE_S)) & (grid <= min(last_s, grid[-1] - _EDGE_S))
        free = np.flatnonzero(inside)
        if free.size * dt_s >= _LEAST_S:
            whole = slice(int(free[0]), int(free[-1]) + 1)
            flights.append(_flight(path, time_s, dt_s, grid, whole, columns, command))
    if not flights:
        raise ValueError(f"{path}: expected a flight of {_LEAST_S:g} s beside take-off and landing, got none")
    return flights


def _stretches(time_s: Array, runs: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last of the samples in which the motors run, with pauses but without gaps."""
    on = np.flatnonzero(runs)
    gaps = np.diff(time_s) > _GAP_S
    found: list[tuple[int, int]] = []
    for k in on:
        last = found[-1] if found else None
        if last and time_s[k] - time_s[last[1] - 1] <= _PAUSE_S and not gaps[last[1] - 1 : k].any():
            found[-1] = (last[0], int(k) + 1)
        else:
            found.append((int(k), int(k) + 1))
    return [stretch for stretch in found if stretch[1] - stretch[0] > 1]


def _flight(
    path: str, time_s: Array, dt_s: float, grid: Array, free: slice, columns: dict[str, Array], command: Array
) -> Flight:
    """Return a flight: commands held between their samples, measurements on lines between theirs."""

    def measured(names: list[str]) -> Array | None:
        if not columns.keys() >= set(names):
            return None
        values = [np.unwrap(columns[n]) if n in ATTITUDE else columns[n] for n in names]
        return np.stack([np.interp(grid, time_s, value) for value in values], axis=1)

    held = command[np.searchsorted(time_s, grid + 0.01 * dt_s, side="right") - 1]  # times on the grid are rounded
    attitude, gyro = measured(ATTITUDE), measured(GYRO)
    acceleration = measured(ACCELERATION)
    force = measured(ACCELEROMETER)
    if force is None and ACCELEROMETER[2] in columns:
        force = np.full((grid.size, 3), np.nan)
        force[:, 2] = np.interp(grid, time_s, columns[ACCELEROMETER[2]])
    if force is None and acceleration is not None:
        world = acceleration + np.array([0, 0, GRAVITY])
        force = np.full((grid.size, 3), np.nan)
        force[:, 2] = np.linalg.norm(world, axis=1)  # nearly all of it is the rotors'
        yaw = measured(["yaw_rad"])
        roll = measured(["roll_rad"])
        if attitude is None and yaw is not None and roll is not None:
            attitude = np.concatenate([roll, _pitch_of(world, yaw)[:, None], yaw], axis=1)
    if force is None:
        raise ValueError(f"{path}: {ACCELERATION[0]}: expected all three axes, got {', '.join(sorted(columns))}")
    is_estimated = gyro is None or (attitude is not None and "pitch_rad" not in columns)
    if gyro is None and attitude is not None:
        gyro = _rates_of(attitude, dt_s)
    moved = measured(POSITION), measured(VELOCITY)
    return Flight(path, grid, dt_s, free, held, gyro, force, *moved, attitude, is_estimated)


def _pitch_of(force: Array, yaw: Array) -> Array:
    """Return the pitch at which the body's z axis points along a force in the world frame, at small angles of roll."""
    forward = np.cos(yaw[:, 0]) * force[:, 0] + np.sin(yaw[:, 0]) * force[:, 1]
    return np.arctan2(forward, force[:, 2])


def _rates_of(attitude: Array, dt_s: float) -> Array:
    """Return the body rates of a turning attitude: roll, pitch, yaw with R = Rz Ry Rx."""
    roll, pitch, _ = attitude.T
    d_roll, d_pitch, d_yaw = np.gradient(attitude, dt_s, axis=0).T
    return np.stack(
        [
            d_roll - np.sin(pitch) * d_yaw,
            np.cos(roll) * d_pitch + np.sin(roll) * np.cos(pitch) * d_yaw,
            -np.sin(roll) * d_pitch + np.cos(roll) * np.cos(pitch) * d_yaw,
        ],
        axis=1,
    )
