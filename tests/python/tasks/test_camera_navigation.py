"""The camera tasks: spaces, envs, observations, and the engine against its NumPy twin."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from messages import refused
from simple_tasks import Still
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_sb3_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecTransposeImage
from twins import both, fly_beside

import flockstep
from flockstep.testing import check_vector_env

CAMERA = "flockstep/CameraNavigation-v0"
PIXELS = "flockstep/CameraPixels-v0"
SMALL = flockstep.CameraConfig(width_px=32, height_px=24)
CHW = flockstep.CameraConfig(width_px=32, height_px=24, layout="chw")

PARLOUR = {
    "flockstep_scene": 1,
    "name": "parlour",
    "materials": {"white": {"base_color": [0.9, 0.9, 0.9]}, "pillar": {"base_color": [0.35, 0.45, 0.6]}},
    "room": {"min": [0, 0, 0], "max": [5, 4, 2], "material": "white"},
    "pillars": [{"center": [2.5, 0.8], "radius": 0.125, "material": "pillar"}],
    "markers": {
        "start": [1, 2, 1],
        "goal": [3.5, 2.25, 1],
        "spawn_box": {"min": [0.75, 1.75, 0.9], "max": [1.25, 2.25, 1.1]},
    },
}

torch.set_num_threads(1)


@pytest.fixture(scope="module")
def parlour():
    return flockstep.World.from_dict(PARLOUR)


@pytest.fixture
def make(parlour):
    def make(env_id, num_envs=4, **arguments):
        arguments = {
            "worlds": parlour,
            "camera": CHW if env_id == PIXELS else SMALL,
            "max_episode_steps": 25,
            "random_start": True,
            "num_threads": 1,
            **arguments,
        }
        return gymnasium.make_vec(env_id, num_envs, **arguments)

    return make


def actions_of(num_envs, steps, seed=0):
    """Mostly forward actions, so that drones reach goals, overshoot and crash."""
    return np.random.default_rng(seed).choice(3, size=(steps, num_envs), p=[0.6, 0.2, 0.2])


class TestSpaces:
    def test_of_the_blob(self):
        envs = gymnasium.make_vec(CAMERA, 2)
        space = envs.single_observation_space
        assert space.shape == (22,)
        np.testing.assert_array_equal(space.low, [-1.0] + [0.0] * 21)
        np.testing.assert_array_equal(space.high, [1.0] * 22)
        assert envs.single_action_space == spaces.Discrete(3)
        assert [world.name for world in envs.batch.worlds] == ["playground/camera-train-1", "playground/camera-train-2"]
        assert envs.lidar == flockstep.LidarConfig(beams=20, hfov_deg=180.0)
        assert 4 * envs.cameras[0].height_px == 3 * envs.cameras[0].width_px
        assert np.isclose(envs.cameras[0].fx, envs.cameras[0].width_px / 2)  # 90 degrees

    def test_of_the_pixels(self):
        envs = gymnasium.make_vec(PIXELS, 2)
        assert envs.single_observation_space == spaces.Dict(
            {"image": spaces.Box(0, 255, (3, 48, 64), np.uint8), "ranges": spaces.Box(0, 1, (20,), np.float32)}
        )
        assert envs.observation_space["image"].shape == (2, 3, 48, 64)
        assert envs.single_action_space == spaces.Discrete(3)

    def test_of_ones_own_camera_and_lidar(self, make):
        lidar = flockstep.LidarConfig(beams=5, channels=2, vfov_deg=20)
        envs = make(PIXELS, lidar=lidar, action="displacement")
        assert envs.single_observation_space["image"].shape == (3, 24, 32)
        assert envs.single_observation_space["ranges"].shape == (10,)
        assert envs.single_action_space.shape == (3,)
        assert make(CAMERA, lidar=lidar).single_observation_space.shape == (12,)

    def test_the_callers_camera_stays_as_it_is(self, make):
        camera = flockstep.CameraConfig(width_px=32, height_px=24, layout="chw")
        envs = make(PIXELS, camera=camera)
        envs.cameras[0].width_px = 1
        assert camera.width_px == 32
        default = gymnasium.make_vec(CAMERA, 1)
        default.cameras[0].width_px = 1
        assert gymnasium.make_vec(CAMERA, 1).cameras[0].width_px > 1

    def test_a_camera_beside_the_lidar_task(self, room):
        envs = flockstep.DroneVectorEnv(2, worlds=room, camera=SMALL)
        envs.reset(seed=0)
        assert envs.single_observation_space.shape == (38,)
        assert envs.batch.camera().rgb.shape == (2, 24, 32, 3)

    def test_several_cameras(self, make):
        belly = flockstep.CameraConfig(name="belly", width_px=8, height_px=8, outputs=("depth",))
        for env_id in (CAMERA, PIXELS):
            envs = make(env_id, 2, camera=[CHW if env_id == PIXELS else SMALL, belly])
            alone = make(env_id, 2)
            observed, expected = envs.reset(seed=0)[0], alone.reset(seed=0)[0]
            np.testing.assert_equal(observed, expected)
            assert envs.batch.camera("belly").depth.shape == (2, 8, 8)
            assert (envs.batch.camera("belly").frame_step == 0).all()
        for camera in (3, [belly, "front"]):
            with refused(TypeError, "camera"):
                make(CAMERA, camera=camera)


class TestChecker:
    @pytest.mark.parametrize("env_id", [CAMERA, PIXELS])
    def test_vector(self, make, env_id, mode):
        check_vector_env(lambda n: make(env_id, n, autoreset_mode=mode, stagger_first_episode=True, num_threads=2))

    @pytest.mark.parametrize("env_id", [CAMERA, PIXELS])
    def test_vector_with_frame_skip(self, make, env_id):
        check_vector_env(lambda n: make(env_id, n, autoreset_mode="same_step", frame_skip=3))

    @pytest.mark.parametrize("env_id", [CAMERA, PIXELS])
    def test_single(self, parlour, env_id):
        camera = SMALL if env_id == CAMERA else CHW
        env = gymnasium.make(env_id, worlds=parlour, camera=camera, render_mode="rgb_array")
        check_env(env.unwrapped)
        env.close()

    @pytest.mark.parametrize("env_id", [CAMERA, PIXELS])
    def test_sb3(self, parlour, env_id):
        check_sb3_env(gymnasium.make(env_id, worlds=parlour, camera=SMALL if env_id == CAMERA else None).unwrapped)


class TestGreenBlob:
    @pytest.mark.parametrize(
        ("image", "layout", "match"),
        [
            (np.zeros((4, 4)), "hwc", ("image",)),
            (np.zeros((4, 4), np.uint8), "hwc", ("image", 3, 4)),
            (np.zeros((4, 4, 3), np.uint8), "chw", ("image", 3)),
            (np.zeros((0, 4, 3), np.uint8), "hwc", ("image",)),
            (np.zeros((4, 4, 3), np.uint8), "bgr", ("layout",)),
        ],
    )
    def test_bad_input(self, image, layout, match):
        with refused(ValueError, *match):
            flockstep.green_blob(image, layout)


class TestStableBaselines:
    def make(self, parlour, env_id, num_envs=6, **arguments):
        return flockstep.sb3.make_vec(
            env_id, num_envs, worlds=parlour, max_episode_steps=12, random_start=True, num_threads=1, **arguments
        )

    def test_images_need_no_transposing(self, parlour):
        model = PPO("MultiInputPolicy", self.make(parlour, PIXELS), n_steps=4, batch_size=8, device="cpu")
        assert not isinstance(model.get_env(), VecTransposeImage)

    @pytest.mark.parametrize(("env_id", "policy"), [(CAMERA, "MlpPolicy"), (PIXELS, "MultiInputPolicy")])
    def test_trains_and_evaluates(self, parlour, env_id, policy):
        envs = self.make(parlour, env_id, frame_skip=2)
        model = PPO(policy, envs, n_steps=16, batch_size=48, n_epochs=1, seed=0, device="cpu")
        model.learn(16 * 6 * 2)
        assert len(model.ep_info_buffer) > 0
        mean, _ = evaluate_policy(model, envs, n_eval_episodes=6)
        assert np.isfinite(mean)


def test_agrees_with_its_numpy_twin(parlour, example, mode):
    worlds = [parlour, *flockstep.scenes.load("camera-train")]
    reward = flockstep.NavigationReward(overshoot_weight=1.0)
    config = flockstep.NavigationConfig(observation="blob", action="discrete_forward", reward=reward)
    lidar, camera = flockstep.LidarConfig(beams=20, hfov_deg=180), flockstep.CameraConfig(width_px=64, height_px=48)
    arguments = {"worlds": worlds, "autoreset_mode": mode, "max_episode_steps": 60}
    task = example("navigation_numpy").Navigation(config, lidar, camera)
    engine, twin = both(12, config, task, lidar=lidar, camera=camera, **arguments)
    ends = {"crashed": 0, "success": 0}
    overshoots = seen = 0
    planned = iter(actions_of(12, 200, seed=2))
    beside = fly_beside(engine, twin, lambda _: next(planned), 200, atol=2e-4, rewards={"rtol": 1e-5, "atol": 3e-3})
    for ours, ended in beside:
        seen += (ours[0][:, 1] > 0).sum()
        overshoots += (engine.batch.reward_terms[:, 5] != 0).sum()
        for key in ends:
            ends[key] += getattr(engine.batch, key)[ended].sum()
    assert min(ends.values()) > 2
    assert overshoots > 0
    assert seen > 500


class TestBadInput:
    @pytest.mark.parametrize(
        ("arguments", "error", "match"),
        [
            ({"frame_skip": 0}, ValueError, ("frame_skip", 0)),
            ({"frame_skip": 2000}, ValueError, ("frame_skip", 2000)),
            ({"action": "discrete_backward"}, ValueError, ("action",)),
            ({"camera": flockstep.CameraConfig(outputs=["depth"])}, ValueError, ("camera.outputs",)),
            (
                {"camera": flockstep.CameraConfig(capture_mode="on_demand")},
                ValueError,
                ("camera.capture_mode", "on_demand"),
            ),
            ({"camera_backend": "paper"}, ValueError, ("camera_backend",)),
            ({"camera": 3}, TypeError, ("camera",)),
        ],
    )
    @pytest.mark.parametrize("env_id", [CAMERA, PIXELS])
    def test_invalid_envs(self, make, env_id, arguments, error, match):
        with refused(error, *match):
            make(env_id, **arguments)

    def test_an_observation_that_does_not_exist(self):
        with refused(ValueError, "observation", "goal", "blob", "pixels", "smell"):
            flockstep.DroneVectorEnv(1, observation="smell")
        with refused(ValueError, "observation", "smell"):
            flockstep.NavigationConfig(observation="smell")
        with refused(TypeError, "observation", "another task"):
            flockstep.DroneVectorEnv(1, task=Still(), observation="blob")

    def test_pixels_need_their_layout(self, parlour):
        task = flockstep.NavigationConfig(observation="pixels")
        with refused(ValueError, "camera.layout", "chw", "hwc"):
            flockstep.Batch([parlour], lidar=flockstep.LidarConfig(), cameras=[SMALL], task=task)
        with refused(ValueError, "cameras"):
            flockstep.Batch([parlour], lidar=flockstep.LidarConfig(), task=task)

    def test_the_camera_of_the_task_takes_its_pictures_itself(self, make):
        envs = make(CAMERA)
        envs.reset(seed=0)
        with refused(ValueError, "capture_mode"):
            envs.batch.set_capture_mode("on_demand")
