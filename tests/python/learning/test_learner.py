"""The learner against Stable-Baselines3's PPO, a NumPy twin of its estimates, and finite differences in double."""

import os
import threading
import time
from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from messages import refused
from scripted_episodes import ScriptedEpisodes
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import flockstep
from flockstep import _core
from flockstep.learning.sources import EngineSource, source_of

STEPS, ROWS = 48, 6


@pytest.fixture(autouse=True, scope="module")
def _one_thread_of_torch():
    """Threads of PyTorch that wait for each other are slow on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


TOLERANCE = 1e-5  # relative to the largest number that is compared


class Still(gymnasium.Env):
    """An environment of given spaces that is never stepped."""

    def __init__(self, observation_space, action_space):
        self.observation_space, self.action_space = observation_space, action_space

    def reset(self, **_):
        return self.observation_space.sample(), {}


def box(*shape):
    return spaces.Box(-10, 10, shape, np.float32)


def make_pair(
    action_space=None, layers=((64, 64), (64, 64)), activation="tanh", observation_size=7, threads=1, **settings
):
    """Return SB3's PPO and a learner with the same parameters."""
    action_space = action_space or box(3)
    envs = DummyVecEnv([lambda: Still(box(observation_size), action_space)] * ROWS)
    activations = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
    torch.manual_seed(5)
    theirs = PPO(
        "MlpPolicy",
        envs,
        n_steps=STEPS,
        batch_size=STEPS,
        device="cpu",
        policy_kwargs={
            "net_arch": {"pi": list(layers[0]), "vf": list(layers[1])},
            "activation_fn": activations[activation],
        },
        **settings,
    )
    theirs.set_logger(configure(format_strings=[]))
    is_discrete = isinstance(action_space, spaces.Discrete)
    config = _core.NetworkConfig(
        observation_size=observation_size,
        action_size=action_space.n if is_discrete else action_space.shape[0],
        is_discrete=is_discrete,
        actor_layers=list(layers[0]),
        critic_layers=list(layers[1]),
        activation=activation,
    )
    ours = _core.Learner(config, threads, 0)
    with torch.no_grad():  # weights of a policy that has learned
        for parameter in theirs.policy.parameters():
            parameter += 0.1 * torch.randn(parameter.shape)
    ours.parameters = plain(theirs)
    return theirs, ours


def plain(model):
    """Return the parameters of a model of SB3 as one vector."""
    return np.concatenate([value.detach().numpy().ravel() for value in model.policy.state_dict().values()])


def collect(theirs, ours, seed=0, gamma=0.97, gae_lambda=0.9):
    """Let both collect the same random rollout, in which ours acts."""
    random = np.random.default_rng(seed)
    ours.begin(_core.RolloutConfig(n_steps=STEPS, gamma=gamma, gae_lambda=gae_lambda), ROWS)
    buffer = theirs.rollout_buffer
    buffer.gamma, buffer.gae_lambda = gamma, gae_lambda
    buffer.reset()
    size = ours.config.observation_size
    starts = np.ones(ROWS, bool)
    for t in range(STEPS):
        observation = random.normal(size=(ROWS, size)).astype(np.float32)
        action = ours.act(t, observation).copy()
        with torch.no_grad():
            value, log_prob, _ = theirs.policy.evaluate_actions(torch.as_tensor(observation), torch.as_tensor(action))
        reward = random.normal(size=ROWS).astype(np.float32)
        terminated, truncated = random.random((2, ROWS)) < 0.05
        final = random.normal(size=(ROWS, size)).astype(np.float32)
        ours.record(t, reward, terminated, truncated, final)
        bootstrapped = reward.copy()
        for row in np.flatnonzero(truncated & ~terminated):
            with torch.no_grad():
                bootstrapped[row] += gamma * theirs.policy.predict_values(torch.as_tensor(final[row : row + 1]))[0, 0]
        buffer.add(observation, action.reshape(ROWS, -1), bootstrapped, starts, value, log_prob)
        starts = terminated | truncated
    last = random.normal(size=(ROWS, size)).astype(np.float32)
    ours.finish(last)
    with torch.no_grad():
        buffer.compute_returns_and_advantage(theirs.policy.predict_values(torch.as_tensor(last)), starts)


