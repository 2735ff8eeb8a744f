"""Cost of a step on several engines, and trainings by other trainers' programs, for two pages of docs/how-to/train/.

Each process flies 256 drones, so that more processes fly more drones. The programs of examples/trainers/ run for a few
updates, without their evaluation flights. Time and bytes are counted between updates, over all processes of the
machine, which should be idle otherwise. The bytes are those of the loopback device: DDP and TorchRL send through it,
and so does RLlib, whose runners are on another node than its learner.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from timing import Figure, Measured, Median, figure

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = ROOT / "examples" / "trainers"
RAY = ROOT / "build" / "ray" / "bin" / "python"  # `./dev test ray` makes it

RUNS = 3
UPDATES, WARM = 8, 2  # of a run; those that are not counted
STEPS = 64 * 256  # of each process between two updates
ENGINES = ("ddp", "torchrl_processes", "torchrl_distributed", "rllib")


def counts() -> list[int]:
    """Return the numbers of processes that are measured: powers of two, up to the processors of the machine."""
    processors = os.cpu_count() or 1
    return [1 << k for k in range(processors.bit_length()) if 1 << k <= processors]


# --- within a program


def read() -> dict[str, float]:
    """Return the time, the processor time of this process and of the machine, and the bytes sent by loopback."""
    ticks = [int(word) for word in Path("/proc/stat").read_text().split()[1:8]]
    busy = sum(ticks) - ticks[3] - ticks[4]  # without idle and iowait
    own = resource.getrusage(resource.RUSAGE_SELF)
    loopback = next(line for line in Path("/proc/net/dev").read_text().splitlines() if line.strip().startswith("lo:"))
    return {
        "seconds": time.time(),
        "all_cpu_s": busy / os.sysconf("SC_CLK_TCK"),
        "main_cpu_s": own.ru_utime + own.ru_stime,
        "bytes": float(loopback.split(":")[1].split()[0]),
    }


def run_inside(engine: str, processes: int) -> None:
    """Run a program with 256 drones for each process; print what the updates after the first ones took."""
    sys.path.insert(0, str(PROGRAMS))
    import lidar_task  # type: ignore[import-not-found]

    readings: list[dict[str, float]] = []

    def read_and_fly_none(_policy: object) -> int:
        readings.append(read())
        return 0

    lidar_task.NUM_ENVS *= processes
    lidar_task.playgrounds_flown = read_and_fly_none
    if engine == "ddp":
        import cleanrl_ppo  # type: ignore[import-not-found]

        cleanrl_ppo.BATCH_SIZE *= processes  # each process keeps minibatches of 4,096 steps
        import ddp_ppo  # type: ignore[import-not-found]

        ddp_ppo.main(ddp_ppo.Options(updates=UPDATES))
    elif engine == "rllib":
        run_rllib(processes)
    else:
        import torchrl_collectors  # type: ignore[import-not-found]

        kind = engine.removeprefix("torchrl_")
        torchrl_collectors.main(torchrl_collectors.CollectorOptions(updates=UPDATES, workers=processes, collector=kind))
    if readings:  # only the first process of DDP reads
        first, last = readings[WARM], readings[-1]
        taken = {name: last[name] - first[name] for name in first}
        print(json.dumps({**taken, "began": readings[0]["seconds"], "updates": len(readings) - 1 - WARM}), flush=True)
    if engine != "rllib":
        import processes as shared  # type: ignore[import-not-found]

        shared.end_process()


def run_rllib(runners: int) -> None:
    """Run RLlib with its learner on one node and all its runners on another."""
    from ray.cluster_utils import Cluster

    import rllib_ppo  # type: ignore[import-not-found]

    sizes = {"object_store_memory": 1 << 29}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **sizes})
    try:
        cluster.add_node(num_cpus=runners, **sizes)
        rllib_ppo.main(rllib_ppo.RLlibOptions(updates=UPDATES, runners=runners, address=cluster.address))
    finally:
        cluster.shutdown()


# --- outside


def ray_python() -> str | Path:
    """Return a Python that has Ray."""
    if importlib.util.find_spec("ray") is None and not RAY.exists():
        sys.exit("RLlib needs the environment that `./dev test ray` makes")
    return RAY if RAY.exists() else sys.executable


def environment() -> dict[str, str]:
    """Return the environment variables of a program."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(PROGRAMS), os.environ.get("PYTHONPATH", "")]),  # for Ray's workers
        "RAY_AUTH_MODE": "token",  # Ray would write one into the home folder
        "RAY_AUTH_TOKEN": os.urandom(16).hex(),
    }


