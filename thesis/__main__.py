"""Reproduce the thesis: `./dev thesis [NAME...]` measures what is missing of a table, a figure or an experiment.

Each job has rows, and each row keeps its own result in out/thesis/NAME/ROW.json when it is measured, so that an
interrupted job goes on where it stopped. Rows that bench/results/thesis_NAME.json has are not measured again, either.
Once all rows of a job are there, it writes out/bench/thesis_NAME.json;
`python bench/table.py --keep` keeps that and writes the pages of docs/thesis/. `--fresh` measures all rows again. A job
that only draws writes its pictures to docs/images/.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import run  # bench/, which the command puts on the path
import table
from timing import Figure, Measured, figure

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out"
Rows = Mapping[str, Callable[[], Iterable[Measured | Figure]]]

#: Jobs that measure, by name: the function of this package that returns its rows.
JOBS = {
    "movement": "benchmarks:movement",
    "scans": "benchmarks:scans",
    "cameras": "benchmarks:cameras",
    "lidar": "experiments:lidar",
    "camera": "experiments:camera",
    "claims": "claims:claims",
    "profile": "claims:profile",
}
#: Properties of a machine that all rows of one result share.
HARDWARE = ("cpu", "logical_processors", "simd")
#: Jobs that only draw, by name: the function that draws.
DRAWN = {"pictures": "pictures:draw", "paths": "experiments:draw_paths"}


def kept_rows(name: str) -> dict[str, dict[str, Any]]:
    """Return the kept results of a job by row: those of out/thesis/, and those of bench/results/ that it lacks."""
    rows: dict[str, dict[str, Any]] = {}
    path = table.KEPT / f"thesis_{name}.json"
    whole = json.loads(path.read_text()) if path.exists() else {"figures": []}
    commits = {row: part["commit"] for part in whole.pop("parts", []) for row in part["what"].split()}
    for each in whole.pop("figures"):
        row = each["name"].split("/")[1]
        about = {**whole, "commit": commits.get(row, whole["commit"])}
        rows.setdefault(row, {**about, "figures": []})["figures"].append(each)
    return rows | {each.stem: json.loads(each.read_text()) for each in (OUT / "thesis" / name).glob("*.json")}


def measured(name: str, row: str, measure: Callable[[], Iterable[Measured | Figure]]) -> dict[str, Any]:
    """Measure a row, and keep its result."""
    print(f"== {name}, {row}", flush=True)
    at = {"machine": run.machine(), "commit": run.commit(), "commit_date": run.commit_date()}
    figures = [figure(*each) if isinstance(each, tuple) else each for each in measure()]
    for each in figures:
        each["name"] = f"thesis_{name}/{row}/{each['name']}"
        print(f"   {each['name']:60} {each['value']:>12,.6g} {each['unit']}", flush=True)
    if run.commit() != at["commit"]:
        sys.exit(f"{name}: the checkout changed while {row} ran; nothing written")
    path = OUT / "thesis" / name / f"{row}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = path.with_suffix(".part")  # renamed when whole, so that an interrupted run leaves no half a row
    whole.write_text(table.lines_of({**at, "figures": figures}))
    whole.replace(path)
    return {**at, "figures": figures}


def function(path: str) -> Callable[[], Any]:
    """Return a function of this package, such as "pictures:draw"."""
    module, _, name = path.partition(":")
    found: Callable[[], Any] = getattr(importlib.import_module(f"thesis.{module}"), name)
    return found


def reproduce(name: str, only: str, fresh: bool, kept: bool) -> None:
    """Measure the rows of a job that are not kept, or one of them, and write all of them as one result."""
    rows: Rows = function(JOBS[name])()
    if only:
        if only not in rows:
            sys.exit(f"NAME/ROW: expected one of {', '.join(rows)} of {name}, got {only!r}")
        measured(name, only, rows[only])
        return
    found = {} if fresh else kept_rows(name)
    if kept:
        rows = {row: measure for row, measure in rows.items() if row in found}
    if not rows:
        sys.exit(f"{name}: no row is kept")
    results = {row: found[row] if row in found else measured(name, row, measure) for row, measure in rows.items()}
    last = results[next(reversed(results))]
    if len({tuple(each["machine"][what] for what in HARDWARE) for each in results.values()}) > 1:
        sys.exit(f"{name}: rows of several machines: --fresh measures all again")
    others = {each["commit"] for each in results.values()} - {last["commit"]}
    parts = [
        {"what": " ".join(row for row, each in results.items() if each["commit"] == commit), "commit": commit}
        for commit in sorted(others)
    ]
    about = {key: last[key] for key in ("machine", "commit", "commit_date")} | ({"parts": parts} if parts else {})
    path = OUT / "bench" / f"thesis_{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(table.lines_of({**about, "figures": [f for each in results.values() for f in each["figures"]]}))
    print(f"{name}: {len(rows)} rows are in {path.relative_to(ROOT)}")


def main() -> None:
    """Reproduce the named jobs, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(JOBS | DRAWN)}; default: all")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--fresh", action="store_true", help="measure rows again that are kept")
    which.add_argument("--kept", action="store_true", help="measure nothing, and write the results of the kept rows")
    args = parser.parse_args()
    names = [name.partition("/")[::2] for name in args.names or JOBS | DRAWN]
    for name, _ in names:
        if name not in JOBS | DRAWN:
            parser.error(f"NAME: expected one of {', '.join(JOBS | DRAWN)}, got {name!r}")
    for name, row in names:
        if name in DRAWN:
            function(DRAWN[name])()
        else:
            reproduce(name, row, args.fresh, args.kept)


if __name__ == "__main__":
    main()