def same_order(epochs, seed):
    """Return the order in which SB3 takes the steps of the next update, as indices of the learner."""
    np.random.seed(seed)  # noqa: NPY002 # which SB3 draws from
    flat = np.concatenate([np.random.permutation(STEPS * ROWS) for _ in range(epochs)])  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    return flat % STEPS * ROWS + flat // STEPS


def close(ours, theirs, tolerance=TOLERANCE):
    theirs = np.asarray(theirs)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * max(1.0, np.abs(theirs).max()))


def test_rollouts_equal_those_of_sb3():
    theirs, ours = make_pair()
    collect(theirs, ours)
    buffer = theirs.rollout_buffer
    close(ours.rollout_values, buffer.values)
    close(ours.log_probs, buffer.log_probs)
    close(ours.rewards, buffer.rewards)
    close(ours.advantages, buffer.advantages)
    close(ours.returns, buffer.returns)


OPTIONS = [
    {},
    {"batch_size": STEPS * ROWS},
    {"batch_size": 100},  # the last minibatch is smaller
    {"clip_range_vf": 0.1},
    {"normalize_advantage": False},
    {"ent_coef": 0.02},
    {"vf_coef": 1.5},
    {"max_grad_norm": 0.05},
    {"max_grad_norm": 1e3},
    {"clip_range": 0.02},
    {"target_kl": 0.003},
    {"learning_rate": 1e-2},
]


def constant(value, _):
    return value


def compare_updates(theirs, ours, updates=1, **options):
    epochs = 3
    settings = {"batch_size": 64, "learning_rate": 1e-3, "clip_range": 0.2} | options
    theirs.n_epochs = epochs
    for name, value in settings.items():
        setattr(theirs, name, partial(constant, value) if "clip_range" in name else value)
    theirs.lr_schedule = lambda _: settings["learning_rate"]
    for update in range(updates):
        collect(theirs, ours, seed=update)
        order = same_order(epochs, seed=update)
        theirs.train()
        report = ours.update(_core.UpdateConfig(n_epochs=epochs, **settings), order)
        expected = theirs.logger.name_to_value
        assert report.is_finite
        for name, key in (
            ("policy_gradient_loss", "policy_gradient_loss"),
            ("value_loss", "value_loss"),
            ("entropy_loss", "entropy_loss"),
            ("clip_fraction", "clip_fraction"),
            ("approx_kl", "approx_kl"),
            ("loss", "loss"),
            ("explained_variance", "explained_variance"),
        ):
            close(getattr(report, name), expected[f"train/{key}"], 3e-5)
        if "train/std" in expected:
            close(report.std, expected["train/std"])
        close(ours.parameters, plain(theirs))
    return report


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("action_space", [box(3), spaces.Discrete(5)], ids=["gaussian", "categorical"])
def test_an_update_equals_that_of_sb3(action_space, options):
    theirs, ours = make_pair(action_space)
    before = ours.parameters
    report = compare_updates(theirs, ours, **options)
    assert np.abs(ours.parameters - before).max() > 1e-3
    assert report.stopped_early == ("target_kl" in options)


@pytest.mark.parametrize(
    ("layers", "activation"),
    [(((), ()), "tanh"), (((5,), (17, 33, 3)), "relu"), (((64, 64), (64, 64)), "relu"), (((100, 16, 7), ()), "tanh")],
)
def test_networks_of_any_shape(layers, activation):
    theirs, ours = make_pair(layers=layers, activation=activation, observation_size=19)
    compare_updates(theirs, ours)


def test_ten_updates_equal_those_of_sb3():
    theirs, ours = make_pair()
    compare_updates(theirs, ours, updates=10)


# --- gradients


