"""Run the benchmarks: `./dev bench [NAME]` writes the figures of each to out/bench/NAME.json; --help lists them."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import compare_rows
import dynamics_peers
import flockstep
import peers
import server
import table
import tasks
from flockstep import _core
from timing import RUNS, Call, Figure, Measured, Median, figure, in_turns, median_ratio, native, timed

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "bench"
sys.path += [str(ROOT), str(ROOT / "examples")]  # for what some benchmarks import when they run
SIZES = (1, 16, 256, 1024, 4096, 16384)
DRONES = 1024  # of flights whose costs are compared


def bench_step() -> list[Figure]:
    """Time `DroneVectorEnv.step` of the LiDAR task under random actions, in steady state, including resets.

    By the same numbers of drones, time scans and images, beside Embree alone and Embree's packets in the engine.
    """
    times = in_turns({n: walled(stepping(n)) for n in SIZES})
    return [
        *(figure(f"step/n{n}/steps_per_second", n / Median(times[n]), "1/s", RUNS) for n in SIZES),
        figure("step/n1/microseconds", 1e6 * Median(times[1]), "us", RUNS),
        figure("step/bytes_per_drone", bytes_per_drone(), "B", 1),
        *native("lidar", "sweep", *SIZES),
        *native("camera", "sweep", *SIZES),
        *worlds_of_their_own(),
        *tasks_in_python(),
    ]


def walled(call: Call) -> Callable[[], float]:
    """Return a timer by the wall clock."""
    return timed(call, 8, 0.25, time.perf_counter)


def worlds_of_their_own(n: int = 1024) -> list[Figure]:
    """Compare envs that have one playground each with envs that share one, averaged over some of these playgrounds."""
    worlds = [flockstep.World.playground(seed) for seed in range(n)]
    shared = [walled(stepping(n, worlds=world)) for world in worlds[:: n // 8]]
    apart = walled(stepping(n, worlds=worlds))
    times = in_turns({"shared": lambda: statistics.mean(timer() for timer in shared), "apart": apart})
    return [
        figure(f"step/worlds{n}/ratio_to_one_world", median_ratio(times["shared"], times["apart"]), "1", RUNS),
        figure(f"step/worlds{n}/steps_per_second", n / Median(times["apart"]), "1/s", RUNS),
    ]


def stepping(n: int, **settings: Any) -> Call:
    """Return a function that steps the LiDAR task, or another one with the same actions, in steady state."""
    return compare_rows.stepping(n, 1000 if n <= 4096 else 300, **settings)(flockstep)


def tasks_in_python() -> list[Figure]:
    """Compare the LiDAR task with two of the examples, which compute the same in Python."""
    import navigation_numpy  # type: ignore[import-not-found]
    import navigation_terms  # type: ignore[import-not-found]

    figures = []
    for n in (64, 1024):
        tasks = {
            "built_in": None,
            "terms": navigation_terms.Navigation(),
            "numpy": navigation_numpy.Navigation(flockstep.NavigationConfig(), flockstep.LidarConfig()),
        }
        times = in_turns({name: walled(stepping(n, task=task)) for name, task in tasks.items()})
        for name in ("terms", "numpy"):
            ratio = median_ratio(times[name], times["built_in"])
            figures.append(figure(f"step/python_task_{name}_n{n}/times_built_in", ratio, "1", RUNS))
    return figures


LIDAR_TASK = """
    lidar, task = flockstep.LidarConfig(), flockstep.NavigationConfig()
    batch = flockstep.Batch(flockstep.scenes.load("train"), n, lidar=lidar, task=task, num_threads=1)
    batch.reset(); batch.step(np.zeros(n, np.int64)); batch.step(np.zeros(n, np.int64)); return batch
"""
SMALL_CAMERA = """
    camera = flockstep.CameraConfig(width_px=64, height_px=64)
    batch = flockstep.Batch(flockstep.scenes.load("camera-train"), n, cameras=[camera], num_threads=1)
    batch.sense(); return batch
