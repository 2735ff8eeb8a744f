"""Compare the speed of this checkout with that of another one, row by row: `./dev bench --against DIR [NAME...]`.

step      whole steps of the vector environments: navigation, Hover, Track, tasks written in Python
lidar     scans of primitives, of many pillars and of triangles
camera    images by both backends, and capture modes that rarely render
tiles     cameras and LiDARs on triangles, in tiles and slices; ids, normals, textures, shadows, samples, resizing
dynamics  `Batch.fly` by each controller, with gusts, ground effect and an IMU, in contact; `Batch.move`
worlds    loading, saving, generating and preparing worlds, world pools, and sensors in the bundled worlds
build     processor time of building the package from scratch; only if named, because it takes minutes

Without a NAME, the first six run. A NAME may also be one row, or a prefix of rows up to a slash. DIR is a checkout
whose .venv has its package installed, under the name in its pyproject.toml.

Each repeat starts a process in either checkout, with its own Python. Both prepare the same row, then alternate in
slices of a few hundredths of a second: this, other, other, this, and so on. Other load on the machine thus slows both
equally. A slice is timed by the processor time of all threads of the process, which other programs hardly change. The
ratio of a repeat is the median over its pairs of slices. Higher is better; above 1 this checkout is faster.

`build` builds both wheels in temporary folders, as `./dev install` does, at the same time and with one compile job
each. It runs once, for any number of repeats. Its ratio is not part of the mean.

The exit status is 1 if the geometric mean over the rows is less than 0.98, if a row is less than 0.93 in every repeat,
or if the build takes more than 1.05 times the other's processor time. It is 2 if a row cannot run in one of the
checkouts.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from compare_rows import ROWS, Call

ROOT = Path(__file__).resolve().parent.parent
PAIRS = 24  # number of slice pairs per row and repeat; down to LEAST_PAIRS if one call exceeds a slice
LEAST_PAIRS = 6
SLICE_S = 0.025
LEAST_MEAN, LEAST_ROW, LEAST_BUILD = 0.98, 0.93, 1 / 1.05
FAMILIES = tuple(dict.fromkeys(row.split("/")[0] for row, _ in ROWS))
ONLY_IF_NAMED = ("build",)

Ratios = dict[str, list[float]]  # by row, one ratio per repeat

# ------------------------------------------------------------------------------------------- the process that runs rows


def work(package_name: str) -> None:
    """Answer each JSON line with another one: "prepare" a row, or time `count` calls of the prepared row."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # keeps other output out of the answers
    package, setups = importlib.import_module(package_name), dict(ROWS)
    call: Call | None = None
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if "prepare" in request:
                call = None  # frees the memory of the previous row
                call = setups[request["prepare"]](package)
                call()
            assert call is not None
            before = time.process_time()
            for _ in range(request.get("count", 1)):
                call()
            answer: dict[str, Any] = {"seconds": time.process_time() - before}
        except Exception:
            answer = {"error": traceback.format_exc()}
        answers.write(json.dumps(answer) + "\n")


# ------------------------------------------------------------------------------------------------ comparing two of them


class CannotRunError(Exception):
    """A row that one of the checkouts cannot run."""


class Checkout:
    """A checkout and, while entered, a process of its Python that runs rows."""

    def __init__(self, root: Path) -> None:
        found = re.search(r'^name = "(\w+)"', (root / "pyproject.toml").read_text(), re.MULTILINE)
        if found is None:
            raise SystemExit(f"{root}: expected a pyproject.toml with the package's name")
        self.root, self.package = root, found[1]
        self.python = root / ".venv" / "bin" / "python"
        if not self.python.exists():
            raise SystemExit(f"{root}: expected .venv with {self.package} installed in it (./dev install there)")

    def __enter__(self) -> Checkout:
        command = [self.python, __file__, "--worker", self.package]
        self.process = subprocess.Popen(
            command, cwd=self.root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, *_: object) -> None:
        self.process.communicate()  # closes its input, which ends it

    def send(self, **request: Any) -> None:
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the process has ended, which `read` reports
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()

    def read(self) -> dict[str, Any]:
        """Return the answer to a request: its time in seconds, or an error."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        answer: dict[str, Any] = json.loads(line) if line else {"error": "its process has ended"}
        return answer

    def time(self, count: int) -> float:
        self.send(count=count)
        return self.seconds(self.read())

    def seconds(self, answer: dict[str, Any]) -> float:
        if "error" in answer:
            raise CannotRunError(f"{self.root}: {answer['error']}")
        return float(answer["seconds"])


def row_ratio(this: Checkout, other: Checkout, row: str) -> float:
    for checkout in (this, other):
        checkout.send(prepare=row)
    answers = [(checkout, checkout.read()) for checkout in (this, other)]  # read both before raising an error of either
    once = min(checkout.seconds(answer) for checkout, answer in answers)
    few = max(1, round(0.2 * SLICE_S / max(once, 1e-7)))
    one_call = max(this.time(few) / few, 1e-7)
    count = max(1, round(SLICE_S / one_call))
    pairs = max(LEAST_PAIRS, round(PAIRS * min(1.0, SLICE_S / (count * one_call))))
    ratios = []
    for pair in range(pairs):
        order = (this, other) if pair % 2 == 0 else (other, this)
        took = {checkout: checkout.time(count) for checkout in order}
        ratios.append(took[other] / took[this])
    return statistics.median(ratios)


def is_selected(row: str, names: Sequence[str]) -> bool:
    return any(f"{row}/".startswith(f"{name}/") for name in names)


def repeat(
    this: Checkout, other: Checkout, names: Sequence[str], failures: dict[str, str]
) -> Iterator[tuple[str, float]]:
    """Yield each row's ratio; rows that cannot run are added to `failures`."""
    with this, other:
        for row, _ in ROWS:
            if not is_selected(row, names) or row in failures:
                continue
            try:
                yield row, row_ratio(this, other, row)
            except CannotRunError as error:
                failures[row] = str(error)


