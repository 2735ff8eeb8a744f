"""The scripts of training/: PPO from scratch, and flights of trained policies."""

import dataclasses
import json
import re
import sys

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
import tyro
from gymnasium import spaces
from messages import message, refused

import flockstep
import trained
from flockstep import trainings
from tools import stills, track_film
from training import evaluate, plot_blob, plot_curve, plot_paths, tasks, train_ppo

# A module with a task with a camera: success by climbing, failure by sinking.
OWN = """
import numpy as np
from gymnasium import spaces

import flockstep
from flockstep import trainings


class Climb(flockstep.Task):
    camera = flockstep.CameraConfig(width_px=12, height_px=8, outputs=("depth",))
    observation_space = spaces.Dict(near=spaces.Box(0, 1, (8, 12)), height=spaces.Box(0, 9, (1,)))
    max_episode_steps = 20

    def step(self, batch):
        height = batch.position[:, 2]
        self.success[:] = height > 2.15
        return height - 2, self.success | (height < 1.85)

    def observe(self, batch):
        return {"near": 1 / (1 + batch.camera().depth), "height": batch.position[:, 2:]}


class Endless(Climb):
    max_episode_steps = 0


class Sensor:
    pass


class AtHome(Climb):
    worlds = "validation"
    frame_skip = 3


flockstep.register_task("own/Climb-v0", Climb)
flockstep.register_task("own/Climb-v1", Climb, worlds=["room.json"], frame_skip=2, max_episode_steps=9, lidar=None)
"""


