"""Cameras: images as arrays, depth against two oracles, configurations, modes, errors, files, lifetimes."""

import copy
import functools
import gc
import io
import multiprocessing
import os
import pickle

import numpy as np
import pytest
import trimesh.ray.ray_triangle
from conftest import ROOT
from PIL import Image

import flockstep

OUTPUTS = {
    "rgb": (np.uint8, 3),
    "depth": (np.float32, 1),
    "semantic": (np.uint16, 1),
    "instance": (np.uint16, 1),
    "normal": (np.float32, 3),
    "grey": (np.uint8, 1),
}

# Only flat objects, so that the triangles represent the world exactly: a room, rotated boxes, a plane and hills.
FLAT = {
    "flockstep_scene": 1,
    "name": "flat",
    "materials": {
        "default": {"base_color": [0.8, 0.8, 0.8]},
        "red": {"base_color": [0.8, 0.1, 0.1]},
        "green": {"base_color": [0.1, 0.7, 0.2], "semantic": 40},
    },
    "room": {"min": [-5, -5, 0], "max": [5, 5, 4]},
    "boxes": [
        {"center": [2, -1, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.96, 0, 0.28, 0], "material": "red"},
        {"center": [-2, 2, 1.5], "size": [0.5, 1, 2], "quat_wxyz": [0.8, 0, 0, 0.6]},
    ],
    "meshes": [
        {
            "vertices": [[1, 1, 0.5], [3, 1, 0.5], [3, 3, 0.5], [1, 3, 0.5], [2, 2, 2]],
            "triangles": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
            "material": "green",
        }
    ],
    "markers": {"start": [0, 0, 2], "goal": [-3, -3, 1]},
}

# With additional round objects.
ROUND = {
    **FLAT,
    "name": "round",
    "cylinders": [{"center": [-2, -1, 1.5], "radius": 0.5, "height": 2, "quat_wxyz": [0.8, 0.6, 0, 0]}],
    "spheres": [{"center": [1, -3, 2], "radius": 0.7, "material": "green"}],
    "capsules": [{"center": [-3, 0, 1.2], "radius": 0.3, "height": 1.6, "material": "red"}],
}


@pytest.fixture(scope="module")
def flat():
    return flockstep.World.from_dict(FLAT)


@pytest.fixture(scope="module")
def round_world():
    return flockstep.World.from_dict(ROUND)


def camera_of(**fields):
    return flockstep.CameraConfig(**{"width_px": 24, "height_px": 18, "outputs": tuple(OUTPUTS), **fields})


def batch_of(worlds, num_drones=1, *, cameras=None, **arguments):
    cameras = [camera_of()] if cameras is None else cameras
    return flockstep.Batch(worlds, num_drones, cameras=cameras, **{"num_threads": 1, **arguments})


def rotation(quat_wxyz):
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def rays(batch, drone, rows, columns, camera="front"):
    """Origin (3,) and directions (R, 3) of pixels in the world frame; the component along the optical axis is 1."""
    config = batch.camera(camera).config_of(drone)
    body = rotation(batch.quat_wxyz[drone])
    mount = rotation(config.quat_wxyz)
    local = np.stack(
        [
            np.ones(len(rows)),
            (config.cx - columns - 0.5) / config.fx,
            (config.cy - rows - 0.5) / config.fy,
        ],
        axis=1,
    )
    return batch.position[drone] + body @ np.asarray(config.offset_m, float), local @ (body @ mount).T


def random_poses(rng, num_drones):
    quats = rng.normal(size=(num_drones, 4))
    position = np.stack([rng.uniform(-1, 1, num_drones), rng.uniform(-1, 1, num_drones), rng.uniform(1, 3, num_drones)])
    return position.T.astype(np.float32), quats / np.linalg.norm(quats, axis=1, keepdims=True)


class EveryTriangle:
    """A replacement for the R-tree that trimesh queries for triangles near a ray: returns all of them."""

    def __init__(self, triangles):
        self.bounds = np.concatenate([triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))])
        self._all = range(len(triangles))

    def intersection(self, _bounds):
        return self._all


