"""The tables of figures: each comes from one commit and one processor, and names both."""

import json
import subprocess

import pytest

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
    figures = [{"name": "step/AVX3/microseconds", "value": 2.5, "unit": "us", "runs": 1}]
    (tmp_path / "step.json").write_text(json.dumps(result(figures=figures)))
    written = table.table(table.read(tmp_path))
    assert "| `step/AVX-512/microseconds` | 2.5 µs |" in written
    assert "2 logical processors, AVX-512, Embree" in written


def test_the_tables_of_the_documents_name_their_source():
    results = {"step": result(), "camera": result()}
    for write in (table.stages, table.frames, table.modes):
        assert write(results).startswith("Fast One, ")
        assert write({}) == "Not measured yet.\n"


def test_the_headline_names_threads_processor_commit_and_remark_of_each_row():
    def one(name, **changes):
        return result(figures=[{"name": name, "value": 2.5, "unit": "s", "runs": 1}], **changes)

    written = table.headline(
        {
            "step": one("step/n1/microseconds"),
            "board": one(
                "board/lidar/seed0/flockstep_2/seconds", machine=MACHINE | {"simd": "AVX2"}, remark="By old code."
            ),
        }
    )
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in written.splitlines() if " 2.5 s " in line]
    assert rows == [
        ["a call of `step` with one drone", "2.5 s", "1", "Fast One, 2 logical, AVX3", "0123456, 2026-11-24"],
        [
            "time to train a policy of the kinematic LiDAR task, 1.5 million steps, median of 5",
            "2.5 s",
            "2",
            "Fast One, 2 logical, AVX2",
            "0123456, 2026-11-24 ¹",
        ],
    ]
    assert written.endswith("\n\n¹ By old code.\n")
    assert written.count("not measured yet") == len(table.HEADLINE) - 2


def test_a_remark_is_shown_with_the_source():
    assert table.source(result(remark="By old code.")).endswith("; commit 0123456789ab. By old code.")


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
        with pytest.raises(SystemExit, match=f"train: expected a commit of this history, got {lost}"):
            table.refuse_lost_commits({"train": result(commit=lost, remark="By old code.")})
        with pytest.raises(SystemExit, match=f"pushes: .* got {lost}"):
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
    ("changes", "match"),
    [
        ({"commit": COMMIT + "-dirty"}, "train: expected a single commit .* got '0123.*-dirty'"),
        ({"commit": "unknown"}, "train: expected a single commit .* got 'unknown'"),
        ({"commit": [COMMIT, COMMIT]}, "train: expected a single commit"),
        ({"machine": {}}, "train: expected the name of one processor, got None"),
        ({"machine": MACHINE | {"cpu": ["Fast One", "Slow One"]}}, "train: expected the name of one processor"),
    ],
)
def test_figures_of_no_or_several_sources_are_refused(changes, match, monkeypatch):
    monkeypatch.setattr(table, "may_be_in_history", lambda commit: True)
    table.refuse_unknown_sources({"train": result()})
    with pytest.raises(SystemExit, match=match):
        table.refuse_unknown_sources({"train": result(**changes)})


def test_the_table_of_trainers_has_the_medians_of_its_seeds():
    def figures(program, steps, flown):
        told = {"unit": "1", "runs": 1, "program": program, "version": "lib 1.0", "autoreset_mode": "same_step"}
        values = {"steps_per_second": [3000, 1000, 2000], "steps": steps, "playgrounds": flown}
        return [
            {"name": f"trainers/{program}/seed{i}/{name}", "value": value, **told}
            for name, row in values.items()
            for i, value in enumerate(row)
        ]

    slow = figures("slow.py", [5000, 9000, 4000], [7, 5, 6])
    never = figures("never.py", [9000, 9000, 4000], [0, 5, 6])
    written = table.trainers({"trainers": result(figures=[*slow, *never])})
    assert written.startswith("Fast One, ")
    assert "| `slow.py` | lib 1.0 | same_step | 2,000 | 5,000 (2 of 3 seeds) |" in written
    assert "| `never.py` | lib 1.0 | same_step | 2,000 | more than 9,000 (1 of 3 seeds) |" in written
    assert table.trainers({}) == "Not measured yet.\n"


