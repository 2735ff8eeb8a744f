"""The flight model that is fitted: what gyroscope and accelerometer should measure under the logged commands.

Everything is divided by the mass, which a log in free flight cannot tell. The equations are those of
docs/concepts/flight-model.md, in which the speed of rotor i is its command, delayed and behind a lag, times the fastest
speed and a gain g_i of this one motor:

    x_i' = (g_i u_i(t - delay) - x_i) / lag,     F_i / m = max(a0 + a1 x_i + a2 x_i^2, 0)

The angular acceleration is not measured but the slope of the gyroscope in a short window. Its expectation is the true
angular acceleration under a parabolic window, which is applied to the model, and likewise to both sides of forces: so
the window shortens no motion on one side only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel
from flockstep.identification.flights import Flight

Array = npt.NDArray[np.float64]

#: Length of the window, and its fewest samples.
_WINDOW_S, _WINDOW_SAMPLES = 0.06, 7


@dataclass(frozen=True)
class Parameters:
    """The numbers of the model, with the drone that gives those that are not fitted."""

    #: a0, a1, a2 in m/s²; `thrust_scale` multiplies all three.
    thrust_0: float
    thrust_1: float
    thrust_2: float
    thrust_scale: float
    lag_s: float
    #: From the command to its effect in the log, the sensor's own filter included.
    delay_s: float
    #: Moments of inertia over mass, m².
    inertia_x: float
    inertia_y: float
    #: Torque over thrust, m.
    torque_ratio: float
    #: Angular momentum of one rotor at command 1 over mass, m²/s.
    spin: float
    #: Shares by which motors are stronger on the left, at the rear, and if they turn clockwise.
    trim_roll: float
    trim_pitch: float
    trim_yaw: float
    #: Linear drag over mass, 1/s.
    drag_x: float
    drag_y: float
    drag_z: float
    #: Offsets of the accelerometer, m/s².
    bias_x: float
    bias_y: float

    def changed(self, names: list[str], values: Array) -> Parameters:
        """Return a copy with other values of some parameters."""
        return replace(self, **dict(zip(names, map(float, values), strict=True)))

    def thrust(self, x: Array) -> Array:
        """Return the thrust of rotors over the drone's mass, m/s², at lagged commands."""
        curve = self.thrust_0 + self.thrust_1 * x + self.thrust_2 * x * x
        return np.maximum(self.thrust_scale * curve, 0.0)


@dataclass(frozen=True)
class Frame:
    """What the model takes from a drone: rotors, and inertia about z by the sum of the two others."""

    position: Array
    spins: Array
    inertia_z_ratio: float
    #: Modes of trim: by how much of `trim_roll`, `trim_pitch` and `trim_yaw` each rotor is stronger, (rotors, 3).
    modes: Array


def frame_of(drone: DroneModel) -> Frame:
    """Return the frame of a drone."""
    data = drone.to_dict()
    position = np.array(data["rotors"]["position_m"])
    spins = np.where(np.array(data["rotors"]["spin"]) == "ccw", 1.0, -1.0)
    x, y, z = data["inertia_kgm2"]
    modes = np.stack([position[:, 1], -position[:, 0], -spins], axis=1)
    return Frame(position, spins, z / (x + y), modes / np.abs(modes).max(axis=0))


def parameters_of(drone: DroneModel) -> Parameters:
    """Return a drone's own numbers."""
    data = drone.to_dict()
    mass, rotors, drag = data["mass_kg"], data["rotors"], data["drag"]
    fastest = rotors["max_speed_radps"]
    c0, c1, c2 = rotors["thrust_n"]
    x, y, _ = data["inertia_kgm2"]
    return Parameters(
        thrust_0=c0 / mass,
        thrust_1=c1 * fastest / mass,
        thrust_2=c2 * fastest**2 / mass,
        thrust_scale=1.0,
        lag_s=(rotors["lag_up_s"] + rotors["lag_down_s"]) / 2,
        delay_s=0.0,
        inertia_x=x / mass,
        inertia_y=y / mass,
        torque_ratio=rotors["torque_ratio_m"],
        spin=rotors["inertia_kgm2"] * fastest / mass,
        trim_roll=0.0,
        trim_pitch=0.0,
        trim_yaw=0.0,
        drag_x=drag["linear_n_per_mps"][0] / mass,
        drag_y=drag["linear_n_per_mps"][1] / mass,
        drag_z=drag["linear_n_per_mps"][2] / mass,
        bias_x=0.0,
        bias_y=0.0,
    )


def lagged(command: Array, dt_s: float, lag_s: float) -> Array:
    """Return commands behind a first-order lag, exactly for commands that are held between samples."""
    from scipy.signal import lfilter

    if lag_s <= 0:
        return command
    keep = math.exp(-dt_s / lag_s)
    start = command[:1]
    followed, _ = lfilter([0.0, 1 - keep], [1.0, -keep], command - start, axis=0, zi=np.zeros_like(start))
    return np.asarray(followed + start)