def trimesh_ranges(world, origin, directions):
    """Distances (R,) m from the origin to the nearest triangle, by trimesh."""
    mesh = world.mesh()
    triangles = mesh["vertices"].astype(float)[mesh["triangles"]]
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.tile(origin.astype(float), (len(unit), 1))
    _, ray, places = trimesh.ray.ray_triangle.ray_triangle_id(triangles, origins, unit, tree=EveryTriangle(triangles))
    ranges = np.full(len(unit), np.inf)
    np.minimum.at(ranges, ray, np.linalg.norm(places - origins[ray], axis=1))
    return ranges


class TestImages:
    @pytest.mark.parametrize("layout", ["hwc", "chw"])
    @pytest.mark.parametrize(("width", "height"), [(1, 1), (17, 3), (40, 30)])
    def test_shapes_and_dtypes(self, flat, layout, width, height):
        batch = batch_of([flat], 3, cameras=[camera_of(width_px=width, height_px=height, layout=layout)])
        batch.sense()
        for output, (dtype, channels) in OUTPUTS.items():
            image = getattr(batch.camera(), output)
            shape = (3, height, width)
            if channels == 3:
                shape = (3, height, width, 3) if layout == "hwc" else (3, 3, height, width)
            assert image.dtype == dtype, output
            assert image.shape == shape, output
            assert image.flags.c_contiguous
        assert batch.camera().frame_step.dtype == np.int64
        np.testing.assert_array_equal(batch.camera().frame_step, [0, 0, 0])

    def test_the_layouts_are_one_picture(self, round_world):
        last = batch_of([round_world], 2, cameras=[camera_of(layout="hwc")])
        first = batch_of([round_world], 2, cameras=[camera_of(layout="chw")])
        for batch in (last, first):
            batch.sense()
        for output in ("rgb", "normal"):
            turned = np.moveaxis(getattr(first.camera(), output), 1, -1)
            np.testing.assert_array_equal(turned, getattr(last.camera(), output))

    def test_an_output_that_is_not_written_raises(self, flat):
        camera = batch_of([flat], cameras=[camera_of(outputs=("depth",))]).camera()
        assert camera.depth.shape == (1, 18, 24)
        for output in OUTPUTS.keys() - {"depth"}:
            with pytest.raises(ValueError, match=rf'"front": expected "{output}" among its outputs, got \(.depth.,\)'):
                getattr(camera, output)

    def test_views_are_read_only_and_written_in_place(self, flat):
        batch = batch_of([flat])
        camera = batch.camera()
        views = {output: getattr(camera, output) for output in OUTPUTS}
        assert not np.isfinite(views["depth"]).any()
        batch.sense()
        assert np.isfinite(views["depth"]).all()
        for output, view in views.items():
            assert not view.flags.writeable
            np.testing.assert_array_equal(view, getattr(batch.camera(), output))
            with pytest.raises(ValueError, match="read-only"):
                view[:] = 0
        assert not camera.frame_step.flags.writeable

    def test_cameras_and_views_outlive_their_batch(self, flat):
        kept = []
        for _ in range(20):
            batch = batch_of([flat], 50)
            batch.sense()
            camera = batch.camera()
            kept.append((camera, camera.rgb, camera.depth, camera.frame_step))
            del batch, camera
        gc.collect()
        for camera, rgb, depth, frame_step in kept:
            np.testing.assert_array_equal(camera.rgb, rgb)
            assert rgb.any()
            assert np.isfinite(depth).all()
            np.testing.assert_array_equal(frame_step, 0)
            assert camera.jpeg(49)[:2] == b"\xff\xd8"

    def test_what_is_seen_is_consistent(self, round_world):
        rng = np.random.default_rng(2)
        batch = batch_of([round_world], 20, cameras=[camera_of(far_m=6)])
        batch.set_pose(*random_poses(rng, 20))
        batch.sense()
        camera = batch.camera()
        seen = np.isfinite(camera.depth)
        assert 0.01 < 1 - seen.mean() < 0.5  # sky is beyond the range
        np.testing.assert_array_equal(camera.semantic > 0, seen)
        np.testing.assert_array_equal(camera.instance > 0, seen)
        np.testing.assert_allclose(np.linalg.norm(camera.normal, axis=-1), seen, atol=1e-5)
        mean = camera.rgb @ np.array([0.299, 0.587, 0.114])
        np.testing.assert_allclose(camera.grey, mean, atol=0.501)
        rows, columns = (grid.ravel() for grid in np.mgrid[:18, :24])
        for drone in range(20):
            _, directions = rays(batch, drone, rows, columns)
            assert ((camera.normal[drone].reshape(-1, 3) * directions).sum(axis=1)[seen[drone].ravel()] < 1e-5).all()

    def test_semantics_and_instances_are_the_worlds(self, round_world):
        batch = batch_of([round_world], 200, cameras=[camera_of(outputs=("semantic", "instance"))])
        batch.set_pose(*random_poses(np.random.default_rng(3), 200))
        batch.sense()
        camera = batch.camera()
        primitives = round_world.primitives
        semantic = {material["name"]: material["semantic"] for material in round_world.materials}
        pairs = np.unique(np.stack([camera.instance.ravel(), camera.semantic.ravel()]), axis=1).T
        # The mesh comes after the primitives, followed by start and goal.
        mesh = len(primitives) + 1
        assert semantic["green"] == 40
        expected = {i + 1: semantic[p["material"]] for i, p in enumerate(primitives)}
        expected |= {mesh: 40, mesh + 1: 65533, mesh + 2: 65535}
        seen = {int(instance): int(semantic) for instance, semantic in pairs if instance}
        assert len(seen) == len(pairs)  # each instance has one class, and a room has no sky
        assert seen == expected


