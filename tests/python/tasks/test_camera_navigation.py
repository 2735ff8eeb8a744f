"""The camera tasks: spaces, envs, observations, and the engine against its NumPy twin."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from messages import refused
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_sb3_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecTransposeImage

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


class TestPixels:
    def test_slots_last_for_one_more_step(self, make):
        plain, slots = make(PIXELS), make(PIXELS, copy=False)
        plain.reset(seed=0)
        last = slots.reset(seed=0)[0]
        expected_last = copy.deepcopy(last)
        seen = [last["image"]]
        for actions in actions_of(4, 40):
            expected, got = plain.step(actions), slots.step(actions)
            np.testing.assert_equal(last, expected_last)
            np.testing.assert_equal(expected[0], got[0])
            last, expected_last = got[0], expected[0]
            seen.append(last["image"])
        assert np.shares_memory(seen[0], seen[2])
        assert not np.shares_memory(seen[0], seen[1])

    def test_slots_outlive_the_env(self, make):
        envs = make(PIXELS, copy=False)
        observation, _ = envs.reset(seed=0)
        expected = copy.deepcopy(observation)
        envs.close()
        del envs
        np.testing.assert_equal(observation, expected)

    def test_a_camera_of_another_layout_is_refused(self, make):
        with refused(ValueError, "camera.layout", "chw", "hwc"):
            make(PIXELS, camera=flockstep.CameraConfig(width_px=32, height_px=24))


class TestGreenBlob:
    def test_by_hand(self):
        image = np.full((48, 64, 3), 200, np.uint8)
        image[10:14, 40:48] = (35, 160, 50)
        for layout, array in (("hwc", image), ("chw", np.ascontiguousarray(image.transpose(2, 0, 1)))):
            blob = flockstep.green_blob(array, layout)
            assert blob.found
            assert (blob.x, blob.y, blob.width, blob.height) == (40, 10, 8, 4)
            assert blob.offset == 12 / 32
            assert blob.area == pytest.approx(32 / 3072)
            assert blob.mask.dtype == bool
            assert blob.mask.sum() == 32
            assert blob.mask[10:14, 40:48].all()
        assert not flockstep.green_blob(image[:, :40]).found

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

    def test_observations_agree_with_the_gymnasium_env(self, parlour, make):
        envs = self.make(parlour, PIXELS, camera=CHW)
        plain = make(PIXELS, 6, autoreset_mode="same_step", max_episode_steps=12)
        envs.seed(3)
        np.testing.assert_equal(envs.reset(), plain.reset(seed=3)[0])
        ends = 0
        for actions in actions_of(6, 40):
            observation, reward, done, infos = envs.step(actions)
            expected = plain.step(actions)
            np.testing.assert_equal(observation, expected[0])
            np.testing.assert_equal(reward, expected[1])
            for i in np.flatnonzero(done):
                ends += 1
                np.testing.assert_equal(infos[i]["terminal_observation"], expected[4]["final_obs"][i])
        assert ends > 12

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
    config = flockstep.NavigationConfig(
        observation="blob",
        action="discrete_forward",
        reward=flockstep.NavigationReward(overshoot_weight=1.0),
    )
    lidar, camera = flockstep.LidarConfig(beams=20, hfov_deg=180), flockstep.CameraConfig(width_px=64, height_px=48)
    arguments = {"worlds": worlds, "autoreset_mode": mode, "max_episode_steps": 60, "num_threads": 1}
    engine = flockstep.DroneVectorEnv(12, observation="blob", camera=camera, **arguments)
    twin_task = example("navigation_numpy").Navigation(config, lidar, camera)
    twin = flockstep.DroneVectorEnv(12, task=twin_task, **arguments)
    np.testing.assert_allclose(engine.reset(seed=0)[0], twin.reset(seed=0)[0], atol=1e-6)
    ends = {"crashed": 0, "success": 0}
    overshoots = seen = 0
    for actions in actions_of(12, 200, seed=2):
        ours, theirs = engine.step(actions), twin.step(actions)
        ended = ours[2] | ours[3]
        np.testing.assert_allclose(ours[0], theirs[0], atol=2e-4)
        np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-5, atol=3e-3)
        np.testing.assert_equal(ours[2], theirs[2])
        np.testing.assert_equal(ours[3], theirs[3])
        seen += (ours[0][:, 1] > 0).sum()
        overshoots += (engine.batch.reward_terms[:, 5] != 0).sum()
        if ended.any():
            infos, expected = (s[4].get("final_info", s[4]) for s in (ours, theirs))
            for key in ends:
                np.testing.assert_equal(infos[key], expected[key])
                ends[key] += infos[key].sum()
        if mode == "disabled" and ended.any():
            options = {"reset_mask": ended}
            np.testing.assert_allclose(engine.reset(options=options)[0], twin.reset(options=options)[0], atol=2e-4)
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

    def test_a_task_of_ones_own_observes_by_itself(self):
        class Still(flockstep.Task):
            observation_space = spaces.Box(-1, 1, (1,), np.float32)

        with refused(TypeError, "observation"):
            flockstep.DroneVectorEnv(1, task=Still(), observation="blob")

    def test_actions(self, make):
        envs = make(CAMERA)
        envs.reset(seed=0)
        for bad in ([0, 1, 2, 3], [-1, 0, 0, 0], [0.0] * 4, [0]):
            with refused(ValueError, "actions"):
                envs.step(bad)

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


def test_configs_pickle():
    config = flockstep.NavigationConfig(observation="pixels", action="discrete_forward", step_m=0.25)
    assert pickle.loads(pickle.dumps(config)) == config
    assert copy.copy(config) == config
    assert "step_m=0.25" in repr(config)
