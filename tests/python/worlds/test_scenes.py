"""Scene files: the bundled ones, and the resolution of names and paths."""

import copy
import importlib.util
import json
import re
from fnmatch import fnmatch
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from conftest import ROOT, world_of
from messages import refused

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


def test_what_save_writes_keeps_to_the_schema(tmp_path, room):
    room.save(tmp_path / "saved.json")
    jsonschema.validate(json.loads((tmp_path / "saved.json").read_text()), SCHEMA)
    assert flockstep.World.load(tmp_path / "saved.json").to_dict() == room.to_dict()


COLORS = ["sun_color", "sky_ambient", "ground_ambient", "zenith_color", "horizon_color"]
POSE = {"center": [0, 0, 1], "quat_wxyz": [0.6, 0.8, 0, 0]}
BALL = {"center": [0, 0, 0], "radius": 1}
TRIANGLE = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}
ROOM = {"min": [0, 0, 0], "max": [1, 1, 1]}
RED = {"red": {"base_color": [1, 0, 0]}}
PNG = "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAIAAAB7QOjdAAAADUlEQVR4nGP4zwAE/wEHAAH/4iOeWQAAAABJRU5ErkJggg=="


def with_light(**light):
    return {"room": ROOM, "light": light}


def with_semantic(semantic):
    materials = {"wall": {"base_color": [1, 1, 1], "semantic": semantic}}
    return {"materials": materials, "room": {**ROOM, "material": "wall"}}


def textured(texture, **mesh):
    return {
        "textures": {"planks": texture},
        "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}},
        "meshes": [{**TRIANGLE, "material": "wood", **mesh}],
    }


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


def with_value(place, value):
    """Return FULL with another value at a path."""
    scene = copy.deepcopy(FULL)
    *way, last = (int(step) if step.isdigit() else step for step in place.split("/"))
    parent = scene
    for step in way:
        parent = parent[step]
    parent[last] = value
    return scene


def expect_refused(scene, *places):
    scene = {"flockstep_scene": 1, **scene}
    assert not jsonschema.Draft202012Validator(SCHEMA).is_valid(scene)
    with refused(ValueError, "scene", *places):
        flockstep.World.from_dict(scene)