"""
#: Everything that a drone can use to fly with simulated rotors.
FLIGHT = """
    wind = flockstep.WindConfig(gusts="dryden")
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="position", ground_effect=True, wind=wind)
    settings = {"clock": flockstep.ClockConfig(policy_hz=100), "dynamics": dynamics, "imu": flockstep.ImuConfig()}
    batch = flockstep.Batch([flockstep.World.load("playground/train-1")], n, num_threads=1, **settings)
    batch.fly(np.ones((n, 4), np.float32)); batch.sense(); return batch
"""


def bench_camera() -> list[Figure]:
    """Measure cameras in C++, and the memory of a camera that writes rgb, of which its frame takes 12,288 bytes."""
    return [
        *native("camera"),
        *capture_modes(),
        figure("camera/bytes_per_64x64_rgb_camera", bytes_per_drone(SMALL_CAMERA, 1 << 14), "B", 1),
    ]


def capture_modes() -> list[Figure]:
    """Measure `Batch.sense` with a camera in each capture mode, for drones at rest and for drones that move."""
    figures = []
    modes = {"every_step": "every_step", "on_movement": "on_movement", "on_demand": "on_demand", "no_camera": None}
    for name, worlds in (("playground", compare_rows.playground), ("hills100k", compare_rows.hills(220))):
        timers = {
            f"{label}/{motion}": timed(compare_rows.capturing(mode, motion == "moving", worlds)(flockstep), 8, 0.03)
            for motion in ("still", "moving")
            for label, mode in modes.items()
        }
        for label, seconds in in_turns(timers, warm_up=True).items():
            us = 1e6 * Median(seconds) / 64
            figures.append(figure(f"camera_modes/{name}/{label}/microseconds_per_drone", us, "us", RUNS))
    return figures


def bytes_per_drone(make: str = LIDAR_TASK, count: int = 1 << 17) -> float:
    """Return a batch's memory per drone; for the LiDAR task, including its observations in both output buffers."""
    code = (
        "import re, sys, numpy as np, flockstep\n"
        # getrusage would include the memory of the parent process
        "def peak(): return 1024 * int(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])\n"
        "n = int(sys.argv[1])\n"
        f"def make(n):{make}"
        "small = make(1); before = peak(); large = make(n); print((peak() - before) / n)\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", code, str(count)], check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    return float(output)


def bench_dynamics() -> list[Figure]:
    """Measure flight in C++, whole steps of it from Python, and the memory of a drone with all features."""
    return [
        *native("dynamics"),
        *flown_steps(),
        *costs(),
        figure("dynamics/bytes_per_drone", bytes_per_drone(FLIGHT, 1 << 16), "B", 1),
    ]


def costs() -> list[Figure]:
    """Measure what gusts, ground effect and an IMU add to `Batch.fly` or `sense`, and ticks near and in contact."""
    fleet = partial(compare_rows.fleet, "position", n=DRONES)
    added = {
        "ground_effect_far_above_ground/ns_per_substep": (fleet(ground_effect=True), fleet()),
        "ground_effect_near_ground/ns_per_substep": (fleet(0.5, ground_effect=True), fleet(0.5)),
        "gusts_Ornstein-Uhlenbeck/ns_per_step": (fleet(wind={"gusts": "ornstein_uhlenbeck"}), fleet()),
        "gusts_Dryden/ns_per_step": (fleet(wind={"gusts": "dryden"}), fleet()),
        "IMU/ns_per_reading": (fleet(imu=True), fleet(senses=True)),
    }
    contacts = {
        "in_the_open": (DRONES, fleet()),
        "5_cm_above_a_floor": (DRONES, fleet(0.11)),  # of the centre
        **{f"pressed_to_a_floor,_{way}": (256, compare_rows.pressed(way)) for way in ("terminate", "stop", "bounce")},
        **{f"pressed_into_a_corner,_{way}": (64, compare_rows.cornered(way)) for way in ("stop", "bounce")},
        **{f"deep_inside_a_pillar,_{way}": (64, compare_rows.inside_pillar(way)) for way in ("stop", "bounce")},
    }
    figures = []
    for name, setups in added.items():
        timers = {i: timed(setup(flockstep), 8, 0.05) for i, setup in enumerate(setups)}
        more, plain = in_turns(timers, warm_up=True).values()
        ns = 1e9 * Median(a - b for a, b in zip(more, plain, strict=True)) / DRONES
        ticks = dynamics_peers.TICKS if name.endswith("substep") else 1
        figures.append(figure(f"dynamics/cost/{name}", ns / ticks, "ns", RUNS))
    for name, (n, setup) in contacts.items():
        (seconds,) = in_turns({name: timed(setup(flockstep), 1, 0.05)}, warm_up=True).values()
        ns = 1e9 * Median(seconds) / (n * dynamics_peers.TICKS)
        figures.append(figure(f"dynamics/contact/{name}/ns_per_substep", ns, "ns", RUNS))
    return figures


