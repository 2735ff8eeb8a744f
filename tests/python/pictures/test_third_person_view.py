"""Pictures from behind a drone, and the choices of `render_view`."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from conftest import begun, placed, world_of
from messages import refused

import flockstep
from flockstep.pictures.lines import Trail
from flockstep.pictures.stage import Stage, _pushed
from flockstep.pictures.third_person_view import ThirdPersonView, frustum, smoothed
from flockstep.rotations import rotate

LENGTH = 0.93  # of the default drone, m
HULL = flockstep.DroneModel(flockstep.DroneModel().hull)  # same size, drawn in one colour
DRONES = pytest.mark.parametrize("drone", [flockstep.DroneModel(), HULL], ids=["rotors", "hull"])


def mask_of(image, kind):
    """Pixels of one kind of object; walls and pillars here are grey or bluish grey."""
    r, g, b = image.astype(int).transpose(2, 0, 1)
    return {
        "hull": (b > 100) & (b > 1.6 * r) & (b > 1.5 * g),
        "beam": (r > 200) & (r - b > 40) & (g > 100) & (g < r - 15),
        "frustum": (r > g + 40) & (b > g + 40) & (b > r),
        "hit": (r > 150) & (g < 110) & (b < 110),
    }[kind]


def dim(world):
    """The world without sun, so that the only difference that a drone makes in a picture is the drone."""
    return world.with_light(sun_color=(0, 0, 0))


def viewed(world, position, quat_wxyz=(1, 0, 0, 0)):
    """The stage's canvas for a pose, in the size of the picture."""
    return Stage(world, LENGTH, (640, 480)).set(np.array(position, float), np.array(quat_wxyz, float))[0]


def changed(after, before):
    return (after != before).any(axis=-1)


def test_the_viewer_moves_past_obstacles_that_end_where_the_motion_ends():
    """Thin bars, such as those of a gate, of which the last surface is less than a millimetre before the end."""
    box = {"center": [1, 0, 0], "size": [0.1, 1, 1]}
    world = world_of(boxes=[box])
    for length in np.concatenate([1.05 + np.linspace(-2e-3, 2e-3, 41), 0.95 + np.linspace(-2e-3, 2e-3, 41)]):
        way = np.array([length, 0.0, 0.0])
        np.testing.assert_allclose(_pushed(world, np.array([True]), np.zeros(3), way, 0.0), way, atol=2e-3)


