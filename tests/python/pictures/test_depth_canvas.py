"""Lines, dots and solids with a depth test, in a frame small enough to count pixels."""

import numpy as np
import pytest

import flockstep
from flockstep.pictures.depth_canvas import DepthCanvas
from flockstep.rotations import rotate

INK = (250, 10, 10)
# fx = fy = 20 px: a point 2 m ahead moves 10 pixels per metre.
CAMERA = flockstep.CameraConfig(width_px=40, height_px=30, hfov_deg=90, near_m=0.1)
LEVEL = np.array([1.0, 0, 0, 0])
# Every face has its own colour, brighter by half if it faces up.
LIGHT = {
    "sun_direction": [0, 0, 1],
    "sun_color": [0.5] * 3,
    "sky_ambient": [1] * 3,
    "ground_ambient": [1] * 3,
    "gamma": 1,
}


def canvas(wall_m=np.inf, position=(0, 0, 0), quat_wxyz=LEVEL):
    rgb = np.zeros((30, 40, 3), np.uint8)
    depth = np.full((30, 40), wall_m, np.float32)
    return DepthCanvas(rgb, depth, CAMERA, np.array(position, float), quat_wxyz, LIGHT)


def inked(drawn):
    """(row, column) of the pixels in the ink's colour."""
    return {tuple(at) for at in np.argwhere((drawn.rgb == INK).all(axis=-1)).tolist()}


def test_project():
    drawn = canvas()
    points = np.array([[2, 0, 0], [2, 2, 1.5], [2, -2, -1.5], [4, 1, -1]])
    expected = [[20, 15, 2], [0, 0, 2], [40, 30, 2], [15, 20, 4]]
    np.testing.assert_allclose(drawn.project(points), expected, atol=1e-12)


def test_project_agrees_with_the_camera(room):
    """The goal's projected centre is the middle of its pixels."""
    camera = flockstep.CameraConfig(width_px=400, height_px=300, outputs=("rgb", "depth", "semantic"))
    position, quat_wxyz = np.array([3.0, 5.5, 2.5]), np.array([0.98, 0.05, 0.1, -0.16])
    quat_wxyz /= np.linalg.norm(quat_wxyz)
    picture = flockstep.render(room, position, quat_wxyz, camera=camera)
    drawn = DepthCanvas(picture["rgb"], picture["depth"], camera, position, quat_wxyz, room.light)
    ((x, y, depth),) = drawn.project(np.array([room.goal], float))
    rows, columns = np.nonzero(picture["semantic"] == 65535)
    assert x == pytest.approx(columns.mean() + 0.5, abs=0.6)
    assert y == pytest.approx(rows.mean() + 0.5, abs=0.6)
    assert depth == pytest.approx(picture["depth"][int(y), int(x)] + room.marker_radius_m, abs=0.02)


def test_a_lines_pixels():
    drawn = canvas()
    drawn.lines(np.array([[2, 1.05, 0.05]]), np.array([[2, -0.95, 0.05]]), INK)  # row 14, columns 9 to 29
    assert inked(drawn) == {(14, column) for column in range(9, 30)}
    np.testing.assert_allclose(drawn.depth[14, 9:30], 2)
    assert np.isinf(drawn.depth[13]).all()

    upright = canvas()
    upright.lines(np.array([[2, 1.05, 0.95]]), np.array([[2, 1.05, -0.55]]), INK)
    assert inked(upright) == {(row, 9) for row in range(5, 21)}

    slanted = canvas()
    slanted.lines(np.array([[2, 1.95, 1.45]]), np.array([[2, -0.95, -1.45]]), INK)
    assert inked(slanted) == {(i, i) for i in range(30)}