def launch(program: Sequence[object], has_ray: bool = False, processes: int | None = None) -> str:
    """Run a program, by `torchrun` if it has processes; return its output."""
    python = ray_python() if has_ray else sys.executable
    torchrun = ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}"] if processes else []
    command = [python, *torchrun, *map(str, program)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment()).stdout


def run(engine: str, processes: int) -> dict[str, float]:
    """Run a program in a new process; return what it printed."""
    begun = time.time()
    output = launch([__file__, engine, processes], engine == "rllib", processes if engine == "ddp" else None)
    found: dict[str, float] = next(json.loads(line) for line in output.splitlines() if line.startswith('{"seconds"'))
    return {**found, "start_s": found["began"] - begun}


def figures(engine: str, processes: int, runs: Sequence[dict[str, float]]) -> Iterator[Measured]:
    """Return the medians of some runs, per step where that makes sense."""
    steps = STEPS * processes * runs[0]["updates"]
    name = f"engines/{engine}/processes{processes}"
    median = {key: Median(each[key] for each in runs) for key in runs[0]}
    yield f"{name}/steps_per_second", steps / median["seconds"], "1/s", len(runs)
    yield f"{name}/cpu_us", 1e6 * median["all_cpu_s"] / steps, "us", len(runs)
    yield f"{name}/main_cpu_us", 1e6 * median["main_cpu_s"] / steps, "us", len(runs)
    yield f"{name}/bytes", median["bytes"] / steps, "B", len(runs)
    yield f"{name}/start_s", median["start_s"], "s", len(runs)


def measure() -> Iterator[Measured]:
    """Measure each engine with each number of processes; the engines take turns."""
    ray_python()  # refuses before anything is measured
    runs: dict[tuple[str, int], list[dict[str, float]]] = {}
    for _ in range(RUNS):
        for engine in ENGINES:
            for processes in counts():
                runs.setdefault((engine, processes), []).append(run(engine, processes))
    for (engine, processes), found in runs.items():
        yield from figures(engine, processes, found)


# --- trainings

#: Programs of examples/trainers/ by the name of their figures, with the processes of those that `torchrun` starts.
TRAINERS: dict[str, tuple[str, int | None]] = {
    "sb3": ("sb3_ppo.py", None),
    "cleanrl": ("cleanrl_ppo.py", None),
    "torchrl_gymwrapper": ("torchrl_ppo.py", None),
    "torchrl_gymenv": ("torchrl_ppo.py --env gymenv", None),
    "skrl": ("skrl_ppo.py", None),
    **{f"ddp_{n}": ("ddp_ppo.py", n) for n in (1, 2)},
    **{f"torchrl_processes_{n}": (f"torchrl_collectors.py --workers {n}", None) for n in (1, 2)},
    **{
        f"torchrl_distributed_{n}": (f"torchrl_collectors.py --workers {n} --collector distributed", None)
        for n in (1, 2)
    },
    **{f"rllib_{n}": (f"rllib_ppo.py --runners {n}", None) for n in (1, 2)},
}
TRAINED = re.compile(r"^(\S+ \S+), (\w+): (\d) of 7 playgrounds after ([\d,]+) steps, ([\d,]+) steps/s$", re.MULTILINE)


def train() -> Iterator[Figure]:
    """Train from scratch with each program. The programs alternate, so that a busy hour affects all of them."""
    for seed in range(3):
        for name, (program, processes) in TRAINERS.items():
            script, *options = program.split()
            output = launch([PROGRAMS / script, *options, "--seed", seed], name.startswith("rllib"), processes)
            ended = TRAINED.search(output)
            assert ended, output
            steps, rate = (float(ended[i].replace(",", "")) for i in (4, 5))
            told = f"torchrun --nproc-per-node {processes} {program}" if processes else program
            about = {"program": told, "version": ended[1], "autoreset_mode": ended[2]}
            subject = f"trainers/{name}/seed{seed}"
            yield figure(f"{subject}/steps_per_second", rate, "1/s", 1, **about)
            yield figure(f"{subject}/steps", steps, "1", 1, **about)
            yield figure(f"{subject}/seconds", steps / rate, "s", 1, **about)
            yield figure(f"{subject}/playgrounds", float(ended[3]), "1", 1, **about)


if __name__ == "__main__":
    run_inside(sys.argv[1], int(sys.argv[2]))
