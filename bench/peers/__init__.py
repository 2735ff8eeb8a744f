"""Measure other programs for comparison: each in its own virtual environment, on one processor."""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from timing import Figure, figure, timed

HOMES = Path(__file__).resolve().parents[2] / "out" / "peers"
LIMIT_S = 1800  # for installing, and for running
RUNS = 5


def rate(
    call: Callable[[], object], count: int, runs: int = RUNS, warm_up: Callable[[], object] | None = None
) -> float:
    """Return the number of items per second of processor time that a call processes, the median of several runs.

    On one pinned processor, processor time equals wall time on an idle machine; on a busy one it excludes other
    programs. Before timing, `warm_up` or the call itself runs once.
    """
    (warm_up or call)()
    timer = timed(call, at_least_s=0.5)
    return count / statistics.median(timer() for _ in range(runs))


Told = tuple[str, float, str, int, dict[str, str]]  # name, value, unit, runs, other keys


def of_each(
    bench: str, packages: Mapping[str, Sequence[str]], measure: Callable[[str, Path], Iterator[Told]]
) -> Iterator[Figure]:
    """Return the figures of all peers; one that cannot be measured has a figure with the reason."""
    for peer, names in packages.items():
        try:
            found = [*measure(peer, python_of(peer, names))]
        except RuntimeError as error:
            print(f"   {peer}: {error}")
            found = [(f"{peer}/measured", 0, "1", 1, {"error": str(error)[:200]})]
        for name, value, unit, runs, more in found:
            yield figure(f"{bench}/{name}", value, unit, runs, **more)


def python_of(peer: str, packages: Sequence[str]) -> Path:
    """Return the Python of a peer's environment, which is created and filled if it does not exist yet."""
    home = HOMES / peer
    python = home / "bin" / "python"
    if not (home / "installed").exists():
        HOMES.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
        run([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-compile", *packages])
        (home / "installed").touch()
    return python


def run(command: Sequence[Any]) -> str:
    """Return the output of a command; on failure a RuntimeError contains the line that explains it."""
    HOMES.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=LIMIT_S, env=environment, cwd=HOMES, check=False
        )  # the folder for log files of these programs
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"not done within {LIMIT_S} s") from None
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines()]
        telling = [line for line in lines if re.search(r"^(\w+Error|ERROR)\b|failed:", line)]
        raise RuntimeError(telling[-1] if telling else f"exit status {done.returncode}")
    return done.stdout


def ask(python: Path, *program: object) -> Any:
    """Run a program with that Python on one processor and return the JSON on its last line of output."""
    processor = max(os.sched_getaffinity(0))
    printed = run(["taskset", "-c", str(processor), python, *map(str, program)])
    return json.loads(printed.splitlines()[-1])
