"""The scripts of training/: PPO from scratch, and flights of what it learned."""

import dataclasses
import json

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

import benchmark
import camera_pictures
import evaluate
import flockstep
import plot_blob
import plot_paths
import tasks
import train_ppo


@pytest.fixture
def train(tmp_path):
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
        return train_ppo.train(train_ppo.Args(out=tmp_path / folder, **{**small, **arguments}))

    return train


@pytest.fixture
def flown(monkeypatch):
    """Say what the evaluations of a training fly to, and see the policies they fly."""

    def flown(*evaluations):
        given, policies = iter(evaluations), []
        kept = [world.name for world in tasks.Setup().generated(tasks.CHOOSING_SEEDS, 2)]

        def fly(policy, worlds, *_, **__):
            assert [world.name for world in worlds] == kept  # and none of the playgrounds that ship
            (model,) = (cell.cell_contents for cell in policy.__closure__)
            policies.append(weights(model))
            ends = ["success" if s else "crash" for s in next(given)]
            return [evaluate.Flight("", end, 1, 0.0, 0.0, None, np.zeros((2, 3))) for end in ends]

        monkeypatch.setattr(train_ppo, "fly", fly)
        return policies

    return flown


def weights(model):
    return torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach().clone()


def test_the_same_seed_gives_the_same_policy(train, flown):
    flown(*[[True] * 2] * 6)
    first, second, other = (train(name, seed=seed)[0] for name, seed in (("one", 3), ("two", 3), ("three", 4)))
    assert torch.equal(weights(first), weights(second))
    assert not torch.equal(weights(first), weights(other))


def test_the_best_model_of_all_evaluations_is_returned(train, flown):
    policies = flown([False, True], [True] * 2, [False] * 2)
    model, outcome = train(total_steps=3072, stop_when_solved=False)
    assert [e["success_rate"] for e in outcome.evaluations] == [0.5, 1.0, 0.0]
    assert outcome.solved
    assert torch.equal(weights(model), policies[1])


def test_stops_when_solved(train, flown, tmp_path):
    flown([True] * 2)
    _, outcome = train(total_steps=100_000)
    assert outcome.solved
    assert outcome.steps < 2 * 1024 + 64
    assert json.loads((tmp_path / "one" / "result.json").read_text())["steps"] == outcome.steps


def test_what_is_resumed_stays_until_something_better_is_learned(train, flown, tmp_path):
    policy = tmp_path / "one" / "policy.zip"
    flown([True] * 2)
    before = weights(train(total_steps=1024, learning_rate=1e-3)[0])
    policies = flown([True, False], [False] * 2, [False] * 2)
    model, outcome = train(resume=policy, learning_rate=2e-3, stop_when_solved=False)
    assert [e["steps"] for e in outcome.evaluations] == [0, 1024, 2048]
    assert torch.equal(policies[0], before)
    assert not torch.equal(policies[1], before)
    assert torch.equal(weights(model), before)
    assert model.lr_schedule(1.0) == 2e-3


def test_seeds_of_training_choosing_and_reporting_are_disjoint():
    ranges = [tasks.TRAINING_SEEDS, tasks.CHOOSING_SEEDS, tasks.UNSEEN_SEEDS]
    for i, one in enumerate(ranges):
        assert len(one) > 0
        assert all(max(one.start, other.start) >= min(one.stop, other.stop) for other in ranges[i + 1 :])


def test_generated_playgrounds_keep_to_their_seeds():
    assert len(tasks.Setup().generated(range(5, 8), 3)) == 3
    with pytest.raises(ValueError, match=r"count: expected at most 3, .*range\(5, 8\).* got 4"):
        tasks.Setup().generated(range(5, 8), 4)


