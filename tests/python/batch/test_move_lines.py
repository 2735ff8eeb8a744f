"""Move lines and visible beams: recorded paths, and pictures of the lines against a projection by hand."""

import time
from itertools import pairwise

import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused
from scipy.spatial.transform import Rotation

import flockstep

OPEN = world_of(room={"min": [-200] * 3, "max": [200] * 3})
GREEN, ORANGE = np.array([0, 230, 60]), np.array([250, 130, 70])


def batch_of(worlds=(OPEN,), num_drones=2, drones_per_env=2, **camera):
    """Two drones in an env: the first takes the pictures, the second draws the line."""
    config = flockstep.CameraConfig(**{"width_px": 160, "height_px": 120, "outputs": ["rgb", "depth"], **camera})
    return flockstep.Batch(list(worlds), num_drones, drones_per_env=drones_per_env, cameras=[config])


def draw(batch, points, drone=1):
    """Make a line through points (K, 3) with one drone; a row of NaN begins a new piece."""
    only = np.arange(batch.num_drones) == drone
    batch.set_move_line_visible(False, only)
    begins = True
    for number, point in enumerate(np.asarray(points, float)):
        place = np.tile(point, (batch.num_drones, 1))
        if np.isnan(point).any():
            begins = True
        elif begins:
            batch.set_pose(place, mask=only)
            if number == 0:
                batch.set_move_line_visible(True, only)
            begins = False
        else:
            batch.move(place, mask=only)


def points_of(batch, drone=1):
    return batch.move_line(drone).tolist()


