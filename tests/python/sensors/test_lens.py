"""Lenses: what each pixel shows against OpenCV's formulas in NumPy, calibrations by OpenCV, and what is refused."""

import itertools

import cv2
import numpy as np
import pytest
from conftest import world_of
from messages import refused
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import flockstep
from flockstep import CameraConfig

BARREL = {"distortion": (-0.3, 0.1, 2e-3, -1e-3, -0.01)}
CUSHION = {"distortion": (0.2, 0.05, 0.01, 0.02), "hfov_deg": 70, "vfov_deg": 80}
FISHEYE = {"projection": "fisheye", "hfov_deg": 120}
WIDE = {"projection": "fisheye", "distortion": (-0.01, 0.04, -0.04, 0.01), "hfov_deg": 170}  # corners look backwards
LENSES = {"barrel": BARREL, "cushion": CUSHION, "fisheye": FISHEYE, "wide": WIDE}

WORLD = world_of(
    name="shapes",
    room={"min": [-5, -5, 0], "max": [5, 5, 4]},
    boxes=[
        {"center": [2, -1, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.96, 0, 0.28, 0]},
        {"center": [-2, 2, 1.5], "size": [0.5, 1, 2], "quat_wxyz": [0.8, 0, 0, 0.6]},
    ],
    spheres=[{"center": [1, -3, 2], "radius": 0.7}],
    cylinders=[{"center": [-2, -1, 1.5], "radius": 0.5, "height": 2, "quat_wxyz": [0.8, 0.6, 0, 0]}],
    meshes=[
        {
            "vertices": [[1, 1, 0.5], [3, 1, 0.5], [3, 3, 0.5], [1, 3, 0.5], [2, 2, 2]],
            "triangles": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        }
    ],
)


def camera_of(**fields):
    return CameraConfig(**{"width_px": 43, "height_px": 34, "outputs": ("depth",), "depth_kind": "range", **fields})


def in_image(config, ideal):
    """Return where the image shows ideal points (..., 2), in focal lengths: the formulas of OpenCV's documentation."""
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x**2 + y**2
    if config.projection == "fisheye":
        k1, k2, k3, k4 = [*config.distortion, 0, 0, 0, 0][:4]
        return ideal * (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4)[..., None]
    k1, k2, p1, p2, k3 = [*config.distortion, 0, 0, 0, 0, 0][:5]
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def ideal_points(config):
    """Return the ideal points (H, W, 2) of all pixels: from the centre outwards, by Newton's method."""
    columns, rows = np.meshgrid(np.arange(config.width_px) + 0.5, np.arange(config.height_px) + 0.5)
    wanted = np.stack([(columns - config.cx) / config.fx, (rows - config.cy) / config.fy], axis=-1)
    ideal = np.zeros_like(wanted)
    for share in np.linspace(0.02, 1, 50):
        for _ in range(4):
            here, step = in_image(config, ideal), 1e-6
            slopes = [(in_image(config, ideal + np.eye(2)[i] * step) - here) / step for i in (0, 1)]
            (a, c), (b, d) = (np.moveaxis(slope, -1, 0) for slope in slopes)
            u, v = np.moveaxis(share * wanted - here, -1, 0)
            ideal = ideal + np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]
    assert np.abs(in_image(config, ideal) - wanted).max() < 1e-9
    return ideal


def directions(config):
    """Return the unit directions (H, W, 3) of all pixels, camera frame."""
    ideal = ideal_points(config)
    if config.projection == "fisheye":
        angle = np.linalg.norm(ideal, axis=-1, keepdims=True)
        return np.concatenate([np.cos(angle), -ideal * np.sinc(angle / np.pi)], axis=-1)
    local = np.concatenate([np.ones((*ideal.shape[:2], 1)), -ideal], axis=-1)
    return local / np.linalg.norm(local, axis=-1, keepdims=True)


def turned(count, seed=4):
    """Return positions and orientations of drones within the room."""
    rng = np.random.default_rng(seed)
    position = rng.uniform([-1, -1, 1], [1, 1, 3], (count, 3))
    return position.astype(np.float32), Rotation.random(count, random_state=seed).as_quat(scalar_first=True)


def shot(config, worlds=WORLD, count=5, **keywords):
    batch = flockstep.Batch(worlds, count, cameras=[config], **keywords)
    batch.set_pose(*turned(count))
    batch.sense()
    return batch