@DRONES
def test_it_is_as_large_as_its_mesh_or_its_hull(room, drone):
    """The drone fills the rectangle around its projected corners, and no pixel of it is outside."""
    batch = flockstep.Batch([dim(room)], drone=drone)
    quat_wxyz = np.float32([0.9, 0.1, -0.2, 0.37])
    quat_wxyz /= np.linalg.norm(quat_wxyz)
    batch.set_pose(np.float32([[5, 6, 2]]), quat_wxyz[None])
    view = ThirdPersonView(batch)
    with_drone = view.frame(0)
    batch.remove([0])
    rows, columns = np.nonzero(changed(with_drone, view.frame(0)))
    outermost = np.asarray(drone.hull if drone is HULL else flockstep.DroneMesh.quadrotor(drone).vertices, float)
    corners = viewed(room, (5, 6, 2), quat_wxyz).project(np.array([5, 6, 2]) + rotate(quat_wxyz, outermost))[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose([columns.min(), rows.min()], low, atol=2)
    np.testing.assert_allclose([columns.max(), rows.max()], high, atol=2)


def test_a_mesh_is_what_is_seen_and_how_far_off_the_viewer_is(room):
    """A slab twice as long as the drone fills the same rectangle as its projected corners, also in the fleet view."""
    box = trimesh.creation.box((1.8, 0.6, 0.2))
    slab = np.array(box.vertices)
    mesh = flockstep.DroneMesh(slab, box.faces, (0.02, 0.08, 0.5))
    batch = placed([dim(room)], [[5, 6, 2], [6.5, 2, 2]], drone=flockstep.DroneModel())
    view = ThirdPersonView(batch, mesh=mesh, beams=False)
    fleet = ThirdPersonView(batch, mesh=mesh, beams=False, others=True)
    seen, both = view.frame(0), fleet.frame(0)
    batch.remove([0])
    empty = view.frame(0)
    drawn = changed(seen, empty)
    assert mask_of(seen, "hull")[drawn].mean() > 0.9
    canvas, _ = Stage(room, 1.8, (640, 480)).set(np.array([5.0, 6, 2]), np.array([1.0, 0, 0, 0]))
    corners = canvas.project(np.array([5.0, 6, 2]) + slab)[:, :2]
    rows, columns = np.nonzero(drawn)
    np.testing.assert_allclose([columns.min(), rows.min()], corners.min(axis=0), atol=2)
    np.testing.assert_allclose([columns.max(), rows.max()], corners.max(axis=0), atol=2)
    other = changed(both, seen)
    assert other.sum() > 300
    ((x, y, _),) = canvas.project(np.array([[6.5, 2, 2.1]]))
    assert other[int(y), int(x)]
    assert both[int(y), int(x)].min() > seen[drawn].min()  # pale


def test_the_viewer_stays_in_the_room_and_off_the_walls(room):
    rng = np.random.default_rng(0)
    bare = flockstep.World.from_dict({k: v for k, v in room.to_dict().items() if k != "markers"})
    stage = Stage(bare, LENGTH, (64, 48))
    low, high = np.asarray(room.bounds, float)
    for _ in range(50):
        position = rng.uniform(low + 0.5, high - 0.5)
        if np.hypot(position[0] - 4, position[1] - 4.5) < 0.7:
            continue  # inside the pillar
        yaw = rng.uniform(-np.pi, np.pi)
        canvas, _ = stage.set(position, np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]))
        assert np.isfinite(canvas.depth).all()  # walls on all sides
        x, y, depth = canvas.project(position[None])[0]
        assert 0 < x < 64
        assert 0 < y < 48
        assert depth > 0.3
        assert canvas.depth[int(y), int(x)] > depth - 1e-3  # nothing in front of it, unless it has faded


def test_a_pillar_between_viewer_and_drone_dissolves(room):
    """The drone is visible through the pillar, which also stays visible."""
    batch = placed([room], [[5.2, 3.9, 2]], drone=HULL)
    view = ThirdPersonView(batch)
    # The viewer is 3.2 m behind the drone, 1.3 m to its left and 1.7 m above it. The pillar at (4, 4.5) is half-way.
    image = view.frame(0)
    r, g, b = image.astype(int).transpose(2, 0, 1)
    assert ((b > r + 20) & (b > g + 10)).sum() > 2000
    _, faded = Stage(room, LENGTH, (640, 480)).set(np.array([5.2, 3.9, 2.0]), np.array([1.0, 0, 0, 0]))
    assert len(faded.at) > 5000
    assert faded.opacity(faded.depth).min() == pytest.approx(0.3)


def test_a_marker_between_viewer_and_drone_dissolves(room):
    """It hides neither the drone nor the wall and the ground behind it, and stays visible."""
    position, quat_wxyz = np.array([5.2, 6.5, 2.0]), np.array([1.0, 0, 0, 0])
    bare = room.with_markers()
    viewer = Stage(bare, LENGTH, (640, 480)).set(position, quat_wxyz)[0]._position
    between = viewer + 0.5 * (position - viewer)
    pictures = []
    for world in (bare, bare.with_markers(goal=between)):
        batch = placed([world], [position], drone=HULL)
        pictures.append(ThirdPersonView(batch).frame(0))
    hull = mask_of(pictures[0], "hull")
    assert hull.sum() > 2000
    canvas, faded = Stage(bare.with_markers(goal=between), LENGTH, (640, 480)).set(position, quat_wxyz)
    expected = Stage(bare, LENGTH, (640, 480)).set(position, quat_wxyz)[0]
    np.testing.assert_array_equal(canvas.rgb, expected.rgb)
    np.testing.assert_array_equal(canvas.depth, expected.depth)
    ((place, _),) = faded.markers
    np.testing.assert_allclose(place, between, atol=1e-6)
    assert faded.opacity(canvas.project(between[None])[:, 2]) == pytest.approx(0.3)
    green = pictures[1].astype(int) - pictures[0]
    assert (green[..., 1] > green[..., 0] + 10)[hull].mean() > 0.5


