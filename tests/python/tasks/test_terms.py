"""Python tasks: rows of a reset, the body frame, commands, gates and the curriculum."""

from itertools import pairwise

import numpy as np
import pytest
from gymnasium import spaces
from rigid_body import CONTROLS

import flockstep
from flockstep import EpisodeEnd
from flockstep.rotations import rotate, yaw_of
from flockstep.testing import check_vector_env

MODES = ["next_step", "same_step", "disabled"]
HALL = flockstep.World.from_dict(
    {"flockstep_scene": 1, "name": "hall", "room": {"min": [-40, -40, 0], "max": [40, 40, 40]}}
)
NOISE = flockstep.PoseSensorConfig(position_noise_std_m=0.1, orientation_noise_std_deg=10.0)


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
            (lambda: batch.set_pose(point * 3, rows=[0, 1]), r"position: expected shape \(2, 3\), got shape \(3, 3\)"),
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


class TestBodyFrame:
    @pytest.fixture
    def batch(self):
        batch = flockstep.Batch(
            [HALL],
            40,
            pose_sensor=NOISE,
            drone=flockstep.DroneModel.load("racer5"),
            dynamics=flockstep.DynamicsConfig(motion="rotors"),
        )
        batch.seed(np.arange(40))
        random_poses(batch)
        batch.set_velocity(np.random.default_rng(1).normal(0, 5, (40, 3)))
        assert not np.array_equal(batch.sensed_quat_wxyz, batch.quat_wxyz)
        return batch

    def test_rotation_matrices_have_the_axes_of_the_body_as_columns(self, batch):
        axes = np.eye(3, dtype=np.float32)
        for matrices, quat in (
            (batch.rotation, batch.quat_wxyz),
            (batch.sensed_rotation, batch.sensed_quat_wxyz),
        ):
            assert (matrices.shape, matrices.dtype) == ((40, 3, 3), np.float32)
            for k in range(3):
                np.testing.assert_array_equal(matrices[:, :, k], rotate(quat, axes[k]))
            up = np.tile(axes[2], (40, 1))
            np.testing.assert_array_equal(matrices[:, 2], rotate(quat, up, inverse=True))
            np.testing.assert_allclose(matrices @ matrices.swapaxes(1, 2), np.tile(axes, (40, 1, 1)), atol=1e-6)

    def test_points_and_vectors(self, batch):
        """Equal to rotate() bit by bit, for the pose that the sensor measured."""
        rng, quat, position = np.random.default_rng(2), batch.sensed_quat_wxyz, batch.sensed_position
        points = rng.uniform(-40, 40, (40, 7, 3)).astype(np.float32)
        inside = batch.terms.to_body(points)
        assert (inside.shape, inside.dtype) == ((40, 7, 3), np.float32)
        expected = rotate(quat[:, None], points - position[:, None], inverse=True)
        np.testing.assert_array_equal(inside, expected)
        turned = batch.terms.rotate_to_body(points)
        np.testing.assert_array_equal(turned, rotate(quat[:, None], points, inverse=True))
        for k in range(7):
            np.testing.assert_array_equal(batch.terms.to_body(points[:, k]), inside[:, k])
            np.testing.assert_array_equal(batch.terms.rotate_to_body(points[:, k]), turned[:, k])
        np.testing.assert_array_equal(batch.terms.to_body(points.astype(float).tolist()), inside)
        assert batch.terms.to_body(points[:, :0]).shape == (40, 0, 3)
        np.testing.assert_array_equal(batch.terms.to_body(position), 0)

    def test_velocity(self, batch):
        expected = rotate(batch.sensed_quat_wxyz, batch.velocity, inverse=True)
        np.testing.assert_array_equal(batch.terms.body_velocity(), expected)

    def test_of_each_drone_of_an_env(self):
        batch = flockstep.Batch([HALL], 6, drones_per_env=3)
        random_poses(batch)
        points = np.random.default_rng(0).uniform(-9, 9, (6, 3)).astype(np.float32)
        expected = rotate(batch.quat_wxyz, points - batch.position, inverse=True)
        np.testing.assert_array_equal(batch.terms.to_body(points), expected)

    def test_refusals(self, batch):
        for points, match in (
            (None, r"points: expected an array \(N, 3\) or \(N, K, 3\), got None"),
            (np.zeros((39, 3)), r"points: expected shape \(40, 3\), got shape \(39, 3\)"),
            (np.zeros((40, 2, 4)), r"points: expected shape \(40, -1, 3\), got shape \(40, 2, 4\)"),
            (np.zeros((40, 3), bool), "points: expected an array of real numbers, got dtype bool"),
            (np.full((40, 3), 1e300), "points: expected finite numbers in float32's range"),
            ("here", "points: expected an array of real numbers"),
        ):
            with pytest.raises(ValueError, match=match):
                batch.terms.to_body(points)
        with pytest.raises(ValueError, match=r"vectors: expected shape \(40, 3\), got shape \(3,\)"):
            batch.terms.rotate_to_body([0, 0, 1])
        with pytest.raises(ValueError, match=r"displacement_m: expected an array \(N, 3\), got None"):
            batch.terms.displaced(None)
        with pytest.raises(AttributeError, match="kinematic motion has no velocities"):
            flockstep.Batch([HALL]).terms.body_velocity()


