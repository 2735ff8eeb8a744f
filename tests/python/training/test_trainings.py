"""flockstep.trainings: the table, the flights that judge, training by both learners, and the commands."""

import itertools
import math
import runpy
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from conftest import world_of
from messages import refused

import flockstep
from flockstep import trainings
from flockstep.trainings import CHOOSING_SEEDS, TRAININGS, UNSEEN_SEEDS, flyers, flying, judge, learning, table, varied
from tools import keep_policy
from training import race_bound

UNSEEN = UNSEEN_SEEDS.start
FEW = {"hover": 4, "swap": 2, "dodge": 4, "formation": 2, "race": 2}


def shortened(name, monkeypatch):
    """A training of two rollouts of few drones in few worlds."""
    monkeypatch.setattr(table, "TRAINING_SEEDS", table.TRAINING_SEEDS[:4])
    training = TRAININGS[name]
    settings = {**training.settings, "n_steps": 4, "batch_size": 32, "n_epochs": 1}
    learns = dict(training.learns() if name in ("hover", "track", "race") else {})
    if name == "swap":
        learns = {"drones_per_env": {2: 16, 8: 16}}
    elif name == "formation":
        learns = {"drones_per_env": 4}
    small = replace(training, steps=256, num_envs=32, settings=settings, learns=lambda: learns)
    monkeypatch.setitem(TRAININGS, name, small)
    return small


def command(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["flockstep", *map(str, arguments)])
    runpy.run_module("flockstep", run_name="__main__")


@pytest.mark.parametrize("name", ["hover", "swap", "dodge", "formation", "race"])
def test_a_training_is_saved_and_judged(name, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    shortened(name, monkeypatch)
    monkeypatch.setattr(table, "WAREHOUSES", 1)
    monkeypatch.setattr(table, "FORMATION_STEPS", dict.fromkeys(table.FORMATION_STEPS, 40))
    command(monkeypatch, "train", name, "--threads", 1, "--flights", FEW[name])
    told = capsys.readouterr().out
    steps = 512 if name == "formation" else 256  # whole rollouts of 32 envs with 4 drones, or of 32 drones
    assert f"{steps} steps in" in told
    assert f"of {FEW[name]} flights succeed" in told
    assert flockstep.PPO.load(tmp_path / f"{name}.zip").num_timesteps == steps


def test_both_learners_train_and_every_command_takes_their_policies(monkeypatch, tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    small = shortened("hover", monkeypatch)
    monkeypatch.setitem(TRAININGS, "hover", replace(small, film={"steps": 2, "render_size": (32, 24)}))
    command(monkeypatch, "train", "hover", "--learner", "sb3", "--flights", 2, "--out", "made/sb3.zip")
    command(monkeypatch, "evaluate", "hover", "made/sb3.zip", "--learner", "sb3", "--flights", 3)
    assert "of 3 flights succeed" in capsys.readouterr().out
    command(monkeypatch, "record", "hover", "made/sb3.zip", "made/film.gif", "--learner", "sb3")
    assert Path("made/film.gif").stat().st_size > 100
    command(monkeypatch, "evaluate", "hover", "controller", "--flights", 2)
    assert "median_error_m" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("train", "hove"), ("flockstep train: TRAINING", "hove", "hover")),
        (("train", "no_such_module:ROW"), ("flockstep train: TRAINING", "no_such_module:ROW")),
        (("evaluate", "math:pi", "x"), ("flockstep evaluate: TRAINING", "math:pi", math.pi)),
        (("evaluate", "race", "none.zip"), ("flockstep evaluate: POLICY", "controller", "none.zip")),
    ],
)
def test_the_commands_name_what_they_refuse(arguments, said, monkeypatch):
    with refused(SystemExit, *said):
        command(monkeypatch, *arguments)


def test_a_row_of_your_own_is_trained(monkeypatch, tmp_path, capsys):
    row = shortened("hover", monkeypatch)
    monkeypatch.setitem(__import__("sys").modules, "my_rows", SimpleNamespace(MINE=row))
    monkeypatch.chdir(tmp_path)
    command(monkeypatch, "train", "my_rows:MINE", "--flights", 2, "--threads", 1)
    assert "MINE.zip" in capsys.readouterr().out
    assert (tmp_path / "MINE.zip").exists()


@pytest.mark.parametrize("name", TRAININGS)
def test_every_row_names_known_keywords_and_figures(name):
    training = TRAININGS[name]
    assert {what for _, what in training.figures.values()} <= {
        *("success", "crashed", "seconds", "contacts_per_minute", "lap_s", "speed_mps", "error_m", "median_error_m"),
        *("within_20cm", "turn_radps"),
    }
    flights = 2
    kinds = set(training.judged(flights, UNSEEN))
    assert {kind for kind, _ in training.figures.values()} <= {"", *kinds}
    assert set(training.over or ()) <= kinds
    assert training.baselines


