"""Writes the tables of figures in the README and in docs/ from the results of `./dev bench`.

python3 bench/table.py                  from out/bench/*.json, otherwise from the stored results in bench/results/
python3 bench/table.py bench/results    from the JSON files in a folder
python3 bench/table.py --keep           copy out/bench/*.json to bench/results/ first
python3 bench/table.py --check          change nothing; exit 1 if a document differs from the stored results

Each table comes from one commit and one processor, and names both. Results of a checkout with local changes are
rejected, and so are those of commits that are not in the history, which nobody could measure again; a shallow clone and
a folder without git of its own cannot tell, so there this is not checked. A "remark" is written by hand into the JSON
file of a result that needs an explanation, and shown with its figures; a new measurement has none.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import thesis

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
BENCHMARKS = ROOT / "docs" / "benchmarks.md"
FRESH = ROOT / "out" / "bench"
KEPT = ROOT / "bench" / "results"
TRIED = ROOT / "out" / "tried"
NAMES = (
    "lidar",
    "step",
    "camera",
    "train",
    "camera_train",
    "pixels_train",
    "camera_large",
    "places_train",
    "trainers",
    "snippet",
    "learner",
    "learner_avx2",
    "load",
    "worlds",
    "tiles",
    "tiles_avx2",
    "dynamics",
)
#: Benchmarks that are not in the table of all figures.
APART = (
    "imaging",
    "plan",
    "race",
    "bodies",
    "meetings",
    "dodge",
    "swap",
    "formation",
    "dynamics_accuracy",
    "dynamics_peers",
    "mesh_peers",
    "flight_train",
    "server",
    "board",
    "scaling",
    "camera_gpu",
    "workers",
    "engines",
    "engines_16",
)
ARCHITECTURE = ROOT / "docs" / "architecture.md"
CAMERAS = ROOT / "docs" / "cameras.md"
TRAINERS = ROOT / "docs" / "trainers.md"
SEVERAL = ROOT / "docs" / "several-machines.md"
OWN_WORLD = ROOT / "docs" / "own-world.md"
DYNAMICS = ROOT / "docs" / "dynamics.md"
RACE = ROOT / "docs" / "environments" / "race.md"
DODGE = ROOT / "docs" / "environments" / "dodge.md"
SWAP = ROOT / "docs" / "environments" / "swap.md"
SEVERAL_DRONES = ROOT / "docs" / "several-drones.md"
FORMATION = ROOT / "docs" / "environments" / "formation.md"
LIVING_WORLDS = ROOT / "docs" / "living-worlds.md"
FLIGHT_TASKS = ROOT / "docs" / "flight-tasks.md"
BOARD = ROOT / "docs" / "board.md"
#: Trainings of the board, described in words.
TRAININGS = {
    "hover": "hover: within 5 cm after a throw",
    "track": "track: within 5 cm of a moving point",
    "race": "race: 3 laps of 7 gates",
    "race_unseen": "race: 3 laps of an unseen generated track",
    "lidar": "LiDAR navigation: an unseen playground",
    "lidar_rotors": "LiDAR navigation by rotors: an unseen playground",
    "forest": "forest: an unseen one by depth of 16 x 12",
}
STAGE = "step/stage/"
#: Rows of the README's table: text, benchmark, the figures whose median is shown, and the number of threads. A training
#: uses one thread for PyTorch, and one per core for the simulator.
HEADLINE = (
    ("steps of the kinematic LiDAR task per second, 1,024 drones", "step", r"step/n1024/steps_per_second", "1"),
    ("a call of `step` with one drone", "step", r"step/n1/microseconds", "1"),
    ("LiDAR scans of 35 beams per second", "lidar", r"lidar/fan35x1024/scans_per_second", "1"),
    (
        "speed of these scans relative to a bare loop of Embree, a ray tracing library, in a world of pillars",
        "lidar",
        r"lidar/fan35x1024/ratio_to_bare_embree",
        "1",
    ),
    ("the same in a world of triangles", "lidar", r"lidar/mesh_fan35x1024/ratio_to_bare_embree", "1"),
    (
        "camera frames per second, 64 x 64 pixels with depth",
        "camera",
        r"camera/raycast/playground/64x64x256/frames_per_second",
        "1",
    ),
    (
        "camera frames per second, 640 x 480 with depth",
        "camera",
        r"camera/raycast/playground/640x480x16/frames_per_second",
        "1",
    ),
    (
        "time to train a policy of the kinematic LiDAR task, 1.5 million steps, median of 5",
        "board",
        r"board/lidar/seed\d/flockstep_2/seconds",
        "2",
    ),
    ("success rate of these policies in unseen playgrounds", "board", r"board/lidar/seed\d/flockstep_1/success", ""),
    (
        "time to train a policy that catches a thrown quadrotor, 1.6 million steps, median of 5",
        "board",
        r"board/hover/seed\d/flockstep_2/seconds",
        "2",
    ),
    ("success rate of these policies, within 5 cm", "board", r"board/hover/seed\d/flockstep_1/success", ""),
)
MARKS = "¹²³⁴⁵⁶⁷⁸⁹"  # of the remarks below that table
#: Figures with separate tables.
FRAMES, MODES = "camera_table/", "camera_modes/"
COST, CONTACT = "dynamics/cost/", "dynamics/contact/"

Result = dict[str, Any]


def lines_of(result: Result) -> str:
    """Return a result as JSON with a line for each key, and in lists, such as that of the figures, for each element."""
    rows = []
    for key, value in result.items():
        text = json.dumps(value)
        if isinstance(value, list):
            text = "[\n  " + ",\n  ".join(json.dumps(each) for each in value) + "\n ]"
        rows.append(f"{json.dumps(key)}: {text}")
    return "{\n " + ",\n ".join(rows) + "\n}\n"


def read(folder: Path) -> dict[str, Result]:
    """Return the results in a folder by the name of their benchmark, the known ones in running order."""
    found = {path.stem: in_plain_units(json.loads(path.read_text())) for path in sorted(folder.glob("*.json"))}
    return {
        name: found[name] for name in sorted(found, key=lambda n: (NAMES.index(n) if n in NAMES else len(NAMES), n))
    }


def in_plain_units(result: Result) -> Result:
    """Write microseconds as µs, and Highway's name AVX3 as AVX-512."""
    if "machine" in result:
        result["machine"]["simd"] = result["machine"].get("simd", "").replace("AVX3", "AVX-512")
    for each in result.get("figures", ()):
        each["name"] = each["name"].replace("AVX3", "AVX-512")
        each["unit"] = "µs" if each["unit"] == "us" else each["unit"]
    return result


def number(value: float) -> str:
    """Format a value with four digits and without an exponent: 0.9134, 23,460."""
    if value == int(value) or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{float(f'{value:.4g}'):,}"