@pytest.fixture
def own(tmp_path, monkeypatch, room):
    """Work in a folder with the module own_tasks and the world room.json."""
    (tmp_path / "own_tasks.py").write_text(OWN)
    room.save(str(tmp_path / "room.json"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield "own_tasks"
    sys.modules.pop("own_tasks", None)
    for name in ("own/Climb-v0", "own/Climb-v1"):
        gymnasium.registry.pop(name, None)


@pytest.fixture
def train(tmp_path):
    """Train for a few updates; only the folder belongs to the test."""

    def train(folder="one", **arguments):
        small = {"total_steps": 2048, "evaluate_every": 1024, "evaluation_flights": 2, "num_envs": 64, "generated": 2}
        small |= {"steps_per_update": 16, "batch_size": 256, "max_episode_steps": 30, "progress": False}
        return train_ppo.train(train_ppo.Args(out=tmp_path / folder, **{**small, **arguments}))

    return train


@pytest.fixture
def flown(monkeypatch):
    """Set the results of a training's evaluations, and record the policies that they fly."""

    def flown(*evaluations):
        given, policies = iter(evaluations), []
        kept = [world.name for world in tasks.Setup().generated(trainings.CHOOSING_SEEDS, 2)]

        def fly(policy, worlds, *_, **__):
            assert [world.name for world in worlds] == kept  # and none of the bundled playgrounds
            (model,) = (cell.cell_contents for cell in policy.__closure__)
            policies.append(weights(model))
            ends = ["success" if s else "contact" for s in next(given)]
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
    assert outcome.steps_per_second == outcome.steps / outcome.seconds
    assert outcome.evaluation_seconds > 0
    assert sum(outcome.seconds_by_part.values()) <= outcome.seconds
    assert json.loads((tmp_path / "one" / "result.json").read_text())["steps"] == outcome.steps


def test_a_resumed_policy_stays_until_a_better_one_is_found(train, flown, tmp_path):
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


def test_envs_of_trainings_by_different_seeds_share_none(train, flown, monkeypatch, tmp_path):
    """Record the seeds of the first reset, also for a training that resumes a policy."""
    given = []

    def spy(self, *, seed=None, **keywords):
        given.extend([] if seed is None else [set(seed)])
        return reset(self, seed=seed, **keywords)

    reset = flockstep.DroneVectorEnv.reset
    monkeypatch.setattr(flockstep.DroneVectorEnv, "reset", spy)
    flown(*[[True] * 2] * 4)
    for keywords in ({"seed": 0}, {"seed": 1}, {"seed": 2, "resume": tmp_path / "one" / "policy.zip"}):
        train(total_steps=1024, **keywords)
    assert [len(seeds) for seeds in given] == [64] * 3
    assert len(set().union(*given)) == 3 * 64
    for seed in (0, 1_000, 10_000):
        assert trainings.first_env_seed(seed, 512) >= trainings.UNSEEN_SEEDS.stop > trainings.CHOOSING_SEEDS.stop


def test_training_flies_no_world_that_is_reported(train, monkeypatch):
    """Training uses only the bundled training playgrounds; evaluations use no bundled ones."""
    given = []

    def spy(self, num_envs, **keywords):
        given.append({world.name for world in keywords["worlds"]})
        return make(self, num_envs, **keywords)

    make = tasks.Setup.make
    monkeypatch.setattr(tasks.Setup, "make", spy)
    train(total_steps=1024)
    training, *evaluations = given
    reported = {world.name for world in flockstep.scenes.load("validation")}
    reported |= {world.name for world in tasks.Setup().generated(trainings.UNSEEN_SEEDS, 5)}
    assert training & {world.name for world in flockstep.scenes.load("train")}
    assert not training & reported
    for evaluation in evaluations:
        assert not evaluation & (training | reported)


def test_the_learner_sees_rewards_scaled_and_clipped():
    args = train_ppo.Args(num_envs=4, generated=1, reward_scale=0.01, reward_clip=0.005, step_cost=0.5)
    venv = train_ppo.make_envs(args)
    venv.seed(0)
    venv.reset()
    rewards = np.concatenate([venv.step(np.full(4, action))[1] for action in (0, 1) * 10])
    assert (rewards.min(), rewards.max()) == (np.float32(-0.505), np.float32(-0.495))
    venv.close()


@pytest.mark.parametrize("task", ["camera", "pixels"])
def test_camera_tasks_train_fly_and_are_drawn(train, tmp_path, task):
    small = {"width_px": 32, "frame_skip": 2, "total_steps": 1024, "evaluation_flights": 1}
    model, outcome = train(task=task, random_start=True, **small)
    assert outcome.steps == 1024
    setup = tasks.setup_of(model)
    assert (setup.task, setup.width_px, setup.height_px, setup.frame_skip) == (task, 32, 24, 2)
    policy = tmp_path / "one" / "policy.zip"

    result = tmp_path / "result.json"
    evaluate.main(evaluate.Args(policy, repeats=2, generated=2, max_episode_steps=40, shortest=False, json=result))
    judged = json.loads(result.read_text())
    counts = {"camera-train": 4, "camera-validation": 4, "generated": 2, "generated, every leg blocked": 2}
    assert {key: judged[key]["summary"]["flights"] for key in counts} == counts
    for group in judged.values():
        assert sum(group["summary"][f"{end}_rate"] for end in evaluate.OUTCOMES) == pytest.approx(1)
        assert group["baselines"]["planner"] == 1
    assert "2.5 m to the side" in judged["generated"]["note"]

    plot_paths.main(plot_paths.Args(policy, worlds=("playground/camera-train-1",), out=tmp_path / "paths", width_px=80))
    assert (tmp_path / "paths" / "path-playground-camera-train-1.png").stat().st_size > 1000
    assert (tmp_path / "paths" / "flight.gif").stat().st_size > 1000


TRUST = "load only policies you trust"


@pytest.mark.parametrize("program", [evaluate, plot_paths, plot_blob, track_film, train_ppo], ids=lambda m: m.__name__)
def test_the_help_says_that_loading_a_policy_runs_code(program, capsys):
    with pytest.raises(SystemExit):
        tyro.cli(program.Args, args=["--help"], description=program.__doc__)
    printed = " ".join(re.sub(r"[^\w.:-]+", " ", capsys.readouterr().out).split())
    assert f"runs code from the file: {TRUST}" in printed


def test_a_program_says_that_loading_a_policy_runs_code(tmp_path, capsys):
    envs = flockstep.sb3.make_vec("flockstep/LidarNavigation-v0", 1)
    model = tasks.PPO("MlpPolicy", envs, n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "policy.zip")
    assert isinstance(tasks.load_policy(tmp_path / "policy.zip"), tasks.PPO)
    printed = capsys.readouterr()
    assert (TRUST in printed.err, printed.out) == (True, "")


def test_a_picture_of_the_blob(tmp_path):
    world = {"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [6, 4, 3]}}
    world["markers"] = {"start": [1, 2, 1.5], "goal": [5, 2.5, 1.5]}
    scene = tmp_path / "hall.json"
    scene.write_text(json.dumps(world))
    images = plot_blob.captures(None, tasks.Setup("camera"), flockstep.World.from_dict(world), 160, 100)
    assert 20 < len(images) < 60  # until the goal leaves the view beside the drone
    assert all(flockstep.green_blob(image).offset < 0 for image in images)  # y grows to the left
    plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "blob.png", width_px=160))
    assert (tmp_path / "blob.png").stat().st_size > 1000
    with refused(SystemExit, "never in view"):
        plot_blob.main(plot_blob.Args(world=str(scene), out=tmp_path / "none.png", width_px=160, max_steps=0))


def test_the_command_line_knows_each_tasks_defaults(monkeypatch):
    for task, defaults in train_ppo.DEFAULTS.items():
        assert defaults.task == task
        monkeypatch.setattr("sys.argv", ["train_ppo.py", "--task", task, "--seed", "7"])
        assert train_ppo.command_line() == dataclasses.replace(defaults, seed=7)


@pytest.fixture
def said_of(monkeypatch, capsys):
    """The command line refuses arguments in one line."""

    def said_of(*arguments):
        monkeypatch.setattr("sys.argv", ["train_ppo.py", *arguments])
        with pytest.raises(SystemExit) as caught:
            train_ppo.command_line()
        assert caught.value.code == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        return said

    return said_of


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ("--num-envs 0", ("1,048,576", 0)),
        ("--resume nope.zip", ("nope.zip",)),
        ("--batch-size 0", (2, 0)),
        ("--learning-rate nan", ("nan",)),
        ("--solved-rate 2", (0, 1, 2.0)),
        ("--reward-clip -1", (-1.0,)),
        ("--step-cost inf", ("inf",)),
        ("--net 0", (1, 0)),
        ("--steps-per-update 1 --num-envs 1", (2,)),
        ("--worlds nope", ("nope",)),
        ("--evaluation-worlds nope.json", ("nope.json",)),
    ],
)
def test_the_command_line_refuses(said_of, given, values):
    assert re.match(message(given.split()[0], *values), said_of(*given.split()))