@pytest.mark.parametrize("name", ["hover", "lidar"])
def test_a_preset_trains_as_its_row(name, monkeypatch):
    training = shortened(name, monkeypatch)
    preset = flockstep.presets[name]
    envs = preset.make_envs(num_threads=1)
    assert envs.num_envs == preset.num_envs == training.num_envs
    model = flockstep.PPO("MlpPolicy", envs, **preset).learn(preset.steps)
    assert model.num_timesteps == training.steps
    assert [model.learning_rate(left) for left in (1.0, 0.0)] == [training.settings["learning_rate"], 0.0]
    assert model.ent_coef == {"hover": 0.0, "lidar": 0.012}[name]
    assert {*preset} - {"ent_coef"} == {*training.settings}


@pytest.mark.parametrize(
    ("preset", "drones", "steps", "rate", "observed", "worlds"),
    [
        (flockstep.thesis.lidar(), 40, 36_864_000, 3e-4, 38, 5),
        (flockstep.thesis.lidar("maximum"), 40, 36_864_000, 3e-4, 38, 5),
        (flockstep.thesis.camera(64), 8, 4_400_000, 1e-4, 22, 2),
    ],
)
def test_the_presets_of_the_thesis_are_its_tables(preset, drones, steps, rate, observed, worlds):
    assert (preset.num_envs, preset.steps, dict(preset)) == (
        drones,
        steps,
        {"n_steps": 2048, "gamma": 0.99, "clip_range": 0.2, "learning_rate": rate},
    )
    envs = preset.make_envs(num_threads=1)
    assert envs.single_observation_space.shape == (observed,)
    assert (len(envs.batch.worlds), envs.recipe.episode.max_episode_steps) == (worlds, None)
    assert np.bincount(envs.batch.world_index).tolist() == [drones // worlds] * worlds  # as many in each playground
    envs.close()


def test_a_camera_of_the_thesis_without_a_width_is_refused():
    with refused(TypeError, "width_px", "an integer", "'a'"):
        flockstep.thesis.camera("a")


def test_presets_are_the_rows_of_the_table():
    assert [*flockstep.presets] == [*TRAININGS]
    assert "hover" in flockstep.presets
    for name, preset in flockstep.presets.items():
        assert {**preset}.items() >= {**TRAININGS[name].settings, "learning_rate": preset["learning_rate"]}.items()
        assert TRAININGS[name].env in repr(preset)
    with refused(ValueError, "presets", *TRAININGS, "lidr"):
        flockstep.presets["lidr"]


def test_training_begins_with_seeds_of_its_own(monkeypatch):
    seeds = []
    reset = flockstep.DroneVectorEnv.reset

    def noted(self, *, seed=None, options=None):
        seeds.append(seed)
        return reset(self, seed=seed, options=options)

    monkeypatch.setattr(flockstep.DroneVectorEnv, "reset", noted)
    trainings.train(shortened("hover", monkeypatch), "flockstep", 2, 1)
    assert seeds == [trainings.first_env_seed(2, 32)]
    assert seeds[0] >= UNSEEN_SEEDS.stop


def test_seeds_of_training_choosing_and_report_are_disjoint():
    ranges = trainings.TRAINING_SEEDS, CHOOSING_SEEDS, UNSEEN_SEEDS
    assert all(a.stop <= b.start for a, b in itertools.pairwise(ranges))
    names = {world.name for world in TRAININGS["race_unseen"].learns()["worlds"]}
    judged = {world.name for world in TRAININGS["race_unseen"].judged(3, UNSEEN)[""]["worlds"]}
    assert len(names) == 300
    assert judged == {f"race_track/seed-{seed}" for seed in range(UNSEEN, UNSEEN + 3)}
    assert not names & judged


def test_gates_are_narrower_in_training():
    for track in (flockstep.World.load("race/split-s"), flockstep.World.race_track(3)):
        made = varied.narrowed(track)
        widths = [gate["size_m"] for gate in track.gates]
        np.testing.assert_allclose([gate["size_m"] for gate in made.gates], np.array(widths) - varied.NARROWER_M)
        np.testing.assert_array_equal(made.gates[2]["center"], track.gates[2]["center"])


def test_still_worlds_have_no_bodies(monkeypatch):
    monkeypatch.setattr(table, "TRAINING_SEEDS", range(1))
    for name, bodies in (("dodge", True), ("dodge_still", False)):
        assert all((len(world.bodies) > 0) == bodies for world in TRAININGS[name].learns()["worlds"])


# --- what is measured


def measured(measure, distances, *rest):
    """Give a measure of one drone some distances to its point."""
    envs = SimpleNamespace(num_envs=1, batch=SimpleNamespace(clock=SimpleNamespace(policy_hz=50.0)))
    made = measure(envs, *rest)
    for distance in distances:
        made.step(np.array([[distance or 0.0, 0.0, 0.0]]), np.array([distance is not None]))
    return {name: values[0] for name, values in made.values(np.array([len(distances)]), np.array([False])).items()}


def test_errors_of_flights_by_hand():
    hover = partial(measured, partial(flyers.PointError, steps=300, last=50, power=1))
    assert hover([9.0] * 250 + [0.04] * 50) == {"error_m": pytest.approx(0.04), "success": True, "crashed": False}
    assert not hover([9.0] * 250 + [0.06] * 51)["success"]  # steps after the last one do not count
    lost = hover([0.01] * 200 + [None] * 100)
    assert np.isnan(lost["error_m"])
    assert (lost["success"], lost["crashed"]) == (False, True)
    track = measured(partial(flyers.PointError, steps=2, last=2, power=2), [0.03, 0.04])
    assert track["error_m"] == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2))
    place = measured(flyers.PlaceError, [0.1, 0.2, None])
    assert place["error_m"] == pytest.approx(0.3)  # observed in units of 2 m


