"""Worlds with bodies: every env in such a world has them."""

import numpy as np
import pytest
from conftest import begun
from messages import refused

import flockstep
from flockstep import BodyConfig

ROOM = {
    "flockstep_scene": 1,
    "name": "room",
    "room": {"min": [0, 0, 0], "max": [20, 20, 10]},
    "markers": {"start": [5, 10, 2], "goal": [15, 10, 2]},
}
SLIDER = {"name": "slider", "position_m": [9, 8, 2], "motion": {"kind": "slider", "travel_m": [0, 4, 0], "period_s": 4}}
CAR = {
    "name": "car",
    "position_m": [12, 12, 1],
    "motion": {"kind": "waypoints", "points_m": [[12, 12, 1], [16, 12, 1], [16, 16, 1]], "speed_mps": 2},
}
BALL = {"name": "ball", "shape": "sphere", "position_m": [3, 3, 3], "motion": {"velocity_mps": [0.5, 0, 0]}}


def world(*bodies, name="room"):
    return flockstep.World.from_dict({**ROOM, "name": name, "bodies": list(bodies)})


def flown(batch, steps):
    """Keep every drone in place for some steps of 0.1 s."""
    for _ in range(steps):
        batch.move(batch.position)
    return batch


def slider_y(time_s):
    return 8 + 4 * (1 - np.cos(2 * np.pi * time_s / 4)) / 2


class TestWorlds:
    def test_with_bodies(self):
        ball = BodyConfig(shape="sphere", position_m=[3, 3, 3])
        changed = world(SLIDER).with_bodies([ball])
        assert [body.shape for body in changed.bodies] == ["sphere"]
        assert changed.with_light(gamma=1.5).bodies[0].shape == "sphere"
        assert changed.with_bodies([]).to_dict() == world().to_dict()
        assert world().with_bodies(ball).to_dict() == changed.to_dict()
        with refused(TypeError, "bodies"):
            changed.with_bodies("ball")
        with refused(ValueError, "bodies", 4097):
            changed.with_bodies([BodyConfig()] * 4097)

    def test_a_builder_adds_bodies(self):
        builder = flockstep.WorldBuilder("built")
        builder.box([0, 0, 0], [1, 1, 1], builder.material("white"))
        builder.body(BodyConfig(name="first"))
        builder.body(BodyConfig(name="second"))
        assert [body.name for body in builder.build().bodies] == ["first", "second"]

    @pytest.mark.parametrize(
        ("bodies", "said"),
        [
            ([{"motion": {"period_s": -1}}], ["scene", "bodies[0].motion.period_s", -1]),
            ([{}, {"shape": "cube"}], ["scene", "bodies[1].shape", "cube"]),
            ([{"motoin": {}}], ["scene", "bodies[0].motoin", "Did you mean"]),
            ({"size_m": [1, 1, 1]}, ["scene", "/bodies", "an array"]),
        ],
    )
    def test_a_bad_body_is_named(self, bodies, said):
        with refused(ValueError, *said):
            flockstep.World.from_dict({**ROOM, "bodies": bodies})

    def test_generated_bodies(self):
        assert len(flockstep.World.playground(1, movers=3).bodies) == 3
        assert flockstep.World.playground(1).bodies == []
        assert len(flockstep.World.warehouse(1, forklifts=2).bodies) == 2
        names = [body.name for body in flockstep.World.office(1, walkers=2).bodies]
        assert names.count("walker") == 2
        assert names.count("door") > 5
        cars = flockstep.World.city(1, traffic=3).bodies
        assert [car.name for car in cars] == ["car"] * 3
        assert all(car.mesh is not None for car in cars)