@pytest.mark.parametrize("tracer", ["tiles", "embree"])
@pytest.mark.parametrize("lens", LENSES)
def test_every_pixel_shows_what_its_ray_hits(lens, tracer):
    config = camera_of(**LENSES[lens], outputs=("depth", "instance", "normal"))
    batch = shot(config, tracer=tracer)
    local = directions(config)
    assert (local[0, 0, 0] < 0) == (lens == "wide")
    for drone in range(batch.num_drones):
        world = Rotation.from_quat(batch.quat_wxyz[drone], scalar_first=True).apply(local.reshape(-1, 3))
        rays = WORLD.raycast(np.broadcast_to(batch.position[drone], world.shape), world, config.far_m)
        depth, normal = batch.camera().depth[drone].ravel(), batch.camera().normal[drone].reshape(-1, 3)
        shown = np.minimum(rays["primitive"], len(WORLD.primitives)) + 1  # the mesh is one object
        same = batch.camera().instance[drone].ravel() == shown
        assert same.mean() > 0.995  # the others are on edges
        away = np.abs(depth - rays["t_hit"])
        assert np.quantile(away[same], 0.995) < 1e-4
        assert (np.abs(normal - rays["normal"])[same].max(axis=1) < 1e-3).mean() > 0.99


def test_planar_depth_is_along_the_optical_axis():
    planar, ranges = (shot(camera_of(**BARREL, depth_kind=kind)).camera().depth for kind in ("planar", "range"))
    np.testing.assert_allclose(planar, ranges * directions(camera_of(**BARREL))[..., 0], rtol=1e-5)


def test_without_coefficients_nothing_changes():
    outputs = ("rgb", "depth", "semantic", "instance", "normal")
    plain, zero = (shot(camera_of(outputs=outputs, distortion=k)) for k in ((), (0, 0, 0, 0, 0)))
    for output in outputs:
        np.testing.assert_array_equal(getattr(plain.camera(), output), getattr(zero.camera(), output))


@pytest.mark.parametrize("lens", LENSES)
def test_samples_and_light_suit_the_lens(lens):
    """A lens bends the samples of a pixel, too: their mean is the mean of a finer image."""
    soft = {"sun_size_deg": 2, "ambient_occlusion_rays": 2}
    for light, error, bias in (({}, 0.3, 0.1), (soft, 3.0, 0.3)):  # soft light is random
        fields = {**LENSES[lens], "outputs": ("rgb",), "shadows": True, **light}
        fine = shot(camera_of(**fields, width_px=4 * 43, height_px=4 * 34)).camera().rgb
        coarse = shot(camera_of(**fields, samples_per_pixel=16)).camera().rgb
        away = fine.reshape(5, 34, 4, 43, 4, 3).astype(float).mean(axis=(2, 4)) - coarse
        assert np.abs(away).mean() < error
        assert abs(away.mean()) < bias
        adaptive = shot(camera_of(**fields, samples_per_pixel=16, adaptive_samples=True)).camera().rgb
        assert np.abs(adaptive.astype(int) - coarse).mean() < 1.0


@pytest.mark.parametrize("lens", LENSES)
def test_images_do_not_depend_on_threads_and_neighbours(lens):
    config = camera_of(**LENSES[lens], outputs=("rgb", "depth"), samples_per_pixel=4)
    one, three = (shot(config, num_threads=threads) for threads in (1, 3))
    for output in config.outputs:
        np.testing.assert_array_equal(getattr(one.camera(), output), getattr(three.camera(), output))
    other = flockstep.Batch(WORLD, 1, cameras=[config])
    other.set_pose(one.position[3:4], one.quat_wxyz[3:4])
    other.sense()
    np.testing.assert_array_equal(other.camera().rgb[0], one.camera().rgb[3])


