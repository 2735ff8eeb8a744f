"""Planned paths: collision-free, close to the shortest, found in large worlds, and the progress display."""

import io
import itertools
import time

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

import flockstep
from flockstep import _core, planning


def length(path):
    return float(np.linalg.norm(np.diff(np.asarray(path, float), axis=0), axis=1).sum())


def assert_free(world, path):
    batch = flockstep.Batch([world])
    batch.set_pose(path[:1])
    assert not any(bool(batch.move(corner[None]).hit[0]) for corner in path[1:])


# The lengths come from the former planner, on the finest grids that it accepted or finished within a minute.
@pytest.mark.parametrize(
    ("place", "seed", "former_m"),
    [
        ("forest", 10, 54.417),
        ("forest", 14, 54.754),
        ("city", 10, 168.904),
        ("office", 0, 38.657),
        ("warehouse", 6, 45.659),
    ],
)
def test_generated_worlds_are_planned_by_default(place, seed, former_m):
    world = getattr(flockstep.World, place)(seed)
    path = flockstep.plan(world, world.start, [world.goal])
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [world.start, world.goal])
    assert length(path) < 1.05 * former_m
    assert_free(world, path)
    np.testing.assert_array_equal(flockstep.plan(world, world.start, [world.goal]), path)


def test_a_goal_in_a_closed_box_is_given_up_soon():
    """A search from the start through a whole office took half a minute of processor time."""
    world = flockstep.World.office(0)
    scene = world.to_dict()
    for axis, side in itertools.product(range(3), (-0.8, 0.8)):
        center, size = world.goal.astype(float), [1.7] * 3
        center[axis] += side
        size[axis] = 0.05
        scene.setdefault("boxes", []).append({"center": center.tolist(), "size": size})
    shut = flockstep.World.from_dict(scene)
    before = time.process_time()
    assert flockstep.plan(shut, world.start, [world.goal]) is None
    assert time.process_time() - before < 10


HALF = np.array([0.3, 0.2, 0.1])  # half size of a box-shaped drone, for which every obstacle blocks a box of positions
ROOM = np.array([4.0, 3.0, 2.0])
STEP = 0.1


def shortest_on_a_grid(low, high, start, goal):
    """Return the length of the shortest path between neighbours of a grid, around boxes (K, 3) to (K, 3)."""
    axes = [np.arange(1, round(size / STEP)) * STEP for size in ROOM]
    shape = tuple(len(axis) for axis in axes)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    is_free = ((places > HALF) & (places < ROOM - HALF)).all(axis=-1)
    for a, b in zip(low - HALF, high + HALF, strict=True):
        is_free &= ((places < a) | (places > b)).any(axis=-1)
    index = np.arange(is_free.size).reshape(shape)
    rows, columns, lengths = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, shape, strict=True))
        both = is_free[here] & is_free[there]
        rows.append(index[here][both])
        columns.append(index[there][both])
        lengths.append(np.full(both.sum(), STEP * np.linalg.norm(step)))
    edges = (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns)))
    graph = csr_matrix(edges, (is_free.size, is_free.size))
    at = [index[tuple(np.rint(np.array(place) / STEP).astype(int) - 1)] for place in (start, goal)]
    return float(dijkstra(graph, directed=False, indices=at[0])[at[1]])


def test_paths_are_as_short_as_on_a_fine_grid():
    """Moves to the 26 neighbours lengthen a path by at most 12.8 %; beside obstacles it is up to one cell off."""
    drone = flockstep.DroneModel(hull=np.array(list(itertools.product(*([-h, h] for h in HALF))), np.float32))
    start, goal = (0.5, 1.5, 1.0), (3.5, 1.5, 1.0)
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(8):
        # A wall across the room, with a window or room to pass over it, and boxes around it.
        top, door = rng.uniform(1.0, 2.0), rng.uniform(0.3, 2.1)
        low = [[1.7, 0, 0], [1.7, door + rng.uniform(0.5, 0.8), 0], *rng.uniform((0.9, 0.3, 0), (1.1, 2, 1.2), (3, 3))]
        size = [[0.2, door, top], [0.2, 3, top], *rng.uniform(0.2, 0.5, (3, 3))]
        low, high = np.array(low), np.minimum(np.array(low) + size, ROOM)
        boxes = [{"center": ((a + b) / 2).tolist(), "size": (b - a).tolist()} for a, b in zip(low, high, strict=True)]
        scene = {"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": ROOM.tolist()}, "boxes": boxes}
        world = flockstep.World.from_dict(scene)
        on_grid = shortest_on_a_grid(low, high, start, goal)
        path = flockstep.plan(world, start, [goal], drone=drone)
        if not np.isfinite(on_grid):
            continue
        found += 1
        assert path is not None
        assert on_grid / 1.128 - 0.06 <= length(path) <= 1.02 * on_grid
        assert_leg_by_leg_free(path, low, high)
    assert found >= 5


def assert_leg_by_leg_free(path, low, high):
    for a, b in itertools.pairwise(np.asarray(path, float)):
        places = a + np.linspace(0, 1, 200)[:, None] * (b - a)
        is_in = ((places[:, None] > low - HALF) & (places[:, None] < high + HALF)).all(axis=-1)
        assert not is_in.any()


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(planning.time, "monotonic", lambda: now[0])
    return now


def test_a_short_search_shows_nothing(clock, monkeypatch):
    monkeypatch.setattr("sys.stderr", out := Terminal())
    shown = planning._Progress()
    for clock[0] in (100.5, 101.9):
        shown(0.5)
    shown.end()
    assert out.getvalue() == ""


def test_a_long_search_shows_a_bar_on_a_terminal_and_takes_it_away(clock, monkeypatch):
    monkeypatch.setattr("sys.stderr", out := Terminal())
    shown = planning._Progress()
    for clock[0], share in ((101, 0.1), (102, 0.2), (103.4, 0.5)):
        shown(share)
    assert out.getvalue() == f"\rplan [{'#' * 6}{'.' * 24}]  20%, 2 s\rplan [{'#' * 15}{'.' * 15}]  50%, 3 s"
    shown.end()
    assert out.getvalue().endswith("\r\x1b[K")


def test_a_long_search_writes_few_lines_into_a_file(clock, monkeypatch):
    monkeypatch.setattr("sys.stderr", out := io.StringIO())
    shown = planning._Progress()
    for second in range(31):
        clock[0] = 100 + second
        shown(second / 100)
    shown.end()
    assert out.getvalue() == "plan: 2%, 2 s\nplan: 12%, 12 s\nplan: 22%, 22 s\n"


def test_progress_grows_and_what_it_raises_ends_the_search():
    world = flockstep.World.office(2)
    shares = []
    assert _core.plan(world, world.start, [world.goal], progress=shares.append) is not None
    assert shares
    assert all(0 <= a <= b <= 1 for a, b in itertools.pairwise([0, *shares]))

    def refuse(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _core.plan(world, world.start, [world.goal], progress=refuse)