def test_training_flies_no_world_that_is_reported(train, monkeypatch):
    """Of those that ship, training has the ones for training; evaluations have none."""
    given = []

    def spy(self, num_envs, **keywords):
        given.append({world.name for world in keywords["worlds"]})
        return make(self, num_envs, **keywords)

    make = tasks.Setup.make
    monkeypatch.setattr(tasks.Setup, "make", spy)
    train(total_steps=1024)
    training, *evaluations = given
    reported = {world.name for world in flockstep.scenes.load("validation")}
    reported |= {world.name for world in tasks.Setup().generated(tasks.UNSEEN_SEEDS, 5)}
    assert training & {world.name for world in flockstep.scenes.load("train")}
    assert not training & reported
    for evaluation in evaluations:
        assert not evaluation & (training | reported)


def test_time_and_steps_tell_the_same_story(train, tmp_path):
    _, outcome = train(total_steps=1024)
    assert outcome.steps_per_second == outcome.steps / outcome.seconds
    assert outcome.evaluation_seconds > 0
    assert sum(outcome.seconds_by_part.values()) <= outcome.seconds


def test_the_learner_sees_rewards_scaled_and_clipped():
    args = train_ppo.Args(num_envs=4, generated=1, reward_scale=0.01, reward_clip=0.005, step_cost=0.5)
    venv = train_ppo.make_envs(args)
    venv.seed(0)
    venv.reset()
    rewards = np.concatenate([venv.step(np.full(4, action))[1] for action in (0, 1) * 10])
    assert rewards.min() == np.float32(-0.505)
    assert rewards.max() == np.float32(-0.495)
    venv.close()


@pytest.mark.parametrize("task", ["camera", "pixels"])
def test_camera_tasks_train_fly_and_are_drawn(train, tmp_path, task):
    model, outcome = train(
        task=task,
        width_px=32,
        frame_skip=2,
        random_start=True,
        total_steps=1024,
        evaluation_worlds=1,
    )
    assert outcome.steps == 1024
    setup = tasks.setup_of(model)
    assert (setup.task, setup.width_px, setup.height_px, setup.frame_skip) == (task, 32, 24, 2)
    policy = tmp_path / "one" / "policy.zip"

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
        assert group["baselines"]["planner"] == 1
    assert "2.5 m to the side" in judged["generated"]["note"]

    plot_paths.main(plot_paths.Args(policy, worlds=("playground/camera-train-1",), out=tmp_path / "paths", width_px=80))
    assert (tmp_path / "paths" / "path-playground-camera-train-1.png").stat().st_size > 1000
    assert (tmp_path / "paths" / "flight.gif").stat().st_size > 1000


def test_a_picture_of_the_blob(tmp_path):
    world = {
        "flockstep_scene": 1,
        "room": {"min": [0, 0, 0], "max": [6, 4, 3]},
        "markers": {"start": [1, 2, 1.5], "goal": [5, 2.5, 1.5]},
    }
    scene = tmp_path / "hall.json"
    scene.write_text(json.dumps(world))
    images = plot_blob.captures(None, tasks.Setup("camera"), flockstep.World.from_dict(world), 160, 100)
    assert 20 < len(images) < 60  # until the goal is out of view beside the drone
    assert all(flockstep.green_blob(image).offset < 0 for image in images)  # y grows to the left
    plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "blob.png", width_px=160))
    assert (tmp_path / "blob.png").stat().st_size > 1000
    with pytest.raises(SystemExit, match="never in view"):
        plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "none.png", width_px=160, max_steps=0))


def test_the_command_line_knows_each_tasks_defaults(monkeypatch):
    for task, defaults in train_ppo.DEFAULTS.items():
        assert defaults.task == task
        monkeypatch.setattr("sys.argv", ["train_ppo.py", "--task", task, "--seed", "7"])
        assert train_ppo.command_line() == dataclasses.replace(defaults, seed=7)


def test_generated_playgrounds_of_the_camera_task():
    worlds = tasks.Setup("camera").generated(range(3, 100), 5)
    assert len({world.name for world in worlds}) == 5
    for world in worlds:
        assert len(world.waypoints) == 0
        assert world.start[2] == world.goal[2] == np.float32(3.12)
        assert abs(world.start[1] - world.goal[1]) <= 2.5
        assert world.spawn_box[0, 2] < 3.12 < world.spawn_box[1, 2]
        assert world.goal[0] > world.start[0] + 5