def source(result: Result) -> str:
    """Describe the machine and the commit of a benchmark's figures."""
    machine, commit = result["machine"], result["commit"]
    gpu = f"{machine['gpu']}, " if "gpu" in machine else ""
    return (
        f"{gpu}{machine['cpu']}, {machine['logical_processors']} logical processors, {machine['simd']}, "
        f"Embree {machine['embree']}, Python {machine['python']}; commit {commit[:12]}"
        + "".join(f", {part['what']}: commit {part['commit'][:12]}" for part in result.get("parts", ()))
    ) + (f". {result['remark']}" if "remark" in result else "")


def refuse_unknown_sources(results: dict[str, Result]) -> None:
    """Exit if any result lacks one known commit or one known processor."""
    for name, result in results.items():
        cpu, commit = result.get("machine", {}).get("cpu"), result.get("commit")
        if not isinstance(cpu, str) or not cpu:
            sys.exit(f"{name}: expected the name of one processor, got {cpu!r}")
        if not isinstance(commit, str) or not re.fullmatch("[0-9a-f]{40}", commit):
            sys.exit(f"{name}: expected a single commit without local changes, got {commit!r}")
    refuse_lost_commits(results)


def refuse_lost_commits(results: dict[str, Result]) -> None:
    """Exit if the history lacks the commit of a result."""
    for name, result in results.items():
        for commit in {result["commit"], *(part["commit"] for part in result.get("parts", ()))}:
            if not may_be_in_history(commit):
                sys.exit(f"{name}: expected a commit of this history, got {commit}: measure again, or remove it")


def may_be_in_history(commit: str) -> bool:
    """Return False if the checkout's history lacks a commit; True without git, and in a shallow clone that lacks it."""

    def git(*args: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["git", *args], cwd=ROOT, check=False, capture_output=True, text=True)

    if shutil.which("git") is None:
        return True
    facts = git("rev-parse", "--is-shallow-repository", "--show-toplevel").stdout.split("\n")
    if facts[0] != "false" or Path(facts[1]).resolve() != ROOT.resolve():  # a source archive within another repository
        return True
    return git("merge-base", "--is-ancestor", commit, "HEAD").returncode == 0


def table(results: dict[str, Result]) -> str:
    """Return the content between the markers."""
    if not results:
        return "Not measured yet.\n"
    lines = []
    for name, result in results.items():
        if name in APART:
            continue
        lines += [f"**{name}**: {source(result)}", "", *benchmark(result["figures"]), *notes(result["figures"])]
    missing = [f"`{name}`" for name in NAMES if name not in results]
    if missing:
        lines += [f"Not measured yet: {', '.join(missing)}.", ""]
    return "\n".join(lines[:-1]) + "\n"


def headline(results: dict[str, Result]) -> str:
    """Return the README's table: some figures, described in words, with threads, processor, commit and remarks."""
    remarks = list(dict.fromkeys(r["remark"] for _, name, *_ in HEADLINE if "remark" in (r := results.get(name, {}))))
    rows = []
    for text, name, pattern, threads in HEADLINE:
        result = results.get(name, {"figures": []})
        figures = [f for f in result["figures"] if re.fullmatch(pattern, f["name"])]
        if not figures:
            rows.append(f"| {text} | not measured yet | | | |")
            continue
        unit = "" if figures[0]["unit"] in ("1", "1/s") else f" {figures[0]['unit']}"
        value = number(statistics.median(f["value"] for f in figures)) + unit
        machine = result["machine"]
        processor = f"{machine['cpu']}, {machine['logical_processors']} logical, {machine['simd']}"
        mark = f" {MARKS[remarks.index(result['remark'])]}" if "remark" in result else ""
        commit = f"{result['commit'][:7]}, {result['commit_date']}{mark}"
        rows.append(f"| {text} | {value} | {threads} | {processor} | {commit} |")
    notes = "".join(f"\n{mark} {remark}\n" for mark, remark in zip(MARKS, remarks, strict=False))
    return "\n".join(["| | | threads | processor | commit |", "|---|---:|---|---|---|", *rows]) + "\n" + notes


def benchmark(figures: list[dict[str, Any]]) -> list[str]:
    """Return tables of a benchmark's figures: one for all subjects with the same first figure, such as all seeds.

    Subjects without such a group become rows of a list.
    """
    subjects: dict[str, dict[str, str]] = {}
    for figure in figures:
        if figure["name"].startswith((FRAMES, MODES, STAGE, COST, CONTACT)):
            continue
        subject, what = figure["name"].rsplit("/", 1)
        unit = "" if figure["unit"] in ("1", "1/s") else f" {figure['unit']}"  # the names of rates imply the unit
        subjects.setdefault(subject, {})[what] = number(figure["value"]) + unit
    kinds: dict[str, dict[str, dict[str, str]]] = {}
    for subject, row in subjects.items():
        kinds.setdefault(next(iter(row)), {})[subject] = row
    tables: list[str] = []
    alone: list[str] = []
    for kind in kinds.values():
        if len(kind) == 1:
            alone += [
                f"| `{subject}/{what}` | {value} |" for subject, row in kind.items() for what, value in row.items()
            ]
        else:
            cells = {
                (f"`{subject}`", f"`{what}`"): value for subject, row in kind.items() for what, value in row.items()
            }
            tables += [*pivot(cells, "").splitlines(), ""]
    return [*tables, *(["| | |", "|---|---:|", *alone, ""] if alone else [])]


def notes(figures: list[dict[str, Any]]) -> list[str]:
    """Return the notes on figures, each of them once."""
    said: dict[str, list[str]] = {}
    for figure in figures:
        if "note" in figure:
            said.setdefault(figure["note"], []).append(figure["name"].rsplit("/", 1)[1])
    lines: list[str] = []
    for note, names in said.items():
        lines += [f"{', '.join(f'`{name}`' for name in dict.fromkeys(names))}: {note}", ""]
    return lines


def with_source(results: dict[str, Result], name: str, rows: str) -> str:
    """Return a table of some figures of a benchmark below a line with their source."""
    return f"{source(results[name])}\n\n{rows}" if name in results else "Not measured yet.\n"


def stages(results: dict[str, Result]) -> str:
    """Return the table of a step's stages."""
    figures = [f for f in results.get("step", {"figures": []})["figures"] if f["name"].startswith(STAGE)]
    rows = [f"| {f['name'].removeprefix(STAGE)} | {number(f['value'])} |" for f in figures]
    return with_source(results, "step", "\n".join(["| stage | ns |", "|---|---:|", *rows]) + "\n")


def pivot(cells: dict[tuple[str, str], str], corner: str) -> str:
    """Return a table of cells by (row, column), in insertion order."""
    rows, columns = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))
    lines = [f"| {corner} | {' | '.join(columns)} |", "|---|" + "---:|" * len(columns)]
    for row in rows:
        lines.append(f"| {row} | {' | '.join(cells.get((row, column), '') for column in columns)} |")
    return "\n".join(lines) + "\n"