@server.pinned()  # two processors may differ in speed
def flown_steps(n: int = dynamics_peers.DRONES) -> list[Figure]:
    """Time steps under body rate commands against the kernel's time for their substeps, in processor time."""
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates")
    clock = flockstep.ClockConfig(policy_hz=dynamics_peers.POLICY_HZ, physics_hz=dynamics_peers.PHYSICS_HZ)
    room = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-100] * 3, "max": [100] * 3}})
    drone = flockstep.DroneModel.load("kingfisher")
    batch = flockstep.Batch([room], n, drone=drone, dynamics=dynamics, clock=clock, num_threads=1)
    command = np.tile(np.float32([9.81, 0, 0, 0]), (n, 1))
    steps: dict[str, Call] = {"batch_fly": lambda: batch.fly(command)}
    steps["env_step"] = compare_rows.stepped(dynamics_peers.hovering(n), 1000, 0.1)
    rates: dict[str, list[float]] = {name: [] for name in steps}
    ratios: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(RUNS):
        kernel = 1e6 * native("dynamics", "rates")[0]["value"]  # substeps per second
        for name, step in steps.items():
            rates[name].append(peers.rate(step, n, runs=1))
            ratios[name].append(kernel / (dynamics_peers.TICKS * rates[name][-1]))
    figures = []
    for name in steps:
        figures += [
            figure(f"dynamics/{name}/ratio_to_substeps", Median(ratios[name]), "1", RUNS),
            figure(f"dynamics/{name}/steps_per_second", Median(rates[name]), "1/s", RUNS),
        ]
    return figures


def bench_board() -> list[Figure]:
    from training import board  # imports PyTorch

    return board.main(board.Args(out=OUT / "train"))


class Bench(NamedTuple):
    """A benchmark: what it measures, and by a function of this file or of a module, which is `measure` by default."""

    what: str
    by: Callable[[], Iterable[Measured | Figure]] | str
    is_apart: bool = False

    def figures(self) -> list[Figure]:
        if isinstance(self.by, str):
            module, _, function = self.by.partition(":")
            measured = getattr(importlib.import_module(module), function or "measure")()
        else:
            measured = self.by()
        return [figure(*each) if isinstance(each, tuple) else each for each in measured]


