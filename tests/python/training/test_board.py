"""The board: recipes, reports, and curves."""

import dataclasses
import json

import imageio.v3 as imageio
import numpy as np
import pytest
from messages import refused

import flockstep

pytest.importorskip("stable_baselines3")
from flockstep.trainings import CHOOSING_SEEDS, TRAINING_SEEDS, UNSEEN_SEEDS, Verdict, table, train
from training import board, demo, evaluate, forest_flight, rotor_navigation


@pytest.fixture
def small(monkeypatch):
    """Make a recipe of two rollouts in four worlds, judged by three flights."""
    for module in (table, forest_flight, rotor_navigation):
        monkeypatch.setattr(module, "TRAINING_SEEDS", TRAINING_SEEDS[:4])

    def make(name):
        recipe = board.TRAININGS[name]
        settings = {**recipe.settings, "n_steps": 4, "batch_size": 32, "n_epochs": 1}
        made = dataclasses.replace(
            recipe,
            steps=128,
            num_envs=16,
            settings=settings,
            flights=3,
            baselines={flyer: each[:1] for flyer, each in recipe.baselines.items()},
            film={**recipe.film, "steps": 2, "render_size": (32, 24)},
        )
        monkeypatch.setitem(board.TRAININGS, name, made)
        return made

    return make


@pytest.mark.parametrize("name", board.TRAININGS)
def test_every_recipe_trains_is_judged_and_filmed(name, small, tmp_path):
    small(name)
    figures = {each["name"]: each for each in board.report(name, 1, name == "hover", tmp_path)}
    run = f"board/{name}/seed0/flockstep_1"
    assert 0 <= figures[f"{run}/success"]["value"] <= 1
    assert figures[f"{run}/seconds"]["value"] > 0
    assert 0 <= figures[f"board/{name}/baseline/success"]["value"] <= 1
    assert [steps for steps, _, _ in figures[f"{run}/success"]["curve"]] == [64, 128]
    assert (f"board/{name}/seed0/sb3_1/success" in figures) == (name == "hover")
    assert (tmp_path / f"{name}.mp4").stat().st_size > 500
    flown = flockstep.PPO.load(tmp_path / f"{name}-seed0")
    assert flown.num_timesteps == 128


def test_the_demo_draws_the_reward_and_names_a_failure(small, tmp_path, capsys):
    recipe = dataclasses.replace(small("hover"), steps=8192, num_envs=64)
    clock = board.Clock(recipe, judges=True)
    train(recipe, "flockstep", 0, 1, [clock])
    steps, seconds, rewards = np.array(clock.rewards).T
    assert steps[-1] == 8192
    assert (np.diff(seconds) > 0).all()
    assert np.isfinite(rewards).all()
    demo.plot_curve(clock, tmp_path / "curve.png")
    assert imageio.imread(tmp_path / "curve.png").shape == (975, 1200, 4)

    assert demo.Args().max_minutes is None
    flights = evaluate.fly(lambda seen: np.zeros(len(seen), int), flockstep.scenes.load("train"), 50)
    demo.print_summary(demo.Args(), clock, flights, 0.5, {"straight_flight": 0.25, "random_policy": 0.0})
    text = capsys.readouterr().out
    assert "FAILED: time ran out at 8,192 of 1,500,000 steps. The policy did not learn to fly by LiDAR" in text
    assert "of 0 of the 5 bundled" in text
    assert f"a film of one flight ({flights[1].outcome})" in text


@pytest.mark.parametrize(
    ("success", "steps", "said"),
    [
        (0.98, 100, "A policy learned from scratch to fly"),
        (0.5, 100, "FAILED. The policy did not learn to fly"),
        (0.5, 60, "FAILED: time ran out at 60 of 100 steps. The policy did not learn to fly"),
    ],
)
def test_a_verdict_says_whether_a_policy_learned(success, steps, said):
    assert board.verdict_on("fly", success, steps, 100) == said


def test_the_flights_of_the_report_are_those_of_nothing_else(small, monkeypatch, tmp_path):
    judged = []

    def judge(recipe, policy, flights, seed):
        judged.append((flights, seed))
        return Verdict(1.0, 0.0)

    small("hover")
    monkeypatch.setattr(board, "judge", judge)
    board.report("hover", 2, False, tmp_path)
    once = [(3, CHOOSING_SEEDS.start), (3, CHOOSING_SEEDS.start), (3, UNSEEN_SEEDS.start)]
    assert judged == [*once * 2, (3, UNSEEN_SEEDS.start)]  # the last are the baseline's


def test_different_policies_of_one_thread_and_two_are_an_error(small, monkeypatch, tmp_path):
    small("hover")
    seeds = iter(range(9))
    monkeypatch.setattr(board, "train", lambda recipe, learner, seed, *rest: train(recipe, learner, next(seeds), *rest))
    with refused(AssertionError, "hover", "different policies"):
        board.report("hover", 1, False, tmp_path)


def test_the_entropy_bonus_falls_to_zero_and_the_learning_rate_too(small):
    recipe = dataclasses.replace(small("lidar"), steps=640)
    coefficients, rates = [], []

    class Look(board.BaseCallback):
        def _on_rollout_start(self):
            coefficients.append(self.model.ent_coef)
            rates.append(self.model.learning_rate(self.model._current_progress_remaining))

        def _on_step(self):
            return True

    train(recipe, "flockstep", 0, 1, [Look()])
    np.testing.assert_allclose(coefficients, [0.03 * max(0, 1 - k / 8) for k in range(10)], atol=1e-12)
    np.testing.assert_allclose(rates, [1.5e-3 * (1 - k / 10) for k in range(10)])


def test_the_command_writes_figures_and_curves_and_refuses_other_names(small, tmp_path):
    small("hover")
    board.main(board.Args(names=("hover",), out=tmp_path, seeds=2, sb3=False))
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert sum("curve" in each for each in figures) == 2
    assert (tmp_path / "curves.png").stat().st_size > 5000
    with refused(SystemExit, "NAME", "hoover"):
        board.main(board.Args(names=("hoover",), out=tmp_path))


def run_of(name, seed, run, success, seconds, curve):
    path = f"board/{name}/seed{seed}/{run}"
    return [
        {"name": f"{path}/seconds", "value": seconds, "unit": "s", "runs": 1},
        {"name": f"{path}/success", "value": success, "unit": "1", "runs": 9, "curve": [[1, 1.0, curve]]},
    ]


def test_the_seeds_of_two_learners_are_compared():
    figures = []
    for seed in range(5):
        figures += run_of("hover", seed, "flockstep_1", 0.99 - 0.01 * seed, 7.0 + seed, 0.5 + 0.01 * seed)
        figures += run_of("hover", seed, "sb3_1", 0.98, 40.0, 0.6 + 0.01 * seed)
    found = {figure["name"]: figure["value"] for figure in board.comparison("hover", figures)}
    assert found["board/hover/seed4/flockstep_1/curve_mean"] == 0.54
    assert found["board/hover/seed1/sb3_1/curve_mean"] == 0.61
    assert found["board/hover/p_of_curves"] == pytest.approx(2 / 252, rel=1e-3)
    assert found["board/hover/p_of_success"] == pytest.approx(0.33, abs=0.005)
    assert not any("/p_of" in each["name"] for each in board.comparison("hover", figures[:2]))


def test_a_permutation_test_by_hand():
    """Four numbers split into pairs in six ways; two have a difference as large as that of 1, 2 and 3, 4."""
    assert board.permutation_p([1, 2], [3, 4]) == pytest.approx(2 / 6)
    assert board.permutation_p([1, 4], [2, 3]) == 1
