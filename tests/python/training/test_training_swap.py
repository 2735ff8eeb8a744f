"""The training of Swap: a small one, and the flights that judge it."""

import numpy as np

import flockstep
from training import swap, train_swap


def test_a_small_training_is_judged(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(swap, "NUM_ENVS", 8)
    monkeypatch.setattr(swap, "JUDGED", (2, 8))
    out = tmp_path / "swap.zip"
    train_swap.main(train_swap.Args(out=out, steps=8192, threads=1, flights=4))
    assert "of 4 swaps of 8 drones succeed" in capsys.readouterr().out
    flockstep.PPO.load(out)


def test_flights_that_judge_count_every_end():
    flown = swap.fly(lambda observation: swap.straight(observation) * [1, 0.0], 40, 500_000, 4)
    assert flown.success.shape == flown.touched.shape == flown.seconds.shape == (40,)
    assert flown.success.any()
    assert flown.touched.any()
    assert not (flown.success & flown.touched).any()
    assert (flown.seconds > 1).all()


def test_two_drones_that_fly_straight_touch():
    assert np.mean(swap.fly(swap.straight, 20, 500_000, 2).touched) > 0.9
