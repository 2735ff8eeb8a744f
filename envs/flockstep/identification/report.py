"""Reports a fit as text and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flockstep._core import DroneModel
from flockstep.identification.drone_file import drone_data
from flockstep.identification.fit import Fit
from flockstep.identification.flights import GRAVITY, Flight
from flockstep.identification.model import Array, Windows, channels, frame_of, parameters_of
from flockstep.identification.prediction import linear_map, predict

#: Rows of the report: what is fitted, its name for readers, its factor to the unit, and the unit behind numbers.
_ROWS = {
    "thrust_scale": ("thrust, times the curve of the drone it began with", 1.0, ""),
    "lag_s": ("motor lag", 1e3, " ms"),
    "delay_s": ("delay, sensor included", 1e3, " ms"),
    "inertia_x": ("inertia over mass, roll", 1e4, " cm²"),
    "inertia_y": ("inertia over mass, pitch", 1e4, " cm²"),
    "torque_ratio": ("torque over thrust", 1e3, " mm"),
    "spin": ("angular momentum of a rotor at full command, over mass", 1e4, " cm²/s"),
    "trim_roll": ("left motors stronger", 100.0, " %"),
    "trim_pitch": ("rear motors stronger", 100.0, " %"),
    "trim_yaw": ("clockwise motors stronger", 100.0, " %"),
    "drag_x": ("drag over mass, forward", 1.0, " 1/s"),
    "drag_y": ("drag over mass, sideways", 1.0, " 1/s"),
    "drag_z": ("drag over mass, along the thrust", 1.0, " 1/s"),
}
_HORIZONS_S = (0.1, 0.2, 0.5)


def report(fit: Fit, held_out: Sequence[Flight] = (), mass_kg: float | None = None) -> str:
    """Return a report in Markdown: what was found, how well it explains the logs, and how well it predicts others."""
    before, drone = parameters_of(fit.like), fit.like.name or "the drone it began with"
    seconds = sum(flight.duration_s for flight in fit.flights)
    lines = [
        "# Identified drone",
        "",
        f"From {seconds:.0f} s of flight: {', '.join(flight.name for flight in fit.flights)}.",
        "Intervals hold 95 % if the model is right. They do not contain its own errors.",
        "",
        f"| | logs | {drone} |",
        "|---|---:|---:|",
    ]
    for name, (label, factor, unit) in _ROWS.items():
        if name in fit.half_widths:
            value, half = factor * getattr(fit.parameters, name), factor * fit.half_widths[name]
            lines.append(f"| {label} | {value:.3g} ± {half:.2g}{unit} | {factor * getattr(before, name):.3g}{unit} |")
    for x, value, half in fit.thrust:
        lines.append(f"| thrust over weight at command {x:.2f} | {value:.3f} ± {half:.3f} | |")
    lines += ["", "| channel | variance explained |", "|---|---:|"]
    lines += [f"| {name} | {f'{100 * share:.1f} %' if share > 0 else 'nothing'} |" for name, share in fit.r2.items()]
    lines += ["", *(f"- **Warning**: {warning}" for warning in fit.warnings)]
    if held_out:
        lines += ["", *_predictions(fit, held_out, mass_kg)]
    return "\n".join(lines).rstrip() + "\n"


def _predictions(fit: Fit, held_out: Sequence[Flight], mass_kg: float | None) -> list[str]:
    """Return a table of the errors of open-loop flight on other logs."""
    drone = DroneModel.from_dict(drone_data(fit, mass_kg=mass_kg))
    errors = predict(held_out, drone, linear_map(drone, fit), _HORIZONS_S, delay_s=fit.parameters.delay_s)
    lines = [
        f"Held out: {', '.join(flight.name for flight in held_out)}. The drone flies the logged commands open loop,",
        f"from {errors.segments} starts. Root mean square errors, and in brackets the guess that nothing accelerates:",
        "",
        "| | " + " | ".join(f"after {horizon:g} s" for horizon in _HORIZONS_S) + " |",
        "|---|" + "---:|" * len(_HORIZONS_S),
    ]
    units = {"rates": "rad/s", "velocity": "m/s", "climb": "m/s", "position": "m", "roll": "rad", "yaw": "rad"}
    for name, by_horizon in errors.of_model.items():
        cells = [f"{value:.3g} ({errors.of_guess[name][horizon]:.3g})" for horizon, value in by_horizon.items()]
        lines.append(f"| {name}, {units[name]} | {' | '.join(cells)} |")
    return lines


def plot(fit: Fit, path: str | Path) -> None:
    """Draw ten seconds of each channel, logged and by the model, and the thrust curve, as a PNG or SVG file.

    Raises
    ------
    ModuleNotFoundError
        Matplotlib is not installed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    frame = frame_of(fit.like)
    shown: dict[str, tuple[Flight, tuple[Array, Array]]] = {}  # the flight in which a channel moves most
    for flight in fit.flights:
        for name, pair in channels(flight, frame, fit.parameters).items():
            if name not in shown or np.std(pair[0]) > np.std(shown[name][1][0]):
                shown[name] = (flight, pair)
    figure = Figure(figsize=(9, 1.9 * (len(shown) + 1)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(shown) + 1, 1)
    for axis, (name, (flight, (told, model))) in zip(axes, shown.items(), strict=False):
        time = flight.time_s[flight.free][0] + np.arange(told.size) * (Windows(flight.dt_s).samples // 2) * flight.dt_s
        part = time < time[0] + 10
        axis.plot(time[part], told[part], color="0.6", linewidth=2.5, label="log")
        axis.plot(time[part], model[part], color="C0", linewidth=1, label="model")
        is_turn = name in ("roll", "pitch", "yaw")
        axis.set_ylabel(f"{name}, rad/s²" if is_turn else f"{name}, m/s²")
        axis.set_title(f"{flight.name}: explains {100 * fit.r2[name]:.0f} %", fontsize=8)
    axes[0].legend(loc="upper right", fontsize=8)
    x = np.linspace(0, 1, 100)
    axes[-1].plot(x, fit.parameters.thrust(x) * fit.like.num_rotors / GRAVITY, color="C0")
    axes[-1].errorbar(*np.transpose(fit.thrust)[:2], np.transpose(fit.thrust)[2], fmt="o", color="C1", label="flown")
    axes[-1].set_xlabel("command of all motors")
    axes[-1].set_ylabel("thrust over weight")
    axes[-1].legend(loc="upper left", fontsize=8)
    figure.savefig(path, dpi=100)
