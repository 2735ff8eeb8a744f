"""Arguments in plain form: the specs of environments survive JSON and make the same environment again."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep.serialization import from_plain, to_plain

ID = "flockstep/LidarNavigation-v0"


def flown(env):
    """Return the results of some steps of an env."""
    space = env.action_space
    space.seed(3)
    return [env.reset(seed=7)[0], *(env.step(space.sample())[:4] for _ in range(5))]


@pytest.mark.parametrize("make", [gymnasium.make, lambda *args, **kwargs: gymnasium.make_vec(*args, 3, **kwargs)])
def test_a_spec_goes_through_json(make, room):
    env = make(
        ID,
        worlds=[room, flockstep.World.playground(3)],
        lidar=flockstep.LidarConfig(beams=9, offset_m=(0, 0, 0.1)),
        camera=[flockstep.CameraConfig(width_px=8, height_px=6, outputs=("depth",))],
        pose_sensor=flockstep.PoseSensorConfig(position_noise_std_m=0.01),
        reward=flockstep.NavigationReward(step_scale=7.0),
        drone=flockstep.DroneModel(
            0.1 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        ),
        random_world=True,
    )
    text = env.unwrapped.spec.to_json()
    spec = gymnasium.envs.registration.EnvSpec.from_json(text)
    again = gymnasium.make(spec) if make is gymnasium.make else gymnasium.make_vec(spec)
    np.testing.assert_equal(flown(again), flown(env))
    assert again.unwrapped.spec.to_json() == text


@pytest.mark.parametrize("config", [flockstep.LidarConfig(beams=7), flockstep.CameraConfig(hfov_deg=70)])
def test_the_plain_form_gives_the_value_back(config):
    plain = to_plain({"it": [config]})
    assert plain["it"][0].keys() == {f"flockstep.{type(config).__name__}"}
    assert from_plain(plain["it"]) == [config]


def test_a_task_of_ones_own(room):
    flockstep.register_task("test/Still-v0", Still)
    spec = gymnasium.envs.registration.EnvSpec.from_json(gymnasium.spec("test/Still-v0").to_json())
    assert isinstance(gymnasium.make(spec, worlds=room).unwrapped.envs.task, Still)
    del gymnasium.registry["test/Still-v0"]


def test_defaults_of_a_registered_task(room, closet):
    lidar = flockstep.LidarConfig(beams=5)
    place = np.array([[1, 1, 3], [4, 4, 1]])
    defaults = {"max_episode_steps": 3, "frame_skip": 2, "lidar": lidar, "render_mode": "rgb_array"}
    flockstep.register_task("test/Still-v1", Still, worlds=room, render_view=place, render_size=(40, 30), **defaults)
    try:
        plain = gymnasium.envs.registration.EnvSpec.from_json(gymnasium.spec("test/Still-v1").to_json())
        for spec in ("test/Still-v1", plain):
            envs = gymnasium.make_vec(spec, 2)
            assert envs.num_envs == 2
            assert (envs.batch.worlds[0].name, envs.lidar.beams) == ("room", 5)
            envs.reset(seed=0)
            assert envs.render()[0].shape == (30, 40, 3)
            still = np.zeros((2, 3), np.float32)
            assert [envs.step(still)[3].any() for _ in range(2)] == [False, True]  # steps of 2 and 1 flown steps
        envs = gymnasium.make_vec("test/Still-v1", 1, worlds=closet, frame_skip=1)
        envs.reset(seed=0)
        assert envs.batch.worlds[0].name == "closet"
        assert [envs.step(still[:1])[3].any() for _ in range(3)] == [False, False, True]
        env = gymnasium.make("test/Still-v1", frame_skip=1)
        env.reset(seed=0)
        assert [env.step(still[0])[3] for _ in range(3)] == [False, False, True]
        vec = pytest.importorskip("flockstep.sb3").make_vec("test/Still-v1", 3)
        assert (vec.num_envs, vec.env.lidar.beams) == (3, 5)
    finally:
        del gymnasium.registry["test/Still-v1"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("num_envs", ["register_task", "got num_envs"]),
        ("copy", ["register_task", "got copy"]),
        ("wrlds", ["wrlds", "worlds"]),
    ],
)
def test_invalid_defaults_are_refused(name, said):
    with refused(TypeError, *said):
        flockstep.register_task("test/Still-v2", Still, **{name: 3})
    assert "test/Still-v2" not in gymnasium.registry


def test_a_class_that_cannot_be_found_stays_itself():
    local = type("Local", (Still,), {})
    assert to_plain(local) is local


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"flockstep.Lidar": {}}, ["LidarConfig", "flockstep.Lidar"]),
        ({"flockstep.Task": "flockstep:Nothing"}, ["task", "flockstep", "Nothing"]),
    ],
)
def test_an_unknown_kind_is_named(value, said):
    with refused(ValueError, *said):
        from_plain(value)


def test_a_limit_by_gymnasium_reports_as_the_engine_does(room):
    env = gymnasium.make(ID, worlds=room, max_episode_steps=3)
    ours = gymnasium.make_vec(ID, 1, worlds=room, max_episode_steps=3)
    env.reset(seed=0)
    ours.reset(seed=0)
    for step in range(3):
        *_, truncated, info = env.step(1)
        *_, ours_truncated, infos = ours.step([1])
        assert truncated == ours_truncated[0] == (step == 2)
    assert info["episode_length"] == infos["episode_length"][0] == 3
    assert info["episode_return"] == infos["episode_return"][0]
    for name, value in info["episode_terms"].items():
        assert value == infos["episode_terms"][name][0]


def test_a_configuration_within_another_one_is_a_part_of_it():
    lidar = flockstep.LidarConfig()
    lidar.errors.dropout = 0.5
    assert pickle.loads(pickle.dumps(lidar)).errors == flockstep.RangeErrors(dropout=0.5)
    other = copy.copy(lidar)
    other.errors.dropout = 0.25
    assert lidar.errors.dropout == 0.5
    errors = lidar.errors
    lidar.errors = other.errors  # copied into its place
    other.errors.dropout = 0.0
    assert errors.dropout == lidar.errors.dropout == 0.25
    del lidar
    assert errors.dropout == 0.25  # and keeps its owner alive