def levels_of(drone, dynamics, most_to_weight):
    """Commands for actions of -1, 0 and 1, (3, 4), from the file of the drone."""
    frame = drone.to_dict()
    rotors, mass = frame["rotors"], frame["mass_kg"]
    c0, c1, c2 = rotors["thrust_n"]
    slowest, fastest = rotors["min_speed_radps"], rotors["max_speed_radps"]

    def thrust_at(speed):
        return max(c0 + c1 * speed + c2 * speed**2, 0)

    def speed_for(thrust):
        return max(root.real for root in np.roots([c2, c1, c0 - thrust]))

    def even(most):
        return np.array([-most, 0, most])

    hover = mass * 9.81 / 4
    most = min(thrust_at(fastest), most_to_weight * hover)
    rotor = np.array([thrust_at(slowest), hover, most])
    speeds = np.array([slowest, speed_for(hover), speed_for(most) if most < thrust_at(fastest) else fastest])
    thrust = 4 * rotor / mass
    rate, yaw_rate = even(np.radians(dynamics.max_rate_dps)), even(np.radians(dynamics.max_yaw_rate_dps))
    tilt, yaw = even(np.radians(dynamics.max_tilt_deg)), even(np.pi)
    speed, acceleration = even(dynamics.max_speed_mps), even(dynamics.max_acceleration_mps2)
    columns = {
        "rotor_speeds": [speeds] * 4,
        "rotor_thrusts": [rotor] * 4,
        "body_rates": [thrust, rate, rate, yaw_rate],
        "attitude": [thrust, tilt, tilt, yaw],
        "acceleration": [acceleration] * 3 + [yaw],
        "velocity": [speed] * 3 + [yaw_rate],
        "heading_velocity": [speed] * 3 + [yaw_rate],
        "position": [even(1.0)] * 3 + [yaw],
    }
    return np.stack(columns[dynamics.control], axis=1)


