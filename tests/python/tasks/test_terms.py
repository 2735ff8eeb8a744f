"""Python tasks: rows of a reset, the body frame, commands and neighbours."""

import numpy as np
import pytest
from conftest import begun, flat_batch, placed, world_of
from gymnasium import spaces
from messages import refused
from rigid_body import CONTROLS

import flockstep
from flockstep.rotations import rotate, yaw_of

HALL = world_of(name="hall", room={"min": [-40, -40, 0], "max": [40, 40, 40]})
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
        envs = begun(
            6, task=task, drones_per_env=drones_per_env, autoreset_mode=mode, stagger_first_episode=True, seed=1
        )
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
        envs = begun(3, task=task, autoreset_mode="disabled")
        task.fails = True
        with refused(RuntimeError, "no place"):
            envs.reset(options={"reset_mask": np.array([False, True, False])})
        assert envs.batch.rows.tolist() == [0, 1, 2]

    def test_of_the_engines_tasks_are_all(self):
        assert flockstep.DroneVectorEnv(3, task=flockstep.HoverConfig()).batch.rows.tolist() == [0, 1, 2]

    def test_need_a_task(self):
        with refused(RuntimeError, "this Batch has no task"):
            _ = flockstep.Batch([HALL]).rows


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
            ([0, 5], ("rows (row 1)", 0, 5)),
            ([-1], ("rows (row 0)", 0, 5, -1)),
            ([0.0], ("rows", "dtype float64")),
            (np.ones(5, bool), ("rows", "dtype bool")),
            ([[0]], ("rows", "(N,)", (1, 1))),
        ):
            with refused(ValueError, *match):
                batch.random(0, 1, rows=rows)
        with refused(ValueError, "stream", 0, 2147483648):
            batch.random(1 << 31, 1, rows=[0])


class TestPlacingRows:
    def pair(self):
        batches = [flat_batch([HALL], 6, drone="racer5", motion="rotors") for _ in range(2)]
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
            (lambda: batch.set_pose(point, rows=[6]), ("rows (row 0)", 0, "got 6")),
            (lambda: batch.set_pose(point * 3, rows=[0, 1]), ("position", (2, 3), (3, 3))),
            (lambda: batch.set_pose(point, None, np.ones(6, bool), rows=[0]), ("mask", "array")),
            (lambda: batch.set_pose([[0, 0, np.nan]], rows=[0]), ("position (row 0)", "finite", np.nan)),
            (lambda: batch.set_pose(None, [[2, 0, 0, 0]], rows=[0]), ("quat_wxyz (row 0)", "2.000000")),
            (lambda: batch.set_velocity(point, rows=[-1]), ("rows (row 0)", 0, 6, -1)),
            (lambda: batch.set_velocity([[np.inf, 0, 0]], rows=[3]), ("velocity (row 0)", "+-10000", np.inf)),
            (lambda: batch.set_velocity(None, [[1e9, 0, 0]], rows=[3]), ("angular_velocity (row 0)", 1570.8, "1e+09")),
            (lambda: batch.set_velocity(None, None, [[-1, 0, 0, 0]], rows=[3]), ("rotor_speed (row 0)", 0, -1)),
        ):
            with refused(ValueError, *match):
                call()
        assert batch.snapshot() == before


