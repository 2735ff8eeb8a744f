"""Run the benchmarks: `./dev bench [NAME]` writes the figures of each to out/bench/NAME.json.

lidar   the LiDAR stage against bare Embree and against a bare direct loop
step    whole steps of the vector environments, stage by stage, and their memory
camera  cameras against bare Embree and bare OpenGL, by size, world and backend; capture modes; memory
camera_train  the camera task, which observes the green blob in an image, by train_ppo with five seeds; only if named
pixels_train  the same for the task that observes the image itself; takes half an hour; only if named
learner one update of flockstep.PPO beside Stable-Baselines3's, and what a second thread gains; needs an idle machine
board   the trainings of docs/board.md with five seeds each, also with Stable-Baselines3; only if named, takes hours
flight_train  Hover and Track by Stable-Baselines3, and the controller only; the LiDAR task's policy with rotors
worlds  LiDARs and cameras in every bundled world, and the share of rays traced by Embree
load    time and memory to load files of a million triangles and more
server  round trips of the clients against a bare echo, a remote vector environment, many clients, streams
scaling steps, frames and trainings with 1, 2, 4, ... threads, up to one per processor; only if named
imaging cost of colour detection, HSV and smaller images, in our kernels and in OpenCV
race    steps of Race, with gates that are solid and with gates that are not
bodies  scans, steps and frames among bodies and beside the same solids in the static world; ticks of scripts
contact_groups  steps and scans of drones that sense each other and collide, and of the same drones in separate envs
workers start of a trainer's worker: import, worlds, first scan, step and frame, memory; by spawn, by fork, by pickle
engines steps of DDP, TorchRL's collectors and RLlib with 1, 2, 4, ... processes: rate, time, bytes; only if named
plan    paths from start to goal in every bundled world and twenty of each generator: processor time and length
trainers  the programs of examples/trainers/ with three seeds each: speed, and steps until they solve the LiDAR task
dynamics  rotor flight: the kernel against a bare one, every controller and term, contacts, steps, memory
dynamics_accuracy  errors of rotor flight against double precision, and quality of the controller
dynamics_peers  comparison with other simulators, which pip downloads into out/peers/; only if named
mesh_peers  comparison with other ray casters on the same triangles, also downloaded; only if named

The name of a task whose row in flockstep/trainings/table.py has a bench: its trainings beside flyers without a policy;
only if named.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import bodies
import bundled
import compare_rows
import contact_groups
import dynamics_accuracy
import dynamics_peers
import engines
import flockstep
import imaging
import mesh_peers
import peers
import plan
import scaling
import server
import table
import tasks
import workers
from flockstep import _core
from timing import RUNS, Call, Figure, figure, in_turns, median_ratio, of, timed

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "bench"
SIZES = (1, 16, 256, 1024, 4096, 16384)
DRONES = 1024  # of flights whose costs are compared


def native(name: str, *args: str) -> list[Figure]:
    """Run a C++ benchmark and return the figures it prints."""
    folder = Path(os.environ["FLOCKSTEP_BENCH_DIR"])
    result = subprocess.run([folder / name, *args], check=True, stdout=subprocess.PIPE, text=True)
    figures: list[Figure] = json.loads(result.stdout)
    return figures


def bench_step() -> list[Figure]:
    """Time `DroneVectorEnv.step` of the LiDAR task under random actions, in steady state, including resets.

    The rate is divided by that of a bare Embree LiDAR loop, which only traces: once with triangles
    (`ratio_to_bare_lidar`), and once with analytic geometry, for which Embree calls back the engine's own kernels
    (`ratio_to_bare_analytic_lidar`).
    """
    bare: dict[str, list[float]] = {"direct_": [], "": []}

    def trace() -> float:
        found = {f["name"]: f["value"] for f in native("lidar", "fan")}
        for kind, rates in bare.items():
            rates.append(found[f"lidar/{kind}fan35x1024/bare_embree_scans_per_second"])
        return 0.0

    steps = {n: walled(stepping(n)) for n in SIZES}
    times = in_turns({**steps, "bare": trace, "again": steps[1024]})
    rates = [1024 / statistics.mean(both) for both in zip(times[1024], times["again"], strict=True)]
    figures = [figure(f"step/n{n}/steps_per_second", n / statistics.median(times[n]), "1/s", RUNS) for n in SIZES]
    figures += [
        figure("step/n1024/ratio_to_bare_lidar", median_ratio(rates, bare["direct_"]), "1", RUNS),
        figure("step/n1024/ratio_to_bare_analytic_lidar", median_ratio(rates, bare[""]), "1", RUNS),
        figure("step/n1/microseconds", 1e6 * statistics.median(times[1]), "us", RUNS),
        figure("step/bytes_per_drone", bytes_per_drone(), "B", 1),
    ]
    scans = in_turns({n: walled(compare_rows.measuring(compare_rows.train, n, {}, "auto")(flockstep)) for n in SIZES})
    for n, seconds in scans.items():
        figures.append(figure(f"step/lidar/n{n}/scans_per_second", n / statistics.median(seconds), "1/s", RUNS))
    return figures + worlds_of_their_own() + tasks_in_python() + native("stages")


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
        figure(f"step/worlds{n}/steps_per_second", n / statistics.median(times["apart"]), "1/s", RUNS),
    ]


def stepping(n: int, **settings: Any) -> Call:
    """Return a function that steps the LiDAR task, or another one with the same actions, in steady state."""
    return compare_rows.stepping(n, 1000 if n <= 4096 else 300, **settings)(flockstep)


def tasks_in_python() -> list[Figure]:
    """Compare the LiDAR task with two of the examples, which compute the same in Python."""
    sys.path.append(str(ROOT / "examples"))
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
            us = 1e6 * statistics.median(seconds) / 64
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
        ns = 1e9 * statistics.median(a - b for a, b in zip(more, plain, strict=True)) / DRONES
        ticks = dynamics_peers.TICKS if name.endswith("substep") else 1
        figures.append(figure(f"dynamics/cost/{name}", ns / ticks, "ns", RUNS))
    for name, (n, setup) in contacts.items():
        (seconds,) = in_turns({name: timed(setup(flockstep), 1, 0.05)}, warm_up=True).values()
        ns = 1e9 * statistics.median(seconds) / (n * dynamics_peers.TICKS)
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
            figure(f"dynamics/{name}/ratio_to_substeps", statistics.median(ratios[name]), "1", RUNS),
            figure(f"dynamics/{name}/steps_per_second", statistics.median(rates[name]), "1/s", RUNS),
        ]
    return figures


def bench_trained(name: str) -> list[Figure]:
    import trained  # imports PyTorch, as do the next two

    return trained.measure(name.removesuffix("_train"), OUT / "train")


def bench_board() -> list[Figure]:
    sys.path.append(str(ROOT))
    from training import board

    (OUT / "train").mkdir(parents=True, exist_ok=True)
    return board.main(board.Args(out=OUT / "train"))


def bench_learner() -> list[Figure]:
    """Compare an update of `flockstep.PPO` with Stable-Baselines3's, and one thread with two."""
    import learner

    return of(learner.measure, RUNS)()