def test_a_lines_depth_is_that_of_its_points():
    drawn = canvas()
    drawn.lines(np.array([[1, 0.9, 0.0]]), np.array([[8, -6.0, 0.0]]), INK)
    assert {row for row, _ in inked(drawn)} == {15}
    for column in np.flatnonzero(np.isfinite(drawn.depth[15])):
        slope = (20 - column - 0.5) / 20  # y / x of the pixel's centre: on the line 0.9 - 6.9 (x - 1) / 7 = slope x
        half_a_pixel = 0.5 / 20 / (0.9 + 6.9 / 7)
        inverse = (slope + 6.9 / 7) / (0.9 + 6.9 / 7)
        assert 1 / drawn.depth[15, column] == pytest.approx(inverse, abs=1.01 * half_a_pixel)


def test_lines_are_cut_at_the_frame_and_the_near_plane():
    drawn = canvas()
    drawn.lines(np.array([[-5, 0.005, -0.005]]), np.array([[1, 0.005, -0.005]]), INK)  # from behind
    assert inked(drawn) <= {(row, column) for row in range(15, 17) for column in range(18, 20)}
    assert inked(drawn)
    across = canvas()
    across.lines(np.array([[2, 500, 0.05]]), np.array([[2, -500, 0.05]]), INK)
    assert inked(across) == {(14, column) for column in range(40)}
    outside = canvas()
    outside.lines(np.array([[2, 5, 0], [-1, 0, 0]]), np.array([[2, 5, 3], [-2, 1, 1]]), INK)
    outside.lines(np.zeros((0, 3)), np.zeros((0, 3)), INK)
    assert not inked(outside)


def test_a_wall_hides_what_is_behind():
    drawn = canvas(wall_m=2.0)
    ends = np.array([[1.9, 0, 0.3], [2.0, 0, 0.0], [2.1, 0, -0.3]])
    starts = ends + np.array([0, 0.5, 0])
    drawn.lines(starts, ends, INK)
    assert {row for row, _ in inked(drawn)} == {11, 15}  # in front of the wall, and on it
    before = inked(drawn)
    drawn.dots(np.array([[3.0, 0, 0.5], [1.0, 0, 0.5]]), INK)
    assert inked(drawn) - before == {(5, 20)}
    half = canvas(wall_m=2.0)
    half.lines(np.array([[1.0, 0.5, 0.0]]), np.array([[3.0, -0.5, 0.0]]), INK)  # pierces the wall at y = 0
    assert max(column for _, column in inked(half)) in (19, 20)
    assert min(column for _, column in inked(half)) == 10


def test_width_and_opacity():
    drawn = canvas(wall_m=5.0)
    drawn.rgb[:] = 100
    drawn.lines(np.array([[2, 1.05, 0.05]]), np.array([[2, 0.05, 0.05]]), (200, 0, 100), opacity=0.5)
    np.testing.assert_array_equal(drawn.rgb[14, 12], [150, 50, 100])
    assert drawn.depth[14, 12] == 5  # glass leaves the depth
    wide = canvas()
    wide.lines(np.array([[2, 1.05, 0.05]]), np.array([[2, -0.95, 0.05]]), INK, width_px=2)
    assert inked(wide) == {(row, column) for row in (13, 14) for column in range(8, 30)}
    dot = canvas()
    dot.dots(np.array([[2, 0.05, 0.05]]), INK, size_px=3)
    assert inked(dot) == {(row, column) for row in range(13, 16) for column in range(18, 21)}


BOX_NORMALS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
BOX_COLORS = np.array([INK, INK, (1, 2, 3), (4, 5, 6), (7, 8, 9), (10, 11, 12)], np.uint8)


def box(drawn, center, half):
    center, half = np.asarray(center, float), np.asarray(half, float)
    corners = center + half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    drawn.solid(BOX_NORMALS, np.abs(BOX_NORMALS) @ half + BOX_NORMALS @ center, corners, BOX_COLORS)


