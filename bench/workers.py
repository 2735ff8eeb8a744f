"""Measures the start of a worker of a distributed trainer: seconds and memory, by the way that it was started.

A worker imports flockstep, loads its worlds, makes a vector environment with a LiDAR, and makes the first scan and the
first step. Then it renders a frame. ``spawnN`` are N new processes that start together and share only files. ``forkN``
are N processes forked from one that has already loaded the worlds and made such environments.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from timing import Measured, Median

RUNS = 3
NUM_ENVS = 64
COUNTS = (1, 2)  # workers at once
PLAYGROUNDS = 1000  # of the LiDAR training of flockstep.trainings
SCANS = {"scan2M": 0, "scan2M_8k": 8192}  # side of the texture in pixels; 0: no texture
ROWS = 1001  # vertices along a side of a scan
CASES = ("playground", "playgrounds1000", "city", *SCANS)


class Worker:
    """One start, stage by stage."""

    def __init__(self, case: str, path: str, worlds: list[Any] | None = None) -> None:
        self.figures: dict[str, float] = {}
        self._case, self._path, self._worlds = case, path, worlds

    def begin(self) -> None:
        """Do everything up to the first step."""
        self._time("import", self._import)
        if self._worlds is None:
            self._worlds = self._time("world", self._load)
        envs = self._time("make", self._make)
        self._time("first_scan", lambda: envs.reset(seed=0))
        self._time("first_step", lambda: envs.step(envs.action_space.sample()))
        self._kept = [envs]

    def render(self) -> None:
        """Render the first frame."""
        self._kept.append(self._time("first_frame", self._frame))

    def _time(self, stage: str, call: Callable[[], Any]) -> Any:
        wall, processor = time.perf_counter(), time.process_time()
        result = call()
        self.figures[f"{stage}_s"] = time.perf_counter() - wall
        self.figures[f"{stage}_cpu_s"] = time.process_time() - processor
        return result

    def _import(self) -> None:
        import flockstep  # noqa: F401

    def _load(self) -> list[Any]:
        import flockstep

        if self._case == "playgrounds1000":
            return [flockstep.World.playground(seed) for seed in range(PLAYGROUNDS)]
        return flockstep.scenes.load(self._path)

    def _make(self) -> Any:
        import flockstep

        return flockstep.DroneVectorEnv(NUM_ENVS, worlds=self._worlds, num_threads=1)

    def _frame(self) -> Any:
        import flockstep

        assert self._worlds is not None
        camera = flockstep.CameraConfig(width_px=64, height_px=64)
        batch = flockstep.Batch([self._worlds[0]], NUM_ENVS, cameras=[camera], num_threads=1)
        batch.set_pose([self._worlds[0].start] * NUM_ENVS)
        batch.sense()
        return batch


def memory() -> dict[str, float]:
    """Return this process's memory in MB: all of it, what other processes have too, and its fair share."""
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()[1:]
    in_mb = {line.split(":")[0]: 1024 * int(line.split()[1]) / 1e6 for line in lines}
    shared = in_mb["Shared_Clean"] + in_mb["Shared_Dirty"]
    return {"resident_mb": in_mb["Rss"], "shared_mb": shared, "proportional_mb": in_mb["Pss"]}


def source(case: str, folder: Path) -> str:
    """Return the name or the path of a case's world. Writes the file if there is none yet."""
    if case not in SCANS:
        return {"playground": "playground/train-1", "city": "outdoor/city"}.get(case, "")
    path = folder / f"{case}.glb"
    if not path.exists():
        import bundled

        bundled.ground(ROWS, SCANS[case], path, start=(0, 0, 8), goal=(10, 0, 8))
    return str(path)


# --- starting workers


def work(worker: Worker, gates: Sequence[int]) -> None:
    """Start, and read this process's memory after each part, while all workers are at the same point."""
    found: dict[str, float] = {}
    waits = iter(gates)
    for part, prefix in ((worker.begin, ""), (worker.render, "camera_")):
        part()
        wait(next(waits))
        found |= {prefix + name: value for name, value in memory().items()}
        wait(next(waits))
    say(json.dumps(worker.figures | found))


def wait(gate: int) -> None:
    """Wait until all workers are at a gate, the end of a pipe whose other end is closed then."""
    say("")
    os.read(gate, 1)


def say(line: str) -> None:
    """Print a line at once, so that those of several processes do not mix."""
    os.write(1, f"{line}\n".encode())


def started(case: str, path: str, processes: int, forks: int) -> list[dict[str, Any]]:
    """Start processes, as `torchrun` does, and return the figures of their workers: themselves, or their forks."""
    gates = [os.pipe() for _ in range(4)]
    output, printed = os.pipe()
    waits = [wait for wait, _ in gates]
    program = [sys.executable, __file__, case, path, *map(str, (forks, *waits))]
    running = [subprocess.Popen(program, stdout=printed, pass_fds=waits) for _ in range(processes)]
    for end in (printed, *waits):
        os.close(end)
    workers = range(processes * max(forks, 1))
    with os.fdopen(output) as lines:
        for _, gate in gates:
            assert all(lines.readline() for _ in workers)
            os.close(gate)
        figures = [json.loads(lines.readline()) for _ in workers]
    for process in running:
        process.wait()
    return figures


def fork(case: str, path: str, count: int, gates: Sequence[int]) -> None:
    """Load the worlds in this process, and fork workers."""
    parent = Worker(case, path)
    parent.begin()
    parent.render()
    worlds = parent._worlds
    del parent  # its environments; the worlds keep what was built from them
    for _ in range(count):
        if os.fork() == 0:
            work(Worker(case, path, worlds), gates)
            os._exit(0)
    for _ in range(count):
        os.wait()


# --- figures


def pickled(case: str, path: str) -> Iterator[Measured]:
    """Measure what it costs to send the worlds to a worker by pickling, as trainers do with objects."""
    worlds = Worker(case, path)._load()
    before = time.process_time()
    text = pickle.dumps(worlds)
    between = time.process_time()
    pickle.loads(text)
    yield f"workers/{case}/pickle/dump_cpu_s", between - before, "s", 1
    yield f"workers/{case}/pickle/load_cpu_s", time.process_time() - between, "s", 1
    yield f"workers/{case}/pickle/size_mb", len(text) / 1e6, "MB", 1


def measure() -> Iterator[Measured]:
    """Measure every case with 1 and 2 workers that are spawned or forked; medians of the workers of all runs."""
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            path = source(case, Path(folder))
            for name in ("spawn", "fork"):
                for count in COUNTS:
                    processes, forks = (count, 0) if name == "spawn" else (1, count)
                    workers = [worker for _ in range(RUNS) for worker in started(case, path, processes, forks)]
                    for figure in workers[0]:
                        unit = "MB" if figure.endswith("_mb") else "s"
                        value = Median(worker[figure] for worker in workers)
                        yield f"workers/{case}/{name}{count}/{figure}", value, unit, RUNS
            yield from pickled(case, path)


if __name__ == "__main__":
    case, path, forks, *waits = sys.argv[1:]
    if int(forks):
        fork(case, path, int(forks), [*map(int, waits)])
    else:
        work(Worker(case, path), [*map(int, waits)])
