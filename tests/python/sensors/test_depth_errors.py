"""Depth images that err, against a NumPy twin with the same random words, and shadows against a second camera."""

import math
import pickle
import re

import numpy as np
import pytest
from conftest import ROOT, placed, world_of
from messages import refused
from philox import named_stream, normals, uniform_pairs, words
from scipy.stats import norm

import flockstep
from flockstep import CameraConfig, DepthErrors

SCENE = {
    "name": "pillars",
    "room": {"min": [0, 0, 0], "max": [12, 8, 4]},
    "boxes": [{"center": [4, 3, 2], "size": [1, 1, 4]}, {"center": [6, 5.5, 2], "size": [0.3, 0.3, 4]}],
    "spheres": [{"center": [3.2, 4.6, 1.5], "radius": 0.4}],
    "markers": {"start": [1, 4, 2]},
}
HALL = world_of(**SCENE)
NOISE = DepthErrors(baseline_m=0.1, disparity_noise_px=0.3, disparity_step_px=0.125, min_range_m=1.6, dropout=0.1)
BLOTCHES = DepthErrors(focal_px=100.0, blotches=0.2, blotch_size_px=11.0, noise_std_m=0.01, noise_per_m=0.02, hole_m=0)
SHADOW = DepthErrors(baseline_m=0.3, edge_shadow=True, hole_m=9.0)
EVERY = [NOISE, BLOTCHES, SHADOW]
POSES = [[1, 4, 2], [2, 5, 1], [1, 3, 1.5], [0.5, 4, 3]]
IMAGE = {"width_px": 37, "height_px": 21, "far_m": 9.7, "outputs": ["depth"]}


def shadowed(depth, depth_px):
    """Pixels (H, W) that the other eye does not see, each compared with all pixels to its right."""
    column = np.arange(depth.shape[1]) + 0.5 - depth_px / depth
    hidden = column < 0
    for u in range(depth.shape[1] - 1):
        hidden[:, u] |= column[:, u] > column[:, u + 1 :].min(1) - 0.5
    return hidden


def between_nodes(count, cell):
    """The matrix (count, nodes) that interpolates between nodes; the squares of a row sum to 1."""
    at = (np.arange(count) + 0.5) / cell
    weights = np.maximum(1 - abs(at[:, None] - np.arange(int(at[-1]) + 2)), 0)
    return weights / np.linalg.norm(weights, axis=1, keepdims=True)


