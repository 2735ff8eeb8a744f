"""Envs of several drones: each drone behaves like a single drone with the same placement and commands."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import world_of
from gymnasium.wrappers.vector import RecordEpisodeStatistics, RecordVideo
from messages import refused

import flockstep
from flockstep.testing import check_vector_env

M = 3
OUTPUTS = ("reward", "reward_terms", "terminated", "truncated", "success", "crashed", "episode_return", "episode_end")


def rows(array: Any, member: int) -> Any:
    """Return the rows of one drone of each env."""
    return array[member::M]


def envs(**keywords: Any) -> flockstep.DroneVectorEnv:
    return flockstep.DroneVectorEnv(4, drones_per_env=M, **keywords)


@pytest.mark.parametrize("observation", ["goal", "pixels"])
def test_equal_drones_return_the_results_of_the_single_env(mode: str, observation: str) -> None:
    keywords: dict[str, Any] = {"observation": observation, "autoreset_mode": mode, "max_episode_steps": 40}
    with_three, single = envs(**keywords), flockstep.DroneVectorEnv(4, **keywords)
    with_three.reset(seed=7)
    single.reset(seed=7)
    single.action_space.seed(1)
    for _ in range(100):
        action = single.action_space.sample()
        with_three.step(np.repeat(action, M, axis=0))
        single.step(action)
        for member in range(M):
            for name in (*OUTPUTS, "position"):
                got, expected = getattr(with_three.batch, name), getattr(single.batch, name)
                np.testing.assert_array_equal(rows(got, member), expected, err_msg=name)
        ended = single.batch.terminated | single.batch.truncated
        if mode == "disabled" and ended.any():
            single.reset(options={"reset_mask": ended})
            with_three.reset(options={"reset_mask": np.repeat(ended, M)})
    assert single.batch.episode.min() >= 1, "several episodes"


@pytest.mark.parametrize(
    "task", [flockstep.HoverConfig(), flockstep.TrackConfig(path="random")], ids=["hover", "track"]
)
def test_the_first_drone_equals_the_single_env_until_a_teammate_ends(task: Any) -> None:
    """Starts, gusts and noise of the pose sensor and the IMU are random, each from its own numbers."""
    keywords: dict[str, Any] = {
        "task": task,
        "wind": flockstep.WindConfig(gusts="dryden"),
        "imu": flockstep.ImuConfig(gyroscope_noise_density=0.1, accelerometer_random_walk=0.1, rate_hz=250),
        "pose_sensor": flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=1),
        "physics_hz": 500,
    }
    with_three, single = envs(**keywords), flockstep.DroneVectorEnv(4, **keywords)
    first, _ = with_three.reset(seed=7)
    expected, _ = single.reset(seed=7)
    starts = with_three.batch.position.reshape(4, M, 3)
    assert len(np.unique(starts.reshape(-1, 3), axis=0)) == 4 * M, "every drone starts elsewhere"
    np.testing.assert_array_equal(rows(first, 0), expected)
    for steps in range(1000):
        action = single.action_space.sample() * 0.1
        observation, reward, terminated, truncated, _ = with_three.step(np.repeat(action, M, axis=0))
        if (terminated | truncated).any():
            assert steps > 5
            return
        same, alone, *_ = single.step(action)
        np.testing.assert_array_equal(rows(observation, 0), same)
        np.testing.assert_array_equal(rows(reward, 0), alone)
        np.testing.assert_array_equal(rows(with_three.batch.accelerometer, 0), single.batch.accelerometer)
        assert not np.array_equal(rows(with_three.batch.gyroscope, 1), single.batch.gyroscope)
    pytest.fail("no episode ended")


def test_an_episode_ends_for_all_drones_of_an_env() -> None:
    env = envs(task=flockstep.HoverConfig(), max_episode_steps=200)
    env.reset(seed=0)
    env.action_space.seed(0)
    ends: list[int] = []
    for _ in range(400):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        ended = (terminated | truncated).reshape(-1, M)
        assert (ended.any(axis=1) == ended.all(axis=1)).all()
        reasons = env.batch.episode_end.reshape(-1, M)[ended[:, 0]]
        for of_env, mates in zip(reasons, terminated.reshape(-1, M)[ended[:, 0]], strict=True):
            assert (of_env != flockstep.EpisodeEnd.none).all()
            assert ((of_env == flockstep.EpisodeEnd.teammate) <= ~mates).all(), "a teammate's end truncates"
            assert (of_env != flockstep.EpisodeEnd.teammate).any(), "some drone has a reason of its own"
            ends += of_env.tolist()
    assert flockstep.EpisodeEnd.teammate in ends
    assert flockstep.EpisodeEnd.left_area in ends or flockstep.EpisodeEnd.contact in ends


def test_a_bad_state_ends_the_episode_of_its_env_only() -> None:
    class Faulty(flockstep.Task):
        observation_space = gymnasium.spaces.Box(-20, 20, (3,), np.float32)
        worlds = "train"

        def step(self, batch: flockstep.Batch) -> tuple[Any, Any]:
            reward = np.ones(batch.num_drones)
            reward[4] = np.nan if self.steps[4] == 3 else 1
            return reward, np.zeros(batch.num_drones, bool)

        def observe(self, batch: flockstep.Batch) -> Any:
            return batch.position

    env = envs(task=Faulty)
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros((12, 3), np.float32))
    with refused(RuntimeWarning, "Faulty.step", "nan", "env 4"):
        _, _, terminated, truncated, infos = env.step(np.zeros((12, 3), np.float32))
    assert np.flatnonzero(terminated).tolist() == [4]
    assert np.flatnonzero(truncated).tolist() == [3, 5]
    assert np.flatnonzero(infos["bad_state"]).tolist() == [4]
    assert env.batch.bad_states.tolist() == [0] * 4 + [1] + [0] * 7


@pytest.mark.parametrize("interaction", ["none", "collide"])
@pytest.mark.parametrize("lost", [0, 4])
def test_a_lost_drone_of_a_team_row_leaves_the_others_as_in_any_other_number_of_envs(
    interaction: str, lost: int
) -> None:
    """The sixteen drones that fly together belong to different envs if there are more."""
    members = 5

    class Runaway(flockstep.Task):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3 * members,), np.float32)
        action_space = gymnasium.spaces.Box(-1, 1, (4,), np.float32)
        row_kind = "env"
        drone = "crazyflie"
        dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
        clock = flockstep.ClockConfig(policy_hz=10, physics_hz=200)

        def reset(self, batch: flockstep.Batch, mask: Any) -> None:
            place, velocity = np.zeros((2, batch.num_drones, 3), np.float32)
            place[:, 1], place[:, 2] = 3 * np.arange(batch.num_drones) % 15, 50
            place[lost::members, 0], velocity[lost::members, 0] = 999_500, 9_900  # the world ends at 1,000 km
            batch.set_pose(place)
            batch.set_velocity(velocity)

        def act(self, batch: flockstep.Batch, actions: Any) -> Any:
            return np.tile(np.float32([0, 1, 0, 0]), (batch.num_drones, 1))

        def step(self, batch: flockstep.Batch) -> tuple[Any, Any]:
            ends = np.zeros(batch.num_drones // members, bool)
            return ends.astype(float), ends

        def observe(self, batch: flockstep.Batch) -> Any:
            return batch.position.reshape(-1, 3 * members)

    world = world_of(boxes=[{"center": [0, 0, 0], "size": [1, 1, 1]}], markers={"start": [5, 5, 5]})
    observations = []
    for num_envs in (1, 7):
        env = flockstep.DroneVectorEnv(
            num_envs, task=Runaway, drones_per_env=members, worlds=world, interaction=interaction
        )
        env.reset(seed=0)
        observation, _, terminated, _, infos = env.step(np.zeros((num_envs, 4), np.float32))
        assert terminated.all()
        assert infos["bad_state"].all()
        observations.append(observation)
    np.testing.assert_array_equal(observations[1], np.repeat(observations[0], 7, axis=0))
    assert observations[0].reshape(members, 3)[:, 2].min() > 40


def test_make_vec_and_wrappers_take_it(tmp_path: Any) -> None:
    env: Any = gymnasium.make_vec(
        "flockstep/LidarNavigation-v0",
        num_envs=2,
        drones_per_env=M,
        max_episode_steps=5,
        render_mode="rgb_array",
        render_size=(96, 64),
    )
    assert (env.num_envs, env.num_groups, env.drones_per_env) == (2 * M, 2, M)
    env = RecordEpisodeStatistics(RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda _: True))
    env.reset(seed=[3, 4])
    for _ in range(13):  # two episodes and the beginning of a third
        env.step(env.action_space.sample())
    env.close()
    assert list(tmp_path.rglob("*.mp4"))


def test_a_vec_env_has_every_row() -> None:
    from flockstep.sb3 import make_vec

    vec = make_vec("flockstep/Hover-v0", num_envs=8, drones_per_env=M, max_episode_steps=30)
    assert vec.num_envs == 24
    vec.seed(5)
    first = np.array(vec.reset())
    alone = flockstep.DroneVectorEnv(8, task=flockstep.HoverConfig(), max_episode_steps=30)
    np.testing.assert_array_equal(rows(first, 0), alone.reset(seed=5)[0])


def test_env_calls_take_a_flag_per_env_and_drone_calls_one_per_drone() -> None:
    batch = flockstep.Batch(flockstep.scenes.load("train"), 12, drones_per_env=M)
    assert (batch.num_envs, batch.drones_per_env, batch.num_drones) == (4, M, 12)
    assert batch.world_index.tolist() == [0, 1, 2, 3]
    assert batch.world_of(5) is batch.worlds[1]
    moved = np.arange(12) == 4
    batch.set_pose(np.full((12, 3), 0.5, np.float32), mask=moved)
    assert np.flatnonzero((batch.position == 0.5).all(axis=1)).tolist() == [4]
    batch.move(batch.position, mask=moved)
    assert batch.tick.tolist() == [0, 1, 0, 0]
    batch.seed(np.arange(4) + 9, mask=np.arange(4) == 1)
    batch.begin_episode(np.arange(4) == 2)
    assert batch.episode.tolist() == [0, 0, 1, 0]
    assert batch.tick.tolist() == [0, 0, 0, 0]
    batch.set_world(np.zeros(4, int), np.arange(4) == 3)
    assert batch.world_index.tolist() == [0, 1, 2, 0]
    assert batch.random(0, 2).shape == (4, 2)
    for call in (batch.begin_episode, lambda mask: batch.seed(np.zeros(4, int), mask)):
        with refused(ValueError, "mask", (4,), (12,)):
            call(np.ones(12, bool))
    for call in (batch.sense, lambda mask: batch.move(batch.position, mask=mask)):
        with refused(ValueError, "mask", (12,), (4,)):
            call(np.ones(4, bool))


def test_removed_drones_leave_their_teammates_flying() -> None:
    batch = flockstep.Batch(
        flockstep.scenes.load("train"),
        12,
        drones_per_env=M,
        lidar=flockstep.LidarConfig(),
        task=flockstep.NavigationConfig(),
    )
    batch.reset(np.arange(4))
    batch.remove([4, 9, 10, 11])
    before = batch.position.copy()
    for _ in range(20):
        batch.step(np.zeros(12, int))
        assert batch.reward[[4, 9, 10, 11]].tolist() == [0] * 4
        assert not (batch.terminated | batch.truncated)[[4, 9, 10, 11]].any()
    assert np.isinf(batch.lidar().ranges[[4, 9]]).all()
    moved = (batch.position != before).any(axis=1)
    assert moved[[3, 5]].all()
    assert not moved[[4, 9, 10, 11]].any()
    with refused(ValueError, "indices (row 0)"):
        batch.spawn([4], before[[4]])
    assert not batch.active[4]
    batch.spawn([3, 4, 5], before[3:6])
    assert batch.steps[3:6].tolist() == [0] * 3
    assert batch.active[:6].all()


def test_without_a_task_one_drone_of_an_env_may_come_back() -> None:
    batch = flockstep.Batch(flockstep.scenes.load("train"), 6, drones_per_env=M, lidar=flockstep.LidarConfig())
    batch.sense()
    batch.move(batch.position)
    position = batch.position.copy()
    batch.remove([1])
    batch.spawn([1], position[[1]])
    assert batch.tick.tolist() == [1, 1], "the env's time goes on"
    assert np.isfinite(batch.lidar().ranges[1]).any()
    with refused(ValueError, "world_index (row 0)", 0, 2):
        batch.spawn([1], position[[1]], world_index=[2])


def test_a_task_may_have_a_row_per_env() -> None:
    class Formation(flockstep.Task):
        """One displacement moves all drones of an env."""

        observation_space = gymnasium.spaces.Box(-100, 100, (3,), np.float32)
        row_kind = "env"
        worlds = "train"
        max_episode_steps = 5

        def act(self, batch: flockstep.Batch, actions: Any) -> Any:
            return batch.position + 0.01 * np.repeat(actions, batch.drones_per_env, axis=0)

        def step(self, batch: flockstep.Batch) -> tuple[Any, Any]:
            return batch.position.reshape(batch.num_envs, -1).sum(axis=1), self.steps < 0

        def observe(self, batch: flockstep.Batch) -> Any:
            return batch.position.reshape(batch.num_envs, -1, 3).mean(axis=1).astype(np.float32)

    env = envs(task=Formation, render_mode="rgb_array")
    assert (env.num_envs, env.num_groups, env.batch.num_drones) == (4, 4, 12)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (4, 3)
    after, reward, _, _, _ = env.step(np.ones((4, 3), np.float32))
    np.testing.assert_allclose(after - observation, 0.01, atol=1e-5)
    assert reward.shape == (4,)
    assert len(env.render() or ()) == 4
    for _ in range(4):
        *_, truncated, infos = env.step(np.ones((4, 3), np.float32))
    assert truncated.all()
    assert infos["episode_length"].tolist() == [5] * 4
    check_vector_env(
        lambda n: flockstep.DroneVectorEnv(n, drones_per_env=M, task=Formation, worlds="playground/train-1"), steps=20
    )


@pytest.mark.parametrize(
    ("kind", "arguments", "said"),
    [
        (flockstep.DroneVectorEnv, {"num_envs": 4, "drones_per_env": 0}, ["drones_per_env", 0]),
        (flockstep.DroneVectorEnv, {"num_envs": 4, "drones_per_env": True}, ["drones_per_env", True]),
        (flockstep.DroneVectorEnv, {"num_envs": 4, "drones_per_env": 1 << 20}, ["num_drones"]),
        (flockstep.DroneEnv, {"drones_per_env": 2}, ["drones_per_env", 1, 2]),
        (flockstep.Batch, {"num_drones": 4, "drones_per_env": 3}, ["num_drones", 3, 4]),
        *(
            (kind, {size: number, "drones_per_env": 10_000, "interaction": to}, ["drones_per_env", 4096, 10_000])
            for kind, size, number in (
                (flockstep.DroneVectorEnv, "num_envs", 1),
                (flockstep.Batch, "num_drones", 10_000),
            )
            for to in ("sense", "collide", "both")
        ),
    ],
)
def test_bad_numbers_of_drones_are_refused(kind: Any, arguments: dict[str, Any], said: list[Any]) -> None:
    with refused(TypeError if kind is flockstep.DroneEnv else ValueError, *said):
        kind(worlds="train", **arguments)


def test_a_mask_that_splits_an_env_is_refused() -> None:
    env = envs(autoreset_mode="disabled")
    env.reset(seed=0)
    before = env.snapshot()
    with refused(ValueError, "options['reset_mask']", 3, "env 1"):
        env.reset(options={"reset_mask": np.arange(12) < 4})
    with refused(ValueError, "options['reset_mask']", (12,)):
        env.reset(options={"reset_mask": np.ones(4, bool)})
    with refused(ValueError, "seed", 12):
        env.reset(seed=list(range(12)))
    assert env.snapshot() == before


@pytest.mark.parametrize("interaction", ["sense", "collide", "both"])
@pytest.mark.parametrize(
    "task", [None, flockstep.HoverConfig(), flockstep.DodgeConfig()], ids=["goal", "hover", "dodge"]
)
def test_a_single_drone_meets_nobody(task: Any, interaction: str) -> None:
    """With one drone in each env all values of ``interaction`` are the same, although all begin at one point."""
    worlds = "playground/train-1"
    runs = [flockstep.DroneVectorEnv(5, task=task, worlds=worlds, interaction=kind) for kind in ("none", interaction)]
    for env in runs:
        env.reset(seed=2)
        env.action_space.seed(0)
    for _ in range(60):
        a, b = (env.step(env.action_space.sample()) for env in runs)
        np.testing.assert_equal(a[:4], b[:4])
        np.testing.assert_array_equal(runs[0].batch.position, runs[1].batch.position)
    assert (runs[1].batch.contact.drone == -1).all()


@pytest.mark.parametrize("motion", ["kinematic", "rotors"])
def test_many_drones_at_one_point_and_in_a_cubic_metre(motion: str) -> None:
    """10,000 that do not interact fly as one does; 60 that do all report each other, and all numbers are finite."""
    world = world_of(room={"min": [-2, -2, -2], "max": [2, 2, 2]})
    dynamics = flockstep.DynamicsConfig(motion=motion, **({"control": "velocity"} if motion == "rotors" else {}))

    def batch_of(count: int, interaction: str) -> flockstep.Batch:
        lidar = flockstep.LidarConfig()
        return flockstep.Batch(
            [world], count, drones_per_env=count, interaction=interaction, dynamics=dynamics, lidar=lidar
        )

    free, met, alone = batch_of(10_000, "none"), batch_of(60, "both"), batch_of(1, "none")
    for cube in (np.zeros((10_000, 3)), np.random.default_rng(0).uniform(-0.5, 0.5, (10_000, 3))):
        ways = np.random.default_rng(1).uniform(-0.5, 0.5, (10_000, 4))
        for batch in (free, met, alone):
            n = batch.num_drones
            batch.set_pose(cube[:n])
            if motion == "kinematic":
                batch.move(cube[:n] + 0.1 * ways[:n, :3])
            else:
                batch.fly(ways[:n], ticks=2)
            batch.sense()
            assert np.isfinite(batch.position).all() and np.isfinite(batch.quat_wxyz).all()
        assert met.contact.inside.all() and (met.contact.drone >= 0).all()
        assert (met.lidar().ranges.reshape(60, -1).min(axis=1) < 1).all()
        np.testing.assert_array_equal(free.position[0], alone.position[0])
        np.testing.assert_array_equal(free.lidar().ranges[0], alone.lidar().ranges[0])
        assert not free.contact.hit.any()