def delayed(values: Array, dt_s: float, delay_s: float) -> Array:
    """Return values as they were some time, maybe a part of a sample, before."""
    if delay_s == 0:
        return values
    whole = math.floor(delay_s / dt_s)
    part = delay_s / dt_s - whole
    late = values[np.maximum(np.arange(len(values)) - whole, 0)]
    later = values[np.maximum(np.arange(len(values)) - whole - 1, 0)]
    return np.asarray((1 - part) * late + part * later)


class Windows:
    """The window for samples of some period: slopes, and means whose expectation is the same."""

    def __init__(self, dt_s: float) -> None:
        self.samples = max(_WINDOW_SAMPLES, 2 * round(_WINDOW_S / dt_s / 2) + 1)
        line = np.arange(self.samples) - (self.samples - 1) / 2
        self._slope = line / (line @ line) / dt_s
        parabola = -np.cumsum(line)[:-1]
        # The slope of a line through sums of rates is this mean of the rates, which begin half a sample before.
        self._mean = parabola / parabola.sum()

    def slopes(self, values: Array) -> Array:
        """Return the slope of the line through each window, along the first axis."""
        return np.stack([np.convolve(column, self._slope[::-1], "valid") for column in values.T], axis=1)

    def means(self, values: Array) -> Array:
        """Return the mean of each window that the slope of an integral has. Values are means up to the next sample."""
        return np.stack([np.convolve(column[:-1], self._mean[::-1], "valid") for column in values.T], axis=1)

    def decimated(self, values: Array) -> Array:
        """Return every value that has something new, two for each window."""
        return np.asarray(values[:: self.samples // 2])


def channels(flight: Flight, frame: Frame, parameters: Parameters) -> dict[str, tuple[Array, Array]]:
    """Return measurement and model of each channel that a flight has, in its free part."""
    p, dt_s = parameters, flight.dt_s
    gains = 1.0 + frame.modes @ np.array([p.trim_roll, p.trim_pitch, p.trim_yaw])
    target = flight.command * gains
    x = delayed(lagged(target, dt_s, p.lag_s), dt_s, p.delay_s)
    part = flight.free
    windows = Windows(dt_s)
    thrust = p.thrust(_midpoints(x))[part]
    measured: dict[str, tuple[Any, Any]] = {}
    lift = thrust.sum(axis=1)
    air = _air(flight)
    if air is not None:
        lift = lift - p.drag_z * air[part, 2]
    # A mean over the window of samples is compared with one of values between samples: half a sample apart.
    force = _midpoints(flight.specific_force)[part]
    measured["thrust"] = (force[:, 2], lift)
    if air is not None and np.isfinite(force).all():
        measured["drag_x"] = (force[:, 0], p.bias_x - p.drag_x * air[part, 0])
        measured["drag_y"] = (force[:, 1], p.bias_y - p.drag_y * air[part, 1])
    result = {name: tuple(windows.means(np.stack(pair, axis=1)).T) for name, pair in measured.items()}
    if flight.gyro is not None:
        rates = flight.gyro
        speed_change = np.diff(x, axis=0, append=x[-1:])[part] / dt_s
        model = _angular_acceleration(frame, p, _midpoints(rates)[part], _midpoints(x)[part], thrust, speed_change)
        slopes, means = windows.slopes(rates[part]), windows.means(model)
        result |= {name: (slopes[:, k], means[:, k]) for k, name in enumerate(("roll", "pitch", "yaw"))}
    return {name: (windows.decimated(a), windows.decimated(b)) for name, (a, b) in result.items()}


def _angular_acceleration(frame: Frame, p: Parameters, rates: Array, x: Array, thrust: Array, change: Array) -> Array:
    """Return the angular acceleration of the model, rad/s²."""
    jx, jy = p.inertia_x, p.inertia_y
    jz = frame.inertia_z_ratio * (jx + jy)
    wx, wy, wz = rates.T
    momentum, reaction = p.spin * (x @ frame.spins), p.spin * (change @ frame.spins)
    return np.stack(
        [
            (thrust @ frame.position[:, 1] - (jz - jy) * wy * wz - wy * momentum) / jx,
            (-(thrust @ frame.position[:, 0]) - (jx - jz) * wz * wx + wx * momentum) / jy,
            (-p.torque_ratio * (thrust @ frame.spins) - (jy - jx) * wx * wy - reaction) / jz,
        ],
        axis=1,
    )


def _midpoints(values: Array) -> Array:
    """Return means of each sample and the next one."""
    return np.asarray((values + np.concatenate([values[1:], values[-1:]])) / 2)


def _air(flight: Flight) -> Array | None:
    """Return the velocity in the body frame at midpoints, if the log tells velocity and attitude."""
    if flight.velocity is None or flight.attitude is None:
        return None
    from flockstep.rotations import quat_from_rpy, rotate

    return _midpoints(np.asarray(rotate(quat_from_rpy(flight.attitude), flight.velocity, inverse=True), float))
