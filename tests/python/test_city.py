"""Generated cities: the same for a seed, a way through them, pictures and ranges that agree, bad arguments."""

import numpy as np
import pytest

import flockstep

SMALL = {"blocks": (1, 1), "height_m": 20}


def test_the_same_arguments_make_the_same_city():
    first, again = flockstep.World.city(3, **SMALL), flockstep.World.city(3, **SMALL)
    assert first.to_dict() == again.to_dict()
    # Made of correctly rounded operations, so that it is the same on every machine.
    mesh = first.mesh(chord_error_m=0.01)
    vertices, triangles = mesh["vertices"], mesh["triangles"]
    assert len(triangles) == 28948
    np.testing.assert_allclose(vertices.astype(float).sum(axis=0), [1883953.88, 1947576.25, 190416.99], rtol=1e-6)
    assert len(flockstep.World.city(4, **SMALL).mesh(chord_error_m=0.01)["triangles"]) != len(triangles)


@pytest.mark.parametrize(("seed", "blocks"), [(0, (1, 1)), (1, (2, 1))])
def test_a_planner_finds_a_way(seed, blocks):
    world = flockstep.World.city(seed, blocks, 16)
    way = flockstep.plan(world, world.start, [world.goal], cell_m=1.8)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [world.start, world.goal])


def test_houses_are_in_the_way_of_a_straight_flight():
    """Of most seeds: without that nothing would have to be learned."""
    hits = 0
    for seed in range(8):
        world = flockstep.World.city(seed, **SMALL)
        batch = flockstep.Batch([world])
        batch.set_pose(world.start[None])
        hits += bool(batch.move(world.goal[None]).hit[0])
    assert hits >= 7


def test_drones_start_free_in_many_cities():
    for seed in range(6):
        world = flockstep.World.city(seed, **SMALL)
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=seed)
        assert 44 <= world.goal[0] - world.start[0] <= 56  # a block and a road
        for place in (world.start, world.goal):
            down = world.raycast(place[None], np.float32([[0, 0, -1]]), 100)["t_hit"][0]
            assert 2 < down < 6  # above a road
            assert down == pytest.approx(place[2], abs=1e-3)


@pytest.mark.parametrize("height", [12, 90])
def test_roofs_are_as_high_as_asked(height):
    """What stands on a roof comes on top of that."""
    world = flockstep.World.city(5, (2, 2), height)
    assert 0.6 * height < world.bounds[1, 2] < height + 12


def test_cameras_tell_what_is_what():
    """A class for each kind of thing; a road below, houses around."""
    world = flockstep.World.city(3, **SMALL)
    classes = {}
    for material in world.materials:
        classes.setdefault(material["semantic"], []).append(material["name"])
    assert "car" in classes[7]
    assert len(classes[4]) > 20  # facades, walls, trim
    camera = flockstep.CameraConfig(width_px=64, height_px=48, outputs=("semantic",), far_m=300)
    seen = flockstep.render(world, world.start, look_at=world.start - np.array([0, 0.1, 1]), camera=camera)["semantic"]
    assert (seen == 1).mean() > 0.6  # the crossing
    ahead = flockstep.render(world, world.start, look_at=world.start + np.array([9, 0, 0]), camera=camera)["semantic"]
    assert {1, 2, 4} <= set(np.unique(ahead))


def test_threads_and_company_change_no_bits():
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("rgb", "depth"), shadows=True)
    actions = np.random.default_rng(0).integers(0, 6, (8, 8))
    world = flockstep.World.city(3, **SMALL)

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
        ({"blocks": (0, 1)}, r"city: blocks\[0\]: expected an integer in \[1, 8\], got 0"),
        ({"blocks": (3, 9)}, r"city: blocks\[1\]"),
        ({"height_m": 11}, r"city: height_m: expected a number in \[12, 200\], got 11"),
        ({"height_m": float("nan")}, "city: height_m"),
    ],
)
def test_bad_arguments(arguments, match):
    with pytest.raises(ValueError, match=match):
        flockstep.World.city(1, **arguments)


def test_the_bench_scenes_differ_in_what_is_seen():
    """As those of the thesis: the same places, of which the one scene has boxes and the other many triangles."""
    simple, complex_ = (flockstep.World.load(f"bench/{name}") for name in ("simple", "complex"))
    assert len(simple.mesh()["triangles"]) < 200
    assert len(complex_.mesh()["triangles"]) > 100_000
    for world in (simple, complex_):
        np.testing.assert_array_equal(world.bounds[:, :2], [[0, 0], [24, 24]])
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=0)
        assert flockstep.plan(world, world.start, [world.goal], cell_m=0.5) is not None
