"""Pictures from above."""

import numpy as np

import swiftlet
from swiftlet.top_view import TopView

FLOOR, SOLID, GOAL, DRONE = (255, 255, 255), (120, 124, 132), (52, 160, 80), (35, 70, 160)


def pixel(image, x, y, world):
    """The colour at a place of an 8 x 8 m room."""
    scale = 256 * 0.96 / 8
    return tuple(image[round(127.5 - (y - 4) * scale), round(127.5 + (x - 4) * scale)])


def test_things_are_where_they_are(room):
    batch = swiftlet.Batch([room], 1, lidar=swiftlet.LidarConfig())
    batch.sense()
    image = TopView(batch, lidar=swiftlet.LidarConfig()).frame(0)
    assert image.shape == (256, 256, 3)
    assert image.dtype == np.uint8
    assert pixel(image, 4, 4.5, room) == SOLID
    assert pixel(image, 6, 4, room) == GOAL
    assert pixel(image, 2, 4, room) == DRONE
    assert pixel(image, 7, 7, room) == FLOOR
    assert tuple(image[0, 0]) not in (FLOOR, SOLID)


def test_the_picture_follows_the_drone(room):
    batch = swiftlet.Batch([room], 2)
    view = TopView(batch)
    before = view.frame(0)
    batch.set_pose(np.float32([[6, 6, 2], [2, 4, 2]]))
    after = view.frame(0)
    assert pixel(before, 6, 6, room) == FLOOR
    assert pixel(after, 6, 6, room) == DRONE
    np.testing.assert_array_equal(view.frame(1), before)


def test_a_removed_drone_is_not_drawn(room):
    batch = swiftlet.Batch([room], 1)
    batch.remove([0])
    assert pixel(TopView(batch).frame(0), 2, 4, room) != DRONE


def test_a_beam_that_hits_nothing_is_as_long_as_the_drones_range(room):
    lidar = swiftlet.LidarConfig(azimuth_deg=[90], elevation_deg=[0])  # towards the wall at y = 8, 4 m away
    batch = swiftlet.Batch([room], 2, lidar=lidar)
    batch.set_lidar(np.array([False, True]), max_range_m=1.0)
    batch.sense()
    view = TopView(batch, lidar=lidar)
    assert pixel(view.frame(0), 2, 6.5, room) != FLOOR
    assert pixel(view.frame(1), 2, 6.5, room) == FLOOR
    assert pixel(view.frame(1), 2, 4.8, room) != FLOOR


def test_meshes_and_every_kind_of_primitive_are_drawn():
    scene = {
        "swiftlet_scene": 1,
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
    world = swiftlet.World.from_dict(scene)
    batch = swiftlet.Batch([world], 1)
    image = TopView(batch).frame(0)
    for x, y in [(2, 2), (6, 2), (2, 6), (6, 6), (4.8, 1), (4.4, 7), (7.3, 4)]:
        assert pixel(image, x, y, world) == SOLID, (x, y)
    assert SOLID in [pixel(image, x, 4, world) for x in (0.95, 1.0, 1.05)]  # a plane seen edge-on is a line


def test_frames_of_worlds_of_different_sizes_have_one_shape(room, closet):
    env = swiftlet.DroneVectorEnv(3, worlds=[room, closet], render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert np.array(frames).shape == (3, 256, 256, 3)
    assert swiftlet.DroneVectorEnv(1, worlds=room).render() is None
