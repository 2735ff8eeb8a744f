"""Drones in pictures."""

import numpy as np
import pytest

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.stage import Stage

BOX = [[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1)]


def pictured(drone, mesh=None, **how):
    """The picture of a drone from above, and its pixels."""
    room = flockstep.World.from_dict(
        {"flockstep_scene": 1, "name": "room", "room": {"min": [-5, -5, -5], "max": [5, 5, 5]}}
    )
    stage = Stage(room, 1.0, (320, 240))
    canvas = stage.seen_from(np.array([0.0, 0.0, 2.0]), np.zeros(3))
    before = canvas.rgb.copy()
    Body(drone, mesh).draw(canvas, np.zeros(3), np.array([1.0, 0, 0, 0]), **how)
    return canvas, (canvas.rgb != before).any(axis=-1)


def assert_solid(parts):
    """Assert that each part is a body: its normals are unit, its corners are inside, and every face touches some."""
    for part in parts:
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1)
        beyond = part.normals @ part.corners.T - part.offsets[:, None]
        np.testing.assert_allclose(beyond.max(axis=1), 0, atol=1e-12)


@pytest.mark.parametrize("name", flockstep.DroneModel.names())
def test_a_drone_is_drawn_as_large_as_it_is(name):
    drone = flockstep.DroneModel.load(name)
    rotors = drone.to_dict()["rotors"]
    assert rotors["radius_m"] > 0
    parts = Body(drone)._parts
    assert_solid(parts)
    corners = np.concatenate([part.corners for part in parts])
    tips = np.abs(rotors["position_m"])[:, :2].max(axis=0) + rotors["radius_m"]
    np.testing.assert_allclose(np.abs(corners[:, :2]).max(axis=0), tips)


@pytest.mark.parametrize("radius_m", [0, 0.1])
@pytest.mark.parametrize("rear", [[[-0.2, 0, 0.05], [-0.2, 0, -0.05]], [[-0.2, 0, 0.3], [0, 0, 0.3]]])
def test_rotors_may_be_anywhere(rear, radius_m):
    """Two rotors above each other, and one high in the middle; rotors without a radius are also drawn."""
    rotors = {"position_m": [[0.2, -0.2, 0], [0.2, 0.2, 0], *rear], "spin": ["ccw", "cw"] * 2, "radius_m": radius_m}
    x500 = flockstep.DroneModel.load("x500").to_dict()
    parts = Body(flockstep.DroneModel.from_dict({**x500, "rotors": {**x500["rotors"], **rotors}}))._parts
    assert_solid(parts)
    corners = np.concatenate([part.corners for part in parts])
    reach = 0.2 + (radius_m or 0.6 * np.hypot(0.2, 0.2))
    np.testing.assert_allclose([corners[:, 0].max(), np.abs(corners[:, 1]).max()], reach)
    middle = parts[0].corners
    assert middle[:, 2].min() <= min(z for _, _, z in rotors["position_m"])
    assert middle[:, 2].max() >= max(z for _, _, z in rotors["position_m"])


@pytest.mark.parametrize("pale", [False, True])
def test_rotors_are_discs_at_their_places_the_front_ones_orange(pale):
    drone = flockstep.DroneModel.load("x500")
    canvas, seen = pictured(drone, pale=pale)
    for hub in drone.to_dict()["rotors"]["position_m"]:
        ((x, y, _),) = canvas.project(np.array([hub]) * [1.5, 1.5, 1]).astype(int)  # beside the hub
        red, _, blue = canvas.rgb[y, x].astype(int)
        assert seen[y, x]
        assert (red > blue) == (hub[0] > 0)
    assert not seen[0].any()


def test_without_rotors_a_drone_is_its_hull_with_edges():
    canvas, seen = pictured(flockstep.DroneModel(BOX))
    ((left, top, _), (right, bottom, _)) = canvas.project(np.array([[0.3, 0.2, 0.1], [-0.3, -0.2, 0.1]]))
    rows, columns = np.nonzero(seen)
    found = sorted([columns.min(), columns.max()]) + sorted([rows.min(), rows.max()])
    expected = sorted([left, right]) + sorted([top, bottom])
    np.testing.assert_allclose(found, expected, atol=2)
    colors = {tuple(color) for color in canvas.rgb[seen]}
    assert (20, 40, 110) in colors


def test_a_mesh_is_drawn_in_its_colours_instead():
    """A pyramid seen from above: its four sides in their colours, paler as another drone, and nothing else."""
    corners = [[0.4, 0.3, 0], [-0.4, 0.3, 0], [-0.4, -0.3, 0], [0.4, -0.3, 0], [0, 0, 0.2]]
    sides = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    colors = np.array([[0.8, 0, 0], [0, 0.8, 0], [0, 0, 0.8], [0.7, 0.7, 0]])
    mesh = flockstep.DroneMesh(corners, sides, colors)
    drone = flockstep.DroneModel.load("crazyflie")
    canvas, seen = pictured(drone, mesh)
    paler, seen_pale = pictured(drone, mesh, pale=True)
    np.testing.assert_array_equal(seen, seen_pale)
    rim = canvas.project(np.array(corners[:4]))[:, :2]
    area = np.prod(np.ptp(rim, axis=0))
    assert seen.sum() == pytest.approx(area, rel=0.02)
    rows, columns = np.nonzero(seen)
    np.testing.assert_allclose([columns.min(), rows.min()], rim.min(axis=0), atol=1)
    np.testing.assert_allclose([columns.max() + 1, rows.max() + 1], rim.max(axis=0), atol=1)
    for (i, j, k), color in zip(sides, colors, strict=True):
        ((x, y, depth),) = canvas.project(np.mean([corners[i], corners[j], corners[k]], axis=0)[None])
        shown, pale = canvas.rgb[int(y), int(x)].astype(int), paler.rgb[int(y), int(x)].astype(int)
        assert canvas.depth[int(y), int(x)] == pytest.approx(depth, abs=0.01)
        assert (shown > 100).tolist() == (color > 0).tolist()
        assert np.ptp(pale) < np.ptp(shown)
        assert pale.min() > shown.min()