def frames(results: dict[str, Result], name: str = "camera") -> str:
    """Return the table of camera frames per second by resolution, number of drones, world and backend."""
    figures = []
    for f in results.get(name, {"figures": []})["figures"]:
        if f["name"].startswith(FRAMES):
            world, size, what = f["name"].removeprefix(FRAMES).split("/")
            column = f"{world} {what.removesuffix('_frames_per_second')}"
            figures.append((tuple(map(int, size.split("x"))), column, number(f["value"])))
    figures.sort(key=lambda figure: figure[0])
    cells = {(f"{size[0]} x {size[1]}, N = {size[2]}", column): value for size, column, value in figures}
    return with_source(results, name, pivot(cells, "frames/s"))


def frames_gpu(results: dict[str, Result]) -> str:
    """Return the same table, measured with a GPU."""
    return frames(results, "camera_gpu")


def scaling(results: dict[str, Result]) -> str:
    """Return the table of rates by number of threads, each with its ratio to the rate of one thread."""
    heads = {
        "steps_per_second": "steps of {}",
        "frames_per_second": "frames of {}",
        "training_steps_per_second": "training of {}",
    }
    one: dict[str, float] = {}
    cells = {}
    for (kind, subject, threads), f in named(results, "scaling", r"scaling/(\w+)/([^/]+)/threads(\d+)"):
        row = heads[kind].format(re.sub(r"(?<=[a-z])(\d+)$", r", \1 drones", subject))
        ratio = f["value"] / one.setdefault(row, f["value"])
        cells[row, f"{threads} threads" if threads != "1" else "1 thread"] = f"{number(f['value'])} ({ratio:.1f})"
    return with_source(results, "scaling", pivot(cells, "per second"))


def modes(results: dict[str, Result]) -> str:
    """Return the table of the cost of capture modes."""
    figures = {}
    for f in results.get("camera", {"figures": []})["figures"]:
        if f["name"].startswith(MODES):
            world, mode, motion, _ = f["name"].removeprefix(MODES).split("/")
            figures[mode.replace("_", " "), f"{world}, {motion}"] = number(f["value"])
    return with_source(results, "camera", pivot(figures, "µs per drone and step"))


def trainers(results: dict[str, Result]) -> str:
    """Return the table of trainers: medians over seeds, with infinite steps for a seed that did not learn."""
    figures = results.get("trainers", {"figures": []})["figures"]
    cells = {}
    for program in dict.fromkeys(f["program"] for f in figures):
        own = [f for f in figures if f["program"] == program]
        rates, steps, flown = (
            [f["value"] for f in own if f["name"].endswith(f"/{what}")]
            for what in ("steps_per_second", "steps", "playgrounds")
        )
        until = [count if flights >= 6 else math.inf for count, flights in zip(steps, flown, strict=True)]
        median, learned = statistics.median(until), sum(map(math.isfinite, until))
        until_it_flies = number(median) if math.isfinite(median) else f"more than {number(max(steps))}"
        seconds = statistics.median(count / rate for count, rate in zip(until, rates, strict=True))
        row = {
            "version": own[0]["version"],
            "autoreset mode": own[0]["autoreset_mode"],
            "steps/s": number(statistics.median(rates)),
            "steps until it flies 6 of 7": until_it_flies
            + f" ({learned} of {len(until)} seeds)" * (learned < len(until)),
            "seconds until then": f"{seconds:.1f}" if math.isfinite(seconds) else "",
        }
        cells |= {(f"`{program}`", column): text for column, text in row.items()}
    return with_source(results, "trainers", pivot(cells, "program"))


def engines(results: dict[str, Result], name: str = "engines") -> str:
    """Return the table of what a step costs on the engines for several processes."""
    heads = {
        "steps_per_second": "steps/s",
        "cpu_us": "processor time of a step, µs",
        "main_cpu_us": "of that, first process, µs",
        "bytes": "sent for a step, B",
        "start_s": "start, s",
    }
    titles = {
        "ddp": "DDP",
        "torchrl_processes": "TorchRL, shared memory",
        "torchrl_distributed": "TorchRL, distributed",
        "rllib": "RLlib",
    }
    cells = {}
    for (engine, count, what), f in named(results, name, r"engines/(\w+)/processes(\d+)/(\w+)"):
        value = f["value"] if what == "steps_per_second" else float(f"{f['value']:.3g}")
        cells[f"{titles[engine]}, {count}", heads[what]] = number(value)
    return with_source(results, name, pivot(cells, "engine, processes"))


def engines_16(results: dict[str, Result]) -> str:
    """Return the same table, measured on a machine of 16 processors."""
    return engines(results, "engines_16")


#: Exchanges of gradients by DDP between two updates, and steps of a process between them.
EXCHANGES, STEPS_BETWEEN = 16, 64 * 256


def many_machines(results: dict[str, Result]) -> str:
    """Return the table of what 10 and 100 machines would carry, calculated from the costs of a step on one."""
    found = {key: f["value"] for key, f in named(results, "engines_16", r"engines/(\w+)/processes(\d+)/(\w+)")}
    if not found:
        return "Not measured yet.\n"
    fewest, cores = 2, 16

    def updates_s(processes: int) -> float:
        return processes * STEPS_BETWEEN / found["ddp", str(processes), "steps_per_second"]

    # An exchange takes a time, and more for each of the 2 (P - 1) messages that P processes pass one after another.
    alone_s, few_s, many_s = (updates_s(processes) for processes in (1, fewest, cores))
    message_s = (many_s - few_s) / EXCHANGES / (2 * (cores - fewest))
    rest_s = (few_s - alone_s) / EXCHANGES - 2 * (fewest - 1) * message_s
    cells = {}
    rows = {"ddp": "DDP, a process per core", "torchrl_distributed": "TorchRL, distributed", "rllib": "RLlib"}
    for engine, row in rows.items():
        measured = found[engine, str(cores if engine == "ddp" else cores - 1), "steps_per_second"]
        cells[row, "1 machine, measured"] = number(float(f"{measured:.2g}"))
        for machines in (10, 100):
            processes = cores * machines
            learner_us = found[engine, "15" if engine != "ddp" else "16", "main_cpu_us"]
            if engine == "ddp":
                exchange_s = rest_s + 2 * (processes - 1) * message_s
                rate = processes * STEPS_BETWEEN / (alone_s + EXCHANGES * exchange_s)
            elif engine == "torchrl_distributed":  # its workers fly on while the learner learns
                rate = 1e6 / learner_us
            else:  # its runners wait for the learner
                flying_us = found[engine, "15", "cpu_us"] - learner_us
                rate = 1e6 / (learner_us + flying_us / (processes - 1))
            cells[row, f"{machines} machines"] = number(float(f"{rate:.2g}"))
        cells[row, "limit"] = (
            f"{number(float(f'{STEPS_BETWEEN / (2 * EXCHANGES * message_s):.2g}'))}, by the exchanges"
            if engine == "ddp"
            else f"{number(float(f'{1e6 / learner_us:.2g}'))}, by the learner"
        )
        hours = 1e9 * 1e-6 * found[engine, "1", "cpu_us"] / 3600
        cells[row, "core hours for 10⁹ steps"] = f"{hours:.0f}"
    return with_source(results, "engines_16", pivot(cells, "steps/s"))