#: Programs of examples/trainers/ by the name of their figures, and the format of their last line.
TRAINERS = {
    "sb3": "sb3_ppo.py",
    "cleanrl": "cleanrl_ppo.py",
    "torchrl_gymwrapper": "torchrl_ppo.py",
    "torchrl_gymenv": "torchrl_ppo.py --env gymenv",
    "skrl": "skrl_ppo.py",
    "ddp_1": "torchrun --nproc-per-node 1 ddp_ppo.py",
    "ddp_2": "torchrun --nproc-per-node 2 ddp_ppo.py",
    "torchrl_processes_1": "torchrl_collectors.py --workers 1",
    "torchrl_processes_2": "torchrl_collectors.py --workers 2",
    "torchrl_distributed_1": "torchrl_collectors.py --workers 1 --collector distributed",
    "torchrl_distributed_2": "torchrl_collectors.py --workers 2 --collector distributed",
    "rllib_1": "rllib_ppo.py --runners 1",
    "rllib_2": "rllib_ppo.py --runners 2",
}
TRAINED = re.compile(r"^(\S+ \S+), (\w+): (\d) of 7 playgrounds after ([\d,]+) steps, ([\d,]+) steps/s$", re.MULTILINE)


def bench_trainers() -> list[Figure]:
    """Train from scratch with each program. The programs alternate, so that a busy hour affects all of them."""
    figures = []
    for seed in range(3):
        for name, program in TRAINERS.items():
            words = program.split()
            launcher: list[str] = []
            if words[0] == "torchrun":
                launcher, words = ["-m", "torch.distributed.run", "--standalone", *words[1:-1]], words[-1:]
            script = str(ROOT / "examples" / "trainers" / words[0])
            python = engines.ray_python() if name.startswith("rllib") else sys.executable
            command = [python, *launcher, script, *words[1:], "--seed", str(seed)]
            output = subprocess.run(
                command, check=True, stdout=subprocess.PIPE, text=True, env=engines.environment()
            ).stdout
            ended = TRAINED.search(output)
            assert ended, output
            subject = f"trainers/{name}/seed{seed}"
            steps, rate = (float(ended[i].replace(",", "")) for i in (4, 5))
            found = [
                figure(f"{subject}/steps_per_second", rate, "1/s", 1),
                figure(f"{subject}/steps", steps, "1", 1),
                figure(f"{subject}/seconds", steps / rate, "s", 1),
                figure(f"{subject}/playgrounds", float(ended[3]), "1", 1),
            ]
            figures += [{**f, "program": program, "version": ended[1], "autoreset_mode": ended[2]} for f in found]
    return figures


