"""Worlds: rays against two references, meshes, generated playgrounds, shortest paths, and worlds made by code."""

import json
import os
import pickle

import numpy as np
import pytest
from conftest import world_of
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import refused

import flockstep

SCENE = {
    "flockstep_scene": 1,
    "name": "shapes",
    "room": {"min": [-5, -5, 0], "max": [5, 5, 4]},
    "cylinders": [{"center": [-2, 1, 1.5], "radius": 0.5, "height": 2, "quat_wxyz": [0.8, 0.6, 0, 0]}],
    "boxes": [{"center": [2, -1, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.96, 0, 0.28, 0]}],
    "spheres": [{"center": [1, 2.5, 2], "radius": 0.7}],
}


@pytest.fixture(scope="module")
def shapes():
    return flockstep.World.from_dict(SCENE)


class TestRaycast:
    def test_returns_the_material(self):
        world = world_of(
            materials={"red": {"base_color": [1, 0, 0]}, "blue": {"base_color": [0, 0, 1]}},
            spheres=[{"center": [5, 0, 0], "radius": 1, "material": "blue"}],
            meshes=[
                {
                    "vertices": [[-5, -1, -1], [-5, 1, -1], [-5, 0, 1]],
                    "triangles": [[0, 1, 2]],
                    "material": "red",
                }
            ],
        )
        hits = world.raycast(np.zeros((3, 3)), [[1, 0, 0], [-1, 0, 0], [0, 0, 1]], 10.0)
        named = [world.materials[m] for m in hits["material"][:2]]
        assert [m["name"] for m in named] == ["blue", "red"]
        assert [m["semantic"] for m in named] == [2, 1]
        assert named[0]["base_color"] == (0, 0, 1)
        assert hits["material"].tolist()[2] == -1

    def test_a_miss(self, room):
        hits = room.raycast([[4, 2, 2]], [[0, 0, 1]], 1.5)
        assert hits["t_hit"][0] == np.inf
        assert hits["primitive"][0] == -1
        np.testing.assert_array_equal(hits["normal"], [[0, 0, 0]])

    def test_no_rays(self, room):
        assert room.raycast(np.zeros((0, 3)), np.zeros((0, 3)), 1.0)["t_hit"].shape == (0,)


class TestLight:
    def test_reads_as_a_scene_file_says_it(self, shapes):
        light = {
            "sun_direction": [0, 3, -4],
            "sun_color": [1, 2, 3],
            "sky_ambient": [0, 0, 0],
            "ground_ambient": [100, 0, 0],
            "zenith_color": [0.5, 0.25, 0.125],
            "horizon_color": [1, 1, 1],
            "gamma": 1.5,
            "sun_radius_deg": 2.5,
            "sun_glow": 0.5,
            "fog_visibility_m": 40.0,
        }
        world = flockstep.World.from_dict({**SCENE, "light": light})
        np.testing.assert_allclose(world.light["sun_direction"], [0, 0.6, -0.8], rtol=1e-7)
        assert {**world.light, "sun_direction": None} == {
            **{k: tuple(v) if isinstance(v, list) else v for k, v in light.items()},
            "sun_direction": None,
        }
        assert flockstep.World.from_dict({**SCENE, "light": world.light}).light == world.light
        assert pickle.loads(pickle.dumps(world)).light == world.light
        assert shapes.light != world.light

    def test_default(self, shapes):
        assert shapes.light["gamma"] == pytest.approx(2.2)
        assert np.linalg.norm(shapes.light["sun_direction"]) == pytest.approx(1)
        assert "light" not in shapes.to_dict()


