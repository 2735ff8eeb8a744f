"""Lines, dots and solids with a depth test, in a frame small enough to count pixels."""

import numpy as np
import pytest
from conftest import world_of

import flockstep
from flockstep.pictures.depth_canvas import DepthCanvas

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
    camera = flockstep.CameraConfig(width_px=160, height_px=120, outputs=("rgb", "depth", "semantic"))
    world = world_of(name="goal", boxes=[solid], markers={"goal": [2, 0.3, -0.2], "radius": 0.4})
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


CENTERS = np.array([[4.0, x, -1] for x in np.arange(-2, 2, 0.5)])
STROKES = {
    "lines": lambda drawn: drawn.lines(np.array([[2, 1.3, 0.9]]), np.array([[9, -4.0, -1]]), INK, width_px=3),
    "glass": lambda drawn: drawn.lines(
        np.zeros((5, 3)), np.array([[3.0, y, y / 2] for y in range(5)]), INK, opacity=0.6
    ),
    "dots": lambda drawn: drawn.dots(np.array([[2, 0.33, 0.2], [3, 9, 9.0]]), INK, size_px=5),
    "sphere": lambda drawn: drawn.sphere(np.array([3, 0.4, -0.3]), 0.8, INK),
    "cells": lambda drawn: drawn.cells(CENTERS, 0.5, np.arange(24, dtype=np.uint8).reshape(8, 3) * 10),
    "stamp": lambda drawn: drawn.stamp(np.array([3, 0.4, -0.3]), np.full((7, 9, 4), 200, np.uint8)),
}


@pytest.mark.parametrize("stroke", STROKES)
def test_finer_samples_are_the_mean_of_a_finer_picture(stroke):
    """Drawn once into a picture with 2 x 2 samples in a pixel, and once into one with four times as many pixels."""
    wide = flockstep.CameraConfig(width_px=80, height_px=60, hfov_deg=90)
    whole = DepthCanvas(
        np.full((60, 80, 3), 50, np.uint8), np.full((60, 80), np.inf, np.float32), wide, np.zeros(3), LEVEL, LIGHT
    )
    drawn = DepthCanvas(
        np.full((30, 40, 3), 50, np.uint8), np.full((30, 40), np.inf, np.float32), CAMERA, np.zeros(3), LEVEL, LIGHT, 2
    )
    STROKES[stroke](whole)
    STROKES[stroke](drawn)
    expected = whole.rgb.reshape(30, 2, 40, 2, 3).mean(axis=(1, 3))
    assert (expected != 50).any()
    np.testing.assert_allclose(drawn.rgb, expected, atol=1)
    np.testing.assert_allclose(drawn.depth, whole.depth.reshape(30, 2, 40, 2).min(axis=(1, 3)), rtol=1e-6)
