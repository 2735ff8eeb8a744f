"""`Batch.set_light`: the light of a world changes while a batch flies."""

import numpy as np
import pytest
from messages import refused

import flockstep

DARK = {"sun_color": (0.1, 0.1, 0.3), "sky_ambient": (0.1, 0.1, 0.2), "sun_direction": (-1.0, 0.2, 0.3)}
WORLDS = ["playground/train-1", "outdoor/forest"]


def loaded():
    return [flockstep.World.load(name) for name in WORLDS]


def batch_in(worlds, backend="raycast", num_drones=4, **camera):
    camera = flockstep.CameraConfig(
        **{"width_px": 64, "height_px": 48, "outputs": ["rgb", "depth"], "shadows": True, **camera}
    )
    batch = flockstep.Batch(worlds, num_drones, cameras=[camera], camera_backend=backend)
    batch.set_pose([np.add(batch.world_of(i).start, (0, 0, 1 + 0.1 * i)) for i in range(num_drones)])
    return batch


@pytest.mark.parametrize("backend", ["raycast", "gl"])
@pytest.mark.parametrize("change", [DARK, {"gamma": 1.0}, {"tint": (0.4, 1.0, 0.7)}, {"fog_visibility_m": 5.0}])
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
        (2, {}, ["world_index", 2]),
        (-1, {}, ["world_index", -1]),
        (0, {"gamma": 0}, ["light.gamma", 0]),
        (0, {"sun_direction": (0, 0, 0)}, ["light.sun_direction"]),
        (1, {"sun_color": (-1, 0, 0)}, ["light.sun_color[0]", -1]),
        (1, {"tint": (11, 1, 1)}, ["tint[0]", "11.000000"]),
        (1, {"tint": [[1, 1, 1]] * 2}, ["tint"]),
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
