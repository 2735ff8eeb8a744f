"""Scene files: the bundled ones, and the resolution of names and paths."""

import base64
import copy
import importlib.util
import json
import struct
from pathlib import Path
from typing import ClassVar

import jsonschema
import numpy as np
import pytest
from conftest import ROOT

import flockstep
from flockstep import scenes

SHIPPED = scenes.names()
SCHEMA = json.loads((scenes.directory() / "schema.json").read_text())


def test_the_eleven_playgrounds_are_bundled():
    expected = [name for members in scenes.SETS.values() for name in members if "/seed-" not in name]
    assert len(expected) == 11
    assert set(expected) <= set(SHIPPED)


def test_a_set_of_living_worlds_is_generated():
    worlds = scenes.load("living")
    assert [world.name.partition("/")[0] for world in worlds] == ["playground"] * 3 + ["warehouse", "office"]
    assert all(len(world.bodies) >= 6 for world in worlds)


def test_schema_and_documents_are_made_from_the_list_of_keys():
    spec = importlib.util.spec_from_file_location("scene_keys", ROOT / "bindings" / "scene_keys.py")
    scene_keys = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(scene_keys)
    for path, text in scene_keys.renewed().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run bindings/scene_keys.py"


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", sorted(set(SHIPPED) - set(scenes.GENERATED)))
def test_shipped_scenes_keep_to_the_schema(name):
    jsonschema.validate(json.loads(scenes.find(name).read_text()), SCHEMA)
    assert flockstep.World.load(name).name == name


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load(name):
    world = flockstep.World.load(name)
    assert world.start is not None
    assert world.goal is not None


def test_a_scene_is_loaded_once_however_it_is_named():
    a, b, c, d = scenes.load(
        ["playground/train-1", scenes.find("playground/train-1"), "outdoor/forest", "outdoor/forest"]
    )
    assert a is b
    assert c is d
    assert c.name == "forest/seed-1"


def test_generated_scenes_are_named_by_their_seeds():
    first, again, *others = scenes.load(["playground/seed-3", "playground/seed-3..5"])
    assert first is again
    assert [world.name for world in others] == ["playground/seed-4", "playground/seed-5"]
    assert others[0].to_dict() == flockstep.World.playground(4).to_dict()
    assert flockstep.World.load("forest/seed-2").to_dict() == flockstep.World.forest(2).to_dict()


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("jungle/seed-3", "unknown scene 'jungle/seed-3': .* such as 'arena/hall' or 'forest/seed-7'"),
        ("forest/seed-", "unknown scene"),
        ("living_ofice/seed-7", "Did you mean 'living_office/seed-0'"),
        ("forest/seed-5..4", "expected a range of 1 to 100000 seeds"),
        ("forest/seed-0..100000", "expected a range of 1 to 100000 seeds"),
    ],
)
def test_invalid_seeds(name, match):
    with pytest.raises(ValueError, match=match):
        scenes.load(name)


def test_a_range_is_not_one_world():
    with pytest.raises(ValueError, match="unknown scene"):
        flockstep.World.load("forest/seed-1..2")


def test_what_save_writes_keeps_to_the_schema(tmp_path, room):
    room.save(tmp_path / "saved.json")
    jsonschema.validate(json.loads((tmp_path / "saved.json").read_text()), SCHEMA)
    assert flockstep.World.load(tmp_path / "saved.json").to_dict() == room.to_dict()


@pytest.mark.parametrize("key", ["walls", "flockstep_scene"])
def test_schema_and_loader_refuse_the_same_scenes(room, key):
    scene = room.to_dict()
    scene[key] = 7
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(scene, SCHEMA)
    with pytest.raises(ValueError, match=key):
        flockstep.World.from_dict(scene)


POSE = {"center": [0, 0, 1], "quat_wxyz": [0.6, 0.8, 0, 0]}


