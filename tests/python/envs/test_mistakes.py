"""Common beginners' mistakes: each error names the mistake and the closest correct choice. Copies of envs."""

import functools
import pickle
import re

import gymnasium
import numpy as np
import pytest
import torch
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep import DroneVectorEnv

ID = "flockstep/LidarNavigation-v0"


def with_sensors(room):
    return flockstep.Batch(
        [room], lidar=flockstep.LidarConfig(name="front"), cameras=[flockstep.CameraConfig(name="below")]
    )


def with_a_material(room):
    scene = room.to_dict()
    scene["materials"]["wood"] = {"base_color": [1, 0.5, 0]}
    scene["boxes"] = [{"center": [1, 1, 1], "size": [0.1, 0.1, 0.1], "material": "woood"}]
    return flockstep.World.from_dict(scene)


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda room: flockstep.DroneModel.load("racer"), "racer5"),
        (lambda room: flockstep.DynamicsConfig(motion="rotor"), "rotors"),
        (lambda room: flockstep.CameraConfig(outputs=["dept"]), "depth"),
        (lambda room: with_sensors(room).lidar("fron"), "front"),
        (lambda room: with_sensors(room).camera("belov"), "below"),
        (lambda room: with_sensors(room).sensor("belov"), "below"),
        (with_a_material, "wood"),
        (lambda room: DroneVectorEnv(worlds=room, autoreset_mode="next_stop"), "'next_step'"),
        (lambda room: DroneVectorEnv(worlds=room, render_view="third_persn"), "'third_person'"),
        (lambda room: flockstep.testing.check_vector_env(DroneVectorEnv, skip=("clos",)), "'close'"),
        (lambda room: flockstep.CamraConfig, "'CameraConfig'"),
    ],
)
def test_misspelt_names(call, meant, room):
    with pytest.raises((ValueError, AttributeError), match=re.escape(f". Did you mean {meant}?") + "$"):
        call(room)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("warehouse", "'indoor/warehouse', 'race/warehouse' or 'warehouse/seed-0'"),
        ("forrest", "'outdoor/forest' or 'forest/seed-0'"),
        ("city", "'outdoor/city' or 'city/seed-0'"),
        ("hall", "'arena/hall'"),
        ("train-1", "'playground/train-1',"),
        ("trian", "'train'"),
        ("playgrund/train-1", "'playground/train-1',"),
        ("living_ofice/seed-7", "'living_office/seed-0'"),
    ],
)
def test_a_misspelt_scene(name, meant):
    """The message compares with the last part of a name, and with generators."""
    in_the_engine = functools.partial(flockstep._core.load_scene, folder=flockstep.scenes.directory())
    for load in (flockstep.scenes.load, flockstep.World.load, flockstep.Batch, in_the_engine):
        with pytest.raises(ValueError, match=re.escape(f"unknown scene '{name}'. Did you mean {meant}")) as raised:
            load(name)
        assert len(str(raised.value)) <= 200


@pytest.mark.parametrize("count", ["4", 4.0, True, 0, None])
def test_number_of_envs(count):
    with refused(ValueError, "num_envs", count):
        DroneVectorEnv(count)


@pytest.mark.parametrize(
    ("other", "field"),
    [
        ({"lidar": flockstep.LidarConfig(beams=7)}, "lidars"),
        ({"step_m": 0.2}, "task"),
        ({"policy_hz": 20}, "clock.policy_hz"),
        ({"bodies": flockstep.BodyConfig()}, "bodies"),
        ({"autoreset_mode": "same_step"}, "autoreset_mode"),
        ({"max_episode_steps": 13}, "max_episode_steps"),
    ],
)
def test_a_snapshot_of_another_env(other, field, closet):
    envs = DroneVectorEnv(2, worlds=closet)
    envs.reset(seed=0)
    with refused(ValueError, "snapshot", field):
        DroneVectorEnv(2, worlds=closet, **other).restore(envs.snapshot())


def test_a_task_object_is_no_task_to_register():
    with refused(TypeError, "task", "each environment"):
        flockstep.register_task("mine/Task-v0", flockstep.Task())


@pytest.mark.parametrize("action", ["discrete", "displacement"])
def test_a_tensor_that_requires_grad(action, closet):
    envs = DroneVectorEnv(2, worlds=closet, action=action)
    envs.reset(seed=0)
    shape = envs.action_space.shape
    with refused(ValueError, "actions", "torch.Tensor", "Use tensor.detach().numpy() instead"):
        envs.step(torch.zeros(shape, requires_grad=True))
    envs.step(torch.zeros(shape, dtype=torch.int64 if action == "discrete" else torch.float32))


@pytest.mark.parametrize("seed", [1.5, True, "1", [1.0, 2.0], [True, False], [1], {1, 2}, -1, 1 << 64, [0, -3]])
def test_seeds_are_integers(seed, closet):
    with refused((TypeError, ValueError), "seed"):
        DroneVectorEnv(2, worlds=closet).reset(seed=seed)
    DroneVectorEnv(2, worlds=closet).reset(seed=(1 << 64) - 2)  # the greatest


def test_seeds_are_recorded(closet):
    envs = DroneVectorEnv(2, worlds=closet)
    for given, recorded in ((np.int64(3), 3), ([7, 5], (7, 5)), (np.array([1, 2]), (1, 2))):
        envs.reset(seed=given)
        assert envs.np_random_seed == recorded


@pytest.mark.parametrize("mode", list(gymnasium.vector.AutoresetMode))
def test_autoreset_as_gymnasium_writes_it(mode, closet):
    for written in (mode, mode.value):
        assert DroneVectorEnv(1, worlds=closet, autoreset_mode=written).autoreset_mode is mode
    with refused(ValueError, "autoreset_mode", "samestep"):
        DroneVectorEnv(1, worlds=closet, autoreset_mode="samestep")


def test_targets_of_a_wrong_width(closet):
    narrow = type("Narrow", (Still,), {"act": lambda self, batch, actions: (batch.position[:, :2], None)})
    envs = DroneVectorEnv(2, worlds=closet, task=narrow)
    envs.reset(seed=0)
    with refused(ValueError, "act: target position", (2, 3), (2, 2)):
        envs.step(envs.action_space.sample())


def test_one_task_object_for_two_envs(closet):
    task = Still()
    envs = DroneVectorEnv(2, worlds=closet, task=task)
    with refused(ValueError, "task", "Still"):
        DroneVectorEnv(2, worlds=closet, task=task)
    envs.reset(seed=0)  # unchanged
    envs.close()
    DroneVectorEnv(2, worlds=closet, task=task).close()
    assert flockstep.sb3.make_vec(Still, 3, worlds=closet).num_envs == 3


# ------------------------------------------------------------------------------------------------------- copies of envs


def test_a_copy_of_a_single_env_and_of_a_task(closet):
    env = gymnasium.make(ID, worlds=closet)
    env.reset(seed=3)
    other = pickle.loads(pickle.dumps(env))
    for _ in range(5):
        np.testing.assert_array_equal(env.step(0)[0], other.step(0)[0])


def test_a_closed_env_has_no_copy(closet):
    envs = DroneVectorEnv(1, worlds=closet)
    envs.close()
    with refused(RuntimeError, "closed"):
        pickle.dumps(envs)
