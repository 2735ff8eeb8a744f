"""Lights of envs: `Batch.set_light` for some envs, and lights that episodes draw.

The oracle is a batch whose worlds have these lights from the start.
"""

import copy
import pickle

import numpy as np
import pytest
from conftest import begun
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep import Light

WORLDS = ["playground/train-1", "outdoor/forest"]
NIGHT = Light(sun_color=(0.05, 0.05, 0.2), sky_ambient=(0.05, 0.05, 0.1), sun_direction=(-3.0, 0.6, 0.9))
FOG = Light(fog_visibility_m=6.0)
GAMMA = Light(gamma=1.2, zenith_color=(0.9, 0.1, 0.1), sun_glow=0.5, sun_radius_deg=4.0)
LIGHTS = [NIGHT, FOG, GAMMA]


def fields(light):
    return {name: getattr(light, name) for name in Light.__match_args__}


def spoilt(**values):
    """Return a light with values that its constructor refuses."""
    light = Light()
    for name, value in values.items():
        setattr(light, name, value)
    return light


def loaded():
    return [flockstep.World.load(name).with_light(fog_visibility_m=0) for name in WORLDS]  # gl draws none


def camera(**config):
    return flockstep.CameraConfig(
        **{"width_px": 32, "height_px": 24, "outputs": ["rgb", "depth"], "shadows": True, **config}
    )


def batch_in(worlds, backend="raycast", num_envs=4, world_index=None, config=None, **keywords):
    batch = flockstep.Batch(
        worlds,
        num_envs * keywords.get("drones_per_env", 1),
        cameras=[camera(**{"shadows": backend == "raycast", **(config or {})})],
        camera_backend=backend,
        world_index=world_index,
        **keywords,
    )
    batch.set_pose([np.add(batch.world_of(i).start, (0, 0, 1 + 0.1 * i)) for i in range(batch.num_drones)])
    return batch


def images(batch):
    return batch.camera().rgb.copy(), batch.camera().depth.copy()


def lit(envs, lights, backend="raycast"):
    """Return the images of a batch in which each env has its own world, made with the light of the env."""
    worlds = [
        world if light is None else world.with_light(**fields(light)) for world, light in zip(envs, lights, strict=True)
    ]
    batch = batch_in(worlds, backend, len(worlds), range(len(worlds)))
    batch.capture()
    return images(batch)