#: All benchmarks.
BENCHES: dict[str, Callable[[], list[Figure]]] = {
    "lidar": partial(native, "lidar"),
    "step": bench_step,
    "camera": bench_camera,
    "camera_train": partial(bench_trained, "camera_train"),
    "pixels_train": partial(bench_trained, "pixels_train"),
    "flight_train": of(tasks.measure_flights),
    "board": bench_board,
    "trainers": bench_trainers,
    "learner": bench_learner,
    "scaling": of(scaling.measure),
    "load": of(bundled.measure_loading),
    "worlds": of(bundled.measure),
    "imaging": of(imaging.measure),
    "plan": of(plan.measure),
    "race": of(tasks.measure_race),
    "bodies": of(bodies.measure),
    "contact_groups": of(contact_groups.measure),
    **{name: of(tasks.measure, name) for name in tasks.BENCHES},
    "workers": of(workers.measure),
    "engines": of(engines.measure),
    "server": of(server.measure),
    "dynamics": bench_dynamics,
    "dynamics_accuracy": of(dynamics_accuracy.measure),
    "dynamics_peers": dynamics_peers.measure,
    "mesh_peers": mesh_peers.measure,
}
#: Benchmarks that run only if named.
APART = (
    *tasks.BENCHES,
    *("board", "camera_train", "pixels_train", "engines", "scaling", "dynamics_peers", "mesh_peers"),
)


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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"one of {', '.join(BENCHES)}; without one, all but {', '.join(APART)}",
    )
    names = parser.parse_args().names or [name for name in BENCHES if name not in APART]
    for name in names:
        if name not in BENCHES:
            parser.error(f"NAME: expected one of {', '.join(BENCHES)}, got {name!r}")
    for name in names:
        print(f"== {name}")
        measured = {"machine": machine(), "commit": commit(), "commit_date": commit_date()}
        figures = BENCHES[name]()
        if commit() != measured["commit"]:
            sys.exit(
                f"{name}: the checkout changed while it ran, from {measured['commit']} to {commit()}; nothing written"
            )
        OUT.mkdir(parents=True, exist_ok=True)
        result = {**measured, "figures": figures}
        (OUT / f"{name}.json").write_text(table.lines_of(result))
        for f in figures:
            print(f"   {f['name']:55} {f['value']:>12,.6g} {f['unit']}")


if __name__ == "__main__":
    main()
