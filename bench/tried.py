"""What `./dev try [NAME...]` runs: what the promises rest on, tried far more often than the tests do.

moves    pushes and turns at rest against walls, 0 to 10 km from the origin: no gap is eaten
pushes   ticks of drones that fly by rotors and push against walls and corners: none is ever inside
motions  sweeps against fine stepping with an independent convex distance
rays     rays traced directly, through Embree, and by closed forms in double precision
agreement     rays of LiDARs in worlds of primitives and triangles, in tiles, through Embree, and by closed forms
watertight    rays at corners and edges of closed meshes, in tiles: none slips through
independence  rays in tiles, and the same beside other rays and alone: no bit differs
worlds   seeds of the generated worlds: each has a way that has been flown, of every fiftieth a planner finds one
extensions   the patches of tests/extensions, applied to a copy, built and run; only if named
scene, obj, ply, gltf, snapshot, calls   the fuzzers, with address and undefined sanitizers

Each writes how often it tried to out/tried/NAME.json; bench/table.py --keep takes it from there. The first seven run in
parts, each with seeds of its own, and write after each: what was stopped goes on with the next part, on another machine
from what was kept.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree

import pybind11

from run import ROOT, commit, machine

OUT = ROOT / "out" / "tried"
KEPT = ROOT / "bench" / "results" / "tried"
#: Tests of the C++ engine, how many parts they run in, and how many times as often as in the suite a part tries.
TESTS = {
    "moves": ("*Creep*", 51, 20),
    "pushes": ("Contact.Pushed*", 30, 10),
    "motions": ("SweepAgainstFineStepping*", 10, 10),
    "rays": ("Agreement*", 20, 50),
    "agreement": ("TracerAgreement*", 21, 750),
    "watertight": ("MeshTiles.NoRay*", 20, 1700),
    "independence": ("MeshTiles.ARays*", 20, 6000),
}
UNITS = dict.fromkeys(("agreement", "watertight", "independence"), "rays")  # what else they count than their name
#: Generators of worlds, and the cells (m) of a planner that finds a way in each.
WORLDS = {"forest": 0.5, "office": 0.5, "warehouse": 0.6}
SEEDS, PLANNED = 1000, 50  # of each generator; one of so many is planned
FUZZERS = ("scene", "obj", "ply", "gltf", "snapshot", "calls")
RUNS, HOUR_S = 1_000_000, 3600  # of a fuzzer, whichever comes first


def run_part(name: str, part: int) -> int:
    """Run the tests with the seeds of a part; return what they have counted."""
    tests, _, times = TESTS[name]
    report = OUT / f"{name}.xml"
    subprocess.run(
        [ROOT / "build/release/flockstep_tests", f"--gtest_filter={tests}", f"--gtest_output=xml:{report}"],
        check=True,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"FLOCKSTEP_TRY": str(times), "FLOCKSTEP_TRY_PART": str(part)},
    )
    properties = xml.etree.ElementTree.parse(report).getroot().iter("property")
    return sum(int(p.attrib["value"]) for p in properties if p.attrib["name"] == f"tried_{name}")


def run_tests(name: str) -> None:
    """Run the parts that no result has yet; write each."""
    known = [json.loads(place.read_text()) for place in (OUT / f"{name}.json", KEPT / f"{name}.json") if place.exists()]
    parts = max((result.get("parts", []) for result in known), key=len, default=[])
    for number in range(len(parts), TESTS[name][1]):
        parts.append({**source(), "count": run_part(name, number)})
        print(f"{name}: part {number + 1} of {TESTS[name][1]}, {parts[-1]['count']:,} {name}", flush=True)
        count = sum(part["count"] for part in parts)
        write(name, {**source(), "count": count, "unit": UNITS.get(name, name), "parts": parts})


def run_fuzzer(name: str, runs: int) -> int:
    """Run a fuzzer from its kept corpus on; return how many inputs it has tried."""
    found = ROOT / "out" / "fuzz" / name
    found.mkdir(parents=True, exist_ok=True)
    limits = [f"-runs={runs}", f"-max_total_time={HOUR_S}", "-timeout=20", "-rss_limit_mb=4096", "-print_final_stats=1"]
    places = [f"-artifact_prefix={found}-", str(found), str(ROOT / "tests/fuzz/corpus" / name)]
    with (OUT / f"{name}.log").open("w") as log:
        subprocess.run(
            [ROOT / "build/fuzz" / f"fuzz_{name}", *limits, *places],
            check=True,
            stderr=log,
            env=os.environ | {"UBSAN_OPTIONS": "print_stacktrace=1"},
        )
    executed = re.findall(r"stat::number_of_executed_units:\s*(\d+)", (OUT / f"{name}.log").read_text())
    return int(executed[-1])


def run_worlds(seeds: int) -> int:
    """Generate worlds; return how many."""
    import flockstep

    for generator, cell_m in WORLDS.items():
        for seed in range(seeds):
            world = getattr(flockstep.World, generator)(seed)  # refuses where it has flown no way
            flockstep.DroneVectorEnv(1, worlds=world, random_start=True).reset(seed=seed)
            if seed % PLANNED == 0 and flockstep.plan(world, world.start, [world.goal], cell_m=cell_m) is None:
                raise SystemExit(f"{generator} {seed}: no way is found")
    return seeds * len(WORLDS)


def run_extensions() -> None:
    """Apply the patches of tests/extensions to a copy of the tracked files, build it and run their tests."""
    copy = ROOT / "build" / "extensions"
    shutil.rmtree(copy, ignore_errors=True)
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in files.rstrip("\0").split("\0"):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    for patch in sorted((ROOT / "tests" / "extensions").glob("*.patch")):
        subprocess.run(["git", "apply", "--directory", copy.relative_to(ROOT), patch], cwd=ROOT, check=True)
    for test in (copy / "tests" / "engine").rglob("*_test.cpp"):
        if (ROOT / test.relative_to(copy)).exists():  # not of a patch
            test.unlink()
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "FLOCKSTEP_TESTS": "ON",
        "FLOCKSTEP_WERROR": "ON",
        "FLOCKSTEP_PYTHON": "ON",
    }
    options |= {"pybind11_DIR": pybind11.get_cmake_dir(), "Python_EXECUTABLE": sys.executable}
    build = copy / "build"
    subprocess.run(
        ["cmake", "-S", copy, "-B", build, "-G", "Ninja", *(f"-D{k}={v}" for k, v in options.items())], check=True
    )
    subprocess.run(["cmake", "--build", build, "--target", "flockstep_tests", "_core"], check=True)
    subprocess.run([build / "flockstep_tests", "--gtest_filter=Altimeter.*:Charge.*:Climb.*:HeightGrid.*"], check=True)
    for module in build.glob("_core.*"):
        shutil.copy2(module, copy / "envs" / "flockstep")
    program = """
