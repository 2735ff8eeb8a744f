"""The flight model beside logs of real Crazyflies: what identification finds, and how well it predicts other flights.

The logs are not in this repository. Their folder, in FLOCKSTEP_REAL_FLIGHTS, has `crazyflie-sysid/log10, log15, log16`
from github.com/arplaboratory/data-driven-system-identification (logs_crazyflie/), and in `crazypad/motor/` the logs
E8_log00 to 03, E9_log00 to 03 and weight_W1_near_M3_E9_log04 from github.com/AerialRoboticsUUST/CrazyPAD.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flockstep import DroneModel
from flockstep.identification import Errors, Fit, Flight, drone_data, fit, linear_map, predict, read_flights, thrust_map
from flockstep.identification.model import parameters_of
from timing import Measured

LAGS_MS = (40, 60, 72, 100, 145)
#: Spans of flights for the fit, and between them others to predict.
FITTED = ("log10", "log15@52-62", "log15@72-82", "log16@30-42")
HELD_OUT = {"roll_pitch": ("log15@62-72", "log15@82-92"), "yaw": ("log16@43-51",)}
RATE_HORIZONS_S = (0.1, 0.2, 0.3, 0.5)
HOVER_HORIZONS_S = (0.1, 0.2, 0.5, 1.0, 2.0)
#: What only the drone file knows if thrust and trim are fitted and nothing else.
ITS_OWN = ("lag_s", "delay_s", "inertia_x", "inertia_y", "torque_ratio", "spin")
SCALES = {"lag_s": 1e3, "delay_s": 1e3, "inertia_x": 1e4, "inertia_y": 1e4, "torque_ratio": 1e3, "spin": 1e4}
UNITS = {"lag_s": "ms", "delay_s": "ms", "inertia_x": "cm²", "inertia_y": "cm²", "torque_ratio": "mm", "spin": "cm²/s"}


def folder(name: str) -> Path:
    """Return a folder of logs, or exit."""
    place = os.environ.get("FLOCKSTEP_REAL_FLIGHTS", "")
    if not place or not (Path(place) / name).is_dir():
        sys.exit(f"reality: set FLOCKSTEP_REAL_FLIGHTS to a folder with {name}/. {' '.join(__doc__.split())}")
    return Path(place) / name


def crazyflie(**rotors: Any) -> DroneModel:
    """Return the bundled Crazyflie with some numbers of its rotors changed."""
    return DroneModel.from_dict({"flockstep_drone": 1, "like": "crazyflie", "rotors": rotors})


def without_gyro(flights: list[Flight]) -> list[Flight]:
    return [flight._replace(gyro=None) for flight in flights]


def made(found: Fit) -> DroneModel:
    return DroneModel.from_dict(drone_data(found))


def tilt(found: Fit) -> float:
    """Return the roll after half a second of a motor that is one percent stronger, in rad."""
    arm = float(np.abs(np.array(found.like.to_dict()["rotors"]["position_m"])[0, 1]))
    return 0.01 * 9.81 / 4 * arm / found.parameters.inertia_x * 0.5**2 / 2


def numbers(logs: Path) -> Iterator[Measured]:
    """Fit all three logs, and the thrust alone."""
    thrust = without_gyro(read_flights([logs / "log10"]))
    for lag_ms in LAGS_MS:
        found = fit(thrust, crazyflie(lag_s=lag_ms / 1e3), keep=["lag_s", "delay_s"])
        yield f"reality/thrust_with_lag/{lag_ms}/r2", found.r2["thrust"], "1", 1
    alone = fit(thrust)
    whole = fit([logs / name for name in ("log10", "log15", "log16")])
    bundled = parameters_of(DroneModel.load("crazyflie"))
    for name, scale in SCALES.items():
        unit = UNITS[name]
        for who, found in (("thrust_alone", alone), ("logs", whole)):
            if name in found.half_widths:
                yield f"reality/number/{name}/{who}", scale * getattr(found.parameters, name), unit, 1
                yield f"reality/half_interval/{name}/{who}", scale * found.half_widths[name], unit, 1
        yield f"reality/number/{name}/bundled", scale * getattr(bundled, name), unit, 1
    half = fit([logs / name for name in ("log10", "log15@52-72", "log16@30-42")])
    yield "reality/number/lag_s/first_half", 1e3 * half.parameters.lag_s, "ms", 1
    yield "reality/number/tilt_by_one_percent/logs", np.degrees(tilt(whole)), "deg", 1
    full = 4 * (whole.parameters.thrust(np.ones(1))[0]) / 9.81
    yield "reality/number/thrust_to_weight/logs", float(full), "1", 1
    yield "reality/number/thrust_to_weight/bundled", DroneModel.load("crazyflie").thrust_to_weight, "1", 1
    kept = fit([logs / name for name in ("log10", "log15", "log16")], keep=ITS_OWN)
    unturned = fit([logs / name for name in ("log10", "log15", "log16")], crazyflie(inertia_kgm2=0), keep=["spin"])
    for channel in ("thrust", "roll", "pitch", "yaw"):
        for who, found in (("fitted", whole), ("trimmed", kept), ("without_rotor_inertia", unturned)):
            yield f"reality/explained/{channel}/{who}", found.r2[channel], "1", 1


def told(name: str, who: str, errors: dict[str, dict[float, float]], segments: int) -> Iterator[Measured]:
    """Yield the errors of a prediction."""
    units = {"rates": "rad/s", "velocity": "m/s", "climb": "m/s", "position": "m"}
    for quantity, by_horizon in errors.items():
        for horizon, error in by_horizon.items():
            unit = units.get(quantity, "rad")
            yield f"reality/{name}/{quantity}/{who}/{round(1000 * horizon)}", error, unit, segments


def rates(logs: Path) -> Iterator[Measured]:
    """Predict body rates in spans between those that were fitted."""
    fitted = fit([logs / name for name in FITTED])
    kept = fit([logs / name for name in FITTED], keep=ITS_OWN)
    bundled = DroneModel.load("crazyflie")
    for name, spans in HELD_OUT.items():
        flights = read_flights([logs / span for span in spans])
        tries: dict[str, Errors] = {
            "bundled": predict(flights, bundled, thrust_map(bundled), RATE_HORIZONS_S),
            "trimmed": predict(flights, made(kept), linear_map(made(kept), kept), RATE_HORIZONS_S),
            "fitted": predict(
                flights,
                made(fitted),
                linear_map(made(fitted), fitted),
                RATE_HORIZONS_S,
                delay_s=fitted.parameters.delay_s,
            ),
        }
        yield f"reality/starts/{name}", tries["fitted"].segments, "1", 1
        yield from told(name, "guess", tries["fitted"].of_guess, tries["fitted"].segments)
        for who, errors in tries.items():
            yield from told(name, who, errors.of_model, errors.segments)


def hover(sysid: Path, pad: Path) -> Iterator[Measured]:
    """Predict calm flights of a drone by what was fitted to another, and to the shaken flights of a third."""
    shaken = fit([sysid / name for name in ("log10", "log15", "log16")])
    flown = [pad / f"E8_log0{k}" for k in range(4)]
    free = fit(flown, made(shaken))
    for name in ("lag_s", "inertia_x", "inertia_y", "torque_ratio", "thrust_2"):
        yield f"reality/calm_determines/{name}", float(name in free.half_widths), "1", 1
    bundled, calm = DroneModel.load("crazyflie"), read_flights(flown)
    middle = np.mean(np.concatenate([flight.command[flight.free] for flight in calm]))
    scale = float(1 / (bundled.thrust_to_weight * middle))  # at which the bundled drone hovers at E8's commands
    drone = DroneModel.from_dict(drone_data(free))
    yield "reality/number/thrust_scale/e8", free.parameters.thrust_scale, "1", 1
    sets = {"e9": [f"E9_log0{k}" for k in range(4)], "weight": ["weight_W1_near_M3_E9_log04"]}
    for name, logs in sets.items():
        flights = read_flights([pad / log for log in logs])
        tries = {
            "bundled": predict(flights, bundled, thrust_map(bundled, scale), HOVER_HORIZONS_S, trim_s=1.0),
            "fitted": predict(flights, drone, linear_map(drone), HOVER_HORIZONS_S, trim_s=1.0),
            "trim_of_e8": predict(flights, drone, linear_map(drone, free), HOVER_HORIZONS_S),
        }
        yield f"reality/starts/{name}", tries["fitted"].segments, "1", 1
        yield from told(name, "guess", tries["fitted"].of_guess, tries["fitted"].segments)
        for who, errors in tries.items():
            yield from told(name, who, errors.of_model, errors.segments)


def measure() -> Iterator[Measured]:
    """Fit and predict."""
    sysid, pad = folder("crazyflie-sysid"), folder("crazypad/motor")
    yield from numbers(sysid)
    yield from rates(sysid)
    yield from hover(sysid, pad)