def test_a_trail_of_steps_along_the_axes_is_smooth():
    steps = np.tile([[0.1, 0, 0], [0, 0.1, 0]], (20, 1))
    path = np.insert(np.cumsum(steps, axis=0), 0, 0, axis=0)
    smooth = smoothed(path, 1.0)
    np.testing.assert_allclose(smooth[[0, -1]], path[[0, -1]], atol=1e-9)
    flown, drawn = (np.linalg.norm(np.diff(each, axis=0), axis=1).sum() for each in (path, smooth))
    assert flown == pytest.approx(4.0)
    assert drawn == pytest.approx(np.sqrt(8), rel=0.02)  # straight
    assert np.linalg.norm(smoothed(path, 0.01) - path, axis=1).max() == pytest.approx(0.01)
    np.testing.assert_allclose(smoothed(path[:1], 1.0), path[:1], atol=1e-9)


def test_a_viewer_who_follows_sees_the_recent_part_of_a_trail(room):
    """The drone flies three laps around a circle; from a fixed place all of them are drawn."""
    batch = flockstep.Batch([room])
    trail = Trail(batch)
    angle = np.linspace(0, 6 * np.pi, 300)
    for a in angle:
        batch.set_pose(np.float32([[5 + 1.5 * np.cos(a), 6 + 1.5 * np.sin(a), 2]]))
        trail.record()
    lengths = []
    for place in (None, (np.array([1.0, 6.5, 3.5]), np.array([5.0, 6.5, 2.0]))):
        view = ThirdPersonView(batch, trail=trail, place=place)
        drawn = []
        canvas = SimpleNamespace(lines=lambda starts, ends, color, width_px, into=drawn: into.append(ends - starts))
        view._draw_trail(canvas, 0)
        lengths.append(np.linalg.norm(drawn[0], axis=1).sum())
    assert lengths[0] == pytest.approx(12 * LENGTH, abs=0.1)
    assert lengths[1] == pytest.approx(9 * np.pi, rel=0.02)


def test_a_wall_of_triangles_does_not_dissolve_and_the_viewer_comes_before_it():
    wall = [[3, -20, -20], [3, 20, -20], [3, 20, 20], [3, -20, 20]]
    world = world_of(meshes=[{"vertices": wall, "triangles": [[0, 1, 2], [0, 2, 3]]}])
    batch = placed([world], [[4.5, 0, 0]], drone=HULL)
    assert mask_of(ThirdPersonView(batch).frame(0), "hull").sum() > 2000
    canvas = viewed(world, (4.5, 0, 0))
    assert canvas.project(np.array([[4.5, 0, 0.0]]))[0, 2] < 2.5


def test_beams_and_hits(room):
    lidar = flockstep.LidarConfig(azimuth_deg=[0], elevation_deg=[0], max_range_m=10)
    batch = placed([room], [[2, 6, 2]], lidar=lidar)
    batch.sense()
    plain, drawn = ThirdPersonView(batch, beams=False).frame(0), ThirdPersonView(batch).frame(0)
    assert batch.lidar().ranges[0, 0, 0] == pytest.approx(6)
    canvas = viewed(room, (2, 6, 2))
    (begin, end) = canvas.project(np.array([[2, 6, 2], [8, 6, 2.0]]))[:, :2]
    difference = changed(drawn, plain)
    rows, columns = np.nonzero(difference)
    # Only along the line from the drone to the wall.
    along = np.clip(((np.stack([columns, rows], 1) + 0.5 - begin) @ (end - begin)) / ((end - begin) ** 2).sum(), 0, 1)
    distance = np.linalg.norm(np.stack([columns, rows], 1) + 0.5 - begin - along[:, None] * (end - begin), axis=1)
    assert distance.max() < 4
    column, row = end.astype(int)
    assert (mask_of(drawn, "hit") & difference)[row - 2 : row + 3, column - 2 : column + 3].any()
    assert (mask_of(drawn, "beam") & difference).sum() > 50


