"""The training of Dodge: a small one, and the flights that judge it."""

import numpy as np
import pytest

import flockstep
from training import dodge, train_dodge


@pytest.fixture(autouse=True)
def few_worlds(monkeypatch):
    monkeypatch.setattr(dodge, "WORLDS", {"playground": 2, "warehouse": 1})
    monkeypatch.setattr(dodge, "UNSEEN_WAREHOUSES", 1)
    monkeypatch.setattr(dodge, "NUM_ENVS", 64)


def test_a_small_training_is_judged(tmp_path, capsys):
    out = tmp_path / "dodge.zip"
    train_dodge.main(train_dodge.Args(out=out, steps=4096, threads=1, flights=4))
    assert "of 4 flights succeed" in capsys.readouterr().out
    flockstep.PPO.load(out)


def test_still_worlds_have_no_bodies():
    living, still = dodge.make(8, 1), dodge.make(8, 1, living=False)
    living.reset(seed=0)
    still.reset(seed=0)
    assert living.batch.bodies.active.any()
    assert len(still.batch.bodies) == 0


def test_flights_that_judge_count_every_end():
    flown = dodge.fly(dodge.straight, 8, 500_000)
    assert flown.success.shape == flown.crashed.shape == (8,)
    assert not (flown.success & flown.crashed).any()
    assert not (flown.by_body & ~flown.crashed).any()
    assert flown.minutes > 0
    np.testing.assert_allclose(flown.crashes_per_minute, flown.crashed.sum() / flown.minutes)