class TestRecording:
    def test_positions_after_motions(self):
        batch = batch_of()
        assert batch.move_line_visible.tolist() == [False, False]
        assert batch.move_line(1).shape == (0, 3)
        batch.move([[1, 0, 0]] * 2)
        batch.set_move_line_visible(True, [False, True])
        assert batch.move_line_visible.tolist() == [False, True]
        assert points_of(batch) == [[1, 0, 0]]
        batch.move([[2, 0, 0]] * 2)
        batch.move([[3, 0, 0]] * 2, mask=[True, False])
        batch.move([[2, 0, 0]] * 2)  # the drone rests
        batch.move([[2, 1, 0]] * 2)
        batch.sense()
        assert points_of(batch) == [[1, 0, 0], [2, 0, 0], [2, 1, 0]]
        assert batch.move_line(0).shape == (0, 3)
        assert batch.move_line(1).dtype == np.float32
        batch.set_move_line_visible(True)  # the line of drone 1 goes on
        assert len(batch.move_line(1)) == 3
        batch.set_move_line_visible(False)
        assert batch.move_line(1).shape == (0, 3)
        assert not batch.move_line_visible.any()
        batch.set_move_line_visible(True)
        assert points_of(batch) == [[2, 1, 0]]

    def test_flight_by_rotors(self):
        dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
        batch = flockstep.Batch([OPEN], 3, dynamics=dynamics)
        batch.set_move_line_visible(True, [True, False, True])
        path = [batch.position.copy()]
        for _ in range(20):
            batch.fly(np.tile([1, 0, 0.5, 0], (3, 1)), ticks=30)  # one point for each call
            path.append(batch.position.copy())
        np.testing.assert_array_equal(batch.move_line(2), np.array(path)[:, 2])
        assert len(batch.move_line(1)) == 0

    def test_slots(self):
        batch = batch_of(num_drones=3, drones_per_env=1)
        batch.set_move_line_visible(True)
        batch.move([[1, 0, 0]] * 3)
        batch.remove([1])
        assert batch.move_line_visible.tolist() == [True, False, True]
        assert len(batch.move_line(1)) == 0
        batch.spawn([1, 2], [[5, 0, 0], [6, 0, 0]])
        batch.move([[7, 0, 0]] * 3)
        assert batch.move_line_visible.tolist() == [True, False, True]
        np.testing.assert_array_equal(batch.move_line(2), [[0, 0, 0], [1, 0, 0], [np.nan] * 3, [6, 0, 0], [7, 0, 0]])

    def test_another_world_begins_a_new_line(self):
        other = world_of(room={"min": [-9] * 3, "max": [9] * 3})
        batch = batch_of([OPEN, other], 2, 1, outputs=["rgb"])
        batch.set_move_line_visible(True)
        batch.move([[1, 0, 0]] * 2)
        batch.set_world([1, 1])
        assert len(batch.move_line(0)) == 0
        assert len(batch.move_line(1)) == 2
        batch.move([[2, 0, 0]] * 2)
        batch.move([[3, 0, 0]] * 2)
        assert points_of(batch, 0) == [[2, 0, 0], [3, 0, 0]]

    @pytest.mark.parametrize("mode", ["next_step", "same_step"])
    @pytest.mark.parametrize("random_world", [False, True])
    def test_episodes(self, mode, random_world):
        """No segment is longer than a step; a reset begins a piece at the start."""
        envs = begun(
            6, worlds="train", autoreset_mode=mode, max_episode_steps=15, random_world=random_world, drones_per_env=2
        )
        batch = envs.batch
        batch.set_move_line_visible(True)
        actions = np.random.default_rng(0)
        for _ in range(100):
            envs.step(actions.integers(0, 3, envs.num_envs))
        for drone in range(batch.num_drones):
            path = batch.move_line(drone)
            ends = np.flatnonzero(np.isnan(path[:, 0]))
            lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
            assert np.nanmax(lengths) < 0.11
            np.testing.assert_array_equal(path[-1], batch.position[drone])
            if random_world:
                continue
            assert len(ends) >= 5
            start = batch.world_of(drone).start
            np.testing.assert_array_equal(path[ends + 1], np.tile(start, (len(ends), 1)).astype(np.float32))
        pieces = [np.isnan(batch.move_line(i)[:, 0]).sum() for i in range(4)]
        envs.reset(options={"reset_mask": np.arange(envs.num_envs) < 2})
        for drone, before in enumerate(pieces):
            if not random_world:
                assert np.isnan(batch.move_line(drone)[:, 0]).sum() - before in ((0, 1) if drone < 2 else (0,))
            np.testing.assert_array_equal(batch.move_line(drone)[-1], batch.position[drone])

    def test_not_in_snapshots(self):
        batch, plain = batch_of(), batch_of()
        batch.set_move_line_visible(True, [False, True])
        for one in (batch, plain):
            one.move([[1, 0, 0]] * 2)
        assert batch.snapshot() == plain.snapshot()
        snapshot = batch.snapshot()
        batch.move([[9, 9, 0]] * 2)
        batch.restore(snapshot)
        assert batch.move_line_visible.tolist() == [False, True]
        np.testing.assert_array_equal(batch.move_line(1), [[0, 0, 0], [1, 0, 0], [9, 9, 0], [np.nan] * 3, [1, 0, 0]])
        plain.restore(snapshot)
        assert not plain.move_line_visible.any()

    def test_observations_do_not_change(self):
        def flown(visible):
            envs = flockstep.DroneVectorEnv(
                4, worlds="train", camera=flockstep.CameraConfig(width_px=32, height_px=24), max_episode_steps=20
            )
            found = [envs.reset(seed=3)[0]]
            if visible:
                envs.batch.set_move_line_visible(True)
            for step in range(50):
                found += envs.step(np.full(4, step % 3))[:4]
                found.append(envs.batch.camera().rgb.copy())
                if visible:
                    envs.batch.picture(0)
            return found

        np.testing.assert_equal(flown(False), flown(True))

    @pytest.mark.parametrize(
        ("call", "error", "said"),
        [
            (lambda b: b.set_move_line_visible(1), TypeError, ["visible", 1]),
            (lambda b: b.set_move_line_visible(True, [True]), ValueError, ["mask", (2,)]),
            (lambda b: b.move_line(2), ValueError, ["index", 2]),
            (lambda b: b.move_line(-1), ValueError, ["index", -1]),
            (lambda b: b.picture(2), ValueError, ["index", 2]),
            (lambda b: b.picture(0, "back"), ValueError, ["camera", "front", "back"]),
            (lambda b: b.picture(0), ValueError, ["index", "stale"]),
            (lambda b: batch_of(outputs=["depth"]).picture(0), ValueError, ["camera", "rgb", "front"]),
        ],
    )
    def test_refusals(self, call, error, said):
        batch = batch_of()
        with refused(error, *said):
            call(batch)
        assert not batch.move_line_visible.any()


