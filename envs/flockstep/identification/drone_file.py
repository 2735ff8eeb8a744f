"""Writes what was identified as a drone file."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from flockstep._core import DroneModel
from flockstep.identification.fit import Fit
from flockstep.identification.flights import GRAVITY


def drone_data(fit: Fit, *, mass_kg: float | None = None, name: str = "identified") -> dict[str, Any]:
    """Return the content of a drone file; `DroneModel.from_dict` makes the drone.

    Parameters
    ----------
    fit
        What `fit` returned.
    mass_kg
        Mass of the drone that flew. Logs only tell forces and inertia divided by it. None: that of ``Fit.like``.
    name
        Name of the drone.

    Raises
    ------
    ValueError
        The mass is not finite and positive, or no drone can fly with these numbers.
    """
    data = fit.like.to_dict()
    mass = data["mass_kg"] if mass_kg is None else mass_kg
    if isinstance(mass, bool) or not 0 < mass < math.inf:
        raise ValueError(f"mass_kg: expected a finite number > 0, got {mass_kg!r}")
    p, rotors = fit.parameters, data["rotors"]
    fastest = rotors["max_speed_radps"]
    x, y, z = data["inertia_kgm2"]
    inertia_z = z / (x + y) * (p.inertia_x + p.inertia_y)
    c0, c1, c2 = (p.thrust_scale * c for c in (p.thrust_0, p.thrust_1, p.thrust_2))
    if c2 > 0:  # the curve grows from here on
        rotors["min_speed_radps"] = max(-c1 / (2 * c2), 0.0) * 1.01 * fastest
    like = fit.like.name or "the drone that it began with"
    head = {
        "flockstep_drone": data["flockstep_drone"],
        "name": name,
        "description": f"Identified from {', '.join(flight.name for flight in fit.flights)}.",
        "sources": {
            "fitted": f"{', '.join(fit.half_widths)}, with commands from 0 to 1 as speeds from 0 to max_speed_radps.",
            "others": f"{like}; the mass by hand, the inertia about z in its ratio to the others.",
        },
    }
    data = head | data | {"name": name, "mass_kg": mass}
    data["inertia_kgm2"] = [mass * each for each in (p.inertia_x, p.inertia_y, inertia_z)]
    rotors |= {
        "thrust_n": [mass * c0, mass * c1 / fastest, mass * c2 / fastest**2],
        "torque_ratio_m": p.torque_ratio,
        "lag_up_s": p.lag_s,
        "lag_down_s": p.lag_s,
        "inertia_kgm2": max(p.spin, 0.0) * mass / fastest,
    }
    data["drag"]["linear_n_per_mps"] = [mass * max(each, 0.0) for each in (p.drag_x, p.drag_y, p.drag_z)]
    full = fit.like.num_rotors * (c0 + c1 + c2) / GRAVITY
    if full <= 1:
        raise ValueError(f"logs: expected a thrust above the weight at full command, got {full:.2f} of it")
    data = {key: _rounded(value) for key, value in data.items()}
    DroneModel.from_dict(data)  # refuses what cannot fly
    return data


def drone_text(data: dict[str, Any]) -> str:
    """Return the text of a drone file: JSON with each list of numbers on a line."""
    text = json.dumps(data, indent=2)
    return re.sub(r"\[[^][{}\"]*\]", lambda match: " ".join(match[0].split()), text) + "\n"


def _rounded(value: Any) -> Any:
    """Return a number, or all numbers of lists and dicts, with five digits."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return {key: _rounded(each) for key, each in value.items()} if isinstance(value, dict) else value
