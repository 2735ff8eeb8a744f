"""Python tasks that fly through gates, and those that become harder: `terms.crossed` and the curriculum."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import begun, world_of
from gymnasium import spaces
from messages import refused
from test_terms import HALL, Still, still

import flockstep
from flockstep import EpisodeEnd
from flockstep.rotations import rotate
from flockstep.testing import check_vector_env


def gates_world(name, gates):
    return world_of(
        name=name, room={"min": [-40, -40, 0], "max": [40, 40, 40]}, gates=[{**gate, "solid": False} for gate in gates]
    )


LANE = gates_world(
    "lane", [{"center": [0, 0, 5]}, {"center": [4, 0, 5], "shape": "ring"}, {"center": [8, 0, 5], "size": 3.0}]
)


def random_gates(seed):
    """Return a world with gates that a drone passes along x, turned at random by up to about 20 degrees."""
    rng = np.random.default_rng(seed)
    quats = [1, 0, 0, 0] + 0.2 * rng.normal(size=(5 + seed, 4))
    return gates_world(
        f"gates-{seed}",
        [
            {
                "center": rng.normal([3 * k - 7, 0, 20], 0.5).tolist(),
                "quat_wxyz": (quat / np.linalg.norm(quat)).tolist(),
                "shape": ("square", "ring")[k % 2],
                "size": rng.uniform(2, 10),
            }
            for k, quat in enumerate(quats)
        ],
    )


class Gates(Still):
    """Flies straight to random points and follows its path through the gates of its world."""

    records_path = True
    clock = flockstep.ClockConfig(policy_hz=10, physics_hz=100)
    action_space = spaces.Box(-40, 40, (3,), np.float32)
    max_episode_steps = 50
    miss_m = None

    def act(self, batch, actions):
        return batch.position + actions

    def setup(self, batch):
        self.target, self.passed, self.has_missed = np.zeros((3, batch.num_drones), int)

    def step(self, batch):
        self.passed, self.has_missed = batch.terms.crossed(self.target, miss_m=self.miss_m)
        self.expected = follow(batch, self.target, self.flying, np.inf if self.miss_m is None else self.miss_m)
        counts = np.array([len(batch.world_of(i).gates) for i in range(batch.num_drones)])
        self.target = (self.target + self.passed) % counts
        return super().step(batch)


def follow(batch, target, flying, miss_m):
    """Count the gates passed and missed in double precision, drone by drone and tick by tick."""
    passed, missed = np.zeros(batch.num_drones, int), np.zeros(batch.num_drones, bool)
    for drone, path in enumerate(batch.path.astype(float)):
        gates = batch.world_of(drone).gates
        for start, end in pairwise(path):
            gate = gates[(target[drone] + passed[drone]) % len(gates)]
            quat = np.array(gate["quat_wxyz"], float)
            before, after = (rotate(quat, point - gate["center"], inverse=True) for point in (start, end))
            if missed[drone] or not flying[drone] or not before[0] < 0 <= after[0]:
                continue
            crossing = before + before[0] / (before[0] - after[0]) * (after - before)
            across = crossing[1:]
            size = np.hypot(*across) if gate["shape"] == "ring" else np.abs(across).max()
            if size < gate["size_m"] / 2:
                passed[drone] += 1
            elif np.linalg.norm(crossing) <= miss_m:
                missed[drone] = True
    return passed, missed


class TestCrossed:
    def envs(self, num_envs=1, worlds=LANE, miss_m=None, **keywords):
        task = Gates()
        task.miss_m = miss_m
        envs = begun(num_envs, worlds=worlds, task=task, **keywords)
        return envs, task

    @pytest.mark.parametrize(
        ("target", "start", "way", "miss_m", "passed", "missed"),
        [
            (0, (-1, 0, 5), (0.5, 0, 0), None, 0, False),  # before the first
            (0, (-1, 0, 5), (2, 0, 0), None, 1, False),
            (0, (-1, 0, 5), (6, 0, 0), None, 2, False),
            (0, (-1, 0, 5), (10, 0, 0), None, 3, False),  # the next is the first again
            (1, (-1, 0, 5), (10, 0, 0), None, 2, False),
            (0, (1, 0, 5), (-2, 0, 0), None, 0, False),  # backwards
            (0, (-1, 0.74, 5), (2, 0, 0), None, 1, False),
            (0, (-1, 0.76, 5), (2, 0, 0), None, 0, True),
            (0, (-1, 0.76, 5), (2, 0, 0), 0.7, 0, False),  # too far away to be a miss
            (0, (-1, 0.7, 5.7), (2, 0, 0), None, 1, False),  # in the corner of a square
            (1, (3, 0.7, 5.7), (2, 0, 0), None, 0, True),  # a ring has none
            (0, (-1, 0.7, 5.7), (10, 0, 0), None, 1, True),  # it misses the second and does not count the third
            (0, (-1, 0.7, 5.7), (10, 0, 0), 0.5, 1, False),  # not a miss, but it does not pass the second either
            (0, (-1, 0, 5), (1, 0, 0), None, 1, False),  # ends in the plane
            (0, (0, 0, 5), (1, 0, 0), None, 0, False),  # begins in the plane
        ],
    )
    def test_by_hand(self, target, start, way, miss_m, passed, missed):
        envs, task = self.envs(miss_m=miss_m)
        task.target[:] = target
        envs.batch.set_pose([start])
        envs.step(np.float32([way]))
        assert (task.passed.tolist(), task.has_missed.tolist()) == ([passed], [missed])
        assert (task.passed.dtype, task.has_missed.dtype) == (np.int32, bool)
        assert task.target[0] == (target + passed) % 3

    @pytest.mark.parametrize("miss_m", [None, 3.0])
    def test_agrees_with_numpy(self, miss_m):
        envs, task = self.envs(60, [random_gates(seed) for seed in range(5)], miss_m, max_episode_steps=7)
        rng, passed, missed = np.random.default_rng(0), [], []
        for _ in range(80):
            aim = rng.uniform([-9, -4, 16], [9, 4, 24], (60, 3))
            envs.step((aim - envs.batch.position).astype(np.float32))
            np.testing.assert_array_equal(task.passed, task.expected[0])
            np.testing.assert_array_equal(task.has_missed, task.expected[1])
            passed.append(task.passed)
            missed.append(task.has_missed)
        assert np.sum(passed) > 50
        assert np.sum(missed) > 50
        assert np.max(passed) > 2

    def test_rows_that_do_not_fly_cross_nothing(self):
        envs, task = self.envs(2, max_episode_steps=1, autoreset_mode="disabled")
        envs.batch.set_pose([[-1, 0, 5]] * 2)
        envs.step(np.float32([[2, 0, 0]] * 2))
        assert task.passed.tolist() == [1, 1]
        envs.reset(options={"reset_mask": np.array([True, False])})
        envs.batch.set_pose([[3, 0, 5]] * 2)
        envs.step(np.float32([[2, 0, 0]] * 2))
        assert task.passed.tolist() == [1, 0]

    def test_refusals(self):
        envs, _ = self.envs(3)
        crossed = envs.batch.terms.crossed
        for call, match in (
            (lambda: crossed(None), ("gate", "None")),
            (lambda: crossed([0, 3, 0]), ("gate (row 1)", 0, 3, "lane")),
            (lambda: crossed([0, 0, -1]), ("gate (row 2)", 0, 3, "lane", -1)),
            (lambda: crossed([0, 0]), ("gate", 3, 2)),
            (lambda: crossed([0.0] * 3), ("gate", "dtype float64")),
            (lambda: crossed([0] * 3, miss_m=0), ("miss_m", 0)),
            (lambda: crossed([0] * 3, miss_m=np.nan), ("miss_m", 0, "nan")),
            (lambda: self.envs(worlds=HALL)[0].batch.terms.crossed([0]), ("gate", "hall")),
        ):
            with refused(ValueError, *match):
                call()
        batch = flockstep.DroneVectorEnv(1, task=Still).batch
        with refused(RuntimeError, "path"):
            batch.terms.crossed([0])
        with refused(RuntimeError, "this Batch has no task"):
            flockstep.Batch([LANE]).terms.crossed([0])


class Ladder(Still):
    """Succeeds at random; each success raises the level of its env, and each failure lowers it."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float32)
    info_names = ("level",)
    max_episode_steps = 3

    def setup(self, batch):
        self.level = np.zeros(len(self.success), np.float32)
        self.calls = 0

    def reset(self, batch, mask):
        super().reset(batch, mask)
        self.level[mask & (batch.episode == 0)] = 0  # with a seed, everything repeats

    def curriculum(self, batch, rows):
        self.calls += 1
        self.level[rows] += np.where(batch.success[rows], 1, -1)

    def step(self, batch):
        drawn = batch.random(stream=0, count=2)
        self.success[:] = drawn[:, 0] < 0.6
        self.info["level"][:] = self.level
        return self.level.astype(float), self.steps > 2 * drawn[:, 1]

    def observe(self, batch):
        return self.level[:, None]  # the state itself, which the curriculum then changes