class TestSetLight:
    @pytest.mark.parametrize(("backend", "light"), [*(("raycast", light) for light in LIGHTS), ("gl", GAMMA)])
    def test_the_pixels_are_those_of_worlds_with_these_lights(self, backend, light):
        worlds = loaded()
        batch = batch_in(worlds, backend)
        batch.sense()
        before = images(batch)
        batch.set_light(light, envs=[1, 2])
        np.testing.assert_array_equal(batch.camera().frame_step, [0, -1, -1, 0])
        batch.capture(np.array([False, True, True, False]))
        expected = lit([*worlds, *worlds], [None, light, light, None], backend)
        for ours, others, old in zip(images(batch), expected, before, strict=True):
            np.testing.assert_array_equal(ours, others)
            np.testing.assert_array_equal(ours[[0, 3]], old[[0, 3]])
        assert (batch.camera().rgb[1:3] != before[0][1:3]).mean() > 0.3

    @pytest.mark.parametrize("envs", [2, [2], np.array([2]), [False, False, True, False], np.int32(2), (2, 2)])
    def test_envs_are_a_mask_or_indices(self, envs):
        batch = batch_in(loaded())
        batch.sense()
        batch.set_light(NIGHT, envs)
        assert [batch.world_of(i).light["sun_color"] == pytest.approx(NIGHT.sun_color) for i in range(4)] == [
            i == 2 for i in range(4)
        ]
        np.testing.assert_array_equal(batch.camera().frame_step, [0, 0, -1, 0])

    def test_without_envs_all_change(self):
        batch = batch_in(loaded())
        batch.set_light(NIGHT)
        batch.set_light(light=FOG, envs=[])
        assert all(batch.world_of(i).light["sun_color"] == pytest.approx(NIGHT.sun_color) for i in range(4))

    def test_fields_change_the_current_lights(self):
        worlds = [loaded()[0].with_light(gamma=3.0), loaded()[1]]
        batch = batch_in(worlds)
        batch.set_light(NIGHT, envs=1)
        batch.set_light(envs=[0, 1], fog_visibility_m=7.0)
        expected = [worlds[0].light, {**worlds[1].light, **NIGHT_IN_A_WORLD}, worlds[0].light, worlds[1].light]
        for light in expected[:2]:
            light["fog_visibility_m"] = 7.0
        assert [batch.world_of(i).light for i in range(4)] == expected

    def test_none_returns_to_the_light_of_the_world(self):
        worlds = loaded()
        batch = batch_in(worlds)
        batch.sense()
        before = images(batch)
        batch.set_light(NIGHT)
        batch.sense()
        batch.set_light(envs=[0, 3])
        np.testing.assert_array_equal(batch.camera().frame_step, [-1, 1, 1, -1])
        batch.sense()
        same = (batch.camera().rgb == before[0]).all(axis=(1, 2, 3))
        np.testing.assert_array_equal(same, [True, False, False, True])
        assert batch.world_of(0) is worlds[0]
        batch.set_light()
        batch.capture()
        np.testing.assert_array_equal(batch.camera().rgb, before[0])

    def test_frames_on_movement_are_rendered_again_only_in_these_envs(self):
        batch = batch_in(loaded(), config={"capture_mode": "on_movement"})
        batch.sense()
        batch.set_light(NIGHT, envs=[3])
        batch.sense()
        np.testing.assert_array_equal(batch.camera().frame_step, [0, 0, 0, 1])

    @pytest.mark.parametrize("backend", ["raycast", "gl"])
    def test_another_world_and_its_changed_light(self, backend):
        worlds = loaded()
        batch = batch_in(worlds, backend, 2, [0, 0])
        batch.set_light(NIGHT, envs=0)
        batch.capture()
        batch.set_world([1, 1])
        batch.set_pose([np.add(worlds[1].start, (0, 0, 1 + 0.1 * i)) for i in range(2)])
        batch.capture()
        np.testing.assert_equal(images(batch), lit([worlds[1]] * 2, [NIGHT, None], backend))
        batch.set_light(1, gamma=1.2, tint=(0.5, 1.0, 0.5))
        np.testing.assert_array_equal(batch.camera().frame_step, [-1, -1])
        batch.capture()
        tinted = worlds[1].with_light(gamma=1.2, tint=(0.5, 1.0, 0.5))
        np.testing.assert_equal(images(batch), lit([tinted] * 2, [NIGHT, None], backend))

    def test_a_frame_of_another_world_is_restored(self):
        worlds = loaded()
        batch = batch_in(worlds, "raycast", 2, [0, 0])
        batch.set_light(NIGHT, envs=0)
        batch.capture()
        before = images(batch)
        batch.set_world([1, 1])  # the frames still show world 0
        batch.restore(batch.snapshot())
        np.testing.assert_equal(images(batch), before)

    @pytest.mark.parametrize("backend", ["raycast", "gl"])
    def test_bodies_have_the_light_of_their_env(self, backend):
        world = loaded()[0]
        ball = flockstep.BodyConfig(
            shape="sphere", size_m=[1.0, 1.0, 1.0], position_m=np.add(world.start, (2, 0, 1.5)).tolist()
        )
        batch = batch_in([world], backend, 2, bodies=[ball])
        made = batch_in([world.with_light(**fields(GAMMA))], backend, 2, bodies=[ball])
        batch.set_light(GAMMA, envs=1)
        batch.capture()
        made.capture()
        np.testing.assert_array_equal(batch.camera().rgb[1], made.camera().rgb[1])
        assert (batch.camera().rgb[0] != made.camera().rgb[0]).any()

    def test_a_larger_batch_keeps_the_lights(self):
        worlds = loaded()
        batch = batch_in(worlds, num_envs=2)
        batch.set_light(NIGHT, envs=1)
        batch.capture()
        before = images(batch)
        batch.spawn([4], position=[np.add(worlds[0].start, (0, 0, 1.4))])
        np.testing.assert_array_equal(batch.camera().rgb[:2], before[0])
        batch.capture()
        np.testing.assert_array_equal(batch.camera().rgb[:2], before[0])
        np.testing.assert_array_equal(batch.camera().rgb[4], lit([worlds[0]] * 5, [None] * 5)[0][4])

    def test_nothing_but_the_colours_changes(self):
        def flown(changes):
            envs = flockstep.DroneVectorEnv(3, worlds=WORLDS[0], max_episode_steps=20, camera=camera())
            rng = np.random.default_rng(4)
            found = [envs.reset(seed=3)[0].copy(), envs.batch.camera().depth.copy()]
            for step in range(60):
                if changes and step % 7 == 0:
                    envs.batch.set_light(Light(sun_color=(step / 60, 0, 0)), envs=step % 3)
                found += [part.copy() for part in envs.step(rng.integers(0, envs.single_action_space.n, 3))[:4]]
                found.append(envs.batch.camera().depth.copy())
            return found

        np.testing.assert_equal(flown(False), flown(True))

    def test_a_light_survives_a_reset(self):
        envs = begun(2, worlds=WORLDS[0], max_episode_steps=3, camera=camera())
        envs.batch.set_light(NIGHT, envs=1)
        for _ in range(9):
            envs.step([0, 0])
        assert [envs.batch.world_of(i).light["sun_glow"] for i in range(2)] == [0, 0]
        envs.reset(seed=5)
        assert envs.batch.world_of(1).light["sun_color"] == pytest.approx(NIGHT.sun_color)
        assert envs.batch.world_of(0) is envs.batch.worlds[0]

    def test_with_a_pool(self):
        pool = flockstep.WorldPool(lambda number: flockstep.World.playground(seed=number), size=2)
        envs = begun(2, worlds=pool, max_episode_steps=3, camera=camera())
        envs.batch.set_light(NIGHT, envs=1)
        for _ in range(12):
            envs.step([0, 0])
        made = flockstep.Batch([envs.batch.world_of(i) for i in range(2)], 2, cameras=[camera()])
        made.set_pose(envs.batch.position, envs.batch.quat_wxyz)
        made.capture()
        np.testing.assert_array_equal(envs.batch.camera().rgb, made.camera().rgb)
        assert envs.batch.world_of(1).light["sun_color"] == pytest.approx(NIGHT.sun_color)

    def test_pictures_show_the_light(self):
        envs = begun(2, worlds=WORLDS[0], render_mode="rgb_array", render_view="third_person", render_size=(64, 48))
        before = np.array(envs.render())
        envs.batch.set_light(NIGHT, envs=1)
        after = np.array(envs.render())
        np.testing.assert_array_equal(before[0], after[0])
        assert after[1].mean() < 0.8 * before[1].mean()


