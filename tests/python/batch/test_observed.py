"""History, past actions and delay of observations, against lists that hold everything an episode has observed."""

import math

import numpy as np
import pytest
from gymnasium import spaces
from messages import refused
from philox import named_stream, uniform
from simple_tasks import Climb

import flockstep
from flockstep import ObservationConfig

SEED = 5
ALL = ObservationConfig(history=3, past_actions=2, delay_s=0.05, jitter_s=0.08, age=True)  # 0.02 s a step


class Episode:
    """A drone's past, and what it should know of it."""

    def __init__(self, config, step_s, draw, first):
        self.config, self.step_s, self.draw = config, step_s, draw
        self.observed, self.times, self.actions = [first], [0], []

    def arrives(self, i):
        """The observation with which observation i arrives."""
        if i == 0:
            return 0
        late_s = float(np.float32(self.config.delay_s))
        if self.config.jitter_s:
            late_s += self.draw(i) * float(np.float32(self.config.jitter_s))
        return i + math.ceil(late_s / self.step_s - 1e-3)

    def known(self):
        """The agent's observation now."""
        now = len(self.observed) - 1
        shown = [
            max(i for i in range(max(k, 0) + 1) if self.arrives(i) <= max(k, 0))
            for k in range(now, now - self.config.history, -1)
        ]
        parts = [self.observed[i] for i in shown]
        nothing = np.zeros_like(self.actions[0]) if self.actions else None
        for k in range(self.config.past_actions):
            parts.append(self.actions[-1 - k] if k < len(self.actions) else nothing)
        if self.config.age:
            parts.append([0.0 if shown[0] == now else self.times[-1] - self.times[shown[0]]])
        return parts


