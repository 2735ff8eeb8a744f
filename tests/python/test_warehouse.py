"""Generated warehouses: the same for a seed, a way through them, pictures and ranges that agree, bad arguments."""

import numpy as np
import pytest

import flockstep

SMALL = {"size_m": (30, 18), "height_m": 6}


def test_the_same_arguments_make_the_same_warehouse():
    first, again = flockstep.World.warehouse(3, **SMALL), flockstep.World.warehouse(3, **SMALL)
    assert first.to_dict() == again.to_dict()
    assert first.to_dict() != flockstep.World.warehouse(4, **SMALL).to_dict()
    # Made of correctly rounded operations, so that it is the same on every machine.
    mesh = first.mesh()
    vertices, triangles = mesh["vertices"], mesh["triangles"]
    assert len(triangles) == 14404
    np.testing.assert_allclose(vertices.astype(float).sum(axis=0), [350146.49, 210925.51, 58418.8], rtol=1e-6)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_planner_finds_a_way(seed):
    world = flockstep.World.warehouse(seed, **SMALL)
    way = flockstep.plan(world, world.start, [world.goal], cell_m=0.5)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [world.start, world.goal])


def test_racks_are_in_the_way_of_a_straight_flight():
    for seed in range(6):
        world = flockstep.World.warehouse(seed)
        assert world.goal[0] - world.start[0] == pytest.approx(43.2)
        batch = flockstep.Batch([world])
        batch.set_pose(world.start[None])
        assert batch.move(world.goal[None]).hit[0]


def test_drones_start_free_in_many_warehouses():
    for seed in range(8):
        world = flockstep.World.warehouse(seed, size_m=(26 + 2 * seed, 16 + 2 * seed), height_m=5 + seed % 5)
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=seed)


def test_the_sky_is_seen_through_skylights():
    world = flockstep.World.warehouse(1, **SMALL)
    x, y = np.meshgrid(np.linspace(1, 29, 60), np.linspace(1, 17, 40))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)], 1).astype(np.float32)
    up = world.raycast(places, np.tile(np.float32([0, 0, 1]), (x.size, 1)), 100)["t_hit"]
    assert 0.05 < np.isinf(up).mean() < 0.3
    assert up[np.isfinite(up)].max() < 6 + 0.06 * 18 - 5 + 0.2


def test_threads_and_company_change_no_bits():
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("rgb", "depth"), shadows=True)
    actions = np.random.default_rng(0).integers(0, 6, (12, 8))
    world = flockstep.World.warehouse(2, **SMALL)

    def flown(envs, first=0, count=8, **how):
        batch = flockstep.DroneVectorEnv(count, worlds=world, camera=[camera], random_start=True, **how)
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
        ({"size_m": (25, 30)}, r"warehouse: size_m\[0\]: expected a number in \[26, 200\], got 25"),
        ({"size_m": (48, 15)}, r"warehouse: size_m\[1\]: expected a number in \[16, 200\], got 15"),
        ({"size_m": (48, float("nan"))}, r"warehouse: size_m\[1\]"),
        ({"height_m": 4.5}, r"warehouse: height_m: expected a number in \[5, 20\], got 4.5"),
        ({"height_m": float("nan")}, "warehouse: height_m"),
    ],
)
def test_bad_arguments(arguments, match):
    with pytest.raises(ValueError, match=match):
        flockstep.World.warehouse(1, **arguments)
