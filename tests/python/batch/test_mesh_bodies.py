"""Bodies that are meshes: sensors detect their triangles, drones hit their convex hull."""

import json
import pickle

import numpy as np
import pytest
from messages import refused
from scipy.spatial.transform import Rotation

import flockstep
from flockstep import BodyConfig, BodyMotion, CameraConfig, LidarConfig, World

ROOM = {
    "flockstep_scene": 1,
    "name": "room",
    "room": {"min": [-6, -6, 0], "max": [6, 6, 6]},
    "boxes": [{"center": [2, 2, 0.5], "size": [1, 1, 1]}],
    "markers": {"start": [-3, 0, 2]},
}
OUTPUTS = ("rgb", "depth", "semantic", "instance", "normal")


def star(rings=12, radius=0.8):
    """Return vertices, triangles and texture coordinates of a closed surface with dents."""
    down, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    across = radius * np.sin(down) * (1 + 0.3 * np.sin(5 * around) * np.sin(down))
    vertices = np.stack([across * np.cos(around), across * np.sin(around), radius * np.cos(down)], -1).reshape(-1, 3)
    uv = np.stack([around / (2 * np.pi), down / np.pi], -1).reshape(-1, 2)
    row = 2 * rings + 1
    first = (np.arange(rings)[:, None] * row + np.arange(2 * rings)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + row, first + 1], 1), np.stack([first + 1, first + row, first + row + 1], 1)]
    )
    corners = vertices[triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return vertices.astype(np.float32), triangles[areas > 1e-9], uv.astype(np.float32)  # without those at the poles


def add_star(builder, place=lambda vertices: vertices, name=""):
    """Add a textured mesh of two materials, with its vertices placed."""
    vertices, triangles, uv = star()
    placed = place(vertices).astype(np.float32)
    pixels = np.random.default_rng(5).integers(0, 256, (16, 16, 4)).astype(np.uint8)
    pixels[..., 3] = 255
    plain = builder.material(name + "plain", (0.7, 0.5, 0.3))
    fancy = builder.material(name + "fancy", (0.9, 0.8, 0.9), texture=builder.texture(name + "noise", pixels))
    half = len(triangles) // 2
    builder.mesh(placed, triangles[:half], fancy, uv)
    builder.mesh(placed, triangles[half:], plain, uv)


def star_world():
    builder = flockstep.WorldBuilder("star")
    add_star(builder)
    return builder.build()


def room_with(star=None):
    """Return a room with a textured mesh, and a further one if ``star`` has its place and rotation."""
    builder = flockstep.WorldBuilder("room")
    grey = builder.material("grey", (0.8, 0.8, 0.8))
    builder.room((-6, -6, 0), (6, 6, 6), grey)
    builder.box((2, 2, 0.5), (1, 1, 1), grey)
    builder.start((-3, 0, 2))
    add_star(builder, lambda vertices: 1.5 * vertices + [0, 0, 2], name="standing ")
    if star is not None:
        position, turn = star
        add_star(builder, lambda vertices: turn.apply(vertices.astype(float)) + position)
    return builder.build()


def room():
    return World.from_dict(ROOM)


def batch_with(bodies=(), world=None, num_drones=1, **more):
    return flockstep.Batch([world or room()], num_drones, bodies=list(bodies), **more)


def quat_of(turn):
    return turn.as_quat()[[3, 0, 1, 2]].tolist()


class TestSensors:
    @pytest.mark.parametrize("tracer", ["auto", "tiles", "slices", "embree"])
    def test_ranges_are_those_of_the_same_mesh_in_the_static_world(self, tracer):
        random = np.random.default_rng(8)
        lidars = [
            LidarConfig(name="fan", beams=36, hfov_deg=360, max_range_m=8),
            LidarConfig(name="dense", beams=200, hfov_deg=90, channels=8, vfov_deg=40, max_range_m=8),
        ]
        met = 0
        for _ in range(10):
            turn, position = Rotation.random(random_state=random), random.uniform([-2, -2, 1], [2, 2, 3])
            body = BodyConfig(shape="mesh", mesh=star_world(), position_m=position.tolist(), quat_wxyz=quat_of(turn))
            standing = batch_with(world=room_with(star=(position, turn)), num_drones=20, lidar=lidars, tracer=tracer)
            moving = batch_with([body], room_with(), num_drones=20, lidar=lidars, tracer=tracer)
            eyes = np.float32(random.uniform([-5, -5, 0.5], [5, 5, 5], (20, 3)))
            turns = np.float32([quat_of(Rotation.random(random_state=random)) for _ in eyes])
            for batch in (moving, standing):
                batch.set_pose(eyes, turns)
                batch.sense()
            for lidar in lidars:
                ours, theirs = moving.lidar(lidar.name).ranges, standing.lidar(lidar.name).ranges
                equal = np.isclose(ours, theirs, rtol=0, atol=1e-4)
                assert equal.mean() > 0.999  # others are at edges
                empty = batch_with(world=room_with(), num_drones=20, lidar=lidars, tracer=tracer)
                empty.set_pose(eyes, turns)
                empty.sense()
                met += (empty.lidar(lidar.name).ranges != ours).sum()
        assert met > 5000

    def test_a_mesh_at_the_origin_gives_the_bits_that_embree_gives_for_the_static_world(self):
        random = np.random.default_rng(9)
        lidar = LidarConfig(beams=90, hfov_deg=360, max_range_m=8)
        eyes = np.float32(random.uniform([-3, -3, -1], [3, 3, 1], (50, 3)))
        eyes[np.linalg.norm(eyes, axis=1) < 1.2] = [2, 0, 0]
        far = World.from_dict({**ROOM, "room": {"min": [-50, -50, -50], "max": [50, 50, 50]}, "boxes": []})
        # Without slices, which round otherwise: a world is seen in slices, bodies are not.
        few = {"num_drones": 50, "lidar": lidar, "tracer": "tiles"}
        standing = batch_with(world=star_world(), **few)
        moving = batch_with([BodyConfig(shape="mesh", mesh=star_world())], far, **few)
        for batch in (moving, standing):
            batch.set_pose(eyes)
            batch.sense()
        assert (moving.lidar().ranges == standing.lidar().ranges).all()
        assert np.isfinite(moving.lidar().ranges).sum() > 100


def box_world(half, random):
    """Return a box as a mesh, with further triangles inside."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = [[f[0], f[k], f[k + 1]] for f in faces for k in (1, 2)]
    inside = random.uniform(-0.99, 0.99, (600, 3)) * half
    builder = flockstep.WorldBuilder("box")
    grey = builder.material("grey")
    builder.mesh(np.float32(corners), triangles, grey)
    builder.mesh(np.float32(inside), np.arange(600).reshape(-1, 3), grey)
    return builder.build()


class TestContacts:
    def test_drones_hit_its_hull_as_a_box_of_that_size(self):
        random = np.random.default_rng(21)
        hits = 0
        for _ in range(10):
            half = random.uniform(0.1, 0.8, 3)
            pose = {
                "position_m": random.uniform([-1, -1, 2], [1, 1, 4]).tolist(),
                "quat_wxyz": quat_of(Rotation.random(random_state=random)),
                "motion": BodyMotion(
                    velocity_mps=random.uniform(-2, 2, 3).tolist(), turn_rate_dps=random.uniform(-90, 90, 3).tolist()
                ),
            }
            solid = BodyConfig(size_m=(2 * half).tolist(), **pose)
            mesh = BodyConfig(shape="mesh", mesh=box_world(half, random), **pose)
            start = np.float32(random.uniform([-4, -4, 1], [4, 4, 5], (200, 3)))
            goal = np.float32(random.uniform([-2, -2, 1], [2, 2, 5], (200, 3)))
            batches = [batch_with([body], num_drones=200) for body in (solid, mesh)]
            free = batches[0].is_free(start)
            np.testing.assert_array_equal(batches[1].is_free(start), free)
            for batch in batches:
                batch.set_pose(start)
                batch.move(goal)
            box, hull = (batch.contact for batch in batches)
            np.testing.assert_array_equal(hull.hit, box.hit)
            met = free & (box.body >= 0)
            hits += met.sum()
            np.testing.assert_array_equal(hull.body[free], box.body[free])
            np.testing.assert_allclose(batches[1].position[free], batches[0].position[free], atol=2e-5)
            np.testing.assert_allclose(hull.surface_velocity[met], box.surface_velocity[met], atol=0.05)
        assert hits > 200

    def test_visibility_of_bodies_and_of_their_objects(self):
        builder = flockstep.WorldBuilder("ghost")
        grey = builder.material("grey")
        vertices, triangles, _ = star()
        builder.mesh(vertices, triangles, grey, solid=False)
        builder.mesh([[0, 2, 0], [0.1, 2, 0], [0, 2.1, 0]], [[0, 1, 2]], grey)
        ghost = builder.build()
        for mesh, role, hit, seen in [
            (star_world(), "full", True, True),
            (star_world(), "visual", False, True),
            (star_world(), "solid", True, False),
            (ghost, "full", False, True),  # the way leads past its solid triangle
        ]:
            body = BodyConfig(shape="mesh", mesh=mesh, position_m=[0, 0, 2], visibility=role)
            batch = batch_with([body], lidar=LidarConfig(beams=3, hfov_deg=10, max_range_m=4))
            batch.set_pose(np.float32([[-3, 0, 2]]))
            batch.sense()
            assert np.isfinite(batch.lidar().ranges).any() == seen
            batch.move(np.float32([[3, 0, 2]]))
            assert bool(batch.contact.hit[0]) == hit


class TestFiles:
    @pytest.mark.parametrize("suffix", ["json", "glb", "gltf"])
    def test_worlds_keep_meshes_of_bodies(self, suffix, tmp_path):
        mesh = star_world()
        bodies = [BodyConfig(shape="mesh", mesh=mesh), BodyConfig(), BodyConfig(shape="mesh", mesh=mesh, semantic=3)]
        world = room().with_bodies(bodies)
        world.save(tmp_path / f"world.{suffix}")
        loaded = World.load(tmp_path / f"world.{suffix}")
        assert loaded.bodies == bodies
        assert loaded.bodies[0].mesh is loaded.bodies[2].mesh
        assert loaded.to_dict() == world.to_dict()
        assert pickle.loads(pickle.dumps(world)).bodies == bodies
        twice = World.load(tmp_path / f"world.{suffix}", scale=2.0)
        np.testing.assert_allclose(twice.bodies[0].mesh.bounds, 2 * np.array(mesh.bounds), rtol=1e-6)

    def test_worlds_as_bytes_of_files(self):
        world = room_with()
        data = world.to_glb()
        assert data.startswith(b"glTF")
        assert World.from_glb(data).to_dict() == world.to_dict()
        for bad in (b"", data[:100], b'{"asset": {"version": "2.0"}}'):
            with refused(ValueError, "data"):
                World.from_glb(bad)
        outside = json.dumps(
            {"asset": {"version": "2.0"}, "buffers": [{"uri": "/etc/passwd", "byteLength": 4}]}
        ).encode()
        with refused(ValueError, "data", "/etc/passwd"):
            World.from_glb(outside)

    def test_a_mesh_in_a_file_of_its_own(self, tmp_path):
        (tmp_path / "meshes").mkdir()
        star_world().save(tmp_path / "meshes" / "star.glb")
        bodies = [{"shape": "mesh", "mesh": "meshes/star.glb"}, {"shape": "mesh", "mesh": 0}]
        (tmp_path / "scene.json").write_text(json.dumps({**ROOM, "bodies": bodies}))
        first, second = World.load(tmp_path / "scene.json").bodies
        assert first.mesh.to_dict() == star_world().to_dict()
        assert second.mesh is first.mesh

    @pytest.mark.parametrize(
        ("body", "said"),
        [
            ({"shape": "mesh"}, ["bodies[0].mesh", "a world of triangles"]),
            ({"mesh": "star.glb"}, ["bodies[0].mesh", "no mesh"]),
            ({"shape": "mesh", "mesh": "/etc/passwd"}, ["bodies[0].mesh", "folder", "/etc/passwd"]),
            ({"shape": "mesh", "mesh": "../star.glb"}, ["bodies[0].mesh", "folder", "../star.glb"]),
            ({"shape": "mesh", "mesh": "scene.json"}, ["bodies[0].mesh", "scene.json"]),
            ({"shape": "mesh", "mesh": "none.glb"}, ["none.glb"]),
            ({"shape": "mesh", "mesh": ""}, ["bodies[0].mesh", "folder"]),
            ({"shape": "mesh", "mesh": 0}, ["bodies[0].mesh", "an earlier body", 0]),
            ({"shape": "mesh", "mesh": -1}, ["bodies[0].mesh", "an earlier body", -1]),
            ({"shape": "mesh", "mesh": True}, ["bodies[0].mesh", "true"]),
            ({"shape": "mesh", "mesh": "data:,x"}, ["bodies[0].mesh", "data:,x"]),
            ({"shape": "mesh", "mesh": "data:model/gltf-binary;base64,AAAA"}, ["bodies[0].mesh"]),
            ({"shape": "mesh", "mesh": "star.glb", "size_m": [2, 1, 1]}, ["bodies[0].size_m"]),
        ],
    )
    def test_a_bad_mesh_is_refused(self, body, said, tmp_path):
        star_world().save(tmp_path / "star.glb")
        (tmp_path / "scene.json").write_text(json.dumps({**ROOM, "bodies": [body]}))
        with refused(ValueError, *said):
            World.load(tmp_path / "scene.json")

    def test_a_mesh_with_other_things_is_refused(self):
        for mesh, said in [
            (room(), "with triangles"),
            (room_with(), "triangles only"),
            (star_world().with_bodies([BodyConfig()]), "without bodies"),
        ]:
            with refused(ValueError, "body.mesh", said):
                batch_with([BodyConfig(shape="mesh", mesh=mesh)])
        with refused(TypeError, "mesh", 3):
            BodyConfig(mesh=3)

    def test_a_picture_of_a_drone_becomes_a_world(self):
        vertices, triangles, _ = star()
        colors = np.random.default_rng(1).uniform(0, 1, (len(triangles), 3))
        mesh = flockstep.DroneMesh(vertices, triangles, colors, "toy").world()
        assert mesh.name == "toy"
        camera = CameraConfig(width_px=64, height_px=64, outputs=["rgb", "instance"])
        batch = batch_with([BodyConfig(shape="mesh", mesh=mesh, position_m=[0, 0, 2])], cameras=[camera])
        batch.set_pose(np.float32([[-2, 0, 2]]))
        batch.capture()
        shows = batch.camera().instance[0] == 61440
        assert shows.sum() > 500
        assert len(np.unique(batch.camera().rgb[0][shows], axis=0)) > 50


def write_gltf(path, nodes, roots):
    """Write a glTF file with one mesh, the star, and these nodes."""
    builder = flockstep.WorldBuilder()
    builder.mesh(*star()[:2], builder.material("paint", (0.2, 0.5, 0.9)))
    builder.build().save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"nodes": nodes, "scenes": [{"nodes": roots}]}))


def turned_node(body=None, **more):
    """Return a node that is moved, turned and scaled, in the axes of glTF."""
    node = {
        "mesh": 0,
        "translation": [2, 1, -3],
        "rotation": [0.5, 0.1, -0.3, 0.8062258],
        "scale": [1.2, 0.7, 0.9],
        **more,
    }
    return node if body is None else node | {"extras": {"body": body}}


def test_a_node_of_a_gltf_file_is_a_body_by_its_extras(tmp_path):
    """At its first pose a LiDAR detects the same as in the static world; it then moves by its script."""
    motion = {"kind": "slider", "travel_m": [0, 1, 0], "period_s": 1}
    child = {"mesh": 0, "translation": [1, 0, 0.5], "scale": [0.4, 0.4, 0.4]}
    for name, body in (("still", None), ("living", {"name": "car", "motion": motion})):
        node = turned_node(body, children=[1])
        nodes = [node, child, {"mesh": 0, "translation": [0, 30, 0]}]
        write_gltf(tmp_path / f"{name}.gltf", nodes, [0, 2])
    lidar = LidarConfig(channels=60, vfov_deg=170, beams=180, hfov_deg=360, max_range_m=20)
    for options in ({}, {"scale": 0.5, "origin": [1, 2, 3]}, {"up": "z"}):
        still = World.load(tmp_path / "still.gltf", **options)
        living = World.load(tmp_path / "living.gltf", **options)
        assert [body.name for body in living.bodies] == ["car"]
        of_body, of_world = (len(world.mesh()["triangles"]) for world in (living.bodies[0].mesh, living))
        assert of_body == 2 * of_world
        places = living.bodies[0].position_m + options.get("scale", 1) * np.array([[0, 0, 2.5], [-2, 1, 0], [1, -2, 0]])
        batches = [flockstep.Batch([world], 3, lidar=lidar) for world in (still, living)]
        for batch in batches:
            batch.set_pose(places)
            batch.sense()
        still_ranges, ranges = (batch.lidar().ranges for batch in batches)
        seen = np.isfinite(still_ranges)
        assert seen.sum() > 100
        differ = ~np.isclose(np.where(seen, still_ranges, 0), np.where(np.isfinite(ranges), ranges, 0), atol=1e-4)
        assert differ.mean() < 1e-3  # at silhouettes
        before = batches[1].bodies.position[0, 0].copy()
        for _ in range(5):
            batches[1].move(batches[1].position)
        way = (batches[1].bodies.position[0, 0] - before) / options.get("scale", 1)
        assert np.linalg.norm(way) == pytest.approx(1, abs=1e-4)


def test_bodies_of_equal_nodes_share_their_mesh(tmp_path):
    nodes = [turned_node({}), turned_node({}, translation=[9, 0, 0]), turned_node({}, scale=[1, 1, 1])]
    write_gltf(tmp_path / "cars.gltf", [*nodes, {"mesh": 0}], [0, 1, 2, 3])
    world = World.load(tmp_path / "cars.gltf")
    assert world.bodies[0].mesh is world.bodies[1].mesh
    assert world.bodies[0].mesh is not world.bodies[2].mesh
    world.save(tmp_path / "saved.glb")
    for saved, body in zip(World.load(tmp_path / "saved.glb").bodies, world.bodies, strict=True):
        assert (saved.position_m, saved.quat_wxyz) == (body.position_m, body.quat_wxyz)
        np.testing.assert_array_equal(saved.mesh.mesh()["vertices"], body.mesh.mesh()["vertices"])


@pytest.mark.parametrize(
    ("nodes", "said"),
    [
        ([turned_node({"color": [1, 0, 0]})], ["/nodes/0/extras/body/color"]),
        ([turned_node({"motion": {"kind": "fly"}})], ["extras/body.motion.kind", "fly"]),
        ([{**turned_node(), "extras": {"body": 3}}], ["extras/body", "an object", 3]),
        ([turned_node({}, children=[1]), turned_node({})], ["/nodes/1/extras/body", "inside another"]),
        ([{"extras": {"body": {}}}], ["/nodes/0/extras/body", "triangle"]),
        ([{**turned_node({}), "scale": [1, 0, 1]}], ["/nodes/0", "scaled"]),
    ],
)
def test_a_bad_body_of_a_gltf_file_is_refused(tmp_path, nodes, said):
    roots = [0, len(nodes)]
    write_gltf(tmp_path / "bad.gltf", [*nodes, {"mesh": 0}], roots)
    with refused(ValueError, *said):
        World.load(tmp_path / "bad.gltf")
