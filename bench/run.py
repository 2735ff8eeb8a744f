"""What `./dev bench [NAME]` runs: each benchmark writes its figures to out/bench/NAME.json.

lidar   the LiDAR stage against bare Embree and against a bare direct loop
step    a whole step of the vector environment, stage by stage, and its memory
camera  cameras against bare Embree and bare OpenGL, over sizes, worlds and backends; capture modes; memory
train   PPO from scratch, several seeds: speed, and how much of what it has never seen it flies
camera_train  the same of the camera tasks: by what is green in an image, and from its pixels
camera_large  the first of these at 640 x 480; half an hour
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep import _core

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "bench"
RUNS = 7
SIZES = (1, 16, 256, 1024, 4096, 16384)
SEEDS = (0, 1, 2, 3, 4)
CAMERA_SEEDS = (0, 1, 2)

Figure = dict[str, Any]


def figure(name: str, value: float, unit: str, runs: int) -> Figure:
    return {"name": name, "value": float(f"{value:.4g}"), "unit": unit, "runs": runs}


def native(name: str, *args: str) -> list[Figure]:
    """Run a C++ benchmark and return the figures it prints."""
    folder = Path(os.environ["FLOCKSTEP_BENCH_DIR"])
    result = subprocess.run([folder / name, *args], check=True, stdout=subprocess.PIPE, text=True)
    figures: list[Figure] = json.loads(result.stdout)
    return figures


def bench_lidar() -> list[Figure]:
    return native("lidar")


def seconds_per_call(call: Callable[[int], object], at_least_s: float = 0.25) -> float:
    """Time calls until they have lasted long enough; the argument counts them."""
    count = 0
    before = time.perf_counter()
    while (elapsed := time.perf_counter() - before) < at_least_s:
        for _ in range(8):
            call(count)
            count += 1
    return elapsed / count


def bench_step() -> list[Figure]:
    """Time `DroneVectorEnv.step` of the LiDAR task under random actions, from steady state, resets included.

    Its rate is divided by that of a bare Embree LiDAR loop, which does no more than trace: over triangles
    (`ratio_to_bare_lidar`), and over analytic geometry, where Embree calls back the engine's own kernels
    (`ratio_to_bare_analytic_lidar`).
    """
    rng = np.random.default_rng(0)
    steps: dict[int, Callable[[int], object]] = {}
    for n in SIZES:
        envs = flockstep.DroneVectorEnv(n, worlds="train", num_threads=1)
        envs.reset(seed=0)
        actions = rng.integers(0, 6, (64, n))
        steps[n] = lambda i, envs=envs, actions=actions: envs.step(actions[i % 64])
        for i in range(1000 if n <= 4096 else 300):  # until drones are everywhere and episodes end all the time
            steps[n](i)
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
    return figures + native("stages")


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


def bench_camera() -> list[Figure]:
    """Cameras in C++, and the memory of one that writes rgb, 12,288 bytes of which are its frame."""
    return [
        *native("camera"),
        figure("camera/bytes_per_64x64_rgb_camera", bytes_per_drone(SMALL_CAMERA, 1 << 14), "B", 1),
    ]


def bytes_per_drone(make: str = LIDAR_TASK, count: int = 1 << 17) -> float:
    """Return the memory of one more drone of a batch; of the LiDAR task, with its observations in both output slots."""
    code = (
        "import resource, sys, numpy as np, flockstep\n"
        "def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024\n"
        "n = int(sys.argv[1])\n"
        f"def make(n):{make}"
        "small = make(1); before = peak(); large = make(n); print((peak() - before) / n)\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", code, str(count)], check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    return float(output)


def bench_train() -> list[Figure]:
    """Train each seed from scratch; then fly worlds that neither training nor the choice of the best model saw."""
    sys.path.insert(0, str(ROOT / "training"))
    import evaluate
    import tasks
    import train_ppo

    playgrounds = flockstep.scenes.load("train") + flockstep.scenes.load("validation")
    unseen = tasks.Setup().generated(evaluate.UNSEEN_SEED, 100)
    figures, outcomes = [], []
    for seed in SEEDS:
        args = train_ppo.Args(seed=seed, out=OUT / "train" / f"seed{seed}", progress=False)
        if seed == SEEDS[0]:
            print("hyperparameters:", args)
        model, outcome = train_ppo.train(args)
        policy = evaluate.greedy(model)
        flown = evaluate.summary(evaluate.fly(policy, playgrounds))["success_rate"]
        generated = evaluate.summary(evaluate.fly(policy, unseen, 1000))["success_rate"]
        total = outcome.seconds + outcome.evaluation_seconds
        print(f"seed {seed}: {outcome.steps:,} steps, {total:.0f} s, playgrounds {flown:.0%}, unseen {generated:.0%}")
        outcomes.append(outcome)
        figures += [
            figure(f"train/lidar/seed{seed}/seconds", total, "s", 1),
            figure(f"train/lidar/seed{seed}/steps", outcome.steps, "1", 1),
            figure(f"train/lidar/seed{seed}/playgrounds_success_rate", flown, "1", len(playgrounds)),
            figure(f"train/lidar/seed{seed}/unseen_success_rate", generated, "1", len(unseen)),
        ]
    rates = [outcome.steps_per_second for outcome in outcomes]
    figures.append(figure("train/lidar/steps_per_second", statistics.median(rates), "1/s", len(rates)))
    for part in outcomes[0].seconds_by_part:
        shares = [1e6 * o.seconds_by_part[part] / o.steps for o in outcomes]
        name = part.replace(", ", "_").replace(" ", "_")
        figures.append(
            figure(f"train/lidar/microseconds_per_step/{name}", statistics.median(shares), "us", len(shares))
        )
    return figures


def train_camera(name: str, args: Any) -> tuple[Any, list[Figure]]:
    """Train from scratch with `train_ppo.Args`; return its outcome and figures.

    Success is of one flight from each start marker, of 50 from all over each spawn box, and of one flight in each of
    100 generated playgrounds.
    """
    sys.path.insert(0, str(ROOT / "training"))
    import evaluate
    import train_ppo

    args = dataclasses.replace(args, out=OUT / "train" / name.replace("/", "-"), progress=False)
    print("hyperparameters:", args)
    model, outcome = train_ppo.train(args)
    policy, total = evaluate.greedy(model), outcome.seconds + outcome.evaluation_seconds
    figures = [
        figure(f"train/{name}/seconds", total, "s", 1),
        figure(f"train/{name}/steps", outcome.steps, "1", 1),
    ]
    for scenes in args.setup.playgrounds:
        worlds = flockstep.scenes.load(scenes)
        alone = evaluate.fly(policy, worlds, setup=args.setup)
        flights = evaluate.fly(policy, worlds * 50, 1000, setup=args.setup, random_start=True)
        rate, from_start = (evaluate.summary(flown)["success_rate"] for flown in (flights, alone))
        print(f"{name}: {scenes}: from the start {from_start:.0%}, from its surroundings {rate:.1%}")
        key = scenes.replace("-", "_")
        figures.append(figure(f"train/{name}/{key}/success_rate", from_start, "1", len(alone)))
        figures.append(figure(f"train/{name}/{key}/random_start_success_rate", rate, "1", len(flights)))
    unseen = evaluate.fly(policy, args.setup.generated(evaluate.UNSEEN_SEED, 100), 1000, setup=args.setup)
    rate = evaluate.summary(unseen)["success_rate"]
    print(f"{name}: unseen generated playgrounds {rate:.0%}")
    figures.append(figure(f"train/{name}/unseen_success_rate", rate, "1", len(unseen)))
    return outcome, figures


def bench_camera_train() -> list[Figure]:
    """Train the camera tasks: from what is green in the image, and from its pixels."""
    sys.path.insert(0, str(ROOT / "training"))
    import train_ppo

    figures = []
    for task in ("camera", "pixels"):
        defaults = train_ppo.DEFAULTS[task]
        outcomes = []
        for seed in CAMERA_SEEDS if task == "camera" else CAMERA_SEEDS[:1]:
            outcome, its_figures = train_camera(f"{task}/seed{seed}", dataclasses.replace(defaults, seed=seed))
            outcomes.append(outcome)
            figures += its_figures
        rates = [outcome.steps_per_second for outcome in outcomes]
        figures.append(figure(f"train/{task}/steps_per_second", statistics.median(rates), "1/s", len(rates)))
        if defaults.frame_skip > 1:
            flown = [defaults.frame_skip * rate for rate in rates]
            figures.append(figure(f"train/{task}/flown_steps_per_second", statistics.median(flown), "1/s", len(flown)))
    return figures


def bench_camera_large() -> list[Figure]:
    """Train the camera task at the thesis's resolution."""
    sys.path.insert(0, str(ROOT / "training"))
    import train_ppo

    args = dataclasses.replace(train_ppo.DEFAULTS["camera"], width_px=640, evaluation_worlds=20)
    outcome, figures = train_camera("camera/640x480", args)
    return [*figures, figure("train/camera/640x480/steps_per_second", outcome.steps_per_second, "1/s", 1)]


BENCHES: dict[str, Callable[[], list[Figure]]] = {
    "lidar": bench_lidar,
    "step": bench_step,
    "camera": bench_camera,
    "train": bench_train,
    "camera_train": bench_camera_train,
    "camera_large": bench_camera_large,
}


def machine() -> dict[str, Any]:
    """Describe where the figures were measured."""
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


def commit() -> str:
    if shutil.which("git") is None:
        return "unknown"

    def git(*args: str) -> str:
        return subprocess.run(["git", *args], cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True).stdout.strip()

    return git("rev-parse", "HEAD") + ("-dirty" if git("status", "--porcelain", "--untracked-files=no") else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(BENCHES)}; all without one")
    names = parser.parse_args().names or list(BENCHES)
    for name in names:
        if name not in BENCHES:
            parser.error(f"no benchmark {name!r}: there are {', '.join(BENCHES)}")
    for name in names:
        print(f"== {name}")
        figures = BENCHES[name]()
        OUT.mkdir(parents=True, exist_ok=True)
        result = {"machine": machine(), "commit": commit(), "figures": figures}
        (OUT / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n")
        for f in figures:
            print(f"   {f['name']:55} {f['value']:>12,.6g} {f['unit']}")


if __name__ == "__main__":
    main()
