"""The scripts of training/: PPO from scratch, and flights of what it learned."""

import json

import numpy as np
import pytest
import torch


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

        def fly(policy, worlds, *_):
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


def test_worlds_of_training_choosing_and_judging_are_distinct(training):
    train_ppo, evaluate = training("train_ppo"), training("evaluate")
    args = train_ppo.Args()
    assert train_ppo.TRAINING_SEED + args.generated <= train_ppo.CHOOSING_SEED
    assert train_ppo.CHOOSING_SEED + args.evaluation_worlds <= evaluate.UNSEEN_SEED


def test_a_flight_ends_where_its_world_says(training, room, closet):
    """Straight ahead: through the room until the pillar or the wall, in the closet at once."""
    flights = training("evaluate").fly(lambda observation: np.zeros(len(observation), int), [room, closet], 200)
    assert [flight.outcome for flight in flights] == ["crash", "crash"]
    for flight, world in zip(flights, [room, closet], strict=True):
        assert flight.trail.shape == (flight.steps + 1, 3)
        np.testing.assert_allclose(flight.trail[0], world.start, atol=1e-6)
        assert flight.path_length_m == pytest.approx(0.1 * flight.steps, abs=0.1)
    assert flights[0].steps > flights[1].steps