def test_a_beam_that_misses_ends_without_a_dot(room):
    lidar = flockstep.LidarConfig(beams=9, hfov_deg=90, max_range_m=0.8)
    batch = placed([room], [[2, 6, 2]], lidar=lidar, drone=HULL)  # orange propellers look like dots
    batch.sense()
    assert np.isinf(batch.lidar().ranges).all()
    plain, drawn = ThirdPersonView(batch, beams=False).frame(0), ThirdPersonView(batch).frame(0)
    assert (mask_of(drawn, "beam") & changed(drawn, plain)).sum() > 50
    assert not (mask_of(drawn, "hit") & changed(drawn, plain)).any()


def test_a_frustums_corners_are_the_images_corners():
    camera = flockstep.CameraConfig(
        width_px=60, height_px=50, hfov_deg=70, vfov_deg=90, offset_m=(0.1, -0.2, 0.3), quat_wxyz=(0.6, 0, 0.8, 0)
    )
    from flockstep.pictures.depth_canvas import DepthCanvas

    points = frustum(camera, 1.5)
    np.testing.assert_allclose(points[0], camera.offset_m, atol=1e-7)
    own = DepthCanvas(
        np.zeros((50, 60, 3), np.uint8),
        np.zeros((50, 60), np.float32),
        camera,
        np.array(camera.offset_m),
        np.array(camera.quat_wxyz),
        flockstep.World.playground(0).light,
    )
    expected = [[0, 0, 1.5], [60, 0, 1.5], [60, 50, 1.5], [0, 50, 1.5]]
    np.testing.assert_allclose(own.project(points[1:]), expected, atol=1e-4)


def test_each_drones_own_camera_is_drawn(room):
    camera = flockstep.CameraConfig(name="belly", width_px=8, height_px=6)
    batch = placed([room], [[2, 6, 2], [2, 6, 2]], cameras=[camera])
    batch.set_camera(np.array([False, True]), "belly", quat_wxyz=[0.70710678, 0, 0.70710678, 0])
    view = ThirdPersonView(batch, cameras=["belly"])
    ahead, down = view.frame(0), view.frame(1)
    canvas = viewed(room, (2, 6, 2))
    for image, direction in ((ahead, [1, 0, 0]), (down, [0, 0, -1])):
        rows, columns = np.nonzero(mask_of(image, "frustum"))
        ((x, y, _),) = canvas.project(np.array([2, 6, 2]) + 0.8 * np.array([direction], float))
        assert len(rows) > 100
        assert np.hypot(columns.mean() - x, rows.mean() - y) < 40
    with refused(ValueError, "camera", "belly", "front"):
        ThirdPersonView(batch, cameras=["front"])


@DRONES
def test_the_other_drones_of_the_world_are_drawn_if_asked_for(room, closet, drone):
    batch = flockstep.Batch([dim(room), closet], 4, world_index=[0, 0, 1, 0], drone=drone)
    batch.set_pose(np.float32([[2, 6, 2], [3.5, 6.9, 2], [3.5, 6.9, 2], [2, 6, 2]]))  # the last equals the first
    alone, fleet = ThirdPersonView(batch), ThirdPersonView(batch, others=True)
    own, all_of_them = alone.frame(0), fleet.frame(0)
    rows, columns = np.nonzero(changed(all_of_them, own))
    ((x, y, _),) = viewed(room, (2, 6, 2)).project(np.array([[3.5, 6.9, 2]]))
    assert len(rows) > 200
    assert np.hypot(columns.mean() - x, rows.mean() - y) < 0.3 * np.ptp(columns)
    batch.remove([1, 3])
    np.testing.assert_array_equal(fleet.frame(0), own)
    batch.remove([0])
    assert not changed(all_of_them, own)[changed(own, alone.frame(0))].any()  # the own drone's pixels are unchanged


def test_the_trail_is_where_the_drone_was(room):
    batch = flockstep.Batch([room])
    trail = Trail(batch)
    for x in np.arange(2, 4.01, 0.25):
        batch.set_pose(np.float32([[x, 6.5, 2]]))
        trail.record()
    path = trail.of(0)
    np.testing.assert_allclose(path, [[x, 6.5, 2] for x in np.arange(2, 4.01, 0.25)], atol=1e-6)
    plain, drawn = ThirdPersonView(batch).frame(0), ThirdPersonView(batch, trail=trail).frame(0)
    difference = changed(drawn, plain)
    inside = 0
    for x, y, _ in viewed(room, (4, 6.5, 2)).project(path[4:7].astype(float)):
        if 2 < x < 637 and 2 < y < 477:
            inside += 1
            assert difference[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2].any()
    assert inside >= 2


