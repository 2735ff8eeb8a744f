"""Run the benchmarks: `./dev bench [NAME]` writes the figures of each to out/bench/NAME.json.

lidar   the LiDAR stage against bare Embree and against a bare direct loop
step    whole steps of the vector environments, stage by stage, and their memory
camera  cameras against bare Embree and bare OpenGL, by size, world and backend; capture modes; memory
train   PPO from scratch with several seeds: speed, and success in unseen playgrounds
camera_train  the same for the camera task, which observes the green blob in an image
pixels_train  the same for the task that observes the image itself; takes half an hour
camera_large  the camera task at 640 x 480; takes half an hour
places_train  the LiDAR task in generated offices and forests
learner one update of flockstep.PPO beside Stable-Baselines3's, and what a second thread gains; needs an idle machine
board   the trainings of docs/board.md with five seeds each, also with Stable-Baselines3; only if named, takes hours
flight_train  Hover and Track by Stable-Baselines3, and the controller only; the LiDAR task's policy with rotors
tiles   tracing rays against triangles, in tiles, as slices and with Embree; only tracing
tiles_avx2  the same for fans, without AVX-512
worlds  LiDARs and cameras in every bundled world, and the share of rays traced by Embree
busy    the trainings of the README and of docs/first-steps.md while every processor runs a busy loop; only if named
server  round trips of the clients against bare echoes, a remote vector environment, many clients, streams
scaling steps, frames and trainings with 1, 2, 4, ... threads, up to one per processor; only if named
imaging cost of colour detection, HSV and smaller images, in our kernels and in OpenCV
race    steps of Race, with gates that are solid and with gates that are not
bodies  scans, steps and frames among bodies and beside the same solids in the static world; ticks of scripts
meetings  steps and scans of drones that see and touch each other, and of the same drones in separate envs
dodge   trainings of Dodge with three seeds among bodies and one without them; only if named
swap    trainings of Swap with three seeds; only if named
formation   trainings of Formation with three seeds; only if named
workers start of a trainer's worker: import, worlds, first scan, step and frame, memory; by spawn, by fork, by pickle
engines steps of DDP, TorchRL's collectors and RLlib with 1, 2, 4, ... processes: rate, time, bytes; only if named
plan    paths from start to goal in every bundled world and twenty of each generator: processor time and length
trainers  the programs of examples/trainers/ with three seeds each: speed, and steps until they solve the LiDAR task
dynamics  rotor flight: the kernel against a bare one, every controller and term, contacts, steps, memory
dynamics_accuracy  errors of rotor flight against double precision, and quality of the controller
dynamics_peers  comparison with other simulators, which pip downloads into out/peers/; only if named
mesh_peers  comparison with other ray casters on the same triangles, also downloaded; only if named
"""

from __future__ import annotations

import argparse
import ast
import itertools
import json
import os
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import bodies
import bundled
import dynamics_accuracy
import dynamics_peers
import engines
import flockstep
import imaging
import meetings
import mesh_peers
import peers
import plan
import scaling
import server
import table
import tasks
import workers
from flockstep import _core

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "bench"
RUNS = 7
SIZES = (1, 16, 256, 1024, 4096, 16384)

Figure = dict[str, Any]


def figure(name: str, value: float, unit: str, runs: int) -> Figure:
    return {"name": name, "value": float(f"{value:.4g}"), "unit": unit, "runs": runs}


def of(measure: Callable[..., Iterable[tuple[str, float, str, int]]], *args: Any) -> Callable[[], list[Figure]]:
    """Return a benchmark whose figures are those that a function measures."""
    return lambda: [figure(*measured) for measured in measure(*args)]


def native(name: str, *args: str) -> list[Figure]:
    """Run a C++ benchmark and return the figures it prints."""
    folder = Path(os.environ["FLOCKSTEP_BENCH_DIR"])
    result = subprocess.run([folder / name, *args], check=True, stdout=subprocess.PIPE, text=True)
    figures: list[Figure] = json.loads(result.stdout)
    return figures


def bench_tiles() -> list[Figure]:
    """Trace triangles in tiles and slices, without the stages before and after."""
    return native("tiles") + steps_with_slices()


