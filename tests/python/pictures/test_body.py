"""Drones in pictures."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from scipy.spatial import ConvexHull

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.stage import Stage, light_rims

BOX = [[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1)]


def pictured(drone, mesh=None, **how):
    """The picture of a drone from above, and its pixels, without its shadow."""
    room = world_of(name="room", room={"min": [-5, -5, -5], "max": [5, 5, 5]})
    stage, view = Stage(room, 1.0, (320, 240)), (np.array([0.0, 0.0, 2.0]), np.zeros(3))
    canvas = stage.seen_from(*view, [Body(drone, mesh).at(np.zeros(3), np.array([1.0, 0, 0, 0]), **how)])
    return canvas, canvas.depth != stage.seen_from(*view).depth


@pytest.mark.parametrize("name", flockstep.DroneModel.names())
def test_the_hull_encloses_the_mesh_of_a_quadrotor(name):
    """The mesh fills the hull's height, and each propeller has the radius of the file and lies around its place."""
    drone = flockstep.DroneModel.load(name)
    rotors, hull = drone.to_dict()["rotors"], np.asarray(drone.hull, float)
    mesh = flockstep.DroneMesh.quadrotor(drone)
    corners = mesh.vertices.astype(float)
    planes = ConvexHull(hull).equations
    assert (corners @ planes[:, :3].T + planes[:, 3]).max() < 0
    assert np.ptp(corners[:, 2]) > 0.95 * np.ptp(hull[:, 2])
    blades = corners[np.unique(mesh.triangles[is_orange(mesh.colors)])]
    for hub in [hub for hub in rotors["position_m"] if hub[0] > 0]:
        near = blades[blades[:, 1] * hub[1] > 0] - hub
        reach = np.linalg.norm(near[:, :2], axis=1).max()
        assert reach == pytest.approx(rotors["radius_m"], rel=0.01)
        np.testing.assert_allclose(near.mean(axis=0), 0, atol=1e-3 * rotors["radius_m"])


def is_orange(colors):
    return colors[:, 0] > 2 * colors[:, 2]


@pytest.mark.parametrize("radius_m", [0, 0.1])
@pytest.mark.parametrize("rear", [[[-0.2, 0, 0.05], [-0.2, 0, -0.05]], [[-0.2, 0, 0.3], [0, 0, 0.3]]])
def test_rotors_may_be_anywhere(rear, radius_m):
    """Two rotors above each other, and one high in the middle; rotors without a radius are also drawn."""
    rotors = {"position_m": [[0.2, -0.2, 0], [0.2, 0.2, 0], *rear], "spin": ["ccw", "cw"] * 2, "radius_m": radius_m}
    x500 = flockstep.DroneModel.load("x500").to_dict()
    drone = flockstep.DroneModel.from_dict({**x500, "rotors": {**x500["rotors"], **rotors}})
    corners = flockstep.DroneMesh.quadrotor(drone).vertices
    radius = radius_m or 0.6 * np.hypot(0.2, 0.2)
    for hub in rotors["position_m"]:
        at_tips = np.abs(np.linalg.norm(corners[:, :2] - hub[:2], axis=1) - radius) < 0.01 * radius
        assert (np.abs(corners[at_tips, 2] - hub[2]) < 0.05 * radius).sum() >= 4


@pytest.mark.parametrize("pale", [False, True])
def test_the_front_propellers_are_orange(pale):
    drone = flockstep.DroneModel.load("x500")
    canvas, seen = pictured(drone, pale=pale)
    mesh = flockstep.DroneMesh.quadrotor(drone)
    tops = mesh.vertices[mesh.triangles].mean(axis=1)
    for x, y, z in drone.to_dict()["rotors"]["position_m"]:
        beside = np.linalg.norm(tops - [x, y, z], axis=1)
        place = tops[(beside > 0.05) & (beside < 0.1) & (tops[:, 2] > z)][:1]
        ((column, row, _),) = canvas.project(place).astype(int)
        red, _, blue = canvas.rgb[row, column].astype(int)
        assert seen[row, column]
        assert (red > blue) == (x > 0)
    assert not seen[0].any()


def test_a_model_without_rotors_is_refused():
    with refused(ValueError, "drone"):
        flockstep.DroneMesh.quadrotor(flockstep.DroneModel(BOX))


def test_without_rotors_a_drone_is_its_hull():
    canvas, seen = pictured(flockstep.DroneModel(BOX))
    ((left, top, _), (right, bottom, _)) = canvas.project(np.array([[0.3, 0.2, 0.1], [-0.3, -0.2, 0.1]]))
    rows, columns = np.nonzero(seen)
    found = sorted([columns.min(), columns.max()]) + sorted([rows.min(), rows.max()])
    expected = sorted([left, right]) + sorted([top, bottom])
    np.testing.assert_allclose(found, expected, atol=2)
    (color,) = {tuple(color) for color in canvas.rgb[seen]}
    assert color[2] > 1.6 * color[0]
    np.testing.assert_allclose(canvas.depth[seen], 1.9, rtol=1e-5)


def test_a_hull_is_closed_and_all_its_faces_are_outside():
    """A line from the middle leaves the default hull where a line from outside enters it."""
    drone = flockstep.DroneModel()
    shape = world_of(
        meshes=[
            {name: mesh[name].tolist() for name in ("vertices", "triangles")}
            for mesh in [Body(flockstep.DroneModel(drone.hull)).at(np.zeros(3), np.array([1.0, 0, 0, 0])).mesh.mesh()]
        ]
    )
    ways = np.random.default_rng(0).normal(size=(300, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    inner = shape.raycast(np.zeros((300, 3)), ways, 10.0)["t_hit"]
    outer = 10 - shape.raycast(10 * ways, -ways, 20.0)["t_hit"]
    assert np.isfinite(inner).all()
    np.testing.assert_allclose(inner, outer, atol=1e-4)
    assert inner.max() <= np.linalg.norm(drone.hull, axis=1).max() + 1e-6


def test_a_hull_has_the_edges_between_its_faces():
    edges = Body(flockstep.DroneModel(BOX)).edges
    assert len(edges) == 12  # of a box, without the diagonals of its faces
    assert (np.count_nonzero(edges[:, 0] != edges[:, 1], axis=1) == 1).all()
    for other in (Body(flockstep.DroneModel()), Body(flockstep.DroneModel(BOX), flockstep.DroneMesh(BOX, [[0, 1, 2]]))):
        assert len(other.edges) == 0


@pytest.mark.parametrize(("background", "is_lit"), [((30, 40, 20), True), ((160, 170, 150), False)])
def test_a_drone_has_a_rim_of_light_before_dark_surfaces(background, is_lit):
    rgb = np.full((9, 12, 3), background, np.uint8)
    is_drone = np.zeros((9, 12), bool)
    is_drone[2:7, 4:9] = True
    rgb[is_drone] = (20, 30, 90)
    before = rgb.copy()
    light_rims(rgb, is_drone)
    rim = is_drone.copy()
    rim[3:6, 5:8] = False
    np.testing.assert_array_equal((rgb > before).all(axis=-1), rim & is_lit)
    np.testing.assert_array_equal(rgb[~rim], before[~rim])
    light_rims(rgb, np.zeros((9, 12), bool))  # no drone is visible


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
