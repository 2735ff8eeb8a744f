"""Worlds that differ only in their looks, and worlds whose light changes while a batch flies."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from messages import refused

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
    city = flockstep.World.load("outdoor/city")
    for world in flockstep.relight(city, 20, elevation_deg=(30, 40), azimuth_deg=(90, 90), tint=0):
        x, y, z = world.light["sun_direction"]
        assert abs(x) < 1e-6 and y > 0
        assert 29.9 < np.degrees(np.arcsin(z)) < 40.1
        assert world.materials == city.materials


def test_fog_in_a_range_changes_nothing_else() -> None:
    clear, foggy = (flockstep.relight("playground/train-1", 8, 3, fog_visibility_m=fog) for fog in (None, (10, 40)))
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
    ("arguments", "said"),
    [
        ({"tint": np.ones((5, 3))}, ["tint", 2, 5]),
        ({"tint": (1, -1, 1)}, ["tint[1]", 0, 10, -1]),
        ({"tint": (1, np.nan, 1)}, ["tint[1]", np.nan]),
        ({"tint": (1, 2)}, ["tint", "(N, 3)", (1, 2)]),
        ({"sun_direction": (0, 0, 0)}, ["light.sun_direction", (0, 0, 0)]),
    ],
)
def test_an_invalid_light(arguments: dict[str, Any], said: list[Any]) -> None:
    with refused(ValueError, *said):
        flockstep.World.load("playground/train-1").with_light(**arguments)


def test_misspelt_fields_of_a_light() -> None:
    world = flockstep.World.load("playground/train-1")
    batch = flockstep.Batch([world])
    for change in (world.with_light, flockstep.WorldBuilder().light, batch.set_light):
        with refused(TypeError, "gama"):
            change(gama=None)  # type: ignore[call-arg]
        with refused(TypeError, "gamma", "bright"):
            change(gamma="bright")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"count": 0}, ["count", 1, 0]),
        ({"count": True}, ["count", 1, True]),
        ({"seed": -1}, ["seed", -1]),
        ({"elevation_deg": (50, 20)}, ["elevation_deg", "-90", 90, (50, 20)]),
        ({"sun": (np.nan, 1)}, ["sun", 0, 100, (np.nan, 1)]),
        ({"sun": 1.2}, ["sun", 0, 100, 1.2]),
        ({"ambient": "bright"}, ["ambient", 100, "bright"]),
        ({"azimuth_deg": (0, 1, 2)}, ["azimuth_deg", "-360", 360, (0, 1, 2)]),
        ({"tint": None}, ["tint", 0, 1, None]),
        ({"tint": 1.5}, ["tint", 0, 1, 1.5]),
        ({"fog_visibility_m": (0.0, 5.0)}, ["fog_visibility_m", 0.1, (0.0, 5.0)]),
        ({"fog_visibility_m": 20}, ["fog_visibility_m", 0.1, 20]),
        ({"world": "train"}, ["world", 5, "train"]),
    ],
)
def test_invalid_appearances(arguments: dict[str, Any], said: list[Any]) -> None:
    with refused(ValueError, *said):
        flockstep.relight(**{"world": "playground/train-1", "count": 2} | arguments)


# ------------------------------------------------------------------------------ `Batch.set_light` of a world

DARK = {"sun_color": (0.1, 0.1, 0.3), "sky_ambient": (0.1, 0.1, 0.2), "sun_direction": (-1.0, 0.2, 0.3)}
WORLDS = ["playground/train-1", "outdoor/forest"]


def loaded():
    return [flockstep.World.load(name).with_light(fog_visibility_m=0) for name in WORLDS]  # gl draws none


def batch_in(worlds, backend="raycast", num_drones=4, **camera):
    camera = flockstep.CameraConfig(
        **{"width_px": 64, "height_px": 48, "outputs": ["rgb", "depth"], "shadows": backend == "raycast", **camera}
    )
    batch = flockstep.Batch(worlds, num_drones, cameras=[camera], camera_backend=backend)
    batch.set_pose([np.add(batch.world_of(i).start, (0, 0, 1 + 0.1 * i)) for i in range(num_drones)])
    return batch


CHANGES = [DARK, {"gamma": 1.0}, {"tint": (0.4, 1.0, 0.7)}, {"fog_visibility_m": 5.0}]


@pytest.mark.parametrize(
    ("backend", "change"), [*(("raycast", change) for change in CHANGES), *(("gl", change) for change in CHANGES[:3])]
)
def test_the_frames_are_those_of_a_batch_made_with_the_relit_world(backend, change):
    worlds = loaded()
    changed, made = batch_in(worlds, backend), batch_in([worlds[0], worlds[1].with_light(**change)], backend)
    changed.sense()
    before = changed.camera().rgb.copy()
    changed.set_light(1, **change)
    np.testing.assert_array_equal(changed.camera().frame_step, [0, -1, 0, -1])
    for batch in (changed, made):
        batch.capture()
    np.testing.assert_array_equal(changed.camera().rgb, made.camera().rgb)
    np.testing.assert_array_equal(changed.camera().depth, made.camera().depth)
    np.testing.assert_array_equal(changed.camera().rgb[::2], before[::2])
    assert (changed.camera().rgb[1::2] != before[1::2]).mean() > 0.3


def test_the_worlds():
    """The batch shows the relit world; the object that it was made with and other batches keep their light."""
    worlds = loaded()
    batch, other = batch_in(worlds), batch_in(worlds)
    usual = [world.light for world in worlds]
    materials = worlds[1].materials
    batch.set_light(1, **DARK)
    batch.set_light(1, gamma=1.5, tint=[0.5, 0.5, 0.5])
    batch.set_light(1, tint=[0.5, 0.5, 0.5])
    expected = worlds[1].with_light(**DARK).with_light(gamma=1.5, tint=[0.5] * 3).with_light(tint=[0.5] * 3)
    assert batch.worlds[1].to_dict() == expected.to_dict()
    assert batch.worlds[1].light["gamma"] == 1.5
    assert batch.world_of(1).light == batch.world_of(3).light == batch.worlds[1].light
    assert batch.worlds[0] is worlds[0]
    assert [world.light for world in worlds] == usual
    assert worlds[1].materials == materials
    assert all(ours is given for ours, given in zip(other.worlds, worlds, strict=True))
    assert (other.camera().frame_step == batch.camera().frame_step).all()


def test_snapshots():
    worlds = loaded()
    batch, made = batch_in(worlds), batch_in([worlds[0].with_light(**DARK), worlds[1]])
    batch.sense()
    bright = batch.snapshot()
    batch.set_light(0, **DARK)
    with refused(ValueError, "snapshot", "worlds or their light"):
        batch.restore(bright)
    batch.capture()
    made.sense()
    pixels = batch.camera().rgb.copy()
    dark = batch.snapshot()
    made.restore(dark)
    np.testing.assert_array_equal(made.camera().rgb, pixels)
    batch.set_light(0, **worlds[0].light)
    with refused(ValueError, "snapshot", "worlds or their light"):
        batch.restore(dark)
    batch.restore(bright)
    batch.capture()
    assert (batch.camera().rgb != pixels).any()


@pytest.mark.parametrize(
    ("index", "change", "said"),
    [
        (2, {}, ["world_index", 0, "got 2"]),
        (-1, {}, ["world_index", 0, 2, -1]),
        (0, {"gamma": 0}, ["light.gamma", 1, 4, 0]),
        (0, {"sun_direction": (0, 0, 0)}, ["light.sun_direction", (0, 0, 0)]),
        (1, {"sun_color": (-1, 0, 0)}, ["light.sun_color[0]", 100, -1]),
        (1, {"tint": (11, 1, 1)}, ["tint[0]", 11]),
        (1, {"tint": [[1, 1, 1]] * 2}, ["tint", 6, 2]),
    ],
)
def test_refusals(index, change, said):
    batch = batch_in(loaded())
    batch.sense()
    before, worlds = batch.snapshot(), batch.worlds
    with refused(ValueError, *said):
        batch.set_light(index, **change)
    assert batch.snapshot() == before
    assert batch.worlds == worlds
    assert (batch.camera().frame_step >= 0).all()


def test_not_with_a_pool():
    pool = flockstep.WorldPool(lambda number: flockstep.World.playground(seed=number), size=2)
    envs = flockstep.DroneVectorEnv(2, worlds=pool)
    envs.reset(seed=0)
    with refused(ValueError, "set_light"):
        envs.batch.set_light(0, gamma=2)