def covered(path, camera, position, quat_wxyz, size=None):
    """The share of each pixel (H, W) that lines of width 2 W / 640, at least 1, cover; and the line's depth there.

    A pinhole by hand: no code of the package except the focal lengths of the configuration.
    """
    width, height = size or (camera.width_px, camera.height_px)
    to_body = Rotation.from_quat(quat_wxyz, scalar_first=True)
    to_camera = Rotation.from_quat(camera.quat_wxyz, scalar_first=True)
    local = to_body.inv().apply(np.asarray(path, float) - position) - camera.offset_m
    local = to_camera.inv().apply(local)
    half = max(width / 640, 0.5)
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    best, depth = np.full((height, width), np.inf), np.full((height, width), np.nan)
    for a, b in pairwise(local):
        if np.isnan(a).any() or np.isnan(b).any() or max(a[0], b[0]) < camera.near_m or min(a[0], b[0]) > camera.far_m:
            continue
        ends = []
        for p, q in ((a, b), (b, a)):
            for plane, beyond in ((camera.near_m, p[0] < camera.near_m), (camera.far_m, p[0] > camera.far_m)):
                if beyond:
                    p = p + (plane - p[0]) / (q[0] - p[0]) * (q - p)
            ends.append(p)
        (x0, y0), (x1, y1) = (
            (
                (camera.cx - camera.fx * p[1] / p[0]) * width / camera.width_px,
                (camera.cy - camera.fy * p[2] / p[0]) * height / camera.height_px,
            )
            for p in ends
        )
        square = (x1 - x0) ** 2 + (y1 - y0) ** 2
        t = np.clip(((columns - x0) * (x1 - x0) + (rows - y0) * (y1 - y0)) / max(square, 1e-12), 0, 1)
        distance = np.hypot(columns - x0 - t * (x1 - x0), rows - y0 - t * (y1 - y0))
        nearer = distance < best
        best[nearer] = distance[nearer]
        depth[nearer] = (1 / (1 / ends[0][0] + t * (1 / ends[1][0] - 1 / ends[0][0])))[nearer]
    return np.clip(half + 0.5 - best, 0, 1), depth


def expect_drawn(picture, frame, share, visible=True, color=GREEN):
    """The picture is the frame with a colour blended in by these shares; visible: (H, W), False where nothing is."""
    share = np.where(visible, share, 0)[..., None]
    expected = frame + share * (color - frame.astype(float))
    assert np.abs(picture - expected).max() <= 0.6


TURNED = tuple(Rotation.from_euler("xyz", [0.2, 0.4, 2.0]).as_quat(scalar_first=True))
CAMERAS = {
    "default": {},
    "large": {"width_px": 640, "height_px": 480},
    "odd size": {"width_px": 97, "height_px": 61, "vfov_deg": 70.0},
    "wide and narrow": {"width_px": 1280, "height_px": 720, "hfov_deg": 40.0},
    "mounted": {"offset_m": (0.3, -0.2, 0.1), "quat_wxyz": TURNED},
    "chw": {"layout": "chw"},
    "grey": {"outputs": ["grey"]},
    "resized": {"outputs": ["depth", "grey", "rgb"], "resize": (80, 90)},
    "resized chw": {"layout": "chw", "resize": (53, 40)},
    "near and far": {"near_m": 2.0, "far_m": 9.0},
    "samples": {"samples_per_pixel": 4},
}