def disturbed(depth, errors, camera, drawn):
    """The image that a camera reads, by the documents in float64. drawn(number, first, count) returns random words."""
    focal = errors.focal_px or camera.fx
    height, width = depth.shape
    seen = np.isfinite(depth)
    exact = np.where(seen, depth, 1.0).astype(float)
    if errors.edge_shadow:
        seen &= ~shadowed(depth.astype(float), camera.fx * errors.baseline_m)
    if errors.blotches:
        cell = max(errors.blotch_size_px * camera.fx / focal, 1)
        down, across = between_nodes(height, cell), between_nodes(width, cell)
        nodes = across.shape[1]
        draws = (nodes + 3) // 4
        rows = [drawn(1, draws * row, draws) for row in range(down.shape[1])]
        field = [np.stack([normals(a, b).reshape(-1, 2), normals(c, d).reshape(-1, 2)], 1) for a, b, c, d in rows]
        field = np.array([numbers.ravel()[:nodes] for numbers in field])
        seen &= down @ field @ across.T >= norm.ppf(errors.blotches)
    a, b, c, d = drawn(0, 0, (depth.size + 1) // 2)
    normal, uniform = (drawn[: depth.size].reshape(depth.shape) for drawn in (normals(a, b), uniform_pairs(c, d)))
    disparity = focal * errors.baseline_m / exact - errors.disparity_noise_px * normal
    if errors.disparity_step_px:
        disparity = np.rint(disparity / errors.disparity_step_px) * errors.disparity_step_px
    with np.errstate(divide="ignore"):
        read = focal * errors.baseline_m / disparity
    read += (errors.noise_std_m + errors.noise_per_m * exact) * normal
    seen &= (read >= errors.min_range_m) & (read <= camera.far_m) & (uniform >= errors.dropout)
    return np.where(seen, read, math.inf if errors.hole_m is None else errors.hole_m)


def batch_of(errors, *, poses=POSES, fields=IMAGE, **keywords):
    """A batch whose drones have a camera without errors and one with them."""
    cameras = [CameraConfig(name="exact", **fields), CameraConfig(name="erring", **fields, depth_errors=errors)]
    batch = placed(HALL, poses, cameras=cameras, **keywords)
    batch.seed(np.arange(batch.num_envs) + 5)
    return batch


@pytest.mark.parametrize("errors", EVERY)
@pytest.mark.parametrize("drones_per_env", [1, 2])
def test_images_are_those_of_the_twin(errors, drones_per_env):
    batch = batch_of(errors, drones_per_env=drones_per_env)
    camera = batch.camera("erring").config
    pixels = IMAGE["width_px"] * IMAGE["height_px"]
    holes = readings = 0
    for taken, episode in enumerate([0, 0, 1]):
        if episode:
            batch.begin_episode()
        batch.sense()
        reading = int(batch.camera("erring").frame_step[0])
        assert reading == (0 if episode else taken)
        for drone in range(len(POSES)):
            env, member = divmod(drone, drones_per_env)

            def drawn(number, first, count, env=env, member=member, reading=reading):
                stream = named_stream("errors of camera.erring") ^ (number << 16)
                of_drone = {"episode": int(batch.episode[env]), "member": member}
                return words(stream, 4 * pixels * reading + first, count, env + 5, **of_drone)

            exact = batch.camera("exact").depth[drone]
            expected = disturbed(exact, errors, camera, drawn)
            got = batch.camera("erring").depth[drone]
            is_hole = got == (math.inf if errors.hole_m is None else np.float32(errors.hole_m))
            differs = abs(got[~is_hole] - expected[~is_hole]) > 1e-5 * expected[~is_hole] ** 2
            assert differs.mean() < 0.02  # a number between two steps may be rounded to either
            np.testing.assert_array_equal(got[is_hole], expected[is_hole])
            holes, readings = holes + is_hole.sum(), readings + (~is_hole).sum()
    assert min(holes, readings) > 500


def test_shadows_are_what_the_right_camera_of_a_pair_does_not_see():
    image = {**IMAGE, "width_px": 160, "height_px": 20, "far_m": 20}
    left, right = CameraConfig(name="pair", **image).stereo_pair(0.25)
    left.depth_errors = DepthErrors(baseline_m=0.25, edge_shadow=True)
    exact = CameraConfig(name="exact", **image)
    batch = placed(HALL, [1, 4, 2], cameras=[exact, left, right])
    batch.sense()
    depth, erring, other = (batch.camera(name).depth[0] for name in ("exact", "pair_left", "pair_right"))
    column = np.arange(160) + 0.5 - exact.fx * 0.25 / depth
    at = np.clip(np.floor(column).astype(int), 0, 159)
    there = np.stack([np.take_along_axis(other, np.clip(at + shift, 0, 159), 1) for shift in (-1, 0, 1)])
    hidden = (column < 0) | (there.max(0) < 0.95 * depth)
    found = np.isinf(erring)
    assert 0.05 < hidden.mean() < 0.5
    assert (found == hidden).mean() > 0.97
    np.testing.assert_array_equal(erring[~found], depth[~found])


@pytest.mark.parametrize(("baseline_m", "shadow", "border"), [(0.16, 3, 1), (0.32, 5, 3), (0.4, 7, 3)])
def test_a_shadow_is_as_wide_as_the_difference_of_disparities(baseline_m, shadow, border):
    room, box = {"min": [0, -9, -9], "max": [6, 9, 9]}, {"center": [3, -4, 0], "size": [2, 8, 9]}
    assert round(50 * baseline_m * (1 / 2 - 1 / 6)) == shadow
    assert round(50 * baseline_m / 6) == border
    errors = DepthErrors(baseline_m=baseline_m, edge_shadow=True)
    camera = CameraConfig(width_px=100, height_px=3, outputs=["depth"], depth_errors=errors)
    batch = placed(world_of(name="step", room=room, boxes=[box]), [0.001, 0, 0], camera=camera)
    batch.sense()
    holes = np.flatnonzero(np.isinf(batch.camera().depth[0, 1]))
    np.testing.assert_array_equal(holes, [*range(border), *range(50 - shadow, 50)])


def flown(steps=3, envs=6, fields=IMAGE, **keywords):
    """Images of a flight with errors, (steps, envs, H, W)."""
    cameras = [CameraConfig(name=f"c{i}", **fields, depth_errors=errors) for i, errors in enumerate(EVERY)]
    env = flockstep.DroneVectorEnv(envs, worlds="train", camera=cameras, **keywords)
    env.reset(seed=3)
    found = []
    for step in range(steps):
        env.step((np.arange(envs) + step) % 6)
        found.append([env.batch.camera(f"c{i}").depth.copy() for i in range(len(EVERY))])
    return np.array(found)


def test_bits_do_not_depend_on_threads_blocks_and_other_envs():
    first = flown(num_threads=1)
    for keywords in ({"num_threads": 3, "block_size": 1}, {"num_threads": 2, "block_size": 4}):
        np.testing.assert_array_equal(flown(**keywords), first)
    np.testing.assert_array_equal(flown(envs=11, num_threads=2)[:, :, :6], first)


def test_errors_precede_pooling():
    whole = {**IMAGE, "width_px": 36, "height_px": 20}
    full = flown(1, fields=whole).reshape(-1, 5, 4, 9, 4)
    pooled = {"min": full.min((2, 4)), "max": full.max((2, 4)), "mean": full.mean((2, 4), dtype=float)}
    for pool, expected in pooled.items():
        small = flown(1, fields={**whole, "resize": (9, 5), "pool": pool})
        np.testing.assert_allclose(small.reshape(-1, 5, 9), expected, rtol=1e-6)


def test_no_errors_are_the_same_bits():
    batch = batch_of(DepthErrors(baseline_m=0.2, focal_px=3.0, blotch_size_px=2.0))
    batch.sense()
    np.testing.assert_array_equal(batch.camera("erring").depth, batch.camera("exact").depth)
    assert CameraConfig(depth_errors=DepthErrors()) == CameraConfig()


@pytest.mark.parametrize("late", [{}, {"latency_s": 0.2, "jitter_s": 0.1, "loss": 0.2}])
def test_a_snapshot_continues_with_the_same_errors(late):
    camera = CameraConfig(**IMAGE, depth_errors=BLOTCHES, **late)
    env, other = (flockstep.DroneVectorEnv(3, worlds="train", camera=camera) for _ in range(2))

    def steps(batch):
        found = [batch.camera().depth.copy()]
        for _ in range(5):
            batch.step(np.arange(3))
            found.append(batch.camera().depth.copy())
        return np.array(found)

    env.reset(seed=3)
    env.step(np.arange(3))
    env.batch.seed(np.arange(3) + 8)  # not of the images so far
    blob = env.batch.snapshot()
    expected = steps(env.batch)
    other.batch.restore(blob)
    np.testing.assert_array_equal(steps(other.batch), expected)
    assert not np.array_equal(expected[0], expected[-1])


def test_a_batch_begins_with_images_without_errors():
    batch = batch_of(BLOTCHES)
    assert np.isinf(batch.camera("erring").depth).all()
    assert (batch.camera("erring").frame_step == -1).all()


def test_configurations_survive_recipes_and_pickles():
    camera = CameraConfig(**IMAGE, depth_errors=BLOTCHES)
    assert pickle.loads(pickle.dumps(camera)) == camera != CameraConfig(**IMAGE)
    env = flockstep.DroneVectorEnv(2, worlds="train", camera=camera)
    assert flockstep.Recipe.from_json(env.recipe.to_json()).cameras[0].depth_errors == BLOTCHES
    text = env.recipe.to_json().replace('"blotches": 0.2', '"blotches": 2')
    with refused(ValueError, "cameras[0].depth_errors.blotches", 2):
        flockstep.Recipe.from_json(text)


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("baseline_m", [0, -1, 11, math.nan]),
        ("focal_px", [0, -1, math.nan, math.inf]),
        ("blotches", [-0.1, 1.1, math.nan]),
        ("blotch_size_px", [0, -1, 1e9, math.nan]),
        ("disparity_noise_px", [-1, math.nan, math.inf, 1e9]),
        ("disparity_step_px", [-1, 1e-9, math.nan, 1e9]),
        ("noise_std_m", [-1, math.nan, math.inf]),
        ("noise_per_m", [-1, math.nan, 2]),
        ("min_range_m", [-1, math.nan, math.inf, 9.7]),  # far_m is 9.7
        ("dropout", [-1, math.nan, 1.01]),
        ("hole_m", [-1, math.nan, math.inf]),
    ],
)
def test_bad_errors_are_refused(field, values):
    for value in values:
        errors = DepthErrors()
        with refused(ValueError, f"camera.depth_errors.{field}"):
            CameraConfig(**IMAGE, depth_errors=DepthErrors(**{field: value}))
        setattr(errors, field, value)
        camera = CameraConfig(**IMAGE)
        camera.depth_errors = errors
        with refused(ValueError, f"camera.depth_errors.{field}"):
            flockstep.Batch(HALL, 1, camera=camera)