#: Worlds of the benchmark of workers, in words.
WORKER_WORLDS = {
    "playground": "one playground",
    "playgrounds1000": "1,000 playgrounds",
    "city": "the city",
    "scan2M": "a scan of 2 million triangles",
    "scan2M_8k": "the scan with a texture of 8,192 x 8,192",
}


def workers(results: dict[str, Result]) -> str:
    """Return the table of what a worker costs to start, when two start together."""
    starts = {"spawn": "new process", "fork": "forked"}
    heads = {
        "world_cpu_s": "load worlds, s",
        "make_cpu_s": "make environments, s",
        "first_frame_cpu_s": "first camera frame, s",
    }
    found = {key: f["value"] for key, f in named(results, "workers", r"workers/(\w+)/(spawn|fork)2/(\w+)")}
    cells = {}
    for (world, start, what), value in found.items():
        row = f"{WORKER_WORLDS[world]}, {starts[start]}"
        if what in heads:
            cells[row, heads[what]] = f"{value:.3f}"
        for prefix, column in (("", "memory, MB"), ("camera_", "with a camera, MB")):
            if what == f"{prefix}resident_mb":
                cells[row, column] = f"{value - found[world, start, f'{prefix}shared_mb']:.0f}"
    ordered = dict.fromkeys([*((row, head) for row, _ in cells for head in heads.values()), *cells])
    return with_source(results, "workers", pivot({key: cells.get(key, "") for key in ordered}, ""))


def pickles(results: dict[str, Result]) -> str:
    """Return the table of what it costs to send worlds to a worker."""
    heads = {"dump_cpu_s": "pickle, s", "load_cpu_s": "load, s", "size_mb": "size, MB"}
    cells = {
        (WORKER_WORLDS[world], heads[what]): number(float(f"{f['value']:.2g}"))
        for (world, what), f in named(results, "workers", r"workers/(\w+)/pickle/(\w+)")
    }
    return with_source(results, "workers", pivot(cells, ""))


def flight_training(results: dict[str, Result]) -> str:
    """Return the table of flight trainings: the median over the seeds of each task, with the worst seed in brackets."""
    figures = results.get("flight_train", {"figures": []})["figures"]
    cells: dict[tuple[str, str], str] = {}
    for task, what in (("hover", "Hover, by rotor thrusts"), ("track", "Track, by thrust and body rates")):
        for by, who in ((r"seed\d", "policy"), ("controller", "controller alone")):
            found: dict[str, list[float]] = {}
            for figure in figures:
                if match := re.fullmatch(rf"train/{task}/{by}/(\w+)", figure["name"]):
                    found.setdefault(match[1], []).append(figure["value"])
            if not found:
                continue
            row = f"{what}: {who}"
            rate, error, crash = (found[name] for name in ("close_rate", "median_error_cm", "crash_rate"))
            cells[row, "within 5 cm"] = spread(rate, min, lambda x: f"{100 * x:.1f} %")
            cells[row, "median error"] = spread(error, max, lambda x: f"{x:.1f} cm")
            cells[row, "crashed"] = spread(crash, max, lambda x: f"{100 * x:.1f} %")
            if "seconds" in found:
                cells[row, "training"] = spread(found["seconds"], max, lambda x: f"{x:.0f} s")
                cells[row, "steps"] = f"{statistics.median(found['steps']):,.0f}"
            else:
                cells[row, "training"] = cells[row, "steps"] = "none"
    return with_source(results, "flight_train", pivot(cells, "1,000 flights"))


def spread(values: list[float], worst: Callable[[list[float]], float], shown: Callable[[float], str]) -> str:
    """Return the median, followed by the worst value in brackets if there are several."""
    return shown(statistics.median(values)) + (f" ({shown(worst(values))})" if len(values) > 1 else "")


def board(results: dict[str, Result]) -> str:
    """Return the table of the board: the median over the seeds, with the worst seed in brackets."""
    cells: dict[tuple[str, str], str] = {}
    for name, row in TRAININGS.items():
        values = by_run(results, name)
        if not values:
            continue
        baseline = named(results, "board", rf"board/{name}/baseline/success")
        cells[row, "success"] = spread(values["flockstep_1", "success"], min, percent_1)
        cells[row, "baseline"] = percent_1(baseline[0][1]["value"])
        cells[row, "two threads"] = spread(values["flockstep_2", "seconds"], max, seconds)
        cells[row, "one thread"] = spread(values["flockstep_1", "seconds"], max, seconds)
        if ("sb3_1", "success") in values:
            cells[row, "success, SB3"] = spread(values["sb3_1", "success"], min, percent_1)
            cells[row, "one thread, SB3"] = spread(values["sb3_1", "seconds"], max, seconds)
        if ("flockstep_1", "lap_s") in values:
            cells[row, "lap"] = spread(values["flockstep_1", "lap_s"], max, lambda x: f"{x:.2f} s")
    return with_source(results, "board", pivot(cells, "training"))


def race_board(results: dict[str, Result]) -> str:
    """Return the table of the races of the board, with laps and speeds."""
    cells: dict[tuple[str, str], str] = {}
    for name, row in (("race", "`race/figure-8`"), ("race_unseen", "unseen tracks")):
        policy = {what: values for (run, what), values in by_run(results, name).items() if run == "flockstep_1"}
        controller = {
            what: [figure["value"]] for (what,), figure in named(results, "board", rf"board/{name}/baseline/(\w+)")
        }
        for who, found in (("policy", policy), ("controller", controller)):
            if "success" in found:
                cells[f"{row}: {who}", "success"] = spread(found["success"], min, percent_1)
            if "lap_s" in found:
                cells[f"{row}: {who}", "lap"] = spread(found["lap_s"], max, lambda x: f"{x:.2f} s")
                cells[f"{row}: {who}", "mean speed"] = spread(found["speed_mps"], min, lambda x: f"{x:.1f} m/s")
    for _, lap in named(results, "race", r"race/point_mass/lap_s"):
        cells["`race/figure-8`: point mass", "lap"] = f"{lap['value']:.2f} s"
    return with_source(results, "board", pivot(cells, ""))


def board_seeds(results: dict[str, Result]) -> str:
    """Return the table of the board's trainings one by one: success and seconds with one thread."""
    cells = {}
    for name in TRAININGS:
        values = by_run(results, name)
        for run, learner in (("flockstep_1", "`flockstep.PPO`"), ("sb3_1", "Stable-Baselines3")):
            pairs = zip(values.get((run, "success"), ()), values.get((run, "seconds"), ()), strict=True)
            for seed, (success, time) in enumerate(pairs):
                cells[f"{name}, {learner}", f"seed {seed}"] = f"{percent_1(success)}, {seconds(time)}"
    return with_source(results, "board", pivot(cells, "one thread"))