class TestBatches:
    def test_an_env_moves_the_bodies_of_its_world(self):
        batch = flown(flockstep.Batch([world(SLIDER, BALL)], 3), 20)
        time_s = 2.0
        assert len(batch.bodies) == 2
        assert batch.bodies.active.all()
        np.testing.assert_allclose(batch.bodies.position[:, 0, 1], slider_y(time_s), rtol=1e-5)
        np.testing.assert_allclose(batch.bodies.position[:, 1, 0], 3 + 0.5 * time_s, rtol=1e-5)
        assert batch.bodies.config(1, 1).name == "ball"

    def test_too_few_slots_name_the_world(self):
        with refused(ValueError, "max_bodies", 3, '"full"', 2):
            flockstep.Batch([world(SLIDER), world(SLIDER, BALL, CAR, name="full")], 2, max_bodies=2)
        with refused(ValueError, "max_bodies", 3, '"room"', 2):
            flockstep.Batch([world(SLIDER, BALL)], 2, bodies=[BodyConfig()], max_bodies=2)

    def test_light_keeps_them(self):
        batch = flown(flockstep.Batch([world(SLIDER)], 1), 4)
        before = batch.bodies.position.copy()
        batch.set_light(0, gamma=1.5)
        np.testing.assert_array_equal(batch.bodies.position, before)
        flown(batch, 6)
        np.testing.assert_allclose(batch.bodies.position[0, 0, 1], slider_y(1), rtol=1e-5)

    def test_an_env_that_changes_its_world_takes_the_other_bodies(self):
        batch = flockstep.Batch([world(SLIDER), world(BALL, CAR)], 4)
        batch.set_world([1, 1, 0, 0])
        assert batch.bodies.active.tolist() == [[True, True], [True, True], [True, False], [True, False]]
        assert batch.bodies.config(0, 0).name == "ball"
        np.testing.assert_array_equal(flown(batch, 10).bodies.position[0, 1], [14, 12, 1])

    def test_new_drones_fly_among_them(self):
        batch = flown(flockstep.Batch([world(SLIDER), world(BALL, CAR)], 2), 10)
        batch.spawn(position=[[5, 5, 5]] * 2, world_index=[1, 0])
        assert batch.bodies.active.tolist() == [[True, False], [True, True], [True, True], [True, False]]
        flown(batch, 5)
        np.testing.assert_allclose(batch.bodies.position[:2, 0], [[9, slider_y(1.5), 2], [3.75, 3, 3]], rtol=1e-5)
        np.testing.assert_allclose(batch.bodies.position[2:, 0], [[3.25, 3, 3], [9, slider_y(0.5), 2]], rtol=1e-5)

    def test_snapshots(self):
        batch = flown(flockstep.Batch([world(SLIDER), world(BALL, CAR)], 4), 7)
        blob = batch.snapshot()
        expected = flown(batch, 20).bodies.position.copy()
        batch.restore(blob)
        np.testing.assert_array_equal(flown(batch, 20).bodies.position, expected)
        other = flockstep.Batch([world(SLIDER), world(BALL, SLIDER)], 4)
        with refused(ValueError, "snapshot"):
            other.restore(blob)


def poses(envs):
    return envs.batch.bodies.position.copy()


class TestEnvs:
    def test_episodes_begin_with_the_bodies_of_their_world(self):
        envs = begun(6, worlds=[world(SLIDER), world(BALL, CAR)], max_episode_steps=5, random_world=True, seed=3)
        for _ in range(40):
            envs.step(envs.action_space.sample())
            active = envs.batch.bodies.active.sum(axis=1)
            np.testing.assert_array_equal(active, envs.batch.world_index + 1)

    def test_an_episode_draws_phases(self):
        motion = {**SLIDER["motion"], "random_phase": True, "speed_spread": 0.5}
        envs = begun(8, worlds=[world({**SLIDER, "motion": motion})], max_episode_steps=5, seed=3)
        first = poses(envs)
        assert len(np.unique(first[:, 0, 1])) == 8
        for _ in range(7):
            envs.step(envs.action_space.sample())
        assert not np.isin(poses(envs)[:, 0, 1], first[:, 0, 1]).any()
        envs.reset(seed=3)
        np.testing.assert_array_equal(poses(envs), first)

    def test_pools(self):
        def make(number):
            return world(*[SLIDER, BALL, CAR][: number % 4], name=f"room-{number}")

        pool = flockstep.WorldPool(make, size=8)
        envs = begun(5, worlds=pool, max_episode_steps=4, max_bodies=3, seed=1)
        for _ in range(30):
            envs.step(envs.action_space.sample())
            np.testing.assert_array_equal(envs.batch.bodies.active.sum(axis=1), envs.batch.world_index % 4)
        blob = envs.batch.snapshot()
        expected = poses(envs)
        for _ in range(10):
            envs.step(envs.action_space.sample())
        envs.batch.restore(blob)
        np.testing.assert_array_equal(poses(envs), expected)

    def test_a_pool_needs_enough_slots(self):
        pool = flockstep.WorldPool(lambda number: world(SLIDER, BALL, name=f"room-{number}"), size=4)
        with refused(ValueError, "world 0 of the pool", "max_bodies", 2):
            flockstep.DroneVectorEnv(2, worlds=pool, max_bodies=1)
        with refused(ValueError, "world 0 of the pool", "max_bodies", 2):
            flockstep.DroneVectorEnv(2, worlds=pool)

    def test_living_scenes_train(self):
        envs = begun(4, worlds="living_playground/seed-1..2")
        assert envs.batch.bodies.active.sum() == 4 * 6
        before = poses(envs)
        for _ in range(5):
            envs.step(envs.action_space.sample())
        assert (poses(envs) != before).any(axis=2).all()