class TestPicture:
    @pytest.mark.parametrize("case", CAMERAS)
    def test_lines_in_the_open(self, case):
        """Random lines, among them some that cross the near plane, the image's border, or lie behind the camera."""
        batch = batch_of(**CAMERAS[case])
        rng = np.random.default_rng(1)
        drawn = 0
        for _ in range(6):
            position = rng.uniform(-50, 50, 3).astype(np.float32)
            quat = (
                Rotation.random(random_state=int(rng.integers(1 << 30))).as_quat(scalar_first=True).astype(np.float32)
            )
            path = position + rng.normal(size=(12, 3)) * rng.uniform(0.3, 8)
            path[5] = np.nan
            draw(batch, path)
            batch.set_pose([position] * 2, [quat] * 2, mask=[True, False])
            batch.capture()
            config, view = batch.camera().config, batch.camera()
            picture = batch.picture(0)
            width, height = config.image_size_px
            assert picture.shape == (height, width, 3)
            assert picture.dtype == np.uint8
            if "rgb" in config.outputs:
                frame = view.rgb[0] if config.layout == "hwc" else view.rgb[0].transpose(1, 2, 0)
            else:
                frame = np.repeat(view.grey[0][..., None], 3, axis=-1)
            share, _ = covered(batch.move_line(1), config, position, quat, (width, height))
            expect_drawn(picture, frame, share)
            drawn += (share > 0.5).sum()
            batch.set_move_line_visible(False)
            np.testing.assert_array_equal(batch.picture(0), frame)
        assert drawn > 100

    @pytest.mark.parametrize("scene", ["playground/train-1", "outdoor/forest", "indoor/office"])
    def test_scenes_hide_lines_as_their_depth_says(self, scene):
        """In whole scenes, with markers, meshes and masked leaves: a line shows where it is nearer than the frame."""
        world = flockstep.World.load(scene)
        camera = flockstep.CameraConfig(width_px=320, height_px=240, outputs=["rgb", "depth"])
        batch = flockstep.Batch([world], 2, drones_per_env=2, cameras=[camera])
        places = world.free_places(40, seed=2)
        rng = np.random.default_rng(0)
        hidden = shown = 0
        for place in places[:6]:
            # Pieces of two points each, anywhere.
            path = np.full((60, 3), np.nan)
            path[0::3] = place + rng.normal(size=(20, 3)) * 3
            path[1::3] = place + rng.normal(size=(20, 3)) * 3
            only = np.array([False, True])
            batch.set_move_line_visible(False)
            batch.set_pose(np.tile(path[0], (2, 1)), mask=only)
            batch.set_move_line_visible(True, only)
            for a, b in zip(path[0::3], path[1::3], strict=True):
                batch.set_pose(np.tile(a, (2, 1)), mask=only)
                batch.move(np.tile(b, (2, 1)), mask=only)
            yaw = rng.uniform(0, 2 * np.pi)
            quat = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
            batch.set_pose([place] * 2, [quat] * 2, mask=~only)
            batch.capture()
            picture, frame, seen = batch.picture(0), batch.camera().rgb[0].astype(int), batch.camera().depth[0]
            share, depth = covered(batch.move_line(1), camera, place, quat)
            # Around a pixel the scene may be nearer or farther than at its centre.
            around = np.stack([np.roll(seen, (i, j), (0, 1)) for i in (-2, -1, 0, 1, 2) for j in (-2, -1, 0, 1, 2)])
            single = (share > 0.5) & (np.linalg.norm(GREEN - frame, axis=-1) > 60)
            is_shown = single & (depth < around.min(axis=0) - 0.05)
            is_hidden = single & (depth > around.max(axis=0) + 0.05)
            parts = [covered(batch.move_line(1)[k : k + 2], camera, place, quat)[0] > 0 for k in range(0, 60, 3)]
            once = np.sum(parts, axis=0) == 1  # elsewhere one line may be hidden and another not
            alone, is_shown = is_hidden & once, is_shown & once
            if is_shown.any():
                expect_drawn(picture[is_shown], frame[is_shown], share[is_shown])
            assert (picture[alone] == frame[alone]).all()
            shown += is_shown.sum()
            hidden += alone.sum()
        assert shown > 200
        assert hidden > 200

    def test_a_frame_keeps_its_pose(self):
        """The lines are drawn from where the frame was taken, although the drone has moved on."""
        batch = batch_of(capture_mode="on_demand")
        draw(batch, [[5, -2, 0], [5, 2, 1]])
        batch.set_pose([[0, 0, 0]] * 2, mask=[True, False])
        batch.capture()
        before = batch.picture(0)
        batch.move([[3, 1, 0]] * 2, mask=[True, False])
        np.testing.assert_array_equal(batch.picture(0), before)
        batch.set_world([0])
        batch.set_camera(hfov_deg=50)
        with refused(ValueError, "index", "not stale"):
            batch.picture(0)

    def test_ten_thousand_points_take_less_than_a_second(self):
        batch = batch_of(num_drones=4, drones_per_env=4, width_px=640, height_px=480)
        batch.set_move_line_visible(True, [False, True, True, True])
        t = np.linspace(0, 60, 4000)
        for angle in t:
            place = np.array([6 + np.cos(angle), 3 * np.sin(0.71 * angle), 2 * np.sin(0.37 * angle)])
            batch.move([[0, 0, 0], place, np.add(place, (1, 0, 0)), np.add(place, (-1, 0, 0))])
        assert sum(len(batch.move_line(i)) for i in range(4)) > 10_000
        batch.capture()
        began = time.perf_counter()
        picture = batch.picture(0)
        taken = time.perf_counter() - began
        print(f"{1e3 * taken:.1f} ms")
        assert (picture == GREEN).all(axis=-1).sum() > 1000
        assert taken < 1


class TestRender:
    @pytest.mark.parametrize("view", ["top", "third_person", "camera", "fleet", ((1, 1, 4), (4, 6, 1))])
    def test_every_view_shows_the_line(self, view):
        envs = begun(
            3,
            worlds="playground/train-1",
            camera=flockstep.CameraConfig(width_px=128, height_px=96),
            render_mode="rgb_array",
            render_view=view,
        )

        def fly(visible):
            envs.reset(seed=0)
            envs.batch.set_move_line_visible(False)
            envs.batch.set_move_line_visible(visible, [True, False, True])
            for action in [0] * 15 + [1] * 5 + [0] * 15:
                envs.step([action] * 3)
            if view == "camera":  # look back at the path, from above it
                turned = [np.cos(1.57), 0, 0, np.sin(1.57)]
                envs.batch.set_pose(np.add(envs.batch.position, (0, 0, 0.5)), [turned] * 3)
                envs.batch.sense()
            return envs.render()

        usual, shown = fly(False), fly(True)
        for drone in (0, 2):
            changed = (shown[drone] != usual[drone]).any(axis=-1)
            assert changed.sum() > 20
            more_green = shown[drone][changed].astype(int) - usual[drone][changed]
            assert (more_green[:, 1] > more_green[:, [0, 2]].max(axis=1)).mean() > 0.95
        if view in ("top", "third_person", "camera"):
            np.testing.assert_array_equal(shown[1], usual[1])


