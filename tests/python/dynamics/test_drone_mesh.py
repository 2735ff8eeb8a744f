"""A drone's visual mesh: loading, simplification, colours, and the hull for collisions."""

import copy
import itertools
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import PIL.Image
import pytest
import trimesh
from messages import refused
from scipy.spatial import ConvexHull, cKDTree

import flockstep
from flockstep.hull_simplify import simplified_hull, thickness

MODELS = Path("/usr/share/assimp/models")  # from Debian's package assimp-testmodels
HALF = np.array([0.26, 0.26, 0.07])  # half size of the bumpy body
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def write_ply(path, vertices, triangles, colors=None):
    """Write a binary PLY file; colours are sRGB levels."""
    trimesh.Trimesh(vertices, triangles, vertex_colors=colors, process=False).export(path)
    return path


def grid(rows, columns, around=False):
    """Triangles of a grid of vertices; with ``around`` the last column joins the first."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if around else columns - 1), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    return np.concatenate(
        [np.stack([a, a + columns, b], -1).reshape(-1, 3), np.stack([b, a + columns, b + columns], -1).reshape(-1, 3)]
    )


def radius(around, down):
    """Radius of the bumpy body relative to its half size: four arms and a rough skin."""
    return 1 + 0.35 * np.cos(4 * around) * np.sin(down) ** 2 + 0.01 * np.sin(40 * around) * np.sin(30 * down)


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory):
    """A file of about 144,000 triangles, red in front and blue behind, its vertices, and its simplified mesh."""
    n = 268
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(0, np.pi, n + 2)[1:-1])
    unit = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=-1)
    vertices = (HALF * radius(around, down)[..., None] * unit).reshape(-1, 3).astype(np.float32)
    colors = np.where(vertices[:, :1] > 0, [[255, 0, 0]], [[0, 0, 255]])
    path = write_ply(tmp_path_factory.mktemp("mesh") / "bumpy.ply", vertices, grid(n, n, around=True), colors)
    return path, vertices, flockstep.DroneMesh.load(path, triangles=5129)


def spread(vertices, triangles, count):
    """Random points spread evenly over triangles."""
    return trimesh.sample.sample_surface(trimesh.Trimesh(vertices, triangles, process=False), count, seed=0)[0]


def beyond(corners, points):
    """Maximum distance of the points outside the hull of the corners; negative if all are inside."""
    hull = ConvexHull(np.asarray(corners, float))
    return float((np.asarray(points, float) @ hull.equations[:, :3].T + hull.equations[:, 3]).max())


def test_144_000_triangles_become_5_129_and_stay_where_they_were(bumpy):
    _, vertices, mesh = bumpy
    assert mesh.triangles_in_file == 143_112
    assert 5_000 < len(mesh.triangles) <= 5_129
    assert (mesh.vertices.dtype, mesh.triangles.dtype, mesh.colors.dtype) == (np.float32, np.int32, np.float32)
    assert repr(mesh) == f"<DroneMesh 'bumpy.ply', {len(mesh.triangles):,} of 143,112 triangles, 0.70 x 0.70 x 0.14 m>"
    # Maximum and mean deviation from the formula of the body.
    points = spread(mesh.vertices, mesh.triangles, 100_000) / HALF
    distance = np.linalg.norm(points, axis=1)
    expected = radius(np.arctan2(points[:, 1], points[:, 0]), np.arccos(points[:, 2] / distance))
    # The formula does not describe the small holes at the body's poles.
    off = HALF[0] * np.abs(distance - expected)[np.hypot(points[:, 0], points[:, 1]) > 0.05]
    assert off.max() < 6e-3
    assert off.mean() < 1e-3
    # No part of the file is far from the simplified mesh.
    assert cKDTree(points * HALF).query(vertices)[0].max() < 5e-3


def test_colours_outlive_simplification(bumpy):
    *_, mesh = bumpy
    x = mesh.vertices[mesh.triangles][:, :, 0]
    front, rear = mesh.colors[(x > 0.01).all(axis=1)], mesh.colors[(x < -0.01).all(axis=1)]  # not across
    assert min(len(front), len(rear)) > 1_500
    assert (front == RED).all()
    assert (rear == BLUE).all()


def test_the_hull_of_the_file_is_within_that_of_32_corners(bumpy):
    _, vertices, mesh = bumpy
    whole = ConvexHull(vertices).volume
    for points, growth in ((32, 1.15), (16, 1.3), (8, 1.8), (4, 5.0)):
        hull = mesh.hull(points)
        assert hull.dtype == np.float32
        assert 4 <= len(hull) <= points
        assert beyond(hull, vertices) <= 0  # exact, even with rounding
        assert ConvexHull(hull).volume < growth * whole
    np.testing.assert_array_equal(flockstep.DroneModel(mesh.hull()).hull, mesh.hull())


def points_of(shape, count):
    rng = np.random.default_rng(1)
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    faces = rng.uniform(-1, 1, (count, 3))
    faces[np.arange(count), rng.integers(0, 3, count)] = 1
    faces[:8] = list(itertools.product((-1, 1), repeat=3))
    rim = ball[:, :2] / np.linalg.norm(ball[:, :2], axis=1, keepdims=True)
    return {
        "ball": ball,
        "disc": ball * [1, 1, 1e-3],
        "needle": ball * [1, 1e-3, 1e-3],
        "far": 0.1 * ball + [90, -90, 90],  # float32 is coarse here
        "cloud": np.random.default_rng(2).normal(size=(count, 3)),
        "cylinder": np.column_stack([rim, 0.2 * (ball[:, 2] > 0)]),
        "box": faces,
    }[shape].astype(np.float32)


@pytest.mark.parametrize(
    ("shape", "most", "count"),
    [
        *itertools.product(("ball", "disc", "needle", "far", "cylinder"), (32, 12, 8, 4), (600,)),
        *itertools.product(("cloud",), (32, 12, 8, 4), (3000,)),
        *itertools.product(("ball", "disc", "far", "box", "cloud"), (32,), (6000,)),
    ],
)
def test_few_corners_hold_all_points_and_little_else(shape, most, count, monkeypatch):
    monkeypatch.setattr("flockstep.hull_simplify._MANY", 4000)  # from where another way is taken
    points = points_of(shape, count)
    corners = simplified_hull(points, most)
    assert len(corners) <= most
    assert beyond(corners, points) <= 0
    growth = ConvexHull(corners.astype(float)).volume / ConvexHull(points.astype(float)).volume
    assert growth < (1.0001 if shape == "box" else {32: 1.15, 12: 1.5, 8: 2.2, 4: 8.0}[most])
    if shape == "box":
        assert {*map(tuple, corners.tolist())} == {*map(tuple, points[:8].tolist())}
    assert thickness(points, 1e-4) >= 1e-4
    thick = {"disc": 2e-3, "needle": 2e-3, "far": 0.2, "cylinder": 0.2}.get(shape, 2.0)
    assert shape == "cloud" or thickness(points, 9.0) == pytest.approx(thick, rel=0.05)


HULL_OF_A_BALL = """
import re, sys, time, numpy as np, flockstep
def memory(what): return 1024 * int(re.search(what + r":\\s+(\\d+)", open("/proc/self/status").read())[1])
n = int(sys.argv[1])
i = np.arange(n) + 0.5
z, around = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
ball = np.stack([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z], axis=1)
mesh = flockstep.DroneMesh(0.3 * ball, np.stack([np.arange(n - 2), np.arange(n - 2) + 1, np.arange(n - 2) + 2], axis=1))
flockstep.DroneMesh(ball[::100], [[0, 1, 2]]).hull(4)  # imports SciPy
before = memory("VmRSS")
corners = mesh.hull()
print(memory("VmHWM") - before)
np.save(sys.argv[2], corners)
"""


def test_the_hull_of_many_vertices_needs_little_memory(tmp_path):
    """Every vertex is a corner of the convex hull: a table of corners and faces would take 54 GiB."""
    program = [sys.executable, "-c", HULL_OF_A_BALL, "60000", str(tmp_path / "hull.npy")]
    assert int(subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True).stdout) < 200e6
    corners = np.load(tmp_path / "hull.npy")
    assert len(corners) <= 32
    assert ConvexHull(corners).volume < 1.13 * 4 / 3 * np.pi * 0.3**3


BOX = np.array(list(itertools.product((-0.3, 0.1), (-0.2, 0.2), (0, 0.1))), np.float32)
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def write_box(path, rows=()):
    lines = [*rows, *(f"v {x} {y} {z}" for x, y, z in BOX)]
    path.write_text("\n".join([*lines, *(f"f {' '.join(str(i + 1) for i in face)}" for face in FACES)]) + "\n")
    return path


def test_a_box_stays_as_it_is(tmp_path):
    mesh = flockstep.DroneMesh.load(write_box(tmp_path / "box.obj"))
    assert repr(mesh) == "<DroneMesh 'box.obj', 12 triangles, 0.40 x 0.40 x 0.10 m>"
    np.testing.assert_array_equal(mesh.vertices, BOX)
    assert mesh.triangles_in_file == len(mesh.triangles) == 12
    assert {tuple(corner) for corner in mesh.hull().tolist()} == {tuple(corner) for corner in BOX.tolist()}
    np.testing.assert_allclose(mesh.colors, 0.8, atol=1e-6)
    with refused(ValueError, "read-only"):
        mesh.vertices[0] = 0


def test_places_are_those_of_world_load(tmp_path):
    path = write_box(tmp_path / "box.obj")
    placed = {"scale": 2.0, "up": "y", "origin": (1.0, 2.0, 3.0)}
    mesh, world = flockstep.DroneMesh.load(path, **placed), flockstep.World.load(path, **placed)
    np.testing.assert_array_equal(mesh.vertices, world.mesh()["vertices"])
    turned = flockstep.DroneMesh.load(path, **placed, yaw_deg=90)
    x, y, z = (mesh.vertices - [1, 2, 3]).T
    np.testing.assert_allclose(turned.vertices - [1, 2, 3], np.stack([-y, x, z], axis=1), atol=1e-6)
    # +z of a glTF file is -y here, and forward with yaw_deg=90.
    builder = flockstep.WorldBuilder()
    builder.mesh([[0, -1, 0], [0.1, 0, 0], [0, 0, 0.1]], [[0, 1, 2]], builder.material("nose"))
    builder.build().save(tmp_path / "nose.glb")
    nose = flockstep.DroneMesh.load(tmp_path / "nose.glb", yaw_deg=90)
    np.testing.assert_allclose(nose.vertices[np.abs(nose.vertices).max(axis=1).argmax()], [1, 0, 0], atol=1e-6)


def test_a_texture_gives_each_triangle_its_mean_colour(tmp_path):
    """The left half of the image is red, the right half has white and black rows; outside it repeats."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, :32] = [255, 0, 0]
    image[::2, 32:] = 255
    PIL.Image.fromarray(image).save(tmp_path / "paint.png")
    (tmp_path / "a.mtl").write_text("newmtl paint\nKd 0.5 0.5 0.5\nmap_Kd paint.png\n")
    places = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"]
    uv = [
        f"vt {u} {v}"
        for left, right in ((2.01, 2.49), (0.51, 0.99))
        for u, v in itertools.product((left, right), (0, 1))
    ]
    faces = ["f 1/1 2/3 3/4", "f 1/5 3/8 4/6"]
    (tmp_path / "a.obj").write_text("\n".join(["mtllib a.mtl", *places, *uv, "usemtl paint", *faces]) + "\n")
    mesh = flockstep.DroneMesh.load(tmp_path / "a.obj")
    np.testing.assert_allclose(mesh.colors, [[0.5, 0, 0], [0.25, 0.25, 0.25]], atol=0.01)