NIGHT_IN_A_WORLD = flockstep.World.load(WORLDS[0]).with_light(**fields(NIGHT)).light


class TestSnapshots:
    def test_they_restore_the_lights(self):
        batch = batch_in(loaded())
        batch.set_light(NIGHT, envs=[1, 3])
        batch.set_light(FOG, envs=0)
        batch.sense()
        expected, lights = images(batch), [batch.world_of(i).light for i in range(4)]
        blob = batch.snapshot()
        batch.set_light(GAMMA)
        batch.set_light(envs=2)
        batch.sense()
        for other in (batch, batch_in(loaded())):
            other.restore(blob)
            assert [other.world_of(i).light for i in range(4)] == lights
            np.testing.assert_equal(images(other), expected)
            assert other.snapshot() == blob

    def test_copies_of_envs(self):
        envs = begun(2, worlds="train", camera=camera(), lights=LIGHTS, seed=1)
        envs.batch.set_light(GAMMA, envs=0)
        envs.batch.set_light(1, gamma=1.5)  # of a world
        envs.step([0, 0])
        for other in (copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))):
            assert other.batch.worlds[1].light == envs.batch.worlds[1].light
            assert [other.batch.world_of(i).light for i in range(2)] == [envs.batch.world_of(i).light for i in range(2)]
            np.testing.assert_array_equal(other.batch.camera().rgb, envs.batch.camera().rgb)