def test_position_control_catches_what_is_thrown():
    flyer = flying.Flyer(flyers.position_control, {"control": "position", "drone": "x500"})
    verdict = judge(TRAININGS["hover"], flyer, 32, UNSEEN)
    assert verdict.crashed == 0
    assert verdict.more["median_error_m"] < 0.05


def test_velocity_control_follows_a_path():
    flyer = flyers.velocity_control(3, 2.0)
    flyer.keywords |= {"speed_mps": 0.5, "drone": "x500"}
    verdict = judge(TRAININGS["track"], flyer, 32, UNSEEN)
    assert verdict.crashed == 0
    assert verdict.more["median_error_m"] < 0.1


def test_a_controller_flies_three_laps():
    verdict = judge(TRAININGS["race"], flyers.pursuit(5.0), 20, CHOOSING_SEEDS.start)
    assert (verdict.success, verdict.crashed) == (1.0, 0.0)
    assert 10 < verdict.more["lap_s"] < 14
    assert verdict.more["lap_s"] * verdict.more["speed_mps"] == pytest.approx(47.6, abs=0.5)  # the length of a lap


def test_the_lap_is_that_of_the_second_and_third():
    """Check one flight, step by step."""
    pilot = flyers.pursuit(5.0)
    task = flockstep.RaceConfig(start="gate")
    envs = flockstep.DroneVectorEnv(1, task=task, max_episode_steps=3000, autoreset_mode="disabled")
    act = pilot.in_envs(envs)
    observation, _ = envs.reset(seed=7)
    passed = [0]
    while passed[-1] < 21:
        observation, *_ = envs.step(act(observation))
        passed.append(int(envs.batch.task_state["passed"][0]))
    lap_s = judge(TRAININGS["race"], pilot, 1, 7).more["lap_s"]
    assert lap_s == pytest.approx((passed.index(21) - passed.index(7)) * 0.02 / 2)


def test_a_policy_that_only_hovers_neither_succeeds_nor_crashes():
    race = replace(TRAININGS["race"], judged=partial(table._race, worlds="race/figure-8", max_episode_steps=20))
    verdict = judge(race, lambda observation: np.zeros((len(observation), 4), np.float32), 4, 0)
    assert (verdict.success, verdict.crashed, verdict.more) == (0.0, 0.0, {})


def test_drones_of_an_env_succeed_and_touch_together():
    drones = {3: (1.0, 0.0), 2: (0.0, 1.0)}  # around: the goals are the places of neighbours; across: they meet
    judged = {str(count): {"drones_per_env": count, "max_episode_steps": 300} for count in drones}
    row = replace(TRAININGS["swap"], judged=lambda flights, seed: judged)
    for count, flown in trainings.fly(row, flyers.straight_in_swap, 20, CHOOSING_SEEDS.start).items():
        assert flown.success.shape == flown.crashed.shape == flown.seconds.shape == (20,)
        assert (flown.figure("success"), flown.figure("crashed")) == drones[int(count)]
        assert (flown.seconds > 1).all()
        assert (flown.seconds < 10).all()


def test_figures_of_flights_by_hand():
    flown = flying.Flights(
        np.array([True, False, True]),
        np.array([False, True, False]),
        np.array([2.0, 30.0, 4.0]),
        {"a": np.full(3, np.nan)},
    )
    assert flown.figure("seconds") == 3  # of the successful ones
    assert flown.figure("contacts_per_minute") == pytest.approx(60 / 36)
    assert np.isnan(flown.figure("a"))