def numpy_loss(learner, parameters, inputs, minibatch, config):
    """Return the loss of a minibatch in double, as the paper and Stable-Baselines3 define it."""
    named = {
        name: parameters[first : first + int(np.prod(shape))].reshape(shape) for name, shape, first in learner.layout
    }
    activation = np.tanh if learner.config.activation == "tanh" else partial(np.maximum, 0)

    def network(hidden, last):
        values = inputs[minibatch]
        for i in range(0, 2 * len(learner.config.actor_layers), 2):
            values = activation(values @ named[f"{hidden}.{i}.weight"].T + named[f"{hidden}.{i}.bias"])
        return values @ named[f"{last}.weight"].T + named[f"{last}.bias"]

    def of(array):
        return array.astype(float).reshape(STEPS * ROWS, -1)[minibatch]

    outputs, action = network("mlp_extractor.policy_net", "action_net"), of(learner.actions)
    if learner.config.is_discrete:
        log_softmax = outputs - np.log(np.exp(outputs).sum(axis=1, keepdims=True))
        log_prob = np.take_along_axis(log_softmax, action.astype(int), axis=1)[:, 0]
        entropy = -(np.exp(log_softmax) * log_softmax).sum(axis=1).mean()
    else:
        log_std = named["log_std"]
        normal = (action - outputs) / np.exp(log_std)
        log_prob = (-0.5 * normal**2 - log_std - 0.5 * np.log(2 * np.pi)).sum(axis=1)
        entropy = (log_std + 0.5 * np.log(2 * np.pi * np.e)).sum()
    advantage = of(learner.advantages)[:, 0]
    if config.normalize_advantage:
        advantage = (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)
    ratio = np.exp(log_prob - of(learner.log_probs)[:, 0])
    clipped = np.clip(ratio, 1 - config.clip_range, 1 + config.clip_range)
    policy = -np.minimum(ratio * advantage, clipped * advantage).mean()
    value, old = network("mlp_extractor.value_net", "value_net")[:, 0], of(learner.rollout_values)[:, 0]
    if config.clip_range_vf is not None:
        value = old + np.clip(value - old, -config.clip_range_vf, config.clip_range_vf)
    errors = value - of(learner.returns)[:, 0]
    return policy - config.ent_coef * entropy + config.vf_coef * (errors**2).mean()


def random_rollout(learner, steps=STEPS, rows=ROWS, seed=0, skips=0.0, **settings):
    """Let a learner collect random observations and rewards; return all observations and what it recorded."""
    random = np.random.default_rng(seed)
    size = learner.config.observation_size
    learner.begin(_core.RolloutConfig(n_steps=steps, **settings), rows)
    recorded = []
    for t in range(steps):
        observation, final = random.normal(size=(2, rows, size)).astype(np.float32)
        learner.act(t, observation)
        reward = random.normal(size=rows).astype(np.float32)
        terminated, truncated = random.random((2, rows)) < 0.1
        skipped = random.random(rows) < skips
        learner.record(t, reward, terminated, truncated, final, skipped)
        recorded.append((observation, reward, terminated, truncated, final, skipped))
    last = random.normal(size=(rows, size)).astype(np.float32)
    learner.finish(last)
    return [np.stack(values) for values in zip(*recorded, strict=True)] + [last]


def make_learner(threads=1, is_discrete=False, seed=3, size=5, **config):
    return _core.Learner(
        _core.NetworkConfig(observation_size=size, action_size=3, is_discrete=is_discrete, **config), threads, seed
    )