def board_curves(results: dict[str, Result]) -> str:
    """Return the table that compares the learning curves of the two learners."""
    cells = {}
    for name in TRAININGS:
        means: dict[str, list[float]] = {}
        successes: dict[str, list[float]] = {}
        for (learner,), figure in named(results, "board", rf"board/{name}/seed\d/(\w+)_1/success"):
            means.setdefault(learner, []).append(statistics.mean(success for _, _, success in figure["curve"]))
            successes.setdefault(learner, []).append(figure["value"])
        if len(means) == 2:
            cells[name, "mean of the curve, `flockstep.PPO`"] = spread(means["flockstep"], min, percent_1)
            cells[name, "Stable-Baselines3"] = spread(means["sb3"], min, percent_1)
            cells[name, "p"] = f"{permutation_p(means['flockstep'], means['sb3']):.2f}"
            cells[name, "p of the success"] = f"{permutation_p(successes['flockstep'], successes['sb3']):.2f}"
    return with_source(results, "board", pivot(cells, "training"))


def by_run(results: dict[str, Result], training: str) -> dict[tuple[str, str], list[float]]:
    """Return the values of a training of the board for all seeds, by run, such as flockstep_1, and kind of figure."""
    values: dict[tuple[str, str], list[float]] = {}
    for (run, what), figure in named(results, "board", rf"board/{training}/seed\d/(\w+)/(\w+)"):
        values.setdefault((run, what), []).append(figure["value"])
    return values


def permutation_p(first: list[float], second: list[float]) -> float:
    """Return the p value of the exact two-sided permutation test of the difference of two means."""
    both, size = [*first, *second], len(first)
    differences = []
    for chosen in itertools.combinations(range(len(both)), size):
        rest = [both[i] for i in range(len(both)) if i not in chosen]
        differences.append(abs(statistics.mean(both[i] for i in chosen) - statistics.mean(rest)))
    observed = abs(statistics.mean(first) - statistics.mean(second))
    return sum(difference >= observed - 1e-12 for difference in differences) / len(differences)


def thesis_by_rotors(results: dict[str, Result]) -> str:
    """Return the table of the LiDAR task's policy, trained with kinematic motion and flown with simulated rotors."""
    cells = {}
    for (motion, _, group), figure in named(
        results, "flight_train", r"train/lidar_by_(\w+)/(seed\d)/(\w+)_success_rate"
    ):
        column = "bundled playgrounds" if group == "playgrounds" else f"{figure['runs']} generated ones, unseen"
        cells[f'motion="{motion}"', column] = f"{100 * figure['value']:.0f} %"
    return with_source(results, "flight_train", pivot(cells, "flown with"))


def named(results: dict[str, Result], name: str, pattern: str) -> list[tuple[tuple[str, ...], dict[str, Any]]]:
    """Return the figures of a benchmark whose full names match, each with the groups of its match."""
    figures = results.get(name, {"figures": []})["figures"]
    return [(match.groups(), f) for f in figures if (match := re.fullmatch(pattern, f["name"]))]


def rough(figure: dict[str, Any]) -> str:
    """Format a figure with two digits and the unit: 0.012 mm, 0.0008°."""
    value = float(f"{figure['value']:.2g}")
    text = f"{value:,.0f}" if abs(value) >= 10 else f"{value:.10f}".rstrip("0").rstrip(".")
    space = "" if figure["unit"] in ("°", "1") else " "
    return text + space + figure["unit"].removeprefix("1")


def accuracy(results: dict[str, Result]) -> str:
    """Return the table of errors by frame, integrator and rate."""
    cells: dict[tuple[str, str], str] = {}
    for (frame, integrator, hz), f in named(results, "dynamics_accuracy", r"dynamics_accuracy/error/(.+)/(.+)/(.+)/.+"):
        key = f"{frame}, {integrator}", f"{hz} Hz"
        cells[key] = f"{cells[key]}, {rough(f)}" if key in cells else rough(f)
    return with_source(results, "dynamics_accuracy", pivot(cells, "frame, integrator"))


def other_accuracy(results: dict[str, Result]) -> str:
    """Return the table of the other accuracy measurements."""
    texts = {
        r"way/(.+)/m": "distance flown by {} in the test above",
        r"way/(.+)/degrees": "rotation of {} in the test above",
        r"tour/(.+)/mm": "{} on a tour with its controller: distance between midpoint and rk4",
        r"ten_minutes_at_1_km/(mean|farthest)_mm": "a point 1 km out along each axis, held for 10 minutes: {} distance",
    }
    rows = [
        f"| {text.format(*groups)} | {rough(f)} |"
        for pattern, text in texts.items()
        for groups, f in named(results, "dynamics_accuracy", f"dynamics_accuracy/{pattern}")
    ]
    return with_source(results, "dynamics_accuracy", "\n".join(["| | |", "|---|---:|", *rows]) + "\n")


def settling(results: dict[str, Result]) -> str:
    """Return the table of the controller's settling times."""
    columns = {
        "seconds_to_90_percent": "90 % after",
        "overshoot_percent": "overshoot",
        "seconds_to_5_cm": "within 5 cm after",
    }
    found = named(results, "dynamics_accuracy", r"dynamics_accuracy/settling/(.+)/(.+)")
    cells = {(frame, columns[what]): rough(f) for (frame, what), f in found}
    return with_source(results, "dynamics_accuracy", pivot(cells, "frame"))


def ten_steps(results: dict[str, Result]) -> str:
    """Return the table of the distances flown in ten steps ahead."""
    found = named(results, "dynamics_accuracy", r"dynamics_accuracy/ten_steps_ahead/(.+)/(.+)/m")
    cells = {(frame, f"`policy_hz={hz}`"): rough(f) for (frame, hz), f in found}
    return with_source(results, "dynamics_accuracy", pivot(cells, "frame"))


def costs(results: dict[str, Result]) -> str:
    """Return the tables of the cost of each term of flight and of each kind of contact."""
    rows = []
    for head, pattern in (
        ("added", f"{COST}(.+)/ns_per_(.+)"),
        ("total cost", f"{CONTACT}(.+)/ns_per_(.+)"),
    ):
        rows += ["", f"| {head} | | |", "|---|---:|---|"]
        for (what, per), f in named(results, "dynamics", pattern):
            rows.append(f"| {what.replace('_', ' ')} | {rough(f)} | a {per} |")
    return with_source(results, "dynamics", "\n".join(rows[1:]) + "\n")


def plans(results: dict[str, Result]) -> str:
    """Return the table of planning times."""
    heads = {"median_cpu_seconds": "median", "most_cpu_seconds": "maximum"}
    cells = {}
    for (kind, what), f in named(results, "plan", r"plan/([^/]+)/(median_cpu_seconds|most_cpu_seconds)"):
        cells[kind, "worlds"] = number(f["runs"])
        cells[kind, heads[what]] = rough(f)
    return with_source(results, "plan", pivot(cells, "kind"))


