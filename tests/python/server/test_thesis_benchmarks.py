"""The benchmarks of the thesis's chapter 5 (`./dev thesis movement scans cameras`), for a moment each."""

from pathlib import Path

import pytest
from cpp_programs import ROOT, WARNINGS, install, run
from messages import refused

import timing
from thesis import benchmarks

ORDERED = ("min", "p5", "p25", "p75", "p95", "max")
COLUMNS = {"mean", "std", "over_time", *ORDERED}


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the program that loads a server."""
    prefix, folder = install(tmp_path_factory.mktemp("client"), "client"), tmp_path_factory.mktemp("bench")
    lib = next(prefix.rglob("libflockstep_client.so")).parent
    paths = ("-I", ROOT / "bench", "-I", prefix / "include", "-L", lib, f"-Wl,-rpath,{lib}")
    source = ROOT / "bench" / "clients.cpp"
    run("g++", "-std=c++20", *WARNINGS, *paths, source, "-o", folder / "clients", "-lflockstep_client", "-pthread")
    return folder


@pytest.mark.parametrize(
    ("job", "row", "drones"),
    [("movement", "2", 2), ("scans", "125_2", 2), ("cameras", "on_movement_moving_simple_1", 1)],
)
def test_a_row_has_the_columns_of_the_tables(job, row, drones, programs, monkeypatch):
    monkeypatch.setenv("FLOCKSTEP_BENCH_DIR", str(programs))
    measured = [
        timing.figure(*each) if isinstance(each, tuple) else each for each in getattr(benchmarks, job)(0.5)[row]()
    ]
    figures = {each["name"]: each for each in measured}
    assert len(figures) == len(measured)
    assert set(figures) == {"requests", "rate_samples", *COLUMNS, *(f"rate_{name}" for name in COLUMNS)}
    assert figures["requests"]["value"] >= drones and figures["rate_samples"]["value"] >= 1
    for prefix, unit in (("", "ms"), ("rate_", "1/s")):
        values = [figures[prefix + name]["value"] for name in ORDERED]
        assert values == sorted(values) and values[0] > 0
        assert values[0] <= figures[f"{prefix}mean"]["value"] <= values[-1]
        assert {figures[prefix + name]["unit"] for name in COLUMNS} == {unit}
        curve = figures[f"{prefix}over_time"]["curve"]
        assert curve and curve == sorted(curve) and all(value > 0 for _, value in curve)


def test_the_tables_have_all_rows():
    assert len(benchmarks.movement()) == 9
    assert len(benchmarks.scans()) == 9 * 5
    assert len(benchmarks.cameras()) == 3 * 2 * 2 * 6 + 1
    images = {name: rate for name, rate, *_ in benchmarks.in_process(drones=2)}
    assert len(images) == 3 * 2 * 2 and min(images.values()) > 0


def test_the_program_refuses_an_unknown_load(programs):
    with refused(AssertionError, "clients", "LOAD", '"hover"'):
        run(programs / "clients", "127.0.0.1:1", 1, "hover", 0.1)
