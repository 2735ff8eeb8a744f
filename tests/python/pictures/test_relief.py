"""Worlds seen along an axis: heights against closed forms, cut areas, and paths that are plotted in them."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import world_of

from flockstep.pictures import relief
from flockstep.pictures.relief import SOLID, Relief

NOTHING = (225, 225, 228)
QUARTER = [0.70710678, 0, 0.70710678, 0]  # about y: z to x


def picture(world, cut_m, view="top", low=(0, 0), high=(8, 8), size=(160, 160)):
    return Relief(world, view, np.array(low), np.array(high), size).picture(cut_m)


def centres(low=(0, 0), high=(8, 8), size=(160, 160)):
    """(H, W) coordinates of the pixels' centres, right and up."""
    right = low[0] + (np.arange(size[0]) + 0.5) * (high[0] - low[0]) / size[0]
    up = high[1] - (np.arange(size[1]) + 0.5) * (high[1] - low[1]) / size[1]
    return np.meshgrid(right, up)


def same(image, expected):
    """Share of the pixels that match; pixels on borders may match their neighbours instead."""
    return (image == expected).all(axis=-1).mean()


@pytest.fixture
def heights(monkeypatch):
    """Encode the height's fraction in a pixel's red and green channels, without light."""
    monkeypatch.setattr(relief, "_ramp", lambda share: np.stack([share * 240, share * 240, 0 * share], axis=-1))
    monkeypatch.setattr(relief, "_shade", lambda normals, *axes: np.ones((len(normals), 1)))
    return lambda image: image[..., 0].astype(float) / 240


def test_heights_are_those_of_the_primitives(heights):
    """A slab, a sphere, a lying capsule, an upright cylinder, and the larger of two, seen from above everything."""
    world = world_of(
        boxes=[{"center": [4, 4, -0.5], "size": [8, 8, 1]}],
        spheres=[{"center": [2, 2, 1], "radius": 1.5}],
        capsules=[{"center": [5, 6, 1], "radius": 0.5, "height": 3, "quat_wxyz": QUARTER}],
        cylinders=[{"center": [6, 2, 1], "radius": 1, "height": 2}],
    )
    x, y = centres()
    expected = np.zeros_like(x)
    ball = 1.5**2 - (x - 2) ** 2 - (y - 2) ** 2
    expected = np.where(ball > 0, 1 + np.sqrt(np.maximum(ball, 0)), expected)
    rod = 0.5**2 - (y - 6) ** 2 - np.maximum(np.abs(x - 5) - 1, 0) ** 2
    expected = np.where(rod > 0, 1 + np.sqrt(np.maximum(rod, 0)), expected)
    expected = np.where(np.hypot(x - 6, y - 2) < 1, 2, expected)
    shares = heights(picture(world, 100.0))
    # The bounds are -1 to 2.5 m; one level is 1 / 240 of that.
    off = np.abs(shares * 3.5 - 1 - expected) > 3.5 / 240
    assert off.mean() < 0.002  # at silhouettes


def test_heights_are_those_of_a_mesh(heights):
    """A hill of triangles; the height is linear within each."""
    n = 9
    gx, gy = np.meshgrid(np.linspace(0, 8, n), np.linspace(0, 8, n))
    gz = 2 * np.sin(gx) * np.cos(gy / 2)
    i = np.arange(n * n).reshape(n, n)
    upper = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:]], -1).reshape(-1, 3)
    lower = np.stack([i[:-1, :-1], i[1:, 1:], i[1:, :-1]], -1).reshape(-1, 3)
    vertices = np.stack([gx.ravel(), gy.ravel(), gz.ravel()], 1)
    world = world_of(meshes=[{"vertices": vertices.tolist(), "triangles": np.concatenate([upper, lower]).tolist()}])
    x, y = centres()
    a, b = np.clip(x.astype(int), 0, n - 2), np.clip(y.astype(int), 0, n - 2)
    u, v = x - a, y - b
    at = gz[b, a]
    right, diagonal, up = gz[b, a + 1], gz[b + 1, a + 1], gz[b + 1, a]
    expected = np.where(u > v, at + u * (right - at) + v * (diagonal - right), at + v * (up - at) + u * (diagonal - up))
    shares = heights(picture(world, 100.0))
    low, high = world.bounds[:, 2]
    np.testing.assert_allclose(low + shares * (high - low), expected, atol=0.51 * (high - low) / 240 + 1e-4)


