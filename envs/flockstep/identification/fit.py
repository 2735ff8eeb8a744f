"""Fits the flight model to logs, with confidence intervals, and says what the logs do not determine."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, fields
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel
from flockstep.errors import did_you_mean
from flockstep.identification.flights import GRAVITY, Flight, read_flights
from flockstep.identification.model import Frame, Parameters, channels, frame_of, lagged, parameters_of

Array = npt.NDArray[np.float64]

#: Errors of the model persist for a part of a second, so a block of this length counts as one independent error.
_BLOCK_S = 0.5
#: Half of an interval over its number, above which a number is not determined, and of the thrust over the weight.
_MOST_UNSURE, _MOST_UNSURE_THRUST = 0.3, 0.1
#: Share of a channel's variance that the model must explain, and ratio of the strongest to the weakest thrust, for the
#: channel to have been excited.
_LEAST_EXPLAINED, _LEAST_RANGE = 0.3, 1.2
#: Variance of a parameter without any effect, for which the formula gives 0.
_UNKNOWN = 1e30
_CURVE = ("thrust_0", "thrust_1", "thrust_2")
_BOUNDS = {
    "thrust_scale": (1e-3, 1e3),
    "lag_s": (1e-3, 1.0),
    "delay_s": (0.0, 0.1),
    "inertia_x": (1e-9, 1e3),
    "inertia_y": (1e-9, 1e3),
    "trim_roll": (-0.5, 0.5),
    "trim_pitch": (-0.5, 0.5),
    "trim_yaw": (-0.5, 0.5),
}
#: Numbers that each channel determines, beside the thrust and the lag that all need.
_OF_CHANNEL: dict[str, tuple[str, ...]] = {
    "thrust": (*_CURVE, "lag_s", "delay_s", "drag_z"),
    "roll": ("inertia_x", "trim_roll"),
    "pitch": ("inertia_y", "trim_pitch"),
    "yaw": ("torque_ratio", "spin", "trim_yaw"),
    "drag_x": ("drag_x", "bias_x"),
    "drag_y": ("drag_y", "bias_y"),
}
#: Measurements, beside commands and the force along z, without which a number is not fitted.
_NEEDS = {
    "inertia_x": "rates or angles",
    "inertia_y": "rates or angles",
    "torque_ratio": "rates or angles",
    "spin": "rates or angles",
    "drag_x": "an accelerometer, velocity and all three angles",
    "drag_y": "an accelerometer, velocity and all three angles",
    "drag_z": "velocity and angles",
}
#: Numbers that are fitted even if its interval is wide: small offsets about zero.
_OFFSETS = ("delay_s", "trim_roll", "trim_pitch", "trim_yaw", "bias_x", "bias_y")
_UNITS = {"lag_s": "s", "inertia_x": "m²", "inertia_y": "m²", "torque_ratio": "m", "spin": "m²/s", "thrust_scale": ""}


@dataclass(frozen=True)
class Fit:
    """Numbers of a drone by its logs."""

    #: The drone that the fit began with: it gives rotors, and numbers that are not fitted.
    like: DroneModel
    parameters: Parameters
    #: Half of the 95 % confidence interval of each fitted parameter, by its name.
    half_widths: dict[str, float]
    #: Share of each channel's variance that the model explains.
    r2: dict[str, float]
    #: Thrust of all rotors over the weight at three commands that were flown: command, value, half of its interval.
    thrust: list[tuple[float, float, float]]
    warnings: list[str]
    flights: list[Flight]


def fit(
    logs: Iterable[str | PathLike[str] | Flight],
    like: str | DroneModel = "crazyflie",
    *,
    keep: Collection[str] = (),
) -> Fit:
    """Fit the flight model to logs.

    Parameters
    ----------
    logs
        Paths of logs, each maybe with a span of seconds as in ``"log@35-65"``, or flights.
    like
        A bundled drone, the path of a drone file, or a drone: where its rotors are, and what the logs do not determine.
    keep
        Names of `Parameters` that stay those of ``like``.

    Raises
    ------
    ModuleNotFoundError
        SciPy is not installed.
    OSError
        A file cannot be read.
    ValueError
        A log cannot be used, or all together are too short.
    """
    try:
        import scipy.optimize  # noqa: F401 # below
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "identification needs scipy, which is not installed: pip install scipy matplotlib", name=error.name
        ) from error
    known = [field.name for field in fields(Parameters)]
    for name in keep:
        if name not in known:
            raise ValueError(f"keep: expected names among {', '.join(known)}, got {name!r}{did_you_mean(name, known)}")
    drone = like if isinstance(like, DroneModel) else DroneModel.load(like)
    if "mass_kg" not in drone.to_dict():
        raise ValueError(f"like: expected a drone with an airframe, got {drone!r}")
    given = list(logs)
    flights = [each for each in given if isinstance(each, Flight)]
    flights += read_flights([each for each in given if not isinstance(each, Flight)], drone.num_rotors)
    if not flights:
        raise ValueError("logs: expected at least one log, got none")
    parameters = parameters_of(drone)
    problem = _Problem(flights, frame_of(drone), parameters)
    names = [name for name in problem.names() if name not in keep]
    warnings = [_lack(name, needs, drone) for name, needs in _NEEDS.items() if name not in (*problem.names(), *keep)]
    if problem.blocks < 2 * len(names):
        raise ValueError(
            f"logs: expected at least {len(names) * 2 * _BLOCK_S:g} s of flight beside take-off and landing, "
            f"got {sum(flight.duration_s for flight in flights):.1f}"
        )
    while True:
        if not names:
            raise ValueError("keep: expected at least one number that the logs determine, got none")
        fitted, covariance, quantile = problem.solve(parameters, names)
        halves = dict(zip(names, quantile * np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
        thrust = _thrust_levels(problem, fitted, names, covariance, quantile)
        r2 = problem.explained(fitted)
        unsure = _undetermined(fitted, parameters, halves, thrust, r2)
        if not unsure:
            break
        for name in unsure:
            if name not in _CURVE[1:]:
                warnings.append(_doubt(name, fitted, parameters, halves, r2, drone))
        names = [name for name in names if name not in unsure]
        if set(unsure) & set(_CURVE):
            names.insert(0, "thrust_scale")
        if "lag_s" in unsure and "delay_s" in names:
            names.remove("delay_s")
    return Fit(drone, fitted, halves, r2, thrust, warnings, flights)


class _Problem:
    """Flights, their residuals, and the blocks that these belong to."""

    def __init__(self, flights: Sequence[Flight], frame: Frame, start: Parameters) -> None:
        self.flights, self.frame = flights, frame
        self.has = set(self.compared(start))
        self._scale: dict[str, float] = {}
        self.blocks = sum(max(round(flight.duration_s / _BLOCK_S), 1) for flight in flights)
        self.rotors = frame.position.shape[0]

    def names(self) -> list[str]:
        """Return the parameters that the flights' channels can determine."""
        names = [name for channel, those in _OF_CHANNEL.items() if channel in self.has for name in those]
        has_air = any(flight.velocity is not None and flight.attitude is not None for flight in self.flights)
        return [name for name in names if name != "drag_z" or has_air]

    def _channels(self, flight: Flight, parameters: Parameters) -> dict[str, tuple[Array, Array]]:
        return channels(flight, self.frame, parameters)

    def compared(self, parameters: Parameters) -> dict[str, tuple[Array, Array]]:
        """Return measurement and model of each channel over all flights."""
        parts: dict[str, list[tuple[Array, Array]]] = {}
        for flight in self.flights:
            for name, pair in self._channels(flight, parameters).items():
                parts.setdefault(name, []).append(pair)
        return {
            name: (np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs]))
            for name, pairs in parts.items()
        }

    def explained(self, parameters: Parameters) -> dict[str, float]:
        """Return R² of each channel."""
        return {
            name: float(1 - np.sum((told - model) ** 2) / max(np.sum((told - told.mean()) ** 2), 1e-300))
            for name, (told, model) in self.compared(parameters).items()
        }

    def _residuals(self, parameters: Parameters, used: set[str]) -> Array:
        found = [
            (model - told) / self._scale[name]
            for flight in self.flights
            for name, (told, model) in self._channels(flight, parameters).items()
            if name in used
        ]
        return np.concatenate(found)

    def _block_of(self, parameters: Parameters, used: set[str]) -> npt.NDArray[np.int64]:
        """Return the number of the block of each residual."""
        found, first = [], 0
        for flight in self.flights:
            count = max(round(flight.duration_s / _BLOCK_S), 1)
            for name, (told, _) in self._channels(flight, parameters).items():
                if name in used:
                    found.append(first + np.arange(told.size) * count // told.size)
            first += count
        return np.concatenate(found)

    def solve(self, start: Parameters, names: list[str]) -> tuple[Parameters, Array, float]:
        """Return the best parameters, the covariance of those named, and the factor of a 95 % interval.

        Channels are weighted by their own errors, which a first solution finds. The covariance is the sandwich of
        blocks: errors within a block may be equal, those of different blocks are taken as independent.
        """
        from scipy.optimize import least_squares
        from scipy.stats import t as student

        used = {channel for channel in self.has if set(_OF_CHANNEL[channel]) & set(names) or channel == "thrust"}
        low, high = (np.array([_BOUNDS.get(name, (-np.inf, np.inf))[side] for name in names]) for side in (0, 1))
        found = np.array([_start(name, getattr(start, name)) for name in names])
        unit = np.maximum(np.abs(found), [_typical(name) for name in names])
        best = start
        for is_first in (True, False):
            self._scale = {
                name: max(float(np.std(told if is_first else told - model)), 1e-6 * float(np.std(told)), 1e-12)
                for name, (told, model) in self.compared(best).items()
            }
            solution: Any = least_squares(
                lambda z: self._residuals(start.changed(names, z * unit), used),
                np.clip(found / unit, low / unit + 1e-9, high / unit - 1e-9),
                bounds=(low / unit, high / unit),
                diff_step=1e-5,
                x_scale="jac",
                max_nfev=40,
            )
            found = solution.x * unit
            best = start.changed(names, found)
        slope, block = solution.jac, self._block_of(best, used)
        score = np.zeros((self.blocks, len(names)))
        np.add.at(score, block, slope * solution.fun[:, None])
        bread = np.linalg.pinv(slope.T @ slope)
        free = max(self.blocks - len(names), 1)
        covariance = bread @ (score.T @ score) @ bread * (self.blocks / free) * np.outer(unit, unit)
        covariance[np.diag_indices(len(names))] += np.where(np.abs(slope).max(axis=0) < 1e-9, _UNKNOWN, 0.0)
        return best, covariance, float(student.ppf(0.975, free))


def _start(name: str, value: float) -> float:
    """Return a value to start from, within the bounds."""
    low, high = _BOUNDS.get(name, (-np.inf, np.inf))
    return float(np.clip(value if name != "delay_s" else 0.005, low, high))


def _typical(name: str) -> float:
    """Return a small but not negligible size of a parameter, the unit of one that begins at zero."""
    sizes = {"thrust_": 1.0, "lag": 0.01, "delay": 0.01, "inertia": 1e-5, "torque": 1e-3, "spin": 1e-4}
    return next((size for begin, size in sizes.items() if name.startswith(begin)), 0.1)


def _thrust_levels(
    problem: _Problem, p: Parameters, names: list[str], covariance: Array, quantile: float
) -> list[tuple[float, float, float]]:
    """Return total thrust over weight at a low, a middle and a high command that were flown."""
    flown = np.concatenate([lagged(f.command, f.dt_s, p.lag_s)[f.free].mean(axis=1) for f in problem.flights])
    levels = []
    for x in np.quantile(flown, [0.02, 0.5, 0.98]):
        curve = np.array([1.0, x, x * x])
        slope = {f"thrust_{k}": p.thrust_scale * curve[k] for k in range(3)}
        slope["thrust_scale"] = float(curve @ [p.thrust_0, p.thrust_1, p.thrust_2])
        row = np.array([slope.get(name, 0.0) for name in names]) * problem.rotors / GRAVITY
        half = quantile * float(np.sqrt(max(row @ covariance @ row, 0.0)))
        levels.append((float(x), float(p.thrust(x)) * problem.rotors / GRAVITY, half))
    return levels


def _undetermined(
    fitted: Parameters,
    before: Parameters,
    halves: dict[str, float],
    thrust: list[tuple[float, float, float]],
    r2: dict[str, float],
) -> list[str]:
    """Return the fitted parameters that the logs do not determine."""
    still = {name for channel, share in r2.items() if share < _LEAST_EXPLAINED for name in _OF_CHANNEL[channel]}
    names = [name for name in halves if name not in (*_CURVE, *_OFFSETS, "thrust_scale")]
    unsure = [
        name
        for name in names
        if name in still
        or not halves[name] <= _MOST_UNSURE * max(abs(getattr(fitted, name)), abs(getattr(before, name)))
    ]
    (_, low, _), (_, high, _) = thrust[0], thrust[-1]
    is_sure = max(half for *_, half in thrust) <= _MOST_UNSURE_THRUST and high >= _LEAST_RANGE * low
    if "thrust_2" in halves and ("thrust_0" in still or not is_sure):
        unsure += _CURVE
    return unsure


def _lack(name: str, needs: str, like: DroneModel) -> str:
    """Return the warning about a parameter whose measurements no log has."""
    return f"{name}: not determined (no log has {needs}). Kept from {like.name or 'like'}"


def _doubt(
    name: str, fitted: Parameters, before: Parameters, halves: dict[str, float], r2: dict[str, float], like: DroneModel
) -> str:
    """Return the warning about a parameter that is not determined."""
    channel = next((channel for channel, those in _OF_CHANNEL.items() if name in those), "thrust")
    value, half, unit = getattr(fitted, name), halves[name], _UNITS.get(name, "")
    why = f"{value:.3g} ± {half:.2g} {unit}".rstrip()
    source = like.name or "like"
    if name in _CURVE:
        return f"thrust curve: too small a range of thrust was flown. Scaled from {source}"
    if r2[channel] < _LEAST_EXPLAINED:
        why = f"{channel} was hardly excited: the model explains {100 * max(r2[channel], 0):.0f} % of its variance"
    return f"{name}: not determined ({why}). Kept from {source}: {getattr(before, name):.3g} {unit}".rstrip()