def test_colours_of_vertices_materials_and_what_glows_and_what_is_hidden(tmp_path):
    builder = flockstep.WorldBuilder()
    white, lamp = builder.material("white"), builder.material("lamp", (0, 0, 0), emissive=(0.2, 0.4, 9))
    green = builder.material("green", (0, 0.5, 0))
    builder.box((0, 0, 5), (1, 1, 1), green)
    triangle = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    builder.mesh(triangle, [[0, 1, 2]], white, colors=np.eye(3))
    builder.mesh(triangle, [[0, 1, 2]], lamp)
    builder.mesh(np.array(triangle) * 9, [[0, 1, 2]], green, visible=False)
    builder.build().save(tmp_path / "parts.glb")
    mesh = flockstep.DroneMesh.load(tmp_path / "parts.glb", up="y")
    assert len(mesh.triangles) == 14
    assert np.abs(mesh.vertices[:, :2]).max() == 1
    np.testing.assert_allclose(mesh.colors[:12], np.tile([0, 0.5, 0], (12, 1)), atol=1e-6)
    np.testing.assert_allclose(mesh.colors[12:], [[1 / 3] * 3, [0.2, 0.4, 1]], atol=2e-3)


def test_a_thin_plate_keeps_its_two_colours(tmp_path):
    """Red above and blue below, two millimetres apart: after simplification neither side has the other's colour."""
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 80), np.linspace(-0.2, 0.2, 80))
    waves = 0.01 * np.sin(20 * x) * np.cos(15 * y)
    top, bottom = (np.stack([x, y, waves + z], axis=-1).reshape(-1, 3) for z in (0.001, -0.001))
    colors = np.repeat([[255, 0, 0], [0, 0, 255]], len(top), axis=0)
    faces = grid(80, 80)
    triangles = np.concatenate([faces[:, ::-1], faces + len(top)])
    path = write_ply(tmp_path / "plate.ply", np.concatenate([top, bottom]), triangles, colors)
    mesh = flockstep.DroneMesh.load(path, triangles=3000)
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    up = np.cross(b - a, c - a)[:, 2] > 0
    assert 1000 < len(mesh.triangles) <= 3000
    np.testing.assert_array_equal(mesh.colors, np.where(up[:, None], RED, BLUE))