def races(results: dict[str, Result]) -> str:
    """Return the table of the time of a step of Race, with frames that drones touch and without."""
    heads = {"solid": "solid gates", "open": "not solid"}
    cells = {
        (f"{ticks} ticks", heads[kind]): rough(f)
        for (kind, ticks), f in named(results, "race", r"race/(solid|open)_gates/(\d+)_ticks/step")
    }
    return with_source(results, "race", pivot(cells, "one drone, one thread"))


def bodies(results: dict[str, Result]) -> str:
    """Return the tables of the costs of bodies: scans, steps, camera frames, and a tick of each script."""
    rows = {
        "scans": {
            "none": "an empty hall",
            "static": "64 solids in the static world",
            "moving": "64 bodies that have moved",
        },
        "lidar_task": {
            "none": "an empty hall",
            "static": "64 solids in the static world",
            "still": "64 bodies that stand",
            "moving": "64 bodies that move",
        },
        "cameras": {
            "none": "an empty room",
            "static": "a mesh of 5,000 triangles in the static world",
            "still": "the mesh as a body that stands",
            "moving": "the mesh as a body that moves",
        },
    }
    heads = {
        "scans_per_second": "scans per second",
        "steps_per_second": "steps per second",
        "frames_per_second": "frames per second",
        "ratio_to_static": "speed relative to the static world",
    }
    corners = {
        "scans": "35 beams, 1,024 drones",
        "lidar_task": "whole steps of 1,024 drones",
        "cameras": "64 x 64 pixels of colour and depth",
    }
    tables = []
    for subject, variants in rows.items():
        cells = {
            (variants[variant], heads[what]): rough(f) if what == "ratio_to_static" else number(f["value"])
            for (variant, what), f in named(results, "bodies", rf"bodies/{subject}/(\w+)/(\w+)")
        }
        tables.append(pivot(cells, corners[subject]))
    scripts = {
        (script.replace("_", " "), "a tick of a body"): rough(f)
        for (script,), f in named(results, "bodies", r"bodies/script/([^/]+)/ns_per_tick")
    }
    return with_source(results, "bodies", "\n".join([*tables, pivot(scripts, "script")]))


def meetings(results: dict[str, Result]) -> str:
    """Return the table of what drones cost that see and touch each other."""
    heads = {name: name for name in ("none", "sense", "collide", "both")}
    cells: dict[tuple[str, str], str] = {}
    for (group, motion, interaction), f in named(results, "meetings", r"meetings/([^/]+)/(\w+)/(\w+)/ratio_to_separate"):
        if interaction in heads:
            cells[f"{group}, {motion}", heads[interaction]] = rough(f)
    for (group, motion), f in named(results, "meetings", r"meetings/([^/]+)/(\w+)/separate/us_per_step"):
        cells[f"{group}, {motion}", "a step in a separate env"] = rough(f)
    for (group, motion), f in named(results, "meetings", r"meetings/([^/]+)/(\w+)/both/share_in_contact"):
        cells[f"{group}, {motion}", "in contact"] = f"{f['value']:.1%}".replace("%", " %")
    return with_source(results, "meetings", pivot(cells, "`interaction`"))


def dodge(results: dict[str, Result]) -> str:
    """Return the table of the trainings of Dodge beside the straight flyer."""
    heads = {
        "success": "success",
        "success_in_playgrounds": "in playgrounds",
        "success_in_warehouses": "in warehouses",
        "contacts_per_minute": "contacts per minute",
        "training_s": "training",
    }
    rows = {"living": "trained among bodies", "still": "trained without bodies"}
    cells = {}
    for (who, what), f in named(results, "dodge", r"dodge/(straight|\w+/\d)/(\w+)"):
        kind, _, seed = who.partition("/")
        row = f"{rows[kind]}, seed {seed}" if seed else "flies straight to the goal"
        value = f["value"]
        cells[row, heads[what]] = (
            seconds(value) if what == "training_s" else f"{value:.2f}" if "minute" in what else percent_1(value)
        )
    return with_source(results, "dodge", pivot(cells, "1,000 flights"))


def swap(results: dict[str, Result]) -> str:
    """Return the table of the trainings of Swap beside the straight flyer."""
    cells = {}
    for (who, what), f in named(results, "swap", r"swap/(straight|trained/\d)/(\w+)"):
        _, _, seed = who.partition("/")
        row = f"trained, seed {seed}" if seed else "fly straight to their goals"
        if what.startswith("success_of_"):
            cells[row, f"{what.removeprefix('success_of_')} drones"] = percent_1(f["value"])
        elif what == "training_s":
            cells[row, "training"] = seconds(f["value"])
        elif what == "seconds" and seed:
            cells[row, "time of 8 drones"] = f"{f['value']:.1f} s"
    return with_source(results, "swap", pivot(cells, "swaps without a touch"))


def formation(results: dict[str, Result]) -> str:
    """Return the table of the trainings of Formation beside the straight flyers."""
    flyers = {"straight": "fly straight to their places", "ahead": "fly to where their places will be"}
    heads = {"success": "success", "touched": "touched", "error_m": "error", "training_s": "training"}
    cells = {}
    for (who, what), f in named(results, "formation", r"formation/(straight|ahead|trained/\d)/(\w+)"):
        _, _, seed = who.partition("/")
        row = f"trained, seed {seed}" if seed else flyers[who]
        kind, _, name = what.partition("_")
        if what == "training_s":
            cells[row, "training"] = seconds(f["value"])
        else:
            value = f"{100 * f['value']:.1f} cm" if name == "error_m" else percent_1(f["value"])
            cells[row, f"{heads[name]}, {kind}s"] = value
    return with_source(results, "formation", pivot(cells, "4 drones"))


def imaging(results: dict[str, Result]) -> str:
    """Return the tables of the costs of colour detection and smaller images."""
    colours = {
        (color, f"{size}, `{function}`"): rough(f)
        for (color, size, function), f in named(results, "imaging", r"imaging/colour/(.+)/(.+)/(.+)")
    }
    cameras = {
        (camera, size): rough(f) for (camera, size), f in named(results, "imaging", r"imaging/camera/(.+)/(.+)/sense")
    }
    both = pivot(colours, "a colour in a frame") + "\n" + pivot(cameras, "a frame, rendered and written")
    return with_source(results, "imaging", both)


def of_peers(results: dict[str, Result], name: str) -> list[tuple[str, str, str, str, str, dict[str, Any]]]:
    """Return figures of a peer benchmark: program with version, the peer measured beside, kind, mode, quantity, figure.

    Our own figures name the peer that they were measured with: " (beside mujoco)". A peer that could not be measured
    has one figure of the kind "measured", which contains its error.
    """
    found = []
    for (peer, kind, mode, what), f in named(results, name, rf"{name}/([^/]+)/([^/]+)/(.+)/(\w+)"):
        if "mode" not in f:  # a figure about the case, not about a program
            continue
        program = peer.removeprefix("flockstep_beside_")
        is_ours = program != peer
        beside = f" (beside {program})" * is_ours
        found.append((f"{'flockstep' if is_ours else peer} {f['version']}", beside, kind, mode, what, f))
    return found


