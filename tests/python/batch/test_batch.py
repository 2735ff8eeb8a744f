"""The batch: motion, sensors, output buffers, random numbers, lifetimes, snapshots."""

import gc
import multiprocessing
import os

import numpy as np
import pytest
from messages import refused

import flockstep

FACING_X = np.array([1, 0, 0, 0], np.float32)


def yaw(degrees):
    half = np.radians(degrees) / 2
    return np.array([np.cos(half), 0, 0, np.sin(half)], np.float32)


@pytest.fixture
def batch(room):
    return flockstep.Batch([room], 3, lidar=flockstep.LidarConfig(), num_threads=1)


class TestMotion:
    def test_starts_at_the_start_marker(self, batch, room):
        np.testing.assert_array_equal(batch.position, [room.start] * 3)
        np.testing.assert_array_equal(batch.quat_wxyz, [FACING_X] * 3)

    def test_a_wall_stops_a_long_flight(self, batch):
        contact = batch.move(batch.position + np.float32([100, 0, 0]), mask=np.array([True, False, False]))
        # The room ends at x = 8; half the drone is 0.465 m long.
        assert contact.hit.tolist() == [True, False, False]
        assert 2 < batch.position[0, 0] < 8 - 0.46
        np.testing.assert_array_equal(batch.position[1:, 0], 2)

    def test_stops_where_the_hull_touches_the_wall(self, closet):
        batch = flockstep.Batch([closet], num_threads=1)
        contact = batch.move([[2.0, 1, 0.6]])
        assert batch.position[0, 0] == pytest.approx(2 - 0.465, abs=1e-3)
        assert contact.fraction[0] == pytest.approx((1 - 0.465) / 1.0, abs=1e-3)
        assert contact.point[0, 0] == pytest.approx(2, abs=2e-3)
        np.testing.assert_allclose(contact.normal[0], [-1, 0, 0], atol=1e-3)


class TestLidar:
    def test_ranges_are_those_of_the_world(self, batch, room):
        batch.set_pose(np.float32([[1, 1, 1], [4, 2, 3], [7, 6, 2]]), np.stack([yaw(20), yaw(-100), FACING_X]))
        batch.sense()
        for i in range(3):
            directions = batch.lidar().directions[i, 0].astype(float)
            w, z = batch.quat_wxyz[i, [0, 3]].astype(float)
            cos, sin = w * w - z * z, 2 * w * z
            turned = directions @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            expected = room.raycast(np.tile(batch.position[i], (35, 1)), turned, 3.0)["t_hit"]
            np.testing.assert_allclose(batch.lidar().ranges[i, 0], expected, atol=1e-4)

    def test_the_ranges_of_the_drones_are_a_view(self, batch):
        view = batch.lidar().max_range_m
        assert view.dtype == np.float32
        assert not view.flags.writeable
        np.testing.assert_array_equal(view, [3, 3, 3])
        blob = batch.snapshot()
        batch.set_lidar(np.array([False, True, False]), max_range_m=1.5)
        np.testing.assert_array_equal(view, [3, 1.5, 3])
        batch.restore(blob)
        np.testing.assert_array_equal(view, [3, 3, 3])

    def test_without_a_lidar_there_are_no_ranges(self, room):
        with refused(ValueError, "lidar="):
            flockstep.Batch([room]).lidar().max_range_m  # noqa: B018


def test_sensor_configurations(room):
    lidars = [flockstep.LidarConfig(), flockstep.LidarConfig(name="up", beams=3)]
    cameras = [flockstep.CameraConfig(width_px=8, height_px=6)]
    imus = [flockstep.ImuConfig(offset_m=(0, 0, 1))]
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    batch = flockstep.Batch(room, lidar=lidars, cameras=cameras, imu=imus, dynamics=dynamics)
    assert (batch.lidars, batch.cameras, batch.imus) == (lidars, cameras, imus)
    batch.lidars[0].beams = 5
    assert batch.lidars == lidars
    plain = flockstep.Batch(room)
    assert plain.lidars == plain.cameras == plain.imus == []


class TestSlots:
    def test_a_drone_can_change_worlds(self, room, closet):
        batch = flockstep.Batch([room, closet], 2, lidar=flockstep.LidarConfig(azimuth_deg=[0], elevation_deg=[0]))
        batch.set_pose(np.float32([[1, 1, 0.6]] * 2))
        batch.sense()
        assert np.isinf(batch.lidar().ranges[0, 0, 0])
        assert batch.lidar().ranges[1, 0, 0] == pytest.approx(1, abs=1e-5)
        batch.set_world([1, 0])
        batch.sense()
        assert batch.lidar().ranges[0, 0, 0] == pytest.approx(1, abs=1e-5)
        assert np.isinf(batch.lidar().ranges[1, 0, 0])

    def test_worlds_are_dealt_in_turn(self, room, closet):
        assert flockstep.Batch([room, closet], 5).world_index.tolist() == [0, 1, 0, 1, 0]
        assert flockstep.Batch([room, closet], 3, world_index=[1, 1, 0]).world_index.tolist() == [1, 1, 0]

    def test_quaternions_close_to_unit_are_normalised(self, batch):
        batch.set_pose(None, np.tile(1.001 * yaw(30), (3, 1)))
        np.testing.assert_allclose(np.linalg.norm(batch.quat_wxyz, axis=1), 1, atol=1e-6)


