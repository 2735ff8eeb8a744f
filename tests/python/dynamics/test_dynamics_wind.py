"""Gusts of a batch advance with time, for any division of the flight into calls."""

import numpy as np
import pytest
from rigid_body import batch_of, frame

import flockstep

DRONES = 3000
POLICY_HZ = 10
WIND = {
    "ornstein_uhlenbeck": flockstep.WindConfig(gusts="ornstein_uhlenbeck", gust_std_mps=1.5, gust_time_s=2.0),
    "dryden": flockstep.WindConfig(gusts="dryden", mean_mps=(5, 0, 0)),
}


def in_gusts(num_drones, gusts="ornstein_uhlenbeck"):
    return batch_of(frame("x500"), num_drones, POLICY_HZ, wind=WIND[gusts])


def gusts_of(batch):
    return batch.wind.astype(float).ravel()


@pytest.mark.parametrize(("calls", "ticks"), [(50, 1), (1, 50), (1, 5000), (250, 20), (7, 7)])
def test_correlation_falls_with_time(calls, ticks):
    """A gust lasts one step, so the time counts between the beginnings of two steps."""
    batch = in_gusts(DRONES)
    command = np.full((DRONES, 4), 400.0)
    batch.fly(command, ticks=1)
    first = gusts_of(batch)
    for _ in range(calls):
        batch.fly(command, ticks=ticks)
    expected = np.exp(-(calls * ticks // 50) / POLICY_HZ / 2.0)
    assert np.corrcoef(first, gusts_of(batch))[0, 1] == pytest.approx(expected, abs=5 / np.sqrt(3 * DRONES))


@pytest.mark.parametrize("gusts", WIND)
def test_calls_of_any_length_have_the_same_gusts(gusts):
    command = np.full((2, 4), 400.0)
    winds = []
    for ticks in (1, 7, 50, 350):
        batch = in_gusts(2, gusts)
        for _ in range(350 // ticks):
            batch.fly(command, ticks=ticks)
        winds.append(batch.wind.copy())
    np.testing.assert_array_equal(winds, [winds[0]] * 4)


def test_an_env_has_the_same_gusts_beside_envs_at_other_ticks():
    """The same bits, including positions, even if the other envs are in the middle of a step."""
    command = np.full((3, 4), 500.0)
    alone, beside = in_gusts(1), in_gusts(3)
    beside.fly(command, ticks=13, mask=[False, True, False])
    beside.fly(command, ticks=49, mask=[False, False, True])
    for ticks in (3, 50, 120, 1, 1):
        alone.fly(command[:1], ticks=ticks)
        beside.fly(command, ticks=ticks)
    for name in ("position", "quat_wxyz", "velocity", "wind"):
        np.testing.assert_array_equal(getattr(alone, name)[0], getattr(beside, name)[0])
    assert beside.tick.tolist() == [175, 188, 224]
