"""Scene files: the shipped ones, and how names and paths are resolved."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import swiftlet
from swiftlet import scenes

SHIPPED = scenes.names()
SCHEMA = json.loads((scenes.directory() / "schema.json").read_text())


def test_the_eleven_playgrounds_are_shipped():
    expected = [name for members in scenes.SETS.values() for name in members]
    assert len(expected) == 11
    assert set(expected) <= set(SHIPPED)


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_keep_to_the_schema(name):
    jsonschema.validate(json.loads(scenes.resolve(name).read_text()), SCHEMA)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load(name):
    world = swiftlet.World.load(name)
    assert world.name == name
    assert world.start is not None
    assert world.goal is not None


def test_what_save_writes_keeps_to_the_schema(tmp_path, room):
    room.save(tmp_path / "saved.json")
    jsonschema.validate(json.loads((tmp_path / "saved.json").read_text()), SCHEMA)
    assert swiftlet.World.load(tmp_path / "saved.json").to_dict() == room.to_dict()


@pytest.mark.parametrize("key", ["walls", "swiftlet_scene"])
def test_schema_and_loader_refuse_alike(room, key):
    scene = room.to_dict()
    scene[key] = 7
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(scene, SCHEMA)
    with pytest.raises(ValueError, match=key):
        swiftlet.World.from_dict(scene)


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

    def test_an_unknown_name_lists_those_that_exist(self):
        with pytest.raises(
            ValueError, match=r"unknown scene 'playground/x'.*playground/train-1.*sets train, validation"
        ):
            scenes.load("playground/x")

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
        ('{"swiftlet_scene": 1, "room"', "json"),  # truncated
        ("[]", "object"),
        ('{"swiftlet_scene": 2, "room": {"min": [0,0,0], "max": [1,1,1]}}', "/swiftlet_scene.*version 1"),
        ('{"swiftlet_scene": 1, "room": {"min": [0,0,0], "max": [1,1,1]}, "wals": []}', "/wals.*unknown field"),
        ('{"swiftlet_scene": 1, "room": {"min": [0,0], "max": [1,1,1]}}', "/room/min.*3 numbers"),
        ('{"swiftlet_scene": 1, "room": {"min": [2,0,0], "max": [1,1,1]}}', "/room.*min < max"),
        ('{"swiftlet_scene": 1, "boxes": [{"center": [0,0,0], "size": [1,1,"one"]}]}', "/boxes/0/size/2"),
        ('{"swiftlet_scene": 1, "spheres": [{"center": [0,0,0], "radius": -1}]}', "/spheres/0/radius"),
        ('{"swiftlet_scene": 1}', "empty scene"),
    ],
)
def test_a_mistake_in_a_scene_file_is_named_with_its_place(tmp_path, text, message):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"(?is)broken\.json.*{message}"):
        swiftlet.World.load(path)


def test_a_degenerate_triangle_is_refused(tmp_path):
    path = tmp_path / "flat.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(ValueError, match=r"(?i)flat\.obj.*triangle"):
        swiftlet.World.load(path)


def test_an_index_out_of_range_is_refused(tmp_path):
    path = tmp_path / "wild.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(ValueError, match=r"(?i)wild\.obj.*9"):
        swiftlet.World.load(path)


def test_an_obj_file_is_a_world(tmp_path):
    path = tmp_path / "one.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    vertices, triangles = swiftlet.World.load(path).mesh()
    assert triangles.shape == (1, 3)
    np.testing.assert_array_equal(vertices[triangles[0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