class TestRandom:
    def test_depends_only_on_seed_episode_and_stream(self, room):
        few, many = flockstep.Batch([room], 4), flockstep.Batch([room], 100)
        few.seed(np.arange(4) + 7)
        many.seed(np.arange(100) + 7)
        numbers = few.random(3, 5)
        np.testing.assert_array_equal(numbers, many.random(3, 5)[:4])
        np.testing.assert_array_equal(numbers, few.random(3, 5))
        np.testing.assert_array_equal(numbers[:, :2], few.random(3, 2))
        assert not np.isin(few.random(4, 5), numbers).any()
        few.begin_episode()
        assert not np.isin(few.random(3, 5), numbers).any()
        few.seed(np.arange(4) + 7)
        np.testing.assert_array_equal(numbers, few.random(3, 5))


class TestLifetime:
    def test_views_are_read_only_and_updated_in_place(self, batch):
        view = batch.position
        assert not view.flags.writeable
        batch.move(batch.position + np.float32([0.1, 0, 0]))
        np.testing.assert_array_equal(view, batch.position)

    def test_a_view_outlives_its_batch(self, room):
        views = []
        for _ in range(20):
            batch = flockstep.Batch([room], 500, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())
            batch.reset(np.arange(500))
            arrays = (batch.position, batch.observation, batch.contact.hit, batch.lidar().ranges)
            views.append((*arrays, batch.lidar().max_range_m))
            del batch
        gc.collect()
        for position, observation, hit, ranges, max_range in views:
            np.testing.assert_array_equal(position, np.tile(room.start, (500, 1)))
            assert np.isfinite(observation).all()
            assert not hit.any()
            assert not np.isnan(ranges).any()
            np.testing.assert_array_equal(max_range, 3)

    def test_a_hull_outlives_its_model(self):
        hull = flockstep.DroneModel().hull
        gc.collect()
        np.testing.assert_allclose(np.ptp(hull, axis=0), [0.93, 0.59, 0.20], atol=1e-6)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
class TestFork:
    @staticmethod
    def in_child(function):
        context = multiprocessing.get_context("fork")
        receiver, sender = context.Pipe(duplex=False)
        child = context.Process(target=lambda: sender.send(function()))
        child.start()
        assert receiver.poll(60), "the child hangs"
        result = receiver.recv()
        child.join(60)
        return result

    def test_a_batch_can_be_made_in_a_child(self, room):
        def use():
            batch = flockstep.Batch([room], 200, num_threads=4, lidar=flockstep.LidarConfig())
            batch.sense()
            return bool(np.isfinite(batch.lidar().ranges).any())

        assert use()  # the parent has used its own threads
        assert self.in_child(use)

    @pytest.mark.parametrize("num_threads", [1, 2])
    @pytest.mark.parametrize("drops", [False, True])
    def test_a_child_uses_or_drops_what_the_parent_built_from_a_world(self, num_threads, drops):
        worlds = [flockstep.World.load("outdoor/city")]  # triangles and textures
        lidar = flockstep.LidarConfig(channels=16, beams=90, vfov_deg=60, max_range_m=60)
        cameras = [flockstep.CameraConfig(width_px=64, height_px=48, outputs=("rgb", "depth"), shadows=True)]

        def scan():
            batch = flockstep.Batch(worlds, 8, lidar=lidar, cameras=cameras, num_threads=num_threads)
            batch.set_pose(worlds[0].free_places(8, seed=0))
            batch.sense()
            return batch.lidar().ranges.copy(), batch.camera().rgb.copy(), batch.camera().depth.copy()

        def use():
            if drops:
                worlds.clear()
                gc.collect()
                worlds.append(flockstep.World.load("outdoor/city"))
            return scan()

        expected = scan()
        np.testing.assert_equal(expected, self.in_child(use))
        assert np.isfinite(expected[0]).any()
        assert expected[1].any()

    def test_a_batch_of_the_parent_raises_in_a_child(self, room):
        batch = flockstep.Batch([room], cameras=[flockstep.CameraConfig(width_px=4, height_px=4)])

        def use(call):
            try:
                call()
            except RuntimeError as error:
                return str(error)
            return "no error"

        for call in (batch.sense, batch.capture, batch.set_camera, lambda: batch.set_capture_mode("on_demand")):
            assert "fork" in self.in_child(lambda call=call: use(call))


class TestSnapshot:
    def test_is_refused_by_another_batch(self, batch, room):
        with refused(ValueError, "snapshot"):
            flockstep.Batch([room], 4, lidar=flockstep.LidarConfig()).restore(batch.snapshot())


def test_one_or_several_of_each_sensor(room):
    camera, light = flockstep.CameraConfig(name="a"), flockstep.Light()
    for keywords in ({"camera": camera}, {"camera": [camera]}, {"cameras": camera}, {"cameras": (camera,)}):
        assert [config.name for config in flockstep.Batch([room], **keywords).cameras] == ["a"]
    assert flockstep.Batch([room], camera=None, cameras=None, bodies=None, lights=None).cameras == []
    one = flockstep.Batch([room], bodies=flockstep.BodyConfig(), lights=light)
    assert len(one.bodies) == 1
    with refused(TypeError, "camera"):
        flockstep.Batch([room], camera=camera, cameras=camera)
