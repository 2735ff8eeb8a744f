"""Worlds made by code."""

import numpy as np
import pytest
from messages import refused

import flockstep

RED = np.full((2, 2, 3), (255, 0, 0), np.uint8)
COLORS = [[1, 0, 0.5], [0.25, 1, 1], [1, 1, 1]]


def test_it_makes_what_a_scene_file_says():
    scene = {
        "flockstep_scene": 1,
        "name": "hall",
        "materials": {
            "wall": {"base_color": [0.8, 0.7, 0.6], "emissive": [0, 2, 0.5]},
            "thing": {"base_color": [0.1, 0.2, 0.3], "semantic": 7},
        },
        "room": {"min": [-5, -4, 0], "max": [5, 4, 3], "material": "wall"},
        "boxes": [{"center": [1, 0, 1], "size": [1, 2, 0.5], "quat_wxyz": [0.6, 0, 0, 0.8], "material": "thing"}],
        "cylinders": [{"center": [2, 1, 1], "radius": 0.5, "height": 2, "material": "thing"}],
        "spheres": [{"center": [-2, 1, 1], "radius": 0.5, "material": "thing"}],
        "capsules": [{"center": [-3, 1, 1], "radius": 0.25, "height": 1.5, "material": "wall"}],
        "planes": [{"center": [0, 2, 1], "size": [1, 2], "material": "wall"}],
        "discs": [{"center": [0, -2, 1], "radius": 0.75, "quat_wxyz": [0.6, 0.8, 0, 0], "material": "wall"}],
        "meshes": [
            {
                "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]],
                "triangles": [[0, 1, 2]],
                "colors": COLORS,
                "material": "thing",
            }
        ],
        "markers": {
            "start": [-4, 0, 1],
            "waypoints": [[0, 3, 1], [1, 3, 1]],
            "goal": [4, 0, 1],
            "spawn_box": {"min": [-4.5, -0.5, 1], "max": [-4, 0.5, 1.5]},
        },
        "light": {
            "sun_direction": [0, 0.6, 0.8],
            "sun_color": [1, 0.9, 0.8],
            "gamma": 2,
            "sun_radius_deg": 1,
            "sun_glow": 0.5,
            "fog_visibility_m": 30,
        },
    }
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
    assert builder.build().to_dict() == flockstep.World.from_dict(scene).to_dict()


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