def test_flat_sheets_do_not_vanish_and_have_no_hull(tmp_path):
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 50), np.linspace(-0.2, 0.2, 50))
    sheet = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    path = write_ply(tmp_path / "sheet.ply", sheet, grid(50, 50))
    mesh = flockstep.DroneMesh.load(path, triangles=300)
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(0.24, rel=0.02)
    for flat in (mesh, flockstep.DroneMesh.load(path)):
        with refused(ValueError, "sheet.ply", "0.0001", "one of 0 m"):
            flat.hull()
    thin = flockstep.DroneMesh(BOX * [1, 1, 5e-4], [[0, 1, 3], [4, 6, 7], [5, 2, 0]])
    with refused(ValueError, "<DroneMesh", "0.0001 m", "5e-05 m"):
        thin.hull()


def test_sheets_with_many_borders_leave_something_for_the_rest(tmp_path):
    """Eight finely meshed blades and four plain arms: 2,000 of 17,000 triangles remain, also for the arms."""
    length, width = np.meshgrid(np.linspace(0.02, 0.12, 96), np.linspace(-0.01, 0.01, 12), indexing="ij")
    hubs = 0.25 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    vertices, triangles = [], []
    for hub, side in itertools.product(hubs, (-1, 1)):
        triangles.append(grid(96, 12) + sum(map(len, vertices)))
        vertices.append(hub + np.stack([side * length, width, 0.02 + 0.3 * width], axis=-1).reshape(-1, 3))
    arms = []
    for hub in hubs:
        across = 0.01 * np.array([-hub[1], hub[0], 0]) / np.linalg.norm(hub)
        ends = [end + s * across + [0, 0, z] for end in (0 * hub, hub) for s in (-1, 1) for z in (-0.01, 0.01)]
        triangles.append(
            np.array([t for a, b, c, d in FACES for t in ((a, b, c), (a, c, d))]) + sum(map(len, vertices))
        )
        vertices.append(np.array(ends))
        arms.append(np.linspace(vertices[-1][::2], vertices[-1][1::2], 9).reshape(-1, 3))
    path = write_ply(tmp_path / "quad.ply", np.concatenate(vertices), np.concatenate(triangles))
    mesh = flockstep.DroneMesh.load(path, triangles=2000)
    assert mesh.triangles_in_file > 8 * len(mesh.triangles)
    left = cKDTree(spread(mesh.vertices, mesh.triangles, 50_000))
    for part in (*arms, *vertices):
        assert left.query(part)[0].max() < 0.02 * 0.7


