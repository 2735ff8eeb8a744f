"""Common beginners' mistakes: each error names the mistake and the closest correct choice."""

import copy
import functools
import pickle
import re

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from messages import refused

import flockstep
from flockstep import DroneVectorEnv

ID = "flockstep/LidarNavigation-v0"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: DroneVectorEnv(max_episode_step=3),
            "DroneVectorEnv.__init__() got an unexpected keyword argument 'max_episode_step'. "
            "Did you mean 'max_episode_steps'?",
        ),
        (
            lambda: DroneVectorEnv(quite_something_else=3),
            "DroneVectorEnv.__init__() got an unexpected keyword argument 'quite_something_else'",
        ),
        (
            lambda: flockstep.LidarConfig(beam=3),
            "LidarConfig.__init__() got an unexpected keyword argument 'beam'. Did you mean 'beams'?",
        ),
        (
            lambda: flockstep.Batch([], num_drone=3),
            "Batch.__init__() got an unexpected keyword argument 'num_drone'. Did you mean 'num_drones'?",
        ),
        (lambda: flockstep.Batch(3), "worlds: expected a name, a path, a World or a sequence of these, got 3"),
        (lambda: flockstep.Batch([3]), "worlds: expected a name, a path or a World, got int"),
        (
            lambda: DroneVectorEnv(hold_m=3),
            "hold_m: a keyword of the hover task, but another task is given",
        ),
        (
            lambda: DroneVectorEnv(task=flockstep.HoverConfig(), step_m=3),
            "step_m: a keyword of the navigation, dodge, swap and formation tasks, but another task is given",
        ),
        (
            lambda: DroneVectorEnv(task=flockstep.HoverConfig(), hold_x=3),
            "DroneVectorEnv.__init__() got an unexpected keyword argument 'hold_x'. Did you mean 'hold_s'?",
        ),
        (
            lambda: flockstep.Batch([flockstep.World.playground(0)], camera=3),
            "camera: expected a flockstep.CameraConfig, None or a sequence of flockstep.CameraConfig objects, got 3",
        ),
        (
            lambda: flockstep.Batch([flockstep.World.playground(0)], "4"),
            "num_drones: expected an integer, got '4'",
        ),
        (
            lambda: DroneVectorEnv(lidar={1: 2}),
            "lidar: expected a flockstep.LidarConfig, None or a sequence of flockstep.LidarConfig objects, got {1: 2}",
        ),
        (
            lambda: DroneVectorEnv(lights="noon"),
            "lights: expected a flockstep.Light, None or a sequence of flockstep.Light objects, got 'noon'",
        ),
        (
            lambda: DroneVectorEnv(policy_hz=30, clock=flockstep.ClockConfig(policy_hz=20)),
            "policy_hz: expected one value, got policy_hz=30.0 and clock.policy_hz=20.0",
        ),
        (
            lambda: DroneVectorEnv(rate_hz=3),
            "rate_hz: a field of a configuration: give it as pose_sensor=flockstep.PoseSensorConfig(rate_hz=...)",
        ),
        (
            lambda: flockstep.Batch([], camera=[], cameras=[]),
            "camera: expected None with cameras, another name of it",
        ),
        (
            lambda: DroneVectorEnv(task="flockstep/Swap-v0"),
            "got 'flockstep/Swap-v0'. gymnasium.make_vec makes an env of an id",
        ),
        (
            lambda: DroneVectorEnv(drone=4),
            "drone: expected a flockstep.DroneModel, the name or path of one, or None, got 4",
        ),
        (
            lambda: DroneVectorEnv(worlds=3),
            "worlds: expected a name, a path, a World or a sequence of these, got 3",
        ),
        (
            lambda: flockstep.register_task("mine/Task-v0", {}),
            "task: expected a subclass of flockstep.Task or the path of a library, got {}",
        ),
        (
            lambda: flockstep.register_task("mine/Task-v0", dict),
            "task: expected a subclass of flockstep.Task or the path of a library, got <class 'dict'>",
        ),
        (
            lambda: flockstep.register_task("mine/Task-v0", flockstep.Task()),
            ": give its class, so that each environment gets a task of its own",
        ),
        (
            lambda: flockstep.NativeTask(3),
            "path: expected the path of a shared library (a str or a Path), got 3",
        ),
        (
            lambda: flockstep.sb3.make_vec(ID, 2, autoreset_mode="disabled"),
            "make_vec: autoreset_mode cannot be chosen: it needs same-step autoreset",
        ),
    ],
)
def test_a_wrong_type_or_name(make, said):
    with pytest.raises(TypeError, match=re.escape(said)):
        make()


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