WALL = {"box": {"center": [8, 0, 0], "size": [0.2, 3, 8]}, "range_m": 3.0}


def with_beams(**keywords):
    """Two drones in an env: the first looks at the second, some of whose beams hit a wall. Both have been sensed."""
    world = world_of(room={"min": [-20] * 3, "max": [20] * 3}, boxes=[WALL["box"]])
    lidar = flockstep.LidarConfig(beams=5, hfov_deg=120, channels=3, vfov_deg=50, max_range_m=WALL["range_m"])
    camera = flockstep.CameraConfig(width_px=320, height_px=240, outputs=["rgb", "depth"])
    batch = flockstep.Batch([world], 2, drones_per_env=2, cameras=[camera], lidar=lidar, **keywords)
    batch.set_pose([[0, 0, 0.3], [6, 0.2, -0.1]])
    batch.sense()
    return batch


def beams(batch, drone):
    """The lines of a drone's beams, (3 K, 3) m, with a row of NaN behind each."""
    ways, ranges = batch.lidar().directions[drone].reshape(-1, 3), batch.lidar().ranges[drone].reshape(-1, 1)
    origin = np.broadcast_to(batch.position[drone], ways.shape)
    ends = origin + ways * np.minimum(ranges, WALL["range_m"])
    return np.stack([origin, ends, np.full(ways.shape, np.nan)], axis=1).reshape(-1, 3)


class TestBeams:
    def test_pictures_show_beams_where_they_are_and_nowhere_else(self):
        batch = with_beams()
        ranges = batch.lidar().ranges[1]
        assert 3 <= np.isfinite(ranges).sum() <= ranges.size - 3
        frame = batch.picture(0)
        batch.set_beams_visible(True, [False, True])
        assert batch.beams_visible.tolist() == [False, True]
        share, depth = covered(beams(batch, 1), batch.camera().config, [0, 0, 0.3], [1, 0, 0, 0])
        seen = batch.camera().depth[0]
        hidden = (share > 0) & (depth > seen + 1e-3)  # behind the wall
        assert (share[~hidden] > 0.5).sum() > 500
        expect_drawn(batch.picture(0), frame, share, ~hidden, ORANGE)
        batch.set_beams_visible(False)
        np.testing.assert_array_equal(batch.picture(0), frame)

    def test_a_picture_scans_from_where_the_drone_is_now(self):
        batch = with_beams()
        batch.set_beams_visible(True, [False, True])
        batch.set_pose([[0, 0, 0.3], [5, -1.0, 0.4]])
        batch.capture()
        unsensed = batch.picture(0)
        batch.sense()
        np.testing.assert_array_equal(unsensed, batch.picture(0))
        batch.remove([1])
        assert not batch.beams_visible.any()

    @pytest.mark.parametrize("view", ["top", "third_person", "fleet"])
    def test_views_show_them_at_run_time(self, view):
        def rendered(beams, visible=False):
            envs = flockstep.DroneVectorEnv(
                2, worlds="train", render_mode="rgb_array", render_view=view, render_beams=beams, max_episode_steps=9
            )
            envs.reset(seed=1)
            envs.batch.set_beams_visible(visible, [False, True])
            return envs.render()

        hidden, shown, at_run_time = rendered(False), rendered(True), rendered(False, True)
        np.testing.assert_array_equal(at_run_time[0], hidden[0])
        np.testing.assert_array_equal(at_run_time[1], shown[1])
        assert (hidden[1] != shown[1]).any()

    @pytest.mark.parametrize(
        ("call", "error", "said"),
        [
            (lambda b: b.set_beams_visible(1), TypeError, ["visible", 1]),
            (lambda b: b.set_beams_visible(True, [True]), ValueError, ["mask", (2,)]),
            (lambda b: flockstep.DroneVectorEnv(render_beams=1), ValueError, ["render_beams", 1]),
        ],
    )
    def test_refusals(self, call, error, said):
        batch = with_beams()
        with refused(error, *said):
            call(batch)
        assert not batch.beams_visible.any()
