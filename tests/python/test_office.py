"""Generated offices: the same for a seed, a way through them, pictures and ranges that agree, bad arguments."""

import numpy as np
import pytest

import flockstep

SMALL = {"size_m": (22, 14), "furniture": 0.5}


def test_the_same_arguments_make_the_same_office():
    first, again = flockstep.World.office(3, **SMALL), flockstep.World.office(3, **SMALL)
    assert first.to_dict() == again.to_dict()
    assert first.to_dict() != flockstep.World.office(4, **SMALL).to_dict()
    # Made of correctly rounded operations, so that it is the same on every machine.
    mesh = first.mesh()
    vertices, triangles = mesh["vertices"], mesh["triangles"]
    assert len(triangles) == 20468
    np.testing.assert_allclose(vertices.astype(float).sum(axis=0), [341802.93, 251554.24, 27832.0], rtol=1e-6)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_planner_finds_a_way(seed):
    world = flockstep.World.office(seed, **SMALL)
    way = flockstep.plan(world, world.start, [world.goal], cell_m=0.4)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [world.start, world.goal])


def test_walls_are_in_the_way_of_a_straight_flight():
    for seed in range(6):
        world = flockstep.World.office(seed)
        assert world.goal[0] - world.start[0] > 24
        batch = flockstep.Batch([world])
        batch.set_pose(world.start[None])
        assert batch.move(world.goal[None]).hit[0]


@pytest.mark.parametrize("furniture", [0, 1])
def test_drones_start_free_in_many_offices(furniture):
    for seed in range(5):
        world = flockstep.World.office(seed, size_m=(20 + 3 * seed, 14 + seed / 2), furniture=furniture)
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=seed)


def test_rooms_are_closed_but_for_their_windows():
    """Straight up there is a ceiling 3 m above the floor; level, the sky is seen through windows."""
    world = flockstep.World.office(1)
    places = np.stack([world.start, world.goal])
    up, down = (world.raycast(places, np.tile(np.float32([0, 0, z]), (2, 1)), 100)["t_hit"] for z in (1, -1))
    np.testing.assert_allclose(down, 1.35, atol=1e-5)
    np.testing.assert_allclose(up, 1.65, atol=0.03)  # or a lamp
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False, dtype=np.float32)
    level = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    for place in places:
        hits = world.raycast(np.tile(place, (720, 1)), level, 100)["t_hit"]
        assert 0.02 < np.isinf(hits).mean() < 0.8


def test_threads_and_company_change_no_bits():
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("rgb", "depth"), shadows=True)
    actions = np.random.default_rng(0).integers(0, 6, (12, 8))
    world = flockstep.World.office(2)

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
        ({"size_m": (19, 20)}, r"office: size_m\[0\]: expected a number in \[20, 200\], got 19"),
        ({"size_m": (36, 13)}, r"office: size_m\[1\]: expected a number in \[14, 200\], got 13"),
        ({"size_m": (36, float("nan"))}, r"office: size_m\[1\]"),
        ({"furniture": 1.5}, r"office: furniture: expected a number in \[0, 1\], got 1.5"),
        ({"furniture": float("nan")}, "office: furniture"),
    ],
)
def test_bad_arguments(arguments, match):
    with pytest.raises(ValueError, match=match):
        flockstep.World.office(1, **arguments)


@pytest.mark.parametrize("make", [flockstep.World.office, flockstep.World.warehouse])
def test_waypoints_lead_along_the_way_that_is_flown(make):
    plain, world = make(2), make(2, waypoints=True)
    assert plain.waypoints.shape == (0, 3)
    data = world.to_dict()
    del data["markers"]["waypoints"]
    assert data == plain.to_dict()  # nothing else differs
    stops = np.concatenate([[world.start], world.waypoints, [world.goal]]).astype(np.float32)
    batch = flockstep.Batch([world], len(stops) - 1, num_threads=1)
    batch.set_pose(stops[:-1])
    batch.move(stops[1:])
    assert not batch.contact.hit.any()
    (named,) = flockstep.scenes.load(f"guided_{world.name}")
    assert named.to_dict() == world.to_dict()