def test_many_loose_parts_are_simplified_too(tmp_path):
    """Simplify three hundred tetrahedra to 200 triangles, fewer than one per tetrahedron."""
    rng = np.random.default_rng(0)
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    vertices = np.concatenate([0.02 * corner + place for place in rng.uniform(-0.5, 0.5, (300, 3))])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    triangles = np.concatenate([faces + 4 * i for i in range(300)])
    mesh = flockstep.DroneMesh.load(write_ply(tmp_path / "dust.ply", vertices, triangles), triangles=200)
    assert 0 < len(mesh.triangles) <= 200
    assert beyond(mesh.hull(), vertices) <= 1e-7  # float32 in the file


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"triangles": 3}, ("triangles", 4, 3)),
        ({"triangles": 5e3}, ("triangles", 4, "5000.0")),
        ({"triangles": True}, ("triangles", 4, "True")),
        ({"yaw_deg": np.nan}, ("yaw_deg", "nan")),
        ({"yaw_deg": "left"}, ("yaw_deg", "left")),
        ({"scale": 0}, ("scale",)),
        ({"up": "x"}, ("up", "y", "z", "x")),
        ({"origin": (1e9, 0, 0)}, ("origin",)),
    ],
)
def test_arguments_that_make_no_sense(tmp_path, keywords, message):
    with refused(ValueError, *message):
        flockstep.DroneMesh.load(write_box(tmp_path / "box.obj"), **keywords)


