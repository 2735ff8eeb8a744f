"""Running moments of the learner against VecNormalize's, and what it refuses."""

import functools
import threading
import time
from functools import partial

import gymnasium
import numpy as np
import pytest
from conftest import begun
from messages import refused
from ppo_models import ROWS, box, learner_of, make_learner, random_rollout
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import flockstep
from flockstep import _core

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
        with refused(FloatingPointError, "final_observation", "in row 2"):
            learner.record(0, np.zeros(3), no, ~no, wrong)
    after = learner.parameters, *learner.observation_moments, *learner.return_moments, learner.discounted_returns
    np.testing.assert_equal(state, after)


def test_actions_that_are_not_finite_are_refused():
    env = begun(2, task=flockstep.HoverConfig())
    learner = learner_of(env)
    parameters = learner.parameters
    parameters[:4] = 200  # standard deviations beyond float32
    learner.parameters = parameters
    learner.begin(_core.RolloutConfig(n_steps=2), 2)
    for call in (
        lambda: learner.act(0, np.ones((2, 16))),
        lambda: learner.sample(np.ones((2, 16))),
        lambda: learner.fly(0, env.batch),
    ):
        with refused(FloatingPointError, "action", "in row 0"):
            call()
    env.step(np.zeros((2, 4)))  # which still flies


def test_wrong_shapes_and_orders_of_calls_are_refused():
    learner = make_learner()
    good, no, none = np.ones((3, 5), np.float32), np.zeros(3, bool), np.zeros(3)
    wrong = functools.partial(refused, (ValueError, TypeError))
    with wrong("finish", 2048, 0):
        learner.finish(np.ones((0, 5)))
    with wrong("update", 0):
        learner.update(_core.UpdateConfig())
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    for shape in ((3, 4), (2, 5), (5,), (3, 5, 1)):
        with wrong("observation", (3, 5), shape):
            learner.act(0, np.ones(shape))
    for observation, got in (("text", "<U4"), (None, None), (good.astype(object), "object")):
        with wrong("observation", "real numbers", got):
            learner.act(0, observation)
    with wrong("t", 0, 1):
        learner.act(1, good)
    for skipped, got in ((np.zeros(2, bool), (2,)), (none, "float64"), ("no", "<U2")):
        with wrong("skipped", got):
            learner.act(0, good, skipped)
    learner.act(0, good)
    for field, array, got in (
        ("reward", np.zeros(2), (2,)),
        ("terminated", none, "float64"),
        ("truncated", np.zeros(4, bool), (4,)),
    ):
        with wrong(field, got):
            learner.record(0, **({"reward": none, "terminated": no, "truncated": no} | {field: array}))
    with wrong("final_observation"):
        learner.record(0, none, no, ~no)
    learner.record(0, none, no, no)
    with wrong("finish", 2, 1):
        learner.finish(good)
    learner.act(1, good)
    learner.record(1, none, no, no)
    learner.finish(good)
    with wrong("discounted_returns", 3, 2):
        learner.discounted_returns = [0.0, 1.0]
    for order in ([6], [-1], [0] * 7):
        with wrong("order", len(order)):
            learner.update(_core.UpdateConfig(n_epochs=2), order)
    for minibatch, got in (([], "float64"), ([6], "got 6"), ([-1], -1)):
        with wrong("minibatch", got):
            learner.gradient(_core.UpdateConfig(), minibatch)
    size = learner.parameters.size
    for parameters, said in ((none, (size, 3)), (np.full(size, np.nan), ("finite", np.nan))):
        with wrong("parameters", *said):
            learner.parameters = parameters
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    with wrong("batch", "a batch with a task"):
        learner.fly(0, flockstep.Batch("playground/train-1", 3))
    for task in (flockstep.HoverConfig(), None):
        env = begun(3, task=task)
        for call in (lambda env=env: learner.fly(0, env.batch), lambda env=env: learner.read_observation(env.batch)):
            with wrong("batch", 5):
                call()


def test_absurd_sizes_are_refused():
    with refused(ValueError, "16777216 parameters"):
        make_learner(actor_layers=[4096] * 1000)
    learner = make_learner()
    with refused(ValueError, "n_steps", 1 << 28, 1 << 48):
        learner.begin(_core.RolloutConfig(n_steps=1 << 24), 1 << 24)
    assert learner.rows == 0
    with refused(ValueError, "batch_size", 2, 1):
        make_learner().update(_core.UpdateConfig(batch_size=1))
    learner = make_learner(size=65536)
    learner.begin(_core.RolloutConfig(n_steps=2), 3)
    with pytest.raises(MemoryError):
        learner.begin(_core.RolloutConfig(n_steps=1 << 24), 16)
    assert learner.rows == learner.advantages.size == 0
    with refused(ValueError, "observation", (0, 65536)):
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
    with refused(FloatingPointError, "observation", "in row 0"):
        learner.finish(np.full((rows, size), np.nan, np.float32))
    with refused(ValueError, "update", 2):
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
        with refused(RuntimeError, "in use by another thread"):
            call()
    assert thread.is_alive()
    thread.join()
    learner.predict(np.ones((1, 5)))