#: Benchmarks by name. Those apart, which take hours, or download other programs, run only if named.
BENCHES = {
    "lidar": Bench("the LiDAR stage beside Embree alone and beside a direct loop", partial(native, "lidar")),
    "step": Bench("steps, scans and images by number of drones; memory of a step", bench_step),
    "camera": Bench("cameras beside Embree alone, by size, world and backend; capture modes; memory", bench_camera),
    "pixels_train": Bench("the task that observes the image, by train_ppo, five seeds", "trained:pixels", True),
    "lidar_by_rotors": Bench("a policy of the LiDAR task, flown with and without rotors", "trained:by_rotors"),
    "board": Bench("trainings of docs/results/board.md, five seeds each, also by Stable-Baselines3", bench_board, True),
    "trainers": Bench("the programs of examples/trainers/: speed, and steps until they solve", "engines:train"),
    "learner": Bench("an update of flockstep.PPO beside Stable-Baselines3's; needs an idle machine", "learner"),
    "scaling": Bench("steps, images and trainings by number of threads, up to the processors", "scaling", True),
    "load": Bench("time and memory to load files of a million triangles and more", "bundled:measure_loading"),
    "worlds": Bench("LiDARs and cameras in every bundled world, and their share of Embree", "bundled"),
    "imaging": Bench("colour detection, HSV and smaller images, in our kernels and in OpenCV", "imaging"),
    "plan": Bench("paths in every bundled world and twenty of each generator: time and length", "plan"),
    "raptor": Bench("the policy RAPTOR and ours on the same throws", "raptor", True),
    "export": Bench("policies as C on Cortex-M4 and M7 in QEMU: error, size, instructions", "export", True),
    "transfer": Bench(
        "our policies in other simulators, and their controllers here; also downloaded", "transfer", True
    ),
    "reality": Bench("fits of real flights, which are in FLOCKSTEP_REAL_FLIGHTS", "peers.real_flights", True),
    "variations": Bench("steps with drones that differ beside drones alike; memory", "variations"),
    "rotors_varied": Bench("two trainings with drones that differ and without", "tasks:measure_varied", True),
    "sensor_errors": Bench(
        "race and LiDAR by rotors, with exact and with erring sensors", "tasks:measure_erring", True
    ),
    "depth_errors": Bench("the forest, with exact and with erring depth", "tasks:measure_erring_depth", True),
    "depth_errors_fast": Bench("the same at 8.5 m/s", "tasks:measure_erring_depth_fast", True),
    "race": Bench("steps of Race, with gates that are solid and with gates that are not", "tasks:measure_race"),
    "bodies": Bench("scans, steps and images among bodies, and beside the same static solids; scripts", "bodies"),
    "contact_groups": Bench("steps of drones that sense each other and collide", "contact_groups"),
    "workers": Bench("start of a trainer's worker by spawn, fork and pickle: time by stage, memory", "workers"),
    "engines": Bench("steps of DDP, TorchRL's collectors and RLlib by number of processes", "engines", True),
    "server": Bench("round trips beside an echo, a remote vector env, streams", "server"),
    "viewer": Bench("recordings, and their page in Chromium; needs Playwright and Chromium", "browser.viewer", True),
    "dynamics": Bench("rotor flight: kernel, controllers, terms, contacts, steps, memory", bench_dynamics),
    "dynamics_accuracy": Bench("errors of rotor flight against double precision", "dynamics_accuracy"),
    "dynamics_peers": Bench("other simulators, which pip downloads into out/peers/", "dynamics_peers", True),
    "mesh_peers": Bench("other ray casters on the same triangles, also downloaded", "mesh_peers", True),
    **{
        name: Bench(
            f"trainings of {', '.join(rows)} beside flyers without a policy", partial(tasks.measure, name), True
        )
        for name, rows in tasks.BENCHES.items()
    },
}


def machine() -> dict[str, Any]:
    """Describe the machine that measures."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        cpu = next(
            (line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if "model name" in line), cpu
        )
    return {
        "cpu": cpu,
        "logical_processors": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "embree": _core.embree_version,
        "simd": _core.simd_target,
    }


def git(*args: str) -> str:
    return subprocess.run(["git", *args], cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True).stdout.strip()


def commit() -> str:
    if shutil.which("git") is None:
        return "unknown"
    return git("rev-parse", "HEAD") + ("-dirty" if git("status", "--porcelain", "--untracked-files=no") else "")


def commit_date() -> str:
    return git("show", "-s", "--format=%cs", "HEAD") if shutil.which("git") else "unknown"


def main() -> None:
    listed = "\n".join(f"{name:18}{each.what}{' (only if named)' * each.is_apart}" for name, each in BENCHES.items())
    parser = argparse.ArgumentParser(
        description=f"{__doc__}\n\n{listed}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all but those only if named")
    names = parser.parse_args().names or [name for name, each in BENCHES.items() if not each.is_apart]
    for name in names:
        if name not in BENCHES:
            parser.error(f"NAME: expected one of {', '.join(BENCHES)}, got {name!r}")
    OUT.mkdir(parents=True, exist_ok=True)
    for name in names:
        print(f"== {name}")
        measured = {"machine": machine(), "commit": commit(), "commit_date": commit_date()}
        figures = BENCHES[name].figures()
        if commit() != measured["commit"]:
            sys.exit(
                f"{name}: the checkout changed while it ran, from {measured['commit']} to {commit()}; nothing written"
            )
        (OUT / f"{name}.json").write_text(table.lines_of({**measured, "figures": figures}))
        for f in figures:
            print(f"   {f['name']:55} {f['value']:>12,.6g} {f['unit']}")


if __name__ == "__main__":
    main()
