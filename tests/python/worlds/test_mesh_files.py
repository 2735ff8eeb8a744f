"""Mesh files: `World.load` reads what trimesh wrote triangle by triangle, and trimesh reads what a world saved as glTF.

A saved world loads back equal. `./dev validate-gltf` checks many such files with the Khronos validator
(`validate_gltf.py`).
"""

import json

import numpy as np
import PIL.Image
import pytest
import scipy.spatial
import trimesh
from messages import refused

import flockstep


def textured(seed, color):
    """A mesh of random triangles, with texture coordinates and its own texture."""
    random = np.random.default_rng(seed)
    vertices = random.uniform(-5, 5, (30, 3)).astype(np.float32)
    faces = random.permuted(np.tile(np.arange(30), (20, 1)), axis=1)[:, :3]
    image = PIL.Image.fromarray(random.integers(0, 256, (4, 8, 3), np.uint8))
    material = trimesh.visual.material.SimpleMaterial(image=image, diffuse=[*color, 255], name=f"paper {seed}")
    visual = trimesh.visual.TextureVisuals(uv=random.uniform(0, 1, (30, 2)), material=material)
    return trimesh.Trimesh(vertices, faces, visual=visual, process=False)


def test_an_obj_file_of_trimesh_with_its_materials_and_textures(tmp_path):
    given = [textured(seed, color) for seed, color in enumerate([(255, 255, 255), (51, 102, 204)])]
    trimesh.Scene(given).export(tmp_path / "scene.obj")
    world = flockstep.World.load(tmp_path / "scene.obj")
    mesh = world.mesh()
    assert len(mesh["triangles"]) == 40
    for i, part in enumerate(given):
        mine = mesh["objects"] == i
        assert mine.sum() == 20
        assert len(set(mesh["materials"][mine])) == 1
        corners = mesh["triangles"][mine]
        np.testing.assert_allclose(mesh["vertices"][corners], part.triangles, atol=1e-5)
        uv = part.visual.uv[part.faces]
        np.testing.assert_allclose(mesh["uv"][corners], np.stack([uv[..., 0], 1 - uv[..., 1]], -1), atol=1e-6)
        material = world.materials[mesh["materials"][mine][0]]
        np.testing.assert_allclose(material["base_color"], part.visual.material.diffuse[:3] / 255, atol=1e-6)
        # A hit has the colour of the image at that point.
        scene = world.to_dict()
        assert len(scene["textures"]) == 2


