"""What `./dev bench --against DIR [NAME...]` runs: the speed of this checkout over that of another one, row by row.

step    whole steps of the vector environments, and of the navigation task written in NumPy
lidar   scans of primitives, of a forest and of triangles
camera  pictures by both backends, and what a camera costs that has nothing to do
stages  the C++ benchmark of that name, stage by stage; only where it is asked for, since it does not time as finely

DIR is a checkout whose .venv has its package installed, under whatever name its pyproject.toml says. For `stages` its
C++ benchmarks are built too.

Each repeat starts a process in either checkout, with its own Python. Both prepare the same row, then take turns in
slices of some hundredths of a second: this, other, other, this, and so on, so that whatever else the machine does hits
both alike. What is timed is the processor time of all threads of the process, which other programs change little. A
repeat's ratio is the median over its pairs of slices; higher is better, and above 1 this checkout is the faster one.

The exit status is 1 if the geometric mean over the rows is less than 0.99, or if a row is less than 0.95 in every
repeat, and 2 if a row cannot be run.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import re
import statistics
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PAIRS = 24  # of slices, a row and repeat
SLICE_S = 0.025
LEAST_MEAN, LEAST_ROW = 0.99, 0.95
DEFAULT_NAMES = ("step", "lidar", "camera")
SECONDS = {"ns": 1e-9, "us": 1e-6, "s": 1.0}

Call = Callable[[], object]
Setup = Callable[[Any], Call]  # of the imported package; what it returns is timed

# ------------------------------------------------------------------------------------ rows, run in either checkout


def stepping(n: int, observation: str = "goal", warm_up: int = 300) -> Setup:
    def setup(package: Any) -> Call:
        worlds = "train" if observation == "goal" else "camera-train"
        return stepped(package.DroneVectorEnv(n, worlds=worlds, observation=observation, num_threads=1), warm_up)

    return setup


def numpy_task(package: Any) -> Call:
    """Step examples/navigation_numpy.py."""
    sys.path.insert(0, str(Path.cwd() / "examples"))
    navigation = importlib.import_module("navigation_numpy")
    task = navigation.Navigation(package.NavigationConfig(), package.LidarConfig())
    return stepped(package.DroneVectorEnv(1024, worlds="train", task=task, num_threads=1), 100)


def stepped(envs: Any, warm_up: int) -> Call:
    envs.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, envs.single_action_space.n, (64, envs.num_envs))
    count = 0

    def step() -> None:
        nonlocal count
        envs.step(actions[count % 64])
        count += 1

    for _ in range(warm_up):  # until drones are everywhere and episodes end all the time
        step()
    return step


def free_positions(world: Any, count: int) -> Any:
    """Return places with half a metre of room in each of 14 directions, (count, 3) m."""
    rng = np.random.default_rng(1)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    directions = np.concatenate([np.eye(3, dtype=np.float32), -np.eye(3, dtype=np.float32), corners])
    found: list[Any] = []
    while len(found) < count:
        points = rng.uniform(world.bounds[0], world.bounds[1], (256, 3)).astype(np.float32)
        hits = world.raycast(np.repeat(points, len(directions), axis=0), np.tile(directions, (len(points), 1)), 100.0)
        found.extend(points[hits["t_hit"].reshape(len(points), -1).min(axis=1) > 0.5])
    return np.array(found[:count])


def pose_drones(batch: Any, worlds: list[Any], turned: bool) -> Any:
    n = batch.num_drones
    position = np.zeros((n, 3), np.float32)
    for i, world in enumerate(worlds):
        position[i :: len(worlds)] = free_positions(world, len(range(i, n, len(worlds))))
    half_yaw = np.random.default_rng(2).uniform(0, math.pi, n) if turned else np.zeros(n)
    quat_wxyz = np.stack([np.cos(half_yaw), 0 * half_yaw, 0 * half_yaw, np.sin(half_yaw)], axis=1).astype(np.float32)
    batch.set_pose(position, quat_wxyz)
    return position


def scene(package: Any, **fields: Any) -> Any:
    return package.World.from_dict({f"{package.__name__}_scene": 1, **fields})


def train(package: Any) -> list[Any]:
    return list(package.scenes.load("train"))


def playground(package: Any) -> list[Any]:
    return list(package.scenes.load("playground/camera-train-1"))


def forest(package: Any) -> list[Any]:
    rng = np.random.default_rng(1)
    pillars = [{"center": center.tolist(), "radius": 0.25} for center in rng.uniform(-100, 100, (5000, 2))]
    return [scene(package, room={"min": [-100, -100, -2.5], "max": [100, 100, 2.5]}, pillars=pillars)]


def hills(cells: int) -> Callable[[Any], list[Any]]:
    """Return a maker of a mesh of 2 * cells**2 triangles, with a thin spike for every 75 cells."""

    def make(package: Any) -> list[Any]:
        side = 0.3 * cells + 14
        x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(0, side, cells + 1)]))
        z = 1.2 * np.sin(0.21 * x) * np.cos(0.17 * y) + 0.4 * np.sin(0.9 * x + 0.5 * y) + 0.15 * np.sin(2.3 * y)
        spikes = np.random.default_rng(1).integers(0, len(x), cells * cells // 75 + 1)
        z[spikes] += 3.5
        corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
        lower = np.stack([corner, corner + 1, corner + cells + 2], axis=1)
        upper = np.stack([corner, corner + cells + 2, corner + cells + 1], axis=1)
        mesh = {
            "vertices": np.stack([x, y, z], axis=1).tolist(),
            "triangles": np.concatenate([lower, upper]).tolist(),
        }
        return [scene(package, meshes=[mesh])]

    return make


def scanning(make_worlds: Callable[[Any], list[Any]], n: int, **lidar: Any) -> Setup:
    def setup(package: Any) -> Call:
        worlds = make_worlds(package)
        batch = package.Batch(worlds, n, lidar=package.LidarConfig(**lidar), num_threads=1)
        pose_drones(batch, worlds, turned=False)
        sense: Call = batch.sense
        return sense

    return setup


def drawing(backend: str, make_worlds: Callable[[Any], list[Any]], width: int, height: int, n: int) -> Setup:
    def setup(package: Any) -> Call:
        worlds = make_worlds(package)
        camera = package.CameraConfig(width_px=width, height_px=height, outputs=["rgb", "depth"])
        batch = package.Batch(worlds, n, cameras=[camera], camera_backend=backend, num_threads=1)
        pose_drones(batch, worlds, turned=True)
        capture: Call = batch.capture
        return capture

    return setup


def capturing(mode: str, moving: bool) -> Setup:
    def setup(package: Any) -> Call:
        worlds = playground(package)
        camera = package.CameraConfig(width_px=64, height_px=64, outputs=["rgb", "depth"], capture_mode=mode)
        batch = package.Batch(worlds, 64, cameras=[camera], num_threads=1)
        position = pose_drones(batch, worlds, turned=True)
        positions = [position, position + np.array([0, 0, 0.01], np.float32)]

        def sense() -> None:
            if moving:
                positions.reverse()
                batch.set_pose(positions[0])
            batch.sense()

        return sense

    return setup


GRID = {"channels": 16, "beams": 360, "hfov_deg": 360, "vfov_deg": 30, "max_range_m": 30}

ROWS: dict[str, Setup] = {
    **{f"step/n{n}": stepping(n, warm_up=500 if n < 4096 else 200) for n in (1, 16, 256, 1024, 4096)},
    "step/camera_n64": stepping(64, "blob"),
    "step/numpy_task_n1024": numpy_task,
    "lidar/fan35x1024": scanning(train, 1024),
    "lidar/grid16x360x64": scanning(train, 64, **GRID),
    "lidar/forest_fan35x1024": scanning(forest, 1024),
    "lidar/mesh_fan35x1024": scanning(hills(40), 1024),
    "lidar/mesh_grid16x360x16": scanning(hills(40), 16, **GRID),
    "camera/raycast/playground/64x64x64": drawing("raycast", playground, 64, 64, 64),
    "camera/raycast/playground/640x480x2": drawing("raycast", playground, 640, 480, 2),
    "camera/raycast/mesh1k/64x64x16": drawing("raycast", hills(22), 64, 64, 16),
    "camera/raycast/mesh100k/64x64x16": drawing("raycast", hills(220), 64, 64, 16),
    "camera/raycast/mesh1k/640x480x1": drawing("raycast", hills(22), 640, 480, 1),
    "camera/gl/playground/64x64x64": drawing("gl", playground, 64, 64, 64),
    "camera/gl/mesh1k/64x64x64": drawing("gl", hills(22), 64, 64, 64),
    "camera/modes/on_movement/still": capturing("on_movement", moving=False),
    "camera/modes/on_demand/moving": capturing("on_demand", moving=True),
}


def work(package_name: str) -> None:
    """Answer one JSON line with another: "prepare" a row, or time `count` calls of what was prepared."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what is printed otherwise is no answer
    package = importlib.import_module(package_name)
    call: Call | None = None
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if "prepare" in request:
                call = None  # its memory first
                call = ROWS[request["prepare"]](package)
                call()
            assert call is not None
            before = time.process_time()
            for _ in range(request.get("count", 1)):
                call()
            answer: dict[str, Any] = {"seconds": time.process_time() - before}
        except Exception:
            answer = {"error": traceback.format_exc()}
        answers.write(json.dumps(answer) + "\n")


