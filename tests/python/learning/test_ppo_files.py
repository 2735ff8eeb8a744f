"""Files of flockstep.PPO: what they hold, hostile ones, and trainings that go on from them."""

import io
import json
import pickle
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
import stable_baselines3
from gymnasium import spaces
from messages import refused
from ppo_models import NET, OPTIONS, SMALL, Aim, Still, ToTarget, assert_same, hover, small_model
from stable_baselines3.common.callbacks import (
    BaseCallback,
)

import flockstep
import flockstep.sb3
from flockstep import PPO

SB3 = stable_baselines3.PPO
REFUSED = "expected a model that PPO.save wrote"
# Most rollouts of these tests are smaller than a minibatch.
pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")
# --- files


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
    with refused(TypeError, "load", "learning_rat", "learning_rate"):
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
        with refused(ValueError, "learning_rate", "function"):
            PPO.load(tmp_path / name, env=model.get_env())
    flies.set_env(model.get_env())
    with refused(ValueError, "learning_rate", "function"):
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
    kind = "MultiInputPolicy" if isinstance(space, spaces.Dict) else "MlpPolicy"
    model = PPO(kind, Still(space, action), **SMALL)
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
            failures += REFUSED in str(error)
        else:
            assert_same(expected, model)
            equal += 1
    assert failures + equal == len(positions)
    assert failures > 0.5 * len(positions)


def test_truncated_files_are_refused(content, tmp_path):
    for length in [*range(0, len(content), 61), len(content) - 1]:
        with refused(ValueError, REFUSED):
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
        with refused(ValueError, "checksum"):
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
    with refused(ValueError, REFUSED):
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
    with refused(ValueError, "expected no compression"):
        PPO.load(tmp_path / "large")
    (tmp_path / "text.zip").write_text("text")
    with refused(ValueError, REFUSED):
        PPO.load(tmp_path / "text")
    with zipfile.ZipFile(tmp_path / "deep.zip", "w") as archive:
        archive.writestr("model.json", "[" * 100_000)
    with refused(ValueError, REFUSED):
        PPO.load(tmp_path / "deep")


# --- checkpoints


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
    python = flockstep.DroneVectorEnv(4, task=ToTarget)
    for model, env in (
        (PPO.load(tmp_path / "model"), hover()),
        (PPO("MlpPolicy", python, **SMALL), python),
        (small_model(), Aim(4)),  # of another kind
    ):
        with refused(ValueError, "force_reset=False"):
            model.set_env(env, force_reset=False)


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