def test_what_a_plane_cuts_of_primitives_is_dark():
    """Test each kind, rotated, against its own inequality."""
    turn = np.array([0.9, 0.1, 0.3, 0.2])
    turn /= np.linalg.norm(turn)
    w, q = turn[0], turn[1:]
    world = world_of(
        boxes=[{"center": [2, 2, 2], "size": [2, 1.2, 1.5], "quat_wxyz": turn.tolist()}],
        cylinders=[{"center": [6, 2, 2], "radius": 0.8, "height": 1.5, "quat_wxyz": turn.tolist()}],
        spheres=[{"center": [2, 6, 1.5], "radius": 1}],
        capsules=[{"center": [6, 6, 2], "radius": 0.6, "height": 3, "quat_wxyz": turn.tolist()}],
    )
    x, y = centres()
    points = np.stack([x, y, np.full_like(x, 2.2)], axis=-1)

    def local(center):
        p = points - center
        twice = 2 * np.cross(-q, p)
        return p + w * twice + np.cross(-q, twice)

    box, cylinder, rod = local([2, 2, 2]), local([6, 2, 2]), local([6, 6, 2])
    inside = (np.abs(box) < [1, 0.6, 0.75]).all(axis=-1)
    inside |= (np.hypot(cylinder[..., 0], cylinder[..., 1]) < 0.8) & (np.abs(cylinder[..., 2]) < 0.75)
    inside |= np.linalg.norm(points - [2, 6, 1.5], axis=-1) < 1
    beyond = np.maximum(np.abs(rod[..., 2]) - 0.9, 0)
    inside |= rod[..., 0] ** 2 + rod[..., 1] ** 2 + beyond**2 < 0.36
    dark = (picture(world, 2.2) == SOLID).all(axis=-1)
    assert inside.sum() > 2000
    assert (inside & ~dark).sum() == 0
    # The outline may be one pixel wider.
    near = np.zeros_like(inside)
    for shift in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        near |= np.roll(inside, shift, (0, 1))
    assert (dark & ~inside & ~near).sum() == 0


def test_rooms_planes_and_meshes_are_cut_along_their_surface():
    wall = [[2, 2, 0], [2, 6, 0], [2, 6, 3], [2, 2, 3]]
    world = world_of(
        room={"min": [1, 1, 0], "max": [7, 7, 4]},
        planes=[{"center": [5, 4, 1.5], "size": [3, 2], "quat_wxyz": QUARTER}],
        meshes=[{"vertices": wall, "triangles": [[0, 1, 2], [0, 2, 3]]}],
    )
    x, y = centres()
    dark = (picture(world, 2.0) == SOLID).all(axis=-1)
    border = np.maximum(np.abs(x - 4), np.abs(y - 4))
    pixel = 8 / 160
    expected = np.abs(border - 3) < pixel
    expected |= (np.abs(x - 5) < pixel) & (np.abs(y - 4) < 1 + pixel)
    expected |= (np.abs(x - 2) < pixel) & (np.abs(y - 4) < 2 + pixel)
    assert not (dark & ~expected).any()
    assert dark[(y > 3.2) & (y < 4.8) & (np.abs(x - 5) < pixel)].mean() == 0.5  # one pixel wide
    assert dark.sum() >= (4 * 6 + 2 + 4) / pixel - 8
    above = (picture(world, 3.5) == SOLID).all(axis=-1)  # above the plane and the wall of triangles
    assert not (above & (border < 2.5)).any()
    outside = border > 3 + pixel
    assert (picture(world, 2.0)[outside] == NOTHING).all()


def test_a_ceiling_is_cut_at_any_height():
    world = world_of(room={"min": [1, 1, 0], "max": [7, 7, 4]}, boxes=[{"center": [4, 4, 0.5], "size": [1, 1, 1]}])
    high = picture(world, 100.0, low=(-0.03, -0.03))
    np.testing.assert_array_equal(high, picture(world, 3.9, low=(-0.03, -0.03)))
    assert tuple(high[80, 80]) != tuple(high[40, 40])  # the box and the floor


def test_ground_above_the_plane_is_dark():
    slope = [[0, 0, 0], [8, 0, 4], [8, 8, 4], [0, 8, 0]]
    world = world_of(meshes=[{"vertices": slope, "triangles": [[0, 1, 2], [0, 2, 3]]}])
    dark = (picture(world, 2.0) == SOLID).all(axis=-1)
    x, _ = centres()
    np.testing.assert_array_equal(dark[x > 4.05], True)
    np.testing.assert_array_equal(dark[x < 3.95], False)


