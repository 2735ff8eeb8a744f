"""flockstep.APG: trainings of a second, the gradient against differences, files, bits and refusals."""

import runpy

import gymnasium
import numpy as np
import pytest
from conftest import ROOT
from messages import refused

import flockstep
from flockstep import APG, PPO, DroneVectorEnv, HoverConfig, RaceConfig, TrackConfig, _core
from flockstep.trainings import CHOOSING_SEEDS, TRAININGS, judge, train

POINT = {"features_extractor_class": "PointFeatures"}
LATE = flockstep.vary(action_delay_s=(0.0, 0.06), action_jitter_s=(0.0, 0.06), action_loss=0.2)


def hover(num_envs=20, **keywords):
    return DroneVectorEnv(num_envs, task=HoverConfig(), **keywords)


def trained(threads=1, steps=9_600, **keywords):
    model = APG("MlpPolicy", hover(**keywords), horizon=16, policy_kwargs=POINT, seed=3, num_threads=threads)
    return model.learn(steps)


@pytest.mark.parametrize(("name", "least"), [("hover_apg", 0.95), ("track_apg", 0.9)])
def test_a_policy_is_trained_in_a_second(name, least):
    model = train(TRAININGS[name], seed=0, threads=1)
    assert isinstance(model, APG)
    assert judge(TRAININGS[name], model, 200, CHOOSING_SEEDS.start).success >= least


def test_a_race_is_learned_by_gradients():
    model = train(TRAININGS["race_apg"], seed=0, threads=2)
    verdict = judge(TRAININGS["race_apg"], model, 100, CHOOSING_SEEDS.start)
    assert verdict.success >= 0.8
    assert verdict.more["lap_s"] < 5.0


@pytest.mark.parametrize(
    ("task", "ticks", "keywords"),
    [
        (HoverConfig(), 1, {}),
        (HoverConfig(), 2, {"control": "body_rates"}),
        (HoverConfig(), 1, {"variations": flockstep.vary(mass_scale=(0.8, 1.2), lag_up_scale=(0.5, 2.0))}),
        (TrackConfig(), 1, {}),
        (RaceConfig(), 2, {"worlds": "race/figure-8"}),
        (HoverConfig(), 1, {"variations": LATE, "max_episode_steps": 6}),
        (HoverConfig(), 2, {"variations": LATE, "control": "body_rates", "airframes": ["crazyflie", "x500"]}),
        (HoverConfig(), 3, {"variations": LATE, "control": "heading_velocity", "autoreset_mode": "same_step"}),
        (TrackConfig(), 1, {"variations": LATE}),
        (RaceConfig(), 2, {"variations": LATE, "worlds": "race/figure-8", "max_episode_steps": 7}),
    ],
)
def test_the_gradient_predicts_how_the_loss_changes(task, ticks, keywords):
    # With as many ticks of flight as are differentiated, the derivatives are exact.
    hz = 100 if isinstance(task, TrackConfig) else 50
    envs = DroneVectorEnv(
        24, task=task, policy_hz=hz, physics_hz=hz * ticks, controller_hz=hz * ticks, integrator="midpoint", **keywords
    )
    model = APG("MlpPolicy", envs, horizon=8, ticks=ticks, policy_kwargs={"log_std_init": 0.0}, seed=1)
    envs.reset(seed=5)
    random = np.random.default_rng(0)
    for _ in range(5):
        envs.step(random.normal(0.0, 0.1, envs.action_space.shape).astype(np.float32))
    start, first = envs.snapshot(), model.learner.parameters
    first += random.normal(0.0, 0.05, first.shape).astype(np.float32)
    config = _core.GradientConfig(horizon=8, ticks=ticks, learning_rate=0.0)

    def loss(parameters):
        envs.restore(start)
        model.learner.parameters = parameters
        return model.learner.learn_window(config, envs.batch).loss

    loss(first)
    gradient = model.learner.window_gradient().astype(float)
    for part in np.array_split(np.flatnonzero(gradient), 4):
        along = np.zeros_like(gradient)
        along[part] = gradient[part]
        square = along @ along
        shift = 1e-2 / np.sqrt(square)
        up, down = (loss((first + sign * shift * along).astype(np.float32)) for sign in (1, -1))
        assert (up - down) / (2 * shift) == pytest.approx(square, rel=0.03)


def blind(keywords, flown, seed=5):
    """Return the environments after these actions, and a model whose action is the same everywhere."""
    envs = DroneVectorEnv(6, task=HoverConfig(), policy_hz=50, control="body_rates", **keywords)
    model = APG("MlpPolicy", envs, seed=0)
    envs.reset(seed=seed)
    for action in flown:
        envs.step(np.tile(action, (6, 1)))
    parameters = np.zeros_like(model.learner.parameters)
    first = next(first for name, _, first in model.learner.layout if name == "action_net.bias")
    where = slice(first, first + 4)
    parameters[where] = np.float32([0.1, -0.05, 0.02, 0.03])
    model.learner.parameters = parameters
    return envs, model.learner, where