@pytest.mark.parametrize("is_discrete", [False, True], ids=["gaussian", "categorical"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"ent_coef": 0.3},
        {"clip_range_vf": 0.1, "vf_coef": 1.0},
        {"normalize_advantage": False, "clip_range": 0.05},
        {"vf_coef": 0.0, "ent_coef": 1.0},
    ],
    ids=str,
)
def test_gradients_are_those_of_finite_differences(is_discrete, options):
    learner = make_learner(is_discrete=is_discrete, actor_layers=[9, 6], critic_layers=[9, 6])
    observation = random_rollout(learner)[0]
    random = np.random.default_rng(1)
    moved = learner.parameters + 0.1 * random.normal(size=learner.parameters.size).astype(np.float32)
    learner.parameters = moved
    minibatch = random.choice(STEPS * ROWS, 150, replace=False)
    config = _core.UpdateConfig(**options)
    got = learner.gradient(config, minibatch)
    inputs = observation.reshape(STEPS * ROWS, -1).astype(float)

    def loss(index, step):
        changed = moved.astype(float)
        changed[index] += step
        return numpy_loss(learner, changed, inputs, minibatch, config)

    expected = np.array([(loss(i, 1e-6) - loss(i, -1e-6)) / 2e-6 for i in range(moved.size)])
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    if "clip_range" in options:  # some steps are clipped, others not
        report = learner.update(_core.UpdateConfig(n_epochs=1, learning_rate=0.0, batch_size=STEPS * ROWS, **options))
        assert 0.1 < report.clip_fraction < 0.95


# --- advantages


@pytest.mark.parametrize("skips", [0.0, 0.2])
def test_advantages_equal_those_of_numpy(skips):
    learner = make_learner()
    gamma, gae_lambda = 0.95, 0.8
    _, reward, terminated, truncated, final, skipped, last = random_rollout(
        learner, skips=skips, gamma=gamma, gae_lambda=gae_lambda
    )
    values = learner.rollout_values.astype(float)
    after = np.concatenate([values[1:], learner.values(last)[None]])
    final_values = learner.values(final.reshape(-1, final.shape[-1])).reshape(STEPS, ROWS)
    done = terminated | truncated
    # The value of the next observation: 0 after the end, that of the last observation where the time was up.
    after = np.where(done, np.where(truncated & ~terminated, final_values, 0.0), after)
    expected = np.zeros((STEPS + 1, ROWS))
    for t in reversed(range(STEPS)):
        goes_on = ~done[t] & ~skipped[t]
        error = reward[t] + gamma * np.where(skipped[t], 0.0, after[t]) - values[t]
        expected[t] = error + gamma * gae_lambda * goes_on * expected[t + 1]
    counts = ~skipped
    assert (done & counts).sum() > 20
    close(learner.advantages[counts], expected[:-1][counts])
    close(learner.returns[counts], (expected[:-1] + values)[counts])


def by_transition(learner, source, steps, gamma=0.9):
    """Collect a rollout; return the advantages of the episodes that ended in it by row, episode and step of it."""
    is_next_step = source.env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    learner.begin(_core.RolloutConfig(n_steps=steps, gamma=gamma), source.rows)
    source.reset(7)
    episode, age = np.zeros((2, source.rows), int)
    over = np.zeros(source.rows, bool)
    keys, ended = {}, set()
    for t in range(steps):
        done = source.step(learner, t, True).dones
        for row in range(source.rows):
            if not over[row]:
                keys[t, row] = (row, episode[row], age[row])
            age[row] = 0 if over[row] or done[row] else age[row] + 1
            if done[row]:
                ended.add((row, episode[row]))
                episode[row] += 1
        over = done if is_next_step else over
    learner.finish(source.observation(learner))
    advantages = learner.advantages
    return {key: advantages[at] for at, key in keys.items() if key[:2] in ended}


def compare_modes(results):
    shared = set.intersection(*(set(result) for result in results))
    assert len({key[:2] for key in shared}) >= 6
    assert max(key[2] for key in shared) >= 4
    for key in shared:
        assert len({float(result[key]) for result in results}) == 1, key


@pytest.mark.parametrize("as_dict", [False, True])
def test_autoreset_modes_give_the_same_advantages(as_dict):
    def advantages(mode):
        learner = _core.Learner(_core.NetworkConfig(observation_size=5 if as_dict else 3, action_size=2), 1, 0)
        return by_transition(learner, source_of(ScriptedEpisodes(3, mode, as_dict)), 30)

    compare_modes([advantages(mode) for mode in ("next_step", "same_step", "disabled")])