def test_a_trail_begins_with_its_episode():
    envs = begun(3, worlds="train", render_mode="rgb_array", render_view="third_person", max_episode_steps=4)
    start = envs.batch.position.copy()
    for _ in range(4):
        envs.step([0, 1, 2])
    assert envs.trail is not None
    for drone in range(3):
        path = envs.trail.of(drone)
        assert path.shape == (5, 3)
        np.testing.assert_array_equal(path[0], start[drone])
        np.testing.assert_array_equal(path[-1], envs.batch.position[drone])
    envs.step([0, 0, 0])  # all begin new episodes
    assert [len(envs.trail.of(drone)) for drone in range(3)] == [1, 1, 1]
    envs.step([0, 0, 0])
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert [len(envs.trail.of(drone)) for drone in range(3)] == [3, 1, 3]
    blob = envs.snapshot()
    envs.step([0, 0, 0])
    envs.restore(blob)
    assert [len(envs.trail.of(drone)) for drone in range(3)] == [1, 1, 1]
    envs.reset(seed=0)  # with the same episode number
    assert [len(envs.trail.of(drone)) for drone in range(3)] == [1, 1, 1]
    envs.close()


def test_a_trail_drops_old_points(room):
    batch = flockstep.Batch([room], 2)
    trail = Trail(batch, max_steps=10)
    for step in range(25):
        batch.set_pose(np.float32([[step * 0.1, 1, 1], [step * 0.1, 2, 1]]))
        trail.record(np.array([False, step == 20]))
    np.testing.assert_allclose(trail.of(0)[:, 0], np.arange(15, 25) * 0.1, atol=1e-6)
    np.testing.assert_allclose(trail.of(1)[:, 0], np.arange(20, 25) * 0.1, atol=1e-6)


def test_a_removed_drone_is_not_drawn(room):
    batch = flockstep.Batch([room], lidar=flockstep.LidarConfig())
    batch.sense()
    batch.remove([0])
    stage = Stage(room, LENGTH, (640, 480), 4)
    canvas, faded = stage.set(batch.position[0].astype(float), batch.quat_wxyz[0].astype(float))
    faded.draw(canvas)  # the start marker
    np.testing.assert_array_equal(ThirdPersonView(batch).frame(0), canvas.rgb)


def test_a_picture_depends_only_on_its_env(room, closet):
    batch = flockstep.Batch([room, closet], 3)
    view = ThirdPersonView(batch, size_px=(96, 64))
    frames = [view.frame(i) for i in (0, 1, 2, 0)]
    assert frames[0].shape == (64, 96, 3)
    np.testing.assert_array_equal(frames[0], frames[3])
    np.testing.assert_array_equal(frames[0], frames[2])
    assert changed(frames[0], frames[1]).any()


def test_a_small_hull_is_drawn_at_a_size_to_be_seen(room):
    drone = flockstep.DroneModel(np.float32([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]))
    batch = placed([room], [[5, 6, 2]], drone=drone)
    assert mask_of(ThirdPersonView(batch).frame(0), "hull").sum() > 500


def test_a_hull_has_lines_along_its_edges(room, monkeypatch):
    batch = flockstep.Batch([room], drone=HULL)
    batch.set_pose(np.float32([[5, 6, 2]]), np.float32([[0.8, 0, 0, 0.6]]))
    view = ThirdPersonView(batch)
    lined = view.frame(0)
    starts = view._body.edges[:, 0]
    monkeypatch.setattr(view._body, "edges", np.zeros((0, 2, 3)))
    rows, columns = np.nonzero(changed(lined, view.frame(0)))
    turned = rotate(batch.quat_wxyz[0].astype(float), starts.astype(float)) + batch.position[0]
    ends = viewed(room, batch.position[0], batch.quat_wxyz[0]).project(turned)[:, :2]
    apart = np.hypot(columns + 0.5 - ends[:, :1], rows + 0.5 - ends[:, 1:]).min(axis=1)
    assert (apart < 2).mean() > 0.4  # the corners that are not hidden
    assert len(rows) > 200