class TestSchemaAndLoader:
    """The schema accepts the same scenes as the loader."""

    @pytest.mark.parametrize("place", LIMITS)
    def test_have_these_limits(self, place):
        for end, outwards in zip(LIMITS[place], (-1, 1), strict=True):
            if end is None:  # another rule applies first
                continue
            at, beyond = with_value(place, end), with_value(place, end + outwards * (abs(end) or 1) * 1e-3)
            jsonschema.validate(at, SCHEMA)
            flockstep.World.from_dict(at)
            expect_refused(beyond, "/" + place.rsplit("/", 1)[0])

    @pytest.mark.parametrize(
        "scene",
        [
            {"capsules": [{"center": [0, 0, 1], "radius": 0.5, "height": 2}]},
            {"materials": RED, "capsules": [{**POSE, "radius": 0.5, "height": 1, "material": "red"}]},  # a ball
            {"planes": [{"center": [0, 0, 1], "size": [1, 2]}]},
            {"materials": RED, "planes": [{**POSE, "size": [2e-6, 2e-6], "material": "red"}]},
            {"discs": [{"center": [0, 0, 1], "radius": 1e-6}]},
            {"materials": RED, "discs": [{**POSE, "radius": 0.5, "material": "red"}]},
            *(
                with_light(**light)
                for light in (
                    *({}, {"sun_direction": [0, 0, -1e6]}, {"sun_direction": [1e-300, 0, 0]}, {"gamma": 4.0}),
                    *({"sun_radius_deg": 45}, {"sun_glow": 1}, {"fog_visibility_m": 0.1}),
                    *({color: [0, 0.5, 100]} for color in COLORS),
                )
            ),
            *(with_semantic(semantic) for semantic in (1, 7, 7.0, 65532)),
            textured({"png_base64": PNG}),
            textured({"png_base64": PNG, "wrap": ["mirror", "clamp"]}, uv=[[0, 0], [1.5, 0], [0, -1]]),
            {"spheres": [{**BALL, "visible": False}]},
            {"spheres": [{**BALL, "solid": False}, BALL]},
            {"pillars": [{**BALL, "center": [0, 0], "z": [0, 1]}]},
            {"room": ROOM, "pillars": [{**BALL, "center": [0, 0]}]},
            {"room": ROOM, "spheres": []},
            {"meshes": [{**TRIANGLE, "uv": [[0, 0]] * 3, "colors": [[1, 1, 1]] * 3}]},
            {"meshes": [{"vertices": [], "triangles": []}, TRIANGLE]},
            {"$schema": "schema.json", "spheres": [BALL]},
        ],
    )
    def test_accept(self, scene):
        """The schema also accepts a scene that was read and saved."""
        scene = {"flockstep_scene": 1, **scene}
        jsonschema.validate(scene, SCHEMA)
        saved = flockstep.World.from_dict(scene).to_dict()
        jsonschema.validate(saved, SCHEMA)
        assert flockstep.World.from_dict(saved).to_dict() == saved
        assert set(saved.get("light", {})) == set(scene.get("light", {}))
        assert saved.get("materials", {}).keys() >= scene.get("materials", {}).keys()
        for name, texture in scene.get("textures", {}).items():
            assert saved["textures"][name].get("wrap") == texture.get("wrap")
            assert saved["meshes"][0]["uv"] == scene["meshes"][0].get("uv", [[0, 0]] * 3)

    @pytest.mark.parametrize(
        ("kind", "solid"),
        [
            *(("capsules", {**POSE, **rest}) for rest in ({"radius": 0.5}, {"height": 2})),
            ("capsules", {"radius": 0.5, "height": 2}),
            ("capsules", {**POSE, "radius": 0.5, "height": "2"}),
            ("capsules", {**POSE, "radius": 0.5, "height": 2, "size": [1, 1]}),
            ("planes", {"size": [1, 1]}),
            *(("planes", {**POSE, "size": size}) for size in ([1], [1, 1, 1], [1, 0], [-1, 1], [1e-6, 1], 1)),
            *(("planes", {**POSE, **rest}) for rest in ({}, {"size": [1, 1], "thickness": 0})),
            ("discs", {"radius": 1}),
            *(("discs", {**POSE, **rest}) for rest in ({}, {"radius": 1, "height": 0})),
            ("discs", {**POSE, "radius": 1, "quat_wxyz": [1, 0, 0]}),
            ("discs", {"center": [0, 0], "radius": 1}),
            ("discs", {"center": [0, 0, 1], "radius": 1, "material": 0}),
        ],
    )
    def test_refuse_solids(self, kind, solid):
        expect_refused({kind: [solid]}, f"/{kind}/0")

    @pytest.mark.parametrize(
        ("place", "scene"),
        [
            *(
                (f"/{kind}", {"spheres": [BALL], kind: value})
                for kind in ("capsules", "planes", "discs")
                for value in ({}, 3, None, [3])
            ),
            ("/light/sun", with_light(sun=[0, 0, 1])),
            *(
                ("/light/sun_direction", with_light(sun_direction=value))
                for value in ([0, 0, 0], [0, -0.0, 0.0], [0, 1], [0, 0, 0, 1], [0, 0, "1"], 1)
            ),
            *(
                (f"/light/{color}", with_light(**{color: value}))
                for color in COLORS
                for value in ([0, 0], [0, 0, True], 1, None)
            ),
            *(("/light/gamma", with_light(gamma=value)) for value in ("2", None)),
            ("/light/sun_radius_deg", with_light(sun_radius_deg=0.05)),
            ("/light/fog_visibility_m", with_light(fog_visibility_m=-1)),
            *(("/light", {"room": ROOM, "light": light}) for light in ([], 1, None)),
            *(
                ("/materials/wall/semantic", with_semantic(semantic))
                for semantic in (0, -1, 1.5, 65533, 1e30, "7", True, None, [7])
            ),
            ("/textures/planks", textured({})),
            ("/textures/planks", textured({"png_base64": PNG, "file": "planks.png"})),
            ("/textures/planks/png_base64", textured({"png_base64": 3})),
            *(("/textures/planks/wrap", textured({"png_base64": PNG, "wrap": w})) for w in (["clamp"], ["clamp", "x"])),
            ("/textures/planks/size", textured({"png_base64": PNG, "size": 2})),
            *(
                ("/meshes/0/uv", textured({"png_base64": PNG}, uv=[[0, 0], corner, [0, 0]]))
                for corner in ([0, 0, 0], [0, 1e7])
            ),
            ("/walls", {"room": ROOM, "walls": 7}),
            ("/flockstep_scene", {"room": ROOM, "flockstep_scene": 7}),
        ],
    )
    def test_refuse_with_the_place(self, place, scene):
        expect_refused(scene, place)

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
        expect_refused(scene)

    def test_what_a_schema_cannot_say(self):
        """It cannot compare two fields; its description states the rule."""
        scene = {"flockstep_scene": 1, "capsules": [{**POSE, "radius": 0.5, "height": 0.99}]}
        jsonschema.validate(scene, SCHEMA)
        with refused(ValueError, "scene", "/capsules/0/height", 0.99):
            flockstep.World.from_dict(scene)
        assert SCHEMA["properties"]["meshes"]["maxItems"] == 65536
        with refused(ValueError, "scene", "/meshes", 65536, 65537):
            world_of(meshes=[0] * 65537)

    def test_the_schema_has_the_defaults(self):
        light = world_of(room=ROOM).light
        properties = SCHEMA["properties"]["light"]["properties"]
        assert list(light) == list(properties)
        for field, value in light.items():
            np.testing.assert_array_equal(np.float32(properties[field]["default"]), np.float32(value), err_msg=field)