class TestBodyFrame:
    @pytest.fixture
    def batch(self):
        batch = flat_batch([HALL], 40, pose_sensor=NOISE, drone="racer5", motion="rotors")
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

    def test_velocity_that_the_pose_sensor_measures(self):
        sensor = flockstep.PoseSensorConfig(orientation_noise_std_deg=10, velocity_noise_std_mps=0.5)
        batch = flat_batch([HALL], 40, pose_sensor=sensor, drone="racer5", motion="rotors", drones_per_env=2)
        random_poses(batch)
        batch.set_velocity(np.random.default_rng(1).normal(0, 5, (40, 3)))
        batch.sense()
        sensed = batch.sensed_velocity
        assert 0.4 < np.std(sensed - batch.velocity) < 0.6
        expected = rotate(batch.sensed_quat_wxyz, sensed, inverse=True)
        np.testing.assert_array_equal(batch.terms.body_velocity(), expected)
        np.testing.assert_array_equal(batch.terms.neighbors(1), batch.terms.neighbors(1, sensed))

    def test_refusals(self, batch):
        for points, match in (
            (None, ("points", 3, "None")),
            (np.zeros((39, 3)), ("points", 40, 3, 39)),
            (np.zeros((40, 2, 4)), ("points", "(40, K, 3)", (40, 2, 4))),
            (np.zeros((40, 3), bool), ("points", "dtype bool")),
            (np.full((40, 3), 1e300), ("points", "finite", 1e300)),
            ("here", ("points", "<U4")),
        ):
            with refused(ValueError, *match):
                batch.terms.to_body(points)
        with refused(ValueError, "vectors", 40, 3):
            batch.terms.rotate_to_body([0, 0, 1])
        with refused(ValueError, "displacement_m", 3, "None"):
            batch.terms.displaced(None)
        with refused(AttributeError, "kinematic motion", "velocities"):
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
        batch = flat_batch(
            [HALL],
            num_drones,
            drone=drone,
            motion="rotors",
            control=control,
            max_rate_dps=300,
            max_yaw_rate_dps=100,
            max_tilt_deg=50,
            max_speed_mps=3,
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

    def test_rotor_levels(self):
        batch = self.batch("rotor_speeds")
        actions = np.random.default_rng(0).uniform(-1, 1, (50, 4))
        actions[:3] = [[-1] * 4, [0] * 4, [1] * 4]
        batch.set_velocity(None, None, batch.terms.command(actions))
        np.testing.assert_allclose(batch.terms.rotor_levels(), actions, atol=1e-6)

    def test_refusals(self):
        for control, actions, most, said in (
            ("body_rates", None, None, ("actions", None)),
            ("body_rates", np.zeros((50, 3)), None, ("actions", (50, 4), (50, 3))),
            ("body_rates", np.zeros((50, 4)), 1, ("max_thrust_to_weight", "got 1")),
            ("body_rates", np.zeros((50, 4)), np.nan, ("max_thrust_to_weight", np.nan)),
            ("velocity", np.zeros((50, 4)), 2, ("max_thrust_to_weight", "commands no thrust")),
            ("pose", np.zeros((50, 4)), None, ("control", "pose")),
        ):
            terms = self.batch(control).terms
            with refused(ValueError, *said):
                terms.command(actions, max_thrust_to_weight=most)
        with refused(TypeError, "command", "max_speed_mps"):
            terms.command(np.zeros((50, 4)), max_speed_mps=1)
        for name, match in (("command", "commands"), ("rotor_levels", "rotors")):
            call = getattr(flockstep.Batch([HALL]).terms, name)
            with refused(AttributeError, "kinematic motion", match):
                call(*([np.zeros((1, 4))] if name == "command" else []))


class TestNeighbors:
    @pytest.mark.parametrize("count", [1, 7])
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
        batch = placed([HALL], [[0, 0, 5], [2, 0, 5]], drones_per_env=2, drone="x500", dynamics=dynamics)
        batch.set_velocity([[1, 0, 0], [0, 3, 0]])
        batch.sense()
        found = batch.terms.neighbors(1)[:, 0]
        np.testing.assert_allclose(found, [[2, 0, 0, -1, 3, 0, 1], [-2, 0, 0, 1, -3, 0, 1]], atol=1e-6)

    def test_kinematic_drones_have_none(self):
        batch = placed([HALL], [[0, 0, 5], [2, 0, 5]], drones_per_env=2)
        batch.sense()
        assert batch.terms.neighbors(1)[:, 0].tolist() == [[2, 0, 0, 0, 0, 0, 1], [-2, 0, 0, 0, 0, 0, 1]]

    def test_bad_input_is_refused(self):
        batch = flockstep.Batch([HALL], 2, drones_per_env=2)
        with refused(ValueError, "count", 1, 0):
            batch.terms.neighbors(0)
        with refused(ValueError, "velocity", (2, 3), (3, 3)):
            batch.terms.neighbors(1, np.zeros((3, 3)))