class TestSolids:
    """The schema accepts the same capsules, planes and discs as the loader."""

    @pytest.mark.parametrize(
        ("kind", "solid"),
        [
            ("capsules", {"center": [0, 0, 1], "radius": 0.5, "height": 2}),
            ("capsules", {**POSE, "radius": 0.5, "height": 1, "material": "red"}),  # a ball
            ("planes", {"center": [0, 0, 1], "size": [1, 2]}),
            ("planes", {**POSE, "size": [2e-6, 2e-6], "material": "red"}),
            ("discs", {"center": [0, 0, 1], "radius": 1e-6}),
            ("discs", {**POSE, "radius": 0.5, "material": "red"}),
        ],
    )
    def test_accepted(self, kind, solid):
        scene = {"flockstep_scene": 1, "materials": {"red": {"base_color": [1, 0, 0]}}, kind: [solid]}
        jsonschema.validate(scene, SCHEMA)
        world = flockstep.World.from_dict(scene)
        saved = world.to_dict()
        assert len(saved[kind]) == 1
        jsonschema.validate(saved, SCHEMA)
        assert flockstep.World.from_dict(saved).to_dict() == saved

    @pytest.mark.parametrize(
        ("kind", "solid"),
        [
            ("capsules", {**POSE, "radius": 0.5}),
            ("capsules", {**POSE, "height": 2}),
            ("capsules", {"radius": 0.5, "height": 2}),
            ("capsules", {**POSE, "radius": 0, "height": 2}),
            ("capsules", {**POSE, "radius": 1e-7, "height": 2}),
            ("capsules", {**POSE, "radius": 0.5, "height": "2"}),
            ("capsules", {**POSE, "radius": 0.5, "height": 2, "size": [1, 1]}),
            ("planes", {**POSE}),
            ("planes", {"size": [1, 1]}),
            ("planes", {**POSE, "size": [1]}),
            ("planes", {**POSE, "size": [1, 1, 1]}),
            ("planes", {**POSE, "size": [1, 0]}),
            ("planes", {**POSE, "size": [-1, 1]}),
            ("planes", {**POSE, "size": [1e-6, 1]}),  # half of it would be below the minimum
            ("planes", {**POSE, "size": 1}),
            ("planes", {**POSE, "size": [1, 1], "thickness": 0}),
            ("discs", {**POSE}),
            ("discs", {"radius": 1}),
            ("discs", {**POSE, "radius": 0}),
            ("discs", {**POSE, "radius": 2e6}),
            ("discs", {**POSE, "radius": 1, "height": 0}),
            ("discs", {**POSE, "radius": 1, "quat_wxyz": [1, 0, 0]}),
            ("discs", {"center": [0, 0], "radius": 1}),
            ("discs", {"center": [0, 0, 1], "radius": 1, "material": 0}),
        ],
    )
    def test_refused(self, kind, solid):
        scene = {"flockstep_scene": 1, kind: [solid]}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match=f"/{kind}/0"):
            flockstep.World.from_dict(scene)

    @pytest.mark.parametrize("kind", ["capsules", "planes", "discs"])
    @pytest.mark.parametrize("value", [{}, 3, None, [3]])
    def test_a_list_of_objects(self, kind, value):
        scene = {"flockstep_scene": 1, "spheres": [{"center": [0, 0, 0], "radius": 1}], kind: value}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match=f"/{kind}"):
            flockstep.World.from_dict(scene)

    def test_a_capsule_shorter_than_its_caps(self):
        # A schema cannot compare two fields; its description states the rule.
        scene = {"flockstep_scene": 1, "capsules": [{**POSE, "radius": 0.5, "height": 0.99}]}
        jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match=r"/capsules/0/height.*twice the radius"):
            flockstep.World.from_dict(scene)