@pytest.mark.parametrize("name", [*scenes.SETS["camera-train"], *scenes.SETS["camera-validation"]])
def test_camera_playgrounds_are_white_with_pillars_that_no_marker_looks_like(name):
    world = flockstep.World.load(name)
    color = {m["name"]: np.array(m["base_color"]) for m in world.materials}
    kinds = {(p["kind"], p["material"]) for p in world.primitives}
    assert kinds == {("room", "white"), ("cylinder", "pillar")}
    np.testing.assert_allclose(color["white"], 0.9)
    assert color["pillar"].argmax() == 2  # bluish
    assert np.ptp(color["pillar"]) < 0.3  # nearly grey


def test_what_load_takes(tmp_path, room):
    def names(given):
        return [world.name for world in scenes.load(given)]

    path = tmp_path / "a.json"
    room.save(path)
    assert names("train") == list(scenes.SETS["train"])
    assert names("playground/validation-1") == ["playground/validation-1"]
    assert scenes.load(room) == [room]
    assert names([str(path), path]) == ["room", "room"]
    mixture = [room, "validation", "playground/train-1"]
    assert names(mixture) == ["room", "playground/validation-1", "playground/validation-2", "playground/train-1"]


def test_what_load_refuses():
    for error, given, said in (
        (ValueError, "x", ("unknown scene", "x", "flockstep.scenes.names()")),
        (FileNotFoundError, Path("nowhere.json"), ("nowhere.json",)),
        (ValueError, [], ("worlds", "at least one")),
        (TypeError, [3], ("worlds", "int")),
        (ValueError, "jungle/seed-3", ("unknown scene", "jungle/seed-3", "arena/hall", "forest/seed-7")),
        (ValueError, "forest/seed-", ("unknown scene",)),
        (ValueError, "living_ofice/seed-7", ("unknown scene", "living_office/seed-0")),
        (ValueError, "forest/seed-5..4", ("1 to 100000 seeds",)),
        (ValueError, "forest/seed-0..100000", ("1 to 100000 seeds",)),
    ):
        with refused(error, *said):
            scenes.load(given)
    with refused(ValueError, "unknown scene"):  # a range is not one world
        flockstep.World.load("forest/seed-1..2")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"flockstep_scene": 1, "room"', ()),  # truncated
        ("[]", ("object",)),
        ('{"flockstep_scene": 2, "room": {"min": [0,0,0], "max": [1,1,1]}}', ("/flockstep_scene", 1)),
        ('{"flockstep_scene": 1, "boxes": [{"center": [0,0,0], "size": [1,1,"one"]}]}', ("/boxes/0/size/2",)),
    ],
)
def test_a_mistake_in_a_scene_file_is_named_with_its_place(tmp_path, text, said):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with refused(ValueError, "broken.json", *said):
        flockstep.World.load(path)


@pytest.mark.parametrize("name", ["one.obj", "ONE.OBJ"])
def test_an_obj_file_is_a_world(tmp_path, name):
    path = tmp_path / name
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = flockstep.World.load(path).mesh()
    assert mesh["triangles"].shape == (1, 3)
    np.testing.assert_array_equal(mesh["vertices"][mesh["triangles"][0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_the_page_has_the_sizes_of_all_bundled_worlds():
    page = (ROOT / "docs" / "how-to" / "worlds" / "pictures-and-videos.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w/*-]+)`.* \| ([\d. x]+) \| ([\d,]+) \|$", page, re.MULTILINE)
    for name in flockstep.scenes.names():
        ((_, size, triangles),) = [row for row in rows if fnmatch(name, row[0])]
        world = flockstep.World.load(name).check()
        shown = " x ".join(f"{metres:.3g}" for metres in world["size_m"])
        assert (size, triangles) == (shown, f"{world['triangles']:,}"), name