def test_what_needs_no_training(room, closet):
    """Straight flight: in the room both legs are free, in a narrower one the pillar stands in the way."""
    scene = room.to_dict()
    scene["markers"]["waypoints"] = []
    scene["pillars"] = [{"center": [4, 4], "radius": 0.25}]
    blocked = flockstep.World.from_dict(scene)
    scene["pillars"] = [{"center": [4, y], "radius": 0.5} for y in np.arange(0.5, 8, 0.9)]
    walled = flockstep.World.from_dict(scene | {"name": "walled"})
    worlds = [room, blocked, closet, walled]
    assert evaluate.fly_routes(worlds, [evaluate.markers(world) for world in worlds]) == [True, False, True, False]
    planned = [evaluate.shortest_path(world) for world in worlds]
    assert planned[-1] is None
    assert evaluate.fly_routes(worlds, planned) == [True, True, True, False]
    assert evaluate.fly_routes([walled], [None]) == [False]


def test_no_straight_flight_passes_the_playgrounds_that_ship():
    for name in ("lidar", "camera"):
        setup = tasks.Setup(name)
        worlds = [world for scenes in setup.playgrounds for world in flockstep.scenes.load(scenes)]
        rates = evaluate.baselines(worlds, setup)
        assert rates == {"random_policy": 0, "straight_flight": 0, "planner": 1}


def test_figures_of_a_training(monkeypatch, tmp_path):
    args = train_ppo.DEFAULTS["camera"]
    small = dataclasses.replace(args, total_steps=1024, num_envs=64, steps_per_update=16, batch_size=256, generated=1)
    small = dataclasses.replace(small, evaluation_worlds=1, max_episode_steps=30, width_px=16)
    monkeypatch.setattr(benchmark, "START_FLIGHTS", 2)
    monkeypatch.setattr(benchmark, "UNSEEN_WORLDS", 2)
    figures = {figure["name"]: figure for figure in benchmark.task_figures(small, [3], tmp_path)}
    values = {name: figure["value"] for name, figure in figures.items()}
    of_seed = "train/camera/seed3"
    rate = values[f"{of_seed}/steps"] / values[f"{of_seed}/seconds"]
    assert values[f"{of_seed}/steps_per_second"] == pytest.approx(rate, rel=2e-3)  # four digits
    assert values[f"{of_seed}/evaluation_seconds"] > 0
    for who in (of_seed, "train/camera/random_policy"):
        assert figures[f"{who}/camera_validation/random_start_success_rate"]["runs"] == 4
    assert "2.5 m to the side" in figures[f"{of_seed}/unseen_success_rate"]["note"]
    assert values["train/camera/straight_flight/camera_train/success_rate"] == 0
    assert values["train/camera/planner/unseen_success_rate"] == 1


def test_a_flight_ends_where_its_world_says(room, closet):
    """Straight ahead: through the room until the pillar or the wall, in the closet at once."""
    flights = evaluate.fly(lambda observation: np.zeros(len(observation), int), [room, closet], 200)
    assert [flight.outcome for flight in flights] == ["crash", "crash"]
    for flight, world in zip(flights, [room, closet], strict=True):
        assert flight.trail.shape == (flight.steps + 1, 3)
        np.testing.assert_allclose(flight.trail[0], world.start, atol=1e-6)
        assert flight.path_length_m == pytest.approx(0.1 * flight.steps, abs=0.1)
    assert flights[0].steps > flights[1].steps


def test_a_sheet_of_camera_frames(tmp_path):
    assert camera_pictures.draw_sheet(tmp_path / "sheet.png", ("raycast",)) == ["raycast"]
    columns, rows = len(camera_pictures.OUTPUTS), len(camera_pictures.POSES)
    height, width, _ = plt.imread(tmp_path / "sheet.png").shape
    assert width > columns * camera_pictures.TILE_PX[0]
    assert height > rows * camera_pictures.TILE_PX[1]