def test_errors_without_what_errs_are_refused():
    with refused(ValueError, "camera.depth_errors", "depth"):
        CameraConfig(depth_errors=NOISE)
    with refused(ValueError, "camera.depth_kind", "range"):
        CameraConfig(**IMAGE, depth_kind="range", depth_errors=NOISE)
    with refused(TypeError, "depth_errors"):
        CameraConfig(depth_errors={"dropout": 0.1})
    with pytest.raises(TypeError, match="disparity_noise_px"):
        DepthErrors(disparity_noise=1.0)


@pytest.mark.parametrize("errors", [DepthErrors(blotches=1), DepthErrors(dropout=1), DepthErrors(min_range_m=9.6)])
def test_nothing_may_be_left(errors):
    errors.hole_m = 3.0
    batch = batch_of(errors)
    batch.sense()
    assert (batch.camera("erring").depth == 3).all()


@pytest.mark.parametrize(
    "errors",
    [
        DepthErrors(baseline_m=1e-30, disparity_noise_px=100, disparity_step_px=1e-4),
        DepthErrors(baseline_m=10, focal_px=1e6, disparity_step_px=1e-4, noise_std_m=1000, noise_per_m=1),
        DepthErrors(baseline_m=10, edge_shadow=True, blotches=0.5, blotch_size_px=1e-30),
        DepthErrors(focal_px=1e6, blotches=0.5, blotch_size_px=8192),
        DepthErrors(focal_px=1, blotches=0.5, blotch_size_px=8192),
    ],
)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (64, 3)])
def test_extreme_errors_give_depths_or_holes(errors, size):
    batch = batch_of(errors, fields={**IMAGE, "width_px": size[0], "height_px": size[1]})
    for _ in range(3):
        batch.sense()
        depth = batch.camera("erring").depth
        assert (np.isinf(depth) | ((depth >= 0) & (depth <= 9.7))).all()