def unmeasured(results: dict[str, Result], name: str) -> dict[str, str]:
    """Return the peers that could not be measured, with the reasons."""
    return {peer: f"not measured: {f['error']}" for (peer,), f in named(results, name, rf"{name}/(.+)/measured")}


def peers(results: dict[str, Result]) -> str:
    """Return the tables of other simulators: their speed, and the distance of their final positions from ours."""
    name, rate = "dynamics_peers", "substeps or steps per second"
    speeds: dict[tuple[str, str], str] = {}
    flights: dict[tuple[str, str], str] = {}
    for peer, beside, kind, mode, what, f in of_peers(results, name):
        if kind == "flight":
            row = f"{peer.split()[0]}, {mode}"
            flights[row, {"mm": "position", "degrees": "attitude"}[what]] = rough(f)
            if what == "degrees":
                flights[row, "because"] = f["reason"]
        else:
            column = {"per_second": rate, "ours_over_it": "flockstep's rate / this rate"}[what]
            text = number(f["value"]) if what == "per_second" else rough(f)
            speeds[f"{peer}, {kind}: {mode}{beside}", column] = text
    speeds |= {(peer, rate): why for peer, why in unmeasured(results, name).items()}
    both = pivot(speeds, "mode") + "\n" + pivot(flights, "flight")
    return with_source(results, name, both)


def mesh_peers(results: dict[str, Result]) -> str:
    """Return the tables of other ray casters: their speed, the ratio of ours to it, and the differing distances."""
    name = "mesh_peers"
    heads = {
        "per_second": "million rays a second",
        "ours_over_it": "`Batch` rate / this rate",
        "raycast_over_it": "`World.raycast` rate / this rate",
        "differing_in_a_million": "rays per million whose distance differs",
    }
    tables: dict[str, dict[tuple[str, str], str]] = {what: {} for what in ("world", *heads)}
    for (world, what), f in named(results, name, rf"{name}/([^/]+)/(triangles)"):
        tables["world"][world, what] = number(f["value"])
    for (world, sensor, what), f in named(results, name, rf"{name}/([^/]+)/([^/]+)/(rays|misses)"):
        text = number(f["value"]) if what == "rays" else f"{100 * f['value']:.0f} %"
        tables["world"][world, f"{what} of the {sensor}"] = text
    for peer, beside, case, mode, what, f in of_peers(results, name):
        text = f"{f['value'] / 1e6:.3g}" if what == "per_second" else rough(f)
        # The differences between our own methods are the same beside each peer.
        tables[what][f"{peer}: {mode}{'' if what == 'differing_in_a_million' else beside}", case] = text
    column = next((case for _, case in tables["per_second"]), "")
    tables["per_second"] |= {(peer, column): why for peer, why in unmeasured(results, name).items()}
    written = [pivot(cells, heads.get(what, what)) for what, cells in tables.items() if cells]
    return with_source(results, name, "\n".join(written))


def figures_of(results: dict[str, Result], name: str, prefix: str) -> dict[str, float]:
    """Return the values of a benchmark's figures whose names begin with a prefix, by the rest of their names."""
    figures = results.get(name, {"figures": []})["figures"]
    return {f["name"].removeprefix(prefix): f["value"] for f in figures if f["name"].startswith(prefix)}


def short(value: float) -> str:
    """Format a value with three digits: 0.0213, 23.5, 1,240."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def server_round_trips(results: dict[str, Result]) -> str:
    """Return the tables of round trips: each client's median, and its ratio to the bare echoes, by operation."""
    echoes = {"tcp": "TCP echo", "async": "Beast echo"}
    clients = {"cpp": "C++ client", "python": "Python", "asyncio": "asyncio"}
    tables = []
    for place, title in (("pinned", "on one core, µs"), ("unpinned", "on all cores, µs")):
        found = figures_of(results, "server", f"server/round_trip/{place}/")
        cells: dict[tuple[str, str], str] = {}
        for name in dict.fromkeys(name.split("/")[0] for name in found):
            row = f"`{name}`, {number(found[f'{name}/request'])} to {number(found[f'{name}/reply'])} B"
            for echo, column in echoes.items():
                cells[row, column] = short(found[f"{name}/{echo}/p50"])
            for client, column in clients.items():
                if f"{name}/{client}/p50" in found:
                    ratios = " / ".join(f"{found[f'{name}/{client}/ratio_to_{echo}']:.1f}" for echo in echoes)
                    cells[row, column] = f"{short(found[f'{name}/{client}/p50'])} ({ratios})"
        tables.append(pivot(cells, title))
    return with_source(results, "server", "\n".join(tables))


def server_vector_env(results: dict[str, Result]) -> str:
    """Return the table of the remote vector environment's speed."""
    cells = {}
    for place, row in (("pinned", "server and client on one core"), ("unpinned", "on all cores")):
        found = figures_of(results, "server", f"server/vector_env/{place}/")
        if "in_process" in found:
            cells[row, "in-process"] = number(found["in_process"])
        for what, ratio, column in (("remote", "ratio", "over TCP"), ("unix", "unix_ratio", "by a Unix socket")):
            if what in found:
                cells[row, f"{column} (ratio)"] = f"{number(found[what])} ({found[ratio]:.2f})"
    return with_source(results, "server", pivot(cells, "drone-steps per second"))


def server_clients(results: dict[str, Result]) -> str:
    """Return tables 5.2 to 5.5 of the thesis with our figures, and those of the thesis in brackets."""
    found = figures_of(results, "server", "server/clients/")
    response: dict[tuple[str, str], str] = {}
    rate: dict[tuple[str, str], str] = {}
    scans: dict[tuple[str, str], str] = {}
    scan_rates: dict[tuple[str, str], str] = {}
    for count in thesis.MOVE_MS:
        if f"move/{count}/mean" not in found:
            continue
        row = number(count)
        for what, ms, fps in zip(thesis.COLUMNS, thesis.MOVE_MS[count], thesis.MOVE_FPS[count], strict=True):
            response[row, what] = f"{short(found[f'move/{count}/{what}'])} ({ms})"
            rate[row, what] = f"{short(found[f'move/{count}/rate_{what}'])} ({fps:.0f})"
        for beams, ms, fps in zip(thesis.BEAMS, thesis.SCAN_MS[count], thesis.SCAN_FPS[count], strict=True):
            mean, std = (found[f"scan{beams}/{count}/{what}"] for what in ("mean", "std"))
            scans[row, f"{beams} beams"] = f"{short(mean)} ± {short(std)} ({ms[0]} ± {ms[1]})"
            scan_rates[row, f"{beams} beams"] = f"{short(found[f'scan{beams}/{count}/rate_mean'])} ({fps:.0f})"
    tables = {
        "moves: response, ms": response,
        "moves: steps per second": rate,
        "scans: response, ms": scans,
        "scans: steps per second": scan_rates,
    }
    return with_source(
        results, "server", "\n".join(pivot(cells, f"drones; {title}") for title, cells in tables.items())
    )