def compare(observed, steps=45, mode="next_step", skip=1, **keywords):
    """Fly the same actions with and without a configuration; return how many episodes began."""
    keywords = {"autoreset_mode": mode, "frame_skip": skip, **keywords}
    plain = flockstep.DroneVectorEnv(3, **keywords)
    rich = flockstep.DroneVectorEnv(3, observed=observed, **keywords)
    rows, members = plain.num_envs, plain.num_envs // 3
    tick_s = 1 / plain.batch.clock.policy_hz
    space = plain.single_action_space
    discrete = isinstance(space, spaces.Discrete)
    width = space.n if discrete else space.shape[0]
    assert rich.single_observation_space.dtype == np.float32

    def begin(row, first):
        env, member = divmod(row, members)
        own = plain.batch.own_episodes[row] if members > 1 and keywords.get("episodes") == "each" else 0
        episode = int(plain.batch.episode[env] + own)
        draw = lambda i: uniform(SEED + env, episode, named_stream("observation"), i, member)  # noqa: E731
        return Episode(observed, tick_s * skip, draw, first)

    def check(row, shown):
        expected = [part if part is not None else np.zeros(width) for part in episodes[row].known()]
        np.testing.assert_array_equal(shown, np.float32(np.concatenate(expected)), err_msg=f"row {row}")
        assert rich.single_observation_space.contains(shown)

    rng = np.random.default_rng(0)
    (first, _), (shown, _) = plain.reset(seed=SEED), rich.reset(seed=SEED)
    episodes = [begin(row, first[row].copy()) for row in range(rows)]
    for row in range(rows):
        check(row, shown[row])
    begun, over = 0, np.zeros(rows, bool)
    for _ in range(steps):
        actions = rng.integers(width, size=rows) if discrete else np.float32(rng.uniform(-1.4, 1.4, (rows, width)))
        raw, *flags = plain.step(actions)
        shown, *others = rich.step(actions)
        for ours, theirs in zip(flags[:3], others[:3], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        done = flags[1] | flags[2]
        ended = np.flatnonzero(done & ~over)
        raw_final = dict(zip(ended, plain.final_observations(ended), strict=True))
        final = dict(zip(ended, rich.final_observations(ended), strict=True))
        for row in range(rows):
            if over[row]:  # this step only began the next episode
                episodes[row] = begin(row, raw[row].copy())
                begun += 1
                check(row, shown[row])
                continue
            episode = episodes[row]
            action = np.eye(width)[actions[row]] if discrete else np.clip(actions[row], -1, 1)
            episode.actions.append(action)
            episode.observed.append(raw_final[row] if done[row] else raw[row].copy())
            took = int(plain.batch.episode_length[row]) * tick_s
            episode.times.append(took)
            if done[row]:
                check(row, final[row])
                if mode == "same_step":
                    episodes[row] = begin(row, raw[row].copy())
                    begun += 1
            check(row, shown[row])
        over = done & (mode == "next_step")
    return begun


HOVER = {"task": flockstep.HoverConfig(), "max_episode_steps": 13, "policy_hz": 50}


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
@pytest.mark.parametrize("threads", [1, 2])
def test_observations_are_those_of_lists(mode, threads):
    assert compare(ALL, mode=mode, num_threads=threads, block_size=1, **HOVER) > 3


@pytest.mark.parametrize(
    "observed",
    [
        ObservationConfig(history=4),
        ObservationConfig(past_actions=3),
        ObservationConfig(delay_s=0.041),
        ObservationConfig(delay_s=0.06, history=2, age=True),
        ObservationConfig(jitter_s=0.5, age=True),
    ],
    ids=["history", "past_actions", "delay", "delay_of_a_history", "jitter"],
)
def test_each_field_alone(observed):
    assert compare(observed, mode="same_step", **HOVER) > 3


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
@pytest.mark.parametrize("episodes", ["team", "each"])
def test_several_drones_in_an_env(mode, episodes):
    swap = {"task": flockstep.SwapConfig(), "drones_per_env": 2, "max_episode_steps": 9, "stagger_first_episode": True}
    observed = ObservationConfig(history=2, past_actions=2, delay_s=0.1, jitter_s=0.3, age=True)
    assert compare(observed, mode=mode, episodes=episodes, steps=30, **swap) > 6


def test_frames_are_skipped():
    observed = ObservationConfig(history=2, past_actions=1, delay_s=0.1, age=True)
    assert compare(observed, skip=3, mode="same_step", **HOVER) > 3


def test_a_discrete_action_is_one_number_for_each_choice():
    assert compare(ObservationConfig(past_actions=2, history=2), max_episode_steps=6) > 3


def test_the_default_changes_nothing():
    plain = flockstep.DroneVectorEnv(2, **HOVER)
    other = flockstep.DroneVectorEnv(2, observed=ObservationConfig(), **HOVER)
    assert plain.single_observation_space == other.single_observation_space
    for env in (plain, other):
        env.reset(seed=1)
    for _ in range(20):
        actions = plain.action_space.sample()
        np.testing.assert_array_equal(plain.step(actions)[0], other.step(actions)[0])


def test_a_snapshot_of_other_observations_is_refused():
    env, without = (flockstep.DroneVectorEnv(2, **more, **HOVER) for more in ({"observed": ALL}, {}))
    env.reset(seed=2)
    with refused(ValueError, "snapshot", "differs in observed"):
        without.restore(env.snapshot())


def test_a_reset_of_some_envs_leaves_the_others():
    env = flockstep.DroneVectorEnv(3, observed=ObservationConfig(history=3, past_actions=2), **HOVER)
    env.reset(seed=2)
    for _ in range(5):
        shown = env.step(np.full((3, 4), 0.3, np.float32))[0].copy()
    env.batch.reset(mask=[False, True, False])
    again = env.observation()
    np.testing.assert_array_equal(again[[0, 2]], shown[[0, 2]])
    parts = np.split(again[1, :-8], 3)
    np.testing.assert_array_equal(parts[1], parts[0])
    np.testing.assert_array_equal(parts[2], parts[0])
    np.testing.assert_array_equal(again[1, -8:], 0)
    assert (shown[:, -8:] == np.float32(0.3)).all()


def test_drones_come_and_go():
    config = ObservationConfig(history=2, past_actions=1)
    env = flockstep.DroneVectorEnv(
        1, task=flockstep.SwapConfig(), drones_per_env=3, episodes="each", max_episode_steps=0, observed=config
    )
    env.reset(seed=1)
    absent = env.batch.observation[1] * 0
    for _ in range(3):
        env.step(np.full((3, *env.single_action_space.shape), 0.5, np.float32))
    where = env.batch.position[1].copy()
    env.batch.remove([1])
    np.testing.assert_array_equal(env.batch.observation[1], absent)
    env.step(np.full((3, *env.single_action_space.shape), 0.5, np.float32))
    np.testing.assert_array_equal(env.batch.observation[1], absent)
    env.batch.spawn([1], [where])
    row, size = env.batch.observation[1], env.single_action_space.shape[0]
    now, before = np.split(row[:-size], 2)
    assert now.any()
    np.testing.assert_array_equal(now, before)
    np.testing.assert_array_equal(row[-size:], 0)
    assert (env.batch.observation[0, -size:] == 0.5).all()


def test_tasks_in_python(room):
    bare, env = (flockstep.DroneVectorEnv(2, task=Climb, worlds=room, **given) for given in ({}, {"observed": ALL}))
    assert env.single_observation_space.shape == (3 * 4 + 2 * bare.single_action_space.shape[0] + 1,)
    assert compare(ALL, mode="same_step", task=Climb, worlds=room) > 3


def test_images_are_joined_along_their_first_axis():
    keywords = {"observation": "pixels", "seed": None}
    keywords.pop("seed")
    plain = flockstep.DroneVectorEnv(1, **keywords)
    env = flockstep.DroneVectorEnv(1, observed=ObservationConfig(history=2, past_actions=3, age=True), **keywords)
    space, was = env.single_observation_space, plain.single_observation_space
    assert set(space) == {*was, "past_actions", "age_s"}
    raw = [{name: part.copy() for name, part in plain.reset(seed=1)[0].items()}]
    env.reset(seed=1)
    for action in (0, 2):
        raw.append({name: part.copy() for name, part in plain.step([action])[0].items()})
        shown = env.step([action])[0]
    for name in was:
        np.testing.assert_array_equal(shown[name], np.concatenate([raw[2][name], raw[1][name]], axis=1))
    taken = np.zeros((3, plain.single_action_space.n))
    taken[0, 2] = taken[1, 0] = 1
    np.testing.assert_array_equal(shown["past_actions"][0], taken.ravel())
    assert shown["age_s"] == 0
    assert env.observation_space.contains(shown)


def test_learners_see_the_longer_observation():
    from stable_baselines3 import PPO

    import flockstep.sb3

    env = flockstep.DroneVectorEnv(4, observed=ALL, autoreset_mode="same_step", **HOVER)
    size = env.single_observation_space.shape[0]
    ours = flockstep.PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, normalize_observations=True, seed=1)
    ours.learn(128)
    assert ours.observation_space.shape == (size,)
    wrapped = flockstep.sb3.DroneVecEnv(flockstep.DroneVectorEnv(2, observed=ALL, autoreset_mode="same_step", **HOVER))
    theirs = PPO("MlpPolicy", wrapped, n_steps=16, batch_size=32, n_epochs=1, device="cpu", seed=1).learn(32)
    assert theirs.policy.observation_space.shape == (size,)


