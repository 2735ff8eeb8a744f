"""training/race.py, training/race_bound.py and training/train_race.py: flights that judge, laps to compare with."""

from dataclasses import replace

import numpy as np
import pytest

import flockstep

pytest.importorskip("stable_baselines3")
from training import race, race_bound, recipes, train_race
from training.tasks import CHOOSING_SEEDS, UNSEEN_SEEDS


def test_a_controller_flies_three_laps():
    flown = race.fly(race.Pursuit(5.0), 20, CHOOSING_SEEDS.start)
    assert flown.success.all()
    assert not flown.crashed.any()
    assert 10 < flown.lap_s < 14
    assert flown.lap_s * flown.speed_mps == pytest.approx(47.6, abs=0.5)  # the length of a lap


def test_the_lap_is_that_of_the_second_and_third():
    """Check one flight, step by step."""
    pilot = race.Pursuit(5.0)
    envs = flockstep.DroneVectorEnv(
        1, task=flockstep.RaceConfig(start="gate"), max_episode_steps=3000, autoreset_mode="disabled"
    )
    observation, _ = envs.reset(seed=7)
    passed = [0]
    while passed[-1] < 21:
        observation, *_ = envs.step(pilot(observation))
        passed.append(int(envs.batch.task_state["passed"][0]))
    assert race.fly(pilot, 1, 7).lap_s == pytest.approx((passed.index(21) - passed.index(7)) * 0.02 / 2)


def test_a_policy_that_only_hovers_neither_succeeds_nor_crashes(monkeypatch):
    monkeypatch.setattr(race, "MOST_STEPS", 20)
    flown = race.fly(lambda observation: np.zeros((len(observation), 4), np.float32), 4, 0)
    assert not flown.success.any()
    assert np.isnan(flown.lap_s)
    verdict = recipes.judge_race(race.fly)(lambda observation: np.zeros((len(observation), 4), np.float32), 4, 0)
    assert (verdict.success, verdict.more) == (0.0, {})


def test_unseen_tracks_are_those_of_the_seeds():
    flown = race.fly_unseen(race.Pursuit(4.0), 6, UNSEEN_SEEDS.start)
    assert flown.success.any()
    by_hand = race.fly(
        race.Pursuit(4.0), 6, UNSEEN_SEEDS.start, [flockstep.World.race_track(UNSEEN_SEEDS.start + i) for i in range(6)]
    )
    np.testing.assert_array_equal(flown.success, by_hand.success)
    assert flown.lap_s == by_hand.lap_s
    envs = race.make_on_tracks(8, 1)
    names = {world.name for world in envs.batch.worlds}
    assert len(names) == race.TRACKS
    assert not names & {flockstep.World.race_track(seed).name for seed in (CHOOSING_SEEDS.start, UNSEEN_SEEDS.start)}


def test_the_chosen_controller_is_the_fastest_of_the_best():
    rates = {3.0: 0.9, 4.0: 1.0, 5.0: 1.0, 6.0: 0.5}

    def fly(pilot, flights, seed):
        assert (flights, seed) == (200, CHOOSING_SEEDS.start)
        success = np.arange(flights) < flights * rates.get(pilot.speed_mps, 0.0)
        return race.Race(success, ~success, 1.0, 1.0)

    assert race.chosen_pursuit(fly).speed_mps == 5.0


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
    assert race_bound.lap_s(world, 4.0, 2) == pytest.approx(3.757, abs=0.01)  # the page has the lap with 8 parts
    assert race_bound.lap_s(world, 4.0, 2) > race_bound.lap_s(world, 6.0, 2) + 0.4


def test_a_training_is_saved_and_judged(tmp_path, monkeypatch, capsys):
    small = replace(recipes.RECIPES["race"], steps=4096, num_envs=64)
    monkeypatch.setitem(recipes.RECIPES, "race", small)
    path = tmp_path / "race.zip"
    train_race.main(train_race.Args(out=path, threads=1, flights=4))
    assert "of 4 flights" in capsys.readouterr().out
    assert path.stat().st_size < 200_000
    assert flockstep.PPO.load(path).num_timesteps == 4096


def test_gates_are_narrower_in_training():
    envs = race.make(2, 1, ("race/split-s", flockstep.World.race_track(3)))
    for made, track in zip(envs.batch.worlds, ("race/split-s", flockstep.World.race_track(3)), strict=True):
        judged = flockstep.World.load(track) if isinstance(track, str) else track
        np.testing.assert_allclose(
            [gate["size_m"] for gate in made.gates],
            np.array([gate["size_m"] for gate in judged.gates]) - race.NARROWER_M,
        )
        np.testing.assert_array_equal(made.gates[2]["center"], judged.gates[2]["center"])