def of_flight(name, *figures):
    """Results of a benchmark with the figures (name, value, unit, more)."""
    return {
        name: result(
            figures=[
                {"name": f"{name}/{what}", "value": value, "unit": unit, "runs": 1, **more}
                for what, value, unit, more in figures
            ]
        )
    }


def test_the_tables_of_flight():
    results = of_flight(
        "dynamics_accuracy",
        ("error/x500/rk4/200/mm", 0.02573, "mm", {}),
        ("error/x500/rk4/200/degrees", 0.00004178, "°", {}),
        ("tour/x500/mm", 12.34, "mm", {}),
        ("settling/x500/seconds_to_90_percent", 1.106, "s", {}),
        ("settling/x500/overshoot_percent", 0.0, "%", {}),
        ("ten_steps_ahead/x500/10/m", 0.6811, "m", {}),
    )
    assert "| x500, rk4 | 0.026 mm, 0.000042° |" in table.accuracy(results)
    assert "| x500 on a tour with its controller: distance between midpoint and rk4 | 12 mm |" in table.other_accuracy(
        results
    )
    assert "| x500 | 1.1 s | 0 % |" in table.settling(results)
    assert "| x500 | 0.68 m |" in table.ten_steps(results)
    assert table.table(results).startswith("Not measured yet: ")  # they are in no table
    results = of_flight(
        "dynamics", ("cost/body_drag/ns_per_substep", 1.5, "ns", {}), ("contact/open/ns_per_substep", 1234.0, "ns", {})
    )
    added, in_all = table.costs(results).split("| total cost")
    assert "| body drag | 1.5 ns | a substep |" in added and "| open | 1,200 ns | a substep |" in in_all
    for write in (table.accuracy, table.other_accuracy, table.settling, table.ten_steps, table.costs, table.peers):
        assert write({}) == "Not measured yet.\n"


def test_the_table_of_peers_has_what_could_not_be_measured():
    about = {"version": "1.2", "mode": "euler"}
    written = table.peers(
        of_flight(
            "dynamics_peers",
            ("slow/simulator/euler/per_second", 12345.0, "1/s", about),
            ("slow/simulator/euler/ours_over_it", 98.76, "1", about),
            ("flockstep_beside_slow/simulator/rk4/per_second", 1219190.0, "1/s", about),
            ("slow/flight/lag: euler/mm", 4.729, "mm", {**about, "reason": "of first order"}),
            ("slow/flight/lag: euler/degrees", 0.1077, "°", {**about, "reason": "of first order"}),
            ("gone/measured", 0.0, "1", {"error": "no such package"}),
        )
    )
    assert "| slow 1.2, simulator: euler | 12,345 | 99 |" in written
    assert "| flockstep 1.2, simulator: rk4 (beside slow) | 1,219,190 |" in written
    assert "| gone | not measured: no such package |  |" in written
    assert "| slow, lag: euler | 4.7 mm | 0.11° | of first order |" in written


