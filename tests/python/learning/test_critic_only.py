"""Numbers of observations that only the critic of flockstep.PPO gets. Their gradients are compared in test_learner."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from messages import refused
from ppo_models import OPTIONS, SMALL, Still, assert_same, box, hover, make_learner, random_rollout
from test_ppo_files import edited

from flockstep import PPO, _core

# Most rollouts of these tests are smaller than a minibatch.
pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")


class Hidden(gymnasium.vector.VectorEnv):
    """One-step episodes whose reward is the last number of the observation, which the first two do not tell."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(self, shown=3):
        self.num_envs, self.shown = 64, shown
        self.single_observation_space, self.single_action_space = box(shown), box(1)
        self.random = np.random.default_rng(0)

    def reset(self, *, seed=None, options=None):
        self.numbers = self.random.normal(size=(self.num_envs, 3)).astype(np.float32)
        return self.numbers[:, : self.shown].copy(), {}

    def step(self, actions):
        reward, last = self.numbers[:, 2].copy(), self.numbers[:, : self.shown].copy()
        final = np.full(self.num_envs, None, dtype=object)
        final[:] = list(last)
        ended = np.ones(self.num_envs, bool)
        return self.reset()[0], reward, ended, ~ended, {"final_obs": final, "_final_obs": ended}


def test_the_critic_fits_values_that_the_actor_cannot_tell():
    losses = []
    for shown, critic_only in ((3, 1), (2, 0)):
        settings = {"n_steps": 16, "batch_size": 256, "n_epochs": 5, "learning_rate": 3e-3, "seed": 0}
        model = PPO("MlpPolicy", Hidden(shown), critic_only=critic_only, **settings).learn(20_000)
        losses.append(model.learner.update(_core.UpdateConfig(learning_rate=0.0, n_epochs=1)).value_loss)
    assert losses[0] < 0.05
    assert 0.8 < losses[1] < 1.2  # the variance of the rewards


@pytest.mark.parametrize(  # goal and blob take logarithms of ranges
    ("features", "normalizes"),
    [("flat", False), ("goal", False), ("blob", False), ("point", False), ("flat", True), ("point", True)],
)
def test_actions_do_not_depend_on_the_numbers_for_the_critic(features, normalizes):
    learner = make_learner(size=9, features=features, critic_only=4)
    learner.begin(_core.RolloutConfig(n_steps=1, normalize_observations=normalizes), 100)
    random = np.random.default_rng(0)
    observation = random.uniform(0.1, 1.0, size=(100, 9)).astype(np.float32)
    actions = learner.predict(observation)
    learner.act(0, observation)
    other = observation.copy()
    other[:, 5:] = random.normal(size=(100, 4))
    values = learner.values(observation)
    if normalizes:
        actions = learner.predict(observation)
        assert learner.observation_moments[0].shape == (9,)
    np.testing.assert_array_equal(learner.predict(other), actions)
    np.testing.assert_array_equal(learner.predict(observation[:, :5]), actions)
    assert (learner.values(other) != values).all()
    # Features are of the actor's part: a learner that has only this part acts the same.
    alone = make_learner(size=5, features=features)
    named = {name: (shape, first) for name, shape, first in alone.layout}
    parameters = alone.parameters
    for name, shape, first in learner.layout:
        if "value_net" not in name:
            count = int(np.prod(shape))
            assert named[name][0] == shape
            parameters[named[name][1] :][:count] = learner.parameters[first : first + count]
    alone.parameters = parameters
    if normalizes:
        mean, variance, count = learner.observation_moments
        alone.begin(_core.RolloutConfig(n_steps=1, normalize_observations=True), 1)
        alone.set_moments((mean[:5], variance[:5], count), learner.return_moments)
    np.testing.assert_array_equal(alone.predict(observation[:, :5]), actions)


def test_random_actions_are_those_of_whole_observations():
    observation = np.random.default_rng(0).normal(size=(70, 5)).astype(np.float32)
    whole, part = (make_learner(critic_only=2).sample(observation[:, :size]) for size in (5, 3))
    np.testing.assert_array_equal(whole, part)


@pytest.mark.parametrize("threads", [1, 2])
def test_steps_in_the_engine_are_those_of_arrays(threads):
    env = hover(70, threads=threads)
    learner, twin = (
        _core.Learner(_core.NetworkConfig(observation_size=16, action_size=4, critic_only=3), threads, 0) for _ in "12"
    )
    assert env.single_observation_space.shape == (16,)
    observation = env.reset(seed=0)[0]
    for each in (learner, twin):
        each.begin(_core.RolloutConfig(n_steps=3), 70)
    for t in range(3):
        action = twin.act(t, observation)
        learner.fly(t, env.batch)
        batch = env.batch
        twin.record(t, batch.reward, batch.terminated, batch.truncated, learner.read_observation(batch))
        np.testing.assert_array_equal(learner.actions[t], action)
        np.testing.assert_array_equal(learner.rollout_values[t], twin.values(observation))
        observation = learner.read_observation(batch)


