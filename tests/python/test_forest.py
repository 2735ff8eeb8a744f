"""Generated forests: the same for a seed, a way through them, pictures and ranges that agree, bad arguments."""

import numpy as np
import pytest

import flockstep

SMALL = {"trees": 40, "size_m": (30, 20)}


def test_the_same_arguments_make_the_same_forest():
    first, again = flockstep.World.forest(3, **SMALL), flockstep.World.forest(3, **SMALL)
    assert first.to_dict() == again.to_dict()
    assert first.to_dict() != flockstep.World.forest(4, **SMALL).to_dict()
    # Made of correctly rounded operations, so that it is the same on every machine.
    mesh = first.mesh()
    assert len(mesh["triangles"]) == 5760
    np.testing.assert_allclose(mesh["vertices"].astype(float).sum(axis=0), [65704.07, 42307.01, 23966.74], rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_planner_finds_a_way(seed):
    world = flockstep.World.forest(seed, **SMALL)
    way = flockstep.plan(world, world.start, [world.goal], cell_m=0.4)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [world.start, world.goal])


def test_trees_are_in_the_way_of_a_straight_flight():
    """Of most seeds: without that nothing would have to be learned."""
    hits = 0
    for seed in range(20):
        world = flockstep.World.forest(seed)
        batch = flockstep.Batch([world])
        batch.set_pose(world.start[None])
        hits += bool(batch.move(world.goal[None]).hit[0])
    assert hits >= 16


def test_drones_start_free_in_many_forests():
    for seed in range(30):
        world = flockstep.World.forest(seed, relief_m=seed, **SMALL)
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=seed)
        assert world.goal[0] - world.start[0] == pytest.approx(24)


def test_markers_are_above_the_ground():
    for seed in range(5):
        world = flockstep.World.forest(seed, relief_m=20, **SMALL)
        places = np.stack([world.start, world.goal])
        down = world.raycast(places, np.tile(np.float32([0, 0, -1]), (2, 1)), 100)
        np.testing.assert_allclose(down["t_hit"], 1.5, atol=0.15)  # flat cells cut the hills' curves short


def test_threads_and_company_change_no_bits():
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("rgb", "depth"), shadows=True)
    actions = np.random.default_rng(0).integers(0, 6, (12, 8))

    def flown(envs, first=0, count=8, **how):
        batch = flockstep.DroneVectorEnv(count, worlds="outdoor/forest", camera=[camera], random_start=True, **how)
        observation, _ = batch.reset(seed=first)
        seen = [observation]
        for row in actions:
            seen.append(batch.step(row[first : first + count])[0])
        return np.stack(seen)[:, envs], batch.batch.camera().rgb[envs].copy(), batch.batch.camera().depth[envs].copy()

    expected = flown(slice(3, 6), num_threads=1)
    for other in (flown(slice(3, 6), num_threads=2), flown(slice(0, 3), 3, 3, num_threads=1)):
        for is_, should_be in zip(other, expected, strict=True):
            np.testing.assert_array_equal(is_, should_be)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"trees": -1}, r"forest: trees: expected an integer in \[0, 5000\], got -1"),
        ({"trees": 5001}, "forest: trees"),
        ({"size_m": (11, 40)}, r"forest: size_m\[0\]: expected a number in \[12, 500\], got 11"),
        ({"size_m": (60, float("nan"))}, r"forest: size_m\[1\]"),
        ({"relief_m": 51}, r"forest: relief_m: expected a number in \[0, 50\], got 51"),
        ({"trees": 5000, "size_m": (12, 12)}, "forest: trees: expected few enough for a free path through 12 x 12 m"),
    ],
)
def test_bad_arguments(arguments, match):
    with pytest.raises(ValueError, match=match):
        flockstep.World.forest(1, **arguments)