def with_light(**light):
    return {"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [1, 1, 1]}, "light": light}


def with_semantic(semantic):
    materials = {"wall": {"base_color": [1, 1, 1], "semantic": semantic}}
    return {
        "flockstep_scene": 1,
        "materials": materials,
        "room": {"min": [0, 0, 0], "max": [1, 1, 1], "material": "wall"},
    }


COLORS = ["sun_color", "sky_ambient", "ground_ambient", "zenith_color", "horizon_color"]


class TestLight:
    """The schema accepts the same light and semantic ids as the loader."""

    @pytest.mark.parametrize(
        "light",
        [
            {},
            {"sun_direction": [0, 0, -1e6]},
            {"sun_direction": [1e-300, 0, 0]},
            {"gamma": 1},
            {"gamma": 4.0},
            {"sun_radius_deg": 0.1},
            {"sun_radius_deg": 45},
            {"sun_glow": 1},
            {"fog_visibility_m": 0.1},
            {"fog_visibility_m": 1e6},
            *({color: [0, 0.5, 100]} for color in COLORS),
        ],
    )
    def test_accepted(self, light):
        jsonschema.validate(with_light(**light), SCHEMA)
        saved = flockstep.World.from_dict(with_light(**light)).to_dict()
        assert set(saved.get("light", {})) == set(light)
        jsonschema.validate(saved, SCHEMA)
        assert flockstep.World.from_dict(saved).to_dict() == saved

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            ("sun", [0, 0, 1]),
            ("sun_direction", [0, 0, 0]),
            ("sun_direction", [0, -0.0, 0.0]),
            ("sun_direction", [0, 1]),
            ("sun_direction", [0, 0]),
            ("sun_direction", [0, 0, 0, 1]),
            ("sun_direction", [0, 0, "1"]),
            ("sun_direction", [0, 0, 2e6]),
            ("sun_direction", 1),
            *(
                (color, value)
                for color in COLORS
                for value in ([0, 0], [0, -0.1, 0], [0, 0, 100.1], [0, 0, True], 1, None)
            ),
            ("gamma", 0.99),
            ("gamma", 4.01),
            ("gamma", "2"),
            ("gamma", None),
            ("sun_radius_deg", 0.05),
            ("sun_radius_deg", 46),
            ("sun_radius_deg", "1"),
            ("sun_glow", -0.1),
            ("sun_glow", 1.1),
            ("fog_visibility_m", 0.05),
            ("fog_visibility_m", -1),
            ("fog_visibility_m", 1.1e6),
        ],
    )
    def test_refused(self, field, value):
        scene = with_light(**{field: value})
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match=f"/light/{field}.*expected"):
            flockstep.World.from_dict(scene)

    @pytest.mark.parametrize("light", [[], 1, None])
    def test_an_object(self, light):
        scene = {**with_light(), "light": light}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match="/light: expected an object"):
            flockstep.World.from_dict(scene)

    @pytest.mark.parametrize("semantic", [1, 7, 7.0, 65532])
    def test_semantic_accepted(self, semantic):
        jsonschema.validate(with_semantic(semantic), SCHEMA)
        world = flockstep.World.from_dict(with_semantic(semantic))
        assert [m["semantic"] for m in world.materials] == [semantic]
        assert world.to_dict()["materials"]["wall"]["semantic"] == semantic
        jsonschema.validate(world.to_dict(), SCHEMA)

    @pytest.mark.parametrize("semantic", [0, -1, 1.5, 65533, 1e30, "7", True, None, [7]])
    def test_semantic_refused(self, semantic):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(with_semantic(semantic), SCHEMA)
        with pytest.raises(ValueError, match=r"/materials/wall/semantic: expected an integer in \[1, 65532\]"):
            flockstep.World.from_dict(with_semantic(semantic))

    def test_too_many_meshes(self):
        scene = {"flockstep_scene": 1, "meshes": [0] * 65537}
        assert SCHEMA["properties"]["meshes"]["maxItems"] == 65536
        with pytest.raises(ValueError, match="/meshes: expected at most 65536 meshes, got 65537"):
            flockstep.World.from_dict(scene)

    def test_the_schema_has_the_defaults(self):
        light = flockstep.World.from_dict(with_light()).light
        properties = SCHEMA["properties"]["light"]["properties"]
        assert list(light) == list(properties)
        for field, value in light.items():
            np.testing.assert_array_equal(np.float32(properties[field]["default"]), np.float32(value), err_msg=field)