class TestCurriculum:
    def test_passes_the_checker(self, mode):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, task=Ladder(), autoreset_mode=mode, num_threads=1),
        )

    @pytest.mark.parametrize("frame_skip", [1, 2])
    def test_is_called_once_for_each_episode_that_ended(self, mode, frame_skip):
        task = Ladder()
        envs = begun(8, task=task, autoreset_mode=mode, frame_skip=frame_skip)
        level, calls, successes = np.zeros(8, int), 0, 0
        for _ in range(30):
            before = level.copy()
            observation, _, terminated, truncated, infos = envs.step(still(envs))
            ended = (terminated | truncated) & envs.batch.flying
            report = infos.get("final_info", infos)
            if ended.any():
                level[ended] += np.where(report["success"][ended], 1, -1)
                np.testing.assert_array_equal(report["level"][ended], before[ended])
                calls += 1
                successes += report["success"][ended].sum()
            np.testing.assert_array_equal(task.level, level)
            assert task.calls == calls
            if mode == "same_step":
                np.testing.assert_array_equal(observation[:, 0], level)  # of the next episode, if one ended
                for env in np.flatnonzero(ended):
                    assert infos["final_obs"][env][0] == before[env]
            else:
                np.testing.assert_array_equal(observation[ended, 0], before[ended])
            if mode == "disabled" and ended.any():
                observation, _ = envs.reset(options={"reset_mask": ended})
                np.testing.assert_array_equal(observation[ended, 0], level[ended])
        assert calls > 5
        assert successes > 5

    def test_an_episode_that_the_caller_cuts_off_does_not_count(self):
        task = Ladder()
        envs = flockstep.DroneVectorEnv(4, task=task, autoreset_mode="disabled")
        for seed in range(3):
            envs.reset(seed=seed)
        assert task.calls == 0
        assert not task.level.any()

    def test_results_of_the_episodes_are_there(self):
        seen = []

        class Reads(Still):
            max_episode_steps = 2
            reward_terms = ("one", "two")

            def step(self, batch):
                ends = np.zeros(3, bool)
                ends[1] = True
                return {"one": np.ones(3), "two": np.full(3, 2.0)}, ends

            def curriculum(self, batch, rows):
                seen.append(
                    (
                        rows.tolist(),
                        batch.episode_end[rows].tolist(),
                        batch.episode_length[rows].tolist(),
                        batch.episode_return[rows].tolist(),
                        batch.episode_terms[rows, 1].tolist(),
                    )
                )

        envs = begun(3, task=Reads)
        for _ in range(3):
            envs.step(still(envs))
        task, time = EpisodeEnd.task, EpisodeEnd.time
        assert seen == [
            ([1], [task], [1], [3.0], [2.0]),
            ([0, 2], [time, time], [2, 2], [6.0, 6.0], [4.0, 4.0]),
            ([1], [task], [1], [3.0], [2.0]),
        ]

    def test_of_teammates(self):
        rows_seen = []

        class Team(Still):
            def step(self, batch):
                ends = np.zeros(6, bool)
                ends[2] = self.steps[2] == 1
                return np.zeros(6), ends

            def curriculum(self, batch, rows):
                rows_seen.append((rows.tolist(), batch.episode_end[rows].tolist()))

        envs = begun(3, task=Team, drones_per_env=2)
        envs.step(still(envs))
        assert rows_seen == [([2, 3], [EpisodeEnd.task, EpisodeEnd.teammate])]
