"""`./dev thesis`: rows that keep their results, and in a small size the experiments of chapter 6 and what it claims."""

import json
from dataclasses import replace

import pytest
from messages import refused

import flockstep
import thesis.__main__ as command
from flockstep.trainings.presets import Preset
from thesis import claims, experiments
from training import evaluate, tasks


@pytest.fixture
def job(monkeypatch, tmp_path):
    """A job of two rows, which counts how often each is measured."""
    counts = {"first": 0, "second": 0}

    def measure(row):
        counts[row] += 1
        yield "value", float(counts[row]), "s", 1

    monkeypatch.setattr(command, "JOBS", {"tiny": "test:tiny"})
    monkeypatch.setattr(command, "ROOT", tmp_path)
    monkeypatch.setattr(command, "OUT", tmp_path / "out")
    monkeypatch.setattr(command, "function", lambda path: lambda: {row: lambda row=row: measure(row) for row in counts})
    return counts


def called(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["thesis", *arguments])
    command.main()


def written(tmp_path):
    figures = json.loads((tmp_path / "out" / "bench" / "thesis_tiny.json").read_text())["figures"]
    return {each["name"]: each["value"] for each in figures}


def test_a_row_is_measured_once_and_again_when_asked(job, monkeypatch, tmp_path):
    called(monkeypatch, "tiny/second")
    assert (job, (tmp_path / "out" / "bench").exists()) == ({"first": 0, "second": 1}, False)
    called(monkeypatch, "tiny", "--kept")
    assert written(tmp_path) == {"thesis_tiny/second/value": 1}
    called(monkeypatch, "tiny")
    assert written(tmp_path) == {"thesis_tiny/first/value": 1, "thesis_tiny/second/value": 1}
    called(monkeypatch, "tiny", "--fresh")
    assert written(tmp_path) == {"thesis_tiny/first/value": 2, "thesis_tiny/second/value": 2}


def test_rows_of_several_commits_are_parts_and_of_several_machines_refused(job, monkeypatch, tmp_path):
    called(monkeypatch, "tiny/first")
    monkeypatch.setattr(command.run, "commit", lambda: "a" * 40)
    called(monkeypatch, "tiny")
    about = json.loads((tmp_path / "out" / "bench" / "thesis_tiny.json").read_text())
    assert about["commit"] == "a" * 40
    assert [part["what"] for part in about["parts"]] == ["first"]
    path = tmp_path / "out" / "thesis" / "tiny" / "first.json"
    path.write_text(path.read_text().replace('"cpu": "', '"cpu": "other '))
    with refused(SystemExit, "tiny", "machines", "--fresh"):
        called(monkeypatch, "tiny")


def test_rows_that_are_kept_in_the_checkout_are_not_measured_again(job, monkeypatch, tmp_path):
    called(monkeypatch, "tiny/first")
    monkeypatch.setattr(command.run, "commit", lambda: "a" * 40)
    called(monkeypatch, "tiny")
    kept = tmp_path / "out" / "bench" / "thesis_tiny.json"
    monkeypatch.setattr(command.table, "KEPT", kept.parent)
    before = json.loads(kept.read_text())
    (tmp_path / "out" / "thesis" / "tiny" / "first.json").unlink()  # a part
    called(monkeypatch, "tiny")
    assert json.loads(kept.read_text()) == before
    (tmp_path / "out" / "thesis" / "tiny" / "second.json").unlink()
    called(monkeypatch, "tiny")
    assert (json.loads(kept.read_text()), job) == (before, {"first": 1, "second": 1})


def test_unknown_jobs_and_rows_are_refused(job, monkeypatch, capsys):
    with refused(SystemExit, "NAME/ROW", "first", "second", "third"):
        called(monkeypatch, "tiny/third")
    with refused(SystemExit, "tiny", "kept"):
        called(monkeypatch, "tiny", "--kept")
    with pytest.raises(SystemExit):
        called(monkeypatch, "tyni")
    assert "expected one of tiny" in capsys.readouterr().err


@pytest.mark.parametrize("task", ["lidar", "camera"])
def test_an_experiment_keeps_its_policy_its_flights_and_its_curve(task, monkeypatch, tmp_path):
    monkeypatch.setattr(experiments, "POLICIES", tmp_path)
    monkeypatch.setattr(experiments, "MAX_STEPS", 40)
    whole = flockstep.thesis.lidar() if task == "lidar" else flockstep.thesis.camera(16)
    settings = {**whole, "n_steps": 64, "batch_size": 64, "n_epochs": 1}
    tiny = Preset(replace(whole._training, steps=512, settings=settings))
    worlds = ("train", "validation") if task == "lidar" else ("camera-train", "camera-validation")
    figures = {}
    for each in experiments.trained(tiny, "policy", 0, *worlds):
        name, value = (each["name"], each["value"]) if isinstance(each, dict) else each[:2]
        figures[name] = value
    assert 0 <= figures["training/flown"] <= len(flockstep.scenes.load(worlds[0]))
    assert sum(name.startswith("validation/") for name in figures) == 3
    assert figures["steps_per_second"] > 0
    again = {name: value for name, value, *_ in experiments.sampled("policy", tiny, *worlds)}
    assert set(again) == {"training", "validation"} and all(0 <= value <= 1 for value in again.values())
    names = {"lidar": experiments.lidar, "camera": experiments.camera}[task]()
    assert {"sampled_4", "unit_4" if task == "lidar" else "64_4"} <= set(names)


@pytest.mark.parametrize("task", ["lidar", "camera"])
def test_every_leg_of_a_blocked_playground_is_blocked(task):
    setup = tasks.Setup(task)
    worlds = setup.generated(range(3, 100), 6, ahead=False, blocked=True)
    assert [world.name for world in worlds] == [f"playground/seed-{seed}" for seed in range(3, 9)]
    free, added = [], 0
    for world in worlds:
        route = setup.route(world)
        legs = [route[i : i + 2] for i in range(len(route) - 1)]
        free += tasks.fly_routes([world] * len(legs), legs)
        added += len(world.to_dict()["cylinders"]) - 12
        assert tasks.fly_routes([world], [evaluate.shortest_path(world, setup)]) == [True]
    assert not any(free)
    assert added > 0


def test_a_playground_without_room_for_a_pillar_is_left_out(monkeypatch):
    monkeypatch.setattr(tasks, "MARKER_CLEARANCE_M", 9.0)
    with refused(ValueError, "count", 0, 2):
        tasks.Setup().generated(range(3, 5), 2, blocked=True)


@pytest.mark.parametrize("task", ["lidar", "camera"])
def test_flyers_that_have_learned_nothing_are_compared(task, monkeypatch):
    monkeypatch.setattr(claims, "WORLDS", 20)
    monkeypatch.setattr(claims, "CHOSEN_BY", 20)
    monkeypatch.setattr(claims, "REACTIVE", [(0.1, 0.0, 0.0), (1.8, 2.0, 45.0)])
    found = {name: (value["value"], value) for value in claims.claimed(task, ahead=False) for name in [value["name"]]}
    success = {name.removesuffix("/success"): value for name, (value, _) in found.items() if name.endswith("/success")}
    assert list(success) == ["policy", "straight", "reactive", "planner"]
    assert success["planner"] == 1
    assert success["straight"] < min(success["reactive"], success["policy"])
    assert found["reactive/success"][1]["settings"] == [1.8, 2.0, 45.0]
    for name, (value, about) in found.items():
        assert about["least"] <= value <= about["greatest"], name