@pytest.mark.parametrize("lens", LENSES)
def test_lines_bend_with_the_image(lens):
    config = camera_of(**LENSES[lens], outputs=("rgb",), width_px=320, height_px=240)
    batch = flockstep.Batch(
        world_of(name="open", boxes=[{"center": [0, 0, -40], "size": [1, 1, 1]}]), 1, cameras=[config]
    )
    batch.set_pose([[0, 0, 0]])
    batch.set_move_line_visible(True)
    path = np.array([[1.0, -2, 1], [1.0, 2, 1.2], [2.0, 1.5, -1], [1.5, -1.8, -0.9]])
    for position in (*path, (0, 0, 0)):
        batch.move([position])
    line = batch.move_line(0)
    batch.sense()
    drawn = np.abs(batch.picture(0).astype(int) - batch.camera().rgb[0]).max(axis=-1) > 60
    dense = np.concatenate([np.linspace(a, b, 4000) for a, b in itertools.pairwise(line)])
    dense = dense[np.isfinite(dense).all(axis=1) & (np.linalg.norm(dense, axis=1) > 0.2)]
    side, ahead = -dense[:, 1:], dense[:, 0]
    across = np.linalg.norm(side, axis=1)
    radius = np.arctan2(across, ahead) if config.projection == "fisheye" else across / ahead
    seen = (radius < 2) & (ahead > 0.05)
    ideal = side[seen] * (radius / across)[seen, None]
    pixels = in_image(config, ideal) * [config.fx, config.fy] + [config.cx, config.cy]
    inside = ((pixels > 1) & (pixels < [319, 239])).all(axis=1)
    columns, rows = np.floor(pixels[inside]).astype(int).T
    assert drawn[rows, columns].mean() > 0.95  # a pixel whose corner the line cuts is drawn faintly
    centres = np.argwhere(drawn)[:, ::-1] + 0.5
    assert len(centres) > 200
    distance = cKDTree(pixels).query(centres)[0]
    assert (distance < 1.5).mean() > 0.97


class TestCalibration:
    """OpenCV finds the parameters in images of a checkerboard."""

    CORNERS = (8, 6)

    @staticmethod
    def board():
        """Squares of 10 cm, with a white margin, across the x axis at 0."""
        vertices = [[0, -0.1 * (i - 6), 0.1 * (j - 5)] for j in range(11) for i in range(13)]
        triangles = {"black": [], "white": []}
        for j in range(10):
            for i in range(12):
                inside = 1 < i < 11 and 1 < j < 9
                a, b, c, d = (13 * y + x for y, x in ((j, i), (j, i + 1), (j + 1, i + 1), (j + 1, i)))
                triangles["black" if inside and (i + j) % 2 else "white"] += [[a, b, c], [a, c, d]]
        meshes = [{"vertices": vertices, "triangles": t, "material": m} for m, t in triangles.items()]
        materials = {"black": {"base_color": [0.02] * 3}, "white": {"base_color": [0.9] * 3}}
        return world_of(name="board", materials=materials, meshes=meshes)

    def views(self, config, distance):
        """Return points of the board (V, P, 3) and where images show them (V, P, 2), px in OpenCV's coordinates."""
        rng = np.random.default_rng(0)
        count = 24
        at = rng.uniform([-1, -0.5, -0.4], [-0.7, 0.5, 0.4], (count, 3)) * distance
        aim = rng.uniform([0, -0.35, -0.25], [0, 0.35, 0.25], (count, 3)) - at  # a point of the board is in the middle
        yaw, pitch = np.arctan2(aim[:, 1], aim[:, 0]), -np.arctan2(aim[:, 2], np.hypot(aim[:, 0], aim[:, 1]))
        turn = Rotation.from_euler("ZYX", np.stack([yaw, pitch, rng.uniform(-0.5, 0.5, count)], axis=1))
        batch = flockstep.Batch(self.board(), count, cameras=[config])
        batch.set_pose(at.astype(np.float32), turn.as_quat(scalar_first=True))
        batch.sense()
        found = [cv2.findChessboardCornersSB(image, self.CORNERS, None) for image in batch.camera().grey]
        points = [corners.reshape(-1, 2) for is_found, corners in found if is_found]
        assert len(points) >= 10
        columns, rows = self.CORNERS
        board = np.stack([*np.meshgrid(np.arange(columns), np.arange(rows)), np.zeros((rows, columns))], axis=-1)
        return np.stack([0.1 * board.reshape(-1, 3)] * len(points)), np.stack(points)

    def expect(self, config, error, matrix, points):
        """Compare the focal lengths and the centre."""
        assert error < 0.15  # px
        spread = np.ptp(points.reshape(-1, 2), axis=0)
        assert (spread > 0.65 * np.array([config.width_px, config.height_px])).all()
        np.testing.assert_allclose([matrix[0, 0], matrix[1, 1]], [config.fx, config.fy], rtol=0.01)
        np.testing.assert_allclose(matrix[:2, 2] + 0.5, [config.cx, config.cy], atol=1.0)

    def test_brown_conrady(self):
        config = camera_of(**BARREL, width_px=480, height_px=360, outputs=("grey",), samples_per_pixel=16)
        board, points = self.views(config, 1.0)
        board, image = board.astype(np.float32), points.astype(np.float32)
        error, matrix, coefficients, *_ = cv2.calibrateCamera(list(board), list(image), (480, 360), None, None)
        self.expect(config, error, matrix, points)
        away = np.ravel(coefficients) - BARREL["distortion"]
        assert (np.abs(away) < [0.005, 0.01, 5e-4, 5e-4, 0.005]).all()

    def test_kannala_brandt(self):
        lens = {"projection": "fisheye", "distortion": (-0.02, 0.03, -0.02, 0.003), "hfov_deg": 120}
        config = camera_of(**lens, width_px=480, height_px=360, outputs=("grey",), samples_per_pixel=16)
        board, points = self.views(config, 0.8)
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
        error, matrix, coefficients, *_ = cv2.fisheye.calibrate(
            board[:, None], points[:, None].astype(float), (480, 360), np.eye(3), np.zeros(4), flags=flags
        )
        self.expect(config, error, matrix, points)
        np.testing.assert_allclose(np.ravel(coefficients), lens["distortion"], atol=0.012)