class TestCommand:
    def batch(self, control, drone="racer5", num_drones=50):
        batch = flockstep.Batch(
            [HALL],
            num_drones,
            drone=flockstep.DroneModel.load(drone),
            dynamics=flockstep.DynamicsConfig(
                motion="rotors",
                control=control,
                max_rate_dps=300,
                max_yaw_rate_dps=100,
                max_tilt_deg=50,
                max_speed_mps=3,
            ),
        )
        random_poses(batch)
        return batch

    @pytest.mark.parametrize("control", CONTROLS)
    @pytest.mark.parametrize("drone", ["racer5", "crazyflie"])
    @pytest.mark.parametrize("most_to_weight", [None, 1.5, 100.0])
    def test_agrees_with_numpy(self, control, drone, most_to_weight):
        batch = self.batch(control, drone)
        commands_thrust = control in ("rotor_speeds", "rotor_thrusts", "body_rates", "attitude")
        most = most_to_weight if commands_thrust else None
        low, middle, high = levels_of(batch.drone, batch.dynamics, most or np.inf)
        actions = np.random.default_rng(0).uniform(-1.3, 1.3, (50, 4))
        actions[:3] = [[-1] * 4, [0] * 4, [1] * 4]
        clipped = np.clip(actions, -1, 1)
        expected = middle + clipped * np.where(clipped < 0, middle - low, high - middle)
        if control == "position":
            expected[:, :3] += batch.position
        if control in ("attitude", "acceleration", "position"):
            expected[:, 3] += yaw_of(batch.quat_wxyz)
        command = batch.terms.command(actions, max_thrust_to_weight=most)
        assert (command.shape, command.dtype) == ((50, 4), np.float32)
        np.testing.assert_allclose(command, expected, rtol=1e-5, atol=1e-5)

    def test_the_cap_limits_the_thrust(self):
        batch = self.batch("body_rates")
        assert batch.terms.command(np.ones((50, 4)))[0, 0] / 9.81 > 5
        assert batch.terms.command(np.ones((50, 4)), max_thrust_to_weight=2)[0, 0] / 9.81 == pytest.approx(2)

    def test_rotor_levels(self):
        batch = self.batch("rotor_speeds")
        actions = np.random.default_rng(0).uniform(-1, 1, (50, 4))
        actions[:3] = [[-1] * 4, [0] * 4, [1] * 4]
        batch.set_velocity(None, None, batch.terms.command(actions))
        np.testing.assert_allclose(batch.terms.rotor_levels(), actions, atol=1e-6)

    def test_refusals(self):
        batch = self.batch("body_rates")
        for call, match in (
            (lambda: batch.terms.command(None), r"actions: expected an array \(N, 4\), got None"),
            (lambda: batch.terms.command(np.zeros((50, 3))), r"actions: expected shape \(50, 4\), got shape \(50, 3\)"),
            (
                lambda: batch.terms.command(np.zeros((50, 4)), max_thrust_to_weight=1),
                "max_thrust_to_weight: expected a number > 1, got 1",
            ),
            (
                lambda: batch.terms.command(np.zeros((50, 4)), max_thrust_to_weight=np.nan),
                "max_thrust_to_weight: expected a number > 1, got nan",
            ),
            (
                lambda: self.batch("velocity").terms.command(np.zeros((50, 4)), max_thrust_to_weight=2),
                "max_thrust_to_weight: expected None with a control that commands no thrust, got a number",
            ),
            (
                lambda: self.batch("pose").terms.command(np.zeros((50, 4))),
                'control: expected one that commands the rotors, got "pose"',
            ),
        ):
            with pytest.raises(ValueError, match=match):
                call()
        for name, match in (("command", "commands"), ("rotor_levels", "rotors")):
            call = getattr(flockstep.Batch([HALL]).terms, name)
            with pytest.raises(AttributeError, match=f"kinematic motion has no {match}"):
                call(*([np.zeros((1, 4))] if name == "command" else []))


def gates_world(name, gates):
    return flockstep.World.from_dict(
        {
            "flockstep_scene": 1,
            "name": name,
            "room": {"min": [-40, -40, 0], "max": [40, 40, 40]},
            "gates": [{**gate, "solid": False} for gate in gates],
        }
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
        envs = flockstep.DroneVectorEnv(num_envs, worlds=worlds, task=task, **keywords)
        envs.reset(seed=0)
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
            (lambda: crossed(None), r"gate: expected an array \(N,\), got None"),
            (
                lambda: crossed([0, 3, 0]),
                r'gate \(row 1\): expected an integer in \[0, 3\), a gate of world "lane", got 3',
            ),
            (
                lambda: crossed([0, 0, -1]),
                r'gate \(row 2\): expected an integer in \[0, 3\), a gate of world "lane", got -1',
            ),
            (lambda: crossed([0, 0]), r"gate: expected shape \(3,\), got shape \(2,\)"),
            (lambda: crossed([0.0] * 3), "gate: expected an array of integers, got dtype float64"),
            (lambda: crossed([0] * 3, miss_m=0), "miss_m: expected a number > 0 or None, got 0"),
            (lambda: crossed([0] * 3, miss_m=np.nan), "miss_m: expected a number > 0 or None, got nan"),
            (
                lambda: self.envs(worlds=HALL)[0].batch.terms.crossed([0]),
                'gate: expected a world with gates, got world "hall", which has none',
            ),
        ):
            with pytest.raises(ValueError, match=match):
                call()
        batch = flockstep.DroneVectorEnv(1, task=Still).batch
        with pytest.raises(RuntimeError, match=r"path: this task does not record it \(declare records_path"):
            batch.terms.crossed([0])
        with pytest.raises(RuntimeError, match="this Batch has no task"):
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
    @pytest.mark.parametrize("mode", MODES)
    def test_passes_the_checker(self, mode):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, task=Ladder(), autoreset_mode=mode, num_threads=1),
        )

    @pytest.mark.parametrize("mode", MODES)
    @pytest.mark.parametrize("frame_skip", [1, 2])
    def test_is_called_once_for_each_episode_that_ended(self, mode, frame_skip):
        task = Ladder()
        envs = flockstep.DroneVectorEnv(8, task=task, autoreset_mode=mode, frame_skip=frame_skip)
        envs.reset(seed=0)
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

        envs = flockstep.DroneVectorEnv(3, task=Reads)
        envs.reset(seed=0)
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

        envs = flockstep.DroneVectorEnv(3, task=Team, drones_per_env=2)
        envs.reset(seed=0)
        envs.step(still(envs))
        assert rows_seen == [([2, 3], [EpisodeEnd.task, EpisodeEnd.teammate])]

    def test_it_may_choose_the_next_world(self):
        other = flockstep.World.from_dict(
            {"flockstep_scene": 1, "name": "harder", "room": {"min": [-9, -9, 0], "max": [9, 9, 9]}}
        )

        class Harder(Ladder):
            def reset(self, batch, mask):
                batch.set_world((self.level > 0).astype(int), mask)
                super().reset(batch, mask)

        task = Harder()
        envs = flockstep.DroneVectorEnv(8, task=task, worlds=[HALL, other], autoreset_mode="same_step")
        envs.reset(seed=0)
        seen = set()
        for _ in range(20):
            envs.step(still(envs))
            np.testing.assert_array_equal(envs.batch.world_index, task.level > 0)
            seen |= set(envs.batch.world_index.tolist())
        assert seen == {0, 1}


