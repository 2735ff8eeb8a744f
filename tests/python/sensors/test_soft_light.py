"""Soft light: ambient occlusion and the sun's size, against integrals in NumPy and against hard light."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import placed, world_of
from messages import refused
from test_camera import ROUND, rays

import flockstep
from flockstep.pictures.picture import facing

REACH_M = 1.5
LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.0, 1.5, 2.5])
WHITE = {"default": {"base_color": [1, 1, 1]}}
SOFT: dict[str, Any] = {"shadows": True, "sun_size_deg": 3.0, "ambient_occlusion_rays": 4}
DOWN = [np.sqrt(0.5), 0, np.sqrt(0.5), 0]

Floats = npt.NDArray[np.float64]


def light(sun: float, ambient: float) -> dict[str, Any]:
    """A light under which a white surface shows its share of the light as a share of 255."""
    return {
        "sun_direction": [0, 0, 1],
        "sun_color": [sun] * 3,
        "sky_ambient": [ambient] * 3,
        "ground_ambient": [ambient] * 3,
        "gamma": 1,
    }


def walls() -> list[tuple[list[float], list[float]]]:
    """Centres and sizes of boxes around the room from LOW to HIGH."""
    middle, size = (LOW + HIGH) / 2, HIGH - LOW
    found = []
    for axis in range(3):
        for side in (-1, 1):
            center, thick = middle.copy(), size + 1
            center[axis] += side * (size[axis] / 2 + 0.25)
            thick[axis] = 0.5
            found.append((center.tolist(), thick.tolist()))
    return found


def room(kind: str) -> flockstep.Batch:
    """A batch with one drone in a white room, whose walls are of this kind, and with one camera."""
    parts: dict[str, Any] = {"materials": WHITE, "light": light(0, 1)}
    if kind == "room":
        parts["room"] = {"min": LOW.tolist(), "max": HIGH.tolist()}
    elif kind == "many boxes":  # too many for the list of casters
        parts["boxes"] = [{"center": center, "size": size} for center, size in walls()]
        parts["boxes"] += [{"center": [x, 60, 1], "size": [0.5, 0.5, 0.5]} for x in range(70)]
    elif kind == "mesh":
        corners = [[x, y, z] for x in (LOW[0], HIGH[0]) for y in (LOW[1], HIGH[1]) for z in (LOW[2], HIGH[2])]
        quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        triangles = [triangle for a, b, c, d in quads for triangle in ([a, b, c], [a, c, d])]
        parts["meshes"] = [{"vertices": corners, "triangles": triangles}]
    else:
        parts["planes"] = [{"center": [0, 0, -5], "size": [1, 1]}]
    camera = flockstep.CameraConfig(
        width_px=40, height_px=30, outputs=["rgb", "depth", "normal"], ambient_occlusion_rays=16, hfov_deg=100
    )
    place = np.array([-1.2, -0.9, 1.8])
    batch = placed([world_of(**parts)], place, [facing(place, [0.6, 0.5, 0])], cameras=[camera], max_bodies=6)
    if kind == "moving boxes":
        for center, size in walls():
            wall = flockstep.BodyConfig(shape="box", size_m=size, position_m=center, color=[1, 1, 1])
            batch.bodies.spawn(wall)
    batch.capture()
    return batch


def unhidden(points: Floats, normals: Floats, number: int = 4096) -> Floats:
    """The share (K,) of directions above points in the room, weighted by the cosine, without a wall within reach."""
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(number, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    shares = []
    for point, normal in zip(points, normals, strict=True):
        way = normal + sphere  # its direction is distributed like the cosine
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_wall = np.where(way > 0, (HIGH - point) / way, (LOW - point) / way)
        shares.append((np.nanmin(to_wall, axis=1) > REACH_M).mean())
    return np.array(shares)


@pytest.mark.parametrize("kind", ["room", "many boxes", "mesh", "moving boxes"])
def test_corners_of_a_room_are_darker_by_the_integral_of_the_cosine(kind: str) -> None:
    batch = room(kind)
    camera = batch.camera()
    rows, columns = (axis.ravel() for axis in np.mgrid[:30, :40])
    origin, directions = rays(batch, 0, rows, columns)
    points = origin + directions * camera.depth[0].reshape(-1, 1)
    normals = camera.normal[0].reshape(-1, 3).astype(float)
    points = np.clip(points + 1e-6 * normals, LOW + 1e-6, HIGH - 1e-6)
    expected, seen = unhidden(points, normals), camera.rgb[0, ..., 0].ravel() / 255
    assert expected.min() < 0.4 and expected.max() > 0.99  # from a corner to the middle
    error = seen - expected
    assert (
        abs(error.mean()) < 0.006
    )  # the integral's own error is up to 0.5 / sqrt(4,096) = 0.008, the same in each wall
    assert np.sqrt((error**2).mean()) < 0.1  # of single pixels; 0.125 at most for random rays
    assert seen[expected > 0.95].mean() > 0.93 and seen[expected < 0.5].mean() < 0.5


def test_shadow_edge_is_as_wide_as_the_sun_seen_from_its_height() -> None:
    height, size_deg = 2.0, 8.0
    world = world_of(
        materials=WHITE,
        light=light(1, 0),
        planes=[{"center": [0, 0, 0], "size": [20, 20]}, {"center": [-2.5, 0, height], "size": [5, 10]}],
    )
    camera = flockstep.CameraConfig(
        width_px=64,
        height_px=96,
        hfov_deg=50,
        samples_per_pixel=16,
        shadows=True,
        sun_size_deg=size_deg,
        quat_wxyz=DOWN,
    )
    batch = placed([world], [0, 0, 1], [[np.sqrt(0.5), 0, 0, -np.sqrt(0.5)]], cameras=[camera])
    batch.capture()
    seen = batch.camera().rgb[0, ..., 0] / 255
    origin, directions = rays(batch, 0, np.zeros(64), np.arange(64))
    x = (origin - directions * (origin[2] / directions[:, 2:]))[:, 0]  # m, of the columns on the ground
    half_width = height * np.tan(np.radians(size_deg / 2))
    s = np.clip(x / half_width, -1, 1)
    expected = 0.5 + (s * np.sqrt(1 - s * s) + np.arcsin(s)) / np.pi  # the part of a disc on one side of a line
    assert np.abs(seen.mean(axis=0) - expected).max() < 0.03  # 0.5 / sqrt(96 * 16) = 0.013 for random points
    partly = ((seen > 0) & (seen < 1)).any(axis=0)
    assert abs(partly.sum() - 2 * half_width / abs(x[1] - x[0])) <= 2
    assert (seen[:, x < -half_width - 0.02] == 0).all() and (seen[:, x > half_width + 0.02] == 1).all()


def lit_world(name: str) -> flockstep.World:
    """A world with all kinds of solids and a lamp, the same in fog, or one of many triangles with textures."""
    if name not in ("solids", "fog"):
        return flockstep.World.load(name)
    lamp = {"base_color": [0.4, 0.1, 0.1], "emissive": [0.2, 0, 0]}
    fog = {"light": {"fog_visibility_m": 9}} if name == "fog" else {}
    return flockstep.World.from_dict({**ROUND, "materials": {**ROUND["materials"], "red": lamp}, **fog})


@pytest.mark.parametrize("name", ["solids", "fog", "indoor/office", "outdoor/forest"])
def test_a_tiny_sun_gives_hard_shadows(name: str) -> None:
    """The kernels for soft light compute what the others look up."""
    world, rng = lit_world(name), np.random.default_rng(3)
    low, high = np.asarray(world.bounds, float)
    places, quats = rng.uniform(low + 0.3, high - 0.3, (12, 3)), rng.normal(size=(12, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    pyramid = world_of(materials=ROUND["materials"], meshes=ROUND["meshes"])
    images = []
    for size in (0, 1e-4):
        camera = flockstep.CameraConfig(width_px=48, height_px=36, shadows=True, sun_size_deg=size)
        batch = placed([world], places, quats, cameras=[camera], max_bodies=1)
        batch.bodies.spawn(flockstep.BodyConfig(shape="mesh", mesh=pyramid, position_m=places[0] + [1, 0, 0]))
        batch.capture()
        images.append(batch.camera().rgb.astype(int))
    assert images[0].std() > 10
    assert (np.abs(images[0] - images[1]) <= 1).mean() > 0.998  # all but edges of shadows


def test_is_bit_identical_for_any_threads_and_leaves_other_outputs() -> None:
    world = flockstep.World.from_dict(ROUND)
    places = np.random.default_rng(1).uniform([-1, -1, 1], [1, 1, 3], (5, 3))
    outputs = ("rgb", "depth", "semantic", "instance", "normal", "grey")

    def taken(threads: int, chosen: slice = slice(None), **fields: Any) -> dict[str, npt.NDArray[Any]]:
        camera = flockstep.CameraConfig(width_px=70, height_px=40, outputs=outputs, samples_per_pixel=4, **fields)
        batch = placed([world], places[chosen], cameras=[camera], num_threads=threads)
        batch.capture()
        return {output: getattr(batch.camera(), output).copy() for output in outputs}

    soft, hard = taken(1, **SOFT), taken(1, shadows=True)
    for output, image in taken(4, **SOFT).items():
        np.testing.assert_array_equal(image, soft[output])
    for output, image in taken(2, slice(3, 4), **SOFT).items():
        np.testing.assert_array_equal(image[0], soft[output][3])
    for output in outputs:
        same = (soft[output] == hard[output]).all()
        assert same == (output not in ("rgb", "grey")), output
    assert soft["rgb"].mean() < hard["rgb"].mean()


def test_adaptive_samples_are_those_of_all_pixels() -> None:
    world = flockstep.World.from_dict(ROUND)

    def taken(**fields: Any) -> npt.NDArray[np.uint8]:
        camera = flockstep.CameraConfig(width_px=64, height_px=48, **SOFT, **fields)
        batch = placed([world], [-1, -1, 2], [facing([-1, -1, 2], [2, 2, 0])], cameras=[camera])
        batch.capture()
        rgb: npt.NDArray[np.uint8] = batch.camera().rgb[0].copy()
        return rgb

    single, every = taken(), taken(samples_per_pixel=9)
    adaptive = taken(samples_per_pixel=9, adaptive_samples=True)
    refined = (adaptive == every).all(axis=-1)
    assert (refined | (adaptive == single).all(axis=-1)).all()
    assert 0.2 < refined.mean() < 1


@pytest.mark.parametrize("field", ["sun_size_deg", "ambient_occlusion_rays"])
def test_gl_refuses(field: str) -> None:
    fields: dict[str, Any] = {field: 2}
    camera = flockstep.CameraConfig(shadows=True, **fields)
    with refused(ValueError, field, "gl"):
        flockstep.Batch([flockstep.World.from_dict(ROUND)], cameras=[camera], camera_backend="gl")