ROOM = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [9, 9, 9]}})


class Homeless(flockstep.Task):
    observation_space = spaces.Box(0, 9, (3,), np.float32)

    def step(self, batch):
        return np.zeros(batch.num_drones), batch.contact.hit

    def observe(self, batch):
        return batch.position


def restored(**keywords):
    envs = DroneVectorEnv(2, worlds=ROOM.with_drawn_markers(0))
    envs.reset(seed=0)
    DroneVectorEnv(2, worlds=ROOM.with_drawn_markers(0), **keywords).restore(envs.snapshot())


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (
            lambda: DroneVectorEnv(task=Homeless),
            ValueError,
            "Homeless declares no worlds: set Homeless.worlds = 'train', or pass worlds=",
        ),
        (
            lambda: flockstep.World.load("a.fbx"),
            ValueError,
            "'a.fbx': .fbx files are not supported: export glTF (.glb)",
        ),
        (
            lambda: DroneVectorEnv.from_recipe('{"worlds": ["/etc/passwd"]}'),
            ValueError,
            'this recipe may only use bundled scenes and drones, not "/etc/passwd"; pass allow_files=True',
        ),
        (lambda: restored(policy_hz=20), ValueError, "got one that differs in clock.policy_hz"),
        (lambda: restored(lidar=flockstep.LidarConfig(beams=7)), ValueError, "got one that differs in lidars"),
        (lambda: restored(step_m=0.2), ValueError, "got one that differs in task"),
        (
            lambda: gymnasium.make(ID, num_envs=4),
            TypeError,
            "num_envs: gymnasium.make makes one env; for several, use gymnasium.make_vec",
        ),
        (lambda: flockstep.PPO("MlpPolicy", None, lr=1e-3), TypeError, "'lr'. Did you mean 'learning_rate'?"),
        (lambda: DroneVectorEnv(seed=3), TypeError, "'seed': pass it to reset(seed=...)"),
        (lambda: DroneVectorEnv(lidar={"beams": 10}), TypeError, ": write flockstep.LidarConfig(beams=10)"),
        (lambda: flockstep.Batch([ROOM], lidar={"beams": 10}), TypeError, ": write flockstep.LidarConfig(beams=10)"),
        (
            lambda: flockstep.DynamicsConfig(wind={"gusts": 3}),
            TypeError,
            "write flockstep.WindConfig(gusts=3)",
        ),
        (lambda: DroneVectorEnv(worlds=ROOM), ValueError, "(world.with_drawn_markers(seed) draws them)"),
        (
            lambda: DroneVectorEnv(task=Homeless, worlds=ROOM).reset(),
            ValueError,
            "has no start marker, where Task.reset puts drones: draw markers by world.with_drawn_markers(seed)",
        ),
        (lambda: flockstep.CameraConfig(outputs="rgb"), TypeError, "got 'rgb': write ('rgb',)"),
        (lambda: flockstep.World.from_dict({}), ValueError, 'found none: add "flockstep_scene": 1'),
        (lambda: flockstep.Batch([ROOM]).restore(b"12345"), ValueError, "5 bytes are too few for a snapshot"),
        (lambda: flockstep.PPO.load("no/model"), FileNotFoundError, "no such model file: no/model.zip"),
        (lambda: flockstep.NativeTask("./fly.so"), FileNotFoundError, "no such shared library: './fly.so'"),
        (lambda: flockstep.DroneModel.load("nix.json"), FileNotFoundError, "nix.json: cannot read a drone file"),
    ],
)
def test_a_message_says_what_to_do(call, error, said):
    with pytest.raises(error, match=re.escape(said)) as raised:
        call()
    assert len(str(raised.value)) <= 200 or "gymnasium.make" in said  # Gymnasium adds all keywords


@pytest.mark.parametrize("count", ["4", 4.0, True, 0, None])
def test_number_of_envs(count):
    with pytest.raises(ValueError, match=re.escape(f"num_envs: expected an integer >= 1, got {count!r}")):
        DroneVectorEnv(count)


