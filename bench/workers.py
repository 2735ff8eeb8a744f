"""Measures the start of a worker of a distributed trainer: seconds and memory, by the way that it was started.

A worker imports flockstep, loads its worlds, makes a vector environment with a LiDAR, and makes the first scan and the
first step. Then it renders a frame. ``spawnN`` are N new processes that start together and share only files. ``forkN``
are N processes forked from one that has already loaded the worlds and made such environments.
"""

from __future__ import annotations

import json
import multiprocessing
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from timing import Measured

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


def memory(pid: int) -> dict[str, float]:
    """Return a process's memory in MB: all of it, what other processes have too, and its fair share."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    kilobytes = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    in_mb = {name: 1024 * count / 1e6 for name, count in kilobytes.items()}
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


def work(worker: Worker, say: Callable[[str], object], wait: Callable[[], object]) -> None:
    """Start, and wait after each part while the parent reads the memory of this process."""
    worker.begin()
    say(json.dumps(worker.figures))
    wait()
    worker.render()
    say(json.dumps(worker.figures))
    wait()


def read(pids: Sequence[int], lines: Callable[[], Sequence[str]], go_on: Callable[[], object]) -> list[dict[str, Any]]:
    """Let workers start together, and return the figures of each."""
    lines()  # all have reached the same point before their memory is read
    lidar_only = [memory(pid) for pid in pids]
    go_on()
    figures = [json.loads(line) for line in lines()]
    with_camera = [memory(pid) for pid in pids]
    go_on()
    return [
        {**stages, **lidar, **{f"camera_{name}": value for name, value in camera.items()}}
        for stages, lidar, camera in zip(figures, lidar_only, with_camera, strict=True)
    ]


def spawned(case: str, path: str, count: int) -> list[dict[str, Any]]:
    """Start new processes, as `torchrun` does, and return the figures of each."""
    program = [sys.executable, __file__, "--worker", case, path]
    workers = [
        subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(count)
    ]

    def lines() -> list[str]:
        return [worker.stdout.readline() for worker in workers if worker.stdout]

    def go_on() -> None:
        for worker in workers:
            assert worker.stdin
            worker.stdin.write("\n")
            worker.stdin.flush()

    figures = read([worker.pid for worker in workers], lines, go_on)
    for worker in workers:
        worker.communicate()
    return figures


def forked(case: str, path: str, count: int) -> list[dict[str, Any]]:
    """Start a process that loads the worlds and forks workers, and return the figures of each worker."""
    program = [sys.executable, __file__, "--parent", case, path, str(count)]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True)
    figures: list[dict[str, Any]] = json.loads(done.stdout)
    return figures


def fork_here(case: str, path: str, count: int) -> list[dict[str, Any]]:
    """Load the worlds in this process, and fork workers."""
    parent = Worker(case, path)
    parent.begin()
    parent.render()
    worlds = parent._worlds
    del parent  # its environments; the worlds keep what was built from them
    context = multiprocessing.get_context("fork")
    pipes, workers = [], []
    for _ in range(count):
        here, there = context.Pipe()
        worker = context.Process(target=in_child, args=(Worker(case, path, worlds), there))
        worker.start()
        pipes.append(here)
        workers.append(worker)

    def lines() -> list[str]:
        return [pipe.recv() for pipe in pipes]

    def go_on() -> None:
        for pipe in pipes:
            pipe.send("")

    figures = read([worker.pid or 0 for worker in workers], lines, go_on)
    for worker in workers:
        worker.join()
    return figures


def in_child(worker: Worker, pipe: Connection) -> None:
    work(worker, pipe.send, pipe.recv)


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
            for name, start in (("spawn", spawned), ("fork", forked)):
                for count in COUNTS:
                    workers = [worker for _ in range(RUNS) for worker in start(case, path, count)]
                    for figure in workers[0]:
                        unit = "MB" if figure.endswith("_mb") else "s"
                        value = statistics.median(worker[figure] for worker in workers)
                        yield f"workers/{case}/{name}{count}/{figure}", value, unit, RUNS
            yield from pickled(case, path)


if __name__ == "__main__":
    match sys.argv[1:]:
        case "--worker", case, path:
            work(Worker(case, path), lambda line: print(line, flush=True), sys.stdin.readline)
        case "--parent", case, path, count:
            print(json.dumps(fork_here(case, path, int(count))))