#: A scene with every key that has limits.
FULL = {
    "flockstep_scene": 1,
    "materials": {"a": {"base_color": [0, 0, 0], "emissive": [0, 0, 0], "semantic": 1, "alpha_cutoff": 0}},
    "room": {"min": [-1, -1, -1], "max": [1, 1, 1]},
    "pillars": [{"center": [0, 0], "radius": 1, "z": [0, 1]}],
    "cylinders": [{"center": [0, 0, 0], "radius": 1, "height": 1}],
    "boxes": [{"center": [0, 0, 0], "size": [1, 1, 1]}],
    "spheres": [{"center": [0, 0, 0], "radius": 1}],
    "capsules": [{"center": [0, 0, 0], "radius": 1e-6, "height": 2e-6}],
    "planes": [{"center": [0, 0, 0], "size": [1, 1]}],
    "discs": [{"center": [0, 0, 0], "radius": 1}],
    "meshes": [
        {
            "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            "triangles": [[0, 1, 2]],
            "uv": [[0, 0], [0, 0], [0, 0]],
            "colors": [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
            "position": [0, 0, 0],
            "scale": 1,
        }
    ],
    "markers": {
        "radius": 1,
        "start": [0, 0, 0],
        "waypoints": [[0, 0, 0]],
        "goal": [0, 0, 0],
        "spawn_box": {"min": [0, 0, 0], "max": [0, 0, 0]},
    },
    "light": {
        **{color: [0, 0, 0] for color in COLORS},
        "sun_direction": [0, 0, 1],
        "gamma": 1,
        "sun_radius_deg": 0,
        "sun_glow": 0,
        "fog_visibility_m": 0,
    },
}
#: The limits of its numbers, by path.
LIMITS = {
    "materials/a/base_color/0": (0, 1),
    "materials/a/emissive/1": (0, 100),
    "materials/a/semantic": (1, 65532),
    "materials/a/alpha_cutoff": (0, 1),
    "pillars/0/center/1": (-1e6, 1e6),
    "pillars/0/radius": (1e-6, 1e6),
    "pillars/0/z/1": (None, 1e6),
    "cylinders/0/radius": (1e-6, 1e6),
    "cylinders/0/height": (2e-6, 2e6),
    "boxes/0/center/2": (-1e6, 1e6),
    "boxes/0/size/1": (2e-6, 2e6),
    "spheres/0/radius": (1e-6, 1e6),
    "capsules/0/height": (2e-6, 2e6),
    "planes/0/size/0": (2e-6, 2e6),
    "discs/0/radius": (1e-6, 1e6),
    "meshes/0/vertices/1/0": (None, 1e6),
    "meshes/0/uv/0/1": (-1e6, 1e6),
    "meshes/0/colors/2/2": (0, 1),
    "meshes/0/position/2": (-1e6, 1e6),
    "meshes/0/scale": (1e-6, 1e6),
    "markers/radius": (1e-6, 1e6),
    "markers/start/0": (-1e6, 1e6),
    "markers/waypoints/0/1": (-1e6, 1e6),
    "markers/goal/2": (-1e6, 1e6),
    "markers/spawn_box/min/0": (-1e6, None),
    "markers/spawn_box/max/0": (None, 1e6),
    **{f"light/{color}/0": (0, 100) for color in COLORS},
    "light/sun_direction/0": (-1e6, 1e6),
    "light/gamma": (1, 4),
    "light/sun_radius_deg": (0.1, 45),
    "light/sun_glow": (0, 1),
    "light/fog_visibility_m": (0.1, 1e6),
}


def accepted_by_schema(scene):
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(scene)


def accepted_by_loader(scene):
    try:
        flockstep.World.from_dict(scene)
    except ValueError:
        return False
    return True


def with_value(place, value):
    """Return FULL with another value at a path."""
    scene = copy.deepcopy(FULL)
    *way, last = (int(step) if step.isdigit() else step for step in place.split("/"))
    parent = scene
    for step in way:
        parent = parent[step]
    parent[last] = value
    return scene


class TestSchemaAndLoader:
    @pytest.mark.parametrize("place", LIMITS)
    def test_have_these_limits(self, place):
        for end, outwards in zip(LIMITS[place], (-1, 1), strict=True):
            if end is None:  # another rule applies first
                continue
            at, beyond = with_value(place, end), with_value(place, end + outwards * (abs(end) or 1) * 1e-3)
            assert accepted_by_schema(at)
            assert accepted_by_loader(at)
            assert not accepted_by_schema(beyond)
            with pytest.raises(ValueError, match=place.rsplit("/", 1)[0].replace("/", ".")):
                flockstep.World.from_dict(beyond)

    BALL: ClassVar = {"center": [0, 0, 0], "radius": 1}
    TRIANGLE: ClassVar = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}

    @pytest.mark.parametrize(
        "scene",
        [
            {"spheres": [{**BALL, "visible": False}]},
            {"spheres": [{**BALL, "solid": False}, BALL]},
            {"pillars": [{**BALL, "center": [0, 0], "z": [0, 1]}]},
            {"room": {"min": [0, 0, 0], "max": [1, 1, 1]}, "pillars": [{**BALL, "center": [0, 0]}]},
            {"room": {"min": [0, 0, 0], "max": [1, 1, 1]}, "spheres": []},
            {"meshes": [{**TRIANGLE, "uv": [[0, 0]] * 3, "colors": [[1, 1, 1]] * 3}]},
            {"meshes": [{"vertices": [], "triangles": []}, TRIANGLE]},
            {"$schema": "schema.json", "spheres": [BALL]},
        ],
    )
    def test_accept(self, scene):
        scene = {"flockstep_scene": 1, **scene}
        jsonschema.validate(scene, SCHEMA)
        flockstep.World.from_dict(scene)

    @pytest.mark.parametrize(
        "scene",
        [
            {},
            {"spheres": []},
            {"spheres": [{**BALL, "solid": False}]},  # nothing is solid
            {"meshes": [{**TRIANGLE, "solid": False}]},
            {"meshes": [{"vertices": [], "triangles": []}]},
            {"spheres": [BALL, {**BALL, "visible": False, "solid": False}]},
            {"pillars": [{**BALL, "center": [0, 0]}]},  # no height
            {"meshes": [TRIANGLE, {"vertices": [[0, 0, 0]]}]},
            {"meshes": [TRIANGLE, {**TRIANGLE, "file": "a.obj"}]},
            {"meshes": [TRIANGLE, {"file": "a.obj", "uv": []}]},
            {"meshes": [TRIANGLE, {"uv": []}]},
            {"spheres": [BALL], "textures": {"a": {}}},
            {"spheres": [BALL], "textures": {"a": {"file": "a.png", "png_base64": ""}}},
        ],
    )
    def test_refuse(self, scene):
        scene = {"flockstep_scene": 1, **scene}
        assert not accepted_by_schema(scene)
        assert not accepted_by_loader(scene)