def test_threads_do_not_change_the_bits():
    results = []
    for threads in (1, 3):
        learner = make_learner(threads, size=20, critic_only=7)
        random_rollout(learner, rows=130, normalize_observations=True)
        learner.update(_core.UpdateConfig(batch_size=1000, n_epochs=2))
        results.append(learner.parameters)
    np.testing.assert_array_equal(*results)


# --- observations without the numbers


def test_observations_of_the_actors_part():
    model = PPO("MlpPolicy", Still(spaces.Box(-1, 1, (5,), np.float32)), critic_only=2, **OPTIONS, **SMALL).learn(16)
    observation = np.random.default_rng(0).uniform(-1, 1, (7, 5))
    whole = model.predict(observation, deterministic=True)[0]
    np.testing.assert_array_equal(model.predict(observation[:, :3], deterministic=True)[0], whole)
    np.testing.assert_array_equal(model.predict(observation[3, :3], deterministic=True)[0], whole[3])
    assert model.predict(np.zeros((0, 3)))[0].shape == (0, 2)
    for shape in ((4,), (7, 4), (2,), (1, 7, 3), ()):
        with refused(ValueError, "observation", shape):
            model.predict(np.zeros(shape))
    with refused(ValueError, "observation", (7, 3)):
        model.learner.values(observation[:, :3])


def test_dicts_of_the_actors_part():
    numbers = spaces.Box(-1, 1, (3,), np.float32)
    space = spaces.Dict({"a": numbers, "b": numbers, "c": spaces.Box(-1, 1, (2, 2), np.float32)})
    random = np.random.default_rng(0)
    observation = {name: random.uniform(-1, 1, (6, *part.shape)) for name, part in space.spaces.items()}
    for critic_only, parts in (
        (4, {"a": np.s_[:], "b": np.s_[:]}),
        (5, {"a": np.s_[:], "b": np.s_[:, :2]}),
        (7, {"a": np.s_[:]}),
    ):
        model = PPO("MultiInputPolicy", Still(space), critic_only=critic_only, **SMALL)
        whole = model.predict(observation, deterministic=True)[0]
        part = {name: observation[name][where] for name, where in parts.items()}
        np.testing.assert_array_equal(model.predict(part, deterministic=True)[0], whole)
        single = {name: values[2] for name, values in part.items()}
        np.testing.assert_array_equal(model.predict(single, deterministic=True)[0], whole[2])
        with refused(ValueError, "observation", "a, b, c", "b"):
            model.predict({"b": observation["b"]})


# --- files, conversions, refusals


def test_a_file_keeps_it_and_an_older_one_has_none(tmp_path):
    model = PPO("MlpPolicy", Still(), critic_only=1, **OPTIONS, **SMALL).learn(16)
    model.save(tmp_path / "model")
    loaded = PPO.load(tmp_path / "model")
    assert (loaded.critic_only, loaded.learner.config.critic_only) == (1, 1)
    assert_same(model, loaded)
    observation = np.ones((2, 2), np.float32)
    np.testing.assert_array_equal(loaded.predict(observation)[0], model.predict(observation)[0])
    again = PPO.load(tmp_path / "model", Still()).learn(16, reset_num_timesteps=False)
    assert again.critic_only == 1

    PPO("MlpPolicy", Still(), **SMALL).save(tmp_path / "older")
    older = edited((tmp_path / "older.zip").read_bytes(), lambda state: state["network"].pop("critic_only"))
    (tmp_path / "older.zip").write_bytes(older)
    assert PPO.load(tmp_path / "older").critic_only == 0
    for wrong in (3, -1, 0, 1.5, None):
        changed = edited(
            (tmp_path / "model.zip").read_bytes(),
            lambda state, value=wrong: state["network"].update(critic_only=value),
        )
        (tmp_path / "wrong.zip").write_bytes(changed)
        with refused(ValueError, "expected a model that PPO.save wrote"):
            PPO.load(tmp_path / "wrong")
    with refused(TypeError, "load", "critic_only"):
        PPO.load(tmp_path / "model", critic_only=0)


def test_stable_baselines3_has_no_such_networks():
    with refused(ValueError, "to_sb3", "critic_only=0", 1):
        PPO("MlpPolicy", Still(), critic_only=1, **SMALL).to_sb3()


@pytest.mark.parametrize(
    ("critic_only", "features", "said"),
    [
        (3, "FlattenExtractor", (2, 3)),
        (1, "GoalFeatures", (0, 1)),
        (2, "BlobFeatures", (1, 2)),
        (-1, "FlattenExtractor", (-1,)),
        (4097, "FlattenExtractor", (4096, 4097)),
    ],
)
def test_it_leaves_the_actor_what_it_needs(critic_only, features, said):
    with refused(ValueError, "critic_only", *said):
        PPO(
            "MlpPolicy", Still(), critic_only=critic_only, policy_kwargs={"features_extractor_class": features}, **SMALL
        )


def test_it_is_an_integer():
    with refused(TypeError, "critic_only"):
        PPO("MlpPolicy", Still(), critic_only=1.5, **SMALL)