def steps_with_slices(n: int = 256) -> list[Figure]:
    """Time whole steps of the LiDAR task in worlds of triangles, with its fan as a slice and through Embree."""
    figures = []
    for name in ("office", "warehouse", "city", "forest"):
        world = getattr(flockstep.World, name)(1)
        slices, embree = stepping(n, worlds=world), stepping(n, worlds=world, tracer="tiles")
        times = [(seconds_per_call(slices), seconds_per_call(embree)) for _ in range(RUNS)]
        ratio = statistics.median(by_embree / as_slice for as_slice, by_embree in times)
        rate = n / statistics.median(as_slice for as_slice, _ in times)
        figures.append(figure(f"tiles/{name}/step/ratio_to_embree_fans", ratio, "1", RUNS))
        figures.append(figure(f"tiles/{name}/step/steps_per_second", rate, "1/s", RUNS))
    return figures


def seconds_per_call(call: Callable[[int], object], at_least_s: float = 0.25) -> float:
    """Time calls until they have lasted long enough; the argument is the index of the call."""
    count = 0
    before = time.perf_counter()
    while (elapsed := time.perf_counter() - before) < at_least_s:
        for _ in range(8):
            call(count)
            count += 1
    return elapsed / count


def bench_step() -> list[Figure]:
    """Time `DroneVectorEnv.step` of the LiDAR task under random actions, in steady state, including resets.

    The rate is divided by that of a bare Embree LiDAR loop, which only traces: once with triangles
    (`ratio_to_bare_lidar`), and once with analytic geometry, for which Embree calls back the engine's own kernels
    (`ratio_to_bare_analytic_lidar`).
    """
    steps = {n: stepping(n) for n in SIZES}
    times: dict[int, list[float]] = {n: [] for n in SIZES}
    ratios, analytic_ratios = [], []
    for _ in range(RUNS):
        for n in SIZES:
            times[n].append(seconds_per_call(steps[n]))
        bare = {f["name"]: f["value"] for f in native("lidar", "fan")}
        again = seconds_per_call(steps[1024])
        rate = 1024 / statistics.mean((times[1024][-1], again))
        ratios.append(rate / bare["lidar/direct_fan35x1024/bare_embree_scans_per_second"])
        analytic_ratios.append(rate / bare["lidar/fan35x1024/bare_embree_scans_per_second"])
    figures = [figure(f"step/n{n}/steps_per_second", n / statistics.median(times[n]), "1/s", RUNS) for n in SIZES]
    figures.append(figure("step/n1024/ratio_to_bare_lidar", statistics.median(ratios), "1", RUNS))
    figures.append(figure("step/n1024/ratio_to_bare_analytic_lidar", statistics.median(analytic_ratios), "1", RUNS))
    figures.append(figure("step/n1/microseconds", 1e6 * statistics.median(times[1]), "us", RUNS))
    figures.append(figure("step/bytes_per_drone", bytes_per_drone(), "B", 1))
    return figures + worlds_of_their_own() + tasks_in_python() + native("stages")


