"""World pools: the drawn worlds, the same bits for any build time, and the state after failures."""

import math
import random
import time

import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused
from philox import uniform

import flockstep
from flockstep import World, WorldPool

LIDAR = flockstep.LidarConfig()


def hall(number):
    """A small room whose pillar's position depends on the number."""
    x, y = np.random.default_rng(number).uniform([2.2, 0.8], [4.8, 4.2])
    return world_of(
        name=f"hall-{number}",
        room={"min": [0, 0, 0], "max": [6, 5, 3]},
        pillars=[{"center": [x, y], "radius": 0.3}],
        markers={
            "start": [1, 2.5, 1.5],
            "goal": [5.2, 2.5, 1.5],
            "spawn_box": {"min": [0.7, 2, 1], "max": [1.3, 3, 2]},
        },
    )


def hall_at_leisure(number):
    time.sleep(random.uniform(0, 0.01))
    return hall(number)


def number_of(seed, episode, size, fresh):
    """The world number that an env with this seed draws in this episode."""
    world_stream = 0x80000003
    return int(np.floor(episode * fresh)) + int(uniform(seed, episode, world_stream, 0) * size)


def make(num_drones=8, pool=None, *, mode="same_step", steps=5, random_world=False, **arguments):
    """A batch with short episodes."""
    arguments = {"lidar": LIDAR, "task": flockstep.NavigationConfig(), "num_threads": 1, **arguments}
    episode = flockstep.EpisodeConfig(autoreset_mode=mode, max_episode_steps=steps, random_world=random_world)
    return flockstep.Batch(pool or WorldPool(hall, 16), num_drones, episode=episode, **arguments)


def fly(batch, steps):
    for _ in range(steps):
        batch.step([4] * batch.num_drones)


# --------------------------------------------------------------------------------------------------------- drawn worlds


@pytest.mark.parametrize(("size", "fresh"), [(1, 0.0), (64, 0.0), (10, 1.5), (1000, 0.3), (3, 7)])
def test_numbers_are_those_of_the_rule(size, fresh):
    seeds = np.array([0, 1, 77, 2**40 + 3, 2**64 - 1], np.uint64)
    batch = make(5, WorldPool(hall, size, fresh), steps=2)
    assert batch.world_index.tolist() == [0] * 5
    batch.reset(seeds)
    for _ in range(12):
        expected = [number_of(int(s), int(e), size, fresh) for s, e in zip(seeds, batch.episode, strict=True)]
        assert batch.world_index.tolist() == expected
        assert [batch.world_of(i).name for i in range(5)] == [f"hall-{number}" for number in expected]
        batch.step([4] * 5)
    assert batch.episode.min() == 6


def test_a_curriculum_gets_harder():
    asked = {}

    def playground(number, pillars):
        asked[number] = pillars
        return World.playground(number, pillars=round(pillars), size_m=(10, 10, 4))

    pool = WorldPool(playground, 4, 2.0, difficulty=(2, 8, 12))
    envs = begun(4, worlds=pool, max_episode_steps=1, autoreset_mode="same_step")
    pillars = []
    for _ in range(10):
        worlds = [envs.batch.world_of(i) for i in range(4)]
        pillars.append(np.mean([sum(p["kind"] == "cylinder" for p in world.primitives) for world in worlds]))
        envs.step([4] * 4)
    assert pillars[0] < 4
    assert pillars[-1] == 8
    assert np.all(np.diff(pillars) >= -1.5)
    for number, difficulty in asked.items():
        assert difficulty == pytest.approx(2 + 6 * min(number / 12, 1))
    assert WorldPool(hall, difficulty=lambda number: number / 2).difficulty_of(6) == 3


# -------------------------------------------------------------------------------------------------------- the same bits


def pad(number):
    """A hall whose floor height depends on the number, with the drone just above the floor."""
    z = 0.1 * (number % 7)
    room, markers = {"min": [-4, -4, z], "max": [4, 4, 5]}, {"goal": [0.1 * number, 0, z + 0.35]}
    return world_of(name=f"pad-{number}", room=room, markers=markers)


def test_pictures_are_of_the_world_that_a_drone_is_in():
    camera = flockstep.CameraConfig(width_px=8, height_px=6, outputs=("rgb", "depth", "instance"))

    def run(num_drones, **arguments):
        batch = make(num_drones, WorldPool(hall_at_leisure, 12, 1.0), steps=3, cameras=[camera], **arguments)
        batch.reset(np.arange(num_drones))
        rows = []
        for _ in range(9):
            batch.step([0] * num_drones)
            rows.append((batch.camera().depth.copy(), batch.camera().rgb.copy(), batch.world_index.copy()))
        i = num_drones - 1
        alone = flockstep.Batch([hall(int(batch.world_index[i]))], 1, cameras=[camera])
        alone.set_pose(batch.position[i : i + 1], batch.quat_wxyz[i : i + 1])
        alone.sense()
        np.testing.assert_array_equal(alone.camera().depth[0], rows[-1][0][i])
        return [np.stack(arrays) for arrays in zip(*rows, strict=True)]

    many = run(12, num_threads=2, camera_backend="auto")
    assert len(np.unique(many[2])) > 8
    for a, b in zip(many, run(4), strict=True):
        np.testing.assert_array_equal(a[:, :4], b)