@pytest.mark.parametrize("task", [flockstep.HoverConfig(), None], ids=["numbers", "choices"])
def test_autoreset_modes_of_an_engine_task_give_the_same_advantages(task):
    """Actions are not random here, because the modes draw them at different steps."""

    def advantages(mode):
        env = flockstep.DroneVectorEnv(4, task=task, autoreset_mode=mode, max_episode_steps=9, num_threads=1)
        source = source_of(env)
        assert isinstance(source, EngineSource)
        space = source.action_space
        is_discrete = isinstance(space, spaces.Discrete)
        config = _core.NetworkConfig(
            observation_size=source.observation_space.shape[0],
            action_size=space.n if is_discrete else space.shape[0],
            is_discrete=is_discrete,
        )
        learner = _core.Learner(config, 1, 0)
        parameters = learner.parameters
        if is_discrete:
            parameters[-65 - space.n : -65] = -1e4  # the biases of all choices but one
            parameters[-65 - space.n] = 0
        else:
            parameters[: config.action_size] = -40
        learner.parameters = parameters
        return by_transition(learner, source, 40)

    compare_modes([advantages(mode) for mode in ("next_step", "same_step", "disabled")])


# --- the same bits


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
@pytest.mark.parametrize("task", [flockstep.HoverConfig(), None], ids=["numbers", "choices"])
def test_flying_equals_acting_stepping_and_recording(mode, task):
    def make():
        env = flockstep.DroneVectorEnv(70, task=task, autoreset_mode=mode, max_episode_steps=7, num_threads=2)
        env.reset(seed=5)
        space = env.single_action_space
        is_discrete = isinstance(space, spaces.Discrete)
        config = _core.NetworkConfig(
            observation_size=env.single_observation_space.shape[0],
            action_size=space.n if is_discrete else space.shape[0],
            is_discrete=is_discrete,
        )
        learner = _core.Learner(config, 2, 1)
        if not is_discrete:
            parameters = learner.parameters
            parameters[: config.action_size] = 0.5  # many actions beyond the bounds
            learner.parameters = parameters
        rollout = _core.RolloutConfig(n_steps=20, normalize_observations=True, normalize_rewards=True)
        learner.begin(rollout, 70)
        return env, learner

    env, flown = make()
    for t in range(20):
        flown.fly(t, env.batch, 0.5)
    flown.finish(flown.read_observation(env.batch))
    env, stepped = make()
    over = np.zeros(70, bool)
    for t in range(20):
        action = stepped.act(t, stepped.read_observation(env.batch), over)
        if stepped.config.is_discrete:
            env.batch.step(action.astype(np.int64))
        else:
            env.batch.step(np.clip(action, -1, 1))
        batch = env.batch
        stepped.record(
            t, batch.reward * np.float32(0.5), batch.terminated, batch.truncated, batch.final_observation, over
        )
        if mode == "next_step":
            over = batch.terminated | batch.truncated
    stepped.finish(stepped.read_observation(env.batch))
    assert flown.rewards.min() < flown.rewards.max()
    config = _core.UpdateConfig(batch_size=300)
    flown.update(config)
    stepped.update(config)
    for name in ("actions", "log_probs", "rollout_values", "rewards", "advantages", "returns", "parameters"):
        np.testing.assert_array_equal(getattr(flown, name), getattr(stepped, name), err_msg=name)
    np.testing.assert_array_equal(flown.observation_moments[0], stepped.observation_moments[0])
    np.testing.assert_array_equal(flown.return_moments[1], stepped.return_moments[1])


@pytest.mark.parametrize("is_discrete", [False, True], ids=["gaussian", "categorical"])
def test_threads_do_not_change_the_bits(is_discrete):
    def result(threads):
        learner = make_learner(threads, is_discrete)
        assert learner.num_threads == threads
        observation = random_rollout(learner, 20, 150, normalize_observations=True, normalize_rewards=True)[0]
        learner.update(_core.UpdateConfig(batch_size=1100, n_epochs=3))
        sampled = learner.sample(observation[0])
        return [learner.parameters, learner.advantages, learner.actions, learner.predict(observation[0]), sampled]

    one = result(1)
    for threads in (2, 7):
        for expected, got in zip(one, result(threads), strict=True):
            np.testing.assert_array_equal(got, expected)


