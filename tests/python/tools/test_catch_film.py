"""The film of a quadrotor that learns to catch itself."""

from dataclasses import replace

import imageio.v3 as imageio
import numpy as np

from flockstep.rotations import rotate
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS
from tools import catch_film
from tools.film import flown


def nothing(observation):
    """Command a plain hover."""
    return np.zeros((len(observation), 4), np.float32)


def learn(max_minutes=None):
    """Train for four updates."""
    settings = {**TRAININGS["hover"].settings, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    return catch_film.learn(replace(TRAININGS["hover"], steps=256, num_envs=8, settings=settings), 0, max_minutes)


def test_the_policies_of_a_training_are_filmed(tmp_path):
    model, moments = learn()
    assert [moment.steps for moment in moments] == [0, 64, 128, 256]
    assert all(np.diff([moment.seconds for moment in moments]) > 0)
    assert not np.array_equal(moments[0].parameters, moments[3].parameters)
    last = model.learner.parameters
    np.testing.assert_array_equal(moments[3].parameters, last)

    rates = catch_film.draw(catch_film.Args(out=tmp_path, flights=2, width_px=128, film_s=0.2), model, moments)
    assert rates[0] == 0
    assert len(rates) == 4
    np.testing.assert_array_equal(model.learner.parameters, last)
    assert (tmp_path / "catch.mp4").stat().st_size > 1000
    assert imageio.imread(tmp_path / "catch.gif").shape == (2, 315, 560, 3)
    assert imageio.imread(tmp_path / "catch.png").shape == (900, 2000, 3)


def test_training_ends_when_its_time_is_up():
    _, moments = learn(max_minutes=0)
    assert [moment.steps for moment in moments] == [0, 0, 0, 8]


def test_a_policy_that_does_not_catch_is_called_a_failure(monkeypatch, tmp_path, capsys):
    model, moments = learn()
    monkeypatch.setattr(catch_film, "learn", lambda *_: (model, moments))
    args = catch_film.Args(out=tmp_path, flights=2, width_px=64, film_s=0.1)
    assert args.max_minutes is None
    assert not catch_film.main(args)
    text = capsys.readouterr().out
    assert "FAILED: time ran out at 256 of 1,600,000 steps. The policy did not learn to catch a quadrotor" in text
    assert "caught" not in text


def test_the_throw_is_the_most_tilted_one():
    seeds = range(UNSEEN_SEEDS.start, UNSEEN_SEEDS.start + 20)
    throws = [flown("hover", nothing, seed) for seed in seeds]
    up = [rotate(throw.quat_wxyz[0], np.array([0.0, 0.0, 1.0]))[2] for throw in throws]
    assert catch_film.most_tilted(seeds) == seeds[int(np.argmin(up))]


def test_a_throw_lasts_until_it_is_lost():
    """A plain hover command drifts to the side; the drone is lost 6 m from the point or at the floor below it."""
    throw = flown("hover", nothing, UNSEEN_SEEDS.start)
    point = catch_film.Scene((32, 18)).point
    distance = np.linalg.norm(throw.position - point, axis=1)
    assert throw.lost
    assert 10 < len(throw.position) == len(throw.quat_wxyz) < 301
    assert (distance[:-1] < 6).all()
    assert distance[-1] > 5.8
