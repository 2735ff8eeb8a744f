"""training/train_flight.py and training/flight.py: the reports on Hover and Track."""

import base64
import json
import zipfile

import numpy as np
import pytest
from conftest import ROOT

import flockstep

pytest.importorskip("stable_baselines3")
from training import benchmark_flight, flight, train_flight
from training.tasks import CHOOSING_SEEDS, UNSEEN_SEEDS, first_env_seed

POLICIES = ROOT / "policies"
ARGS = train_flight.Args  # tests replace it


def small(**changes):
    given = {"total_steps": 4096, "num_envs": 32, "batch_size": 512, "evaluations": 2, "evaluation_flights": 4}
    return ARGS(**{**given, "learner_threads": 1, "progress": False, **changes})


def still(observation, envs):
    """Command a plain hover."""
    return np.zeros((len(observation), 4), np.float32)


def test_errors_of_flights_by_hand():
    distance = np.full((300, 3), 9.0)
    distance[-50:, 0], distance[-50:, 1], distance[200:, 2] = 0.04, 0.06, np.nan
    flights = flight.Flights("hover", distance)
    np.testing.assert_allclose(flights.error_m, [0.04, 0.06, np.nan])  # only over the last second
    assert flights.close_rate == pytest.approx(1 / 3)
    assert flights.median_error_m == pytest.approx(0.05)
    assert list(flights.crashed) == [False, False, True]
    tracked = flight.Flights("track", np.array([[0.03], [0.04]]))
    assert tracked.error_m == pytest.approx([np.sqrt((0.03**2 + 0.04**2) / 2)])
    assert flight.Flights("hover", np.full((300, 2), np.nan)).median_error_m == np.inf


def test_flights_are_measured_from_the_state():
    """Check the distance of every step until an uncontrolled drone has left the task's area."""
    envs = flight.make("hover", 4, max_episode_steps=0)
    envs.reset(seed=3)
    goal = envs.batch.worlds[0].goal
    expected = []
    for _ in range(20):
        envs.step(np.zeros((4, 4), np.float32))
        expected.append(np.linalg.norm(envs.batch.position - goal, axis=1))
    flown = flight.fly("hover", still, 4, 3)
    np.testing.assert_allclose(flown.distance_m[:20], expected, atol=1e-5)
    assert flown.distance_m.shape == (300, 4)
    assert flown.crashed.all()  # thrown and never caught


def test_position_control_catches_what_is_thrown():
    flown = flight.fly("hover", flight.position_control(), 32, UNSEEN_SEEDS.start, drone="x500", control="position")
    assert not flown.crashed.any()
    assert flown.median_error_m < 0.05


def test_velocity_control_follows_a_path():
    task = flockstep.TrackConfig(points=6, speed_mps=0.5)
    pilot = flight.velocity_control(task, 3, 2.0)
    flown = flight.fly("track", pilot, 32, UNSEEN_SEEDS.start, task=task, drone="x500", control="velocity")
    assert not flown.crashed.any()
    assert flown.median_error_m < 0.1


@pytest.mark.parametrize("task", ["hover", "track"])
def test_the_kept_model_is_the_best_of_those_tried(task, monkeypatch):
    tried = []

    def fly(name, pilot, count, seed, **keywords):
        assert (name, count, seed) == (task, 4, CHOOSING_SEEDS.start)
        rate = [0.1, 0.9, 0.5, 0.4][len(tried)]
        observation = np.ones((3, flight.make(task, 3).single_observation_space.shape[0]), np.float32)
        tried.append(pilot(observation, None))
        error = np.where(np.arange(1000) < 1000 * rate, 0.01, 1.0)
        return flight.Flights(task, np.tile(error, (300, 1)))

    monkeypatch.setattr(train_flight, "fly", fly)
    model, outcome = train_flight.train(small(task=task))
    assert [point["close_rate"] for point in outcome.curve] == [0.1, 0.9, 0.5][: len(tried)]
    observation = np.ones((3, model.observation_space.shape[0]), np.float32)
    np.testing.assert_array_equal(flight.greedy(model)(observation, None), tried[1])
    assert outcome.steps == 4096
    assert outcome.seconds > 0


def test_the_same_seed_gives_the_same_policy():
    models = [train_flight.train(small())[0] for _ in range(2)]
    for first, second in zip(*(model.policy.parameters() for model in models), strict=True):
        assert first.equal(second)


def test_training_begins_with_seeds_of_its_own(monkeypatch):
    seeds = []
    seed_of = flockstep.sb3.DroneVecEnv.seed

    def seed(self, seed=None):
        seeds.append(seed)
        return seed_of(self, seed)

    monkeypatch.setattr(flockstep.sb3.DroneVecEnv, "seed", seed)
    train_flight.train(small(seed=2))
    assert seeds[-1] == first_env_seed(2, 32) >= UNSEEN_SEEDS.stop


@pytest.mark.parametrize("name", ["hover", "track", "lidar"])
def test_kept_policies_hold_no_bytecode(name):
    """A saved function crashes other Python versions that load it."""
    with zipfile.ZipFile(POLICIES / f"{name}.zip") as file:
        saved = json.loads(file.read("data"))
    pickles = [
        base64.b64decode(v[":serialized:"]) for v in saved.values() if isinstance(v, dict) and ":serialized:" in v
    ]
    assert len(pickles) > 5
    assert not any(b"CodeType" in pickle or b"_builtin_type" in pickle for pickle in pickles)


def test_figures_of_trainings(monkeypatch, tmp_path):
    monkeypatch.setattr(train_flight, "Args", small)
    monkeypatch.setattr(train_flight, "REPORTED_FLIGHTS", 4)
    made = {each["name"]: each["value"] for each in benchmark_flight.trained("hover", (0,), tmp_path)}
    names = ("close_rate", "crash_rate", "median_error_cm")
    assert {f"train/hover/{who}/{name}" for who in ("seed0", "controller") for name in names} <= set(made)
    assert made["train/hover/seed0/steps"] == 4096
    assert (tmp_path / "hover-seed0" / "policy.zip").exists()
