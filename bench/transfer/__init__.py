"""Flights between simulators: our policies in RotorPy and Crazyflow, and their controllers on our drones.

Every pilot flies the same 100 starts in each simulator: throws as in Hover, and a figure-8 as in Track. A policy is
the compiled header of `flockstep.export`; the other simulator sees nothing of flockstep. bench/transfer/flights.py says
how. pip installs the others into out/peers/.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from dynamics_peers import PEERS
from peers import ask, python_of
from timing import Figure, figure
from transfer.flights import OWNERS

HERE = Path(__file__).resolve().parent
POLICIES: dict[str, dict[str, Any]] = {
    "hover": {"task": "hover", "control": "rotor_thrusts", "hz": 50, "history": 1, "past_actions": 0},
    "hover_varied": {"task": "hover", "control": "body_rates", "hz": 50, "history": 2, "past_actions": 2},
    "track": {"task": "track", "control": "body_rates", "hz": 100, "history": 1, "past_actions": 0},
}
#: Drones by simulator, each with its pilots.
SIMULATORS = {
    ("flockstep", "crazyflie"): [*POLICIES, "se3", "mellinger"],
    ("rotorpy", "crazyflie"): [*POLICIES, "se3"],
    ("rotorpy", "crazyflie, k_w=20"): ["hover_varied", "track"],
    ("crazyflow", "cf2x_L250"): [*POLICIES, "mellinger"],
    ("flockstep", "hummingbird"): ["hover_varied", "se3"],
    ("rotorpy", "hummingbird"): ["se3"],
    ("rotorpy", "hummingbird, k_w=20"): ["hover_varied"],
}
SUCCESS_M, HELD_M = 0.1, 0.5


def compiled(folder: Path) -> None:
    """Compile the policies as libraries, and write what flights.py has to know of them."""
    for name in POLICIES:
        flockstep.export(flockstep.policies.load(name), folder / f"{name}.h")
        source = f'#include "{name}.h"\nvoid act(const float *o, float *a) {{ {name}_act(o, a); }}\n'
        (folder / f"{name}.c").write_text(source)
        command = ["cc", "-std=c99", "-O2", "-shared", "-fPIC", f"{name}.c", "-o", f"{name}.so", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
    (folder / "policies.json").write_text(json.dumps(POLICIES))


def site_of(python: Path) -> str:
    """Return where a Python has its packages."""
    where = [str(python), "-c", "import site; print(site.getsitepackages()[0])"]
    return subprocess.run(where, capture_output=True, text=True, check=True).stdout.strip()


def flown(simulator: str, drone: str, pilot: str, folder: str) -> Any:
    """Return the errors of all flights by task."""
    if simulator != "flockstep":
        return ask(python_of(simulator, PEERS[simulator]), HERE / "flights.py", f"of_{simulator}", drone, pilot, folder)
    owner = OWNERS.get(pilot)  # its packages come behind our own, so that only what is missing is from there
    more = [site_of(python_of(owner, PEERS[owner]))] if owner else []
    return ask(Path(sys.executable), HERE / "flights.py", "ours", drone, pilot, folder, *more)


def measure() -> Iterator[Figure]:
    """Fly all pilots."""
    with tempfile.TemporaryDirectory() as folder:
        compiled(Path(folder))
        for (simulator, drone), pilots in SIMULATORS.items():
            for pilot in pilots:
                try:
                    found = flown(simulator, drone, pilot, folder)
                except RuntimeError as error:
                    name = f"transfer/{simulator}/{drone}/{pilot}/measured"
                    yield figure(name, 0, "1", 1, error=str(error)[:200])
                    continue
                for task, values in found.items():
                    errors = np.array(values)
                    name, held = f"transfer/{pilot}/{task}/{simulator}/{drone}", errors <= HELD_M
                    yield figure(f"{name}/success", float((errors <= SUCCESS_M).mean()), "1", len(errors))
                    if held.any():
                        yield figure(f"{name}/median_error_m", float(np.median(errors[held])), "m", int(held.sum()))
