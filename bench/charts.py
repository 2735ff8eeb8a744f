"""The charts of figures, which `bench/table.py` draws from the kept results, for light and dark."""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

import table

#: Charts by file: title, axes, and the figures of each line. Their names have the position on the x axis, or each
#: figure has a curve of its own. Axes with positions are logarithmic, unless y is a success.
CHARTS: dict[str, tuple[str, str, str, dict[str, str]]] = {
    "speed-drones": (
        "One thread",
        "drones",
        "per second",
        {
            "LiDAR scans": "step: lidar/fan35x{x}/scans_per_second",
            "steps of the LiDAR task": "step/n{x}/steps_per_second",
            "scans, Embree alone": "step: lidar/fan35x{x}/bare_embree_scans_per_second",
            "images of 64 x 64": "step: camera/raycast/playground/64x64x{x}/frames_per_second",
            "images, Embree alone": "step: camera/raycast/playground/64x64x{x}/bare_embree_frames_per_second",
        },
    ),
    "speed-threads": (
        "One to sixteen threads",
        "threads",
        "per second",
        {
            "steps of lidar": "scaling/steps_per_second/lidar4096/threads{x}",
            "steps of race": "scaling/steps_per_second/race4096/threads{x}",
            "training of lidar": "scaling/training_steps_per_second/lidar/threads{x}",
            "frames of 64 x 64 in a playground": "scaling/frames_per_second/playground_camera-train-1/threads{x}",
            "frames in an office": "scaling/frames_per_second/indoor_office/threads{x}",
            "steps of forest, with depth": "scaling/steps_per_second/forest512/threads{x}",
        },
    ),
    "drones-that-differ": (
        "Race: three laps without a contact, median of five seeds",
        "percent by which each number of the drone may be off",
        "success",
        {
            "trained with differences": "race_varied/varied/{seed}/{x:\\d+}/success",
            "trained without": "race_varied/alike/{seed}/{x:\\d+}/success",
            "controller, slower": "race_varied/controller/{x:\\d+}/success",
        },
    ),
    "reality-rates": (
        "Roll and pitch of a real Crazyflie, shaken",
        "ms after the start",
        "error of body rates, rad/s",
        {
            "constant rates": "reality/roll_pitch/rates/guess/{x:\\d+}",
            "bundled": "reality/roll_pitch/rates/bundled/{x:\\d+}",
            "trimmed": "reality/roll_pitch/rates/trimmed/{x:\\d+}",
            "fitted": "reality/roll_pitch/rates/fitted/{x:\\d+}",
        },
    ),
    "thesis-steps": (
        "Steps of the server while drones move, figure 5.1",
        "s",
        "steps per second",
        {"N = {drones}": "thesis_movement/{drones}/rate_over_time"},
    ),
    "thesis-responses": (
        "Response time while drones move, figure 5.2",
        "s",
        "ms",
        {"N = {drones}": "thesis_movement/{drones}/over_time"},
    ),
    "thesis-lidar": (
        "LiDAR experiment, table 6.2",
        "steps",
        "reward of an episode",
        {"seed {seed}": "thesis_lidar/unit_{seed}/reward", "largest component 1": "thesis_lidar/largest_0/reward"},
    ),
    "thesis-camera": (
        "Camera experiment, table 6.4",
        "steps",
        "reward of an episode",
        {"64 x 48, seed {seed}": "thesis_camera/64_{seed}/reward", "640 x 480": "thesis_camera/640_0/reward"},
    ),
}
INK, PAPER = "#1f2329", "#ffffff"  # in the light; the file replaces them in the dark
STYLE = (
    f"<style>:root{{--ink:{INK};--paper:{PAPER}}}"
    "@media(prefers-color-scheme:dark){:root{--ink:#e4e8ee;--paper:#14181e}}</style>"
)
SETTINGS: Any = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "flockstep",  # the same file each time
    "font.family": "sans-serif",
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor"), PAPER),
}


def lines_of(patterns: dict[str, str], results: dict[str, Any]) -> dict[str, list[Any]]:
    """Return the points of each line, by its label."""
    lines: dict[str, list[Any]] = {}
    for label, pattern in patterns.items():
        for _, figure, at in table.found(pattern, results):
            if "x" in at:
                lines.setdefault(label, []).append((int(at["x"]), figure["value"]))
            else:
                lines[label.format(**at)] = figure["curve"]
    return {label: medians(line) if isinstance(line[0], tuple) else line for label, line in lines.items()}


def medians(points: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """Return one point for each position: the median of its values, such as those of five seeds."""
    return [(x, statistics.median(value for at, value in points if at == x)) for x in sorted({x for x, _ in points})]


def draw(results: dict[str, Any], folder: Path, is_check: bool) -> None:
    """Draw the charts whose points have changed, or exit if there is one."""
    for name, (title, x_label, y_label, patterns) in CHARTS.items():
        lines = lines_of(patterns, results)
        if not lines:
            continue
        is_log = any("{x" in pattern for pattern in patterns.values())
        path, told = folder / f"{name}.svg", json.dumps([title, x_label, y_label, lines])
        if path.exists() and told in path.read_text(encoding="utf-8"):
            continue
        if is_check:
            sys.exit(f"{path.name}: its figures are out of date: run python bench/table.py")
        with plt.rc_context(SETTINGS):
            chart, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
            for label, line in lines.items():
                axes.plot(*zip(*line, strict=True), marker="o" if is_log else "", markersize=4, label=label)
            axes.set(title=title, xlabel=x_label, ylabel=y_label)
            if is_log:
                axes.set(**({"ylim": (0, 1.05)} if y_label == "success" else {"xscale": "log", "yscale": "log"}))
                axes.set_xticks([x for x, _ in next(iter(lines.values()))], minor=False)
                axes.minorticks_off()
            elif y_label == "ms":
                axes.set_yscale("log")
            else:
                axes.xaxis.get_major_locator().set_params(nbins=5)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter("{x:,.10g}")
            axes.grid(alpha=0.3)
            chart.legend(loc="outside right center", frameon=False)
            chart.savefig(path, metadata={"Date": None, "Creator": None})
            plt.close(chart)
        drawn = path.read_text(encoding="utf-8").replace(INK, "var(--ink)").replace(PAPER, "var(--paper)")
        head, _, rest = drawn.partition("<defs>")
        path.write_text(f"{head}<!-- {told} -->\n {STYLE}\n <defs>{rest}", encoding="utf-8")