def test_the_tables_of_ray_casters_have_a_column_for_each_world_and_sensor():
    about, ours = {"version": "1.2", "mode": "cast"}, {"version": "0.1", "mode": "Batch"}
    written = table.mesh_peers(
        of_flight(
            "mesh_peers",
            ("office/triangles", 51926, "1", {}),
            ("office/camera/rays", 7372800, "1", {}),
            ("office/camera/misses", 0.25, "1", {}),
            ("slow/office, camera/cast/per_second", 8765432.0, "1/s", about),
            ("slow/office, camera/cast/differing_in_a_million", 0.2713, "1", about),
            ("slow/office, camera/cast/ours_over_it", 15.1, "1", about),
            ("slow/office, camera/cast/raycast_over_it", 1.234, "1", about),
            ("slow/city, LiDAR/cast/per_second", 765432.0, "1/s", about),
            ("flockstep_beside_slow/office, camera/Batch/per_second", 123456789.0, "1/s", ours),
            ("flockstep_beside_slow/office, camera/Batch/differing_in_a_million", 0.0, "1", ours),
            ("gone/measured", 0.0, "1", {"error": "no such package"}),
        )
    )
    assert "| office | 51,926 | 7,372,800 | 25 % |" in written
    rates, batch, raycast, differing = (part.splitlines() for part in written.split("\n\n")[2:])
    assert rates[0] == "| million rays a second | office, camera | city, LiDAR |"
    assert "| slow 1.2: cast | 8.77 | 0.765 |" in rates
    assert "| flockstep 0.1: Batch (beside slow) | 123 |  |" in rates
    assert "| gone | not measured: no such package |  |" in rates
    assert batch[2:] == ["| slow 1.2: cast | 15 |"] and raycast[2:] == ["| slow 1.2: cast | 1.2 |"]
    assert differing[2:] == ["| slow 1.2: cast | 0.27 |", "| flockstep 0.1: Batch | 0 |"]
    assert table.mesh_peers({}) == "Not measured yet.\n"
    assert table.table(of_flight("mesh_peers")).startswith("Not measured yet: ")  # it is in no table


def test_the_tables_of_the_server():
    values = {
        "round_trip/pinned/get_location/request": 10,
        "round_trip/pinned/get_location/reply": 24,
        "round_trip/pinned/get_location/tcp/p50": 12.5,
        "round_trip/pinned/get_location/async/p50": 15.04,
        "round_trip/pinned/get_location/cpp/p50": 25,
        "round_trip/pinned/get_location/cpp/ratio_to_tcp": 2,
        "round_trip/pinned/get_location/cpp/ratio_to_async": 1.66,
        "vector_env/pinned/in_process": 3_000_000,
        "vector_env/pinned/remote": 2_100_000,
        "vector_env/pinned/ratio": 0.7,
        "vector_env/pinned/unix": 2_400_000,
        "vector_env/pinned/unix_ratio": 0.8,
        "streams/steps_per_second": 1000,
        "streams/steps_lost": 0.25,
    }
    for load in ("move", "scan35", "scan125", "scan250", "scan500", "scan1000"):
        for what in ("mean", "std", "min", "max", "p5", "p25", "p75", "p95"):
            values |= {f"clients/{load}/2/{what}": 0.0456, f"clients/{load}/2/rate_{what}": 999.6}
    figures = [{"name": f"server/{name}", "value": value, "unit": "1", "runs": 1} for name, value in values.items()]
    results = {"server": result(figures=figures)}
    assert "| `get_location`, 10 to 24 B | 12.5 | 15 | 25 (2.0 / 1.7) |" in table.server_round_trips(results)
    assert (
        "| server and client on one core | 3,000,000 | 2,100,000 (0.70) | 2,400,000 (0.80) |"
        in table.server_vector_env(results)
    )
    written = table.server_clients(results)
    assert "| 2 | 0.0456 (3.6) | 0.0456 (0.25) | 0.0456 (0.46) | 0.0456 (8.69) |" in written
    assert "| 2 | 1,000 (273) | 1,000 (14) | 1,000 (215) | 1,000 (400) |" in written
    assert "| 2 | 0.0456 ± 0.0456 (0.13 ± 0.03) | 0.0456 ± 0.0456 (0.38 ± 0.08) |" in written
    assert "| 2 | 1,000 (286) | 1,000 (287) |" in written
    assert "| steps lost | 25 % |" in table.server_streams(results)
    for write in (table.server_round_trips, table.server_vector_env, table.server_clients, table.server_streams):
        assert write(results).startswith("Fast One, ")
        assert write({}) == "Not measured yet.\n"