@pytest.mark.parametrize("name", [*scenes.SETS["camera-train"], *scenes.SETS["camera-validation"]])
def test_camera_playgrounds_are_white_with_pillars_that_no_marker_looks_like(name):
    world = flockstep.World.load(name)
    color = {m["name"]: np.array(m["base_color"]) for m in world.materials}
    kinds = {(p["kind"], p["material"]) for p in world.primitives}
    assert kinds == {("room", "white"), ("cylinder", "pillar")}
    np.testing.assert_allclose(color["white"], 0.9)
    assert color["pillar"].argmax() == 2  # bluish
    assert np.ptp(color["pillar"]) < 0.3  # nearly grey


class TestLoad:
    def test_a_set(self):
        assert [w.name for w in scenes.load("train")] == list(scenes.SETS["train"])

    def test_a_name(self):
        assert [w.name for w in scenes.load("playground/validation-1")] == ["playground/validation-1"]

    def test_a_world(self, room):
        assert scenes.load(room) == [room]

    def test_paths_as_text_and_as_path(self, tmp_path, room):
        path = tmp_path / "a.json"
        room.save(path)
        assert [w.name for w in scenes.load([str(path), path])] == ["room", "room"]

    def test_a_mixture_in_its_order(self, room):
        worlds = scenes.load([room, "validation", "playground/train-1"])
        assert [w.name for w in worlds] == [
            "room",
            "playground/validation-1",
            "playground/validation-2",
            "playground/train-1",
        ]

    def test_a_repeated_scene_is_one_world(self):
        first, second = scenes.load(["playground/train-1"] * 2)
        assert first is second

    def test_an_unknown_name_says_where_names_are_listed(self):
        with pytest.raises(ValueError, match=r"unknown scene 'x': .*; flockstep\.scenes\.names\(\) lists all"):
            scenes.load("x")

    def test_a_missing_file(self):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.json"):
            scenes.load(Path("nowhere.json"))

    def test_no_world_at_all(self):
        with pytest.raises(ValueError, match="at least one"):
            scenes.load([])

    def test_neither_a_world_nor_a_name(self):
        with pytest.raises(TypeError, match="int"):
            scenes.load([3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"flockstep_scene": 1, "room"', "json"),  # truncated
        ("[]", "object"),
        ('{"flockstep_scene": 2, "room": {"min": [0,0,0], "max": [1,1,1]}}', "/flockstep_scene.*version 1"),
        ('{"flockstep_scene": 1, "room": {"min": [0,0,0], "max": [1,1,1]}, "wals": []}', "/wals.*unknown field"),
        ('{"flockstep_scene": 1, "room": {"min": [0,0], "max": [1,1,1]}}', "/room/min.*3 numbers"),
        ('{"flockstep_scene": 1, "room": {"min": [2,0,0], "max": [1,1,1]}}', "/room.*min < max"),
        ('{"flockstep_scene": 1, "boxes": [{"center": [0,0,0], "size": [1,1,"one"]}]}', "/boxes/0/size/2"),
        ('{"flockstep_scene": 1, "spheres": [{"center": [0,0,0], "radius": -1}]}', "/spheres/0/radius"),
        ('{"flockstep_scene": 1}', "empty scene"),
    ],
)
def test_a_mistake_in_a_scene_file_is_named_with_its_place(tmp_path, text, message):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"(?is)broken\.json.*{message}"):
        flockstep.World.load(path)


