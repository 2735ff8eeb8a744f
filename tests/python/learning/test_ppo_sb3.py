"""flockstep.PPO with callbacks, logs and seeds of Stable-Baselines3, and models converted to and from it."""

import io

import numpy as np
import pytest
import stable_baselines3
import torch
import torch._dynamo  # which optimizers import; it derives a class from pickle.Unpickler, which a fixture replaces
from gymnasium import spaces
from gymnasium.vector import SyncVectorEnv
from messages import refused
from ppo_models import SMALL, Aim, Still, ToTarget, hover, small_model
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CheckpointCallback,
    EvalCallback,
    StopTrainingOnMaxEpisodes,
    StopTrainingOnRewardThreshold,
)
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import flockstep
import flockstep.sb3
from flockstep import PPO

SB3 = stable_baselines3.PPO
REFUSED = "expected a model that PPO.save wrote"
# Most rollouts of these tests are smaller than a minibatch.
pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")
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
        with refused(TypeError, "own/list", "list"):
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


# --- seeds


@pytest.mark.parametrize(
    "wrap", [lambda env: env, lambda env: VecNormalize(env, norm_reward=False)], ids=["engine", "arrays"]
)
def test_seeds_given_to_a_vec_env_after_the_model_are_used(wrap):
    """As with Stable-Baselines3: each model begins where its environments begin with those seeds."""

    def begun(cls, seed, later=None):
        inner = hover_vec_env()
        vec_env = wrap(inner)
        model = cls("MlpPolicy", vec_env, n_steps=8, batch_size=48, seed=seed)
        if later is not None:
            vec_env.seed(later)
        model.learn(0)
        return places(inner)

    expected = places_of(1000)
    for cls in (PPO, SB3):
        assert (begun(cls, 0, 1000) == expected).all()
        assert (begun(cls, 1000) == expected).all()
        assert (begun(cls, 0) != expected).any()


def hover_vec_env():
    return flockstep.sb3.make_vec(hover(6))


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
    first, same, other = (
        PPO.load(tmp_path / "model", seed=seed).predict(observation)[0] for seed in (7, np.int64(7), 8)
    )
    assert (first == same).all()
    assert (first != other).any()
    with refused(ValueError, "seed"):
        PPO.load(tmp_path / "model", seed=-1)


def test_a_model_made_from_one_of_sb3_leaves_the_seeds_of_its_env():
    vec_env = hover_vec_env()
    theirs = SB3("MlpPolicy", vec_env, n_steps=8, batch_size=48, seed=0)
    vec_env.seed(1000)
    PPO.from_sb3(theirs).learn(0)
    assert (places(vec_env) == places_of(1000)).all()


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
    np.testing.assert_equal(one.learner.adam, other.learner.adam)
    if one.normalize_observations:
        np.testing.assert_equal(one.learner.observation_moments, other.learner.observation_moments)
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
    still, pixels = DummyVecEnv([Still]), DummyVecEnv([lambda: Still(spaces.Box(0, 255, (3, 40, 40), np.uint8))])
    small = {"n_steps": 8, "batch_size": 8}
    for model, *said in (
        (SB3("MlpPolicy", still, use_sde=True, **small), "model", "use_sde=False"),
        (stable_baselines3.A2C("MlpPolicy", still), "model", "A2C"),
        (SB3("MlpPolicy", still, **small, policy_kwargs={"activation_fn": torch.nn.ELU}), "activation_fn"),
        (SB3("CnnPolicy", pixels, **small), "model", "NatureCNN"),
        (3, "model", "int"),
    ):
        with refused(ValueError, *said):
            PPO.from_sb3(model)
    with refused(ValueError, "action_space", "Discrete(2, start=3)"):
        PPO("MlpPolicy", Aim(4, is_discrete=True)).to_sb3()