@pytest.mark.parametrize("view", ["top", "third_person"])
def test_views_show_the_world_that_a_drone_is_in(view):
    arguments = {"render_mode": "rgb_array", "render_view": view, "render_size": (64, 48)}
    envs = begun(2, worlds=WorldPool(hall, 16, 1.0), **arguments)
    envs.render()
    envs.reset()
    for i, frame in enumerate(envs.render()):
        alone = begun(1, worlds=hall(int(envs.batch.world_index[i])), **arguments)
        np.testing.assert_array_equal(frame, alone.render()[0])


# ------------------------------------------------------------------------------------------- drones that end separately

M = 3


def team(worlds, episodes, mode, num_envs=5, **arguments):
    """Envs of M drones that begin at random places and fly at most 15 steps."""
    arguments = {"random_start": True, "max_episode_steps": 15, "action": "displacement", **arguments}
    return flockstep.DroneVectorEnv(
        num_envs, worlds=worlds, drones_per_env=M, episodes=episodes, autoreset_mode=mode, **arguments
    )


def flown(envs, steps=60):
    """Yield after the reset and after each step, with the rows that have ended: each drone often flies into a wall.

    With autoreset disabled these rows are reset.
    """
    envs.reset(seed=7)
    yield np.zeros(envs.num_envs, bool)
    ways = np.random.default_rng(2).choice([-1, 0, 1], (steps // 6 + 1, 5 * M, 3))
    for action in np.repeat(ways, 6, axis=0)[:steps].astype(np.float32):
        _, _, terminated, truncated, _ = envs.step(action[: envs.num_envs])
        ended = terminated | truncated
        if envs.metadata["autoreset_mode"].value == "Disabled" and ended.any():
            envs.reset(options={"reset_mask": ended})
        yield ended


@pytest.mark.parametrize("source", ["pool", "random_world"])
@pytest.mark.parametrize("episodes", ["each", "last"])
def test_drones_of_an_env_are_in_the_world_that_its_episode_draws(episodes, mode, source):
    """With "each" the episode of an env ends only by its reset."""
    halls = [hall(number) for number in range(9)]
    worlds = WorldPool(hall_at_leisure, 9, 1.0) if source == "pool" else halls
    fresh = 1.0 if source == "pool" else 0.0
    envs = team(worlds, episodes, mode, **({} if source == "pool" else {"random_world": True}))
    batch = envs.batch
    seen, ends = set(), 0
    for reset in range(2):
        for ended in flown(envs, 60):
            expected = [number_of(7 + i, int(batch.episode[i]), 9, fresh) for i in range(5)]
            assert batch.world_index.tolist() == expected
            assert [batch.world_of(row).name for row in range(0, 5 * M, M)] == [f"hall-{n}" for n in expected]
            ends += np.count_nonzero(ended)
            seen |= set(batch.episode.tolist())
            ranges = batch.lidar().ranges.copy()
            for row in np.flatnonzero(~batch.waiting)[:: 4 + reset]:
                alone = flockstep.Batch([hall(expected[row // M])], 1, lidar=envs.lidar)
                alone.set_pose(batch.position[[row]], batch.quat_wxyz[[row]])
                alone.sense()
                np.testing.assert_array_equal(alone.lidar().ranges[0], ranges[row])
        if episodes == "each":
            assert (batch.own_episodes >= 2).all()
            before = batch.world_index.copy()
            envs.reset(options={"reset_mask": np.arange(5 * M) % 4 == 0})  # single drones
            np.testing.assert_array_equal(batch.world_index, before)
            envs.reset()
            seen |= set(batch.episode.tolist())
            assert batch.world_index.tolist() == [number_of(7 + i, 1, 9, fresh) for i in range(5)]
    assert ends > 60
    assert max(seen) == 1 if episodes == "each" else max(seen) >= 3


# ------------------------------------------------------------------------------------------------------------ snapshots


def test_a_snapshot_of_other_worlds_is_refused():
    def elsewhere(number):
        return hall(number + (number > 3))

    one, other = make(), make(pool=WorldPool(elsewhere, 16))
    for batch in (one, other):
        batch.reset(np.arange(8))
    before = other.snapshot()
    with refused(ValueError, "snapshot"):
        other.restore(one.snapshot())
    assert other.snapshot() == before
    for pool in (WorldPool(hall, 15), WorldPool(hall, 16, 0.5)):
        with refused(ValueError, "snapshot"):
            make(pool=pool).restore(one.snapshot())
    with refused(ValueError, "snapshot"):
        make(pool=[hall(0)]).restore(one.snapshot())


# ------------------------------------------------------------------------------------------------------------- failures


class TestFailures:
    @staticmethod
    def failing(number, bad, how):
        return how() if number in bad else hall(number)

    def batch(self, bad, how, **arguments):
        return make(pool=WorldPool(lambda number: self.failing(number, bad, how), 2, 1.0), **arguments)

    def test_a_make_that_raises(self):
        def how():
            raise KeyError("lost")

        bad = {number_of(1, 4, 2, 1.0)}
        batch = self.batch(bad, how, steps=1)
        batch.reset([1] * 8)  # all episodes are in the same worlds
        last = next(n for n in range(9) if number_of(1, n, 2, 1.0) in bad) - 1
        with refused(RuntimeError, "WorldPool", "making world", "KeyError: 'lost'") as error:
            fly(batch, 9)
        assert isinstance(error.value.__cause__, KeyError)
        assert batch.episode.tolist() == [last] * 8
        with refused(RuntimeError, "interrupted the last step"):
            batch.step([4] * 8)
        batch.reset([1] * 8)
        bad.clear()  # failed builds are tried again
        for _ in range(9):
            batch.step([4] * 8)
        assert batch.episode.min() == 9

    def test_a_reset_that_fails_changes_nothing(self):
        batch = self.batch({1, 2, 3}, lambda: None)
        seed = next(s for s in range(99) if number_of(s, 0, 2, 1.0) == 0)
        other = next(s for s in range(99) if number_of(s, 0, 2, 1.0) == 1)
        batch.reset([seed] * 8)
        batch.step([0] * 8)
        before = batch.snapshot()
        with refused(TypeError, "WorldPool", "world 1", None):
            batch.reset([seed] * 7 + [other])
        assert batch.snapshot() == before
        batch.step([0] * 8)

    def test_a_world_that_the_task_cannot_be_flown_in(self):
        def how():
            return world_of(room={"min": [0, 0, 0], "max": [6, 5, 3]})

        batch = self.batch(range(1, 99), how)
        with refused(ValueError, "of the pool", "markers.start"):
            batch.reset(np.arange(8))
        with refused(ValueError, "world 0 of the pool", "markers.start"):
            self.batch([0], how)

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            ({"size": 0}, ["size", 0]),
            ({"size": 1.5}, ["size", 1.5]),
            ({"fresh": -1}, ["fresh", -1]),
            ({"fresh": math.nan}, ["fresh", math.nan]),
            ({"fresh": True}, ["fresh", True]),
            ({"threads": 0}, ["threads", 0]),
            ({"difficulty": (1, 2)}, ["difficulty", "a function"]),
            ({"difficulty": (1, 2, 0)}, ["difficulty", "over", 0]),
            ({"difficulty": (math.nan, math.inf, 1)}, ["difficulty", "finite"]),
            ({"difficulty": (1, math.inf, 1)}, ["difficulty", "finite"]),
            ({"difficulty": (True, 2, 1)}, ["difficulty", "finite"]),
            ({"make": 3}, ["make", 3]),
        ],
    )
    def test_wrong_pools(self, arguments, said):
        with refused((TypeError, ValueError), *said):
            WorldPool(**{"make": hall, **arguments})

    @pytest.mark.parametrize("value", [math.nan, math.inf, None, "hard"])
    def test_an_invalid_difficulty(self, value):
        pool = WorldPool(lambda number, difficulty: hall(number), difficulty=lambda number: value)
        with refused(ValueError, "difficulty", value):
            pool.difficulty_of(3)

    @pytest.mark.parametrize(
        ("call", "error", "said"),
        [
            (lambda _: make(pool=WorldPool(lambda number: number)), TypeError, ["WorldPool", "world 0", 0]),
            (lambda _: flockstep.Batch(WorldPool(hall), 1), ValueError, ["worlds", "a task"]),
            (lambda _: flockstep.Batch(hall), TypeError, ["worlds"]),
            (lambda _: make(camera=flockstep.CameraConfig(), camera_backend="gl"), ValueError, ["camera_backend"]),
            (lambda _: make(world_index=[0] * 8), ValueError, ["world_index", "WorldPool"]),
            (lambda batch: batch.set_world([0] * 8), ValueError, ["world_index", "WorldPool"]),
            (lambda batch: batch.spawn([0], [[1, 2, 1]], world_index=[0]), ValueError, ["world_index", "WorldPool"]),
            (lambda batch: batch.worlds, AttributeError, ["world_of"]),
            (lambda batch: batch.world_of(8), IndexError, ["index", 8]),
        ],
    )
    def test_unsupported_uses_of_a_pool(self, call, error, said):
        batch = make()
        batch.reset(np.arange(8))
        with refused(error, *said):
            call(batch)