def test_a_degenerate_triangle_is_refused(tmp_path):
    path = tmp_path / "flat.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(ValueError, match=r"(?i)flat\.obj.*triangle"):
        flockstep.World.load(path)


def test_an_index_out_of_range_is_refused(tmp_path):
    path = tmp_path / "wild.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(ValueError, match=r"(?i)wild\.obj.*9"):
        flockstep.World.load(path)


@pytest.mark.parametrize("name", ["one.obj", "ONE.OBJ"])
def test_an_obj_file_is_a_world(tmp_path, name):
    path = tmp_path / name
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = flockstep.World.load(path).mesh()
    assert mesh["triangles"].shape == (1, 3)
    np.testing.assert_array_equal(mesh["vertices"][mesh["triangles"][0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


PNG = "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAIAAAB7QOjdAAAADUlEQVR4nGP4zwAE/wEHAAH/4iOeWQAAAABJRU5ErkJggg=="


def textured(texture, **mesh):
    corners = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]], "material": "wood"}
    materials = {"wood": {"base_color": [1, 1, 1], "texture": "planks"}}
    return {
        "flockstep_scene": 1,
        "textures": {"planks": texture},
        "materials": materials,
        "meshes": [{**corners, **mesh}],
    }


class TestTextures:
    """The schema accepts the same textures as the loader."""

    @pytest.mark.parametrize(
        ("texture", "mesh"),
        [
            ({"png_base64": PNG}, {}),
            ({"png_base64": PNG, "wrap": ["mirror", "clamp"]}, {"uv": [[0, 0], [1.5, 0], [0, -1]]}),
        ],
    )
    def test_accepted(self, texture, mesh):
        scene = textured(texture, **mesh)
        jsonschema.validate(scene, SCHEMA)
        world = flockstep.World.from_dict(scene)
        saved = world.to_dict()
        jsonschema.validate(saved, SCHEMA)
        assert saved["materials"]["wood"]["texture"] == "planks"
        assert saved["textures"]["planks"].get("wrap", ["repeat", "repeat"]) == texture.get(
            "wrap", ["repeat", "repeat"]
        )
        assert saved["meshes"][0]["uv"] == mesh.get("uv", [[0, 0]] * 3)
        assert flockstep.World.from_dict(saved).to_dict() == saved

    @pytest.mark.parametrize(
        ("texture", "mesh", "place"),
        [
            ({}, {}, "/textures/planks"),
            ({"png_base64": PNG, "file": "planks.png"}, {}, "/textures/planks"),
            ({"png_base64": 3}, {}, "/textures/planks/png_base64"),
            ({"png_base64": PNG, "wrap": ["clamp"]}, {}, "/textures/planks/wrap"),
            ({"png_base64": PNG, "wrap": ["clamp", "tile"]}, {}, "/textures/planks/wrap"),
            ({"png_base64": PNG, "size": 2}, {}, "/textures/planks/size"),
            ({"png_base64": PNG}, {"uv": [[0, 0], [0, 0, 0], [0, 0]]}, "/meshes/0/uv"),
            ({"png_base64": PNG}, {"uv": [[0, 0], [0, 1e7], [0, 0]]}, "/meshes/0/uv"),
        ],
    )
    def test_refused(self, texture, mesh, place):
        scene = textured(texture, **mesh)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, SCHEMA)
        with pytest.raises(ValueError, match=place):
            flockstep.World.from_dict(scene)