def test_every_number_of_the_command_line_has_a_range():
    types = {field.name: str(field.type) for field in dataclasses.fields(train_ppo.Args)}
    numbers = {name for name, kind in types.items() if kind.split(" | ")[0] in ("int", "float")}
    assert train_ppo.RANGES.keys() == numbers
    for args in (*train_ppo.DEFAULTS.values(), train_ppo.OWN):
        train_ppo.require_valid(args)


@pytest.mark.parametrize("name", ["own_tasks:Climb", "own_tasks:own/Climb-v0"])
def test_a_task_of_ones_own_trains_flies_and_is_drawn(train, own, tmp_path, name):
    model, outcome = train(task=name, worlds=("room.json",), generated=0, evaluation_flights=3, stop_when_solved=False)
    assert [evaluation["steps"] for evaluation in outcome.evaluations] == [1024, 2048]
    assert 0 < outcome.first_success["steps"] <= 2048
    assert isinstance(model.policy.features_extractor, flockstep.sb3.ImageFeatures)
    setup = tasks.setup_of(model)
    assert (setup.task, setup.playgrounds) == (name, ("room.json",))

    policy, result = tmp_path / "one" / "policy.zip", tmp_path / "result.json"
    evaluate.main(evaluate.Args(policy, repeats=4, json=result))
    (judged,) = json.loads(result.read_text()).values()
    assert judged["summary"]["flights"] == 4
    assert set(judged["baselines"]) == {"random_policy", "straight_flight", "planner"}

    plot_paths.main(plot_paths.Args(policy, out=tmp_path / "paths", width_px=80))
    assert (tmp_path / "paths" / "flight.gif").stat().st_size > 1000
    plot_curve.main(plot_curve.Args((tmp_path / "one",) * 2, out=tmp_path / "curve.png"))
    assert (tmp_path / "curve.png").stat().st_size > 1000


