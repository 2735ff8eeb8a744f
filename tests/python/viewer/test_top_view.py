"""Pictures from above."""

import numpy as np
import pytest

import flockstep
from flockstep.viewer.beams import beams_of
from flockstep.viewer.third_person_view import ThirdPersonView
from flockstep.viewer.top_view import TopView

FLOOR, SOLID, GOAL, DRONE = (255, 255, 255), (120, 124, 132), (52, 160, 80), (35, 70, 160)


def pixel(image, x, y, world):
    """The colour at a place of an 8 x 8 m room."""
    scale = 256 * 0.96 / 8
    return tuple(image[round(127.5 - (y - 4) * scale), round(127.5 + (x - 4) * scale)])


def test_things_are_where_they_are(room):
    batch = flockstep.Batch([room], 1, lidar=flockstep.LidarConfig())
    batch.sense()
    image = TopView(batch).frame(0)
    assert image.shape == (256, 256, 3)
    assert image.dtype == np.uint8
    assert pixel(image, 4, 4.5, room) == SOLID
    assert pixel(image, 6, 4, room) == GOAL
    assert pixel(image, 2, 4, room) == DRONE
    assert pixel(image, 7, 7, room) == FLOOR
    assert tuple(image[0, 0]) not in (FLOOR, SOLID)


def test_the_picture_follows_the_drone(room):
    batch = flockstep.Batch([room], 2)
    view = TopView(batch)
    before = view.frame(0)
    batch.set_pose(np.float32([[6, 6, 2], [2, 4, 2]]))
    after = view.frame(0)
    assert pixel(before, 6, 6, room) == FLOOR
    assert pixel(after, 6, 6, room) == DRONE
    np.testing.assert_array_equal(view.frame(1), before)


def test_a_removed_drone_is_not_drawn(room):
    batch = flockstep.Batch([room], 1)
    batch.remove([0])
    assert pixel(TopView(batch).frame(0), 2, 4, room) != DRONE


def test_a_beam_that_hits_nothing_is_as_long_as_the_drones_range(room):
    lidar = flockstep.LidarConfig(azimuth_deg=[90], elevation_deg=[0])  # towards the wall at y = 8, 4 m away
    batch = flockstep.Batch([room], 2, lidar=lidar)
    batch.set_lidar(np.array([False, True]), max_range_m=1.0)
    batch.sense()
    view = TopView(batch)
    assert pixel(view.frame(0), 2, 6.5, room) != FLOOR
    assert pixel(view.frame(1), 2, 6.5, room) == FLOOR
    assert pixel(view.frame(1), 2, 4.8, room) != FLOOR


def test_beams_are_those_of_the_lidar_as_it_is_now(room):
    batch = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig(beams=9, max_range_m=10))
    batch.set_pose(quat_wxyz=np.float32([[1, 0, 0, 0], [0.8, 0, 0, 0.6]]))
    views = TopView(batch), ThirdPersonView(batch)
    batch.set_lidar(np.array([False, True]), hfov_deg=40, max_range_m=4.5, offset_m=(0.2, 0.1, 0.3))
    batch.sense()
    assert batch.lidar().config_of(0).hfov_deg == 270
    assert batch.lidar().config_of(1).hfov_deg == 40
    for drone in range(2):
        origin, ends, hit = beams_of(batch, drone)
        np.testing.assert_allclose(ends[hit], batch.lidar().points[drone].reshape(-1, 3)[hit], atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(ends[~hit] - origin, axis=1), [10, 4.5][drone], atol=1e-5)
        assert hit.any()
    for view, fresh in zip(views, (TopView(batch), ThirdPersonView(batch)), strict=True):
        np.testing.assert_array_equal(view.frame(1), fresh.frame(1))
    with pytest.raises(ValueError, match=r"index: expected an integer in \[0, 2\), got 2"):
        batch.lidar().config_of(2)
    with pytest.raises(ValueError, match="no LiDAR"):
        flockstep.Batch([room]).lidar().config_of(0)


def test_meshes_and_every_kind_of_primitive_are_drawn():
    scene = {
        "flockstep_scene": 1,
        "name": "all",
        "room": {"min": [0, 0, 0], "max": [8, 8, 4]},
        "boxes": [{"center": [2, 2, 1], "size": [1, 1, 1]}],
        "cylinders": [{"center": [6, 2, 1], "radius": 0.4, "height": 1}],
        "spheres": [{"center": [2, 6, 1], "radius": 0.5}],
        "capsules": [{"center": [4, 1, 1], "radius": 0.3, "height": 2, "quat_wxyz": [0.70710678, 0, 0.70710678, 0]}],
        "planes": [
            {"center": [4, 7, 1], "size": [1, 0.5]},
            {"center": [1, 4, 1], "size": [2, 1], "quat_wxyz": [0.70710678, 0, 0.70710678, 0]},
        ],
        "discs": [{"center": [7, 4, 1], "radius": 0.4}],
        "meshes": [{"vertices": [[5, 5, 1], [7, 5, 1], [6, 7, 1]], "triangles": [[0, 1, 2]]}],
    }
    world = flockstep.World.from_dict(scene)
    batch = flockstep.Batch([world], 1)
    image = TopView(batch).frame(0)
    for x, y in [(2, 2), (6, 2), (2, 6), (6, 6), (4.8, 1), (4.4, 7), (7.3, 4)]:
        assert pixel(image, x, y, world) == SOLID, (x, y)
    assert SOLID in [pixel(image, x, 4, world) for x in (0.95, 1.0, 1.05)]  # a plane seen edge-on is a line


def test_frames_of_worlds_of_different_sizes_have_one_shape(room, closet):
    env = flockstep.DroneVectorEnv(3, worlds=[room, closet], render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert np.array(frames).shape == (3, 256, 256, 3)
    assert flockstep.DroneVectorEnv(1, worlds=room).render() is None
