"""`Batch.set_light`: the light of a world changes while a batch flies."""

import copy
import gc
import pickle

import numpy as np
import pytest
from gymnasium import spaces

import flockstep

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


def test_the_next_sense_renders_the_new_light():
    batch = batch_in(loaded(), capture_mode="on_movement")
    batch.sense()
    before = batch.camera().rgb.copy()
    batch.set_light(0, **DARK)
    batch.sense()
    changed = (batch.camera().rgb != before).reshape(4, -1).any(axis=1)
    np.testing.assert_array_equal(changed, [True, False, True, False])
    assert (batch.camera().frame_step >= 0).all()


@pytest.mark.parametrize("backend", ["raycast", "gl"])
def test_many_lights(backend):
    """Replaced worlds are freed; a new world at the same address is not mistaken for an old one."""
    world = flockstep.World.load("playground/train-1")
    batch = batch_in([world], backend, 1, shadows=False)
    for step in range(12):
        share = step / 12
        batch.set_light(0, sun_color=(share, 0.2, 1 - share))
        gc.collect()
        batch.capture()
        fresh = batch_in([world.with_light(sun_color=(share, 0.2, 1 - share))], backend, 1, shadows=False)
        fresh.capture()
        np.testing.assert_array_equal(batch.camera().rgb, fresh.camera().rgb)


def test_nothing_but_the_colours_changes():
    def flown(relights):
        worlds = [flockstep.World.load("playground/train-1")]
        envs = flockstep.DroneVectorEnv(3, worlds=worlds, max_episode_steps=20)
        rng = np.random.default_rng(4)
        found = [envs.reset(seed=3)[0].copy()]
        for step in range(60):
            if relights and step % 7 == 0:
                envs.batch.set_light(0, sun_color=(step / 60, 0, 0))
            found += [part.copy() for part in envs.step(rng.integers(0, envs.single_action_space.n, 3))[:4]]
        return found

    for usual, relit in zip(flown(False), flown(True), strict=True):
        np.testing.assert_array_equal(usual, relit)


def test_snapshots():
    worlds = loaded()
    batch, made = batch_in(worlds), batch_in([worlds[0].with_light(**DARK), worlds[1]])
    batch.sense()
    bright = batch.snapshot()
    batch.set_light(0, **DARK)
    with pytest.raises(ValueError, match=r"snapshot: expected .*, got one that differs in worlds or their light$"):
        batch.restore(bright)
    batch.capture()
    made.sense()
    pixels = batch.camera().rgb.copy()
    dark = batch.snapshot()
    made.restore(dark)
    np.testing.assert_array_equal(made.camera().rgb, pixels)
    batch.set_light(0, **worlds[0].light)
    with pytest.raises(ValueError, match="differs in worlds or their light"):
        batch.restore(dark)
    batch.restore(bright)
    batch.capture()
    assert (batch.camera().rgb != pixels).any()


def test_a_copy_of_an_env_has_its_light():
    envs = flockstep.DroneVectorEnv(2, worlds="train", camera=flockstep.CameraConfig(width_px=32, height_px=24))
    envs.reset(seed=1)
    envs.batch.set_light(0, **DARK)
    envs.step([0, 0])
    for other in (copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))):
        assert other.batch.worlds[0].light == envs.batch.worlds[0].light
        np.testing.assert_array_equal(other.batch.camera().rgb, envs.batch.camera().rgb)


@pytest.mark.parametrize(
    ("index", "change", "match"),
    [
        (2, {}, r"world_index: expected an integer in \[0, 2\), got 2"),
        (-1, {}, r"world_index: expected an integer in \[0, 2\), got -1"),
        (0, {"gamma": 0}, "gamma"),
        (0, {"sun_direction": (0, 0, 0)}, "sun_direction"),
        (1, {"sun_color": (-1, 0, 0)}, "sun_color"),
        (1, {"tint": (11, 1, 1)}, "tint"),
        (1, {"tint": [[1, 1, 1]] * 2}, "tint"),
    ],
)
def test_refusals(index, change, match):
    batch = batch_in(loaded())
    batch.sense()
    before, worlds = batch.snapshot(), batch.worlds
    with pytest.raises(ValueError, match=match):
        batch.set_light(index, **change)
    assert batch.snapshot() == before
    assert batch.worlds == worlds
    assert (batch.camera().frame_step >= 0).all()


def test_not_with_a_pool():
    pool = flockstep.WorldPool(lambda number: flockstep.World.playground(seed=number), size=2)
    envs = flockstep.DroneVectorEnv(2, worlds=pool)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="set_light: not allowed with a WorldPool: each episode draws its world"):
        envs.batch.set_light(0, gamma=2)


def test_not_from_inside_a_step():
    class Relit(flockstep.Task):
        observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)

        def step(self, batch):
            batch.set_light(0, gamma=1.0)
            return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)

        def observe(self, batch):
            return batch.position

    envs = flockstep.DroneVectorEnv(2, worlds="playground/train-1", task=Relit)
    envs.reset(seed=0)
    with pytest.raises(RuntimeError, match=r"set_light\(\) was called by a task"):
        envs.step(np.zeros((2, 3), np.float32))
    assert envs.batch.worlds[0].light["gamma"] != 1.0
