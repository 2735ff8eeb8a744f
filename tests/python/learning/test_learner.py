"""The learner against Stable-Baselines3's PPO, a NumPy twin of its estimates, and finite differences in double."""

from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from ppo_models import ROWS, STEPS, box, learner_of, make_learner, random_rollout
from scripted_episodes import ScriptedEpisodes
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import DummyVecEnv

import flockstep
from flockstep import _core
from flockstep.learning.sources import EngineSource, source_of

TOLERANCE = 1e-5  # relative to the largest number that is compared


class Still(gymnasium.Env):
    """An environment of given spaces that is never stepped."""

    def __init__(self, observation_space, action_space):
        self.observation_space, self.action_space = observation_space, action_space

    def reset(self, **_):
        return self.observation_space.sample(), {}


class Asymmetric(ActorCriticPolicy):
    """A policy whose actor does not get the last ``critic_only`` numbers of the features."""

    def __init__(self, *args, critic_only, **options):
        self.critic_only = critic_only
        super().__init__(*args, **options)

    def _build_mlp_extractor(self):
        options = {"net_arch": self.net_arch, "activation_fn": self.activation_fn, "device": "cpu"}
        full = MlpExtractor(self.features_dim, **options)
        first = self.features_dim - self.critic_only
        cut = MlpExtractor(first, **options)
        full.policy_net, full.latent_dim_pi = cut.policy_net, cut.latent_dim_pi
        full.forward_actor = lambda features: full.policy_net(features[:, :first])
        full.forward = lambda features: (full.forward_actor(features), full.forward_critic(features))
        self.mlp_extractor = full


def make_pair(
    action_space=None,
    layers=((64, 64), (64, 64)),
    activation="tanh",
    observation_size=7,
    threads=1,
    critic_only=0,
    **settings,
):
    """Return SB3's PPO and a learner with the same parameters."""
    action_space = action_space or box(3)
    envs = DummyVecEnv([lambda: Still(box(observation_size), action_space)] * ROWS)
    activations = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
    torch.manual_seed(5)
    theirs = PPO(
        Asymmetric if critic_only else "MlpPolicy",
        envs,
        n_steps=STEPS,
        batch_size=STEPS,
        device="cpu",
        policy_kwargs={
            "net_arch": {"pi": list(layers[0]), "vf": list(layers[1])},
            "activation_fn": activations[activation],
            **({"critic_only": critic_only} if critic_only else {}),
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
        critic_only=critic_only,
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
        losses = ("policy_gradient_loss", "value_loss", "entropy_loss", "loss")
        for name in (*losses, "clip_fraction", "approx_kl", "explained_variance"):
            close(getattr(report, name), expected[f"train/{name}"], 3e-5)
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
    with pytest.raises(AttributeError):
        report.loss = 0.0


@pytest.mark.parametrize(
    ("layers", "activation"),
    [(((), ()), "tanh"), (((5,), (17, 33, 3)), "relu"), (((64, 64), (64, 64)), "relu"), (((100, 16, 7), ()), "tanh")],
)
def test_networks_of_any_shape(layers, activation):
    theirs, ours = make_pair(layers=layers, activation=activation, observation_size=19)
    compare_updates(theirs, ours)


# 17 - 1 numbers fill whole vectors, 18 - 3 do not, and 20 - 4 of 20 have another padding than all.
@pytest.mark.parametrize(("size", "critic_only"), [(7, 3), (17, 1), (18, 3), (20, 4), (40, 39)])
@pytest.mark.parametrize("action_space", [box(3), spaces.Discrete(5)], ids=["gaussian", "categorical"])
def test_numbers_for_the_critic_only(action_space, size, critic_only):
    theirs, ours = make_pair(action_space, observation_size=size, critic_only=critic_only)
    assert [shape for name, shape, _ in ours.layout if name.endswith("net.0.weight")] == [
        (64, size - critic_only),
        (64, size),
    ]
    compare_updates(theirs, ours, updates=2)


def test_an_actor_without_hidden_layers_and_numbers_for_the_critic_only():
    compare_updates(*make_pair(layers=((), (8,)), critic_only=2, activation="relu"), clip_range_vf=0.1)


def test_ten_updates_equal_those_of_sb3():
    theirs, ours = make_pair()
    compare_updates(theirs, ours, updates=10)


# --- gradients


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
        learner = learner_of(env)
        parameters, count = learner.parameters, learner.config.action_size
        if learner.config.is_discrete:
            parameters[-65 - count : -65] = -1e4  # the biases of all choices but one
            parameters[-65 - count] = 0
        else:
            parameters[:count] = -40
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
        learner = learner_of(env, 2, 1)
        if not learner.config.is_discrete:
            parameters = learner.parameters
            parameters[: learner.config.action_size] = 0.5  # many actions beyond the bounds
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