def test_from_a_fixed_place_the_world_stays_and_all_drones_of_it_are_seen(room, closet):
    place = ((0.5, 7.5, 3.5), (5, 3, 1.5))
    batch = placed([room, closet], [[3, 6, 2], [5.5, 5, 1], [1, 1, 0.6]], world_index=[0, 0, 1])
    view = ThirdPersonView(batch, others=True, place=tuple(np.array(point) for point in place))
    image = view.frame(0)
    bare = flockstep.render(
        room, place[0], look_at=place[1], camera=flockstep.CameraConfig(hfov_deg=75, samples_per_pixel=4, shadows=True)
    )["rgb"]
    canvas = Stage(room, LENGTH, (640, 480)).seen_from(*(np.array(point) for point in place))
    rows, columns = np.nonzero(np.abs(image.astype(int) - bare).max(axis=-1) > 24)
    near = np.zeros(len(rows), bool)
    for x, y, depth in canvas.project(np.array([[3, 6, 2], [5.5, 5, 1.0]])):
        around = np.hypot(columns - x, rows - y) < 0.6 * 417 / depth
        assert around.sum() > 300
        near |= around
    assert near.mean() > 0.99  # silhouettes are averaged differently
    batch.set_pose(np.float32([[3, 6.5, 2], [5.5, 5, 1], [1, 1, 0.6]]))
    moved = view.frame(0)
    assert changed(moved, image).any()
    np.testing.assert_array_equal(view.frame(0), moved)  # earlier drawings are not in the next picture
    batch.remove([0, 1])
    np.testing.assert_allclose(view.frame(0).astype(int)[::7, ::7], bare[::7, ::7], atol=80)


def test_a_viewer_follows_smoothly_and_keeps_the_drone_in_view(room):
    """Steps back and forth: the viewer moves half as far as the drone and stays in reach."""
    batch = flockstep.Batch([room])
    trail = Trail(batch)
    view = ThirdPersonView(batch, trail=trail)
    anchors = []
    for step in range(30):
        batch.set_pose(np.float32([[2 + 0.05 * step, 6.0 + 0.1 * (step % 2), 2]]))
        trail.record()
        anchors.append(view._anchor(0, batch.position[0].astype(float)))
    steps = np.abs(np.diff(np.array(anchors), axis=0))
    assert steps[12:, 1].max() < 0.02
    assert steps[12:, 0].max() == pytest.approx(0.05, abs=1e-5)
    batch.set_pose(np.float32([[7, 2, 2]]))
    trail.record()
    np.testing.assert_allclose(
        np.linalg.norm(view._anchor(0, np.array([7.0, 2, 2])) - [7, 2, 2]), 0.5 * LENGTH, atol=1e-4
    )


def test_nothing_is_too_far_away_to_be_seen():
    """A tower 5 km away, beyond the range of the drone's own camera, in every view with depth."""
    world = world_of(boxes=[{"center": [5000, 0, 0], "size": [200, 200, 4000]}])
    depth = viewed(world, (0, 0, 1500)).depth
    assert depth[np.isfinite(depth)].min() > 3500
    assert np.isfinite(depth).sum() > 1000
    tower = flockstep.render(world, (0, 0, 0), look_at=(1, 0, 0))["rgb"]
    assert (tower[240, 318:322] != tower[240, 0]).any()


def test_an_envs_own_camera_is_shown_and_its_view_drawn(room):
    camera = flockstep.CameraConfig(name="eye", width_px=32, height_px=24)
    shown = {}
    for name in ("camera", "third_person"):
        envs = begun(2, worlds=room, camera=camera, render_mode="rgb_array", render_view=name)
        envs.step([0, 2])
        shown[name] = envs.render()
        if name == "camera":
            np.testing.assert_array_equal(shown[name], envs.batch.camera("eye").rgb)
        envs.close()
    assert mask_of(shown["third_person"][0], "frustum").sum() > 100
    single = flockstep.DroneEnv(worlds=room, camera=camera, render_mode="rgb_array", render_view="camera")
    single.reset(seed=0)
    single.step(0)
    np.testing.assert_array_equal(single.render(), shown["camera"][0])
