"""The training of Formation: a small one, and the flights that judge it."""

import pytest

import flockstep
from training import formation, train_formation


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(formation, "NUM_ENVS", 8)
    monkeypatch.setattr(formation, "WORLDS", {"playground": 2, "warehouse": 1})
    monkeypatch.setattr(formation, "UNSEEN_WAREHOUSES", 1)
    monkeypatch.setattr(formation, "MOST_STEPS", dict.fromkeys(formation.KINDS, 40))


@pytest.mark.filterwarnings("ignore:batch_size")  # that of whole trainings
def test_a_small_training_is_judged(tmp_path, capsys):
    out = tmp_path / "formation.zip"
    train_formation.main(train_formation.Args(out=out, steps=4096, threads=1, flights=3))
    assert "of 3 flights of each kind succeed" in capsys.readouterr().out
    flockstep.PPO.load(out)


@pytest.mark.parametrize("kind", formation.KINDS)
def test_flights_that_judge_count_every_end(kind):
    flown = formation.fly(formation.straight, 4, 500_000, kind)
    assert flown.success.shape == flown.touched.shape == flown.error.shape == (4,)
    assert not (flown.success & flown.touched).any()
    assert (flown.error > 0).all()
