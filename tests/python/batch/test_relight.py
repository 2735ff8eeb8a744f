"""Worlds that differ only in their looks."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import flockstep

CAMERA = {"width_px": 96, "height_px": 72, "outputs": ["rgb", "depth"], "shadows": True}


def picture(worlds: list[flockstep.World]) -> flockstep.Camera:
    batch = flockstep.Batch(
        worlds,
        num_drones=len(worlds),
        cameras=[flockstep.CameraConfig(**CAMERA)],
    )
    place = np.add(worlds[0].start, (0, 0, 1))
    batch.set_pose(np.tile(place, (len(worlds), 1)))
    batch.sense()
    return batch.camera()


def test_only_colours_change() -> None:
    worlds = flockstep.relight("outdoor/forest", 3, seed=4)
    traced = picture(worlds)
    assert not np.array_equal(traced.rgb[0], traced.rgb[1])
    assert np.array_equal(traced.depth[0], traced.depth[1])


def test_the_same_seed_draws_the_same_looks() -> None:
    first, again = flockstep.relight("playground/train-1", 3, 7), flockstep.relight("playground/train-1", 5, 7)
    assert [world.to_dict() for world in first] == [world.to_dict() for world in again[:3]]
    assert first[0].light != first[1].light
    assert first[0].to_dict() != flockstep.relight("playground/train-1", 1, 8)[0].to_dict()
    for world in flockstep.relight("outdoor/city", 20, elevation_deg=(30, 40), azimuth_deg=(90, 90), tint=0):
        x, y, z = world.light["sun_direction"]
        assert abs(x) < 1e-6 and y > 0
        assert 29.9 < np.degrees(np.arcsin(z)) < 40.1
        assert world.materials == flockstep.World.load("outdoor/city").materials


def test_fog_in_a_range_changes_nothing_else() -> None:
    clear, foggy = (flockstep.relight("outdoor/city", 8, 3, fog_visibility_m=fog) for fog in (None, (10, 40)))
    for before, after in zip(clear, foggy, strict=True):
        assert before.light["fog_visibility_m"] == 0
        assert 10 <= after.light["fog_visibility_m"] <= 40
        assert {**after.light, "fog_visibility_m": 0} == before.light
        assert after.materials == before.materials
    assert len({world.light["fog_visibility_m"] for world in foggy}) == 8


def test_a_light_of_ones_own() -> None:
    world = flockstep.World.load("playground/train-1")
    red = world.with_light(sun_color=(1, 0, 0), tint=(0.5, 1, 1))
    assert red.light == {**world.light, "sun_color": (1.0, 0.0, 0.0)}
    for before, after in zip(world.materials, red.materials, strict=True):
        assert np.allclose(after["base_color"], np.multiply(before["base_color"], (0.5, 1, 1)))
    assert pickle.loads(pickle.dumps(red)).to_dict() == red.to_dict()
    assert world.with_light().to_dict() == world.to_dict()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tint": np.ones((5, 3))}, "tint: expected"),
        ({"tint": (1, -1, 1)}, "tint"),
        ({"tint": (1, np.nan, 1)}, "tint"),
        ({"tint": (1, 2)}, "tint"),
        ({"gamma": 0.5}, "light.gamma: expected"),
        ({"sun_direction": (0, 0, 0)}, "light.sun_direction: expected"),
        ({"sun_color": (np.inf, 0, 0)}, r"light.sun_color\[0\]: expected"),
        ({"fog_visibility_m": 0.01}, "light.fog_visibility_m: expected 0 or a number in"),
    ],
)
def test_an_invalid_light(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        flockstep.World.load("playground/train-1").with_light(**arguments)


def test_misspelt_fields_of_a_light() -> None:
    world = flockstep.World.load("playground/train-1")
    batch = flockstep.Batch([world])
    for change in (world.with_light, flockstep.WorldBuilder().light, batch.set_light):
        with pytest.raises(TypeError, match="unexpected keyword argument 'gama'"):
            change(gama=None)  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="gamma: expected a number, got 'bright'"):
            change(gamma="bright")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 0}, "count: expected an integer >= 1, got 0"),
        ({"count": True}, "count: expected"),
        ({"count": 2, "seed": -1}, "seed: expected"),
        ({"count": 2, "elevation_deg": (50, 20)}, "elevation_deg: expected"),
        ({"count": 2, "sun": (np.nan, 1)}, "sun: expected"),
        ({"count": 2, "sun": 1.2}, r"sun: expected two numbers \(low, high\) in"),
        ({"count": 2, "ambient": "bright"}, "ambient: expected"),
        ({"count": 2, "azimuth_deg": (0, 1, 2)}, "azimuth_deg: expected"),
        ({"count": 2, "tint": None}, "tint: expected a number"),
        ({"count": 2, "tint": 1.5}, "tint: expected"),
        (
            {"count": 2, "fog_visibility_m": (0.0, 5.0)},
            r"fog_visibility_m: expected two numbers \(low, high\) in \[0.1",
        ),
        ({"count": 2, "fog_visibility_m": 20}, "fog_visibility_m: expected"),
        ({"count": 2, "world": "train"}, "world: expected one world, got 5"),
    ],
)
def test_invalid_appearances(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        flockstep.relight(**{"world": "playground/train-1", **arguments})