PAGE = (ROOT / "docs/reference/sensors.md").read_text(encoding="utf-8")
PRODUCTS = re.findall(r"^\| `([\w-]+)` \|", PAGE.partition("| depth camera |")[2].partition("\n\n")[0], re.MULTILINE)


def test_presets_are_the_products_of_the_documents():
    with refused(ValueError, "CameraConfig.preset", "Did you mean d435?") as said:
        CameraConfig.preset("d436")
    assert re.findall(r"\w+", str(said.value).partition("one of ")[2].partition(", got")[0]) == PRODUCTS
    with refused(ValueError, "CameraConfig.preset"):
        CameraConfig.preset("<b>" * 100)


@pytest.mark.parametrize("name", PRODUCTS)
def test_presets_see_and_err(name):
    camera = CameraConfig.preset(name)
    assert eval(repr(camera), vars(flockstep)) == camera
    camera.width_px, camera.height_px = 64, 48
    exact = pickle.loads(pickle.dumps(camera))
    exact.name, exact.depth_errors = "exact", DepthErrors()
    batch = placed(HALL, [[1, 4, 2]], cameras=[camera, exact])
    batch.sense()
    got, truth = batch.camera(name).depth, batch.camera("exact").depth
    seen = (got > 0) & (truth < 4)
    assert seen.mean() > 0.1
    assert 0 < np.abs(got - truth)[seen].mean() < 0.1
    assert 0 < (got == 0).mean() < 0.9


def test_the_minimum_range_of_a_realsense():
    assert abs(CameraConfig.preset("d455").depth_errors.min_range_m - 0.34) < 0.01  # its maintainers say 34 cm


def test_a_stereo_pair_is_its_baseline_apart():
    turned = CameraConfig(offset_m=(1, 2, 3), quat_wxyz=(math.sqrt(0.5), 0, 0, math.sqrt(0.5)))  # x points to the left
    left, right = turned.stereo_pair(0.2)
    assert (left.name, right.name) == ("front_left", "front_right")
    assert left.offset_m == turned.offset_m
    np.testing.assert_allclose(np.subtract(right.offset_m, left.offset_m), [0.2, 0, 0], atol=1e-6)
    right.offset_m, right.name = left.offset_m, left.name
    assert right == left
    for baseline_m in (0, -1, math.nan, 11):
        with refused(ValueError, "baseline_m", baseline_m):
            turned.stereo_pair(baseline_m)