def test_each_mesh_stays_one():
    triangle = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}
    world = world_of(meshes=[triangle, {**triangle, "position": [0, 0, 1]}])
    meshes = world.to_dict()["meshes"]
    assert [m["triangles"] for m in meshes] == [[[0, 1, 2]]] * 2
    assert [m["vertices"][0] for m in meshes] == [[0, 0, 0], [0, 0, 1]]
    assert flockstep.World.from_dict(world.to_dict()).to_dict() == world.to_dict()
    mesh = world.mesh()
    assert mesh["vertices"].shape == (6, 3)
    assert mesh["triangles"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert mesh["objects"].tolist() == [0, 1]


class TestPlayground:
    @settings(max_examples=10, deadline=None)
    @given(st.integers(0, 2**32))
    def test_is_a_function_of_its_seed_and_can_be_flown(self, seed):
        world = flockstep.World.playground(seed)
        assert world.to_dict() == flockstep.World.playground(seed).to_dict()
        assert len([p for p in world.primitives if p["kind"] == "cylinder"]) == 12
        path = flockstep.plan(world, world.start, [*world.waypoints, world.goal])
        assert path is not None


def test_plan_says_so_when_there_is_no_path():
    walled = world_of(room={"min": [0, 0, 0], "max": [6, 3, 2]}, boxes=[{"center": [3, 1.5, 1], "size": [0.2, 3, 2]}])
    assert flockstep.plan(walled, [1, 1.5, 1], [[5, 1.5, 1]]) is None


class TestMeshFiles:
    """A scene may only name files in its own folder, so that a downloaded scene cannot read other files."""

    MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

    @pytest.fixture
    def folder(self, tmp_path):
        (tmp_path / "scene" / "meshes").mkdir(parents=True)
        for place in ("secret.obj", "scene/a.obj", "scene/meshes/b.obj"):
            (tmp_path / place).write_text(self.MESH)
        (tmp_path / "scene" / "link.obj").symlink_to(tmp_path / "secret.obj")
        return tmp_path / "scene"

    @staticmethod
    def scene(file):
        return {"flockstep_scene": 1, "meshes": [{"file": str(file)}]}

    @pytest.mark.parametrize("file", ["a.obj", "meshes/b.obj", "meshes/../a.obj", "./a.obj"])
    def test_those_below_are_read(self, folder, file, monkeypatch):
        assert len(flockstep.World.from_dict(self.scene(file), folder).mesh()["triangles"]) == 1
        monkeypatch.chdir(folder)
        assert len(flockstep.World.from_dict(self.scene(file)).mesh()["triangles"]) == 1
        (folder / "s.json").write_text(json.dumps(self.scene(file)))
        assert len(flockstep.World.load("s.json").mesh()["triangles"]) == 1

    @pytest.mark.parametrize(
        "file", ["../secret.obj", "meshes/../../secret.obj", "link.obj", "absolute", "../scene2/a.obj"]
    )
    def test_others_only_where_they_are_allowed(self, folder, file):
        (folder.parent / "scene2").mkdir()
        (folder.parent / "scene2" / "a.obj").write_text(self.MESH)
        scene = self.scene(folder.parent / "secret.obj" if file == "absolute" else file)
        (folder / "s.json").write_text(json.dumps(scene))
        loads = [
            lambda **anywhere: flockstep.World.load(folder / "s.json", **anywhere),
            lambda **anywhere: flockstep.World.from_dict(scene, folder, **anywhere),
        ]
        for load in loads:
            with refused(ValueError, "scene", "/meshes/0/file"):
                load()
            assert len(load(meshes_anywhere=True).mesh()["triangles"]) == 1

    def test_names_without_a_file_are_refused(self, folder):
        os.mkfifo(folder / "pipe.obj")
        for file in ("pipe.obj", "meshes"):
            with refused(ValueError, "scene: /meshes/0/file", "not a regular file"):
                flockstep.World.from_dict(self.scene(file), folder)


class TestPickles:
    def test_every_bundled_kind_of_world_comes_back_equal(self):
        for name in ("playground/train-1", "race/figure-8", "outdoor/city"):
            world = flockstep.World.load(name)
            again = pickle.loads(pickle.dumps(world))
            assert again.to_dict() == world.to_dict()

    def test_triangles_and_textures_are_binary(self):
        """JSON takes seconds for a mesh of a million triangles."""
        builder = flockstep.WorldBuilder()
        noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
        material = builder.material("ground", texture=builder.texture("noise", noise))
        rows = 101
        builder.heightfield(np.zeros((rows, rows), np.float32), material, cell_m=1)
        per_vertex, per_triangle = 4 * (3 + 2), 4 * 3 + 2 + 2
        size = per_vertex * rows**2 + per_triangle * 2 * (rows - 1) ** 2 + 4 * noise.size // 3
        assert size <= len(pickle.dumps(builder.build())) < size + 2000

    @pytest.mark.parametrize("state", [b"", b"flockstep", b"\xff" * 100])
    def test_damaged_bytes_are_refused(self, state):
        with refused(ValueError, "world", "others"):
            flockstep.World.__new__(flockstep.World).__setstate__(state)


RED = np.full((2, 2, 3), (255, 0, 0), np.uint8)
COLORS = [[1, 0, 0.5], [0.25, 1, 1], [1, 1, 1]]


def test_it_makes_what_a_scene_file_says():
    builder = flockstep.WorldBuilder("hall")
    wall = builder.material("wall", [0.8, 0.7, 0.6], emissive=[0, 2, 0.5])
    thing = builder.material("thing", [0.1, 0.2, 0.3], semantic=7)
    builder.room([-5, -4, 0], [5, 4, 3], wall)
    builder.box([1, 0, 1], [1, 2, 0.5], thing, [0.6, 0, 0, 0.8])
    builder.cylinder([2, 1, 1], 0.5, 2, thing)
    builder.sphere([-2, 1, 1], 0.5, thing)
    builder.capsule([-3, 1, 1], 0.25, 1.5, wall)
    builder.plane([0, 2, 1], [1, 2], wall)
    builder.disc([0, -2, 1], 0.75, wall, [0.6, 0.8, 0, 0])
    builder.mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], [[0, 1, 2]], thing, colors=COLORS)
    builder.start([-4, 0, 1])
    builder.waypoint([0, 3, 1])
    builder.waypoint(np.array([1, 3, 1]))
    builder.goal([4, 0, 1])
    builder.spawn_box([-4.5, -0.5, 1], [-4, 0.5, 1.5])
    builder.light(
        sun_direction=[0, 0.6, 0.8],
        sun_color=[1, 0.9, 0.8],
        gamma=2,
        sun_radius_deg=1,
        sun_glow=0.5,
        fog_visibility_m=30,
    )
    expected = world_of(
        name="hall",
        materials={
            "wall": {"base_color": [0.8, 0.7, 0.6], "emissive": [0, 2, 0.5]},
            "thing": {"base_color": [0.1, 0.2, 0.3], "semantic": 7},
        },
        room={"min": [-5, -4, 0], "max": [5, 4, 3], "material": "wall"},
        boxes=[{"center": [1, 0, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.6, 0, 0, 0.8], "material": "thing"}],
        cylinders=[{"center": [2, 1, 1], "radius": 0.5, "height": 2, "material": "thing"}],
        spheres=[{"center": [-2, 1, 1], "radius": 0.5, "material": "thing"}],
        capsules=[{"center": [-3, 1, 1], "radius": 0.25, "height": 1.5, "material": "wall"}],
        planes=[{"center": [0, 2, 1], "size": [1, 2], "material": "wall"}],
        discs=[{"center": [0, -2, 1], "radius": 0.75, "quat_wxyz": [0.6, 0.8, 0, 0], "material": "wall"}],
        meshes=[
            {
                "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]],
                "triangles": [[0, 1, 2]],
                "colors": COLORS,
                "material": "thing",
            }
        ],
        markers={
            "start": [-4, 0, 1],
            "waypoints": [[0, 3, 1], [1, 3, 1]],
            "goal": [4, 0, 1],
            "spawn_box": {"min": [-4.5, -0.5, 1], "max": [-4, 0.5, 1.5]},
        },
        light={
            "sun_direction": [0, 0.6, 0.8],
            "sun_color": [1, 0.9, 0.8],
            "gamma": 2,
            "sun_radius_deg": 1,
            "sun_glow": 0.5,
            "fog_visibility_m": 30,
        },
    )
    assert builder.build().to_dict() == expected.to_dict()


