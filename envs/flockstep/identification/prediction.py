"""Flies logged commands open loop in the engine, and measures how far the flight is from the logged one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, ClockConfig, DroneModel, DynamicsConfig, World
from flockstep.identification.fit import Fit
from flockstep.identification.flights import Flight
from flockstep.identification.model import delayed, frame_of, lagged
from flockstep.rotations import quat_from_rpy, rpy_from_quat

Array = npt.NDArray[np.float64]

#: Speeds in rad/s that rotors should turn at, by their commands.
Map = Callable[[Array], Array]

#: Before each segment, where attitudes and rates that the log lacks are fitted; and time from segment to segment.
_BEFORE_S, _EVERY_S = 0.3, 0.25
#: Over which the gyroscope's noise is averaged.
_GYRO_S = 0.01
_TICK_S, _MOST_S = 1e-3, 10.0
_HALF_ROOM_M = 1e4


class Errors(NamedTuple):
    """Root mean squares over all segments and axes, by quantity and by horizon in s."""

    segments: int
    #: Quantity ("rates"; or "velocity", "climb", "position", "roll", "yaw"): horizon: error in rad/s, m/s, m or rad.
    of_model: dict[str, dict[float, float]]
    #: The same for a guess: rates or velocity stay as they are at the start, angles keep their rates.
    of_guess: dict[str, dict[float, float]]


def linear_map(drone: DroneModel, fit: Fit | None = None) -> Map:
    """Return the map of the model that is fitted: speeds grow with commands, and maybe differ from motor to motor."""
    fastest = drone.to_dict()["rotors"]["max_speed_radps"]
    if fit is None:
        return lambda command: np.asarray(command * fastest)
    p = fit.parameters
    gains = 1 + frame_of(drone).modes @ np.array([p.trim_roll, p.trim_pitch, p.trim_yaw])
    return lambda command: np.asarray(command * gains * fastest)


def thrust_map(drone: DroneModel, scale: float = 1.0) -> Map:
    """Return the map that a Crazyflie's firmware intends: thrusts grow with commands, up to the largest thrust."""
    c0, c1, c2 = drone.to_dict()["rotors"]["thrust_n"]

    def speed(command: Array) -> Array:
        thrust = np.clip(command, 0, 1) * scale * drone.max_thrust_n
        root = np.sqrt(np.maximum(c1 * c1 - 4 * c2 * (c0 - thrust), 0))
        return np.asarray((root - c1) / (2 * c2) if c2 else (thrust - c0) / c1)

    return speed


def predict(
    flights: Sequence[Flight],
    drone: DroneModel,
    to_speed: Map,
    horizons_s: Sequence[float],
    *,
    delay_s: float = 0.0,
    trim_s: float = 0.0,
) -> Errors:
    """Fly the commands of segments of flights, and compare with the logs after each horizon.

    All segments fly at once. Each begins with the logged state; pitch and rates that were not measured are lines
    through the last 0.3 s. A flight without velocities compares body rates only.

    Parameters
    ----------
    flights
        Flights, all with the same columns.
    drone
        The drone that flies, with its own lag.
    to_speed
        Makes rotor speeds of logged commands.
    horizons_s
        Times after the start of a segment.
    delay_s
        By how much commands come later than the log says.
    trim_s
        Time before each segment over which the mean torque is set to zero, as it is in calm flight, by gains of the
        motors. 0: they stay as they are.
    """
    horizons = sorted(horizons_s)
    if not horizons:
        raise ValueError("horizons_s: expected at least one time, got none")
    for horizon in horizons:
        if not _TICK_S <= horizon <= _MOST_S:
            raise ValueError(f"horizons_s: expected times in [{_TICK_S:g}, {_MOST_S:g}], got {horizon!r}")
    steps = [round(horizon / _TICK_S) for horizon in horizons]
    kinds = {all(each is not None for each in (f.position, f.velocity, f.attitude)) for f in flights}
    if len(kinds) > 1:
        raise ValueError("flights: expected positions, velocities and attitudes of all or none, got some")
    moves = True in kinds
    for name, value in (("delay_s", delay_s), ("trim_s", trim_s)):
        if not 0 <= value <= _MOST_S:
            raise ValueError(f"{name}: expected a time in [0, {_MOST_S:g}], got {value!r}")
    starts = [(flight, k) for flight in flights for k in _starts(flight, horizons[-1], max(trim_s, _BEFORE_S))]
    if not starts:
        raise ValueError(f"flights: expected one in the air for {horizons[-1] + max(trim_s, _BEFORE_S):g} s, got none")
    command = np.stack([_commands(flight, k, steps[-1], to_speed, delay_s) for flight, k in starts])
    state = [_start(flight, k) for flight, k in starts]
    attitude, rates = (np.stack([each[k] for each in state]) for k in (0, 1))
    position = np.stack([f.position[k] if f.position is not None else np.zeros(3) for f, k in starts])
    velocity = np.stack([f.velocity[k] if f.velocity is not None else np.zeros(3) for f, k in starts])
    speeds = _rotor_speeds(drone, starts, to_speed, delay_s)
    if trim_s:
        gains = np.stack([_trim(drone, to_speed(f.command[k - round(trim_s / f.dt_s) : k])) for f, k in starts])
        command, speeds = command * gains[:, None], speeds * gains
    flown = _fly(drone, command, steps, position, attitude, velocity, rates, speeds)

    model: dict[str, dict[float, float]] = {}
    guess: dict[str, dict[float, float]] = {}

    def note(quantity: str, horizon: float, log: Array, of_model: Array, of_guess: Array) -> None:
        for errors, value in ((model, of_model), (guess, of_guess)):
            off = value - log
            if quantity in ("roll", "yaw"):
                off = (off + np.pi) % (2 * np.pi) - np.pi
            errors.setdefault(quantity, {})[horizon] = float(np.sqrt(np.mean(off**2)))

    for horizon, step in zip(horizons, steps, strict=True):
        p, q, v, w = flown[step]
        ends = [(flight, k + round(horizon / flight.dt_s)) for flight, k in starts]
        if not moves:
            note("rates", horizon, np.stack([f.gyro[k] for f, k in ends if f.gyro is not None]), w, rates)
            continue
        moved = np.stack([f.velocity[k] for f, k in ends if f.velocity is not None])
        note("velocity", horizon, moved, v, velocity)
        note("climb", horizon, moved[:, 2], v[:, 2], velocity[:, 2])
        truth = np.stack([f.position[k] for f, k in ends if f.position is not None])
        note("position", horizon, truth, p, position + velocity * horizon)
        angles = np.stack([f.attitude[k] for f, k in ends if f.attitude is not None])
        turned = rpy_from_quat(q)
        for axis, quantity in ((0, "roll"), (2, "yaw")):
            kept = attitude[:, axis] + rates[:, axis] * horizon
            note(quantity, horizon, angles[:, axis], turned[:, axis], kept)
    return Errors(len(starts), model, guess)