class TestDrawnLights:
    def envs(self, num_envs, **keywords):
        usual = {"worlds": "train", "max_episode_steps": 4, "camera": camera(), "lights": LIGHTS}
        return flockstep.DroneVectorEnv(num_envs, **{**usual, **keywords})

    def flown(self, envs, seed, steps=14):
        envs.reset(seed=seed)
        found = []
        for _ in range(steps):
            envs.step(np.zeros(envs.num_envs, int))
            found.append(
                (
                    [envs.batch.world_of(i).light["gamma"] for i in range(envs.num_envs)],
                    [envs.batch.world_of(i).light["fog_visibility_m"] for i in range(envs.num_envs)],
                    envs.batch.camera().rgb.copy(),
                )
            )
        return [np.stack(part) for part in zip(*found, strict=True)]

    def test_the_draws(self):
        """Every light is drawn about equally often, and episodes differ."""
        envs = self.envs(200, camera=None, worlds=WORLDS[0])
        counts = np.zeros(3)
        draws = []
        envs.reset(seed=7)
        for _ in range(6):
            drawn = np.array(
                [
                    0 if light["sun_color"][2] < 0.3 else 1 if light["fog_visibility_m"] > 0 else 2
                    for light in (envs.batch.world_of(i).light for i in range(200))
                ]
            )
            counts += np.bincount(drawn, minlength=3)
            draws.append(drawn)
            envs.reset()
        assert (abs(counts - 400) < 5 * np.sqrt(1200 * 2 / 9)).all()
        assert len({tuple(drawn) for drawn in draws}) == 6
        envs.reset(seed=7)
        again = [envs.batch.world_of(i).light["gamma"] == pytest.approx(1.2) for i in range(200)]
        np.testing.assert_array_equal(again, draws[0] == 2)

    def test_the_pixels_are_those_of_the_worlds_in_these_lights(self):
        envs = self.envs(4)
        self.flown(envs, 3)
        batch = flockstep.Batch([envs.batch.world_of(i) for i in range(4)], 4, cameras=[camera()])
        batch.set_pose(envs.batch.position, envs.batch.quat_wxyz)
        batch.capture()
        np.testing.assert_array_equal(envs.batch.camera().rgb, batch.camera().rgb)

    def test_a_light_that_was_set_stays_until_the_next_episode(self):
        envs = self.envs(3, lights=[FOG])
        envs.reset(seed=0)
        envs.batch.set_light(NIGHT, envs=1)
        fog = [envs.batch.world_of(i).light["fog_visibility_m"] for i in range(3)]
        assert fog == [6, 0, 6]
        for _ in range(5):
            envs.step([0, 0, 0])
        assert [envs.batch.world_of(i).light["fog_visibility_m"] for i in range(3)] == [6, 6, 6]

    def test_without_a_task(self):
        batch = batch_in(loaded(), lights=[FOG, NIGHT])

        def lights():
            return [batch.world_of(i).light["fog_visibility_m"] for i in range(4)]

        batch.seed(np.arange(4) + 40)
        first, seen = lights(), []
        for _ in range(8):
            batch.begin_episode()
            seen.append(tuple(lights()))
        assert len(set(seen)) > 1
        batch.seed(np.arange(4) + 40)
        assert lights() == first

    def test_a_single_env_and_a_task_of_ones_own(self):
        env = flockstep.DroneEnv(worlds=WORLDS[0], lights=FOG)
        env.reset(seed=0)
        assert env.batch.world_of(0).light["fog_visibility_m"] == 6

        class Hold(Still):
            lights = (NIGHT,)

        envs = begun(2, worlds=WORLDS[0], task=Hold)
        assert envs.batch.world_of(1).light["sun_color"] == pytest.approx(NIGHT.sun_color)


class TestRefusals:
    @pytest.mark.parametrize(
        ("light", "envs", "keywords", "said"),
        [
            (NIGHT, 4, {}, ["envs", 4]),
            (NIGHT, [0, -1], {}, ["envs", -1]),
            (NIGHT, [True], {}, ["envs"]),
            (NIGHT, [0.5], {}, ["envs"]),
            (NIGHT, "all", {}, ["envs"]),
            (spoilt(sun_direction=(0, 0, 0)), 0, {}, ["light.sun_direction", "not 0"]),
            (spoilt(sun_direction=(np.nan, 0, 1)), 0, {}, ["light.sun_direction[0]", np.nan]),
            (None, 0, {"sky_ambient": (-1, 0, 0)}, ["light.sky_ambient[0]", -1]),
            (0, 0, {}, ["envs", None]),
            (NIGHT, 0, {"gamma": 2.0}, ["light", None, "fields"]),
            (NIGHT, 0, {"world_index": 0}, ["light", None, "world_index"]),
            (None, 0, {"tint": (1, 1, 1)}, ["tint", None]),
            ({"gamma": 2.0}, 0, {}, ["light", "flockstep.Light"]),
        ],
    )
    def test_they_change_nothing(self, light, envs, keywords, said):
        batch = batch_in(loaded())
        batch.set_light(FOG, envs=2)
        batch.sense()
        before = batch.snapshot()
        with refused((ValueError, TypeError), *said):
            batch.set_light(light, envs, **keywords)
        assert batch.snapshot() == before
        assert (batch.camera().frame_step >= 0).all()

    @pytest.mark.parametrize(
        ("lights", "said"),
        [
            ([spoilt(sun_direction=(0, 0, 0))], ["light.sun_direction"]),
            ([FOG, spoilt(gamma=np.nan)], ["light.gamma", np.nan]),
            ([FOG] * 4097, ["lights", 4096, 4097]),
            ([{"gamma": 2.0}], ["lights"]),
        ],
    )
    def test_lights_of_a_batch(self, lights, said):
        for make in (
            lambda: batch_in(loaded(), lights=lights),
            lambda: flockstep.DroneVectorEnv(2, worlds=WORLDS[0], lights=lights),
        ):
            with refused((ValueError, TypeError), *said):
                make()
