"""Planned paths: collision-free, close to the shortest, found in large worlds, and the progress display."""

import io
import itertools
import time

import numpy as np
import pytest
from conftest import placed

import flockstep
from flockstep import _core, planning


def length(path):
    return float(np.linalg.norm(np.diff(np.asarray(path, float), axis=0), axis=1).sum())


def assert_free(world, path):
    batch = placed([world], path[:1])
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