def test_invalid_files(tmp_path):
    with refused(ValueError, "path", "indoor/office"):
        flockstep.DroneMesh.load("indoor/office")
    with refused(FileNotFoundError, "nowhere.glb"):
        flockstep.DroneMesh.load(tmp_path / "nowhere.glb")
    (tmp_path / "broken.ply").write_text("ply\n")
    with refused(ValueError, "broken.ply"):
        flockstep.DroneMesh.load(tmp_path / "broken.ply")
    with refused(ValueError, "points", 4, 32, 33):
        flockstep.DroneMesh.load(write_box(tmp_path / "box.obj")).hull(33)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0]], [[0, 0, 0]]), ("vertices", 3, 1, 2)),
        (([[0, 0, np.inf]], [[0, 0, 0]]), ("vertices",)),
        ((BOX, np.zeros((0, 3), int)), ("triangles", 3, 0)),
        ((BOX, [[0, 1, 2.0]]), ("triangles",)),
        ((BOX, [[0, 1, 8]]), ("triangles", 8)),
        ((BOX, [[0, 1, -1]]), ("triangles", 8, -1)),
        ((BOX, [[0, 1, 2]], [[1, 1]]), ("colors", 1, 3, 2)),
        ((BOX, [[0, 1, 2]], [0, 0, 255]), ("colors", 0, 1)),
        ((BOX, [[0, 1, 2]], [0, 0, np.nan]), ("colors", 0, 1)),
    ],
)
def test_invalid_arrays(arguments, message):
    with refused(ValueError, *message):
        flockstep.DroneMesh(*arguments)