def test_a_solids_pixels_and_depth():
    drawn = canvas()
    box(drawn, (3, 0, 0), (1, 0.5, 0.4))  # its front, 2 m away, is 10 by 8 pixels
    assert inked(drawn) == {(row, column) for row in range(11, 19) for column in range(15, 25)}
    np.testing.assert_allclose(drawn.depth[11:19, 15:25], 2)
    assert np.isfinite(drawn.depth).sum() == 80


def test_a_solid_is_hidden_by_and_hides():
    drawn = canvas(wall_m=1.5)
    box(drawn, (3, 0, 0), (1, 0.5, 0.4))
    assert not inked(drawn)
    drawn = canvas()
    box(drawn, (3, 0, 0), (1, 0.5, 0.4))
    drawn.lines(np.array([[2.5, 1, 0]]), np.array([[2.5, -1, 0]]), (0, 0, 200))
    assert (drawn.rgb[15, 15:25] == INK).all()
    assert (drawn.rgb[15, 12:15] == (0, 0, 200)).all()


def test_a_solid_agrees_with_the_engines_box():
    """The same box in a world: the same pixels at the same depth."""
    half = np.array([0.6, 0.4, 0.25])
    turn = np.array([0.9, 0.1, 0.3, 0.3])
    turn /= np.linalg.norm(turn)
    scene = {
        "flockstep_scene": 1,
        "name": "box",
        "boxes": [{"center": [2, 0.3, -0.2], "size": (2 * half).tolist(), "quat_wxyz": turn.tolist()}],
    }
    camera = flockstep.CameraConfig(width_px=160, height_px=120, outputs=("rgb", "depth"))
    expected = flockstep.render(flockstep.World.from_dict(scene), (0, 0, 0), camera=camera)["depth"]
    rgb, depth = np.zeros((120, 160, 3), np.uint8), np.full((120, 160), np.inf, np.float32)
    normals = rotate(turn, BOX_NORMALS)
    center = np.array([2, 0.3, -0.2])
    corners = center + rotate(turn, half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]))
    DepthCanvas(rgb, depth, camera, np.zeros(3), LEVEL, LIGHT).solid(
        normals, np.abs(BOX_NORMALS) @ half + normals @ center, corners, BOX_COLORS
    )
    assert (np.isfinite(depth) != np.isfinite(expected)).sum() <= 3
    both = np.isfinite(depth) & np.isfinite(expected)
    assert both.sum() > 1000
    np.testing.assert_allclose(depth[both], expected[both], rtol=1e-4)


def test_a_solid_around_or_behind_the_viewer_is_not_seen():
    drawn = canvas()
    box(drawn, (0, 0, 0), (1, 1, 1))
    box(drawn, (-3, 0, 0), (1, 1, 1))
    box(drawn, (2, 9, 0), (1, 1, 1))
    assert not drawn.rgb.any()


def test_a_spheres_pixels_depth_and_shade():
    """Compare with the equation of the sphere, pixel by pixel, and with the formula of the light."""
    drawn = canvas()
    center, radius = np.array([3.0, 0.4, -0.3]), 0.8
    drawn.sphere(center, radius, (100, 60, 20))
    seen = 0
    for row in range(30):
        for column in range(40):
            ray = np.array([1, (20 - column - 0.5) / 20, (15 - row - 0.5) / 20])
            nearest = (ray @ center) / (ray @ ray)
            off = np.linalg.norm(nearest * ray - center)
            if off > radius:
                assert np.isinf(drawn.depth[row, column])
                assert not drawn.rgb[row, column].any()
                continue
            seen += 1
            depth = nearest - np.sqrt((radius**2 - off**2) / (ray @ ray))
            assert drawn.depth[row, column] == pytest.approx(depth, abs=1e-5)
            up = (depth * ray - center)[2] / radius
            expected = np.array([100, 60, 20]) * (1 + 0.5 * max(up, 0))
            np.testing.assert_allclose(drawn.rgb[row, column], expected, atol=0.51)
    assert seen > 80


