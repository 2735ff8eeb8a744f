"""The command ``python -m flockstep identify``."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from flockstep._core import DroneModel
from flockstep.identification.drone_file import drone_data, drone_text
from flockstep.identification.fit import fit
from flockstep.identification.flights import read_flights
from flockstep.identification.report import plot, report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``identify``."""
    parser.set_defaults(run=main)
    about_logs = "log of a Crazyflie, or CSV file; LOG@35-65 reads only these seconds of its clock"
    parser.add_argument("log", nargs="+", help=about_logs, metavar="LOG")
    about_like = "drone that gives the rotors' places and what the logs do not determine: a bundled one, or a JSON file"
    parser.add_argument("--like", default="crazyflie", help=about_like + ". Default: crazyflie", metavar="DRONE")
    parser.add_argument("--mass-kg", type=float, help="mass in flight. Default: that of --like", metavar="KG")
    parser.add_argument("--held-out", nargs="+", default=[], help="logs to predict with the result", metavar="LOG")
    about_out = "drone file to write; report and plots get its name with .md and .png. Default: identified.json"
    parser.add_argument("--out", type=Path, default=Path("identified.json"), help=about_out, metavar="FILE")


def main(arguments: argparse.Namespace) -> None:
    """Fit, write the drone file and the report, and print the report."""
    out: Path = arguments.out
    if out.suffix != ".json":
        sys.exit(f"identify: --out: expected a name that ends with .json, got {str(out)!r}")
    for package in ("scipy", "matplotlib"):
        try:
            importlib.import_module(package)
        except ModuleNotFoundError:
            sys.exit(f"identify needs {package}, which is not installed: pip install scipy matplotlib")
    try:
        drone = DroneModel.load(arguments.like)
        held_out = read_flights(arguments.held_out, drone.num_rotors)
        found = fit(arguments.log, drone)
        data = drone_data(found, mass_kg=arguments.mass_kg, name=out.stem)
        text = report(found, held_out, arguments.mass_kg)
    except ValueError as error:
        sys.exit(f"identify: {error}")
    out.write_text(drone_text(data), encoding="utf-8")
    plot(found, out.with_suffix(".png"))
    out.with_suffix(".md").write_text(text + f"\n![Logs and model]({out.stem}.png)\n", encoding="utf-8")
    print(text)
    print(f"Wrote {out}, {out.with_suffix('.md')} and {out.with_suffix('.png')}.")
