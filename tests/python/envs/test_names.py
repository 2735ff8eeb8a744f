"""Worlds and drones can be given by name everywhere, and fields of a task's configuration as keywords of its env."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from messages import refused
from simple_tasks import Still

import flockstep

ONE = "playground/train-1"
TRAIN = [f"playground/train-{i}" for i in range(1, 6)]
RACER = Path(flockstep.scenes.directory()).parent / "drones" / "racer5.json"
WORLDS = [
    (flockstep.World.load(ONE), [ONE]),
    (ONE, [ONE]),
    (flockstep.scenes.directory() / f"{ONE}.json", [ONE]),
    ("train", TRAIN),
    ([ONE, flockstep.World.load("playground/train-2")], TRAIN[:2]),
    (("train", ONE), [*TRAIN, ONE]),
]


@pytest.mark.parametrize(("worlds", "names"), WORLDS)
def test_worlds(worlds, names):
    own = type("Own", (Still,), {"worlds": worlds})
    for batch in (
        flockstep.Batch(worlds, 2),
        flockstep.DroneVectorEnv(2, worlds=worlds).batch,
        flockstep.DroneVectorEnv(2, task=own).batch,
        gymnasium.make("flockstep/LidarNavigation-v0", worlds=worlds).unwrapped.batch,
    ):
        assert [world.name for world in batch.worlds] == names


@pytest.mark.parametrize("drone", ["racer5", flockstep.DroneModel.load("racer5"), RACER])
def test_drones(drone, room):
    if isinstance(drone, Path) and not drone.exists():
        pytest.fail("the drones of a checkout lie beside its scenes")
    racer = flockstep.DroneModel.load("racer5")
    own = type("Own", (Still,), {"drone": drone})
    for batch in (
        flockstep.Batch(room, drone=drone),
        flockstep.DroneVectorEnv(worlds=room, drone=drone).batch,
        flockstep.DroneVectorEnv(worlds=room, task=own).batch,
    ):
        np.testing.assert_array_equal(batch.drone.hull, racer.hull)
    for call in (
        lambda model: room.free_places(5, drone=model),
        lambda model: room.with_drawn_markers(3, drone=model).start,
        lambda model: flockstep.plan(room, room.start, [room.goal], model, 0.3),
    ):
        np.testing.assert_array_equal(call(drone), call(racer))
    assert not np.array_equal(room.free_places(5, drone=drone), room.free_places(5))
    assert room.check(drone)["not_navigable"] is None


def test_calls_for_one_world():
    world = flockstep.World.load(ONE)
    shortest = flockstep.plan(world, world.start, [world.goal], cell_m=0.3)
    np.testing.assert_array_equal(flockstep.plan(ONE, world.start, [world.goal], cell_m=0.3), shortest)
    camera = flockstep.CameraConfig(width_px=8, height_px=6)
    taken = flockstep.render(world, world.start, camera=camera)["rgb"]
    np.testing.assert_array_equal(flockstep.render(ONE, world.start, camera=camera)["rgb"], taken)
    for call in (lambda: flockstep.plan("train", [0, 0, 0], [[1, 1, 1]]), lambda: flockstep.render("train", [0, 0, 0])):
        with refused(ValueError, "world", "5 ('train')"):
            call()
    with refused(TypeError, "drone"):
        flockstep.plan(world, world.start, [world.goal], drone=3)


OTHER = {"path": "random", "yaw": "along", "points": 3}
OTHER |= {"laps": 2, "cap_episodes": 2, "gates_ahead": 1, "start": "gate", "speed_cap_mps": (5.0, 9.0)}
FIELDS = [
    (name, config, field)
    for name, config in (
        ("Hover", flockstep.HoverConfig),
        ("Track", flockstep.TrackConfig),
        ("Race", flockstep.RaceConfig),
    )
    for field in config.__match_args__
]


@pytest.mark.parametrize(("name", "config", "field"), FIELDS)
def test_fields_of_a_task_are_keywords(name, config, field):
    value = OTHER[field] if field in OTHER else 0.1 + 0.6 * getattr(config(), field)
    made = gymnasium.make_vec(f"flockstep/{name}-v0", 1, **{field: value})
    assert made.unwrapped.task == config(**{field: value}) != config()
    assert gymnasium.make_vec(f"flockstep/{name}-v0", 1).unwrapped.task == config()


def test_a_field_changes_the_flight_and_not_the_configuration_given():
    task = flockstep.HoverConfig()
    level = flockstep.DroneVectorEnv(64, task=task, start_tilt_deg=0).reset(seed=0)[0][:, 8]
    tilted = flockstep.DroneVectorEnv(64, task=task).reset(seed=0)[0][:, 8]
    np.testing.assert_allclose(level, 1, atol=1e-6)  # up in the body frame
    assert tilted.min() < 0.5
    assert task == flockstep.HoverConfig()
    single = gymnasium.make("flockstep/Hover-v0", start_tilt_deg=0)
    assert single.reset(seed=0)[0][8] == pytest.approx(1)
    with refused(ValueError, "task.start_tilt_deg", 200):
        flockstep.DroneVectorEnv(task=task, start_tilt_deg=200)