def test_what_has_no_place_is_refused(room):
    class Image(Climb):
        observation_space = spaces.Box(0, 255, (3, 4, 4), np.uint8)

        def observe(self, batch):
            return np.zeros((batch.num_drones, 3, 4, 4), np.uint8)

    for name, value in (("past_actions", 2), ("age", True)):
        with refused(ValueError, f"observed.{name}", "vector of floats", value):
            flockstep.DroneVectorEnv(1, task=Image, worlds=room, observed=ObservationConfig(**{name: value}))
    env = flockstep.DroneVectorEnv(1, task=Image, worlds=room, observed=ObservationConfig(history=5))
    assert env.single_observation_space.shape == (15, 4, 4)


def test_a_bad_observation_ends_its_episode_at_once(room):
    class Breaks(Climb):
        def observe(self, batch):
            seen = super().observe(batch)
            seen[batch.steps == 3] = np.nan
            return seen

    env = flockstep.DroneVectorEnv(
        1, task=Breaks, worlds=room, observed=ObservationConfig(history=2, delay_s=0.3), autoreset_mode="same_step"
    )
    env.reset(seed=1)
    still = np.zeros((1, *env.single_action_space.shape), np.float32)
    ends = [bool(env.step(still)[2][0]) for _ in range(2)]
    with pytest.warns(RuntimeWarning, match="is nan in env 0"):
        ends.append(bool(env.step(still)[2][0]))
    assert ends == [False, False, True]
    assert env.batch.bad_state[0]