def test_a_sphere_agrees_with_the_engines_sphere():
    """A sphere among a world's markers: the same pixels, depths and colours."""
    solid = {"center": [60, 0, 0], "size": [1, 1, 1]}
    scene = {"flockstep_scene": 1, "name": "goal", "boxes": [solid], "markers": {"goal": [2, 0.3, -0.2], "radius": 0.4}}
    camera = flockstep.CameraConfig(width_px=160, height_px=120, outputs=("rgb", "depth", "semantic"))
    world = flockstep.World.from_dict(scene)
    expected = flockstep.render(world, (0, 0, 0), camera=camera)
    goal = expected["semantic"] == 65535
    color = tuple(int(c) for c in expected["rgb"][goal].max(axis=0))
    rgb, depth = np.zeros((120, 160, 3), np.uint8), np.full((120, 160), np.inf, np.float32)
    drawn = DepthCanvas(rgb, depth, camera, np.zeros(3), LEVEL, world.light)
    drawn.sphere(np.array([2, 0.3, -0.2]), 0.4, color)
    both = goal & np.isfinite(depth)
    assert (goal != np.isfinite(depth)).sum() <= 3
    assert both.sum() > 500
    np.testing.assert_allclose(depth[both], expected["depth"][both], rtol=1e-4)
    shades = rgb[both].astype(float).mean(axis=1) / expected["rgb"][both].astype(float).mean(axis=1)
    assert np.ptp(shades) < 0.05  # one base colour, equally lit


def test_a_sphere_is_hidden_hides_and_is_not_seen_from_inside():
    drawn = canvas(wall_m=1.5)
    drawn.sphere(np.array([3.0, 0, 0]), 0.5, INK)
    assert not drawn.rgb.any()
    drawn = canvas()
    drawn.sphere(np.array([0.2, 0, 0]), 1.0, INK)  # around the viewer
    drawn.sphere(np.array([-3.0, 0, 0]), 1.0, INK)
    drawn.sphere(np.array([2.0, 9, 0]), 1.0, INK)
    assert not drawn.rgb.any()
    drawn.sphere(np.array([3.0, 0, 0]), 0.5, (9, 9, 9))
    drawn.lines(np.array([[4.0, 1, 0]]), np.array([[4.0, -1, 0]]), INK)
    assert inked(drawn)
    assert (15, 20) not in inked(drawn)


def test_a_turned_viewer():
    quat_wxyz = np.array([np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])  # faces +y
    drawn = canvas(position=(1, 2, 3), quat_wxyz=quat_wxyz)
    np.testing.assert_allclose(drawn.project(np.array([[1 - 1, 2 + 2, 3 + 1.0]])), [[10, 5, 2]], atol=1e-9)


def brute_force(drawn, corners):
    """(H, W) depth and triangle index, by intersecting each pixel's ray with each triangle in double precision."""
    depth, which = np.full(drawn.depth.shape, np.inf), np.full(drawn.depth.shape, -1)
    for row in range(30):
        for column in range(40):
            ray = np.array([1, (20 - column - 0.5) / 20, (15 - row - 0.5) / 20])
            for index, (a, b, c) in enumerate(corners):
                matrix = np.stack([a - b, a - c, ray], axis=1)
                if abs(np.linalg.det(matrix)) < 1e-12:
                    continue
                u, v, distance = np.linalg.solve(matrix, a)
                if u >= 0 and v >= 0 and u + v <= 1 and 0.1 <= distance < depth[row, column]:
                    depth[row, column], which[row, column] = distance, index
    return depth, which