def worlds_of_their_own(n: int = 1024) -> list[Figure]:
    """Compare envs that have one playground each with envs that share one, averaged over some of these playgrounds."""
    worlds = [flockstep.World.playground(seed) for seed in range(n)]
    apart = stepping(n, worlds=worlds)
    shared = [stepping(n, worlds=world) for world in worlds[:: n // 8]]
    ratios, times = [], []
    for _ in range(RUNS):
        together_s = statistics.mean(seconds_per_call(step, 0.1) for step in shared)
        times.append(seconds_per_call(apart))
        ratios.append(together_s / times[-1])
    return [
        figure(f"step/worlds{n}/ratio_to_one_world", statistics.median(ratios), "1", RUNS),
        figure(f"step/worlds{n}/steps_per_second", n / statistics.median(times), "1/s", RUNS),
    ]


def stepping(
    n: int, task: flockstep.Task | None = None, worlds: flockstep.scenes.WorldsLike = "train", tracer: str = "auto"
) -> Callable[[int], object]:
    """Return a function that steps the LiDAR task, or another one with the same actions, in steady state."""
    envs = flockstep.DroneVectorEnv(n, worlds=worlds, task=task, num_threads=1, tracer=tracer)
    envs.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, 6, (64, n))
    for i in range(1000 if n <= 4096 else 300):  # until drones are spread out and episodes end at a steady rate
        envs.step(actions[i % 64])
    return lambda i: envs.step(actions[i % 64])


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
        steps = {name: stepping(n, task) for name, task in tasks.items()}
        times: dict[str, list[float]] = {name: [] for name in steps}
        for _ in range(RUNS):
            for name, step in steps.items():
                times[name].append(seconds_per_call(step))
        for name in ("terms", "numpy"):
            ratio = statistics.median(a / b for a, b in zip(times[name], times["built_in"], strict=True))
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
        figure("camera/bytes_per_64x64_rgb_camera", bytes_per_drone(SMALL_CAMERA, 1 << 14), "B", 1),
    ]


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
        figure("dynamics/bytes_per_drone", bytes_per_drone(FLIGHT, 1 << 16), "B", 1),
    ]


def flown_steps(n: int = dynamics_peers.DRONES) -> list[Figure]:
    """Time steps under body rate commands against the kernel's time for their substeps, in processor time.

    Everything runs on one processor, because two may differ in speed.
    """
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        return flown_steps_here(n)
    finally:
        os.sched_setaffinity(0, before)


def flown_steps_here(n: int) -> list[Figure]:
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates")
    clock = flockstep.ClockConfig(policy_hz=dynamics_peers.POLICY_HZ, physics_hz=dynamics_peers.PHYSICS_HZ)
    room = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-100] * 3, "max": [100] * 3}})
    drone = flockstep.DroneModel.load("kingfisher")
    batch = flockstep.Batch([room], n, drone=drone, dynamics=dynamics, clock=clock, num_threads=1)
    command = np.tile(np.float32([9.81, 0, 0, 0]), (n, 1))
    steps: dict[str, Callable[[], object]] = {"batch_fly": lambda: batch.fly(command)}
    if envs := dynamics_peers.hovering(n):
        actions = [envs.action_space.sample() / 10 for _ in range(64)]
        for i in range(1000):  # until episodes end at a steady rate
            envs.step(actions[i % 64])
        turns = itertools.cycle(actions)
        steps["env_step"] = lambda: envs.step(next(turns))
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

    return trained.measure(name, OUT / "train")


def bench_board() -> list[Figure]:
    sys.path.append(str(ROOT))
    from training import board

    (OUT / "train").mkdir(parents=True, exist_ok=True)
    return board.main(board.Args(out=OUT / "train"))


def bench_learner() -> list[Figure]:
    """Compare an update of `flockstep.PPO` with Stable-Baselines3's, and one thread with two."""
    import learner

    return of(learner.figures, RUNS)()


def bench_load() -> list[Figure]:
    """Load scene files of 65,000 objects: with one shared material, and with one material each."""
    count = 65_000
    places = np.random.default_rng(0).uniform(-500, 500, (count, 3)).round(3).tolist()
    figures = []
    for materials in (1, count):
        scene = {
            "flockstep_scene": 1,
            "materials": {f"m{i}": {"base_color": [0.5, 0.5, 0.5]} for i in range(materials)},
            "spheres": [
                {"center": place, "radius": 0.1, "material": f"m{i % materials}"} for i, place in enumerate(places)
            ],
        }
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.json"
            path.write_text(json.dumps(scene))
            flockstep.World.load(path)
            times = []
            for _ in range(RUNS):
                before = time.perf_counter()
                flockstep.World.load(path)
                times.append(time.perf_counter() - before)
        figures.append(figure(f"load/spheres{count}_materials{materials}/seconds", statistics.median(times), "s", RUNS))
    return figures + [figure(*measured) for measured in bundled.measure_loading()]


def bench_worlds() -> list[Figure]:
    measured = (*bundled.measure(), *bundled.measure_steps(), *bundled.measure_looks())
    return [figure(*each) for each in measured]


FILM = 'flockstep.record("flight.mp4", model, worlds=unseen[0])\n'