# ---------------------------------------------------------------------------------------------- what compares them


class CannotRunError(Exception):
    """A row that one of the checkouts cannot run."""


class Checkout:
    """A checkout, and while it is entered a process of its Python that runs rows."""

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
        self.process.communicate()  # ends its input

    def send(self, **request: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()

    def seconds(self) -> float:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        answer = json.loads(line) if line else {"error": "its process has ended"}
        if "error" in answer:
            raise CannotRunError(f"{self.root}: {answer['error']}")
        return float(answer["seconds"])

    def time(self, count: int) -> float:
        self.send(count=count)
        return self.seconds()

    def stages(self) -> dict[str, float]:
        """Run the C++ benchmark; return the times it prints, in seconds."""
        program = self.root / "build" / "release" / "bench" / "stages"
        if not program.exists():
            raise CannotRunError(f"{program}: not built (cmake -D{self.package.upper()}_BENCH=ON there)")
        output = subprocess.run([program], check=True, stdout=subprocess.PIPE, text=True).stdout
        return {f["name"]: f["value"] * SECONDS[f["unit"]] for f in json.loads(output) if f["unit"] in SECONDS}


def row_ratio(this: Checkout, other: Checkout, row: str) -> float:
    for checkout in (this, other):
        checkout.send(prepare=row)
    once = min(checkout.seconds() for checkout in (this, other))
    few = max(1, round(0.2 * SLICE_S / max(once, 1e-7)))
    count = max(1, round(SLICE_S * few / max(this.time(few), 1e-7)))
    ratios = []
    for pair in range(PAIRS):
        order = (this, other) if pair % 2 == 0 else (other, this)
        took = {checkout: checkout.time(count) for checkout in order}
        ratios.append(took[other] / took[this])
    return statistics.median(ratios)


def repeat(this: Checkout, other: Checkout, names: list[str], failures: dict[str, str]) -> Iterator[tuple[str, float]]:
    """Yield each row's ratio; rows that cannot run go to `failures`."""
    with this, other:
        for row in ROWS:
            if row.split("/")[0] not in names or row in failures:
                continue
            try:
                yield row, row_ratio(this, other, row)
            except CannotRunError as error:
                failures[row] = str(error)
    if "stages" in names:
        try:
            runs = [checkout.stages() for checkout in (this, other, other, this)]
        except CannotRunError as error:
            failures["stages"] = str(error)
            return
        for row in runs[0]:
            if row in runs[1]:
                yield f"stages/{row}", (runs[1][row] + runs[2][row]) / (runs[0][row] + runs[3][row])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="step, lidar, camera or stages; the first 3 if none is given"
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="the other checkout")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        work(args.worker)
        return 0
    names = args.names or list(DEFAULT_NAMES)
    for name in names:
        if name not in (*DEFAULT_NAMES, "stages"):
            parser.error(f"no comparison {name!r}: there are {', '.join(DEFAULT_NAMES)} and stages")
    if args.against is None or args.repeats < 1:
        parser.error("--against DIR is needed, and at least one repeat")
    this, other = Checkout(ROOT), Checkout(args.against.resolve())
    ratios: dict[str, list[float]] = {}
    failures: dict[str, str] = {}
    for number in range(args.repeats):
        for row, ratio in repeat(this, other, names, failures):
            ratios.setdefault(row, []).append(ratio)
            print(f"   repeat {number + 1}: {row:45} {ratio:6.3f}", file=sys.stderr)
    print(f"speed of {this.root} over that of {other.root}; above 1 the former is faster")
    print(f"   {'row':45} {'  repeats' + ' ' * (7 * args.repeats - 9)}  median")
    for row, values in ratios.items():
        slow = "  slower in every repeat" if max(values) < LEAST_ROW else ""
        print(f"   {row:45} {' '.join(f'{v:6.3f}' for v in values)}  {statistics.median(values):6.3f}{slow}")
    for row, why in failures.items():
        print(f"   {row}: cannot be run: {why}")
    if not ratios:
        return 2
    mean = math.exp(statistics.mean(math.log(statistics.median(values)) for values in ratios.values()))
    print(f"   geometric mean over {len(ratios)} rows: {mean:.3f}")
    if failures:
        return 2
    return 1 if mean < LEAST_MEAN or any(max(values) < LEAST_ROW for values in ratios.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
