"""flockstep.PPO against Stable-Baselines3's: keywords, callbacks, logs, files, conversions, and what goes wrong."""

import inspect
import io
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stable_baselines3
import torch
import torch._dynamo  # which optimizers import; it derives a class from pickle.Unpickler, which a fixture replaces
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from messages import refused
from scripted_episodes import ScriptedEpisodes
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CheckpointCallback,
    EvalCallback,
    StopTrainingOnMaxEpisodes,
    StopTrainingOnRewardThreshold,
)
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import flockstep
import flockstep.sb3
from flockstep import PPO
from flockstep.learning.sources import EngineSource, VectorEnvSource

SB3 = stable_baselines3.PPO
ROOM = flockstep.World.from_dict(
    {
        "flockstep_scene": 1,
        "name": "room",
        "room": {"min": [0, 0, 0], "max": [8, 8, 4]},
        "markers": {"start": [4, 4, 2]},
    }
)
REFUSED = r"expected a model that PPO\.save wrote"
SMALL = {"n_steps": 8, "batch_size": 64, "n_epochs": 2, "seed": 1}
NET = {"net_arch": [8]}

# Most rollouts of these tests are smaller than a minibatch.
pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")
OPTIONS = {"normalize_observations": True, "normalize_rewards": True}


@pytest.fixture(autouse=True, scope="module")
def _one_thread_of_torch():
    """Threads of PyTorch that wait for each other are slow on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


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


def hover(num_envs=16, mode="same_step", threads=1, **keywords):
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.HoverConfig(),
        **({"autoreset_mode": mode, "max_episode_steps": 7, "num_threads": threads} | keywords),
    )


def state_of(model):
    """Return everything that the next rollout and update depend on."""
    learner = model.learner
    arrays = [learner.parameters, *learner.adam, *learner.observation_moments, *learner.return_moments]
    return [*arrays, learner.discounted_returns, learner.draws, model.num_timesteps, model._n_updates]


def assert_same(one, other):
    for expected, got in zip(state_of(one), state_of(other), strict=True):
        np.testing.assert_array_equal(got, expected)


# --- keywords of Stable-Baselines3


def test_every_keyword_of_sb3_has_the_same_place_and_default():
    theirs = inspect.signature(SB3.__init__).parameters
    ours = inspect.signature(PPO.__init__).parameters
    assert list(ours)[: len(theirs)] == list(theirs)
    kinds = [parameter.kind for parameter in list(ours.values())[len(theirs) :]]
    assert set(kinds[:-1]) == {inspect.Parameter.KEYWORD_ONLY}
    assert kinds[-1] is inspect.Parameter.VAR_KEYWORD  # for a message about unknown ones
    assert {name: ours[name].default for name in theirs} == {name: theirs[name].default for name in theirs}
    for method in ("learn", "predict", "load", "set_env"):
        theirs, ours = (dict(inspect.signature(getattr(cls, method)).parameters) for cls in (SB3, PPO))
        assert set(theirs) - {"kwargs"} <= set(ours), method


def test_a_minibatch_larger_than_a_rollout_warns():
    said = r"^batch_size: expected at most the 8 steps of a rollout \(8 n_steps x 1 envs\), got 9: each epoch is"
    with pytest.warns(UserWarning, match=said):
        PPO("MlpPolicy", Still(), n_steps=8, batch_size=9)
    model = PPO("MlpPolicy", Still(), n_steps=8, batch_size=8)
    model.batch_size = 9
    with pytest.warns(UserWarning, match=said):
        model.set_env(Still())


def test_complex_and_masked_observations_are_refused():
    model = PPO("MlpPolicy", Still(), n_steps=8, batch_size=8)
    observation = np.zeros(model.observation_space.shape, np.float32)
    with refused(ValueError, "observation", "complex64"):
        model.predict(observation + np.complex64(1j))
    with refused(ValueError, "observation"):
        model.predict(np.ma.masked_less(observation, 1))


def test_a_file_of_sb3_says_how_to_load_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SB3("MlpPolicy", Still(), n_steps=8, batch_size=8, device="cpu").save("theirs")
    said = r"^theirs.zip is a model of Stable-Baselines3\. Load it by flockstep\.PPO\.from_sb3\(.*which runs code"
    for name in ("theirs", "theirs.zip"):
        with pytest.raises(ValueError, match=said):
            PPO.load(name)
    assert flockstep.PPO.from_sb3(SB3.load("theirs.zip", device="cpu")).n_steps == 8


def test_keywords_with_the_defaults_of_sb3_are_accepted():
    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.ppo import MlpPolicy

    model = PPO(
        MlpPolicy,
        Still(),
        *(3e-4, 16, 16, 1, 0.99, 0.95, 0.2, None, True, 0.0, 0.5, 0.5),
        *(False, 4, RolloutBuffer, {}, None, 50, None),
        {
            "net_arch": [{"pi": [4], "vf": [5, 6]}],
            "activation_fn": torch.nn.ReLU,
            "ortho_init": True,
            "squash_output": False,
            "share_features_extractor": False,
            "optimizer_class": torch.optim.Adam,
            "optimizer_kwargs": {"eps": 1e-5},
            "features_extractor_kwargs": None,
            "log_std_init": -1.0,
        },
        0,
        3,
        torch.device("cpu"),
        True,
    )
    config = model.learner.config
    assert (config.actor_layers, config.critic_layers, config.activation) == ([4], [5, 6], "relu")
    np.testing.assert_array_equal(model.learner.parameters[:2], -1)
    assert model.learn(32.0).num_timesteps == 32


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"use_sde": True}, "use_sde: expected False.*use Stable-Baselines3"),
        ({"rollout_buffer_class": dict}, "rollout_buffer_class: expected None.*use Stable-Baselines3"),
        ({"rollout_buffer_kwargs": {"a": 1}}, "rollout_buffer_kwargs"),
        ({"_init_setup_model": False}, "_init_setup_model"),
        ({"device": "cuda"}, "device: expected 'cpu' or 'auto'"),
        ({"policy": "CnnPolicy"}, "policy: expected.*for images or memory, train with Stable-Baselines3"),
        ({"policy": "MlpLstmPolicy"}, "policy: expected.*for images or memory, train with Stable-Baselines3"),
        ({"policy": torch.nn.Module}, "policy: expected.*train with Stable-Baselines3"),
        ({"policy_kwargs": {"ortho_init": False}}, "ortho_init=True.*train with Stable-Baselines3"),
        ({"policy_kwargs": {"use_sde": True}}, "use_sde=False"),
        ({"policy_kwargs": {"optimizer_class": torch.optim.SGD}}, "optimizer_class=Adam"),
        ({"policy_kwargs": {"optimizer_kwargs": {"weight_decay": 1.0}}}, "optimizer_kwargs=None"),
        ({"policy_kwargs": {"net_arc": [3]}}, "Did you mean 'net_arch'"),
        ({"policy_kwargs": {"net_arch": [0]}}, "net_arch"),
        ({"policy_kwargs": {"net_arch": {"qf": [3]}}}, "net_arch"),
        ({"policy_kwargs": {"activation_fn": torch.nn.ELU}}, "activation_fn.*train with Stable-Baselines3"),
        (
            {"policy_kwargs": {"features_extractor_class": flockstep.sb3.ImageFeatures}},
            "features_extractor_class.*train with Stable-Baselines3",
        ),
        ({"policy_kwargs": {"log_std_init": np.nan}}, "log_std_init"),
        ({"n_steps": 0}, "n_steps"),
        ({"n_steps": 2.5}, "n_steps: expected an integer"),
        ({"batch_size": 1}, "batch_size"),
        ({"gamma": 1.5}, "gamma"),
        ({"learning_rate": -1.0}, "learning_rate"),
        ({"learning_rate": lambda _: np.nan}, "learning_rate"),
        ({"clip_range_vf": 0.0}, "clip_range_vf"),
        ({"target_kl": -1.0}, "target_kl"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"stats_window_size": 0}, "stats_window_size"),
        ({"num_threads": -1}, "num_threads"),
        ({"env": None}, "env: expected an environment"),
        ({"env": 3}, "env: expected a Gymnasium id"),
        ({"env": Still(spaces.Box(0, 255, (16, 16, 3), np.uint8))}, "it is an image.*train with Stable-Baselines3"),
        ({"env": Still(spaces.Discrete(4))}, "observation: expected numbers.*train with Stable-Baselines3"),
        ({"env": Still(None, spaces.MultiDiscrete([2, 3]))}, "actions: expected.*train with Stable-Baselines3"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_the_learner_lacks_is_refused_in_words(changes, message):
    with pytest.raises((ValueError, TypeError), match=message):
        PPO(**({"policy": "MlpPolicy", "env": Still(), "seed": 0} | changes))


SCRIPT = """
import gymnasium as gym
from {module} import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.callbacks import EvalCallback