def bench_snippet() -> list[Figure]:
    """Run the README's trainings as published, without the film, with five seeds not used to choose them."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    figures = []
    for seed in range(20, 25):
        first = published(blocks[0], {"left}": f'left, "seed": {seed}}}', FILM: ""})
        both = published(first, {"1_000_000, progress_bar=True": "1"}) + blocks[1]
        for subject, text in ((f"snippet/seed{seed}", first), (f"snippet/sb3/seed{seed}", both)):
            before = time.perf_counter()
            output = subprocess.run([sys.executable, "-c", text], check=True, stdout=subprocess.PIPE, text=True).stdout
            seconds = time.perf_counter() - before
            ends = ast.literal_eval(output.splitlines()[-1])
            figures.append(figure(f"{subject}/success_rate", ends["success"], "1", 100))
            figures.append(figure(f"{subject}/seconds", seconds, "s", 1))
    return figures


def published(block: str, changes: dict[str, str]) -> str:
    """Return a block of the README with changes, each of a text that is there once."""
    for old, new in changes.items():
        assert block.count(old) == 1, f"README.md: expected {old} once"
        block = block.replace(old, new)
    return block


BUSY = "while True: pass"


def bench_busy() -> list[Figure]:
    """Run the trainings of the README and of First steps as published, while every processor runs a busy loop."""
    pages = "".join((ROOT / page).read_text() for page in ("README.md", "docs/first-steps.md"))
    blocks = re.findall(r"```python\n(.*?)```", pages, re.DOTALL)
    trainings = [block for block in blocks if "learn(" in block and "import flockstep" in block]
    figures = []
    others = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(os.cpu_count() or 1)]
    try:
        for name, block in zip(("train", "own_task"), trainings, strict=True):
            before, spent = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run([sys.executable, "-c", block], check=True, stdout=subprocess.PIPE, text=True)
            seconds, used = time.perf_counter() - before, resource.getrusage(resource.RUSAGE_CHILDREN)
            processor = used.ru_utime + used.ru_stime - spent.ru_utime - spent.ru_stime
            rates = ast.literal_eval(done.stdout.splitlines()[-1])
            rate = rates["success"] if "success" in rates else statistics.mean(rates.values())
            figures += [
                figure(f"busy/{name}/success_rate", rate, "1", 1),
                figure(f"busy/{name}/seconds", seconds, "s", 1),
                figure(f"busy/{name}/processor_seconds", processor, "s", 1),
            ]
    finally:
        for other in others:
            other.kill()
            other.wait()
    return figures


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
    "train": partial(bench_trained, "train"),
    "camera_train": partial(bench_trained, "camera_train"),
    "pixels_train": partial(bench_trained, "pixels_train"),
    "camera_large": partial(bench_trained, "camera_large"),
    "places_train": partial(bench_trained, "places_train"),
    "flight_train": of(tasks.measure_flights),
    "board": bench_board,
    "trainers": bench_trainers,
    "snippet": bench_snippet,
    "busy": bench_busy,
    "learner": bench_learner,
    "scaling": scaling.measure,
    "load": bench_load,
    "worlds": bench_worlds,
    "imaging": of(imaging.measure),
    "plan": of(plan.measure),
    "race": of(tasks.measure_race),
    "bodies": of(bodies.measure),
    "meetings": of(meetings.measure),
    "dodge": of(tasks.measure, "dodge"),
    "swap": of(tasks.measure, "swap"),
    "formation": of(tasks.measure, "formation"),
    "workers": of(workers.measure),
    "engines": of(engines.measure),
    "server": of(server.measure),
    "tiles": bench_tiles,
    "tiles_avx2": partial(native, "tiles", "all", "fan", "avx2"),
    "dynamics": bench_dynamics,
    "dynamics_accuracy": of(dynamics_accuracy.measure),
    "dynamics_peers": dynamics_peers.measure,
    "mesh_peers": mesh_peers.measure,
}
#: Benchmarks that run only if named.
APART = ("board", "busy", "dodge", "engines", "formation", "scaling", "swap", "dynamics_peers", "mesh_peers")


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