class TestDepth:
    @pytest.mark.parametrize("kind", ["planar", "range"])
    def test_is_that_of_raycast(self, round_world, kind):
        rng = np.random.default_rng(4)
        mount = rng.normal(size=4)
        mount /= np.linalg.norm(mount)
        config = camera_of(depth_kind=kind, offset_m=(0.2, -0.1, 0.3), quat_wxyz=mount, hfov_deg=100, vfov_deg=60)
        scene = {**ROUND, "markers": {}}  # raycast ignores markers
        batch = batch_of([flockstep.World.from_dict(scene)], 40, cameras=[config])
        batch.set_pose(*random_poses(rng, 40))
        batch.sense()
        camera = batch.camera()
        compared = 0
        for drone in range(40):
            rows, columns = rng.integers(18, size=30), rng.integers(24, size=30)
            origin, directions = rays(batch, drone, rows, columns)
            hits = batch.worlds[0].raycast(np.tile(origin, (30, 1)), directions, 200)
            depth = hits["t_hit"]
            if kind == "planar":
                depth = depth / np.linalg.norm(directions, axis=1)
            # At a silhouette the last bit of a direction decides the hit.
            same = (
                camera.instance[drone, rows, columns] == np.minimum(hits["primitive"], len(round_world.primitives)) + 1
            )
            np.testing.assert_allclose(camera.depth[drone, rows, columns][same], depth[same], rtol=1e-4)
            np.testing.assert_allclose(camera.normal[drone, rows, columns][same], hits["normal"][same], atol=1e-2)
            compared += same.sum()
        assert compared > 0.99 * 40 * 30

    def test_is_that_of_an_independent_library(self, flat):
        rng = np.random.default_rng(5)
        world = flockstep.World.from_dict({**FLAT, "markers": {}})
        batch = batch_of([world], 12, cameras=[camera_of(depth_kind="range", near_m=1e-3)])
        batch.set_pose(*random_poses(rng, 12))
        batch.sense()
        rows, columns = (grid.ravel() for grid in np.mgrid[:18, :24])
        errors = []
        for drone in range(12):
            expected = trimesh_ranges(world, *rays(batch, drone, rows, columns))
            errors.append(np.abs(batch.camera().depth[drone].ravel() - expected))
        errors = np.concatenate(errors)
        # All except a few pixels on a silhouette, for which either may be right.
        assert (errors < 1e-4).mean() > 0.999

    def test_of_round_things_is_that_of_an_independent_library(self):
        rng = np.random.default_rng(6)
        world = flockstep.World.from_dict({**ROUND, "markers": {}})
        batch = batch_of([world], 12, cameras=[camera_of(depth_kind="range", near_m=1e-3)])
        batch.set_pose(*random_poses(rng, 12))
        batch.sense()
        errors = []
        for drone in range(12):
            rows, columns = rng.integers(18, size=100), rng.integers(24, size=100)
            expected = trimesh_ranges(world, *rays(batch, drone, rows, columns))
            errors.append(np.abs(batch.camera().depth[drone, rows, columns] - expected))
        # Chords are up to a millimetre away from the surface, more along a grazing ray.
        assert (np.concatenate(errors) < 5e-3).mean() > 0.98

    def test_planar_is_range_along_the_axis(self, round_world):
        batch = batch_of(
            [round_world],
            cameras=[camera_of(name="planar"), camera_of(name="range", depth_kind="range")],
        )
        batch.sense()
        rows, columns = (grid.ravel() for grid in np.mgrid[:18, :24])
        _, directions = rays(batch, 0, rows, columns, "planar")
        lengths = np.linalg.norm(directions, axis=1).reshape(18, 24)
        np.testing.assert_allclose(batch.camera("planar").depth[0] * lengths, batch.camera("range").depth[0], rtol=1e-6)