# --- running moments


class Played(gymnasium.Env):
    """Gives observations and rewards that were drawn before."""

    observation_space, action_space = box(5), box(3)

    def __init__(self, observations, rewards, ends):
        self.observations, self.rewards, self.ends, self.t = observations, rewards, ends, -1

    def reset(self, **_):
        return self.observations[self.t + 1], {}

    def step(self, _):
        self.t += 1
        return self.observations[self.t + 1], self.rewards[self.t], bool(self.ends[self.t]), False, {}


def test_running_moments_equal_those_of_vec_normalize():
    random = np.random.default_rng(2)
    steps, rollouts = 16, 4
    total = steps * rollouts
    observations = (random.normal(size=(ROWS, total + 1, 5)) * [1, 10, 0.1, 3, 1] + [0, 5, 0, 0, 1]).astype(np.float32)
    rewards = random.normal(2, 3, size=(ROWS, total)).astype(np.float32)
    ends = random.random((ROWS, total)) < 0.1
    played = [partial(Played, observations[row], rewards[row], ends[row]) for row in range(ROWS)]
    theirs = VecNormalize(DummyVecEnv(played), gamma=0.9)
    ours = make_learner(2)
    theirs.reset()
    for rollout in range(rollouts):
        settings = {"gamma": 0.9, "normalize_observations": True, "normalize_rewards": True}
        ours.begin(_core.RolloutConfig(n_steps=steps, **settings), ROWS)
        for t in range(steps):
            at = rollout * steps + t
            ours.act(t, observations[:, at])
            mean, variance, count = ours.observation_moments
            np.testing.assert_allclose(mean, theirs.obs_rms.mean, rtol=1e-6, atol=1e-7)
            np.testing.assert_allclose(variance, theirs.obs_rms.var, rtol=1e-6)
            assert count == pytest.approx(theirs.obs_rms.count, abs=1e-9)
            _, reward, done, _ = theirs.step(np.zeros((ROWS, 3)))
            ours.record(t, rewards[:, at], done, np.zeros(ROWS, bool))
            np.testing.assert_allclose(ours.rewards[t], reward, rtol=1e-5)
            np.testing.assert_allclose(ours.discounted_returns, theirs.returns, rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(ours.return_moments[1], theirs.ret_rms.var, rtol=1e-6)
        ours.finish(observations[:, (rollout + 1) * steps])
    assert ends.sum() > 20
    # A learner without normalisation computes the same values from normalised observations.
    plain_one = make_learner()
    raw = observations[:, 3]
    mean, variance, _ = ours.observation_moments
    normal = np.clip((raw - mean) / np.sqrt(variance + 1e-8), -10, 10).astype(np.float32)
    np.testing.assert_allclose(ours.values(raw), plain_one.values(normal), rtol=1e-5, atol=1e-6)


def test_skipped_steps_do_not_count_for_moments_and_updates():
    with_skips, without = make_learner(), make_learner()
    settings = {"n_steps": 2, "normalize_rewards": True}
    observation, reward = np.ones((3, 5), np.float32), np.float32([1, 2, 3])
    no = np.zeros(3, bool)
    for learner in (with_skips, without):
        learner.begin(_core.RolloutConfig(**settings), 3)
    for t, skipped in ((0, no), (1, ~no)):
        with_skips.act(t, observation)
        with_skips.record(t, reward, no, no, skipped=skipped)
    without.act(0, observation)
    without.record(0, reward, no, no)
    assert with_skips.return_moments[1:] == without.return_moments[1:]
    with_skips.finish(observation)
    before = with_skips.parameters
    assert with_skips.update(_core.UpdateConfig(batch_size=2, n_epochs=1)).epochs == 1
    assert with_skips.adam[2] == 2  # minibatches of the three steps that count
    assert (with_skips.parameters != before).any()


# --- refusals


def test_bad_numbers_are_refused_and_change_nothing():
    learner = make_learner()
    learner.begin(_core.RolloutConfig(n_steps=2, normalize_observations=True, normalize_rewards=True), 3)
    good, no = np.ones((3, 5), np.float32), np.zeros(3, bool)
    learner.act(0, good)
    state = learner.parameters, *learner.observation_moments, *learner.return_moments, learner.discounted_returns
    for bad in (np.nan, np.inf, -np.inf):
        wrong = good.copy()
        wrong[2, 1] = bad
        for call in (learner.predict, learner.sample, learner.values, lambda observation: learner.act(0, observation)):
            with refused(FloatingPointError, "observation", "in row 2"):
                call(wrong)
        with refused(FloatingPointError, "reward", "in row 1"):
            learner.record(0, np.float32([0, bad, 0]), no, no)
        with refused(FloatingPointError, "final_observation"):
            learner.record(0, np.zeros(3), no, ~no, wrong)
    after = learner.parameters, *learner.observation_moments, *learner.return_moments, learner.discounted_returns
    for expected, got in zip(state, after, strict=True):
        np.testing.assert_array_equal(got, expected)


def test_actions_that_are_not_finite_are_refused():
    learner = make_learner()
    parameters = learner.parameters
    parameters[:3] = 200  # standard deviations beyond float32
    learner.parameters = parameters
    learner.begin(_core.RolloutConfig(n_steps=2), 2)
    with refused(FloatingPointError, "action"):
        learner.act(0, np.ones((2, 5)))
    with refused(FloatingPointError, "action"):
        learner.sample(np.ones((2, 5)))
    env = flockstep.DroneVectorEnv(2, task=flockstep.HoverConfig())
    env.reset(seed=0)
    flying = _core.Learner(_core.NetworkConfig(observation_size=16, action_size=4), 1, 0)
    parameters = flying.parameters
    parameters[:4] = 200
    flying.parameters = parameters
    flying.begin(_core.RolloutConfig(n_steps=2), 2)
    with refused(FloatingPointError, "action"):
        flying.fly(0, env.batch)
    env.step(np.zeros((2, 4)))  # which still flies


def test_wrong_shapes_and_orders_of_calls_are_refused():
    learner = make_learner()
    good, no = np.ones((3, 5), np.float32), np.zeros(3, bool)
    refused = partial(pytest.raises, (ValueError, TypeError))
    with refused(match="finish"):
        learner.finish(np.ones((0, 5)))
    with refused(match="update"):
        learner.update(_core.UpdateConfig())
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    for wrong in (
        np.ones((3, 4)),
        np.ones((2, 5)),
        np.ones(5),
        np.ones((3, 5, 1)),
        "text",
        None,
        np.ones((3, 5), object),
    ):
        with refused(match="observation"):
            learner.act(0, wrong)
    with refused(match="t: expected step 0, got 1"):
        learner.act(1, good)
    for skipped in (np.zeros(2, bool), np.zeros(3), "no"):
        with refused(match="skipped"):
            learner.act(0, good, skipped)
    learner.act(0, good)
    for wrong in ({"reward": np.zeros(2)}, {"terminated": np.zeros(3)}, {"truncated": np.zeros(4, bool)}):
        with refused(match=next(iter(wrong))):
            learner.record(0, **({"reward": np.zeros(3), "terminated": no, "truncated": no} | wrong))
    with refused(match="final_observation"):
        learner.record(0, np.zeros(3), no, ~no)
    learner.record(0, np.zeros(3), no, no)
    with refused(match="finish"):
        learner.finish(good)
    learner.act(1, good)
    learner.record(1, np.zeros(3), no, no)
    learner.finish(good)
    with refused(match="discounted_returns: expected 3 numbers, got 2"):
        learner.discounted_returns = [0.0, 1.0]
    for order in ([6], [-1], [0] * 7):
        with refused(match="order"):
            learner.update(_core.UpdateConfig(n_epochs=2), order)
    for minibatch in ([], [6], [-1]):
        with refused(match="minibatch"):
            learner.gradient(_core.UpdateConfig(), minibatch)
    for parameters in (np.zeros(3), np.full(learner.parameters.size, np.nan)):
        with refused(match="parameters"):
            learner.parameters = parameters
    batch = flockstep.Batch("playground/train-1", 3)
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    with refused(match="a batch with a task"):
        learner.fly(0, batch)
    for task, expected in ((flockstep.HoverConfig(), "observations of 5"), (None, "of 5")):
        env = flockstep.DroneVectorEnv(3, task=task)
        env.reset(seed=0)
        with refused(match=expected):
            learner.fly(0, env.batch)
        with refused(match=expected):
            learner.read_observation(env.batch)


def test_absurd_sizes_are_refused():
    with pytest.raises(ValueError, match="at most 16777216 parameters"):
        make_learner(actor_layers=[4096] * 1000)
    learner = make_learner()
    with refused(ValueError, "n_steps"):
        learner.begin(_core.RolloutConfig(n_steps=1 << 24), 1 << 24)
    assert learner.rows == 0
    with refused(ValueError, "batch_size"):
        make_learner().update(_core.UpdateConfig(batch_size=1))


def test_too_little_memory_leaves_no_rollout():
    learner = make_learner(size=65536)
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    with pytest.raises(MemoryError):
        learner.begin(_core.RolloutConfig(n_steps=1 << 24), 16)
    assert learner.rows == learner.advantages.size == 0
    with refused(ValueError, "observation"):
        learner.act(0, np.zeros((16, 65536), np.float32))


def test_an_update_needs_a_finished_rollout():
    learner = make_learner()
    random_rollout(learner)
    learner.update(_core.UpdateConfig())
    learner.update(_core.UpdateConfig())  # again, as with Stable-Baselines3
    steps, rows = 2, 3
    learner.begin(_core.RolloutConfig(n_steps=steps), rows)
    size, no = learner.config.observation_size, np.zeros(rows, bool)
    for t in range(steps):
        learner.act(t, np.zeros((rows, size), np.float32))
        learner.record(t, np.zeros(rows, np.float32), no, no)
    with refused(FloatingPointError, "observation"):
        learner.finish(np.full((rows, size), np.nan, np.float32))
    with refused(ValueError, "update"):
        learner.update(_core.UpdateConfig())


def test_arrays_of_a_rollout_outlive_it():
    learner = make_learner()
    assert learner.advantages.size == learner.actions.size == 0
    random_rollout(learner)
    kept = {name: getattr(learner, name) for name in ("actions", "advantages", "log_probs")}
    copies = {name: array.copy() for name, array in kept.items()}
    random_rollout(learner, steps=500, rows=64, seed=9)
    for name, array in kept.items():
        np.testing.assert_array_equal(array, copies[name])


def test_a_second_thread_is_refused():
    learner = make_learner(actor_layers=[512, 512], critic_layers=[512, 512])
    random_rollout(learner, 8, 256)

    def update():
        while True:
            try:
                return learner.update(_core.UpdateConfig(batch_size=2048, n_epochs=4))
            except RuntimeError:  # the other thread was first
                pass

    thread = threading.Thread(target=update)
    thread.start()
    refusal = None
    while refusal is None and thread.is_alive():
        try:
            learner.predict(np.ones((1, 5)))  # harmless before and after the update
        except RuntimeError as error:
            refusal = str(error)
        time.sleep(0.001)
    assert refusal == "this Learner is in use by another thread: one call at a time"
    for call in (
        lambda: learner.parameters,
        lambda: learner.advantages,
        lambda: learner.begin(_core.RolloutConfig(), 1),
    ):
        with pytest.raises(RuntimeError, match="in use by another thread"):
            call()
    assert thread.is_alive()
    thread.join()
    learner.predict(np.ones((1, 5)))


def test_a_forked_child_is_refused():
    learner = make_learner()
    child = os.fork()
    if child == 0:
        try:
            learner.predict(np.ones((1, 5)))
        except RuntimeError as error:
            os._exit(0 if "does not survive fork" in str(error) else 2)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
