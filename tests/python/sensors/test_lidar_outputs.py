"""Classes, objects and intensities of hits, against a camera that looks along the same beams."""

import math
import pickle

import numpy as np
import pytest
from conftest import placed, world_of
from messages import refused
from scipy.spatial.transform import Rotation

import flockstep
from flockstep import BodyConfig, CameraConfig, LidarConfig, RangeErrors

OUTPUTS = ("semantic", "instance", "intensity")
# Reflectances by semantic id; the drones' is that of their grey hull.
COLORS = {7: [0.5, 0.5, 0.5], 8: [0.8, 0.1, 0.3], 9: [0.2, 0.7, 0.6], 10: [0.05, 0.1, 0.06]}
BODIES = {20: [1, 1, 1], 21: [0.3, 0.3, 0.9], 22: [0, 0, 0.3], 23: [0.9, 0.9, 0]}
MESH = 24
REFLECTANCE = {**{key: np.mean(color) for key, color in (COLORS | BODIES).items()}, MESH: 0.7, 65531: 0.4}


def all_shapes(*others):
    """A room with a solid of each kind, two meshes and other spheres."""
    return world_of(
        name="all shapes",
        materials={f"m{key}": {"base_color": color, "semantic": key} for key, color in COLORS.items()},
        room={"min": [-5, -5, 0], "max": [5, 5, 4], "material": "m7"},
        boxes=[{"center": [2, -1, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.96, 0, 0.28, 0], "material": "m8"}],
        cylinders=[
            {"center": [-2, -1, 1.5], "radius": 0.5, "height": 2, "quat_wxyz": [0.8, 0.6, 0, 0], "material": "m9"},
            {"center": [-4, -4, 2], "radius": 0.5, "height": 4, "material": "m10"},
        ],
        spheres=[{"center": [1, -3, 2], "radius": 0.7, "material": "m9"}, *others],
        capsules=[{"center": [-3, 0, 1.2], "radius": 0.3, "height": 1.6, "material": "m8"}],
        planes=[{"center": [0, 3, 2], "size": [2, 1], "quat_wxyz": [0.6, 0.8, 0, 0], "material": "m8"}],
        discs=[{"center": [4, 0, 2], "radius": 0.8, "quat_wxyz": [0.8, 0, 0.6, 0], "material": "m10"}],
        meshes=[
            {
                "vertices": [[x - 1, 1, 0.5], [x + 1, 1, 0.5], [x + 1, 3, 0.5], [x - 1, 3, 0.5], [x, 2, 2]],
                "triangles": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
                "material": material,
            }
            for x, material in ((2, "m9"), (4, "m10"))
        ],
    )


WORLD = all_shapes()
# It has more elements than are looked up at once. The others are outside the room.
CROWDED = all_shapes(*({"center": [x, 0, 9], "radius": 0.2} for x in range(40)))


def pyramid():
    """The mesh of a body, whose material counts instead of the body's colour."""
    builder = flockstep.WorldBuilder()
    material = builder.material("bright", base_color=(0.6, 0.7, 0.8))
    corners = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0], [0, 0, 1]]
    builder.mesh(corners, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [2, 1, 0], [3, 2, 0]], material)
    return builder.build()


def bodies():
    shapes = {"box": [0.4, 0.5, 0.6], "sphere": [0.6, 0.6, 0.6], "cylinder": [0.4, 0.4, 0.9], "capsule": [0.4, 0.4, 1]}
    places = [[-1, 1, 1], [0, -2, 3], [-1, -3, 1], [1, 0, 3]]
    turned = {"quat_wxyz": [0.8, 0.48, 0.36, 0]}
    solids = [
        BodyConfig(name=shape, shape=shape, size_m=size, position_m=place, semantic=key, color=color, **turned)
        for (shape, size), place, (key, color) in zip(shapes.items(), places, BODIES.items(), strict=True)
    ]
    return [*solids, BodyConfig(shape="mesh", mesh=pyramid(), position_m=[-3, 3, 1], semantic=MESH, **turned)]


CAMERA = CameraConfig(
    width_px=60, height_px=45, hfov_deg=100, depth_kind="range", outputs=("depth", "semantic", "instance", "normal")
)
MOUNT = {"offset_m": [0.1, -0.05, 0.02], "quat_wxyz": [0.96, 0, 0.28, 0]}