env = gym.make("CartPole-v1")
rate, clip = lambda left: 1e-3 * left, lambda left: 0.2 * left
model = PPO("MlpPolicy", env, n_steps=64, learning_rate=rate, clip_range=clip, verbose=0)
callback = EvalCallback(gym.make("CartPole-v1"), eval_freq=100, n_eval_episodes=1, verbose=0, warn=False)
model.learn(total_timesteps=150, callback=callback)
model.save(folder + "/cartpole")
del model
model = PPO.load(folder + "/cartpole", env=env, **changes)
model.learn(64, reset_num_timesteps=False)
mean, _ = evaluate_policy(model, model.get_env(), n_eval_episodes=2)
assert mean > 5
vec_env = model.get_env()
obs = vec_env.reset()
for _ in range(20):
    action, _states = model.predict(obs, deterministic=True)
    obs, reward, done, info = vec_env.step(action)
action, _ = model.predict(env.reset()[0])
env.step(action)
steps = model.num_timesteps
"""


@pytest.mark.parametrize("module", ["stable_baselines3", "flockstep"])
def test_a_script_for_sb3_changes_only_its_import(module, tmp_path):
    changes = {} if module == "stable_baselines3" else {"learning_rate": 1e-3, "clip_range": 0.2}
    names = {"folder": str(tmp_path), "changes": changes}
    exec(SCRIPT.format(module=module), names)
    assert names["steps"] == 192 + 64


def test_a_schedule_that_falls_to_zero_ends_there():
    """The last rollout ends after total_timesteps, where a linear schedule would be negative."""
    seen = []
    model = PPO(
        "MlpPolicy", hover(), 1e-3, 8, 64, 1, clip_range=lambda left: 0.2 * left, clip_range_vf=lambda left: left
    )
    model.learning_rate = lambda left: seen.append(left) or 1e-3 * left
    model.learn(300)
    assert seen[-1] == 0.0
    assert min(seen) == 0.0
    assert model.num_timesteps == 384


# --- training


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


@pytest.mark.parametrize("is_discrete", [False, True])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_it_learns(is_discrete, scale):
    model = PPO(
        "MlpPolicy",
        Aim(64, is_discrete, scale),
        3e-3,
        n_steps=16,
        batch_size=256,
        n_epochs=10,
        seed=0,
        policy_kwargs={"net_arch": [16], "log_std_init": -1.0},
        normalize_observations=scale != 1,
    )
    model.learn(40_000)
    last = np.mean([episode["r"] for episode in model.ep_info_buffer])
    assert last > (0.93 if is_discrete else -0.05)
    observations = np.float32([[-0.9], [-0.4], [0.4], [0.9]]) * np.float32(scale)
    actions, _ = model.predict(observations, deterministic=True)
    expected = [3, 3, 4, 4] if is_discrete else [[-0.9], [-0.4], [0.4], [0.9]]
    np.testing.assert_allclose(actions, expected, atol=0.2)


@pytest.mark.parametrize("make", [hover, lambda threads: ScriptedEpisodes(37, "next_step")], ids=["engine", "arrays"])
def test_threads_do_not_change_the_bits(make):
    def trained(threads):
        env = make(threads=threads)
        model = PPO("MlpPolicy", env, num_threads=threads, policy_kwargs=NET, **OPTIONS, **(SMALL | {"n_steps": 20}))
        return model.learn(20 * env.num_envs * 3)

    one = trained(1)
    for threads in (2, 7):
        assert_same(one, trained(threads))


def test_a_batch_may_have_more_threads_than_the_learner():
    one = PPO("MlpPolicy", hover(), **SMALL).learn(256)
    other = PPO("MlpPolicy", hover(threads=3), num_threads=1, **SMALL).learn(256)
    assert_same(one, other)


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
def test_every_kind_of_environment_counts_the_same_episodes(mode):
    """Tasks in C++ and Python, Gymnasium's vector envs, and VecEnvs."""
    make_still = [lambda: Still() for _ in range(3)]
    modes = {"next_step": AutoresetMode.NEXT_STEP, "same_step": AutoresetMode.SAME_STEP}
    gym_mode = modes.get(mode, AutoresetMode.DISABLED)
    kinds = [
        (hover(3, mode, max_episode_steps=5), EngineSource),
        (flockstep.DroneVectorEnv(3, task=ToTarget, autoreset_mode=mode, max_episode_steps=5), VectorEnvSource),
        (SyncVectorEnv(make_still, autoreset_mode=gym_mode), VectorEnvSource),
    ]
    for env, kind in kinds:
        model = PPO("MlpPolicy", env, **(SMALL | {"n_steps": 24}))
        assert isinstance(model.source, kind)
        model.learn(24 * 3)
        lengths = [episode["l"] for episode in model.ep_info_buffer]
        assert lengths == [5] * len(lengths)
        assert len(lengths) == 3 * (24 // (6 if mode == "next_step" else 5))
        if kind is EngineSource or isinstance(env, flockstep.DroneVectorEnv):
            assert list(model.ep_success_buffer) == [False] * len(lengths)
            assert len({episode["r"] for episode in model.ep_info_buffer}) > 3
        else:
            assert {episode["r"] for episode in model.ep_info_buffer} == {5.0}


def test_vec_envs_of_sb3_count_the_same_episodes():
    envs = DummyVecEnv([lambda: Monitor(Still())] * 3)
    for env in (
        envs,
        VecNormalize(envs),
        VecMonitor(DummyVecEnv([Still] * 3)),
        flockstep.sb3.make_vec(ToTarget, 3, max_episode_steps=5),
    ):
        model = PPO("MlpPolicy", env, **(SMALL | {"n_steps": 24})).learn(72)
        assert [episode["l"] for episode in model.ep_info_buffer] == [5] * 12
    assert PPO("MlpPolicy", VecNormalize(envs), **SMALL).get_vec_normalize_env() is not None
    assert model.get_vec_normalize_env() is None


@pytest.mark.parametrize("task", [flockstep.HoverConfig(), ToTarget], ids=["engine", "python"])
def test_steps_of_a_subclass_are_used(task):
    class Shaped(flockstep.DroneVectorEnv):
        def step(self, actions):
            observation, reward, *rest = super().step(actions)
            return (observation, 0 * reward - 3, *rest)

    model = PPO("MlpPolicy", Shaped(4, task=task, max_episode_steps=100), **SMALL).learn(32)
    assert (model.learner.rewards == -3).all()


def test_success_that_an_env_does_not_know_is_not_counted():
    successes = iter([None, 0.5, 1.0, np.array([True, False])])

    class Judged(Still):
        def step(self, action):
            *rest, truncated, infos = super().step(action)
            return (*rest, truncated, {"is_success": next(successes)} if truncated else infos)

    model = PPO("MlpPolicy", Judged(), n_steps=20, batch_size=20, seed=0).learn(20)
    assert list(model.ep_success_buffer) == [0.5, 1.0]


def test_reward_scale_trains_and_is_not_reported():
    with_scale, without = (PPO("MlpPolicy", hover(reward_scale=scale), **SMALL).learn(128) for scale in (0.01, 1.0))
    assert np.abs(with_scale.learner.rewards).max() < np.abs(without.learner.rewards).max()
    assert [end["r"] for end in with_scale.ep_info_buffer] == [end["r"] for end in without.ep_info_buffer]


def test_drones_that_share_an_env_train():
    env = hover(4, drones_per_env=3)
    model = PPO("MlpPolicy", env, **SMALL).learn(8 * 12 * 2)
    assert model.n_envs == 12
    assert {end["l"] for end in model.ep_info_buffer} == {7}


# --- callbacks and logs


class Calls(BaseCallback):
    """Notes every call with the counts at that time."""

    def __init__(self):
        super().__init__()
        self.noted = []

    def _note(self, name):
        self.noted.append((name, self.n_calls, self.num_timesteps, self.model.num_timesteps))

    def _on_training_start(self):
        assert self.locals["total_timesteps"] == 40
        self._note("training start")

    def _on_rollout_start(self):
        self._note("rollout start")

    def _on_step(self):
        assert self.locals["self"] is self.model
        assert len(self.locals["infos"]) == len(self.locals["dones"]) == len(self.locals["rewards"]) == 2
        self._note("step")
        return True

    def _on_rollout_end(self):
        self._note("rollout end")

    def _on_training_end(self):
        self._note("training end")


def test_callbacks_are_called_as_by_sb3():
    noted = []
    for cls in (SB3, PPO):
        callback = Calls()
        env = DummyVecEnv([lambda: Monitor(Still())] * 2)
        cls("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1).learn(40, callback=[callback])
        noted.append(callback.noted)
    assert noted[0] == noted[1]
    assert len(noted[0]) > 30


@pytest.mark.parametrize("cls", [PPO, SB3])
def test_the_total_of_a_training_that_goes_on(cls):
    """As a progress bar needs it: with the steps before."""

    class Total(BaseCallback):
        def _on_training_start(self):
            totals.append(self.locals["total_timesteps"])

        def _on_step(self):
            return True

    totals = []
    model = cls("MlpPolicy", DummyVecEnv([Still] * 2), n_steps=8, batch_size=16, n_epochs=1)
    model.learn(16, callback=Total())
    model.learn(32, callback=Total(), reset_num_timesteps=False)
    assert totals == [16, 48]


def test_a_callback_may_keep_rewards():
    kept = []

    def keep(names, _):
        kept.append((names["rewards"], names["rewards"].copy()))

    PPO("MlpPolicy", hover(), **SMALL).learn(16 * 8, callback=keep)
    assert all((rewards == then).all() for rewards, then in kept)
    assert len({float(then[0]) for _, then in kept}) > 4


def test_an_env_that_a_callback_sets_at_the_end_is_reset():
    class Move(BaseCallback):
        def _on_step(self):
            return True

        def _on_training_end(self):
            self.model.set_env(SyncVectorEnv([Still] * 2))

    model = PPO("MlpPolicy", SyncVectorEnv([Still] * 2), n_steps=8, batch_size=16).learn(16, callback=Move())
    assert model.learn(16, reset_num_timesteps=False).num_timesteps == 32


def test_the_callbacks_of_sb3_work(tmp_path):
    env = flockstep.sb3.make_vec("flockstep/Hover-v0", 8, max_episode_steps=5)
    test_env = flockstep.sb3.make_vec("flockstep/Hover-v0", 2, max_episode_steps=5)
    printed, recorded = io.StringIO(), set()
    terms = [f"terms/{name}" for name in env.env.batch.spec.reward_terms]
    callbacks = [
        EvalCallback(test_env, eval_freq=8, n_eval_episodes=2, best_model_save_path=str(tmp_path / "best"), verbose=0),
        CheckpointCallback(8, str(tmp_path), "model"),
        flockstep.sb3.LogTerms(),
        flockstep.sb3.Progress(0.0, printed),
    ]
    model = PPO("MlpPolicy", env, **SMALL)
    logger = configure(format_strings=[])
    dump = logger.dump
    logger.dump = lambda step=0: (recorded.update(logger.name_to_value), dump(step))
    model.set_logger(logger)
    model.learn(128, callback=callbacks)
    assert (tmp_path / "best" / "best_model.zip").is_file()
    for steps in (64, 128):
        assert PPO.load(tmp_path / f"model_{steps}_steps").num_timesteps == steps
    assert "128 of 128 steps (100%)" in printed.getvalue()
    assert recorded >= {"eval/mean_reward", "rollout/success_rate", *terms}
    stop = EvalCallback(
        test_env, callback_on_new_best=StopTrainingOnRewardThreshold(-1e9, verbose=0), eval_freq=3, verbose=0
    )
    assert model.learn(10_000, callback=stop).num_timesteps == 24
    assert model.learn(10_000, callback=StopTrainingOnMaxEpisodes(1)).num_timesteps < 100


@pytest.mark.parametrize("make", [hover, lambda: flockstep.DroneVectorEnv(16, task=ToTarget, max_episode_steps=7)])
def test_terms_are_logged_without_a_vec_env(make):
    env = make()
    has_infos = isinstance(env.task, ToTarget)
    model = PPO("MlpPolicy", env, **(SMALL | {"n_steps": 16}))
    recorded = {}
    logger = configure(format_strings=[])
    logger.dump = lambda step=0: recorded.update(logger.name_to_value)
    model.set_logger(logger)
    model.learn(256, callback=flockstep.sb3.LogTerms(("far",) if has_infos else ()))
    terms = [f"terms/{name}" for name in env.batch.spec.reward_terms]
    assert set(terms) <= set(recorded)
    assert recorded["rollout/ep_rew_mean"] == pytest.approx(sum(recorded[name] for name in terms))
    assert ("infos/far" in recorded) == has_infos


def test_a_function_stops_a_training():
    steps = []

    def count(names, _):
        steps.append(names["self"].num_timesteps)
        return None if len(steps) < 3 else np.bool_(False)

    assert PPO("MlpPolicy", hover(), **SMALL).learn(10_000, callback=count).num_timesteps == 48
    assert steps == [16, 32, 48]
    with refused(TypeError, "callback"):
        PPO("MlpPolicy", hover(), **SMALL).learn(16, callback=3)


def tags(folder):
    events = EventAccumulator(str(folder)).Reload()
    names = events.Tags()["scalars"]
    return {name: [event.step for event in events.Scalars(name)] for name in names}


@pytest.mark.parametrize("action_space", [None, spaces.Discrete(3)], ids=["gaussian", "categorical"])
def test_tensorboard_has_the_tags_and_steps_of_sb3(action_space, tmp_path):
    for cls in (SB3, PPO):
        envs = DummyVecEnv([lambda: Monitor(Still(None, action_space))] * 2)
        folder = tmp_path / cls.__module__
        model = cls("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, clip_range_vf=0.2, tensorboard_log=folder)
        model.learn(48, tb_log_name="run")
        model.learn(16, tb_log_name="run")
        model.learn(16, tb_log_name="run", reset_num_timesteps=False)
        model.logger.close()
    theirs, ours = (tmp_path / cls.__module__ for cls in (SB3, PPO))
    assert {path.name for path in ours.iterdir()} == {path.name for path in theirs.iterdir()} == {"run_1", "run_2"}
    for run in ("run_1", "run_2"):
        assert tags(ours / run) == tags(theirs / run)
    assert "train/loss" in tags(ours / "run_1")


def test_the_table_and_the_log(capsys, tmp_path):
    model = PPO("MlpPolicy", hover(), verbose=1, tensorboard_log=tmp_path, **SMALL)

    def note(names, _):
        log = names["self"].logger
        log.record("own/number", np.float32(2.5))
        log.record("own/text", "words")
        log.record("own/hidden", 7, exclude=("stdout",))
        log.record("own/printed", torch.tensor(3.0), exclude="tensorboard")
        log.record_mean("own/mean", len(names["dones"]))
        with pytest.raises(TypeError, match="own/list: expected a number or a text, got list"):
            log.record("own/list", [1])

    model.learn(256, callback=note)
    printed = capsys.readouterr().out
    for expected in ("ep_len_mean", "total_timesteps", "explained_variance", "number", "words", "printed", "mean"):
        assert expected in printed
    assert "hidden" not in printed
    found = tags(model.logger.dir)
    assert {"own/number", "own/hidden", "own/mean"} <= set(found)
    assert not {"own/text", "own/printed"} & set(found)


def test_a_progress_bar_is_shown(capsys):
    PPO("MlpPolicy", hover(), **SMALL).learn(256, progress_bar=True)
    assert "256/256" in capsys.readouterr().err


# --- files


def small_model(**keywords):
    model = PPO("MlpPolicy", Aim(4), policy_kwargs={"net_arch": [3]}, **OPTIONS, **(SMALL | keywords))
    return model.learn(64)


def test_a_model_survives_a_file(tmp_path):
    model = small_model(
        learning_rate=np.float32(1e-3), n_steps=np.int64(8), seed=np.int64(5), gamma=np.float64(0.9), target_kl=0.5
    )
    model.save(tmp_path / "folder" / "model")
    for name in ("model", "model.zip"):
        loaded = PPO.load(tmp_path / "folder" / name)
        assert_same(model, loaded)
        for name in (
            "learning_rate",
            "n_steps",
            "seed",
            "gamma",
            "target_kl",
            "normalize_rewards",
            "observation_space",
        ):
            assert getattr(loaded, name) == getattr(model, name)
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["model.zip"]
    observation = np.float32([[0.3], [-7.0]])
    for deterministic in (True, False):  # random actions go on as well
        one, other = (each.predict(observation, deterministic=deterministic)[0] for each in (model, loaded))
        np.testing.assert_array_equal(one, other)
    with refused(ValueError, "learn"):
        loaded.learn(10)
    changed = PPO.load(tmp_path / "folder" / "model", Aim(4), learning_rate=0.5, verbose=0, num_threads=2)
    assert (changed.learning_rate, changed.learner.num_threads) == (0.5, 2)
    changed.learn(32, reset_num_timesteps=False)
    assert changed.num_timesteps == 96
    with pytest.raises(TypeError, match=r"expected hyperparameters such as learning_rate, got 'learning_rat'.*Did you"):
        PPO.load(tmp_path / "folder" / "model", learning_rat=1)
    with refused(ValueError, "load", "custom_objects"):
        PPO.load(tmp_path / "folder" / "model", custom_objects={"learning_rate": 0.0})
    with refused(ValueError, "env"):
        PPO.load(tmp_path / "folder" / "model", Aim(4, is_discrete=True))
    with refused(FileNotFoundError, "nothing"):
        PPO.load(tmp_path / "nothing")


def test_a_function_is_given_again_to_learn(tmp_path):
    model = small_model(learning_rate=lambda left: 1e-3 * left)
    model.save(tmp_path / "model")
    flies = PPO.load(tmp_path / "model")
    observation = np.ones((3, *model.observation_space.shape), np.float32)
    np.testing.assert_array_equal(flies.predict(observation)[0], model.predict(observation)[0])
    flies.save(tmp_path / "again")
    for name in ("model", "again"):
        with pytest.raises(ValueError, match="learning_rate: it was a function, which files do not hold"):
            PPO.load(tmp_path / name, env=model.get_env())
    flies.set_env(model.get_env())
    with pytest.raises(ValueError, match="learning_rate: it was a function, which files do not hold"):
        flies.learn(1)
    learns = PPO.load(tmp_path / "model", env=model.get_env(), learning_rate=1e-3)
    assert learns.learn(1).learning_rate == 1e-3


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(-np.inf, np.inf, (3,), np.float32),
        spaces.Box(np.float32([-1, -np.inf]), np.float32([0.1, 2]), dtype=np.float32),
        spaces.Dict([("z", spaces.Box(0, 5, (4,), np.uint8)), ("a", spaces.Box(-1, 1, (), np.float64))]),
    ],
    ids=str,
)
@pytest.mark.parametrize("action", [spaces.Discrete(3, start=-1), spaces.Box(-2, 0.1, (2, 2), np.float64)], ids=str)
def test_spaces_survive_a_file(space, action, tmp_path):
    model = PPO("MultiInputPolicy", Still(space, action), **SMALL)
    model.save(tmp_path / "model")
    loaded = PPO.load(tmp_path / "model", Still(space, action))
    assert (loaded.observation_space, loaded.action_space) == (space, action)
    if isinstance(space, spaces.Dict):
        assert list(loaded.observation_space) == ["z", "a"]
    observation = space.sample()
    got, expected = (each.predict(observation, deterministic=True)[0] for each in (loaded, model))
    np.testing.assert_array_equal(got, expected)
    assert action.contains(got) or np.issubdtype(got.dtype, np.integer)
    with zipfile.ZipFile(tmp_path / "model.zip") as archive:
        json.loads(archive.read("model.json"), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def load_bytes(content, path):
    path.write_bytes(content)
    return PPO.load(path)


def edited(content, change):
    """Return an archive whose JSON text was changed, with right checksums of the archive."""
    to = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(to, "w") as made:
        for name in archive.namelist():
            member = archive.read(name)
            if name == "model.json":
                state = json.loads(member)
                change(state)
                member = json.dumps(state)
            made.writestr(name, member)
    return to.getvalue()


@pytest.fixture
def content(tmp_path):
    small_model().save(tmp_path / "model")
    return (tmp_path / "model.zip").read_bytes()


@pytest.fixture(autouse=True)
def _no_pickle(monkeypatch, request):
    """Files are never read by pickle."""
    if "content" in request.fixturenames:
        for name in ("load", "loads", "Unpickler"):
            monkeypatch.setattr(pickle, name, lambda *_, **__: pytest.fail("pickle was read"))


def test_mutated_files_are_refused_or_equal(content, tmp_path):
    expected = load_bytes(content, tmp_path / "whole.zip")
    random, failures, equal, path = np.random.default_rng(0), 0, 0, tmp_path / "mutated.zip"
    positions = np.concatenate([np.arange(len(content)), random.integers(0, len(content), 500)])
    assert len(positions) > 3000
    for at in positions:
        mutated = bytearray(content)
        mutated[at] ^= random.integers(1, 256)
        try:
            model = load_bytes(bytes(mutated), path)
        except ValueError as error:
            failures += REFUSED.replace("\\", "") in str(error)
        else:
            assert_same(expected, model)
            equal += 1
    assert failures + equal == len(positions)
    assert failures > 0.5 * len(positions)


def test_truncated_files_are_refused(content, tmp_path):
    for length in [*range(0, len(content), 61), len(content) - 1]:
        with pytest.raises(ValueError, match=REFUSED):
            load_bytes(content[:length], tmp_path / "short.zip")


def test_parts_of_other_files_are_refused(content, tmp_path):
    small_model(seed=2).save(tmp_path / "other")
    with zipfile.ZipFile(io.BytesIO(content)) as one, zipfile.ZipFile(tmp_path / "other.zip") as other:
        members = {name: one.read(name) for name in one.namelist()}
        others = {name: other.read(name) for name in other.namelist()}
    swaps = [{name: others[name]} for name in members if members[name] != others[name]]
    swaps.append({"adam_first": members["parameters"], "parameters": members["adam_first"]})
    assert len(swaps) >= 5
    for swap in swaps:
        with zipfile.ZipFile(tmp_path / "swapped.zip", "w") as archive:
            for name, member in (members | swap).items():
                archive.writestr(name, member)
        with pytest.raises(ValueError, match="the checksum differs"):
            PPO.load(tmp_path / "swapped")


@pytest.mark.parametrize(
    "change",
    [
        lambda state: state.update(format="flockstep model 2"),
        lambda state: state.pop("network"),
        lambda state: state["network"].update(actor_layers=[4096] * 1000),
        lambda state: state["network"].update(actor_layers=[4]),
        lambda state: state["network"].update(observation_size=1e9),
        lambda state: state["network"].update(observation_size=2),
        lambda state: state["network"].update(other=2),
        lambda state: state["observation_space"].update(box=[1 << 40]),
        lambda state: state["observation_space"].update(box=[-1]),
        lambda state: state["observation_space"].update(box=[2]),
        lambda state: state["observation_space"].update(dtype="O"),
        lambda state: state["observation_space"].update(dtype="9" * 5000),
        lambda state: state["observation_space"].update(low=["nan"]),
        lambda state: state.update(observation_space={"dict": 3}),
        lambda state: state.update(action_space={"discrete": 10**30, "start": 0}),
        lambda state: state.update(action_space={"discrete": 1, "start": 0}),
        lambda state: state["hyperparameters"].pop("n_steps"),
        lambda state: state["hyperparameters"].update(n_steps="many"),
        lambda state: state["hyperparameters"].update(stats_window_size=None),
        lambda state: state["schedules"].update(learning_rate=None),
        lambda state: state.update(callable_schedules=3),
        lambda state: state.update(num_timesteps=-1),
        lambda state: state.update(adam_steps=-1),
        lambda state: state.update(draws="x"),
        lambda state: state.update(learner_seed=-1),
        lambda state: state.update(observation_count=-1.0),
        lambda state: state.update(sha256={}),
    ],
)
def test_absurd_values_are_refused(content, change, tmp_path):
    assert load_bytes(edited(content, lambda _: None), tmp_path / "same.zip")
    began = time.perf_counter()
    with pytest.raises(ValueError, match=REFUSED):
        load_bytes(edited(content, change), tmp_path / "edited.zip")
    assert time.perf_counter() - began < 5


def test_numbers_of_spaces_are_counted_before_they_are_made(content, tmp_path):
    def change(state):
        box = {"box": [65536], "dtype": "float64", "low": [0], "high": [1]}
        state["observation_space"] = {"dict": [[f"p{i}", box] for i in range(100)]}

    bomb = edited(content, change)
    tracemalloc.start()
    with refused(ValueError, "space", 6553600):
        load_bytes(bomb, tmp_path / "edited.zip")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 << 20  # of 100 MiB


def test_a_file_sets_nothing_but_hyperparameters(content, tmp_path):
    def change(state):
        state["hyperparameters"].update(predict="mine", source=3)
        state["schedules"].update(save=1.0)

    model = load_bytes(edited(content, change), tmp_path / "edited.zip")
    assert callable(model.predict)
    assert callable(model.save)
    assert model.source is None


def test_other_archives_are_refused(content, tmp_path):
    with zipfile.ZipFile(tmp_path / "large.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("model.json", b" " * (1 << 24))
    with pytest.raises(ValueError, match="expected no compression"):
        PPO.load(tmp_path / "large")
    (tmp_path / "text.zip").write_text("text")
    with pytest.raises(ValueError, match=REFUSED):
        PPO.load(tmp_path / "text")
    with zipfile.ZipFile(tmp_path / "deep.zip", "w") as archive:
        archive.writestr("model.json", "[" * 100_000)
    with pytest.raises(ValueError, match=REFUSED):
        PPO.load(tmp_path / "deep")


# --- seeds


@pytest.mark.parametrize(
    "wrap", [lambda env: env, lambda env: VecNormalize(env, norm_reward=False)], ids=["engine", "arrays"]
)
def test_seeds_given_to_a_vec_env_after_the_model_are_used(wrap):
    """As with Stable-Baselines3: each model begins where its environments begin with those seeds."""

    def first_places(make):
        env = flockstep.DroneVectorEnv(6, task=flockstep.HoverConfig(), autoreset_mode="same_step")
        make(env)
        return np.array(env.batch.position)

    def seeded(cls, seed, later):
        def make(env):
            vec_env = wrap(flockstep.sb3.make_vec(env))
            model = cls("MlpPolicy", vec_env, n_steps=8, batch_size=48, seed=seed)
            if later is not None:
                vec_env.seed(later)
            model.learn(0)

        return first_places(make)

    expected = first_places(lambda env: env.reset(seed=1000))
    for cls in (PPO, stable_baselines3.PPO):
        assert (seeded(cls, 0, 1000) == expected).all()
        assert (seeded(cls, 1000, None) == expected).all()
        assert (seeded(cls, 0, None) != expected).any()


def hover_vec_env():
    env = flockstep.DroneVectorEnv(6, task=flockstep.HoverConfig(), autoreset_mode="same_step")
    return flockstep.sb3.make_vec(env)


def places(vec_env):
    return np.array(vec_env.env.batch.position)


def places_of(seed):
    vec_env = hover_vec_env()
    vec_env.env.reset(seed=seed)
    return places(vec_env)


def test_another_env_keeps_its_seeds():
    model, other = PPO("MlpPolicy", hover_vec_env(), **SMALL), hover_vec_env()
    other.seed(1000)
    model.set_env(other)
    model.learn(0)
    assert (places(other) == places_of(1000)).all()


def test_a_loaded_model_seeds_its_env(tmp_path):
    PPO("MlpPolicy", hover_vec_env(), **SMALL).save(tmp_path / "model")
    for changes, seed in (({}, SMALL["seed"]), ({"seed": 7}, 7)):
        vec_env = hover_vec_env()
        PPO.load(tmp_path / "model", vec_env, **changes).learn(0)
        assert (places(vec_env) == places_of(seed)).all()
    drone_env = hover_vec_env().env
    PPO.load(tmp_path / "model", drone_env, seed=7).learn(0)
    assert (np.array(drone_env.batch.position) == places_of(7)).all()


def test_a_seed_given_to_load_is_also_that_of_actions(tmp_path):
    small_model().save(tmp_path / "model")
    observation = np.zeros((4, 1), np.float32)
    first, same, other = (PPO.load(tmp_path / "model", seed=seed).predict(observation)[0] for seed in (7, 7, 8))
    assert (first == same).all()
    assert (first != other).any()
    with refused(ValueError, "seed"):
        PPO.load(tmp_path / "model", seed=-1)


def test_a_model_made_from_one_of_sb3_leaves_the_seeds_of_its_env():
    vec_env = hover_vec_env()
    theirs = stable_baselines3.PPO("MlpPolicy", vec_env, n_steps=8, batch_size=48, seed=0)
    vec_env.seed(1000)
    PPO.from_sb3(theirs).learn(0)
    assert (places(vec_env) == places_of(1000)).all()


def test_seeds_of_numpy_are_accepted():
    PPO("MlpPolicy", "CartPole-v1", n_steps=8, batch_size=8, seed=np.int64(5)).learn(8)


# --- checkpoints


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
@pytest.mark.parametrize("task", [flockstep.HoverConfig(), ToTarget], ids=["engine", "python"])
@pytest.mark.parametrize("options", [{}, OPTIONS], ids=["plain", "normalized"])
def test_a_checkpoint_resumes_to_the_same_bits(mode, task, options, tmp_path):
    def make():
        return flockstep.DroneVectorEnv(6, task=task, autoreset_mode=mode, max_episode_steps=5, num_threads=2)

    settings = SMALL | options | {"n_steps": 9, "policy_kwargs": NET}
    whole = PPO("MlpPolicy", make(), **settings).learn(9 * 6 * 5)
    env = make()
    model = PPO("MlpPolicy", env, **settings).learn(9 * 6 * 2)
    model.save(tmp_path / "model")
    snapshot = env.snapshot()
    del model
    env.close()
    env = make()
    env.reset(seed=99)
    env.restore(snapshot)
    resumed = PPO.load(tmp_path / "model", env, force_reset=False)
    resumed.learn(9 * 6 * 3, reset_num_timesteps=False)
    assert_same(whole, resumed)


def test_a_checkpoint_within_a_training_resumes_to_the_same_bits(tmp_path):
    class Save(BaseCallback):
        def _on_step(self):
            return True

        def _on_rollout_start(self):
            if self.num_timesteps == 256:
                self.model.save(tmp_path / "model")
                (tmp_path / "snapshot").write_bytes(self.training_env.snapshot())

    whole = PPO("MlpPolicy", hover(), 1e-2, **SMALL).learn(512, callback=Save())
    env = hover()
    env.restore((tmp_path / "snapshot").read_bytes())
    resumed = PPO.load(tmp_path / "model", env, force_reset=False)
    assert_same(whole, resumed.learn(256, reset_num_timesteps=False))


def test_an_env_without_episodes_cannot_go_on(tmp_path):
    PPO("MlpPolicy", hover(), **SMALL).save(tmp_path / "model")
    for task in (flockstep.HoverConfig(), None):
        env = hover() if task else flockstep.DroneVectorEnv(4, task=ToTarget)
        with refused(ValueError, "force_reset=False"):
            (PPO.load(tmp_path / "model") if task else PPO("MlpPolicy", env, **SMALL)).set_env(env, force_reset=False)


def test_other_environments_cannot_go_on(tmp_path):
    small_model().save(tmp_path / "model")
    with refused(ValueError, "force_reset=False"):
        PPO.load(tmp_path / "model", Aim(4), force_reset=False)


def test_discounted_returns_begin_at_zero_with_the_episodes():
    """As in VecNormalize: what was earned before a reset does not count afterwards."""
    env = hover(max_episode_steps=1000)
    model = PPO("MlpPolicy", env, **OPTIONS, **SMALL).learn(16 * 8)
    assert model.learner.discounted_returns.any()
    model.learn(0)
    assert not model.learner.discounted_returns.any()


def test_learning_twice_equals_learning_once():
    """Without a reset in between, if no schedule depends on the total."""
    once = PPO("MlpPolicy", hover(), **SMALL).learn(512)
    twice = PPO("MlpPolicy", hover(), **SMALL).learn(256).learn(256, reset_num_timesteps=False)
    assert_same(once, twice)


# --- conversions

SUM_ERROR = 64 * 2.0**-24  # of 64 float32 products of at most 1 that are added in another order


def random_parameters(model):
    """Move a model away from its small initial actions."""
    random = np.random.default_rng(4)
    learner = model.learner
    learner.parameters = learner.parameters + 0.2 * random.normal(size=learner.parameters.size).astype(np.float32)
    return model


CONVERTED = {
    "numbers": (spaces.Box(-3, 3, (5,), np.float32), None, {}),
    "choices": (spaces.Box(-3, 3, (5,), np.float32), spaces.Discrete(4), {"activation_fn": "relu"}),
    "dict": (
        spaces.Dict([("z", spaces.Box(-3, 3, (2, 2), np.float32)), ("a", spaces.Box(-3, 3, (1,), np.float32))]),
        None,
        {"net_arch": {"pi": [7, 5], "vf": []}},
    ),
    "goal": (spaces.Box(0, 1, (9,), np.float32), spaces.Discrete(6), {"features_extractor_class": "GoalFeatures"}),
    "blob": (spaces.Box(0, 1, (9,), np.float32), None, {"features_extractor_class": flockstep.sb3.BlobFeatures}),
    "point": (spaces.Box(-1, 1, (9,), np.float32), None, {"features_extractor_class": "PointFeatures"}),
}


@pytest.mark.parametrize("normalizes", [False, True], ids=["plain", "normalized"])
@pytest.mark.parametrize("kind", CONVERTED)
def test_conversions_act_the_same(kind, normalizes, tmp_path):
    observation_space, action_space, arguments = CONVERTED[kind]
    if normalizes and kind in ("goal", "blob"):
        arguments = arguments | {"features_extractor_class": "PointFeatures"}  # others take logarithms of ranges
    env = Still(observation_space, action_space)
    is_dict = isinstance(observation_space, spaces.Dict)
    model = PPO(
        "MultiInputPolicy" if is_dict else "MlpPolicy",
        env,
        learning_rate=1e-3,
        policy_kwargs=arguments,
        normalize_observations=normalizes,
        **SMALL,
    )
    random_parameters(model.learn(64))
    theirs = model.to_sb3()
    theirs.save(tmp_path / "theirs")
    back = PPO.from_sb3(SB3.load(tmp_path / "theirs"))
    observation_space.seed(7)
    for _ in range(20):
        observation = observation_space.sample()
        batch = {name: part[None] for name, part in observation.items()} if is_dict else observation[None]
        expected = theirs.predict(observation, deterministic=True)[0]
        for ours in (model, back):
            got = ours.predict(observation, deterministic=True)[0]
            assert got.dtype == expected.dtype
            np.testing.assert_allclose(got, expected, rtol=0, atol=SUM_ERROR)
            value = theirs.policy.predict_values(theirs.policy.obs_to_tensor(batch)[0]).item()
            np.testing.assert_allclose(ours.learner.values(ours._rows(observation)[0]), value, rtol=0, atol=SUM_ERROR)
    assert_same_but_draws(model, back)
    for name in ("gamma", "n_steps", "batch_size", "n_epochs", "learning_rate", "clip_range", "normalize_observations"):
        assert getattr(back, name) == getattr(model, name), name


def assert_same_but_draws(one, other):
    np.testing.assert_array_equal(one.learner.parameters, other.learner.parameters)
    for expected, got in zip(one.learner.adam, other.learner.adam, strict=True):
        np.testing.assert_array_equal(got, expected)
    if one.normalize_observations:
        for expected, got in zip(one.learner.observation_moments, other.learner.observation_moments, strict=True):
            np.testing.assert_array_equal(got, expected)
    assert (one.num_timesteps, one._n_updates) == (other.num_timesteps, other._n_updates)


def test_training_goes_on_after_a_conversion():
    model = PPO("MlpPolicy", hover(), **SMALL).learn(256)
    theirs = model.to_sb3()
    theirs.set_env(flockstep.sb3.make_vec(hover()))
    theirs.learn(128, reset_num_timesteps=False)
    ours = PPO.from_sb3(theirs)
    assert ours.num_timesteps == 384
    assert ours.learn(128, reset_num_timesteps=False).num_timesteps == 512


@pytest.mark.parametrize(
    "changes",
    [
        {"optimizer_class": torch.optim.AdamW},
        {"optimizer_kwargs": {"weight_decay": 0.01}},
        {"optimizer_kwargs": {"eps": 1e-8}},
    ],
)
def test_other_optimizers_are_not_converted(changes):
    policy_kwargs = {"optimizer_kwargs": {"eps": 1e-5}} | changes
    theirs = SB3("MlpPolicy", DummyVecEnv([Still]), n_steps=8, batch_size=8, policy_kwargs=policy_kwargs)
    with refused(ValueError, "model", "Adam"):
        PPO.from_sb3(theirs)


def test_a_model_trained_by_sb3_with_vec_normalize_converts():
    envs = VecNormalize(DummyVecEnv([lambda: Monitor(Still())] * 2))
    theirs = SB3("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, clip_range_vf=0.3).learn(32)
    ours = PPO.from_sb3(theirs)
    assert (ours.clip_range, ours.clip_range_vf) == (0.2, 0.3)
    assert ours.get_vec_normalize_env() is envs
    observation = envs.reset()
    np.testing.assert_allclose(
        ours.predict(observation, deterministic=True)[0], theirs.predict(observation, deterministic=True)[0], atol=1e-6
    )
    ours.learn(32)


def test_evaluation_takes_a_model():
    model = PPO("MlpPolicy", hover(), **SMALL).learn(128)
    for each in (model, model.to_sb3()):
        evaluation = flockstep.sb3.evaluate(each, "flockstep/Hover-v0", episodes=4, max_episode_steps=9)
        assert evaluation.episodes == 4


def test_what_cannot_be_converted_is_refused():
    still = DummyVecEnv([Still])
    for model, message in (
        (SB3("MlpPolicy", still, use_sde=True, n_steps=8, batch_size=8), "use_sde=False"),
        (stable_baselines3.A2C("MlpPolicy", still), "expected a PPO of Stable-Baselines3, got A2C"),
        (
            SB3("MlpPolicy", still, n_steps=8, batch_size=8, policy_kwargs={"activation_fn": torch.nn.ELU}),
            "activation_fn",
        ),
        (
            SB3(
                "CnnPolicy",
                DummyVecEnv([lambda: Still(spaces.Box(0, 255, (3, 40, 40), np.uint8))]),
                n_steps=8,
                batch_size=8,
            ),
            "expected features of",
        ),
        (3, "expected a PPO of Stable-Baselines3, got int"),
    ):
        with pytest.raises(ValueError, match=message):
            PPO.from_sb3(model)
    with pytest.raises(ValueError, match="a Discrete that starts at 0"):
        PPO("MlpPolicy", Aim(4, is_discrete=True)).to_sb3()


# --- acting


def test_shapes_of_observations():
    model = PPO("MlpPolicy", Still(), **SMALL)
    assert model.predict(np.zeros(3))[0].shape == (2,)
    assert model.predict(np.zeros((4, 3)))[0].shape == (4, 2)
    assert model.predict(np.zeros((0, 3)))[0].shape == (0, 2)
    assert model.predict(np.zeros(3), state=(np.ones(1),))[1] == (np.ones(1),)
    for wrong in (np.zeros(2), np.zeros((4, 2)), np.zeros((1, 4, 3)), 0.0, "text", None, {"a": np.zeros(3)}):
        with pytest.raises((ValueError, TypeError)):
            model.predict(wrong)
    with refused(FloatingPointError, "observation", "nan in row 0"):
        model.predict(np.float32([0, np.nan, 0]))
    space = spaces.Dict({"a": spaces.Box(-1, 1, (2,), np.float32), "b": spaces.Box(-1, 1, (), np.float32)})
    model = PPO("MultiInputPolicy", Still(space), **SMALL)
    assert model.predict({"a": np.zeros(2), "b": np.float32(0)})[0].shape == (2,)
    assert model.predict({"b": np.zeros(4), "a": np.zeros((4, 2))})[0].shape == (4, 2)
    for wrong in ({"a": np.zeros(2)}, {"a": np.zeros((4, 2)), "b": np.zeros(3)}, np.zeros(3), {}):
        with refused(ValueError, "observation"):
            model.predict(wrong)


# --- what goes wrong


@pytest.mark.parametrize("bad", ["reward", "observation"])
@pytest.mark.parametrize("n_steps", [4, 5])  # with 5 the observation is the last of a rollout
def test_a_number_that_is_not_finite_stops_with_its_step(bad, n_steps):
    model = PPO("MlpPolicy", Aim(64, bad=bad), n_steps=n_steps, batch_size=64, n_epochs=1, seed=0, **OPTIONS)
    steps = 5 * 64 if bad == "reward" or n_steps == 5 else 6 * 64
    kept = []

    def keep(names, _):
        if names["self"].num_timesteps == 5 * 64:
            kept.extend([model.learner.parameters, *model.learner.observation_moments])

    message = (
        f"step {steps}: {bad}: expected finite numbers, got nan in row 7; the parameters are those of the last update"
    )
    with pytest.raises(FloatingPointError, match=re.escape(message)):
        model.learn(10_000, callback=keep)
    if bad == "observation":
        np.testing.assert_array_equal(model.learner.parameters, kept[0])
        for expected, got in zip(kept[1:], model.learner.observation_moments, strict=True):
            np.testing.assert_array_equal(got, expected)
    assert model._n_updates == (1 if n_steps == 4 else 0)
    for array in (model.learner.parameters, *model.learner.observation_moments[:2], model.learner.return_moments[1]):
        assert np.isfinite(array).all()
    model.learn(256)  # another training is not affected


def test_losses_that_are_not_finite_stop_with_the_step():
    model = PPO("MlpPolicy", Aim(64), 200.0, n_steps=4, batch_size=64, seed=0)
    with pytest.raises(FloatingPointError, match="step 256: the loss of an update is not finite"):
        model.learn(10_000)
    assert np.isfinite(model.learner.parameters).all()


def test_a_keyboard_interrupt_leaves_a_whole_model(tmp_path):
    model = PPO("MlpPolicy", hover(), **SMALL)

    def interrupt(names, _):
        if names["self"].num_timesteps == 16 * 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        model.learn(10_000, callback=interrupt)
    assert model.num_timesteps == 320
    model.save(tmp_path / "model")
    assert_same(model, PPO.load(tmp_path / "model"))
    assert model.learn(128, reset_num_timesteps=False).num_timesteps == 320 + 128


INTERRUPTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import numpy as np
import flockstep

envs = flockstep.DroneVectorEnv(256, task=flockstep.HoverConfig(), autoreset_mode="same_step", num_threads=2)
model = flockstep.PPO("MlpPolicy", envs, n_steps=64, batch_size=2048, n_epochs=20, seed=0)
model.learn(64 * 256)
print("begun", flush=True)
try:
    model.learn(10**12)
except KeyboardInterrupt:
    assert np.isfinite(model.learner.parameters).all()
    model.save(sys.argv[1])
    loaded = flockstep.PPO.load(sys.argv[1])
    assert (loaded.learner.parameters == model.learner.parameters).all()
    model.learn(64 * 256, reset_num_timesteps=False)
    print("interrupted", flush=True)
"""


def test_ctrl_c_leaves_a_whole_model(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", INTERRUPTED, tmp_path / "model"], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == "begun\n"
        time.sleep(0.3)
        child.send_signal(signal.SIGINT)
        out, _ = child.communicate(timeout=60)
        assert out == "interrupted\n"
        assert child.returncode == 0
    finally:
        child.kill()


def test_a_closed_env_is_refused():
    for env in (hover(), flockstep.DroneVectorEnv(2, task=ToTarget)):
        model = PPO("MlpPolicy", env, **SMALL).learn(16)
        env.close()
        for reset in (True, False):
            with refused(Exception, "closed"):
                model.learn(16, reset_num_timesteps=reset)
        model.predict(env.single_observation_space.sample())


def test_a_second_thread_is_refused_while_a_model_trains():
    model = PPO("MlpPolicy", hover(64), n_steps=64, batch_size=4096, n_epochs=10)
    refusals, stop = [], []
    thread = threading.Thread(target=model.learn, args=(10**9,), kwargs={"callback": lambda *_: not stop})

    def act():
        try:
            model.predict(np.zeros(16, np.float32))
        except RuntimeError as error:
            refusals.append(str(error))

    errors = []
    previous, threading.excepthook = threading.excepthook, lambda args: errors.append(args.exc_value)
    try:
        thread.start()
        ends = time.monotonic() + 20
        while not refusals and thread.is_alive() and time.monotonic() < ends:
            act()
        stop.append(True)
        thread.join()
    finally:
        threading.excepthook = previous
    # Either of the two threads may come second.
    texts = refusals + [str(error) for error in errors]
    assert texts
    assert all("this Learner is in use by another thread: one call at a time" in text for text in texts)
    act()


def test_a_forked_child_acts_with_its_own_copy(tmp_path):
    model = small_model()
    model.save(tmp_path / "model")
    child = os.fork()
    if child == 0:
        code = 1
        try:
            model.predict(np.zeros(1, np.float32))
        except RuntimeError as error:
            if "does not survive fork" in str(error):
                PPO.load(tmp_path / "model").predict(np.zeros(1, np.float32))
                code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_it_needs_no_pytorch():
    code = (
        "import sys, flockstep\n"
        "envs = flockstep.DroneVectorEnv(4, task=flockstep.HoverConfig())\n"
        "flockstep.PPO('MlpPolicy', envs, n_steps=8, policy_kwargs={'activation_fn': 'relu'}).learn(64)\n"
        "flockstep.success_rates(None, 'flockstep/Hover-v0')\n"
        "assert 'torch' not in sys.modules and 'stable_baselines3' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parent)