def test_a_height_field_has_its_heights():
    heights = np.random.default_rng(0).uniform(-1, 1, (4, 6)).astype(np.float32)
    builder = flockstep.WorldBuilder()
    builder.heightfield(heights, builder.material("ground"), corner=(-2, 3), cell_m=0.5)
    world = builder.build()
    np.testing.assert_allclose(world.bounds[:, :2], [[-2, 3], [0.5, 4.5]])
    rows, columns = np.mgrid[0:4, 0:6]
    inner = np.s_[1:-1, 1:-1]  # a ray through a corner at the border may miss
    places = np.stack([-2 + 0.5 * columns, 3 + 0.5 * rows, np.full(rows.shape, 5.0)], axis=-1)[inner].reshape(-1, 3)
    hits = world.raycast(places, np.tile([0, 0, -1], (len(places), 1)), 10)
    np.testing.assert_allclose(5 - hits["t_hit"], heights[inner].ravel(), atol=1e-5)
    assert (hits["normal"][:, 2] > 0).all()  # seen from above, the outside


def test_textures_show_on_meshes():
    builder = flockstep.WorldBuilder()
    painted = builder.material("painted", texture=builder.texture("red", RED))
    builder.mesh([[2, -5, -5], [2, 5, -5], [2, 5, 5], [2, -5, 5]], [[0, 2, 1], [0, 3, 2]], painted)
    camera = flockstep.CameraConfig(width_px=8, height_px=6)
    red, green, blue = np.moveaxis(flockstep.render(builder.build(), [0, 0, 0], camera=camera)["rgb"], -1, 0)
    assert (red > 100).all()
    assert not green.any()
    assert not blue.any()