def test_the_table_of_race_steps():
    values = {"solid_gates/5_ticks": 0.2986, "open_gates/5_ticks": 0.2556, "solid_gates/10_ticks": 0.4213}
    figures = [{"name": f"race/{name}/step", "value": v, "unit": "us", "runs": 1} for name, v in values.items()]
    written = table.races({"race": result(figures=figures)})
    assert "| one drone, one thread | solid gates | not solid |" in written
    assert "| 5 ticks | 0.3 us | 0.26 us |" in written
    assert "| 10 ticks | 0.42 us |  |" in written


def test_the_trainings_of_dodge():
    values = {
        "straight/success": (0.2, "1"),
        "straight/contacts_per_minute": (15.123, "1/min"),
        "living/0/success": (0.8125, "1"),
        "living/0/training_s": (251.0, "s"),
    }
    figures = [{"name": f"dodge/{name}", "value": v, "unit": unit, "runs": 1} for name, (v, unit) in values.items()]
    written = table.dodge({"dodge": result(figures=figures)})
    assert "| 1,000 flights | success | contacts per minute | training |" in written
    assert "| flies straight to the goal | 20.0 % | 15.12 |  |" in written
    assert "| trained among bodies, seed 0 | 81.2 % |  | 251 s |" in written


def test_the_trainings_of_swap():
    values = {
        "straight/success_of_8": (0.0, "1"),
        "trained/0/success_of_2": (1.0, "1"),
        "trained/0/success_of_8": (0.9512, "1"),
        "trained/0/seconds": (12.34, "s"),
        "trained/0/training_s": (251.0, "s"),
    }
    figures = [{"name": f"swap/{name}", "value": v, "unit": unit, "runs": 1} for name, (v, unit) in values.items()]
    written = table.swap({"swap": result(figures=figures)})
    assert "| swaps without a touch | 8 drones | 2 drones | time of 8 drones | training |" in written
    assert "| fly straight to their goals | 0.0 % |  |  |  |" in written
    assert "| trained, seed 0 | 95.1 % | 100.0 % | 12.3 s | 251 s |" in written


def test_the_trainings_of_formation():
    values = {
        "straight/hall_success": (0.25, "1"),
        "straight/hall_error_m": (0.1234, "m"),
        "ahead/hall_success": (0.99, "1"),
        "trained/2/hall_success": (1.0, "1"),
        "trained/2/training_s": (251.0, "s"),
    }
    figures = [{"name": f"formation/{name}", "value": v, "unit": unit, "runs": 1} for name, (v, unit) in values.items()]
    written = table.formation({"formation": result(figures=figures)})
    assert "| 4 drones | success, halls | error, halls | training |" in written
    assert "| fly straight to their places | 25.0 % | 12.3 cm |  |" in written
    assert "| fly to where their places will be | 99.0 % |  |  |" in written
    assert "| trained, seed 2 | 100.0 % |  | 251 s |" in written


def test_the_costs_of_bodies():
    values = {
        "lidar_task/static/steps_per_second": (2_000_000.0, "1/s"),
        "lidar_task/moving/steps_per_second": (1_240_000.0, "1/s"),
        "lidar_task/moving/ratio_to_static": (0.6213, "1"),
        "cameras/still/frames_per_second": (61_234.0, "1/s"),
        "cameras/still/ratio_to_static": (0.8765, "1"),
        "script/random_walk/ns_per_tick": (46.98, "ns"),
    }
    figures = [{"name": f"bodies/{name}", "value": v, "unit": unit, "runs": 7} for name, (v, unit) in values.items()]
    written = table.bodies({"bodies": result(figures=figures)})
    assert "| 64 solids in the static world | 2,000,000 |  |" in written
    assert "| 64 bodies that move | 1,240,000 | 0.62 |" in written
    assert "| the mesh as a body that stands | 61,234 | 0.88 |" in written
    assert "| random walk | 47 ns |" in written