def pixels():
    """Directions (H, W, 3) of the pixels in the camera's frame, unit."""
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px] + 0.5
    rays = np.stack([np.ones_like(u), (CAMERA.cx - u) / CAMERA.fx, (CAMERA.cy - v) / CAMERA.fy], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def along(directions, **fields):
    """A LiDAR whose pattern has these directions."""
    x, y, z = np.reshape(directions, (-1, 3)).T.astype(float)
    azimuth, elevation = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
    return LidarConfig(azimuth_deg=azimuth, elevation_deg=elevation, max_range_m=50, outputs=OUTPUTS, **fields)


def random_poses(count):
    rng = np.random.default_rng(3)
    position = rng.uniform([-3, -3, 1], [3, 3, 3], (count, 3))
    return position.astype(np.float32), Rotation.random(count, random_state=4).as_quat(scalar_first=True)


def scanned(lidars, count=12, world=WORLD, **keywords):
    """A batch of drones that see all kinds of things, two in an env."""
    shared = {"bodies": bodies(), "drones_per_env": 2, "interaction": "sense"}
    batch = placed([world], *random_poses(count), lidars=lidars, **shared | keywords)
    batch.sense()
    return batch


@pytest.mark.parametrize("world", [WORLD, CROWDED], ids=["few", "many"])
@pytest.mark.parametrize("tracer", ["auto", "slices", "tiles", "embree"])
def test_hits_are_those_of_a_camera(tracer, world):
    camera = CameraConfig(**{name: getattr(CAMERA, name) for name in CAMERA.__match_args__} | MOUNT)
    directions = pixels()
    batch = scanned([along(directions, **MOUNT)], 24, world, cameras=[camera], tracer=tracer)
    lidar, images = batch.lidar(), batch.camera()
    same = lidar.instance.reshape(images.instance.shape) == images.instance
    assert same.mean() > 0.995  # all but some at silhouettes
    np.testing.assert_array_equal(lidar.semantic.reshape(same.shape)[same], images.semantic[same])
    np.testing.assert_allclose(lidar.ranges.reshape(same.shape)[same], images.depth[same], rtol=1e-3, atol=1e-4)
    world = np.stack(
        [
            (Rotation.from_quat(quat, scalar_first=True) * Rotation.from_quat(MOUNT["quat_wxyz"], scalar_first=True))
            .apply(directions.reshape(-1, 3))
            .reshape(directions.shape)
            for quat in batch.quat_wxyz
        ]
    )
    incidence = np.abs((world * images.normal).sum(axis=-1))
    reflectance = np.vectorize(REFLECTANCE.get, otypes=[float])(images.semantic)
    expected = reflectance * incidence / np.maximum(images.depth, 1) ** 2
    errors = np.abs(lidar.intensity.reshape(same.shape) - expected)[same]
    assert np.mean(errors < 1e-4) > 0.995  # all but some at edges between the faces of an object
    assert {*np.unique(images.semantic)} == {*REFLECTANCE}
    assert len(np.unique(images.instance)) > 14


GRIDS = {
    "fan": {"beams": 90, "hfov_deg": 300},
    "small fan": {"beams": 3, "hfov_deg": 40},
    "views": {"channels": 32, "beams": 48, "hfov_deg": 90, "vfov_deg": 60},
    "narrow": {"channels": 19, "beams": 13, "hfov_deg": 90, "vfov_deg": 60},
    "column": {"channels": 70, "beams": 1, "vfov_deg": 100},
    "columns": {"channels": 12, "beams": 9, "hfov_deg": 90, "vfov_deg": 60, "scan_time_s": 0.01},
}


@pytest.mark.parametrize("tracer", ["auto", "slices", "tiles", "embree"])
def test_hits_do_not_depend_on_the_order_of_beams(tracer):
    grids = [LidarConfig(name=name.replace(" ", "-"), max_range_m=50, **fields) for name, fields in GRIDS.items()]
    exact = scanned(grids, tracer=tracer)
    for grid in grids:
        grid.outputs = OUTPUTS
    shuffled = np.random.default_rng(0).permutation
    orders = [shuffled(math.prod(grid.shape)) for grid in grids]
    patterns = []
    for grid, order in zip(grids, orders, strict=True):
        directions = exact.lidar(grid.name).directions[0].reshape(-1, 3)[order]
        patterns.append(along(directions, name=f"{grid.name}-pattern"))
    batch = scanned([*grids, *patterns], tracer=tracer)
    for grid, order in zip(grids, orders, strict=True):
        one, other = batch.lidar(grid.name), batch.lidar(f"{grid.name}-pattern")
        np.testing.assert_allclose(one.ranges, exact.lidar(grid.name).ranges, rtol=1e-6)
        same = one.instance.reshape(12, -1)[:, order] == other.instance[:, 0]
        assert same.mean() > 0.98
        for output in OUTPUTS:
            got, expected = getattr(one, output).reshape(12, -1)[:, order][same], getattr(other, output)[:, 0][same]
            assert np.isclose(got, expected, rtol=1e-3, atol=1e-4).mean() > 0.99
        assert (one.intensity > 0).any()


WALL = world_of(
    name="wall",
    materials={"grey": {"base_color": [0.2, 0.4, 0.6]}},
    boxes=[{"center": [5, 0, 0], "size": [2, 50, 50], "material": "grey"}],
)


def test_intensity_is_the_formula_of_the_documents():
    distances, angles = np.array([0.5, 1, 2, 3.9]), np.arange(-80, 81, 10)
    fields = {"azimuth_deg": angles, "elevation_deg": [0] * len(angles), "outputs": ["intensity"]}
    batch = placed([WALL], np.stack([4 - distances, 0 * distances, 0 * distances], 1), lidar=LidarConfig(**fields))
    batch.set_lidar(max_range_m=20)
    batch.sense()
    cosine = np.cos(np.radians(angles))
    ranges = distances[:, None] / cosine
    np.testing.assert_allclose(batch.lidar().ranges[:, 0], np.where(ranges > 20, np.inf, ranges), rtol=1e-5)
    expected = np.where(ranges > 20, 0, 0.4 * cosine / np.maximum(ranges, 1) ** 2)
    np.testing.assert_allclose(batch.lidar().intensity[:, 0], expected, rtol=1e-4)


def lost(errors, **fields):
    """Return what two LiDARs read that differ in their errors."""
    beams = {"channels": 9, "beams": 40, "hfov_deg": 120, "vfov_deg": 40, "max_range_m": 50, "outputs": OUTPUTS}
    lidars = [LidarConfig(name="exact", **beams), LidarConfig(name="erring", errors=errors, **beams | fields)]
    batch = scanned(lidars)
    return batch.lidar("exact"), batch.lidar("erring")


@pytest.mark.parametrize("divergence_mrad", [0, 20])
def test_grazing_beams_miss(divergence_mrad):
    batch = placed([WALL], [[2, 0, 0]], lidar=LidarConfig(beams=171, hfov_deg=170, max_range_m=100))
    batch.sense()
    assert np.isfinite(batch.lidar().ranges).all()
    errors = RangeErrors(max_incidence_deg=60.5, divergence_mrad=divergence_mrad)
    batch = placed([WALL], [[2, 0, 0]], lidar=LidarConfig(beams=171, hfov_deg=170, max_range_m=100, errors=errors))
    batch.sense()
    np.testing.assert_array_equal(np.isfinite(batch.lidar().ranges[0, 0]), np.abs(np.arange(-85, 86)) <= 60)


def test_weak_beams_miss():
    exact, erring = lost(RangeErrors(min_intensity=0.02))
    expected = exact.intensity >= np.float32(0.02)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(erring.ranges, np.where(expected, exact.ranges, np.inf))


def test_outputs_of_a_miss_are_zero():
    exact, erring = lost(RangeErrors(noise_std_m=0.01, dropout=0.3, max_incidence_deg=70, min_intensity=0.01))
    misses = np.isinf(erring.ranges)
    assert 0.3 < misses.mean() < 0.95
    for output in OUTPUTS:
        got, truth = getattr(erring, output), getattr(exact, output)
        np.testing.assert_array_equal(got, np.where(misses, 0, truth))
    outside = placed([WALL], [[-50, 0, 0]], lidar=LidarConfig(outputs=OUTPUTS))
    outside.sense()
    assert not any(getattr(outside.lidar(), output).any() for output in OUTPUTS)


def test_clutter_has_no_outputs_and_is_before_every_surface():
    exact, erring = lost(RangeErrors(clutter_per_m=0.1, dropout=0.1, max_incidence_deg=60, min_intensity=0.01))
    is_clutter = np.isfinite(erring.ranges) & (erring.ranges != exact.ranges)
    weak = exact.intensity < np.float32(0.01)  # surfaces also lose these beams
    for beams in (weak, ~weak):
        assert 0.02 < is_clutter[beams].mean() < 0.9
    assert (erring.ranges[is_clutter] < exact.ranges[is_clutter]).all()
    for output in OUTPUTS:
        kept = np.isfinite(erring.ranges) & ~is_clutter
        np.testing.assert_array_equal(getattr(erring, output), np.where(kept, getattr(exact, output), 0))


def test_a_removed_drone_has_none():
    batch = scanned([LidarConfig(outputs=OUTPUTS, max_range_m=50)])
    before = batch.lidar().instance.copy()
    batch.remove([3])
    for output in OUTPUTS:
        assert getattr(batch.lidar(), output)[2:5].any(axis=(1, 2)).tolist() == [True, False, True]
    batch.spawn(indices=[3])
    assert batch.lidar().instance[3].any()
    np.testing.assert_array_equal(batch.lidar().instance[4], before[4])


def test_bits_do_not_depend_on_threads_and_blocks():
    lidar = LidarConfig(
        outputs=OUTPUTS, max_range_m=50, errors=RangeErrors(divergence_mrad=30, dropout=0.2, min_intensity=0.01)
    )
    first = scanned([lidar], num_threads=1)
    for keywords in ({"num_threads": 3, "block_size": 1}, {"num_threads": 2, "block_size": 4}):
        other = scanned([lidar], **keywords)
        for output in ("ranges", *OUTPUTS):
            np.testing.assert_array_equal(getattr(other.lidar(), output), getattr(first.lidar(), output))


@pytest.mark.parametrize("late", [{}, {"latency_s": 0.2, "jitter_s": 0.1, "loss": 0.2}])
def test_outputs_are_as_old_as_ranges_and_in_snapshots(late):
    lidar = LidarConfig(beams=21, outputs=OUTPUTS, **late)
    env, other = (flockstep.DroneVectorEnv(3, worlds="train", lidar=lidar) for _ in range(2))

    def readings(batch):
        return [getattr(batch.lidar(), name).copy() for name in ("ranges", *OUTPUTS)]

    def flown(batch):
        found = [readings(batch)]
        for _ in range(5):
            batch.step(np.arange(3))
            found.append(readings(batch))
        return found

    env.reset(seed=3)
    env.step(np.arange(3))
    blob = env.batch.snapshot()
    expected = flown(env.batch)
    other.batch.restore(blob)
    for got, arrays in zip(flown(other.batch), expected, strict=True):
        for one, array in zip(got, arrays, strict=True):
            np.testing.assert_array_equal(one, array)
        for output in arrays[1:]:
            np.testing.assert_array_equal(output > 0, np.isfinite(arrays[0]))
    assert any((arrays[0] != expected[0][0]).any() for arrays in expected)


def test_arrays_exist_only_if_asked_for():
    batch = placed([WALL], [[0, 0, 0]] * 2, lidar=LidarConfig(outputs=["semantic"]))
    with pytest.raises(RuntimeError, match="sense"):
        _ = batch.lidar().semantic
    batch.sense()
    assert batch.lidar().semantic.dtype == np.uint16
    assert batch.lidar().semantic.shape == (2, 1, 35)
    assert not batch.lidar().semantic.flags.writeable
    assert {*batch.sensor("lidar")} >= {"ranges", "semantic"}
    assert not {"instance", "intensity"} & {*batch.sensor("lidar")}
    for output in ("instance", "intensity"):
        with refused(ValueError, "lidar", output, "semantic"):
            getattr(batch.lidar(), output)
    resized = flockstep.Batch([WALL], 2, lidar=LidarConfig(outputs=OUTPUTS))
    resized.set_lidar(beams=7)
    resized.sense()
    assert resized.lidar().intensity.shape == (2, 1, 7)


def test_configurations_and_bad_names():
    lidar = LidarConfig(outputs=["intensity", "semantic"], errors=RangeErrors(min_intensity=0.1))
    assert lidar.outputs == ("semantic", "intensity")
    assert pickle.loads(pickle.dumps(lidar)) == lidar != LidarConfig()
    assert eval(repr(lidar), vars(flockstep)) == lidar
    env = flockstep.DroneVectorEnv(2, worlds="train", lidar=lidar)
    assert flockstep.Recipe.from_json(env.recipe.to_json()).lidars[0] == lidar
    for bad in (["class"], ["<b>"], ["rgb"], ["intensity", "x" * 50]):
        with refused(ValueError, "outputs", bad[-1]):
            LidarConfig(outputs=bad)
    for wrong in ("intensity", 3, None):
        with refused(TypeError, "outputs", wrong):
            LidarConfig(outputs=wrong)