def test_commands_that_are_late_by_two_steps_are_those_of_two_steps_before():
    random, late, steps = np.random.default_rng(1), 2, 12
    sent = random.normal(0.0, 0.1, (5, 4)).astype(np.float32)
    flown = [sent[0]] * late + [*sent]  # the first one arrives at once
    config = {"gamma": 0.9, "learning_rate": 0.0, "ticks": 2}
    envs, learner, where = blind({"variations": flockstep.vary(action_delay_s=late / 50)}, sent)
    learner.learn_window(_core.GradientConfig(horizon=steps + late, **config), envs.batch)
    found, action = learner.window_gradient()[where], learner.parameters[where]
    envs, learner, where = blind({}, flown)
    learner.learn_window(_core.GradientConfig(horizon=steps, **config), envs.batch)
    shifted = learner.window_gradient()[where] * 0.9**late * steps
    effort = 0.005 * 2 * action * sum(0.9**t for t in range(late))  # of the steps that fly earlier commands
    assert found * (steps + late) == pytest.approx(shifted + effort, rel=1e-4, abs=1e-6)


def test_commands_that_are_not_late_have_the_usual_derivatives():
    gradients = []
    for variations in ([], flockstep.vary(action_delay_s=(0.0, 0.06))):
        envs = hover(variations=variations)
        model = APG("MlpPolicy", envs, policy_kwargs=POINT, seed=0)
        envs.reset(seed=3)
        if variations:
            is_delay = [name == "action_delay_s" for name in flockstep.parameter_names]
            envs.batch.set_params(np.where(is_delay, 0, envs.batch.params))
        model.learner.learn_window(_core.GradientConfig(), envs.batch)
        gradients.append(model.learner.window_gradient())
    np.testing.assert_allclose(gradients[1], gradients[0], atol=1e-5 * np.abs(gradients[0]).max())


def test_threads_and_repeats_give_the_same_bits():
    for keywords in ({}, {"variations": LATE}):
        several = [
            trained(threads, num_envs=150, num_threads=threads, **keywords).learner.parameters for threads in (1, 2, 1)
        ]
        assert np.array_equal(several[0], several[1])
        assert np.array_equal(several[0], several[2])


def test_ppo_goes_on_with_a_file(tmp_path):
    model = trained()
    model.save(tmp_path / "model")
    observation = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    again = PPO.load(
        tmp_path / "model", hover(autoreset_mode="same_step"), learning_rate=1e-4, n_steps=16, batch_size=320
    )
    expected = model.predict(observation, deterministic=True)[0]
    assert np.array_equal(again.predict(observation, deterministic=True)[0], expected)
    again.learn(320)
    loaded = APG.load(tmp_path / "model", hover())
    assert np.array_equal(loaded.predict(observation, deterministic=True)[0], expected)
    loaded.learn(640)


def test_callbacks_are_called_after_each_update():
    seen = []

    def count(local, _global):
        seen.append(local["self"].num_timesteps)
        return len(seen) < 3

    model = APG("MlpPolicy", hover(), horizon=16, policy_kwargs=POINT, seed=0)
    model.learn(100_000, count)
    assert seen == [320, 640, 960]
    assert {"train/loss", "train/gradient_norm"} <= {*model.logger.name_to_value}  # of the update that ended it


def test_without_a_derivative_is_refused_by_name():
    for keywords, field, *told in (
        ({"control": "position"}, "control", "rotor_thrusts", "position"),
        ({"drone": "f550"}, "drone", "6 rotors"),
        ({"observed": flockstep.ObservationConfig(history=2, past_actions=1)}, "observed", "history=2, past_actions=1"),
        (
            {"privileged": ["mass_scale"], "variations": flockstep.vary(mass_scale=(0.9, 1.1))},
            "privileged",
            "mass_scale",
        ),
        ({"frame_skip": 2}, "frame_skip", "got 2"),
    ):
        with refused(ValueError, field, *told):
            APG("MlpPolicy", hover(**keywords), seed=0)
    envs = hover()
    model = APG("MlpPolicy", envs, seed=0)
    with refused(ValueError, "frame_skip"):
        model.set_env(hover(frame_skip=2))
    assert model.env is envs
    with refused(ValueError, "horizon", 5_000_000):
        APG("MlpPolicy", hover(500), horizon=10_000)
    with refused(ValueError, "autoreset_mode", "disabled"):
        APG("MlpPolicy", hover(autoreset_mode="disabled"))
    with refused(ValueError, "env"):
        APG("MlpPolicy", gymnasium.make_vec("Pendulum-v1", 2))
    dodge = DroneVectorEnv(4, task=flockstep.DodgeConfig())
    with refused(ValueError, "task", "hover, track or race", "dodge"):
        APG("MlpPolicy", dodge)


@pytest.mark.parametrize(
    ("name", "value"), [("horizon", 0), ("ticks", 0), ("gamma", 1.5), ("max_grad_norm", 0), ("learning_rate", -1)]
)
def test_settings_out_of_range_are_refused(name, value):
    with refused(ValueError, name, value):
        APG("MlpPolicy", hover(), **{name: value}).learn(640)


def test_settings_of_ppo_are_refused():
    with pytest.raises(TypeError, match="n_epochs"):
        APG("MlpPolicy", hover(), n_epochs=3)


def test_a_policy_adapts_to_a_heavier_drone():
    live = runpy.run_path(str(ROOT / "examples" / "adapt_live.py"))["Live"]()
    errors = []
    for act in (lambda: None, lambda: [live.change("M") for _ in range(2)], live.adapt):
        act()
        errors.append(np.mean([live.step() for _ in range(300)][150:]))
    assert live.numbers["mass_scale"] == pytest.approx(1.21)
    assert errors[0] < 0.03
    assert errors[1] > 0.08
    assert errors[2] < 0.03
