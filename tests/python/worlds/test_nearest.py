"""World.nearest against closed forms of shapes and a search of all triangles."""

import numpy as np
import pytest
import trimesh
from conftest import world_of
from messages import refused

import flockstep

REACH = 30.0  # m, beyond which no point is drawn


def rotation(quat):
    w, x, y, z = quat
    return trimesh.transformations.quaternion_matrix([w, x, y, z])[:3, :3]


def distance_to(primitive, points):
    """Return the distances (K,) to a primitive: 0 inside a solid or outside a room."""
    local = (points - primitive["center"]) @ rotation(primitive["quat_wxyz"])
    half, across = np.asarray(primitive["half_extents"], float), np.linalg.norm(local[:, :2], axis=1)
    kind = primitive["kind"]
    if kind == "room":
        return (half - np.abs(local)).min(axis=1).clip(0)
    if kind == "sphere":
        return (np.linalg.norm(local, axis=1) - half[0]).clip(0)
    if kind == "capsule":
        middle = half[2] - half[0]
        return (np.hypot(across, (np.abs(local[:, 2]) - middle).clip(0)) - half[0]).clip(0)
    if kind in ("cylinder", "disc"):
        return np.hypot((across - half[0]).clip(0), (np.abs(local[:, 2]) - half[2]).clip(0))
    return np.linalg.norm((np.abs(local) - half).clip(0), axis=1)


def check(world, count=10_000, few=100):
    """Compare random points with all primitives, and a few of them with all triangles."""
    rng, solid = np.random.default_rng(7), world.objects()["solid"]
    low, high = world.bounds.clip(-REACH, REACH)
    points = rng.uniform(low - 1, high + 1, (count, 3)).astype(np.float32)
    found, distances, objects = world.nearest(points)
    assert (found.dtype, distances.dtype, objects.dtype) == (np.float32, np.float32, np.int32)
    assert solid[objects].all()
    primitives = [(i, p) for i, p in enumerate(world.primitives) if p["solid"]]
    shapes = [distance_to(p, points) for _, p in primitives]
    expected = np.min([np.full(count, np.inf), *shapes], axis=0)
    mesh = world.mesh()
    is_mesh = (mesh["objects"] >= len(world.primitives)) & solid[mesh["objects"]]
    if is_mesh.any():
        triangles = trimesh.Trimesh(mesh["vertices"].astype(float), mesh["triangles"][is_mesh], process=False)
        _, by_triangles, _ = trimesh.proximity.closest_point_naive(triangles, points[:few])
        points, found, distances, objects = points[:few], found[:few], distances[:few], objects[:few]
        expected = np.minimum(expected[:few], by_triangles)
        for number in set(objects[objects >= len(world.primitives)].tolist()):  # the point is on its object
            part = triangles.submesh([mesh["objects"][is_mesh] == number], append=True)
            _, zeros, _ = trimesh.proximity.closest_point_naive(part, found[objects == number])
            np.testing.assert_allclose(zeros, 0, atol=1e-5)
    np.testing.assert_allclose(distances, expected, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found - points, axis=1), distances, rtol=1e-6, atol=1e-5)
    for number, primitive in primitives:
        np.testing.assert_allclose(distance_to(primitive, found[objects == number].astype(float)), 0, atol=1e-5)
    again, zeros, _ = world.nearest(found)
    np.testing.assert_allclose(zeros, 0, atol=1e-5)
    np.testing.assert_allclose(again, found, atol=1e-5)
    return set(objects.tolist())


def test_shapes_of_every_kind_in_any_orientation():
    rng = np.random.default_rng(2)

    def placed():
        quat = rng.normal(size=4)
        return {"center": rng.uniform(-6, 6, 3).tolist(), "quat_wxyz": (quat / np.linalg.norm(quat)).tolist()}

    world = world_of(
        room={"min": [-10, -9, -8], "max": [10, 9, 8]},
        boxes=[{"size": rng.uniform(0.2, 3, 3).tolist(), **placed()} for _ in range(9)],
        spheres=[{"center": placed()["center"], "radius": 0.7} for _ in range(9)],
        cylinders=[{"radius": 0.5, "height": 2.0, **placed()} for _ in range(9)],
        capsules=[{"radius": 0.4, "height": 2.5, **placed()} for _ in range(9)],
    )
    assert check(world) == set(range(37))


@pytest.mark.parametrize("name", ["train", "arena/hall", "office/seed-1", "forest/seed-1", "city/seed-1"])
def test_bundled_worlds(name):
    for world in flockstep.scenes.load(name)[:2]:
        check(world)


def test_meshes_and_what_drones_do_not_hit():
    builder = flockstep.WorldBuilder("hills")
    grey = builder.material("grey")
    heights = np.random.default_rng(3).uniform(0, 2, (40, 30))
    builder.heightfield(heights, grey, corner=(-20, -15), cell_m=1.0)
    ball = trimesh.creation.icosphere(3, 1.5)
    builder.mesh(ball.vertices + np.array([0, 0, 6]), ball.faces, grey)
    builder.mesh(ball.vertices + np.array([0, 0, 9]), ball.faces, grey, solid=False)
    builder.mesh(ball.vertices + np.array([5, 0, 9]), ball.faces, grey, visible=False)
    world = builder.build()
    assert check(world) == {0, 1, 3}


def test_a_point_far_away_and_no_points():
    world = world_of(spheres=[{"center": [0, 0, 0], "radius": 1.0}])
    points, distances, objects = world.nearest([[9e5, 0, 0], [0, 0, 0.5]])
    np.testing.assert_allclose(points, [[1, 0, 0], [0, 0, 0.5]], atol=1e-6)
    np.testing.assert_allclose(distances, [9e5 - 1, 0])
    assert objects.tolist() == [0, 0]
    assert [part.shape for part in world.nearest(np.zeros((0, 3)))] == [(0, 3), (0,), (0,)]


def test_refusals(room):
    for points, values in (
        (np.zeros((2, 2)), ["(2, 2)"]),
        (np.zeros(3), ["(3,)"]),
        (None, ["None"]),
        ([[0, 0, np.nan]], ["row 0"]),
        ([[0, 0, 0], [0, 2e6, 0]], ["row 1"]),
    ):
        with refused(ValueError, "points", *values):
            room.nearest(points)
