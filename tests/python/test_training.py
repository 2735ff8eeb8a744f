"""The scripts of training/: PPO from scratch, and flights of what it learned."""

import dataclasses
import json

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

import flockstep


@pytest.fixture
def train(training, tmp_path):
    """Train for a few updates; only the folder is the test's."""

    def train(folder="one", **arguments):
        small = {
            "total_steps": 2048,
            "evaluate_every": 1024,
            "evaluation_worlds": 2,
            "num_envs": 64,
            "steps_per_update": 16,
            "batch_size": 256,
            "generated": 2,
            "max_episode_steps": 30,
            "progress": False,
        }
        module = training("train_ppo")
        return module.train(module.Args(out=tmp_path / folder, **{**small, **arguments}))

    return train


@pytest.fixture
def flown(training, monkeypatch):
    """Say what the evaluations of a training fly to, and see the policies they fly."""

    def flown(*evaluations):
        given, policies = iter(evaluations), []
        flight = training("evaluate").Flight

        def fly(policy, worlds, *_, **__):
            assert len(worlds) == 7 + 2
            (model,) = (cell.cell_contents for cell in policy.__closure__)
            policies.append(weights(model))
            return [flight("", "success" if s else "crash", 1, 0.0, 0.0, None, np.zeros((2, 3))) for s in next(given)]

        monkeypatch.setattr(training("train_ppo"), "fly", fly)
        return policies

    return flown


def weights(model):
    return torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach().clone()


def test_the_same_seed_gives_the_same_policy(train, flown):
    flown(*[[True] * 9] * 6)
    first, second, other = (train(name, seed=seed)[0] for name, seed in (("one", 3), ("two", 3), ("three", 4)))
    assert torch.equal(weights(first), weights(second))
    assert not torch.equal(weights(first), weights(other))


def test_the_best_model_of_all_evaluations_is_returned(train, flown):
    policies = flown([True] * 7 + [False, True], [True] * 9, [False] + [True] * 8)
    model, outcome = train(total_steps=3072, stop_when_solved=False)
    assert [e["generated"] for e in outcome.evaluations] == [0.5, 1.0, 1.0]
    assert outcome.solved
    assert torch.equal(weights(model), policies[1])


def test_stops_when_solved(train, flown, tmp_path):
    flown([True] * 9)
    _, outcome = train(total_steps=100_000)
    assert outcome.solved
    assert outcome.steps < 2 * 1024 + 64
    assert json.loads((tmp_path / "one" / "result.json").read_text())["steps"] == outcome.steps


def test_what_is_resumed_stays_until_something_better_is_learned(train, flown, tmp_path):
    policy = tmp_path / "one" / "policy.zip"
    flown([True] * 9)
    before = weights(train(total_steps=1024, learning_rate=1e-3)[0])
    policies = flown([True] * 8 + [False], [False] * 9, [False] * 9)
    model, outcome = train(resume=policy, learning_rate=2e-3, stop_when_solved=False)
    assert [e["steps"] for e in outcome.evaluations] == [0, 1024, 2048]
    assert torch.equal(policies[0], before)
    assert not torch.equal(policies[1], before)
    assert torch.equal(weights(model), before)
    assert model.lr_schedule(1.0) == 2e-3


def test_worlds_of_training_choosing_and_judging_are_distinct(training):
    train_ppo, evaluate = training("train_ppo"), training("evaluate")
    args = train_ppo.Args()
    assert train_ppo.TRAINING_SEED + args.generated <= train_ppo.CHOOSING_SEED
    assert train_ppo.CHOOSING_SEED + args.evaluation_worlds <= evaluate.UNSEEN_SEED