class TestConfig:
    def test_defaults_are_those_of_the_thesis(self):
        config = flockstep.CameraConfig()
        assert (config.name, config.width_px, config.height_px) == ("front", 640, 480)
        assert (config.fx, config.fy, config.cx, config.cy) == (320, 320, 320, 240)
        assert config.outputs == ("rgb",)
        assert (config.capture_mode, config.layout, config.depth_kind) == ("every_step", "hwc", "planar")

    def test_repr_equality_and_pickling(self):
        config = camera_of(name="c", hfov_deg=70, quat_wxyz=(0, 1, 0, 0), shadows=True, samples_per_pixel=4)
        assert eval(repr(config), {"CameraConfig": flockstep.CameraConfig}) == config
        for other in (pickle.loads(pickle.dumps(config)), copy.copy(config), copy.deepcopy(config)):
            assert other == config
            assert other is not config
        assert config != camera_of(name="c", hfov_deg=71, quat_wxyz=(0, 1, 0, 0), shadows=True, samples_per_pixel=4)
        assert config != flockstep.LidarConfig()
        with pytest.raises(TypeError, match="hash"):
            hash(config)

    @pytest.mark.parametrize(
        ("fields", "match"),
        [
            ({"name": ""}, "camera.name"),
            ({"width_px": 0}, r"camera.width_px: expected an integer in \[1, 8192\], got 0"),
            ({"width_px": 100_000}, "camera.width_px.*100000"),
            ({"height_px": -1}, "camera.height_px.*-1"),
            ({"hfov_deg": 0}, r"camera.hfov_deg: expected a number in \[0.1, 179\], got 0"),
            ({"hfov_deg": 180}, "camera.hfov_deg.*180"),
            ({"vfov_deg": 180}, "camera.vfov_deg.*180"),
            ({"hfov_deg": np.nan}, "camera.hfov_deg.*nan"),
            ({"width_px": 10, "height_px": 8000, "hfov_deg": 150}, "camera.hfov_deg.*square"),
            ({"offset_m": (0, np.inf, 0)}, "camera.offset_m"),
            ({"quat_wxyz": (0, 0, 0, 0)}, "camera.quat_wxyz"),
            ({"near_m": 0}, "camera.near_m"),
            ({"near_m": 2, "far_m": 2}, "camera.far_m.*near_m"),
            ({"far_m": 0.01}, "camera.far_m"),
            ({"far_m": np.inf}, "camera.far_m"),
            ({"outputs": ()}, "camera.outputs.*at least one"),
            ({"outputs": ("rgb", "heat")}, "outputs.*rgb, depth.*heat"),
            ({"outputs": (1,)}, "outputs.*rgb, depth.*1"),
            ({"depth_kind": "deep"}, 'depth_kind: expected "planar" or "range", got "deep"'),
            ({"layout": "wch"}, 'layout: expected "hwc" or "chw", got "wch"'),
            (
                {"capture_mode": "never"},
                'capture_mode: expected "every_step", "on_movement" or "on_demand", got "never"',
            ),
            ({"samples_per_pixel": 3}, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 3"),
        ],
    )
    def test_bad_fields(self, flat, fields, match):
        with pytest.raises(ValueError, match=match):
            flockstep.CameraConfig(**fields)
        config = flockstep.CameraConfig()
        with pytest.raises(ValueError, match=match):  # fields set later are rejected at the latest here
            self.use(flat, config, fields)

    @staticmethod
    def use(world, config, fields):
        for field, value in fields.items():
            setattr(config, field, value)
        flockstep.Batch([world], cameras=[config])

    def test_outputs_given_as_a_string_are_refused(self):
        with pytest.raises(TypeError, match="outputs"):
            flockstep.CameraConfig(outputs="rgb")

    def test_unknown_fields(self):
        with pytest.raises(TypeError, match="zoom"):
            flockstep.CameraConfig(zoom=2)

    def test_two_of_one_name(self, flat):
        with pytest.raises(ValueError, match=r'camera.name.*"front"'):
            batch_of([flat], cameras=[camera_of(), camera_of()])

    def test_what_a_batch_gives_is_a_copy(self, flat):
        batch = batch_of([flat])
        batch.camera().config.width_px = 3
        assert batch.camera().config == camera_of()
        batch.set_camera(hfov_deg=40)
        assert batch.camera().config == camera_of()
        assert batch.camera().config_of(0) == camera_of(hfov_deg=40)


class TestModes:
    @staticmethod
    def shown(batch):
        """The drones' positions according to their frames: the wall ahead is at x = 5, with nothing in front of it."""
        return 5 - batch.camera().depth[:, 0, 0]

    @pytest.fixture
    def probes(self):
        hall = flockstep.World.from_dict(
            {"flockstep_scene": 1, "name": "hall", "room": {"min": [-5, -5, -5], "max": [5, 5, 5]}}
        )

        def make(mode):
            config = camera_of(width_px=1, height_px=1, outputs=("depth",), capture_mode=mode)
            batch = batch_of([hall], 3, cameras=[config])
            batch.set_pose([[1, 0, 0], [2, 0, 0], [3, 0, 0]])
            batch.sense()
            return batch

        return make

    def test_every_step(self, probes):
        batch = probes("every_step")
        np.testing.assert_array_equal(self.shown(batch), [1, 2, 3])
        batch.set_pose([[2, 0, 0]] * 3, mask=np.array([True, False, False]))
        np.testing.assert_array_equal(self.shown(batch), [1, 2, 3])
        batch.sense()
        np.testing.assert_array_equal(self.shown(batch), [2, 2, 3])
        np.testing.assert_array_equal(batch.camera().frame_step, [1, 1, 1])

    def test_on_movement(self, probes):
        batch = probes("on_movement")
        batch.set_pose([[2, 0, 0]] * 3, mask=np.array([True, True, False]))
        batch.sense()
        np.testing.assert_array_equal(self.shown(batch), [2, 2, 3])
        np.testing.assert_array_equal(batch.camera().frame_step, [1, 0, 0])

    def test_on_demand(self, probes):
        batch = probes("on_demand")
        np.testing.assert_array_equal(batch.camera().frame_step, [-1, -1, -1])
        assert np.isinf(batch.camera().depth).all()
        batch.capture(np.array([False, True, False]))
        np.testing.assert_array_equal(batch.camera().frame_step, [-1, 0, -1])
        np.testing.assert_array_equal(self.shown(batch), [-np.inf, 2, -np.inf])
        batch.begin_episode()
        np.testing.assert_array_equal(batch.camera().frame_step, [-1, -1, -1])

    def test_can_be_changed(self, probes):
        batch = probes("on_demand")
        batch.set_capture_mode("every_step")
        assert batch.camera().config.capture_mode == "every_step"
        batch.sense()
        np.testing.assert_array_equal(self.shown(batch), [1, 2, 3])
        with pytest.raises(ValueError, match=r'capture_mode.*"sometimes"'):
            batch.set_capture_mode("sometimes")
        with pytest.raises(ValueError, match='camera: expected "front", got "back"'):
            batch.set_capture_mode("on_demand", camera="back")
        assert batch.camera().config.capture_mode == "every_step"

    def test_of_one_camera(self, flat):
        names = ("left", "right")
        batch = batch_of([flat], 2, cameras=[camera_of(name=name, capture_mode="on_demand") for name in names])

        def ages():
            return [batch.camera(name).frame_step.tolist() for name in names]

        batch.capture(camera="right")
        assert ages() == [[-1, -1], [0, 0]]
        batch.capture(np.array([True, False]), "left")
        assert ages() == [[0, -1], [0, 0]]
        for call in (batch.camera, batch.capture, batch.set_camera, lambda: batch.set_capture_mode("every_step")):
            with pytest.raises(ValueError, match=r"camera: expected one of \"left\", \"right\", got no name"):
                call()
        batch.set_capture_mode("every_step", camera="left")
        batch.sense()
        assert ages() == [[0, 0], [0, 0]]
        batch.sense()
        assert ages() == [[1, 1], [0, 0]]

    def test_a_removed_drone_sees_nothing(self, flat):
        batch = batch_of([flat], 2)
        batch.sense()
        batch.remove([1])
        batch.sense()
        camera = batch.camera()
        assert np.isinf(camera.depth[1]).all()
        for output in OUTPUTS.keys() - {"depth"}:
            assert not getattr(camera, output)[1].any(), output
            assert getattr(camera, output)[0].any(), output
        assert camera.frame_step.tolist() == [1, -1]

    def test_a_restore_brings_the_frames_back(self, round_world):
        cameras = [camera_of(capture_mode="on_movement"), camera_of(name="still", capture_mode="on_demand", width_px=9)]
        batch = batch_of([round_world], 6, cameras=cameras)
        rng = np.random.default_rng(7)
        batch.set_pose(*random_poses(rng, 6))
        batch.sense()
        batch.capture(np.arange(6) < 3, camera="still")
        batch.set_pose(*random_poses(rng, 6), mask=np.arange(6) % 2 == 0)
        batch.sense()
        batch.set_camera(np.arange(6) == 5, "front", hfov_deg=30)
        batch.set_capture_mode("on_demand", camera="front")
        blob = batch.snapshot()
        other = batch_of([round_world], 6, cameras=cameras, num_threads=3)
        other.restore(blob)
        for name in ("front", "still"):
            one, two = batch.camera(name), other.camera(name)
            np.testing.assert_array_equal(one.frame_step, two.frame_step)
            counts = one.frame_step >= 0
            assert counts.any() and not counts.all()
            for output in OUTPUTS:
                np.testing.assert_array_equal(getattr(one, output)[counts], getattr(two, output)[counts])
            assert one.config == two.config
            assert [one.config_of(i) for i in range(6)] == [two.config_of(i) for i in range(6)]


class TestChange:
    def test_of_some_drones(self, flat):
        batch = batch_of([flat], 3)
        batch.sense()
        batch.set_camera(np.array([False, True, False]), vfov_deg=30, offset_m=(0.5, 0, 0))
        assert batch.camera().frame_step.tolist() == [0, -1, 0]
        assert batch.camera().config_of(1) == camera_of(vfov_deg=30, offset_m=(0.5, 0, 0))
        batch.sense()
        made_so = batch_of([flat], cameras=[camera_of(vfov_deg=30, offset_m=(0.5, 0, 0))])
        made_so.sense()
        np.testing.assert_array_equal(batch.camera().rgb[1], made_so.camera().rgb[0])
        np.testing.assert_array_equal(batch.camera().depth[0], batch.camera().depth[2])
        assert (batch.camera().depth[0] != batch.camera().depth[1]).any()

    def test_of_nothing(self, flat):
        batch = batch_of([flat], 2)
        batch.sense()
        batch.set_camera()
        assert batch.camera().frame_step.tolist() == [0, 0]

    @pytest.mark.parametrize(
        ("arguments", "match"),
        [
            ({"hfov_deg": 0}, "camera.hfov_deg"),
            ({"vfov_deg": 180}, "camera.vfov_deg"),
            ({"offset_m": (np.nan, 0, 0)}, "camera.offset_m"),
            ({"quat_wxyz": (0, 0, 0, 0)}, "camera.quat_wxyz"),
            ({"camera": "back", "hfov_deg": 50}, 'camera: expected "front", got "back"'),
            ({"mask": [True], "hfov_deg": 50}, "mask.*shape"),
            ({"mask": [1, 0], "hfov_deg": 50}, "mask.*bool.*int"),
        ],
    )
    def test_bad_input_changes_nothing(self, flat, arguments, match):
        batch = batch_of([flat], 2)
        batch.sense()
        before, rgb = batch.snapshot(), batch.camera().rgb.copy()
        with pytest.raises(ValueError, match=f"(?s){match}"):
            batch.set_camera(**arguments)
        assert batch.snapshot() == before
        np.testing.assert_array_equal(batch.camera().rgb, rgb)


class TestErrors:
    def test_an_unknown_camera(self, flat):
        batch = batch_of([flat])
        with pytest.raises(ValueError, match='camera: expected "front", got "rear"'):
            batch.camera("rear")
        with pytest.raises(ValueError, match="rear"):
            batch.capture(camera="rear")
        with pytest.raises(ValueError, match="this Batch has no camera"):
            flockstep.Batch([flat]).camera()
        with pytest.raises(ValueError, match="this Batch has no camera"):
            flockstep.Batch([flat]).capture()
        with pytest.raises(ValueError, match="this Batch has no camera"):
            flockstep.Batch([flat]).set_capture_mode("on_demand")
        assert "no cameras" in flockstep.Batch([flat]).camera_backend_report()

    @pytest.mark.parametrize("index", [2, 100, -1])
    def test_an_index_out_of_range(self, flat, index):
        batch = batch_of([flat], 2)
        with pytest.raises(ValueError, match=rf"index: expected an integer in \[0, 2\), got {index}$"):
            batch.camera().config_of(index)
        with pytest.raises(ValueError, match=rf"index: expected an integer in \[0, 2\), got {index}$"):
            batch.camera().jpeg(index)

    def test_backends(self, flat):
        assert "raycast" in batch_of([flat], camera_backend="raycast").camera_backend_report()
        with pytest.raises(ValueError, match='camera_backend: expected "raycast", "gl" or "auto", got "vulkan"'):
            batch_of([flat], camera_backend="vulkan")


class TestJpeg:
    @pytest.mark.parametrize("layout", ["hwc", "chw"])
    def test_is_the_frame(self, round_world, layout):
        config = camera_of(width_px=120, height_px=90, layout=layout, outputs=("rgb",))
        batch = batch_of([round_world], 2, cameras=[config])
        batch.set_pose([[0, 0, 2], [-3, -2, 1.5]])
        batch.sense()
        for drone in range(2):
            image = Image.open(io.BytesIO(batch.camera().jpeg(drone, 95)))
            assert (image.format, image.mode, image.size) == ("JPEG", "RGB", (120, 90))
            frame = batch.camera().rgb[drone].astype(int)
            frame = frame if layout == "hwc" else np.moveaxis(frame, 0, -1)
            error = np.abs(np.asarray(image, int) - frame)
            assert error.mean() < 3
            assert np.median(error) <= 1

    def test_of_grey(self, round_world):
        batch = batch_of([round_world], cameras=[camera_of(outputs=("grey", "depth"))])
        batch.sense()
        image = Image.open(io.BytesIO(batch.camera().jpeg(0, quality=100)))
        assert image.mode == "L"
        assert np.abs(np.asarray(image, int) - batch.camera().grey[0]).mean() < 1

    @pytest.mark.parametrize("quality", [0, 101, -5])
    def test_bad_quality(self, flat, quality):
        with pytest.raises(ValueError, match=rf"quality: expected an integer in \[1, 100\], got {quality}"):
            batch_of([flat]).camera().jpeg(0, quality)

    def test_without_a_picture(self, flat):
        with pytest.raises(ValueError, match="rgb or grey"):
            batch_of([flat], cameras=[camera_of(outputs=("depth",))]).camera().jpeg(0)


class TestBits:
    def test_threads_and_neighbours_do_not_matter(self, flat, round_world, playgrounds):
        worlds = [flat, round_world, playgrounds[0]]
        config = camera_of(width_px=41, height_px=35, shadows=True, samples_per_pixel=4)
        position, quats = random_poses(np.random.default_rng(8), 30)

        def shoot(num_drones, **arguments):
            batch = batch_of(worlds, num_drones, cameras=[config], **arguments)
            batch.set_pose(position[:num_drones], quats[:num_drones])
            batch.sense()
            return {output: getattr(batch.camera(), output).tobytes() for output in OUTPUTS}

        whole = shoot(30)
        assert shoot(30, num_threads=2, block_size=3) == whole
        assert shoot(30, num_threads=8, block_size=1) == whole
        for output, image in shoot(3).items():
            assert whole[output].startswith(image), output


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

    def test_a_child_takes_the_same_pictures(self, round_world):
        def use():
            batch = batch_of([round_world], 20, num_threads=4)
            batch.sense()
            return batch.camera().rgb.tobytes()

        assert self.in_child(use) == use()  # before and after the parent has used its own threads
        assert self.in_child(use) == use()

    def test_a_batch_of_the_parent_raises_in_a_child(self, flat):
        batch = batch_of([flat])
        batch.sense()

        def use(call):
            def run():
                try:
                    call(batch)
                except RuntimeError as error:
                    return str(error)
                return "no error"

            return run

        calls = [
            lambda b: b.capture(),
            lambda b: b.sense(),
            lambda b: b.set_camera(hfov_deg=30),
            lambda b: b.set_capture_mode("on_demand"),
        ]
        for call in calls:
            assert "fork" in self.in_child(use(call))


class TestGolden:
    """Reference images, checked by eye. After an intended change renew them and check them again.

    FLOCKSTEP_RENEW_GOLDEN=1 ./dev test python -k golden
    """

    FOLDER = ROOT / "tests" / "golden"

    @staticmethod
    def shoot(world, position, quat_wxyz, **fields):
        config = camera_of(**{"width_px": 96, "height_px": 72, "outputs": tuple(OUTPUTS), **fields})
        batch = batch_of([world], cameras=[config])
        batch.set_pose([position], [np.asarray(quat_wxyz) / np.linalg.norm(quat_wxyz)])
        batch.capture()
        return batch.camera()

    @classmethod
    @functools.cache
    def pictures(cls):
        """The images in their saved form: 8 bits, three times 8, or 16."""
        shoot = cls.shoot
        hall = shoot(
            flockstep.World.from_dict(ROUND), [3.6, -3.8, 2.6], (0.42, 0.05, 0.1, 0.9), hfov_deg=80, samples_per_pixel=4
        )
        sun = {**ROUND, "light": {"sun_direction": [0.5, -0.4, 0.7], "sun_color": [0.9, 0.85, 0.7]}}
        del sun["room"]
        sun["planes"] = [{"center": [0, 0, 0], "size": [10, 10]}]
        yard = shoot(
            flockstep.World.from_dict(sun), [4, -4.5, 3], (0.4, 0.07, 0.12, 0.9), samples_per_pixel=4, shadows=True
        )
        playground = flockstep.World.load("playground/camera-train-1")
        flight = shoot(playground, playground.start, (1, 0, 0, 0))
        palette = (np.arange(1, 17) * 14 + 16).astype(np.uint8)
        return {
            "hall-rgb": hall.rgb[0],
            "hall-depth": np.round(hall.depth[0] * 1000).astype(np.uint16),
            "hall-normal": np.round(127.5 * (hall.normal[0] + 1)).astype(np.uint8),
            "hall-instance": palette[hall.instance[0] % 16],
            "hall-grey": hall.grey[0],
            "yard-rgb": yard.rgb[0],
            "flight-rgb": flight.rgb[0],
        }

    @pytest.mark.parametrize(
        "name", ["hall-rgb", "hall-depth", "hall-normal", "hall-instance", "hall-grey", "yard-rgb", "flight-rgb"]
    )
    def test_golden(self, name):
        path, picture = self.FOLDER / f"{name}.png", self.pictures()[name]
        if os.environ.get("FLOCKSTEP_RENEW_GOLDEN"):
            self.FOLDER.mkdir(exist_ok=True)
            Image.fromarray(picture).save(path, optimize=True)
        assert path.stat().st_size < 20_000
        golden = np.asarray(Image.open(path)).astype(int)
        assert golden.shape == picture.shape
        error = np.abs(picture.astype(int) - golden)
        # For depth: 2 mm of up to 12 m; except pixels on a silhouette.
        assert (error <= 2).mean() > 0.995
        assert name == "hall-depth" or error.mean() < 0.5