FOLDED = (-1.0, 0, 0, 0, 0)  # at a radius of 0.58


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"distortion": (0.1,)}, ["camera.distortion", 1]),
        ({"distortion": (0.1,) * 6}, ["camera.distortion", 6]),
        ({"distortion": (0.1,) * 5, "projection": "fisheye"}, ["camera.distortion", 5]),
        ({"distortion": (0.1, float("nan"), 0, 0)}, ["camera.distortion[1]", "nan"]),
        ({"distortion": (0, 0, 0, 2e6)}, ["camera.distortion[3]"]),
        ({"distortion": FOLDED}, ["camera.distortion", "fold"]),
        ({"distortion": (0, 0, 0, 5.0)}, ["camera.distortion", "fold"]),  # k1 is not what folds
        ({"distortion": (0, 0, 0.5, 0.5)}, ["camera.distortion", "fold"]),
        ({"distortion": (-1e6, 1e6, 1e6, -1e6, 1e6)}, ["camera.distortion", "fold"]),
        ({"distortion": (-0.5, 0, 0, 0), "projection": "fisheye", "hfov_deg": 150}, ["camera.distortion", "fold"]),
        ({"projection": "fisheye", "width_px": 10, "height_px": 90}, ["camera.hfov_deg", "180", 90]),
        ({"projection": "fisheye", "width_px": 90, "height_px": 10, "vfov_deg": 45}, ["camera.vfov_deg", "180", 45]),
        ({"projection": "fisheye", "depth_kind": "planar"}, ["camera.depth_kind", "range", "planar"]),
        (
            {"projection": "fisheye", "width_px": 8192, "height_px": 8192, "samples_per_pixel": 4},
            ["camera.width_px", 134217728, 5 * 8192**2],
        ),
        ({"projection": "orthographic"}, ["projection", "orthographic"]),
    ],
)
def test_bad_lenses(fields, said):
    with refused(ValueError, *said):
        camera_of(**fields)
    config = camera_of()
    with refused(ValueError, *said):
        for name, value in fields.items():
            setattr(config, name, value)
        flockstep.Batch(WORLD, cameras=[config])


def test_a_lens_that_folds_a_wider_image_is_refused_and_nothing_changes():
    config = camera_of(distortion=FOLDED, hfov_deg=30)
    batch = shot(config, count=2)
    before, depth = batch.snapshot(), batch.camera().depth.copy()
    with refused(ValueError, "camera.distortion", "fold"):
        batch.set_camera(hfov_deg=80)
    assert batch.snapshot() == before
    batch.sense()
    np.testing.assert_array_equal(batch.camera().depth, depth)
    batch.set_camera(np.array([False, True]), hfov_deg=20)
    batch.sense()
    assert batch.camera().config_of(1).distortion == config.distortion
    assert not np.array_equal(batch.camera().depth[1], depth[1])
    np.testing.assert_array_equal(batch.camera().depth[0], depth[0])


@pytest.mark.parametrize(
    ("fields", "said"),
    [({"distortion": (0.1, 0, 0, 0)}, ["distortion", 4]), ({"projection": "fisheye"}, ["projection"])],
)
def test_gl_has_no_lenses(fields, said):
    with refused(ValueError, *said, "gl"):
        flockstep.Batch(WORLD, cameras=[CameraConfig(**fields)], camera_backend="gl")
