"""Worlds in which every leg is blocked, and flyers that have learned nothing."""

import pytest
from messages import refused

from thesis import claims
from training import evaluate, tasks


@pytest.mark.parametrize("task", ["lidar", "camera"])
def test_every_leg_of_a_blocked_playground_is_blocked(task):
    setup = tasks.Setup(task)
    worlds = setup.generated(range(3, 100), 6, ahead=False, blocked=True)
    assert [world.name for world in worlds] == [f"playground/seed-{seed}" for seed in range(3, 9)]
    free, added = [], 0
    for world in worlds:
        route = setup.route(world)
        legs = [route[i : i + 2] for i in range(len(route) - 1)]
        free += tasks.fly_routes([world] * len(legs), legs)
        added += len(world.to_dict()["cylinders"]) - 12
        assert tasks.fly_routes([world], [evaluate.shortest_path(world, setup)]) == [True]
    assert not any(free)
    assert added > 0


def test_a_playground_without_room_for_a_pillar_is_left_out(monkeypatch):
    monkeypatch.setattr(tasks, "MARKER_CLEARANCE_M", 9.0)
    with refused(ValueError, "count", 0, 2):
        tasks.Setup().generated(range(3, 5), 2, blocked=True)


@pytest.mark.parametrize("task", ["lidar", "camera"])
def test_flyers_that_have_learned_nothing_are_compared(task, monkeypatch):
    monkeypatch.setattr(claims, "WORLDS", 20)
    monkeypatch.setattr(claims, "CHOSEN_BY", 20)
    monkeypatch.setattr(claims, "REACTIVE", [(0.1, 0.0, 0.0), (1.8, 2.0, 45.0)])
    found = {name: (value["value"], value) for value in claims.claimed(task, ahead=False) for name in [value["name"]]}
    success = {name.removesuffix("/success"): value for name, (value, _) in found.items() if name.endswith("/success")}
    assert list(success) == ["policy", "straight", "reactive", "planner"]
    assert success["planner"] == 1
    assert success["straight"] < min(success["reactive"], success["policy"])
    assert found["reactive/success"][1]["settings"] == [1.8, 2.0, 45.0]
    for name, (value, about) in found.items():
        assert about["least"] <= value <= about["greatest"], name
