"""The tables of figures: each comes from one commit and one processor, and names both."""

import json
import subprocess

import pytest
from messages import refused

import table

MACHINE = {"cpu": "Fast One", "logical_processors": 2, "simd": "AVX3", "embree": "3", "python": "3.11"}
COMMIT = "0123456789abcdef0123456789abcdef01234567"
NOTE = {"note": "Of easy worlds only."}
FIGURES = [
    {"name": "train/a/seed0/success_rate", "value": 0.98, "unit": "1", "runs": 7, **NOTE},
    {"name": "train/a/seed0/seconds", "value": 31.25, "unit": "s", "runs": 1},
    {"name": "train/a/random_policy/success_rate", "value": 0.0, "unit": "1", "runs": 7, **NOTE},
]


def result(**changes):
    return {"machine": MACHINE, "commit": COMMIT, "commit_date": "2026-11-24", "figures": FIGURES, **changes}


def results(bench, *figures):
    """Results of a bench, with its figures as (name, value, more keys)."""
    about = {"unit": "1", "runs": 1}
    return {
        bench: result(
            figures=[{"name": f"{bench}/{name}", "value": value, **about, **more} for name, value, more in figures]
        )
    }


def test_a_table_names_its_source_and_says_its_notes_once():
    written = table.table({name: result() for name in table.NAMES})
    first = written.split("**step**")[0]
    assert first.startswith(
        "**lidar**: Fast One, 2 logical processors, AVX3, Embree 3, Python 3.11; commit 0123456789ab"
    )
    assert "| `train/a/seed0` | 0.98 | 31.25 s |" in first
    assert "| `train/a/random_policy` | 0 |  |" in first  # beside the figures to compare with
    assert first.count("`success_rate`: Of easy worlds only.") == 1
    assert "Not measured" not in written


def test_results_are_read_in_plain_units(tmp_path):
    measured = results("step", ("AVX3/microseconds", 2.5, {"unit": "us"}))["step"]
    (tmp_path / "step.json").write_text(json.dumps(measured))
    written = table.table(table.read(tmp_path))
    assert "| `step/AVX-512/microseconds` | 2.5 µs |" in written
    assert "2 logical processors, AVX-512, Embree" in written


def test_the_headline_names_threads_processor_commit_and_remark_of_each_row():
    step = results("step", ("n1/microseconds", 2.5, {"unit": "s"}))
    board = results("board", ("lidar/seed0/flockstep_2/seconds", 2.5, {"unit": "s"}))
    board["board"] |= {"machine": MACHINE | {"simd": "AVX2"}, "remark": "By old code."}
    written = table.headline(step | board)
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in written.splitlines() if " 2.5 s " in line]
    assert [row[2:] for row in rows] == [
        ["1", "Fast One, 2 logical, AVX3", "0123456, 2026-11-24"],
        ["2", "Fast One, 2 logical, AVX2", "0123456, 2026-11-24 ¹"],
    ]
    assert written.endswith("\n\n¹ By old code.\n")
    assert written.count("not measured yet") == len(table.HEADLINE) - 2
    assert table.source(board["board"]).endswith("; commit 0123456789ab. By old code.")


@pytest.fixture
def history(tmp_path, monkeypatch):
    """A repository with two commits as the checkout of the tables; returns their hashes."""

    def git(*args):
        identity = ["-c", "user.name=n", "-c", "user.email=e"]
        done = subprocess.run(["git", "-C", tmp_path, *identity, *args], check=True, stdout=subprocess.PIPE, text=True)
        return done.stdout.strip()

    git("init", "-q")
    hashes = []
    for _ in range(2):
        git("commit", "-q", "--allow-empty", "-m", "m")
        hashes.append(git("rev-parse", "HEAD"))
    git("checkout", "-q", hashes[0])  # the second is known, but not in the history
    monkeypatch.setattr(table, "ROOT", tmp_path)
    return hashes


def test_commits_that_the_history_lacks_are_refused(history):
    first, second = history
    table.refuse_lost_commits({"train": result(commit=first)})
    for lost in (second, COMMIT):
        with refused(SystemExit, "train", lost):
            table.refuse_lost_commits({"train": result(commit=lost, remark="By old code.")})
        with refused(SystemExit, "pushes", lost):
            table.refuse_lost_commits({"pushes": {"commit": first, "parts": [{"commit": first}, {"commit": lost}]}})


