"""Generated worlds: reproducible from a seed, passable, with matching pictures and ranges, and checked arguments."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import placed
from messages import refused

import flockstep

World = flockstep.World


class Kind(NamedTuple):
    """Expectations for one generator."""

    small: dict[str, Any]  # arguments of a small world
    cell_m: float  # of the planner's grid
    planned: tuple[int, ...]  # seeds to plan in
    chord_error_m: float
    triangles: int  # of the small world with seed 3
    vertex_sum: tuple[float, float, float]
    blocked: tuple[int, int]  # number of seeds, and minimum number of those with a blocked straight flight
    blocked_small: bool  # count these in small worlds


KINDS = {
    "city": Kind(
        {"blocks": (1, 1), "height_m": 20}, 1.8, (0, 1), 0.01, 28948, (1883953.88, 1947576.25, 190416.99), (8, 7), True
    ),
    "forest": Kind(
        {"trees": 40, "size_m": (30, 20)},
        0.4,
        (0, 1, 2, 3),
        1e-3,
        5760,
        (65704.07, 42307.01, 23966.74),
        (20, 16),
        False,
    ),
    "office": Kind(
        {"size_m": (22, 14), "furniture": 0.5},
        0.4,
        (0, 1, 2),
        1e-3,
        20468,
        (341802.93, 251554.24, 27832.0),
        (6, 6),
        False,
    ),
    "warehouse": Kind(
        {"size_m": (30, 18), "height_m": 6}, 0.5, (0, 2), 1e-3, 14404, (350146.49, 210925.51, 58418.8), (6, 6), False
    ),
}
ALL = pytest.mark.parametrize("name", KINDS)


def small(name: str, seed: int, **changed: Any) -> World:
    return getattr(World, name)(seed, **KINDS[name].small | changed)


@ALL
def test_the_same_arguments_make_the_same_world(name):
    kind = KINDS[name]
    first = small(name, 3)
    data = first.to_dict()
    assert data == small(name, 3).to_dict()
    assert data != small(name, 4).to_dict()
    # Computed with correctly rounded operations, so it is the same on every machine.
    mesh = first.mesh(chord_error_m=kind.chord_error_m)
    assert len(mesh["triangles"]) == kind.triangles
    np.testing.assert_allclose(mesh["vertices"].astype(float).sum(axis=0), kind.vertex_sum, rtol=1e-6)


@pytest.mark.parametrize(("name", "seed"), [(name, seed) for name, kind in KINDS.items() for seed in kind.planned])
def test_a_planner_finds_a_way(name, seed):
    world = World.city(seed, (1 + seed, 1), 16) if name == "city" else small(name, seed)
    way = flockstep.plan(world, world.start, [world.goal], cell_m=KINDS[name].cell_m)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [world.start, world.goal])


@ALL
def test_a_straight_flight_is_blocked(name):
    """The straight flight is blocked for most seeds; otherwise there would be nothing to learn."""
    kind, hits = KINDS[name], 0
    seeds, least = kind.blocked
    for seed in range(seeds):
        world = small(name, seed) if kind.blocked_small else getattr(World, name)(seed)
        batch = placed([world], world.start[None])
        hits += bool(batch.move(world.goal[None]).hit[0])
    assert hits >= least


def start_free(world: World, seed: int) -> None:
    flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=seed)


def test_drones_start_free_in_many_cities():
    for seed in range(6):
        world = small("city", seed)
        start_free(world, seed)
        assert 44 <= world.goal[0] - world.start[0] <= 56  # one block and one road
        for place in (world.start, world.goal):
            down = world.raycast(place[None], np.float32([[0, 0, -1]]), 100)["t_hit"][0]
            assert 2 < down < 6  # above a road
            assert down == pytest.approx(place[2], abs=1e-3)


def test_drones_start_free_in_many_forests():
    for seed in range(30):
        world = small("forest", seed, relief_m=seed)
        start_free(world, seed)
        assert world.goal[0] - world.start[0] == pytest.approx(24)


@pytest.mark.parametrize("furniture", [0, 1])
def test_drones_start_free_in_many_offices(furniture):
    for seed in range(5):
        start_free(World.office(seed, size_m=(20 + 3 * seed, 14 + seed / 2), furniture=furniture), seed)


def test_drones_start_free_in_many_warehouses():
    for seed in range(8):
        start_free(World.warehouse(seed, size_m=(26 + 2 * seed, 16 + 2 * seed), height_m=5 + seed % 5), seed)


NAN = float("nan")


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("city", {"blocks": (0, 1)}, ("blocks[0]", 1, 8, 0)),
        ("city", {"blocks": (3, 9)}, ("blocks[1]",)),
        ("city", {"height_m": 11}, ("height_m", 12, 200, 11)),
        ("city", {"height_m": NAN}, ("height_m",)),
        ("forest", {"trees": -1}, ("trees", 0, 5000, -1)),
        ("forest", {"trees": 5001}, ("trees",)),
        ("forest", {"size_m": (11, 40)}, ("size_m[0]", 12, 500, 11)),
        ("forest", {"size_m": (60, NAN)}, ("size_m[1]",)),
        ("forest", {"relief_m": 51}, ("relief_m", 0, 50, 51)),
        ("forest", {"trees": 5000, "size_m": (12, 12)}, ("trees", "12 x 12 m")),
        ("office", {"size_m": (19, 20)}, ("size_m[0]", 20, 200, 19)),
        ("office", {"size_m": (36, 13)}, ("size_m[1]", 14, 200, 13)),
        ("office", {"size_m": (36, NAN)}, ("size_m[1]",)),
        ("office", {"furniture": 1.5}, ("furniture", 0, 1, "1.5")),
        ("office", {"furniture": NAN}, ("furniture",)),
        ("warehouse", {"size_m": (25, 30)}, ("size_m[0]", 26, 200, 25)),
        ("warehouse", {"size_m": (48, 15)}, ("size_m[1]", 16, 200, 15)),
        ("warehouse", {"size_m": (48, NAN)}, ("size_m[1]",)),
        ("warehouse", {"height_m": 4.5}, ("height_m", 5, 20, "4.5")),
        ("warehouse", {"height_m": NAN}, ("height_m",)),
    ],
)
def test_bad_arguments(name, arguments, said):
    with refused(ValueError, name, *said):
        getattr(World, name)(1, **arguments)


@pytest.mark.parametrize(
    ("positional", "keywords", "message"),
    [
        ((), {}, ("missing 1 required positional argument", "seed")),
        ((1, 150), {"trees": 3}, ("multiple values for argument 'trees'",)),
        ((1, 150, (60, 40), 4, 5), {}, ("takes at most 4 arguments, got 5",)),
        ((1,), {"tree": 3}, ("unexpected keyword argument 'tree'. Did you mean 'trees'",)),
        ((1, "many"), {}, ("trees", "many")),
    ],
)
def test_arguments_are_the_fields_of_the_configuration(positional, keywords, message):
    with refused(TypeError, *message):
        World.forest(*positional, **keywords)
    assert World.forest(1, 9).to_dict() == World.forest(seed=1, trees=9).to_dict()


@pytest.mark.parametrize("height", [12, 90])
def test_roofs_of_cities_are_as_high_as_asked(height):
    """Objects on a roof come on top of that."""
    world = World.city(5, (2, 2), height)
    assert 0.6 * height < world.bounds[1, 2] < height + 12


def test_cameras_in_cities_see_classes():
    """Each kind of object has its class; a road is below, houses are around."""
    world = small("city", 3)
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


def test_markers_of_forests_are_above_the_ground():
    for seed in range(5):
        world = small("forest", seed, relief_m=20)
        places = np.stack([world.start, world.goal])
        down = world.raycast(places, np.tile(np.float32([0, 0, -1]), (2, 1)), 100)
        np.testing.assert_allclose(down["t_hit"], 1.5, atol=0.15)  # flat cells cut off the hills' curvature


def test_start_and_goal_are_at_opposite_ends():
    assert all(world.goal[0] - world.start[0] > 24 for world in map(World.office, range(6)))
    assert all(world.goal[0] - world.start[0] == pytest.approx(43.2) for world in map(World.warehouse, range(6)))


def test_offices_have_ceilings_and_windows():
    """Straight up there is a ceiling 3 m above the floor; level views see the sky through windows."""
    world = World.office(1)
    places = np.stack([world.start, world.goal])
    up, down = (world.raycast(places, np.tile(np.float32([0, 0, z]), (2, 1)), 100)["t_hit"] for z in (1, -1))
    np.testing.assert_allclose(down, 1.35, atol=1e-5)
    np.testing.assert_allclose(up, 1.65, atol=0.03)  # or a lamp
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False, dtype=np.float32)
    level = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    for place in places:
        hits = world.raycast(np.tile(place, (720, 1)), level, 100)["t_hit"]
        assert 0.02 < np.isinf(hits).mean() < 0.8


def test_the_sky_is_seen_through_skylights_of_warehouses():
    world = small("warehouse", 1)
    x, y = np.meshgrid(np.linspace(1, 29, 60), np.linspace(1, 17, 40))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)], 1).astype(np.float32)
    up = world.raycast(places, np.tile(np.float32([0, 0, 1]), (x.size, 1)), 100)["t_hit"]
    assert 0.05 < np.isinf(up).mean() < 0.3
    assert up[np.isfinite(up)].max() < 6 + 0.06 * 18 - 5 + 0.2


@pytest.mark.parametrize("make", [World.office, World.warehouse])
def test_waypoints_lead_along_the_way_that_is_flown(make):
    plain, world = make(2), make(2, waypoints=True)
    assert plain.waypoints.shape == (0, 3)
    (named,) = flockstep.scenes.load(f"guided_{world.name}")
    data = world.to_dict()
    assert data == named.to_dict()
    del data["markers"]["waypoints"]
    assert data == plain.to_dict()  # nothing else differs
    stops = np.concatenate([[world.start], world.waypoints, [world.goal]]).astype(np.float32)
    batch = placed([world], stops[:-1], num_threads=1)
    batch.move(stops[1:])
    assert not batch.contact.hit.any()


def test_the_bench_scenes_differ_in_what_is_seen():
    """The same places as in the thesis, with boxes in one scene and many triangles in the other."""
    simple, complex_ = (World.load(f"bench/{name}") for name in ("simple", "complex"))
    assert len(simple.mesh()["triangles"]) < 200
    assert len(complex_.mesh()["triangles"]) > 100_000
    for world in (simple, complex_):
        np.testing.assert_array_equal(world.bounds[:, :2], [[0, 0], [24, 24]])
        flockstep.DroneVectorEnv(2, worlds=world, random_start=True).reset(seed=0)
        assert flockstep.plan(world, world.start, [world.goal], cell_m=0.5) is not None
