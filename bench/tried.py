"""Run the extensive trials: `./dev try [NAME...]` repeats the key tests far more often than the test suite.

moves    pushes and turns at rest against walls, 0 to 10 km from the origin: the resting gap never shrinks
pushes   ticks of rotor-driven drones that push against walls and corners: none ever penetrates
motions  sweeps against fine stepping with an independent convex distance
encounters   motions among moving bodies against fine stepping with an independent convex distance: the first contacts
shoves       pushes by bodies among walls and other bodies: no drone is inside anything unless it is reported
crushes      ticks of rotor-driven drones among bodies that push them: none is inside anything unless it is reported
tumbles      ticks of drones that tumble onto solids, meshes, bodies and each other: none freezes, or gains energy
meetings     motions of drones that touch each other, kinematic and by rotors, among bodies: none is inside another one
body_rays    LiDAR beams and camera pixels among bodies of 1 mm to 100 m, against closed forms in double precision
rays     rays traced directly, through Embree, and by closed forms in double precision
agreement     LiDAR rays in worlds of primitives and triangles, in tiles, through Embree, and by closed forms
watertight    rays at corners and edges of closed meshes, in tiles: none passes through
independence  rays in tiles, traced beside other rays and singly: the same bits
slices        rays in slices, each compared with all triangles and closed forms in double precision, or with Embree
slices_watertight    rays at corners and edges of closed meshes, in slices: none passes through
slices_independence  rays in slices, traced beside other rays and singly: the same bits
worlds   seeds of the generated worlds: each has a flown path, and in every fiftieth a planner finds one
attacks  random calls of `batch.bodies`, many of them invalid: none crashes or hangs, and a refused one changes nothing
soak     clients that connect, fly, read, stream, break off and send nonsense: the server's memory and files do not grow
scene, obj, ply, gltf, snapshot, calls, messages   the fuzzers, with address and undefined-behaviour sanitizers

Each writes its number of trials to out/tried/NAME.json; bench/table.py --keep copies it from there. The first sixteen
run in parts, each with its own seeds, and write after each part. A stopped run continues with the next part, on another
machine from the stored results.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import xml.etree.ElementTree

import body_attack
import soak
import table
from run import ROOT, commit, machine

OUT = ROOT / "out" / "tried"
#: Tests of the C++ engine, their number of parts, the number of trials in a part as a multiple of the test suite's, and
#: what they count.
TESTS = {
    "moves": ("*Creep*", 51, 20, "moves"),
    "pushes": ("Contact.Pushed*", 30, 10, "pushes"),
    "motions": ("SweepAgainstFineStepping*", 10, 10, "motions"),
    "encounters": ("Encounters*", 10, 20, "motions"),
    "shoves": ("Shoves*:Push*", 10, 150, "pushes"),
    "crushes": ("ContactInACrowd.NoDrone*", 10, 10, "ticks"),
    "tumbles": ("Tumbles.No*", 10, 8, "ticks"),
    "meetings": ("Meetings*", 10, 50, "motions"),
    "body_rays": ("BodyRays*", 10, 25, "rays"),
    "rays": ("Agreement*", 20, 50, "rays"),
    "agreement": ("TracerAgreement*", 21, 750, "rays"),
    "watertight": ("MeshTiles.NoRay*", 20, 1700, "rays"),
    "independence": ("MeshTiles.ARays*", 20, 6000, "rays"),
    "slices": ("SlicesAgreement*", 10, 50, "rays"),
    "slices_watertight": ("SlicesWatertight*", 10, 25, "rays"),
    "slices_independence": ("MeshSlices.ARays*", 10, 80, "rays"),
}
#: Generators of worlds, and the cell size (m) with which a planner finds a path in each.
WORLDS = {"forest": 0.5, "office": 0.5, "warehouse": 0.6}
SEEDS, PLANNED = 1000, 50  # seeds per generator; one world in PLANNED is planned
FUZZERS = ("scene", "obj", "ply", "gltf", "snapshot", "calls", "messages")
SOAK_S = 1800.0
CALLS = 1_000_000
RUNS, HOUR_S = 1_000_000, 3600  # limits of a fuzzer, whichever is reached first


def run_part(name: str, part: int) -> int:
    """Run the tests with the seeds of a part and return their count."""
    tests, _, times, _ = TESTS[name]
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
    """Run the parts without a result, and write after each."""
    known = [trials[name] for trials in (table.read(OUT), table.read_trials()) if name in trials]
    parts = max((result.get("parts", []) for result in known), key=len, default=[])
    done = {part.get("part", index) for index, part in enumerate(parts)}
    for number in sorted(set(range(TESTS[name][1])) - done):
        parts.append({"part": number, **source(), "count": run_part(name, number)})
        print(f"{name}: part {number + 1} of {TESTS[name][1]}, {parts[-1]['count']:,} {name}", flush=True)
        count = sum(part["count"] for part in parts)
        write(name, {**source(), "count": count, "unit": TESTS[name][3], "parts": parts})


def run_fuzzer(name: str, runs: int) -> int:
    """Run a fuzzer, starting from its stored corpus; return the number of inputs tried."""
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
    """Generate worlds and return their number."""
    import flockstep

    for generator, cell_m in WORLDS.items():
        for seed in range(seeds):
            world = getattr(flockstep.World, generator)(seed)  # raises an error if its own flight finds no path
            flockstep.DroneVectorEnv(1, worlds=world, random_start=True).reset(seed=seed)
            if seed % PLANNED == 0 and flockstep.plan(world, world.start, [world.goal], cell_m=cell_m) is None:
                raise SystemExit(f"{generator} {seed}: no path found")
    return seeds * len(WORLDS)


def run_attacks(calls: int) -> int:
    """Call the bodies of batches at random and return the number of calls."""
    counts = body_attack.run(calls)
    print(f"attacks: {counts['accepted']:,} accepted, {counts['refused']:,} refused", flush=True)
    return counts["accepted"] + counts["refused"]


def source() -> dict[str, str]:
    return {"commit": commit(), "cpu": machine()["cpu"]}


def write(name: str, result: dict[str, object]) -> None:
    print(f"{name}: {result['count']:,} {result['unit']}", flush=True)
    if str(result["commit"]).endswith("-dirty"):
        print("   not written: the checkout has changes")
    else:
        (OUT / f"{name}.json").write_text(table.lines_of(result))


def main() -> None:
    names = [*TESTS, "worlds", "attacks", "soak", *FUZZERS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(names)}; all without one")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each generator of worlds")
    parser.add_argument("--runs", type=int, default=RUNS, help="of a fuzzer; it ends after an hour all the same")
    parser.add_argument("--calls", type=int, default=CALLS, help="of the random attack on bodies")
    parser.add_argument("--seconds", type=float, default=SOAK_S, help="of the soak test of the server")
    args = parser.parse_args()
    for name in args.names:
        if name not in names:
            parser.error(f"NAME: expected one of {', '.join(names)}, got {name!r}")
    OUT.mkdir(parents=True, exist_ok=True)
    for name in args.names or names:
        if name in TESTS:
            run_tests(name)
        elif name == "worlds":
            write(name, {**source(), "count": run_worlds(args.seeds), "unit": name})
        elif name == "attacks":
            write(name, {**source(), "count": run_attacks(args.calls), "unit": "calls"})
        elif name == "soak":
            write(name, {**source(), **soak.run(args.seconds)})
        else:
            write(name, {**source(), "count": run_fuzzer(name, args.runs), "unit": "runs"})


if __name__ == "__main__":
    main()