import sys
sys.meta_path = [finder for finder in sys.meta_path if "Redirecting" not in type(finder).__name__]  # of the checkout
import gymnasium
import flockstep
recipe = flockstep.Recipe.from_json('{"worlds": ["playground/train-1"], "num_envs": 2, "altimeters": [{}]}')
batch = flockstep.Batch.from_recipe(recipe)
batch.sense()
print(flockstep.__file__, batch.sensor("altimeter"), batch.charge)
assert batch.sensor("altimeter")["height"].shape == batch.charge.shape == (2,)
recipe.task = flockstep._core.ClimbConfig(height_m=1)
envs = flockstep.DroneVectorEnv.from_recipe(recipe)
envs.reset(seed=0)
_, reward, *_ = envs.step([[1.0], [-1.0]])
print(envs.recipe.task, reward)
assert reward[0] > 0 > reward[1]
assert gymnasium.make("flockstep/Climb-v0", step_m=0.2).unwrapped.action_space.shape == (1,)
"""
    subprocess.run([sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": str(copy / "envs")}, check=True)


def source() -> dict[str, str]:
    return {"commit": commit(), "cpu": machine()["cpu"]}


def write(name: str, result: dict[str, object]) -> None:
    print(f"{name}: {result['count']:,} {result['unit']}", flush=True)
    if str(result["commit"]).endswith("-dirty"):
        print("   not written: the checkout has changes")
    else:
        (OUT / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n")


def main() -> None:
    names = [*TESTS, "worlds", "extensions", *FUZZERS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(names)}; all without one")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each generator of worlds")
    parser.add_argument("--runs", type=int, default=RUNS, help="of a fuzzer; it ends after an hour all the same")
    args = parser.parse_args()
    for name in args.names:
        if name not in names:
            parser.error(f"nothing to try is called {name!r}: there are {', '.join(names)}")
    OUT.mkdir(parents=True, exist_ok=True)
    for name in args.names or [name for name in names if name != "extensions"]:
        if name == "extensions":
            run_extensions()
        elif name in TESTS:
            run_tests(name)
        elif name == "worlds":
            write(name, {**source(), "count": run_worlds(args.seeds), "unit": name})
        else:
            write(name, {**source(), "count": run_fuzzer(name, args.runs), "unit": "runs"})


if __name__ == "__main__":
    main()
