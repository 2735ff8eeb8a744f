"""Episodes of several drones in an env: each by itself, or resting until the last has ended, against single envs."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from messages import refused

import flockstep
from flockstep.testing import check_vector_env

E, M = 4, 3
N = E * M
VALUES = ("reward_terms", "episode_return", "episode_length", "success", "crashed", "episode_end", "episode_terms")
VALUES += ("position",)


def envs(num_envs: int = E, **keywords: Any) -> flockstep.DroneVectorEnv:
    return flockstep.DroneVectorEnv(num_envs, drones_per_env=M, **keywords)


def actions_of(env: Any, steps: int, rows: int = N) -> Any:
    """Return actions (steps, rows, ...), whose columns do not depend on the number of rows."""
    space = env.single_action_space
    if isinstance(space, gymnasium.spaces.Discrete):
        columns = [np.random.default_rng([3, row]).integers(space.n, size=steps // 15 + 1) for row in range(rows)]
        return np.repeat(columns, 15, axis=1)[:, :steps].T  # long ways, which end at walls
    columns = [np.random.default_rng([3, row]).uniform(-1, 1, (steps, *space.shape)) for row in range(rows)]
    return np.stack(columns, 1).astype(np.float32)


def history(env: Any, steps: int, seed: int = 5, actions: Any = None) -> dict[str, Any]:
    """Return every value of every step, (steps, rows, ...). With autoreset disabled it resets the ended rows."""
    actions = actions_of(env, steps, env.num_envs) if actions is None else actions
    env.reset(seed=seed)
    rows: dict[str, list[Any]] = {}
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        ended = terminated | truncated
        values = {"observation": observation, "reward": reward, "terminated": terminated, "truncated": truncated}
        values |= {name: getattr(env.batch, name).copy() for name in VALUES}
        values["active"] = env.batch.active.copy()
        values["final"] = np.where(ended[:, None], env.batch.final_observation, 0)
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
        if env.autoreset_mode.value == "Disabled" and ended.any():
            env.reset(options={"reset_mask": ended})
    return {name: np.stack(values) for name, values in rows.items()}


class Walk(flockstep.Task):
    """Ends when a drone has gone 1 m from its random start."""

    observation_space = gymnasium.spaces.Box(-40, 40, (4,), np.float32)
    worlds = "playground/train-1"
    max_episode_steps = 30
    info_names = ("way",)

    def setup(self, batch: flockstep.Batch) -> None:
        self.start = np.zeros((batch.num_drones, 3), np.float32)

    def reset(self, batch: flockstep.Batch, mask: Any) -> None:
        rows = np.flatnonzero(mask)
        np.testing.assert_array_equal(np.sort(batch.rows), rows)
        draws = batch.random(0, 3, batch.rows, row_kind="drone")
        self.start[batch.rows] = batch.position[batch.rows] * 0 + [1, 1, 1] + draws
        batch.set_pose(self.start[batch.rows], rows=batch.rows)

    def step(self, batch: flockstep.Batch) -> Any:
        way = np.linalg.norm(batch.position - self.start, axis=1)
        self.info["way"] = np.where(self.flying, way, self.info["way"])
        return way, (way > 1) & self.flying

    def observe(self, batch: flockstep.Batch) -> Any:
        return np.column_stack([batch.position, self.steps]).astype(np.float32)


# ---------------------------------------------------------------------------------------------------- each


@pytest.mark.parametrize("frame_skip", [1, 3])
def test_each_drone_has_the_episodes_of_a_single_env(mode: str, frame_skip: int) -> None:
    """All begin at the start marker: each drone of an env flies as the single env with its actions does."""
    keywords: dict[str, Any] = {"autoreset_mode": mode, "max_episode_steps": 40, "frame_skip": frame_skip}
    env = envs(episodes="each", **keywords)
    actions = actions_of(env, 120)
    got = history(env, 120, actions=actions)
    ends = []
    for member in range(M):
        single = flockstep.DroneVectorEnv(E, **keywords)
        expected = history(single, 120, actions=actions[:, member::M])
        np.testing.assert_equal({name: values[:, member::M] for name, values in got.items()}, expected)
        ends.append(expected["terminated"] | expected["truncated"])
    assert np.min(np.sum(ends, axis=1)) >= 2, "several episodes"
    assert (np.any(ends, axis=0) != np.all(ends, axis=0)).sum() > 2 * E, "they end at different times"


@pytest.mark.parametrize(
    "keywords",
    [
        {"random_start": True, "worlds": "train", "max_episode_steps": 30},
        {"task": flockstep.HoverConfig(), "max_episode_steps": 60},
        {"task": flockstep.TrackConfig(path="random"), "max_episode_steps": 60},
        {"task": flockstep.RaceConfig(), "max_episode_steps": 60},
        {"task": flockstep.DodgeConfig(), "worlds": "playground/train-1", "max_episode_steps": 40},
    ],
    ids=["navigation", "hover", "track", "race", "dodge"],
)
def test_the_first_of_each_equals_the_single_env(mode: str, keywords: dict[str, Any]) -> None:
    """Starts are random. The first drone of an env has the random numbers of the single env."""
    env = envs(episodes="each", autoreset_mode=mode, **keywords)
    actions = actions_of(env, 150)
    got = history(env, 150, actions=actions)
    single = flockstep.DroneVectorEnv(E, autoreset_mode=mode, **keywords)
    expected = history(single, 150, actions=actions[:, ::M])
    np.testing.assert_equal({name: values[:, ::M] for name, values in got.items()}, expected)
    assert env.batch.own_episodes[::M].tolist() == single.batch.episode.tolist()
    assert min(single.batch.episode) >= 2
    assert not env.batch.episode.any(), "the env goes on"
    assert env.batch.active.all() and not env.batch.finished.any()


NOISY: dict[str, Any] = {
    "task": flockstep.HoverConfig(),
    "wind": flockstep.WindConfig(gusts="dryden"),
    "imu": flockstep.ImuConfig(gyroscope_noise_density=0.1, accelerometer_random_walk=0.1, rate_hz=250),
    "pose_sensor": flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=1, rate_hz=25),
    "physics_hz": 500,
    "max_episode_steps": 70,
}


def test_what_each_drone_does_is_independent_of_the_others() -> None:
    env, other = (envs(episodes="each", autoreset_mode="same_step", **NOISY) for _ in range(2))
    actions = actions_of(env, 200)
    changed = actions.copy()
    changed[:, 0::M] *= -1
    changed[:, 2::M] *= 0.1
    first, second = history(env, 200, actions=actions), history(other, 200, actions=changed)
    np.testing.assert_equal(*({name: values[:, 1::M] for name, values in run.items()} for run in (first, second)))
    assert not np.array_equal(first["terminated"][:, ::M], second["terminated"][:, ::M])
    begins = first["terminated"] | first["truncated"]
    starts = first["position"][begins]
    assert len(np.unique(starts, axis=0)) == len(starts) > 2 * N, "every episode begins elsewhere"


def test_bodies_and_clock_of_an_env_go_on_while_each_drone_begins() -> None:
    motion = flockstep.BodyMotion(velocity_mps=(0.1, 0, 0))
    body = flockstep.BodyConfig(shape="sphere", position_m=(1, 0, 1.5), motion=motion)
    env = envs(2, episodes="each", autoreset_mode="same_step", max_episode_steps=7, bodies=body)
    env.reset(seed=0)
    for step in range(1, 30):
        env.step(np.arange(2 * M) % 6)
        assert env.batch.tick.tolist() == [step] * 2
        np.testing.assert_allclose(env.batch.bodies.position[:, 0, 0], 1 + 0.01 * step, atol=1e-5)
    env.reset()
    assert env.batch.tick.tolist() == [0, 0]
    assert env.batch.episode.tolist() == [1, 1]
    np.testing.assert_allclose(env.batch.bodies.position[:, 0, 0], 1)


def test_a_mask_begins_the_episodes_of_single_drones() -> None:
    env = envs(episodes="each", autoreset_mode="disabled", random_start=True, worlds="train")
    first, _ = env.reset(seed=1)
    for _ in range(3):
        before, *_ = env.step(np.zeros(N, int))
    mask = np.arange(N) == 4
    after, _ = env.reset(options={"reset_mask": mask})
    assert env.batch.steps.tolist() == np.where(mask, 0, 3).tolist()
    assert env.batch.own_episodes.tolist() == mask.astype(int).tolist()
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert not np.array_equal(after[4], before[4]) and not np.array_equal(after[4], first[4])
    with refused(ValueError, "options['reset_mask']", 3, "one seed"):
        env.reset(seed=2, options={"reset_mask": mask})
    again, _ = env.reset(seed=1)
    np.testing.assert_array_equal(again, first)
    env.reset()
    assert env.batch.episode.tolist() == [1] * E


@pytest.mark.parametrize("kind", ["navigation", "hover", "own"])
def test_a_removed_drone_comes_back_while_its_env_flies(kind: str, mode: str) -> None:
    """It begins its next episode at the given place, and the others fly as if nothing had happened."""
    tasks: dict[str, dict[str, Any]] = {
        "navigation": {"worlds": "playground/train-1", "max_episode_steps": 30},
        "hover": {**NOISY, "max_episode_steps": 30},
        "own": {"task": Walk},
    }
    env, other = (envs(2, episodes="each", autoreset_mode=mode, **tasks[kind]) for _ in range(2))
    env.reset(seed=3)
    other.reset(seed=3)
    actions = actions_of(env, 60, 2 * M)
    rest = np.arange(2 * M) != 1
    for step, action in enumerate(actions):
        if step == 5:
            env.batch.remove([1])
        if step == 10:
            episode = int(env.batch.own_episodes[1])
            place = env.batch.position[1] + [0.1, 0, 0.2]
            assert env.batch.spawn([1], [place]).tolist() == [1]
            if kind != "own":  # which places drones itself
                np.testing.assert_allclose(env.batch.position[1], place, atol=1e-6)
            assert env.batch.active[1] and env.batch.own_episodes[1] == episode + 1
            assert env.batch.steps[1] == 0 and not env.batch.waiting[1]
            assert np.isfinite(env.observation()).all()
            if kind == "navigation":
                assert env.batch.lidar().ranges[1].min() < 3
        a, b = env.step(action), other.step(action)
        for mine, others in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(mine[rest], others[rest])
        if 5 <= step < 10:
            assert env.batch.waiting[1] and not env.batch.flying[1]
        elif step == 10:
            assert env.batch.flying[1] and env.batch.steps[1] == 1
        ended = (a[2] | a[3]) & rest
        if mode == "disabled" and ended.any():
            env.reset(options={"reset_mask": ended})
            other.reset(options={"reset_mask": ended})
    assert env.batch.tick.tolist() == other.batch.tick.tolist()


def test_drones_that_begin_together_are_spawned_together() -> None:
    for episodes in ("team", "last"):
        env = envs(2, episodes=episodes, worlds="playground/train-1")
        env.reset(seed=0)
        env.step(np.zeros(2 * M, int))
        env.batch.remove([1])
        before = env.snapshot()
        with refused(ValueError, "indices (row 0)", "all drones of an env"):
            env.batch.spawn([1], [[1, 1, 1]])
        assert env.snapshot() == before
        assert env.batch.spawn([0, 1, 2], env.batch.position[:3]).tolist() == [0, 1, 2]
        assert env.batch.steps.tolist() == [0] * M + [1] * M
    env = envs(1, episodes="last", max_episode_steps=50)
    env.reset(seed=0)
    for action in actions_of(env, 100, M):
        env.step(action)
        if env.batch.finished.any():
            break
    flying, resting = np.flatnonzero(env.batch.active), np.flatnonzero(env.batch.finished)
    for some in (flying, resting):
        with refused(ValueError, "indices", "all drones of an env"):
            env.batch.spawn(some, env.batch.position[some])
    env.batch.spawn(np.arange(M), env.batch.position)
    assert env.batch.active.all() and not env.batch.finished.any()
    assert env.batch.steps.tolist() == [0] * M


# ---------------------------------------------------------------------------------------------------- last

ABSENT = np.array([0] * 3 + [1] * 35, np.float32)


def reference_of_last(actions: Any, mode: str, **keywords: Any) -> Any:
    """Yield the expected results of each step, from M single envs whose books are kept here.

    All begin at the start marker, so that the drones of an env begin as a single env does.
    """
    singles = [flockstep.DroneVectorEnv(E, autoreset_mode="disabled", **keywords) for _ in range(M)]
    for single in singles:
        single.reset(seed=5)
    over = np.zeros((E, M), bool)  # the episode of the drone has ended
    for action in actions:
        expected: dict[str, Any] = {
            "observation": np.tile(ABSENT, (E, M, 1)),
            "final": np.zeros((E, M, 38), np.float32),
            "reward": np.zeros((E, M), np.float32),
            "terminated": np.zeros((E, M), bool),
            "truncated": np.zeros((E, M), bool),
            "flying": np.zeros((E, M), bool),
            "return": np.zeros((E, M)),
        }

        def begin(expected: dict[str, Any], which: Any) -> None:
            for member, single in enumerate(singles):
                observation, _ = single.reset(options={"reset_mask": which})
                expected["observation"][which, member] = observation[which]
            over[which] = False

        begins = over.all(axis=1)  # next-step autoreset: this step only resets
        if begins.any():
            begin(expected, begins)
        for member, single in enumerate(singles):
            observation, reward, terminated, truncated, infos = single.step(action[member::M])
            flies = ~over[:, member] & ~begins
            ended = (terminated | truncated) & flies
            expected["flying"][:, member] = flies
            for name, values in (("reward", reward), ("terminated", terminated), ("truncated", truncated)):
                expected[name][flies, member] = values[flies]
            expected["observation"][flies, member] = observation[flies]
            expected["final"][ended, member] = observation[ended]
            if ended.any():
                expected["return"][ended, member] = infos["episode_return"][ended]
            if begins.any():  # undo the step of those that have only been reset
                single.reset(seed=[5] * E, options={"reset_mask": begins})
            over[:, member] |= ended
        if mode != "next_step":
            expected["observation"][over] = ABSENT
            if over.all(axis=1).any():
                begin(expected, over.all(axis=1))
        yield expected, over.copy()


def test_ended_drones_rest_until_the_last_has_ended(mode: str) -> None:
    keywords: dict[str, Any] = {"max_episode_steps": 40}
    env = envs(episodes="last", autoreset_mode=mode, **keywords)
    actions = actions_of(env, 250)
    env.reset(seed=5)
    rests = 0
    for action, (expected, over) in zip(actions, reference_of_last(actions, mode, **keywords), strict=True):
        observation, reward, terminated, truncated, infos = env.step(action)
        ended = terminated | truncated
        flat = {name: values.reshape(N, *values.shape[2:]) for name, values in expected.items()}
        final = np.where(ended[:, None], env.batch.final_observation, 0)
        np.testing.assert_array_equal(reward, flat["reward"])
        np.testing.assert_array_equal(terminated, flat["terminated"])
        np.testing.assert_array_equal(truncated, flat["truncated"])
        np.testing.assert_array_equal(final, flat["final"])
        np.testing.assert_array_equal(env.batch.flying, flat["flying"])
        is_over = over.all(axis=1, keepdims=True)
        np.testing.assert_array_equal(env.batch.active.reshape(E, M), ~over | is_over)
        np.testing.assert_array_equal(env.batch.finished.reshape(E, M), over & ~is_over)
        assert ("finished" in infos) == (~flat["flying"]).any()
        if "finished" in infos:
            np.testing.assert_array_equal(infos["finished"], ~flat["flying"])
        if ended.any():
            stats = infos["final_info"] if mode == "same_step" else infos
            np.testing.assert_array_equal(stats["_episode_return"], ended)
            np.testing.assert_array_equal(stats["episode_return"], flat["return"])
        if mode == "disabled" and ended.any():
            observation, _ = env.reset(options={"reset_mask": ended})
        np.testing.assert_array_equal(observation, flat["observation"])
        rests += int((~flat["flying"]).sum())
    assert rests > 100
    assert env.batch.episode.max() >= 2 and not env.batch.own_episodes.any()


def test_with_autoreset_disabled_flags_repeat_until_the_reset() -> None:
    env = envs(1, episodes="last", autoreset_mode="disabled", max_episode_steps=50)
    env.reset(seed=0)
    ended = np.zeros(M, bool)
    for action in actions_of(env, 100, M):
        before = ended
        _, reward, terminated, truncated, _ = env.step(action)
        ended = terminated | truncated
        assert (ended >= before).all() and not reward[before].any()
        if ended.any() and not ended.all():
            with refused(ValueError, "mask", "env 0"):
                env.reset(options={"reset_mask": ~ended})
    assert ended.all() and env.batch.active.all()
    observation, _ = env.reset(options={"reset_mask": np.ones(M, bool)})
    assert env.batch.episode.tolist() == [1]
    np.testing.assert_array_equal(observation[0], observation[2])


def test_a_resting_drone_is_not_sensed_and_a_reset_wakes_it() -> None:
    env = envs(2, episodes="last", max_episode_steps=60)
    env.reset(seed=0)
    actions = iter(actions_of(env, 300, 2 * M))
    while not env.batch.finished.any():
        env.step(next(actions))
    row = int(np.flatnonzero(env.batch.finished)[0])
    env.step(next(actions))
    assert env.batch.finished[row] and not env.batch.active[row]
    assert np.isinf(env.batch.lidar().ranges[row]).all()
    position = env.batch.position[row].copy()
    env.step(next(actions))
    np.testing.assert_array_equal(env.batch.position[row], position)
    env.reset()
    assert env.batch.active.all() and not env.batch.finished.any()
    assert np.isfinite(env.batch.observation).all() and env.batch.lidar().ranges[row].min() < 3


def test_removing_the_last_flying_drone_ends_the_episode() -> None:
    batch = flockstep.Batch(
        flockstep.scenes.load("train"),
        2 * M,
        drones_per_env=M,
        lidar=flockstep.LidarConfig(),
        task=flockstep.NavigationConfig(),
        episode=flockstep.EpisodeConfig(episodes="last", max_episode_steps=0),
    )
    batch.reset(np.arange(2))
    crash = np.array([5, 5, 0] * 2)  # the first two fly to the ground
    for step in range(40):
        crash[2::M] = step % 2  # forward and back
        batch.step(crash)
    assert batch.finished.tolist() == [True, True, False] * 2
    batch.remove([2])
    assert batch.active[:3].tolist() == [True, True, False]
    batch.step(crash)
    assert batch.episode.tolist() == [1, 0]
    assert batch.steps[:2].tolist() == [0, 0]
    batch.step(crash)
    assert batch.steps[:2].tolist() == [1, 1] and not batch.reward[2]


# ---------------------------------------------------------------------------------------------------- both


@pytest.mark.parametrize("episodes", ["each", "last"])
def test_one_drone_is_the_same_in_all_modes(mode: str, episodes: str) -> None:
    runs = []
    for each in ("team", episodes):
        keywords: dict[str, Any] = {
            "worlds": "train",
            "random_world": True,
            "random_start": True,
            "max_episode_steps": 30,
        }
        env = flockstep.DroneVectorEnv(N, autoreset_mode=mode, episodes=each, **keywords)
        runs.append(history(env, 80))
        assert len(env.batch.finished) == 0
    np.testing.assert_equal(*runs)


@pytest.mark.parametrize("episodes", ["team", "each", "last"])
@pytest.mark.parametrize("kind", ["navigation", "hover", "own"])
def test_gymnasiums_rules_hold(kind: str, mode: str, episodes: str) -> None:
    keywords: dict[str, Any] = {
        "navigation": {"worlds": "playground/train-1"},
        "hover": {"task": flockstep.HoverConfig()},
        "own": {"task": Walk},
    }[kind]
    keywords |= {"drones_per_env": M, "episodes": episodes, "autoreset_mode": mode, "max_episode_steps": 15}
    check_vector_env(lambda n: flockstep.DroneVectorEnv(n, render_mode="rgb_array", **keywords), steps=40, num_envs=3)
