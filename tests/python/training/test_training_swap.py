"""The training of Swap: a small one, and the flights that judge it."""

import flockstep
from training import swap, train_swap


def test_a_small_training_is_judged(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(swap, "TRAINING_DRONES", {2: 64, 8: 64})
    monkeypatch.setattr(swap, "JUDGED", (2, 8))
    out = tmp_path / "swap.zip"
    train_swap.main(train_swap.Args(out=out, steps=8192, threads=1, flights=4))
    assert "of 4 swaps of 8 drones succeed" in capsys.readouterr().out
    flockstep.PPO.load(out)


def test_flights_that_judge_count_every_end():
    around = swap.fly(swap.straight, 20, 500_000, 3)  # the goals are the places of neighbours
    assert around.success.all()
    assert not around.touched.any()
    across = swap.fly(swap.straight, 20, 500_000, 2)
    assert across.touched.all()
    assert not across.success.any()
    for flown in (around, across):
        assert (flown.seconds > 1).all()
        assert (flown.seconds < 10).all()