@pytest.mark.parametrize("nearest", [0.5, -1.0])
def test_triangles_pixels_and_depth(nearest):
    """Random triangles that intersect each other and, in the second case, also the near plane and the viewer."""
    rng = np.random.default_rng(4)
    corners = rng.uniform([nearest, -1.5, -1.5], [4, 1.5, 1.5], (25, 3, 3))
    colors = rng.integers(1, 255, (25, 3)).astype(np.uint8)
    drawn = canvas()
    drawn.triangles(corners, colors)
    depth, which = brute_force(drawn, corners)
    seen = np.isfinite(depth)
    assert 300 < seen.sum() < 1200
    np.testing.assert_array_equal(np.isfinite(drawn.depth), seen)
    np.testing.assert_allclose(drawn.depth[seen], depth[seen], rtol=1e-5)
    np.testing.assert_array_equal(drawn.rgb[seen], colors[which[seen]])
    assert not drawn.rgb[~seen].any()


def test_triangles_that_share_their_sides_leave_no_gap():
    """A fan of slivers around a point fills the frame at any rotation: every pixel is drawn exactly once."""
    angle = np.linspace(0, 2 * np.pi, 200)
    rim = np.stack([np.full(200, 2.0), 4 * np.cos(angle), 4 * np.sin(angle)], axis=1)
    fan = np.stack([np.broadcast_to([2.0, 0.013, 0.021], (199, 3)), rim[:-1], rim[1:]], axis=1)
    drawn = canvas()
    drawn.triangles(fan, np.full((199, 3), 9, np.uint8))
    np.testing.assert_allclose(drawn.depth, 2, rtol=1e-6)
    assert (drawn.rgb == 9).all()


def test_triangles_hide_and_are_hidden():
    square = np.array([[[2, 1, -1], [2, -1, -1], [2, 1, 1]], [[2, -1, -1], [2, -1, 1], [2, 1, 1]]], float)
    ink = np.tile(np.array([INK], np.uint8), (2, 1))
    wall = canvas(wall_m=1.9)
    wall.triangles(square, ink)
    assert not inked(wall)
    drawn = canvas(wall_m=2.1)
    drawn.triangles(square, ink)
    assert inked(drawn) == {(row, column) for row in range(5, 25) for column in range(10, 30)}
    drawn.lines(np.array([[3.0, 2, 0]]), np.array([[3.0, -2, 0]]), (0, 0, 200))  # also behind the wall
    assert len(inked(drawn)) == 400
    box(drawn, (1.5, 0, 0), (0.2, 0.1, 0.1))
    assert drawn.depth[15, 20] == pytest.approx(1.3)
    drawn.triangles(square, ink)
    assert drawn.depth[15, 20] == pytest.approx(1.3)
    behind = canvas()
    behind.triangles(square - np.array([5, 0, 0]), ink)
    behind.triangles(square + np.array([0, 9, 0]), ink)
    behind.triangles(square[:0], ink[:0])
    assert not inked(behind)


def test_triangles_agree_with_the_engines_mesh():
    """The same mesh in a world: the same pixels at the same depth."""
    rng = np.random.default_rng(0)
    corners = rng.uniform([1, -1, -1], [4, 1, 1], (40, 3, 3)).astype(np.float32)
    mesh = {"vertices": corners.reshape(-1, 3).tolist(), "triangles": np.arange(120).reshape(-1, 3).tolist()}
    camera = flockstep.CameraConfig(width_px=160, height_px=120, outputs=("rgb", "depth"))
    world = flockstep.World.from_dict({"flockstep_scene": 1, "name": "mesh", "meshes": [mesh]})
    expected = flockstep.render(world, (0, 0, 0), camera=camera)["depth"]
    rgb, depth = np.zeros((120, 160, 3), np.uint8), np.full((120, 160), np.inf, np.float32)
    drawn = DepthCanvas(rgb, depth, camera, np.zeros(3), LEVEL, LIGHT)
    drawn.triangles(corners.astype(float), np.full((40, 3), 99, np.uint8))
    both = np.isfinite(depth) & np.isfinite(expected)
    assert (np.isfinite(depth) != np.isfinite(expected)).sum() <= 10
    assert both.sum() > 4000
    assert (np.abs(depth[both] - expected[both]) > 1e-4 * expected[both]).sum() <= 10  # at edges that one just misses