@pytest.mark.parametrize("action", ["discrete", "displacement"])
def test_a_tensor_that_requires_grad(action, closet):
    envs = DroneVectorEnv(2, worlds=closet, action=action)
    envs.reset(seed=0)
    shape = envs.action_space.shape
    with refused(ValueError, "actions", "torch.Tensor", "Use tensor.detach().numpy() instead"):
        envs.step(torch.zeros(shape, requires_grad=True))
    envs.step(torch.zeros(shape, dtype=torch.int64 if action == "discrete" else torch.float32))


@pytest.mark.parametrize("seed", [1.5, True, "1", [1.0, 2.0], [True, False], [1], {1, 2}])
def test_seeds_are_integers(seed, closet):
    envs = DroneVectorEnv(2, worlds=closet)
    with refused((TypeError, ValueError), "seed"):
        envs.reset(seed=seed)


def test_seeds_are_recorded(closet):
    envs = DroneVectorEnv(2, worlds=closet)
    for given, recorded in ((np.int64(3), 3), ([7, 5], (7, 5)), (np.array([1, 2]), (1, 2))):
        envs.reset(seed=given)
        assert envs.np_random_seed == recorded


def test_unknown_options_are_refused(closet):
    envs = DroneVectorEnv(2, worlds=closet)
    with refused(ValueError, "options", "mask"):
        envs.reset(seed=0, options={"mask": np.ones(2, bool)})


@pytest.mark.parametrize("mode", list(gymnasium.vector.AutoresetMode))
def test_autoreset_as_gymnasium_writes_it(mode, closet):
    for written in (mode, mode.value):
        assert DroneVectorEnv(1, worlds=closet, autoreset_mode=written).autoreset_mode is mode
    with refused(ValueError, "autoreset_mode", "samestep"):
        DroneVectorEnv(1, worlds=closet, autoreset_mode="samestep")


def test_targets_of_a_wrong_width(closet):
    class Narrow(flockstep.Task):
        observation_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

        def act(self, batch, actions):
            return batch.position[:, :2], None

        def step(self, batch):
            return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)

        def observe(self, batch):
            return np.zeros((batch.num_drones, 1), np.float32)

    envs = DroneVectorEnv(2, worlds=closet, task=Narrow())
    envs.reset(seed=0)
    with refused(ValueError, "act", "shape (2, 2)"):
        envs.step(envs.action_space.sample())


def test_one_task_object_for_two_envs(closet):
    class Hover(flockstep.Task):
        observation_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

        def step(self, batch):
            return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)

        def observe(self, batch):
            return np.zeros((batch.num_drones, 1), np.float32)

    task = Hover()
    envs = DroneVectorEnv(2, worlds=closet, task=task)
    with pytest.raises(
        ValueError, match="task: this Hover object belongs to another environment: give each env its own"
    ):
        DroneVectorEnv(2, worlds=closet, task=task)
    envs.reset(seed=0)  # unchanged
    envs.close()
    DroneVectorEnv(2, worlds=closet, task=task).close()
    assert flockstep.sb3.make_vec(Hover, 3, worlds=closet).num_envs == 3


# ------------------------------------------------------------------------------------------------------- copies of envs


def flown(envs, steps):
    rng = np.random.default_rng(1)
    return [envs.step(rng.integers(6, size=envs.num_envs))[:4] for _ in range(steps)]


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
@pytest.mark.parametrize("seeded", [True, False])
def test_a_copy_of_an_env_goes_on_as_it_does(duplicate, seeded, closet):
    envs = DroneVectorEnv(3, worlds=closet, max_episode_steps=9, lidar=flockstep.LidarConfig(beams=9), reward_scale=0.5)
    if seeded:
        envs.reset(seed=4)
        flown(envs, 20)
    other = duplicate(envs)
    assert other.observation_space == envs.observation_space
    assert other.np_random_seed == envs.np_random_seed
    if not seeded:
        envs.reset(seed=4)
        other.reset(seed=4)
    for expected, got in zip(flown(envs, 30), flown(other, 30), strict=True):
        for a, b in zip(expected, got, strict=True):
            np.testing.assert_array_equal(a, b)
    assert envs.snapshot() == other.snapshot()


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
