"""Environments and models of the tests of `flockstep.PPO`, and a comparison of models."""

import gymnasium
import numpy as np
import torch
from conftest import world_of
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

import flockstep
from flockstep import PPO, _core

torch.set_num_threads(1)  # threads that wait for each other are slow on a busy machine

SMALL = {"n_steps": 8, "batch_size": 64, "n_epochs": 2, "seed": 1}
NET = {"net_arch": [8]}
OPTIONS = {"normalize_observations": True, "normalize_rewards": True}

ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": [8, 8, 4]}, markers={"start": [4, 4, 2]})


class Still(gymnasium.Env):
    """An environment of given spaces; every episode has 5 steps."""

    def __init__(self, observation_space=None, action_space=None):
        self.observation_space = observation_space or spaces.Box(-1, 1, (3,), np.float32)
        self.action_space = action_space or spaces.Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.age = 0
        return self.observation_space.sample(), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.age += 1
        return self.observation_space.sample(), 1.0, False, self.age == 5, {}


class ToTarget(flockstep.Task):
    """A task in Python: the reward is minus the distance to a point."""

    worlds = ROOM
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    reward_terms = ("near", "small")
    info_names = ("far",)
    max_episode_steps = 6

    def step(self, batch):
        distance = np.linalg.norm(batch.position - 1, axis=1)
        self.info["far"][:] = distance
        return {"near": -distance, "small": np.ones(len(distance))}, batch.contact.hit

    def observe(self, batch):
        return batch.position


class Aim(gymnasium.vector.VectorEnv):
    """One-step episodes: the action should equal the observation, or its sign."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(self, num_envs=64, is_discrete=False, scale=1.0, bad=None):
        self.num_envs, self.scale, self.bad, self.steps = num_envs, scale, bad, 0
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float32)
        self.single_action_space = spaces.Discrete(2, start=3) if is_discrete else spaces.Box(-1, 1, (1,), np.float32)
        self.random = np.random.default_rng(0)

    def _next(self):
        self.target = self.random.uniform(-1, 1, (self.num_envs, 1)).astype(np.float32)
        return self.scale * self.target

    def reset(self, *, seed=None, options=None):
        return self._next(), {}

    def step(self, actions):
        self.steps += 1
        if isinstance(self.single_action_space, spaces.Discrete):
            assert set(actions.tolist()) <= {3, 4}
            reward = ((actions == 4) == (self.target[:, 0] > 0)).astype(np.float32)
        else:
            reward = -((actions - self.target)[:, 0] ** 2)
        last = self.scale * self.target
        observation, ended = self._next(), np.ones(self.num_envs, bool)
        final = np.full(self.num_envs, None, dtype=object)
        final[:] = list(last)
        if self.bad and self.steps == 5:
            {"reward": reward, "observation": observation}[self.bad][7] = np.nan
        return observation, reward, ended, ~ended, {"final_obs": final, "_final_obs": ended}


def hover(num_envs=16, mode="same_step", threads=1, **keywords):
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.HoverConfig(),
        **({"autoreset_mode": mode, "max_episode_steps": 7, "num_threads": threads} | keywords),
    )


def small_model(**keywords):
    model = PPO("MlpPolicy", Aim(4), policy_kwargs={"net_arch": [3]}, **OPTIONS, **(SMALL | keywords))
    return model.learn(64)


def state_of(model):
    """Return everything that the next rollout and update depend on."""
    learner = model.learner
    arrays = [learner.parameters, *learner.adam, *learner.observation_moments, *learner.return_moments]
    return [*arrays, learner.discounted_returns, learner.draws, model.num_timesteps, model._n_updates]


def assert_same(one, other):
    np.testing.assert_equal(state_of(one), state_of(other))


# --- learners without a model

STEPS, ROWS = 48, 6


def box(*shape):
    return spaces.Box(-10, 10, shape, np.float32)


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


def learner_of(env, threads=1, seed=0):
    """A learner that fits an env of the engine, and what acts with one choice only, or hardly at random."""
    action = env.single_action_space
    is_discrete = isinstance(action, spaces.Discrete)
    size = env.single_observation_space.shape[0]
    count = action.n if is_discrete else action.shape[0]
    config = _core.NetworkConfig(observation_size=size, action_size=count, is_discrete=is_discrete)
    return _core.Learner(config, threads, seed)
