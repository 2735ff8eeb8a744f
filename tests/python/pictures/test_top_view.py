"""Pictures from above."""

import numpy as np
from conftest import placed, world_of

import flockstep
from flockstep.pictures.lines import beams_of
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.top_view import TopView

FLOOR, SOLID, GOAL, DRONE = (252, 252, 250), (96, 101, 112), (52, 160, 80), (35, 70, 160)


def pixel(image, x, y, world):
    """The colour at a point of an 8 x 8 m room."""
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


def test_what_is_higher_than_the_drone_is_cut_away():
    """Under a roof, in a room with a ceiling: drone and floor are visible, or the roof if the cut is above it."""
    world = world_of(
        room={"min": [0, 0, 0], "max": [8, 8, 6]},
        boxes=[{"center": [4, 4, 3.1], "size": [6, 6, 0.2]}, {"center": [2, 2, 0.25], "size": [1, 1, 0.5]}],
    )
    batch = placed([world], [[6, 4, 1.5], [6, 4, 5]])
    below, above = (TopView(batch).frame(i) for i in range(2))
    assert pixel(below, 6, 4, world) == pixel(above, 6, 4, world) == DRONE
    assert pixel(below, 4, 4, world) == pixel(below, 0.5, 4, world) == FLOOR
    assert pixel(below, 2, 2, world) not in (FLOOR, SOLID)  # lower than the drone, coloured by height
    assert pixel(above, 4, 4, world) == pixel(above, 2, 2, world) != FLOOR
    cut = TopView(batch, cut_m=0.25).frame(1)
    assert pixel(cut, 2, 2, world) == SOLID
    assert pixel(cut, 4, 4, world) == FLOOR


def test_its_size_and_what_is_too_small_to_see():
    """A world of kilometres: the drone and its markers, outside the geometry, are visible."""
    world = world_of(
        boxes=[{"center": [0, 0, -1], "size": [4000, 2000, 2]}],
        markers={"start": [-1000, 500, 300], "goal": [3000, 0, 10]},
    )
    batch = flockstep.Batch([world], 1)
    image = TopView(batch, size_px=(400, 100)).frame(0)
    assert image.shape == (100, 400, 3)
    px_per_m = 0.96 * 100 / 2000  # the height determines the scale; 5 km by 2 km fit into the width

    def at(x, y):
        return tuple(image[round(49.5 - y * px_per_m), round(199.5 + (x - 500) * px_per_m)])

    assert at(-1000, 500) == DRONE
    assert at(3000, 0) == GOAL
    assert (image == DRONE).all(axis=2).sum() >= 7 * 4
    assert 25 <= (image == GOAL).all(axis=2).sum() <= 64
    assert at(2500, 0) != at(0, 0)  # nothing is beside the box


def test_frames_of_worlds_of_different_sizes_have_one_shape(room, closet):
    env = flockstep.DroneVectorEnv(3, worlds=[room, closet], render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert np.array(frames).shape == (3, 256, 256, 3)