def test_a_shallow_clone_and_a_folder_without_git_know_no_commits(history, tmp_path, monkeypatch):
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "-q", "--depth=1", f"file://{tmp_path}", shallow], check=True)
    (tmp_path / "archive").mkdir()  # unpacked within a repository
    for folder in (shallow, tmp_path / "archive", "/"):
        monkeypatch.setattr(table, "ROOT", folder)
        table.refuse_lost_commits({"train": result()})


def test_kept_results_have_a_line_for_each_figure():
    made = result(remark="By old code.", parts=[{"commit": COMMIT, "count": 1}])
    written = table.lines_of(made)
    assert json.loads(written) == made
    assert {json.dumps(figure) for figure in FIGURES} <= {line.strip(" ,") for line in written.splitlines()}
    for path in sorted(table.KEPT.rglob("*.json")):
        assert path.read_text() == table.lines_of(json.loads(path.read_text())), path.name


def test_counts_of_trials_have_their_remark(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "KEPT", tmp_path)
    (tmp_path / "tried").mkdir()
    kept = {"commit": COMMIT, "count": 1500, "unit": "moves", "remark": "by old code"}
    (tmp_path / "tried" / "moves.json").write_text(json.dumps(kept))
    assert table.tried("a <!-- tried moves -->?<!-- /tried --> b") == (
        "a <!-- tried moves -->1,500 moves (by old code)<!-- /tried --> b"
    )


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"commit": COMMIT + "-dirty"}, COMMIT + "-dirty"),
        ({"commit": "unknown"}, "unknown"),
        ({"commit": [COMMIT, COMMIT]}, [COMMIT, COMMIT]),
        ({"machine": {}}, None),
        ({"machine": MACHINE | {"cpu": ["Fast One", "Slow One"]}}, ["Fast One", "Slow One"]),
    ],
)
def test_figures_of_no_or_several_sources_are_refused(changes, got, monkeypatch):
    monkeypatch.setattr(table, "may_be_in_history", lambda commit: True)
    table.refuse_unknown_sources({"train": result()})
    with refused(SystemExit, "train", got):
        table.refuse_unknown_sources({"train": result(**changes)})


#: A table: how it is written, the results that it is of, and rows that must be in it.


def test_the_table_of_trainers_has_the_medians_of_its_seeds():
    def figures(program, steps, flown):
        about = {"program": program, "version": "lib 1.0", "autoreset_mode": "same_step"}
        rows = {"steps_per_second": [3000, 1000, 2000], "steps": steps, "playgrounds": flown}
        return [(f"{program}/seed{i}/{name}", row[i], about) for name, row in rows.items() for i in range(3)]

    slow, never = figures("slow.py", [5000, 9000, 4000], [7, 5, 6]), figures("never.py", [9000, 9000, 4000], [0, 5, 6])
    written = table.trainers(results("trainers", *slow, *never))
    assert written.startswith("Fast One, ")
    assert "| `slow.py` | lib 1.0 | same_step | 2,000 | 5,000 (2 of 3 seeds) |" in written
    assert "| `never.py` | lib 1.0 | same_step | 2,000 | more than 9,000 (1 of 3 seeds) |" in written


def test_the_table_of_peers_has_what_could_not_be_measured():
    about = {"version": "1.2", "mode": "euler"}
    written = table.peers(
        results(
            "dynamics_peers",
            ("slow/simulator/euler/per_second", 12345.0, about),
            ("slow/simulator/euler/ours_over_it", 98.76, about),
            ("slow/flight/lag: euler/mm", 4.729, {**about, "unit": "mm"}),
            ("gone/measured", 0.0, {"error": "no such package"}),
        )
    )
    assert "| slow 1.2, simulator: euler | 12,345 | 99 |" in written
    assert "| gone | not measured: no such package |  |" in written
    assert "| slow, lag: euler | 4.7 mm |" in written


@pytest.mark.parametrize(
    "name", ["stages", "frames", "costs", "server_clients", "mesh_peers", "races", "bodies", "board"]
)
def test_what_is_not_measured_is_no_error(name):
    """What the tables of the documents show of the kept results is compared by `./dev lint`."""
    assert getattr(table, name)({}) == "Not measured yet.\n"
