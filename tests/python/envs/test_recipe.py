"""Recipes: one value that builds the same batch in C++, in Python, and from JSON. Worlds and drones by name."""

import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep import _core, scenes
from flockstep.keywords import FLAT

ENVS: dict[str, dict[str, Any]] = {
    "navigation": {
        "frame_skip": 2,
        "step_m": 0.2,
        "pose_sensor": flockstep.PoseSensorConfig(position_noise_std_m=0.02),
    },
    "blob": {"observation": "blob", "autoreset_mode": "same_step"},
    "hover": {"task": flockstep.HoverConfig(hold_s=0.5), "imu": flockstep.ImuConfig(gyroscope_noise_density=0.01)},
    "track": {"task": flockstep.TrackConfig(), "drones_per_env": 2, "max_tilt_deg": 30.0, "on_contact": "bounce"},
    "race": {"task": flockstep.RaceConfig(laps=1, start="gate"), "worlds": "race/split-s", "max_rate_dps": 500.0},
}


class Rise(Still):
    """Fly upwards."""

    worlds = "validation"
    max_episode_steps = 9

    def step(self, batch: flockstep.Batch) -> Any:
        return batch.position[:, 2], batch.contact.hit


def digest(batch: flockstep.Batch, steps: int = 30) -> str:
    """Hash a batch's results for actions that are independent of everything else."""
    rng = np.random.default_rng(3)
    batch.reset(np.arange(batch.num_envs, dtype=np.uint64))
    hashed = hashlib.sha256()
    action = batch.spec.action
    for _ in range(steps):
        if action.dtype == "int64":
            actions: Any = rng.integers(0, int(action.high) + 1, batch.num_drones)
        else:
            actions = rng.uniform(-1, 1, (batch.num_drones, *action.shape)).astype(np.float32)
        batch.step(actions)
        observation = batch.observation
        parts = observation.values() if isinstance(observation, dict) else [observation]
        for array in (*parts, batch.reward, batch.episode_end, batch.position):
            hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()


@pytest.mark.parametrize("name", ENVS)
def test_python_and_cpp_build_the_same_batch(name: str) -> None:
    envs = flockstep.DroneVectorEnv(3, **ENVS[name])
    text = envs.recipe.to_json()
    by_engine = flockstep.Batch.from_recipe(flockstep.Recipe.from_json(text))
    again = flockstep.DroneVectorEnv.from_recipe(text)
    expected = digest(envs.batch)
    assert digest(by_engine) == expected
    assert digest(again.batch) == expected
    assert again.recipe == envs.recipe
    assert (again.num_envs, again.num_groups) == (envs.num_envs, envs.num_groups)


def test_a_recipe_has_the_defaults_of_its_task() -> None:
    recipe = flockstep.Recipe.from_json('{"task": {"name": "hover"}}')
    assert recipe == flockstep.Recipe(flockstep.HoverConfig())
    assert recipe.dynamics.motion == "rotors"
    assert recipe != flockstep.Recipe(flockstep.HoverConfig(hold_m=0.2))
    assert pickle.loads(pickle.dumps(recipe)) == recipe
    assert json.loads(recipe.to_json())["task"]["name"] == "hover"


def test_a_task_of_your_own_stands_in_it_as_its_registered_id() -> None:
    flockstep.register_task("recipes/Rise-v0", Rise)
    envs = gymnasium.make_vec("recipes/Rise-v0", num_envs=2)
    assert isinstance(envs, flockstep.DroneVectorEnv)
    text = envs.recipe.to_json()
    assert json.loads(text)["task"] == {"name": "recipes/Rise-v0"}
    again = flockstep.DroneVectorEnv.from_recipe(text)
    assert isinstance(again.task, Rise)
    assert digest(again.batch) == digest(envs.batch)
    with refused(ValueError, "task.name", "recipes/Rise-v0"):
        flockstep.Batch.from_recipe(flockstep.Recipe.from_json(text))
    with refused(ValueError, "task.name"):
        flockstep.DroneVectorEnv.from_recipe('{"task": {"name": "recipes/Other-v0"}, "worlds": ["train"]}')


