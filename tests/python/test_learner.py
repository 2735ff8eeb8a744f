"""The learner against Stable-Baselines3's PPO, a NumPy twin of its estimates, and finite differences in double."""

from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv

from flockstep import _core

STEPS, ROWS = 48, 6
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