def test_ignored_parts_of_files_and_dicts_are_named(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    parts = "1 missing file (gone.mtl)", "1 material"
    with refused(UserWarning, "a.obj", *parts):
        world = flockstep.World.load(tmp_path / "a.obj")
    assert world.check()["not_read"] == [
        "1 missing file (gone.mtl)",
        "1 material that no material file defines",
    ]
    scene = {"flockstep_scene": 1, "meshes": [{"file": "a.obj"}]}
    with refused(UserWarning, "scene", *parts):
        flockstep.World.from_dict(scene, tmp_path)
    (tmp_path / "s.json").write_text(json.dumps(scene))
    with refused(UserWarning, "s.json", *parts):
        flockstep.World.load(tmp_path / "s.json")


def test_cameras_see_the_colors_of_a_material_file(tmp_path):
    square = "v 0 -1 -1\nv 0 1 -1\nv 0 1 1\nv 0 -1 1\nf 1 2 3 4\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\nusemtl lamp\n{square}")
    (tmp_path / "a.mtl").write_text("newmtl lamp\nKd 0 0 0\nKe 0.5 0.25 1\n")
    world = flockstep.World.load(tmp_path / "a.obj")
    shown = flockstep.render(world, (2, 0, 0), look_at=(0, 0, 0))["rgb"]
    height, width = shown.shape[:2]
    expected = 255 * np.array([0.5, 0.25, 1]) ** (1 / world.light["gamma"])
    np.testing.assert_allclose(shown[height // 2, width // 2], expected, atol=1)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
@pytest.mark.parametrize("is_colored", [False, True])
def test_a_ply_file_of_trimesh(tmp_path, encoding, is_colored):
    random = np.random.default_rng(3)
    mesh = trimesh.creation.icosphere(subdivisions=2)
    if is_colored:
        mesh.visual.vertex_colors = random.integers(0, 256, (len(mesh.vertices), 4), np.uint8)
    mesh.export(tmp_path / "ball.ply", encoding=encoding)
    world = flockstep.World.load(tmp_path / "ball.ply", scale=2, origin=(1, 2, 3))
    got = world.mesh()
    np.testing.assert_allclose(got["vertices"][got["triangles"]], mesh.triangles * 2 + (1, 2, 3), atol=1e-5)
    scene = world.to_dict()["meshes"][0]
    assert ("colors" in scene) == is_colored
    if is_colored:
        srgb = mesh.visual.vertex_colors[:, :3] / 255
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        np.testing.assert_allclose(np.array(scene["colors"])[scene["triangles"]], linear[mesh.faces], atol=1e-6)


def test_a_cloud_of_points_is_refused(tmp_path):
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "cloud.ply")
    with refused(ValueError, "cloud.ply", "point cloud"):
        flockstep.World.load(tmp_path / "cloud.ply")


RADIUS = 0.25  # m, of all round objects in comparisons: files are tessellated to a hundredth of it


def random_world(seed, radius=None):
    """A world with every kind of content; all round objects have one radius, if given."""
    random = np.random.default_rng(seed)
    builder = flockstep.WorldBuilder(f"random {seed}")

    def point():
        return random.uniform(-9, 9, 3)

    def size():
        return random.uniform(0.1, 2)

    def rotation():
        wxyz = random.normal(size=4)
        return wxyz / np.linalg.norm(wxyz)

    images = [
        builder.texture(f"image {i}", random.integers(0, 256, (5 + i, 7, 3), np.uint8), wrap=(wrap, "repeat"))
        for i, wrap in enumerate(("repeat", "mirror", "clamp"))
    ]
    materials = [builder.material(f"material {i}", random.uniform(0, 1, 3), semantic=i + 9) for i in range(4)]
    materials += [builder.material(f"paper {i}", [1, 1, 1], texture=image) for i, image in enumerate(images)]
    builder.room([-10, -10, -10], [10, 10, 10], builder.material("wall", [0.5, 0.6, 0.7]))
    for i in range(3):
        r = radius or size()
        builder.box(point(), random.uniform(0.1, 2, 3), materials[i], rotation(), solid=i > 0)
        builder.cylinder(point(), r, size(), materials[i], rotation(), visible=i > 1)
        builder.capsule(point(), r, 2 * r + size(), materials[i], rotation())
        builder.sphere(point(), r, materials[i])
        builder.plane(point(), random.uniform(0.1, 2, 2), materials[i], rotation())
        builder.disc(point(), r, materials[i + 3], rotation())
        builder.mesh(
            random.uniform(-5, 5, (12, 3)),
            np.arange(12).reshape(4, 3),
            materials[i + 4],
            random.normal(size=(12, 2)),
            visible=i != 1,
            solid=i != 2,
        )
    builder.heightfield(random.uniform(-9, -8, (6, 8)), materials[1], corner=(-8, -8))
    builder.start(point())
    builder.waypoint(point())
    builder.waypoint(point())
    builder.goal(point())
    builder.spawn_box([-1, -2, -3], [1, 2, 3])
    builder.light(sun_direction=point(), sun_color=random.uniform(0, 2, 3), gamma=2)
    return builder.build()


def as_trimesh_reads(path):
    """Triangles (T, 3, 3) m of a file, transformed by its nodes, z up."""
    parts = []
    scene = trimesh.load(path)
    for node in scene.graph.nodes_geometry:
        place, name = scene.graph[node]
        parts.append(trimesh.transform_points(scene.geometry[name].vertices, place)[scene.geometry[name].faces])
    x, y, z = np.moveaxis(np.concatenate(parts), -1, 0)
    return np.stack([x, -z, y], -1)


def with_normals(triangles):
    """(T, 6): the centroid of each triangle, with a larger weight, and its normal times its area."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.concatenate([100 * (a + b + c) / 3, np.cross(b - a, c - a) / 2], -1)


@pytest.mark.parametrize("name", ["playground/train-1", "playground/validation-2", *range(4)])
def test_another_reader_finds_the_same_triangles(tmp_path, name):
    suffix = "glb" if name != 0 else "gltf"
    world = random_world(name, RADIUS) if isinstance(name, int) else flockstep.World.load(name)
    world.save(tmp_path / f"world.{suffix}")
    mesh = world.mesh(RADIUS / 100)
    vertices, triangles = mesh["vertices"], mesh["triangles"]
    expected, got = with_normals(vertices[triangles]), with_normals(as_trimesh_reads(tmp_path / f"world.{suffix}"))
    assert len(got) == len(expected)
    for ours, theirs in ((expected, got), (got, expected)):
        distance, _ = scipy.spatial.cKDTree(ours).query(theirs)
        assert distance.max() < 2e-3  # centroids within 20 um


@pytest.mark.parametrize("seed", range(4))
def test_a_saved_world_loads_back_equal(tmp_path, seed):
    world = random_world(seed)
    for name in ("world.glb", "world.gltf", "world.json"):
        world.save(tmp_path / name)
        assert flockstep.World.load(tmp_path / name).to_dict() == world.to_dict()


def test_materials_are_what_another_reader_sees(tmp_path):
    world = random_world(0)
    world.save(tmp_path / "world.glb")
    scene = trimesh.load(tmp_path / "world.glb")
    read = {part.visual.material.name: part.visual for part in scene.geometry.values()}
    looks = world.to_dict()["materials"]
    for name in ("wall", "material 1"):
        np.testing.assert_allclose(
            read[name].material.baseColorFactor[:3] / 255, looks[name]["base_color"], atol=1 / 255
        )
        assert read[name].material.metallicFactor == 0
    assert not read["wall"].material.doubleSided  # only for a room
    assert read["material 1"].material.doubleSided  # also for planes
    (paper,) = (
        part.visual
        for part in scene.geometry.values()
        if part.visual.material.name == "paper 0" and len(part.faces) == 4
    )
    random = np.random.default_rng(0)
    np.testing.assert_array_equal(
        np.asarray(paper.material.baseColorTexture)[..., :3], random.integers(0, 256, (5, 7, 3), np.uint8)
    )
    written = np.array(world.to_dict()["meshes"][0]["uv"])
    np.testing.assert_allclose(np.asarray(paper.uv) * [1, -1] + [0, 1], written, atol=1e-6)  # in trimesh, v points up


def test_what_is_shared_is_written_once(tmp_path):
    flockstep.World.playground(seed=1, pillars=40).save(tmp_path / "world.gltf")
    gltf = json.loads((tmp_path / "world.gltf").read_text())
    assert len(gltf["meshes"]) < len(gltf["nodes"]) / 4


def test_other_suffixes_are_refused(tmp_path):
    with refused(ValueError, "world.stl"):
        random_world(0).save(tmp_path / "world.stl")
    assert not list(tmp_path.iterdir())
