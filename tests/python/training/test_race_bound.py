"""training/race_bound.py: the lap of a point mass."""

import numpy as np
import pytest

import flockstep
from training import race_bound


@pytest.mark.parametrize("name", ["race/figure-8", "race/split-s"])  # squares; squares and rings
def test_the_slopes_of_the_point_mass(name):
    lap = race_bound.Lap(list(flockstep.World.load(name).gates), 30.0, 3)
    x = lap.first_guess(9.0)
    x += 0.1 * np.random.default_rng(0).normal(size=x.size)
    for function, slope in ((lap.gaps, lap.gaps_slope), (lap.room, lap.room_slope)):
        steps = 1e-6 * np.eye(x.size)
        numeric = np.stack([(function(x + step) - function(x - step)) / 2e-6 for step in steps], axis=1)
        np.testing.assert_allclose(slope(x), numeric, atol=1e-6)


def test_the_point_mass_there_and_back():
    """Two gates ahead of one another, 10 m apart: accelerate and brake sideways to gravity, twice."""
    turned = [0, 0, 0, 1]
    gates = [{"center": [0, 0, 50], "size": 0.2}, {"center": [10, 0, 50], "size": 0.2, "quat_wxyz": turned}]
    world = flockstep.World.from_dict({"flockstep_scene": 1, "gates": gates})
    along = 9.81 * np.sqrt(4.0**2 - 1)  # m/s^2, while the thrust carries the weight
    expected = 4 * np.sqrt(10 / along)
    assert race_bound.lap_s(world, 4.0, 4) == pytest.approx(expected, rel=0.05)


def test_the_point_mass_on_the_figure_8(monkeypatch):
    monkeypatch.setattr(race_bound, "SPEEDS_MPS", (9.0,))
    world = flockstep.World.load("race/figure-8")
    assert race_bound.lap_s(world, 4.0, 2) == pytest.approx(3.757, abs=0.01)  # docs/race.md has the lap with 8 parts
    assert race_bound.lap_s(world, 4.0, 2) > race_bound.lap_s(world, 6.0, 2) + 0.4