@pytest.mark.parametrize("field", ["worlds", "drone"])
def test_files_are_opened_only_if_the_caller_allows_it(field: str, tmp_path: Path) -> None:
    if field == "worlds":
        path = tmp_path / "own.json"
        path.write_text((scenes.directory() / "playground" / "train-1.json").read_text())
    else:
        path = tmp_path / "drone.json"
        path.write_text(json.dumps(flockstep.DroneModel.load("kingfisher").to_dict()))
    value = [str(path)] if field == "worlds" else str(path)
    text = json.dumps({"task": {"name": "hover"}, field: value})
    recipe = flockstep.Recipe.from_json(text)
    for build in (flockstep.Batch.from_recipe, flockstep.DroneVectorEnv.from_recipe):
        with refused(ValueError, field, "allow_files=True"):
            build(recipe)
    assert flockstep.DroneVectorEnv.from_recipe(text, allow_files=True).num_envs == 1
    assert flockstep.Batch.from_recipe(recipe, allow_files=True).num_drones == 1


def test_a_recipe_from_outside_builds_a_limited_number_of_worlds() -> None:
    text = '{"task": null, "worlds": ["playground/seed-1", "city/seed-0..99999"], "num_envs": 100000}'
    recipe = flockstep.Recipe.from_json(text)
    for build in (flockstep.Batch.from_recipe, flockstep.DroneVectorEnv.from_recipe):
        with refused(ValueError, "worlds"):
            build(recipe)
    recipe.worlds, recipe.num_envs = ["playground/seed-0..2"], 3
    with refused(ValueError, "worlds"):
        flockstep.Batch.from_recipe(recipe, max_worlds=2, allow_files=True)
    assert len(flockstep.Batch.from_recipe(recipe, max_worlds=3).worlds) == 3
    assert len(flockstep.DroneVectorEnv(1, worlds="playground/seed-0..1").batch.worlds) == 2


def test_worlds_given_as_objects_are_not_in_the_recipe() -> None:
    world = scenes.load_one("playground/train-1")
    envs = flockstep.DroneVectorEnv(2, worlds=world)
    assert envs.recipe.worlds == []
    with refused(ValueError, "worlds"):
        flockstep.Batch.from_recipe(envs.recipe)


def test_every_name_of_a_scene_is_known_to_the_engine() -> None:
    bundled = [name for members in scenes.SETS.values() for name in members if "/seed-" not in name]
    assert set(bundled) <= set(scenes.names())
    with refused(ValueError, "worlds", "unknown scene"):
        _core.load_scene("no/such", scenes.directory())
    for name in bundled:
        _core.load_scene(name, scenes.directory())
    for name in ("playground/seed-3", "playground/train-1", "bench/simple"):
        envs = flockstep.DroneVectorEnv(1, worlds=name)
        batch = flockstep.Batch.from_recipe(envs.recipe)
        assert batch.worlds[0].to_dict() == envs.batch.worlds[0].to_dict()


def test_keywords_change_a_recipe() -> None:
    envs = flockstep.DroneVectorEnv(2, policy_hz=20, max_episode_steps=50, autoreset_mode="same_step", drones_per_env=3)
    changes = {"policy_hz": 25, "max_episode_steps": 9, "autoreset_mode": AutoresetMode.DISABLED}
    changed = flockstep.DroneVectorEnv.from_recipe(envs.recipe, **changes)
    episode = changed.recipe.episode
    assert (changed.recipe.clock.policy_hz, episode.max_episode_steps, episode.autoreset_mode) == (25, 9, "disabled")
    assert (changed.autoreset_mode, changed.drones_per_env) == (AutoresetMode.DISABLED, 3)


def test_whole_configurations_and_single_fields_make_the_same_recipe() -> None:
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity", max_speed_mps=3)
    whole = {"clock": flockstep.ClockConfig(policy_hz=20), "dynamics": dynamics, "lidar": flockstep.LidarConfig()}
    single = {"policy_hz": 20, "motion": "rotors", "control": "velocity", "max_speed_mps": 3, "lidar": [whole["lidar"]]}
    envs, others = (gymnasium.make_vec("flockstep/Hover-v0", 2, **keywords) for keywords in (whole, single))
    assert envs.unwrapped.recipe == others.unwrapped.recipe
    plain = json.loads(envs.spec.to_json())["kwargs"]
    again = flockstep.DroneVectorEnv(2, **{name: plain[name] for name in ("task", *whole)})
    assert again.recipe.dynamics == dynamics
    assert pickle.loads(pickle.dumps(again)).recipe == again.recipe


# --- worlds and drones by name, and fields of a task as keywords of its env


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
    if field in FLAT
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