def test_the_verdict_is_over_the_flights_of_its_kinds(monkeypatch):
    kinds = {name: flying.Flights(np.array(flags), ~np.array(flags), np.ones(len(flags)), {}) for name, flags in
             (("a", [True]), ("b", [False, False, True]))}  # fmt: skip
    monkeypatch.setattr(flying, "fly", lambda *_: dict(kinds))
    row = replace(TRAININGS["dodge"], figures={"of_a": ("a", "success"), "all": ("", "crashed")})
    assert judge(row, None, 1, 0) == flying.Verdict(0.5, 0.5, {"of_a": 1.0, "all": 0.5})
    assert judge(replace(row, over=("a",)), None, 1, 0).success == 1.0


def test_the_chosen_flyer_has_the_least_error_or_else_is_the_last_of_the_best(monkeypatch):
    rates = {3.0: 0.9, 4.0: 1.0, 5.0: 1.0, 6.0: 0.5}

    def verdict(row, flyer, flights, seed):
        assert (flights, seed) == (200, CHOOSING_SEEDS.start)
        return flying.Verdict(rates[flyer], 0.0, {} if row is TRAININGS["race"] else {"median_error_m": flyer})

    monkeypatch.setattr(flying, "judge", verdict)
    assert trainings.best_of(TRAININGS["race"], list(rates)) == 5.0
    assert trainings.best_of(TRAININGS["track"], list(rates)) == 3.0


def test_unknown_ends_are_not_judged():
    """A figure whose flights have no value is left out, so that no table shows NaN."""
    row = replace(TRAININGS["hover"], judged=lambda flights, seed: {"": {"max_episode_steps": 301}})
    verdict = judge(row, lambda observation: np.zeros((len(observation), 4), np.float32), 2, 3)
    assert (verdict.success, verdict.crashed, verdict.more) == (0.0, 1.0, {})  # thrown and never caught


@pytest.mark.parametrize("name", flockstep.policies.names())
def test_bundled_policies_fit_the_environment_of_their_row(name):
    own = {key: value for key, value in TRAININGS[name].film.items() if key in ("control", "observed")}
    model, envs = flockstep.policies.load(name), gymnasium.make_vec(TRAININGS[name].env, num_envs=2, **own)
    actions, _ = model.predict(envs.reset(seed=0)[0], deterministic=True)
    assert actions.shape == (envs.num_envs, *envs.single_action_space.shape)
    assert model.num_timesteps > 1_000_000
    assert model.learner.adam[2] == 0  # a wheel holds no moments of Adam
    envs.close()


def test_a_policy_that_is_not_bundled_is_refused():
    with refused(ValueError, "policies", "dodge, formation, hover", "liadr", "Did you mean 'lidar'?"):
        flockstep.policies.load("liadr")


def test_a_policy_is_kept_without_the_moments_of_adam(monkeypatch, tmp_path):
    preset = flockstep.presets["hover"]
    model = flockstep.PPO("MlpPolicy", preset.make_envs(1), **preset).learn(1)
    model.save(tmp_path / "new")
    keep_policy.main(keep_policy.Args(tmp_path / "new.zip", "mine", tmp_path / "kept"))
    monkeypatch.setattr(flockstep.policies, "directory", lambda: tmp_path / "kept")
    assert flockstep.policies.names() == ["mine"]
    kept = flockstep.policies.load("mine")
    np.testing.assert_array_equal(kept.learner.parameters, model.learner.parameters)
    assert (model.learner.adam[2] > 0, kept.learner.adam[2]) == (True, 0)


def test_the_commands_take_the_name_of_a_bundled_policy(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    command(monkeypatch, "evaluate", "race", "race", "--flights", 1)
    assert "of 1 flights succeed" in capsys.readouterr().out


def test_side_by_side_needs_its_own_rows(monkeypatch):
    pytest.importorskip("stable_baselines3")
    envs = learning.make(shortened("swap", monkeypatch), 32, 1)
    assert envs.num_envs == 32
    assert envs.reset().shape[0] == 32
    envs.close()


# --- the lap of a point mass


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
    world = world_of(gates=gates)
    along = 9.81 * np.sqrt(4.0**2 - 1)  # m/s^2, while the thrust carries the weight
    expected = 4 * np.sqrt(10 / along)
    assert race_bound.lap_s(world, 4.0, 4) == pytest.approx(expected, rel=0.05)


def test_the_point_mass_on_the_figure_8(monkeypatch):
    monkeypatch.setattr(race_bound, "SPEEDS_MPS", (9.0,))
    world = flockstep.World.load("race/figure-8")
    assert race_bound.lap_s(world, 4.0, 2) == pytest.approx(3.757, abs=0.01)  # docs/race.md has the lap with 8 parts
    assert race_bound.lap_s(world, 4.0, 2) > race_bound.lap_s(world, 6.0, 2) + 0.4