def test_without_the_extra_it_says_what_to_install(bumpy, tmp_path, monkeypatch):
    path, _, mesh = bumpy
    advice = "pip install 'flockstep[mesh]'"
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    with refused(ModuleNotFoundError, "DroneMesh.load", "fast-simplification", advice):
        flockstep.DroneMesh.load(path)
    flockstep.DroneMesh.load(write_box(tmp_path / "box.obj"))  # requires none of them
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    with refused(ModuleNotFoundError, "DroneMesh.hull", "scipy", advice):
        mesh.hull()


def test_envs_accept_copy_pickle_and_describe_it(bumpy, room):
    *_, mesh = bumpy
    small = flockstep.DroneMesh(BOX, [[0, 1, 3], [4, 6, 7]], [0.1, 0.7, 0.3], "small")
    small.triangles_in_file = 7
    keywords = {"worlds": room, "render_mode": "rgb_array", "render_view": "fleet", "render_size": (80, 60)}
    envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", 2, drone_mesh=small, **keywords)
    spec = gymnasium.envs.registration.EnvSpec.from_json(envs.unwrapped.spec.to_json())
    plain = flockstep.DroneVectorEnv(2, **keywords)
    pictures = []
    for made in (envs, gymnasium.make_vec(spec), copy.deepcopy(envs), pickle.loads(pickle.dumps(envs)), plain):
        made.reset(seed=3)
        pictures.append(made.render()[0])
    for picture in pictures[1:4]:
        np.testing.assert_array_equal(picture, pictures[0])
    assert (pictures[0] != pictures[4]).any()
    again = flockstep.DroneMesh.from_dict(mesh.to_dict())
    assert repr(again) == repr(mesh)
    for name in ("vertices", "triangles", "colors"):
        np.testing.assert_array_equal(getattr(again, name), getattr(mesh, name))
    np.testing.assert_array_equal(again.hull(), mesh.hull())
    with refused(TypeError, "drone_mesh", "drone.glb"):
        flockstep.DroneVectorEnv(1, worlds=room, drone_mesh="drone.glb")


@pytest.mark.skipif(not MODELS.exists(), reason="Debian's package assimp-testmodels is not installed")
@pytest.mark.parametrize(
    ("name", "scale", "triangles", "count"),
    [
        ("glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb", 1e-3, 5129, 110_336),
        ("OBJ/spider.obj", 1e-2, 500, 1_312),
        ("glTF2/BoxTextured-glTF-Binary/BoxTextured.glb", 1.0, 5000, 12),
        ("PLY/cube.ply", 1.0, 5000, 12),
    ],
)
@pytest.mark.filterwarnings("ignore:.*ignored:UserWarning")
def test_files_of_others(name, scale, triangles, count):
    mesh = flockstep.DroneMesh.load(MODELS / name, scale=scale, triangles=triangles)
    assert mesh.triangles_in_file == count
    assert min(triangles, count) - 10 <= len(mesh.triangles) <= triangles
    whole = flockstep.World.load(MODELS / name, scale=scale).mesh()
    size = float(np.ptp(whole["vertices"], axis=0).max())
    before, after = (
        spread(vertices, faces, 100_000)
        for vertices, faces in ((whole["vertices"], whole["triangles"]), (mesh.vertices, mesh.triangles))
    )
    for points, others in ((before, after), (after, before)):
        apart = cKDTree(points).query(others)[0]
        assert apart.mean() < 0.01 * size
        assert apart.max() < 0.08 * size
    assert beyond(mesh.hull(), whole["vertices"]) <= 1e-7 * size
    assert 0.005 < mesh.colors.mean() < 1
