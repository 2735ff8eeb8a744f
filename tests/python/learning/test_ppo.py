"""flockstep.PPO against Stable-Baselines3's: keywords, training, acting, and what goes wrong."""

import inspect
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import stable_baselines3
import torch
import torch._dynamo  # which optimizers import; it derives a class from pickle.Unpickler, which a fixture replaces
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from messages import refused
from ppo_models import NET, OPTIONS, SMALL, Aim, Still, ToTarget, assert_same, hover, small_model
from scripted_episodes import ScriptedEpisodes
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

import flockstep
import flockstep.sb3
from flockstep import PPO
from flockstep.learning.sources import EngineSource, VectorEnvSource

SB3 = stable_baselines3.PPO
# Most rollouts of these tests are smaller than a minibatch.
pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")
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


def test_a_training_logs_what_sb3_logs():
    logged = []
    for kind in (SB3, PPO):
        model = kind("MlpPolicy", Still(), n_steps=8, batch_size=8, device="cpu").learn(16)
        logged.append({name for name in model.logger.name_to_value if name.startswith("train/")})
    assert logged[0] == logged[1]


def test_a_minibatch_larger_than_a_rollout_warns():
    with refused(UserWarning, "batch_size", 8, 9) as warned:
        PPO("MlpPolicy", Still(), n_steps=8, batch_size=9)
    assert warned[0].filename == __file__
    model = PPO("MlpPolicy", Still(), n_steps=8, batch_size=8)
    model.batch_size = 9
    with refused(UserWarning, "batch_size", 8, 9):
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
    for name in ("theirs", "theirs.zip"):
        with refused(ValueError, "theirs.zip", "Stable-Baselines3", "from_sb3", "runs code"):
            PPO.load(name)
    assert PPO.from_sb3(SB3.load("theirs.zip", device="cpu")).n_steps == 8


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


ELSEWHERE = "Stable-Baselines3"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"use_sde": True}, ("use_sde", ELSEWHERE)),
        ({"rollout_buffer_class": dict}, ("rollout_buffer_class", ELSEWHERE)),
        ({"rollout_buffer_kwargs": {"a": 1}}, ("rollout_buffer_kwargs",)),
        ({"_init_setup_model": False}, ("_init_setup_model",)),
        ({"device": "cuda"}, ("device", "cpu", "cuda")),
        ({"policy": "CnnPolicy"}, ("policy", "CnnPolicy", ELSEWHERE)),
        ({"policy": "MultiInputPolicy"}, ("policy", "MlpPolicy", "Box", "MultiInputPolicy")),
        ({"policy": "MlpLstmPolicy"}, ("policy", "MlpLstmPolicy", ELSEWHERE)),
        ({"policy": torch.nn.Module}, ("policy", ELSEWHERE)),
        ({"policy_kwargs": {"ortho_init": False}}, ("policy_kwargs", "ortho_init=True", ELSEWHERE)),
        ({"policy_kwargs": {"use_sde": True}}, ("policy_kwargs", "use_sde=False")),
        ({"policy_kwargs": {"optimizer_class": torch.optim.SGD}}, ("policy_kwargs", "optimizer_class=Adam")),
        ({"policy_kwargs": {"optimizer_kwargs": {"weight_decay": 1.0}}}, ("policy_kwargs", "optimizer_kwargs=None")),
        ({"policy_kwargs": {"net_arc": [3]}}, ("policy_kwargs", "net_arch")),
        ({"policy_kwargs": {"net_arch": [0]}}, ("net_arch",)),
        ({"policy_kwargs": {"net_arch": {"qf": [3]}}}, ("net_arch",)),
        ({"policy_kwargs": {"activation_fn": torch.nn.ELU}}, ("activation_fn", ELSEWHERE)),
        (
            {"policy_kwargs": {"features_extractor_class": flockstep.sb3.ImageFeatures}},
            ("features_extractor_class", ELSEWHERE),
        ),
        ({"policy_kwargs": {"log_std_init": np.nan}}, ("log_std_init",)),
        ({"n_steps": 0}, ("n_steps", 0)),
        ({"n_steps": 2.5}, ("n_steps", 2.5)),
        ({"batch_size": 1}, ("batch_size",)),
        ({"gamma": 1.5}, ("gamma", 1.5)),
        ({"learning_rate": -1.0}, ("learning_rate",)),
        ({"learning_rate": lambda _: np.nan}, ("learning_rate",)),
        ({"clip_range_vf": 0.0}, ("clip_range_vf",)),
        ({"target_kl": -1.0}, ("target_kl",)),
        ({"seed": -1}, ("seed", -1)),
        ({"seed": 1.5}, ("seed", 1.5)),
        ({"stats_window_size": 0}, ("stats_window_size", 0)),
        ({"num_threads": -1}, ("num_threads", -1)),
        ({"env": None}, ("env",)),
        ({"env": 3}, ("env", 3)),
        ({"env": Still(spaces.Box(0, 255, (16, 16, 3), np.uint8))}, ("observation", "image", ELSEWHERE)),
        ({"env": Still(spaces.Discrete(4))}, ("observation", ELSEWHERE)),
        ({"env": Still(None, spaces.MultiDiscrete([2, 3]))}, ("actions", ELSEWHERE)),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_the_learner_lacks_is_refused(changes, said):
    with refused((ValueError, TypeError), *said):
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
    def trained(threads, of_env=None):
        env = make(threads=of_env or threads)
        model = PPO("MlpPolicy", env, num_threads=threads, policy_kwargs=NET, **OPTIONS, **(SMALL | {"n_steps": 20}))
        return model.learn(20 * env.num_envs * 3)

    one = trained(1)
    for threads in (2, 7):
        assert_same(one, trained(threads))
    assert_same(one, trained(1, of_env=3))


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

    with refused(FloatingPointError, f"step {steps}: {bad}", "nan in row 7"):
        model.learn(10_000, callback=keep)
    if bad == "observation":
        np.testing.assert_array_equal(model.learner.parameters, kept[0])
        np.testing.assert_equal(kept[1:], model.learner.observation_moments)
    assert model._n_updates == (1 if n_steps == 4 else 0)
    for array in (model.learner.parameters, *model.learner.observation_moments[:2], model.learner.return_moments[1]):
        assert np.isfinite(array).all()
    model.learn(256)  # another training is not affected


def test_losses_that_are_not_finite_stop_with_the_step():
    model = PPO("MlpPolicy", Aim(64), 200.0, n_steps=4, batch_size=64, seed=0)
    with refused(FloatingPointError, "step 256", "loss"):
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