def test_what_hangs_over_nothing_is_not_ground():
    world = world_of(boxes=[{"center": [4, 4, 3], "size": [4, 4, 1]}])
    assert (picture(world, 1.0) == NOTHING).all()


def test_from_the_side_nearer_is_smaller_y(heights):
    """Two boxes, one in front of the other; the plane removes the nearer one or cuts through it."""
    world = world_of(boxes=[{"center": [3, 2, 1], "size": [2, 2, 2]}, {"center": [4, 6, 2], "size": [4, 2, 4]}])
    x, z = centres(high=(8, 4), size=(160, 80))
    front, back = (np.abs(x - 3) < 1) & (z < 2), np.abs(x - 4) < 2
    for cut_m, share_of_front in ((-10.0, 1.0), (3.5, 2 / 6)):
        image = picture(world, cut_m, "side", high=(8, 4), size=(160, 80))
        np.testing.assert_allclose(heights(image)[front], share_of_front, atol=1 / 240)
        np.testing.assert_allclose(heights(image)[back & ~front], 2 / 6, atol=1 / 240)
        assert (image[~front & ~back] == NOTHING).all()
    through = picture(world, 2.0, "side", high=(8, 4), size=(160, 80))
    assert same(through[front], SOLID) == 1
    assert same(through[back & ~front & (z > 2.1)], SOLID) == 0


def test_what_is_hidden_is_not_cut():
    wall = {"vertices": [[2, 2, 0], [2, 6, 0], [2, 6, 3], [2, 2, 3]], "triangles": [[0, 1, 2], [0, 2, 3]]}
    box = {"center": [4, 4, 1], "size": [2, 2, 2]}
    floor = {"center": [4, 4, 0], "size": [8, 8]}
    bare = picture(world_of(planes=[floor]), 1.0)
    hidden = picture(
        world_of(planes=[floor], boxes=[{**box, "visible": False}], meshes=[{**wall, "visible": False}]), 1.0
    )
    seen = picture(world_of(planes=[floor], boxes=[{**box, "solid": False}], meshes=[{**wall, "solid": False}]), 1.0)
    dark = (picture(world_of(planes=[floor], boxes=[box], meshes=[wall]), 1.0) == SOLID).all(axis=-1)
    assert dark.any()
    np.testing.assert_array_equal((seen == SOLID).all(axis=-1), dark)
    assert not (hidden == SOLID).all(axis=-1).any()
    assert not (bare == SOLID).all(axis=-1).any()


def test_a_mesh_and_a_path_that_leaves_it_are_drawn(tmp_path):
    pytest.importorskip("stable_baselines3")
    from training.evaluate import Flight
    from training.plot_paths import draw_path, plot_flight

    wall = [[3, -2, 0], [3, 2, 0], [3, 2, 2], [3, -2, 2]]
    floor = [[0, -3, 0], [6, -3, 0], [6, 3, 0], [0, 3, 0]]
    meshes = [{"vertices": corners, "triangles": [[0, 1, 2], [0, 2, 3]]} for corners in (wall, floor)]
    world = world_of(name="wall", meshes=meshes, markers={"goal": [5, 0, 1]})
    trail = np.float32([[1, 0, 1], [1, 2.5, 1], [8, 2.5, 1]])
    flight = Flight("wall", "time", 2, 0.0, 9.5, None, trail)
    figure, axes = plt.subplots()
    for view, corners, dark in (("top", (0, 8, -3, 3), 3), ("side", (0, 8, 0, 2), None)):
        axes.clear()
        draw_path(axes, world, view, flight, ("start",))
        (image,), circles = axes.get_images(), axes.patches
        left, right, bottom, top = image.get_extent()
        assert left < corners[0] < corners[1] < right
        assert bottom < corners[2] < corners[3] < top
        assert right - left == pytest.approx(8 * 1.03)
        assert not circles  # the world has no start
        columns = np.flatnonzero((np.asarray(image.get_array()) == SOLID).all(axis=-1).any(axis=0))
        if dark is not None:  # from above, the cut follows the wall
            np.testing.assert_allclose(left + (columns + 0.5) * (right - left) / 900, dark, atol=0.02)
    draw_path(axes, world, "top", flight, ("goal",))
    assert [circle.center for circle in axes.patches] == [(5, 0)]
    plt.close(figure)
    plot_flight(world, flight, tmp_path / "path.png")
    assert (tmp_path / "path.png").stat().st_size > 1000