def build_seconds(this: Checkout, other: Checkout) -> tuple[float, float]:
    """Build both packages from scratch at the same time; return the processor time of each in s."""
    with tempfile.TemporaryDirectory() as folder:
        builds = []
        for name, checkout in (("this", this), ("other", other)):
            at = Path(folder) / name
            at.mkdir()
            options = ["--disable-pip-version-check", "--no-deps", "--no-build-isolation", "-v", "--wheel-dir", str(at)]
            options.append(f"--config-settings=build-dir={at / 'build'}")
            with (at / "log").open("w") as log:
                builds.append(
                    subprocess.Popen(
                        [checkout.python, "-m", "pip", "wheel", *options, "."],
                        cwd=checkout.root,
                        env=os.environ | {"CMAKE_BUILD_PARALLEL_LEVEL": "1"},
                        stdin=subprocess.DEVNULL,
                        stdout=log,
                        stderr=subprocess.STDOUT,
                    )
                )
        seconds = []
        for build in builds:
            _, status, used = os.wait4(build.pid, 0)  # includes its compilers
            build.returncode = os.waitstatus_to_exitcode(status)
            seconds.append(used.ru_utime + used.ru_stime)
        for name, checkout, build in zip(("this", "other"), (this, other), builds, strict=True):
            if build.returncode != 0:
                end = "\n".join((Path(folder) / name / "log").read_text(errors="replace").splitlines()[-20:])
                raise CannotRunError(f"{checkout.root}: pip wheel failed with status {build.returncode}:\n{end}")
    return seconds[0], seconds[1]


# ---------------------------------------------------------------------------------------------------------- the verdict


def least(row: str) -> float:
    """Return the minimum ratio of a row in at least one repeat."""
    return LEAST_BUILD if row == "build" else LEAST_ROW


def is_slower(row: str, values: Sequence[float]) -> bool:
    return max(values) < least(row)


def geometric_mean(ratios: Ratios) -> float | None:
    """Return the mean over the medians of all rows except the build, or None if there are none."""
    logs = [math.log(statistics.median(values)) for row, values in ratios.items() if row != "build"]
    return math.exp(statistics.mean(logs)) if logs else None


def report(ratios: Ratios, failures: dict[str, str], repeats: int) -> int:
    """Print the table; return the exit status."""
    print(f"   {'row':45} {'  repeats' + ' ' * (7 * repeats - 9)}  median")
    for row, values in ratios.items():
        slower = f"  below {least(row):.2f} in every repeat" if is_slower(row, values) else ""
        listed = " ".join(f"{value:6.3f}" for value in values)
        print(f"   {row:45} {listed:{7 * repeats - 1}}  {statistics.median(values):6.3f}{slower}")
    for row, why in failures.items():
        print(f"   {row}: cannot be run: {why}")
    mean = geometric_mean(ratios)
    if mean is not None:
        print(
            f"   geometric mean of {len(ratios) - ('build' in ratios)} rows: {mean:.3f}, at least {LEAST_MEAN} needed"
        )
    if failures or not ratios:
        return 2
    is_slow = mean is not None and mean < LEAST_MEAN
    return 1 if is_slow or any(is_slower(row, values) for row, values in ratios.items()) else 0


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names_of_all = (*FAMILIES, *ONLY_IF_NAMED)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(names_of_all)}, or a row; default: {', '.join(FAMILIES)}"
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="the other checkout")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.worker:
        work(args.worker)
        return 0
    names = args.names or FAMILIES
    for name in names:
        if name not in names_of_all and not any(is_selected(row, [name]) for row, _ in ROWS):
            parser.error(f"NAME: expected {', '.join(names_of_all)} or a row of theirs, got {name!r}")
    if args.against is None:
        parser.error("--against: expected the folder of the other checkout, got none")
    if args.repeats < 1:
        parser.error(f"--repeats: expected at least 1, got {args.repeats}")
    this, other = Checkout(ROOT), Checkout(args.against.resolve())
    ratios: Ratios = {}
    failures: dict[str, str] = {}
    for number in range(args.repeats):
        for row, ratio in repeat(this, other, names, failures):
            ratios.setdefault(row, []).append(ratio)
            print(f"   repeat {number + 1}: {row:45} {ratio:6.3f}", file=sys.stderr)
    if "build" in names:
        try:
            ours, theirs = build_seconds(this, other)
            print(f"   build: {ours:.1f} s of processor time here, {theirs:.1f} s there", file=sys.stderr)
            ratios["build"] = [theirs / ours]
        except CannotRunError as error:
            failures["build"] = str(error)
    print(f"speed of {this.root} over that of {other.root}; above 1 the former is faster")
    return report(ratios, failures, args.repeats)


if __name__ == "__main__":
    sys.exit(main())