def _trim(drone: DroneModel, speeds: Array) -> Array:
    """Return gains of the motors with which the mean of some speeds (n, rotors) gives no torque."""
    frame, (c0, c1, c2) = frame_of(drone), drone.to_dict()["rotors"]["thrust_n"]
    mean = speeds.mean(axis=0)
    torques = np.stack([frame.position[:, 1], -frame.position[:, 0], -frame.spins])
    gains = np.ones_like(mean)
    for _ in range(4):
        speed = mean * gains
        slope = torques * ((c1 + 2 * c2 * speed) * mean)
        gains = gains - frame.modes @ np.linalg.solve(slope @ frame.modes, torques @ (c0 + c1 * speed + c2 * speed**2))
    return np.asarray(gains)


def _starts(flight: Flight, longest_s: float, earliest_s: float) -> range:
    """Return the samples at which segments begin."""
    before, after = round(earliest_s / flight.dt_s), round(longest_s / flight.dt_s) + 1
    return range(flight.free.start + before, flight.free.stop - after, max(round(_EVERY_S / flight.dt_s), 1))


def _start(flight: Flight, k: int) -> tuple[Array, Array]:
    """Return roll, pitch, yaw and body rates at a sample, from it and the samples before."""
    if not flight.is_estimated and flight.gyro is not None:
        few = max(round(_GYRO_S / flight.dt_s), 1)
        level = np.zeros(3) if flight.attitude is None else flight.attitude[k]
        return level, flight.gyro[k - few + 1 : k + 1].mean(axis=0)
    if flight.attitude is None:
        raise ValueError(f"{flight.name}: gyro_x_radps: expected this column, or angles, got none")
    span = slice(k - round(_BEFORE_S / flight.dt_s), k + 1)
    time = flight.time_s[span] - flight.time_s[k]
    slope, now = np.polyfit(time, flight.attitude[span], 1)
    return np.array([flight.attitude[k, 0], now[1], flight.attitude[k, 2]]), slope


def _commands(flight: Flight, k: int, steps: int, to_speed: Map, delay_s: float) -> Array:
    """Return the rotor speeds that are commanded in each tick after a sample."""
    time = flight.time_s[k] + (np.arange(steps) + 0.5) * _TICK_S - delay_s
    held = np.searchsorted(flight.time_s, time, side="right") - 1
    return to_speed(flight.command[np.maximum(held, 0)])


def _rotor_speeds(drone: DroneModel, starts: list[tuple[Flight, int]], to_speed: Map, delay_s: float) -> Array:
    """Return the speeds of the rotors at the start of each segment, behind the drone's own lag."""
    rotors = drone.to_dict()["rotors"]
    lag_s = (rotors["lag_up_s"] + rotors["lag_down_s"]) / 2
    low, high = rotors["min_speed_radps"], rotors["max_speed_radps"]
    by_flight: dict[int, Array] = {}
    for flight, _ in starts:
        if id(flight) not in by_flight:
            target = np.clip(to_speed(flight.command), low, high)
            by_flight[id(flight)] = delayed(lagged(target, flight.dt_s, lag_s), flight.dt_s, delay_s)
    return np.stack([by_flight[id(flight)][k] for flight, k in starts])


def _fly(
    drone: DroneModel,
    command: Array,
    steps: list[int],
    position: Array,
    attitude: Array,
    velocity: Array,
    rates: Array,
    speeds: Array,
) -> dict[int, list[Array]]:
    """Return position, attitude, velocity and body rates after some ticks of commands (segments, ticks, rotors)."""
    room = {"min": [-_HALF_ROOM_M] * 3, "max": [_HALF_ROOM_M] * 3}
    batch = Batch(
        [World.from_dict({"flockstep_scene": 1, "name": "open", "room": room})],
        len(command),
        drone=drone,
        dynamics=DynamicsConfig(motion="rotors", control="rotor_speeds", on_contact="stop"),
        clock=ClockConfig(policy_hz=1 / _TICK_S, physics_hz=1 / _TICK_S),
    )
    batch.set_pose(position, quat_from_rpy(attitude))
    batch.set_velocity(velocity, rates, speeds)
    found = {}
    for tick in range(steps[-1]):
        batch.fly(command[:, tick])
        if tick + 1 in steps:
            state = (batch.position, batch.quat_wxyz, batch.velocity, batch.angular_velocity)
            found[tick + 1] = [np.array(each, float) for each in state]
    return found