def a_gltf_file(path, **more):
    corners = base64.b64encode(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)).decode()
    gltf = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{corners}"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}, {"name": "start", "translation": [1, 2, 3]}],
    }
    path.write_text(json.dumps({**gltf, **more}))
    return path


class TestGltf:
    def test_y_is_up(self, tmp_path):
        path = a_gltf_file(tmp_path / "corner.gltf")
        world = flockstep.World.load(path)
        assert world.name == "corner"
        assert world.bounds.tolist() == [[0, 0, 0], [1, 0, 1]]
        assert world.start.tolist() == [1, -3, 2]
        assert flockstep.World.load(path, up="z").bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
        placed = flockstep.World.load(path, scale=2, origin=(1, 2, 3))
        assert placed.bounds.tolist() == [[1, 2, 3], [3, 2, 5]]

    def test_ignored_parts_are_named(self, tmp_path):
        path = a_gltf_file(tmp_path / "corner.gltf", animations=[{}], skins=[{}, {}])
        with pytest.warns(UserWarning, match=r"corner\.gltf: ignored 1 animation, 2 skins"):
            flockstep.World.load(path)

    @pytest.mark.parametrize("wrong", [{"up": "x"}, {"scale": 0}, {"origin": (0, 0, float("nan"))}])
    def test_refused(self, tmp_path, wrong):
        path = a_gltf_file(tmp_path / "corner.gltf")
        with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: expected"):
            flockstep.World.load(path, **wrong)
