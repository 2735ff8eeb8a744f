"""Mesh files of other programs as worlds: `World.load` reads trimesh's files triangle by triangle."""

import json

import numpy as np
import PIL.Image
import pytest
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