class TestNeighbors:
    @pytest.mark.parametrize("count", [1, 3, 7])
    def test_are_those_of_a_sort(self, count):
        batch = flockstep.Batch([HALL], 12, drones_per_env=4, pose_sensor=NOISE)
        random_poses(batch)
        batch.remove([5])
        velocity = np.random.default_rng(1).normal(size=(12, 3)).astype(np.float32)
        found = batch.terms.neighbors(count, velocity)
        assert found.shape == (12, count, 7)
        position, quat = batch.sensed_position.astype(float), batch.sensed_quat_wxyz.astype(float)
        for drone in range(12):
            others = [i for i in range(drone // 4 * 4, drone // 4 * 4 + 4) if i not in (drone, 5) and drone != 5]
            others.sort(key=lambda i: np.linalg.norm(position[i] - position[drone]))
            expected = np.zeros((count, 7))
            for k, other in enumerate(others[:count]):
                apart, moving = position[other] - position[drone], (velocity[other] - velocity[drone]).astype(float)
                expected[k] = [
                    *rotate(quat[drone], apart, inverse=True),
                    *rotate(quat[drone], moving, inverse=True),
                    1,
                ]
            np.testing.assert_allclose(found[drone], expected, atol=1e-4)

    def test_have_the_velocities_of_rotor_driven_drones(self):
        dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
        batch = flockstep.Batch([HALL], 2, drones_per_env=2, drone=flockstep.DroneModel.load("x500"), dynamics=dynamics)
        batch.set_pose([[0, 0, 5], [2, 0, 5]])
        batch.set_velocity([[1, 0, 0], [0, 3, 0]])
        batch.sense()
        found = batch.terms.neighbors(1)[:, 0]
        np.testing.assert_allclose(found, [[2, 0, 0, -1, 3, 0, 1], [-2, 0, 0, 1, -3, 0, 1]], atol=1e-6)

    def test_kinematic_drones_have_none(self):
        batch = flockstep.Batch([HALL], 2, drones_per_env=2)
        batch.set_pose([[0, 0, 5], [2, 0, 5]])
        batch.sense()
        assert batch.terms.neighbors(1)[:, 0].tolist() == [[2, 0, 0, 0, 0, 0, 1], [-2, 0, 0, 0, 0, 0, 1]]

    def test_bad_input_is_refused(self):
        batch = flockstep.Batch([HALL], 2, drones_per_env=2)
        with pytest.raises(ValueError, match="count: expected an integer >= 1, got 0"):
            batch.terms.neighbors(0)
        with pytest.raises(ValueError, match="velocity: expected"):
            batch.terms.neighbors(1, np.zeros((3, 3)))