def test_how_the_flights_of_a_task_of_ones_own_end(own, room):
    setup = tasks.Setup("own_tasks:Climb")
    actions = np.array([[0, 0, 1], [0, 0, -1], [0, 0, 0]], np.float32)
    flights = evaluate.fly(lambda observation: actions, [room] * 3, setup=setup)
    assert [(flight.outcome, flight.steps) for flight in flights] == [("success", 2), ("task", 2), ("time", 20)]
    assert evaluate.summary(flights)["task_rate"] == 1 / 3


def test_episodes_that_never_end_are_refused(own, train, room):
    setup = tasks.Setup("own_tasks:Endless")
    with refused(ValueError, "max_episode_steps", "own_tasks:Endless"):
        evaluate.fly(lambda observation: np.zeros((1, 3), np.float32), [room], setup=setup)
    assert evaluate.fly(lambda observation: np.zeros((1, 3), np.float32), [room], 5, setup=setup)[0].steps == 5
    with refused(ValueError, "stagger_first_episode", "max_episode_steps=0"):
        train(task="own_tasks:Endless", max_episode_steps=None)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lidr", "The nearest are lidar"),
        ("flockstep/LidarNavigation", "The nearest are flockstep/LidarNavigation-v0"),
        ("CartPole-v1", "not an env of flockstep's"),
        ("own_tasks:Clim", "The nearest are own_tasks:Climb"),
        ("own_tasks:own/Clim-v0", "The nearest are own_tasks:own/Climb-v0"),
        ("own_tasks:Sensor", "does not derive from flockstep.Task"),
        ("own_tasks:np", "which is a module"),
        ("nowhere:Climb", "whose module is neither installed nor in"),
        ("own_tasks.nowhere:Climb", "whose module is neither installed nor in"),
        ("own tasks:Climb", "'own tasks' is not the name of a module"),
        (":Climb", "'' is not the name of a module"),
    ],
)
def test_other_values_than_tasks_are_refused(own, said_of, name, said):
    assert re.match(message("--task", "an id of flockstep's", said), said_of("--task", name))


def test_what_a_module_of_ones_own_lacks_is_named(own, tmp_path):
    (tmp_path / "own_tasks.py").write_text("import nowhere")
    with refused(ModuleNotFoundError, "nowhere"):
        tasks.env_keywords("own_tasks:Climb")


def test_an_id_is_another_name_of_a_task(monkeypatch):
    for env_id, name in tasks.IDS.items():
        assert gymnasium.spec(env_id).kwargs == tasks.env_keywords(name)
        monkeypatch.setattr("sys.argv", ["train_ppo.py", "--task", env_id])
        assert train_ppo.command_line() == train_ppo.DEFAULTS[name]


def test_the_kind_of_policy_follows_the_observation():
    image, vector = spaces.Box(0, 1, (8, 12)), spaces.Box(0, 1, (3,))
    seen = {"features_extractor_class": flockstep.sb3.ImageFeatures}
    assert train_ppo.network("own", vector) == ("MlpPolicy", {})
    assert train_ppo.network("own", image) == ("CnnPolicy", seen)
    assert train_ppo.network("own", spaces.Dict(a=vector, b=vector)) == ("MultiInputPolicy", {})
    assert train_ppo.network("own", spaces.Dict(a=vector, b=image)) == ("MultiInputPolicy", seen)


def test_worlds_are_chosen_by_name(own, train, tmp_path):
    args = train_ppo.defaults_of("own_tasks:Climb")
    assert args.out.name == "Climb"
    flown = [
        dataclasses.replace(args, evaluation_flights=3, **chosen)
        for chosen in ({}, {"generated": 2}, {"evaluation_worlds": ("validation",)}, {"worlds": ("room.json",)})
    ]
    names = [[world.name.rpartition("/")[2] for world in train_ppo.evaluation_flights(args)[0]] for args in flown]
    assert names == [
        ["train-1", "train-2", "train-3", "train-4", "train-5"],
        ["seed-500000", "seed-500001", "seed-500002"],
        ["validation-1", "validation-2", "validation-1"],
        ["room"] * 3,
    ]
    lidar = train_ppo.Args(evaluation_worlds=("validation",), worlds=("train",))
    assert len(train_ppo.evaluation_flights(lidar)[0]) == 2
    assert lidar.setup.playgrounds == ("train", "validation")