@pytest.mark.parametrize("task", ["camera", "pixels"])
def test_camera_tasks_train_fly_and_are_drawn(training, train, tmp_path, task):
    model, outcome = train(
        task=task,
        width_px=32,
        frame_skip=2,
        random_start=True,
        start_flights=2,
        total_steps=1024,
        evaluation_worlds=1,
    )
    assert outcome.steps == 1024
    setup = training("tasks").setup_of(model)
    assert (setup.task, setup.width_px, setup.height_px, setup.frame_skip) == (task, 32, 24, 2)
    policy = tmp_path / "one" / "policy.zip"

    evaluate = training("evaluate")
    result = tmp_path / "result.json"
    evaluate.main(evaluate.Args(policy, repeats=2, generated=2, max_episode_steps=40, shortest=False, json=result))
    judged = json.loads(result.read_text())
    assert [judged[key]["summary"]["flights"] for key in ("camera-train", "camera-validation", "generated")] == [
        4,
        4,
        2,
    ]
    for group in judged.values():
        rates = [group["summary"][f"{end}_rate"] for end in ("success", "crash", "overshoot", "time_out")]
        assert sum(rates) == pytest.approx(1)

    plot_paths = training("plot_paths")
    plot_paths.main(plot_paths.Args(policy, worlds=("playground/camera-train-1",), out=tmp_path / "paths"))
    assert (tmp_path / "paths" / "path-playground-camera-train-1.png").stat().st_size > 1000
    assert (tmp_path / "paths" / "flight.gif").stat().st_size > 1000


def test_a_picture_of_the_blob(training, tmp_path):
    plot_blob = training("plot_blob")
    world = {
        "flockstep_scene": 1,
        "room": {"min": [0, 0, 0], "max": [6, 4, 3]},
        "markers": {"start": [1, 2, 1.5], "goal": [5, 2.5, 1.5]},
    }
    scene = tmp_path / "hall.json"
    scene.write_text(json.dumps(world))
    images = plot_blob.captures(None, training("tasks").Setup("camera"), flockstep.World.from_dict(world), 160, 100)
    assert 20 < len(images) < 60  # until the goal is out of view beside the drone
    assert all(flockstep.green_blob(image).offset < 0 for image in images)  # y grows to the left
    plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "blob.png", width_px=160))
    assert (tmp_path / "blob.png").stat().st_size > 1000
    with pytest.raises(SystemExit, match="never in view"):
        plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "none.png", width_px=160, max_steps=0))


def test_the_command_line_knows_each_tasks_defaults(training, monkeypatch):
    train_ppo = training("train_ppo")
    for task, defaults in train_ppo.DEFAULTS.items():
        assert defaults.task == task
        monkeypatch.setattr("sys.argv", ["train_ppo.py", "--task", task, "--seed", "7"])
        assert train_ppo.command_line() == dataclasses.replace(defaults, seed=7)


def test_generated_playgrounds_of_the_camera_task(training):
    tasks = training("tasks")
    worlds = tasks.Setup("camera").generated(3, 5)
    assert len({world.name for world in worlds}) == 5
    for world in worlds:
        assert len(world.waypoints) == 0
        assert world.start[2] == world.goal[2] == np.float32(3.12)
        assert abs(world.start[1] - world.goal[1]) <= 2.5
        assert world.spawn_box[0, 2] < 3.12 < world.spawn_box[1, 2]
        assert world.goal[0] > world.start[0] + 5


def test_a_flight_ends_where_its_world_says(training, room, closet):
    """Straight ahead: through the room until the pillar or the wall, in the closet at once."""
    flights = training("evaluate").fly(lambda observation: np.zeros(len(observation), int), [room, closet], 200)
    assert [flight.outcome for flight in flights] == ["crash", "crash"]
    for flight, world in zip(flights, [room, closet], strict=True):
        assert flight.trail.shape == (flight.steps + 1, 3)
        np.testing.assert_allclose(flight.trail[0], world.start, atol=1e-6)
        assert flight.path_length_m == pytest.approx(0.1 * flight.steps, abs=0.1)
    assert flights[0].steps > flights[1].steps


def test_a_sheet_of_camera_frames(training, tmp_path):
    pictures = training("camera_pictures")
    assert pictures.draw_sheet(tmp_path / "sheet.png", ("raycast",)) == ["raycast"]
    columns, rows = len(pictures.OUTPUTS), len(pictures.POSES)
    height, width, _ = plt.imread(tmp_path / "sheet.png").shape
    assert width > columns * pictures.TILE_PX[0]
    assert height > rows * pictures.TILE_PX[1]