def server_streams(results: dict[str, Result]) -> str:
    """Return the table of the cost of camera streams."""
    found = figures_of(results, "server", "server/streams/")
    texts = {
        "steps_per_second": ("steps per second without streams", number),
        "steps_per_second_watched": ("with streams", number),
        "images_per_second": ("images per second", number),
        "steps_lost": ("steps lost", percentage),
        "steps_lost_beside_encoding": (
            "steps lost beside another process that encodes as many images, without streams",
            percentage,
        ),
        "encoding": ("time of all cores that encoding takes", percentage),
        "reading": ("time of all cores that the reading client takes", percentage),
    }
    rows = [f"| {text} | {shown(found[name])} |" for name, (text, shown) in texts.items() if name in found]
    return with_source(results, "server", "\n".join(["| | |", "|---|---:|", *rows]) + "\n")


def percentage(value: float) -> str:
    """Format a fraction: 12 %."""
    return f"{100 * value:.0f} %"


def percent_1(value: float) -> str:
    """Format a fraction: 99.2 %."""
    return f"{100 * value:.1f} %"


def seconds(value: float) -> str:
    """Format a time: 7.4 s, 74 s."""
    return f"{value:.1f} s" if value < 20 else f"{value:.0f} s"


def with_content(text: str, name: str, content: str) -> str:
    """Return a document with the content between the markers of this name."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        sys.exit(f"{text.splitlines()[0]}: expected one {begin} and after it one {end}")
    before, rest = text.split(begin)
    return f"{before}{begin}\n{content}{end}{rest.split(end)[1]}"


def tried(text: str) -> str:
    """Return a document with the counts of `./dev try` between its markers."""

    def cell(match: re.Match[str]) -> str:
        path = KEPT / "tried" / f"{match[1]}.json"
        if not path.exists():
            return f"<!-- tried {match[1]} -->not yet<!-- /tried -->"
        result = json.loads(path.read_text())
        remark = f" ({result['remark']})" if "remark" in result else ""
        return f"<!-- tried {match[1]} -->{result['count']:,} {result['unit']}{remark}<!-- /tried -->"

    return re.sub(r"<!-- tried (\w+) -->.*?<!-- /tried -->", cell, text)


def keep() -> None:
    """Copy new results to the committed folder."""
    fresh = sorted(FRESH.glob("*.json"))
    if not fresh and not any(TRIED.glob("*.json")):
        sys.exit(f"{FRESH}: no results; run ./dev bench first")
    KEPT.mkdir(parents=True, exist_ok=True)
    refuse_unknown_sources(read(FRESH))
    for path in fresh:
        shutil.copy(path, KEPT / path.name)
    for path in sorted(TRIED.glob("*.json")):
        (KEPT / "tried").mkdir(exist_ok=True)
        shutil.copy(path, KEPT / "tried" / path.name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="folder of the results")
    parser.add_argument("--keep", action="store_true", help="copy out/bench/*.json to bench/results/ first")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if a document is out of date")
    args = parser.parse_args()
    if args.check and args.keep:
        parser.error("--check changes nothing, --keep does")
    if args.keep:
        keep()
    # A check must not depend on files in out/, and after --keep bench/results/ is complete.
    default = KEPT if args.check or args.keep or not any(FRESH.glob("*.json")) else FRESH
    results = read(args.folder or default)
    refuse_unknown_sources(results)
    refuse_lost_commits(read(KEPT / "tried"))
    documents = {
        README: with_content(README.read_text(encoding="utf-8"), "headline", headline(results)),
        BENCHMARKS: with_content(BENCHMARKS.read_text(encoding="utf-8"), "figures", table(results)),
        ARCHITECTURE: tried(with_content(ARCHITECTURE.read_text(encoding="utf-8"), "stages", stages(results))),
        CAMERAS: CAMERAS.read_text(encoding="utf-8"),
        OWN_WORLD: with_content(OWN_WORLD.read_text(encoding="utf-8"), "plans", plans(results)),
        DYNAMICS: DYNAMICS.read_text(encoding="utf-8"),
        BOARD: BOARD.read_text(encoding="utf-8"),
        RACE: with_content(
            with_content(RACE.read_text(encoding="utf-8"), "race steps", races(results)),
            "race board",
            race_board(results),
        ),
        DODGE: with_content(DODGE.read_text(encoding="utf-8"), "dodge", dodge(results)),
        SEVERAL_DRONES: with_content(SEVERAL_DRONES.read_text(encoding="utf-8"), "meetings", meetings(results)),
        SWAP: with_content(SWAP.read_text(encoding="utf-8"), "swap", swap(results)),
        FORMATION: with_content(FORMATION.read_text(encoding="utf-8"), "formation", formation(results)),
        LIVING_WORLDS: with_content(LIVING_WORLDS.read_text(encoding="utf-8"), "bodies", bodies(results)),
        TRAINERS: with_content(TRAINERS.read_text(encoding="utf-8"), "trainers", trainers(results)),
        SEVERAL: SEVERAL.read_text(encoding="utf-8"),
        FLIGHT_TASKS: with_content(
            with_content(FLIGHT_TASKS.read_text(encoding="utf-8"), "flight training", flight_training(results)),
            "by rotors",
            thesis_by_rotors(results),
        ),
    }
    for marker, write in {
        "accuracy": accuracy,
        "other accuracy": other_accuracy,
        "settling": settling,
        "ten steps ahead": ten_steps,
        "costs": costs,
    }.items():
        documents[DYNAMICS] = with_content(documents[DYNAMICS], marker, write(results))
    for marker, write in {
        "engines": engines,
        "engines 16": engines_16,
        "many machines": many_machines,
        "workers": workers,
        "pickles": pickles,
    }.items():
        documents[SEVERAL] = with_content(documents[SEVERAL], marker, write(results))
    for marker, write in {"board": board, "seeds": board_seeds, "curves": board_curves}.items():
        documents[BOARD] = with_content(documents[BOARD], marker, write(results))
    for marker, write in {
        "frames": frames,
        "frames gpu": frames_gpu,
        "modes": modes,
        "imaging": imaging,
    }.items():
        documents[CAMERAS] = with_content(documents[CAMERAS], marker, write(results))
    for marker, write in {
        "scaling": scaling,
        "peers": peers,
        "mesh peers": mesh_peers,
        "server round trips": server_round_trips,
        "server vector env": server_vector_env,
        "server clients": server_clients,
        "server streams": server_streams,
    }.items():
        documents[BENCHMARKS] = with_content(documents[BENCHMARKS], marker, write(results))
    for path, text in documents.items():
        if text == path.read_text(encoding="utf-8"):
            continue
        if args.check:
            sys.exit(f"{path.name}: its figures are out of date: run python3 bench/table.py --keep")
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