def test_a_registered_task_is_trained_and_flown_as_it_was_registered(own, train, room):
    args = train_ppo.defaults_of("own_tasks:own/Climb-v1")
    assert (args.worlds, args.frame_skip, args.max_episode_steps) == (("room.json",), 2, 9)
    at_home = train_ppo.defaults_of("own_tasks:AtHome")
    assert (at_home.worlds, at_home.frame_skip) == (("validation",), 3)
    assert train_ppo.defaults_of("own_tasks:Climb").worlds == ()
    setup = dataclasses.replace(args, frame_skip=1).setup
    still = np.zeros((1, 3), np.float32)
    assert [evaluate.fly(lambda observation: still, [room], limit, setup=setup)[0].steps for limit in (None, 4)] == [
        9,
        4,
    ]


def test_generated_playgrounds_of_the_camera_task():
    worlds = tasks.Setup("camera").generated(range(3, 100), 5)
    assert len({world.name for world in worlds}) == 5
    for world in worlds:
        assert len(world.waypoints) == 0
        assert world.start[2] == world.goal[2] == np.float32(3.12)
        assert abs(world.start[1] - world.goal[1]) <= 2.5
        assert world.spawn_box[0, 2] < 3.12 < world.spawn_box[1, 2]
        assert world.goal[0] > world.start[0] + 5
    assert len(tasks.Setup().generated(range(5, 8), 3)) == 3
    with refused(ValueError, "count", "range(5, 8)", 4):
        tasks.Setup().generated(range(5, 8), 4)


def test_what_needs_no_training(room, closet):
    """Straight flight: in the room both legs are free; in a narrower one the pillar blocks the path."""
    scene = room.to_dict()
    scene["markers"]["waypoints"] = []
    scene["pillars"] = [{"center": [4, 4], "radius": 0.25}]
    blocked = flockstep.World.from_dict(scene)
    scene["pillars"] = [{"center": [4, y], "radius": 0.5} for y in np.arange(0.5, 8, 0.9)]
    walled = flockstep.World.from_dict(scene | {"name": "walled"})
    worlds = [room, blocked, closet, walled]
    setup = tasks.Setup()
    assert evaluate.fly_routes(worlds, [setup.route(world) for world in worlds]) == [True, False, True, False]
    planned = [evaluate.shortest_path(world, setup) for world in worlds]
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
    small = dataclasses.replace(small, evaluation_flights=1, max_episode_steps=30, width_px=16)
    monkeypatch.setattr(trained, "START_FLIGHTS", 2)
    monkeypatch.setattr(trained, "UNSEEN_WORLDS", 2)
    figures = {made["name"]: made for made in trained.task_figures(small, [3], tmp_path)}
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
    """Straight ahead: through the room up to the pillar or the wall, in the closet at once."""
    flights = evaluate.fly(lambda observation: np.zeros(len(observation), int), [room, closet], 200)
    assert [flight.outcome for flight in flights] == ["contact", "contact"]
    for flight, world in zip(flights, [room, closet], strict=True):
        assert flight.trail.shape == (flight.steps + 1, 3)
        np.testing.assert_allclose(flight.trail[0], world.start, atol=1e-6)
        assert flight.path_length_m == pytest.approx(0.1 * flight.steps, abs=0.1)
    assert flights[0].steps > flights[1].steps


def test_a_sheet_of_camera_frames(tmp_path):
    stills.draw_sheet(tmp_path / "sheet.png")
    columns, rows = len(stills.OUTPUTS), len(stills.POSES)
    height, width, _ = plt.imread(tmp_path / "sheet.png").shape
    assert width > columns * stills.TILE_PX[0]
    assert height > rows * stills.TILE_PX[1]
