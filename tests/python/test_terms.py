"""Python tasks: rows of a reset."""

import numpy as np
import pytest
from gymnasium import spaces

import flockstep

MODES = ["next_step", "same_step", "disabled"]
HALL = flockstep.World.from_dict(
    {"flockstep_scene": 1, "name": "hall", "room": {"min": [-40, -40, 0], "max": [40, 40, 40]}}
)


class Still(flockstep.Task):
    """Observes nothing and never ends; subclasses add what they test."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float32)
    worlds = HALL
    max_episode_steps = 4

    def reset(self, batch, mask):
        batch.set_pose(np.tile([0, 0, 5], (batch.num_drones, 1)), None, mask)

    def act(self, batch, actions):
        return batch.position

    def step(self, batch):
        return np.zeros(len(self.steps)), np.zeros(len(self.steps), bool)

    def observe(self, batch):
        return self.steps[:, None].astype(np.float32)


def still(envs):
    return np.zeros(envs.action_space.shape, np.float32)


def random_poses(batch, seed=0):
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=(batch.num_drones, 4))
    batch.set_pose(
        rng.uniform([-30, -30, 5], [30, 30, 35], (batch.num_drones, 3)),
        quat / np.linalg.norm(quat, axis=1, keepdims=True),
    )
    batch.sense()


class TestRows:
    @pytest.mark.parametrize("mode", MODES)
    @pytest.mark.parametrize(("row_kind", "drones_per_env"), [("drone", 1), ("drone", 2), ("env", 2)])
    def test_are_those_of_the_mask_in_a_reset(self, mode, row_kind, drones_per_env):
        resets, elsewhere = [], []

        class Records(Still):
            def reset(self, batch, mask):
                drones = mask if row_kind == "drone" else np.repeat(mask, drones_per_env)
                super().reset(batch, drones)
                resets.append((np.flatnonzero(mask).tolist(), batch.rows.tolist()))
                assert batch.rows.dtype == np.int64
                assert not batch.rows.flags.writeable

            def step(self, batch):
                elsewhere.append(batch.rows.tolist())
                return super().step(batch)

        task = Records()
        task.row_kind = row_kind
        envs = flockstep.DroneVectorEnv(
            6, task=task, drones_per_env=drones_per_env, autoreset_mode=mode, stagger_first_episode=True
        )
        envs.reset(seed=1)
        for _ in range(12):
            *_, terminated, truncated, _ = envs.step(still(envs))
            if mode == "disabled" and (terminated | truncated).any():
                envs.reset(options={"reset_mask": terminated | truncated})
        count = len(envs.batch.reward)
        assert resets[0] == (list(range(count)), list(range(count)))
        assert len({tuple(selected) for selected, _ in resets}) > 2
        assert all(selected == rows for selected, rows in resets)
        assert all(rows == list(range(count)) for rows in [*elsewhere, envs.batch.rows.tolist()])

    def test_an_exception_in_a_reset_ends_it(self):
        class Fails(Still):
            fails = False

            def reset(self, batch, mask):
                super().reset(batch, mask)
                if self.fails:
                    raise RuntimeError("no place")

        task = Fails()
        envs = flockstep.DroneVectorEnv(3, task=task, autoreset_mode="disabled")
        envs.reset(seed=0)
        task.fails = True
        with pytest.raises(RuntimeError, match="no place"):
            envs.reset(options={"reset_mask": np.array([False, True, False])})
        assert envs.batch.rows.tolist() == [0, 1, 2]

    def test_need_a_task(self):
        with pytest.raises(RuntimeError, match="this Batch has no task"):
            _ = flockstep.Batch([HALL]).rows

    def test_of_the_engines_tasks_are_all(self):
        assert flockstep.DroneVectorEnv(3, task=flockstep.HoverConfig()).batch.rows.tolist() == [0, 1, 2]


class TestRandom:
    @pytest.mark.parametrize("rows", [[3, 0, 3], np.zeros(0, int), [4], np.array([1, 2], np.int32)])
    @pytest.mark.parametrize("drones_per_env", [1, 2])
    def test_rows_are_those_of_the_full_call(self, rows, drones_per_env):
        batch = flockstep.Batch([HALL], 5 * drones_per_env, drones_per_env=drones_per_env)
        batch.seed(np.arange(5))
        batch.begin_episode(np.arange(5) > 2)
        for count in (0, 1, 7):
            some, full = batch.random(9, count, rows), batch.random(9, count)
            assert some.shape == (len(rows), count)
            np.testing.assert_array_equal(some, full[np.asarray(rows, int)])

    def test_refusals(self):
        batch = flockstep.Batch([HALL], 5)
        for rows, match in (
            ([0, 5], r"rows \(row 1\): expected an integer in \[0, 5\), got 5"),
            ([-1], r"rows \(row 0\): expected an integer in \[0, 5\), got -1"),
            ([0.0], "rows: expected an array of integers, got dtype float64"),
            (np.ones(5, bool), "rows: expected an array of integers, got dtype bool"),
            ([[0]], r"rows: expected shape \(-1,\), got shape \(1, 1\)"),
        ):
            with pytest.raises(ValueError, match=match):
                batch.random(0, 1, rows=rows)
        with pytest.raises(ValueError, match=r"stream: expected an integer in \[0, 2147483648\)"):
            batch.random(1 << 31, 1, rows=[0])


class TestPlacingRows:
    def pair(self):
        batches = [
            flockstep.Batch(
                [HALL], 6, drone=flockstep.DroneModel.load("racer5"), dynamics=flockstep.DynamicsConfig(motion="rotors")
            )
            for _ in range(2)
        ]
        for batch in batches:
            random_poses(batch)
            batch.set_velocity(np.ones((6, 3)), np.ones((6, 3)), np.full((6, 4), 100.0))
        return batches

    def test_is_placing_by_the_mask(self):
        by_rows, by_mask = self.pair()
        rng, rows = np.random.default_rng(1), np.array([4, 1, 2])
        mask = np.isin(np.arange(6), rows)
        position, velocity, rates = rng.uniform(1, 9, (3, 6, 3))
        quat, speeds = np.tile([0, 0, 0, 1.0], (6, 1)), rng.uniform(100, 900, (6, 4))
        for given in ((position, quat), (position, None), (None, quat)):
            by_mask.set_pose(*given, mask)
            by_rows.set_pose(*(None if part is None else part[rows] for part in given), rows=rows)
            for name in ("position", "quat_wxyz", "velocity", "rotor_speed"):
                np.testing.assert_array_equal(getattr(by_rows, name), getattr(by_mask, name))
        for given in ((velocity, rates, speeds), (velocity, None, None), (None, None, speeds)):
            by_mask.set_velocity(*given, mask)
            by_rows.set_velocity(*(None if part is None else part[rows] for part in given), rows=rows)
            for name in ("velocity", "angular_velocity", "rotor_speed"):
                np.testing.assert_array_equal(getattr(by_rows, name), getattr(by_mask, name))
        assert by_rows.snapshot() == by_mask.snapshot()
        by_rows.set_pose(np.zeros((0, 3)), rows=np.zeros(0, int))
        assert by_rows.snapshot() == by_mask.snapshot()

    def test_refusals_change_nothing(self):
        batch, _ = self.pair()
        before = batch.snapshot()
        point = [[0, 0, 5.0]]
        for call, match in (
            (lambda: batch.set_pose(point, rows=[6]), r"rows \(row 0\): expected an integer in \[0, 6\), got 6"),
            (lambda: batch.set_pose(point, rows=[0, 1]), r"position: expected shape \(2, 3\), got shape \(1, 3\)"),
            (
                lambda: batch.set_pose(point, None, np.ones(6, bool), rows=[0]),
                "mask: expected None with rows, got an array",
            ),
            (lambda: batch.set_pose([[0, 0, np.nan]], rows=[0]), r"position \(row 0\): expected finite coordinates"),
            (
                lambda: batch.set_pose(None, [[2, 0, 0, 0]], rows=[0]),
                r"quat_wxyz \(row 0\): expected a unit quaternion",
            ),
            (lambda: batch.set_velocity(point, rows=[-1]), r"rows \(row 0\): expected an integer in \[0, 6\), got -1"),
            (lambda: batch.set_velocity([[np.inf, 0, 0]], rows=[3]), r"velocity \(row 0\): expected finite numbers"),
            (
                lambda: batch.set_velocity(None, [[1e9, 0, 0]], rows=[3]),
                r"angular_velocity \(row 0\): expected at most",
            ),
            (
                lambda: batch.set_velocity(None, None, [[-1, 0, 0, 0]], rows=[3]),
                r"rotor_speed \(row 0\): expected numbers in",
            ),
        ):
            with pytest.raises(ValueError, match=match):
                call()
        assert batch.snapshot() == before