@pytest.mark.parametrize("suffix", [".json", ".glb"])
def test_cameras_see_through_masks_and_files_keep_them(suffix, tmp_path):
    left_half = np.full((2, 2, 4), (255, 0, 0, 255), np.uint8)
    left_half[:, 0, 3] = 127
    builder = flockstep.WorldBuilder()
    fence = builder.material("fence", texture=builder.texture("bars", left_half, ("clamp", "clamp")), alpha_cutoff=0.75)
    corners, uv = [[2, 5, 5], [2, -5, 5], [2, -5, -5], [2, 5, -5]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    builder.mesh(corners, [[0, 1, 2], [0, 2, 3]], fence, uv=uv)
    builder.box([4, 0, 0], [1, 20, 20], builder.material("wall", [0, 0, 1]))
    built = builder.build()
    built.save(tmp_path / f"fence{suffix}")
    world = flockstep.World.load(tmp_path / f"fence{suffix}")
    assert world.to_dict() == built.to_dict()
    assert [m["alpha_cutoff"] for m in world.materials] == [0.75, 0]
    camera = flockstep.CameraConfig(width_px=8, height_px=6, outputs=("rgb", "depth", "semantic"))
    images = flockstep.render(world, [0, 0, 0], camera=camera)
    # The alpha is 127 up to a quarter of the fence, 255 from three quarters on, and 0.75 just right of its middle.
    np.testing.assert_allclose(images["depth"], np.tile(np.repeat([3.5, 2], 4), (6, 1)), atol=1e-4)
    assert (images["semantic"] == np.repeat([2, 1], 4)).all()
    assert (images["rgb"][:, :4, 2] > images["rgb"][:, :4, 0]).all()
    assert (images["rgb"][:, 4:, 0] > images["rgb"][:, 4:, 2]).all()
    hits = world.raycast(np.zeros((2, 3)), [[1, 0.5, 0.1], [1, -0.5, 0.1]], 10)
    assert (hits["primitive"] == [2, 1]).all()  # a LiDAR hits the whole object


def test_a_built_world_does_not_change_later():
    builder = flockstep.WorldBuilder()
    builder.sphere([0, 0, 0], 1, builder.material("a"))
    first = builder.build()
    builder.sphere([3, 0, 0], 1, 0)
    assert len(first.primitives) == 1
    assert len(builder.build().primitives) == 2


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda b: b.box([0, 0], [1, 1, 1], 0), ("center", 3, 2)),
        (lambda b: b.start(None), ("place", 3, "None")),
        (lambda b: b.texture("t", RED.astype(float)), ("pixels", 3, 4)),
        (lambda b: b.texture("t", RED, ("repeat", "tile")), ("wrap", "repeat", "mirror", "clamp", "tile")),
        (lambda b: b.mesh([[0, 0, 0]], [[0, 0, 1]], 0), ("triangles", 0, 1)),
        (lambda b: b.mesh([[0, 0, 0]], [[0, 0, -1]], 0), ("triangles",)),
        (lambda b: b.mesh(np.eye(3), [[0, 1, 2]], 0, [[0, 0]]), ("uv", 3, 1)),
        (lambda b: b.mesh(np.eye(3), [[0, 1, 2]], 0, colors=[[0, 0, 0]]), ("colors", 3)),
        (lambda b: b.heightfield([[0.0]], 0), ("heightfield", 2, 32768, 1)),
        (lambda b: b.heightfield([[0, 0], [0, 0]], 0, cell_m=0), ("heightfield", 0)),
        (lambda b: b.build(), ("scene", "empty scene")),
        (lambda b: (b.sphere([0, 0, 0], 1, 3), b.build()), ("primitives[0].material", 1, 3)),
        (lambda b: (b.sphere([0, 0, 0], -1, 0), b.build()), ("primitives[0].half_extents", "1e-06")),
        (lambda b: (b.material("a"), b.material("a"), b.sphere([0, 0, 0], 1, 0), b.build()), ("materials[1].name",)),
    ],
)
def test_mistakes(call, match):
    with refused(ValueError, *match):
        call(flockstep.WorldBuilder())
