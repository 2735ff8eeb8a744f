"""Stable-Baselines3 over a batch."""

import io
import re

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from messages import refused
from simple_tasks import Still
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

import flockstep
from flockstep.sb3 import DroneVecEnv
from flockstep.sb3.side_by_side import SideBySide

ID = "flockstep/LidarNavigation-v0"

torch.set_num_threads(1)  # the networks are small


@pytest.fixture
def make(closet):
    def make(num_envs=6, **arguments):
        arguments = {"worlds": closet, "max_episode_steps": 10, "num_threads": 1, **arguments}
        return flockstep.sb3.make_vec(ID, num_envs, **arguments)

    return make


@pytest.mark.parametrize("action", ["discrete", "displacement", "displacement_yaw"])
@pytest.mark.filterwarnings("ignore:.*action space.*:UserWarning")
def test_sb3_likes_the_single_env(room, action):
    check_env(gymnasium.make(ID, worlds=room, action=action).unwrapped)


def test_the_log_has_the_terms_of_the_reward(room):
    class Climb(Still):
        reward_terms = ("height", "cost")
        info_names = ("steps_flown",)
        max_episode_steps = 4

        def step(self, batch):
            self.info["steps_flown"] += 1
            cost = np.full(batch.num_drones, -0.5)
            return {"height": batch.position[:, 2], "cost": cost}, np.zeros(batch.num_drones, bool)

    class Spy(flockstep.sb3.LogTerms):
        def _on_rollout_end(self):
            super()._on_rollout_end()
            logged.append(dict(self.logger.name_to_value))

    logged = []
    envs = flockstep.sb3.make_vec(Climb, 3, worlds=room)
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=24, n_epochs=1, seed=0, device="cpu")
    model.learn(48, callback=Spy(["steps_flown"]))
    assert len(logged) == 2
    for log in logged:
        assert log["terms/cost"] == -2.0
        assert log["infos/steps_flown"] == 4.0
        assert log["terms/height"] == pytest.approx(8, abs=0.5)

    with refused(ValueError, "info_names", "is_success", "steps", "steps_flown"):
        model.learn(48, callback=flockstep.sb3.LogTerms(["steps"]))
    with refused(TypeError, "info_names", "steps_flown"):
        flockstep.sb3.LogTerms("steps_flown")


def test_options_reach_the_next_reset(make):
    envs = make()
    envs.seed(0)
    envs.reset()
    for _ in range(3):
        envs.step(np.full(6, 4))
    mask = np.arange(6) < 2
    envs.set_options({"reset_mask": mask})
    envs.reset()
    assert envs.get_attr("batch")[0].episode.tolist() == [1, 1, 0, 0, 0, 0]
    envs.reset()  # options are used once
    assert envs.get_attr("batch")[0].episode.tolist() == [2, 2, 1, 1, 1, 1]
    envs.set_options({"nonsense": 1})
    with refused(ValueError, "options", "nonsense"):
        envs.reset()
    envs.reset()  # rejected options are discarded
    envs.set_options([{}] * 6)
    envs.reset()
    with refused(ValueError, "options"):
        envs.set_options([{"reset_mask": mask}] * 6)


def test_is_a_direct_vec_env(make):
    envs = make()
    assert type(envs).__base__ is VecEnv
    assert envs.num_envs == 6
    assert envs.observation_space.shape == (38,)
    assert envs.action_space == gymnasium.spaces.Discrete(6)
    assert envs.metadata["render_fps"] > 0
    assert envs.render_mode is None


@pytest.mark.parametrize("env_id", [ID, "flockstep/CameraPixels-v0"])
def test_steps_agree_with_the_gymnasium_env(closet, env_id):
    keywords = {"worlds": closet, "max_episode_steps": 10, "num_threads": 1}
    envs = flockstep.sb3.make_vec(env_id, 6, **keywords)
    plain = gymnasium.make_vec(env_id, 6, autoreset_mode="same_step", **keywords)
    envs.seed(3)
    np.testing.assert_equal(envs.reset(), plain.reset(seed=3)[0])
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(100):
        actions = rng.integers(envs.action_space.n, size=6)
        observation, reward, done, infos = envs.step(actions)
        expected = plain.step(actions)
        np.testing.assert_equal(observation, expected[0])
        np.testing.assert_array_equal(reward, expected[1])
        np.testing.assert_array_equal(done, expected[2] | expected[3])
        assert len(infos) == 6
        for i in range(6):
            if not done[i]:
                assert infos[i] == {}
                continue
            ends += 1
            final = expected[4]["final_info"]
            np.testing.assert_equal(infos[i]["terminal_observation"], expected[4]["final_obs"][i])
            assert infos[i]["TimeLimit.truncated"] == expected[3][i]
            assert infos[i]["is_success"] == final["success"][i]
            assert infos[i]["episode"]["r"] == final["episode_return"][i]
            assert infos[i]["episode"]["l"] == final["episode_length"][i]
            assert infos[i]["episode"]["t"] > 0
    assert ends > 20


def test_the_infos_list_and_rewards_are_the_callers(make):
    envs = make()
    envs.reset()
    _, first_reward, _, first = envs.step(np.zeros(6, int))
    kept = first_reward.copy()
    first[0] = {"mine": True}
    first_reward += 100
    _, _, _, second = envs.step(np.zeros(6, int))
    assert second[0] == {}
    np.testing.assert_array_equal(first_reward, kept + 100)


def test_seeds_are_taken_once(make, room):
    envs = make(worlds=room, random_start=True)
    assert envs.seed(5) == [5, 6, 7, 8, 9, 10]
    first = envs.reset().copy()
    second = envs.reset().copy()
    assert (first != second).any()
    envs.seed(5)
    np.testing.assert_array_equal(envs.reset(), first)


class TestPoisonedSlots:
    """Data stored by Stable-Baselines3 stays intact when the returned arrays are reused."""

    def test_the_previous_observation_survives_a_step(self, make):
        envs = make()
        previous = envs.reset()
        for _ in range(30):
            kept = previous.copy()
            observation = envs.step(np.random.default_rng(0).integers(6, size=6))[0]
            np.testing.assert_array_equal(previous, kept)
            assert not np.shares_memory(previous, observation)
            previous = observation

    def test_rollouts_are_those_of_an_adapter_that_copies_and_poisons(self, closet):
        def rollout(poison):
            env = flockstep.DroneVectorEnv(
                8, worlds=closet, max_episode_steps=10, autoreset_mode="same_step", copy=False, num_threads=1
            )
            envs = flockstep.sb3.make_vec(env)
            if poison:
                # Return private arrays, and fill each with NaN as soon as it may be reused, after the next step.
                step_wait, reset = envs.step_wait, envs.reset
                handed = []

                def private(observation):
                    handed.append(observation.copy())
                    if len(handed) > 2:
                        handed.pop(0).fill(np.nan)
                    return handed[-1]

                def poisoned_step_wait():
                    observation, *rest = step_wait()
                    return (private(observation), *rest)

                envs.step_wait, envs.reset = poisoned_step_wait, lambda: private(reset())
            model = PPO("MlpPolicy", envs, n_steps=32, batch_size=64, n_epochs=1, seed=0, device="cpu")
            model.learn(32 * 8)
            buffer = model.rollout_buffer
            return buffer.observations.copy(), buffer.rewards.copy(), buffer.actions.copy()

        for a, b in zip(rollout(poison=False), rollout(poison=True), strict=True):
            assert np.isfinite(a).all()
            np.testing.assert_array_equal(a, b)


class TestAttributes:
    def test_are_read_for_indices(self, make):
        envs = make()
        assert envs.get_attr("render_mode") == [None] * 6
        assert envs.get_attr("num_envs", [1, 2]) == [6, 6]
        assert envs.get_attr("num_envs", 3) == [6]
        assert not envs.has_attr("nothing")

    def test_are_set_for_all(self, make):
        envs = make()
        envs.set_attr("reward_scale", 4)
        assert envs.get_attr("reward_scale") == [4] * 6
        with refused(ValueError, "reward_scale"):
            envs.set_attr("reward_scale", 5, indices=[0])
        with refused(AttributeError, "set_attr", "note"):
            envs.set_attr("note", 4)

    def test_of_the_task(self, room):
        class Near(Still):
            worlds = room
            radius = 1.0

            def step(self, batch):
                return np.full(batch.num_drones, self.radius), np.zeros(batch.num_drones, bool)

            def grow(self, by):
                self.radius += by
                return self.radius

        envs = flockstep.sb3.make_vec(Near, 3)
        envs.reset()
        envs.set_attr("radius", 2.0)
        assert envs.get_attr("radius") == [2.0] * 3
        assert envs.step(np.zeros((3, 3), np.float32))[1].tolist() == [2, 2, 2]
        assert envs.env_method("grow", 0.5, indices=[1]) == [2.5]
        assert envs.env.task.radius == 2.5
        envs.set_attr("step_m", 0.2)
        assert envs.env.task.step_m == 0.2
        for name in ("max_episode_steps", "reward_terms", "grow", "diameter"):
            with refused(AttributeError, "set_attr", "(reward_scale, radius, step_m)", name):
                envs.set_attr(name, 3)

    def test_methods(self, make):
        envs = make(render_mode="rgb_array")
        envs.reset()
        assert len(envs.env_method("render", indices=[0, 1])) == 2

    def test_monitor_counts_as_wrapped(self, make):
        assert make().env_is_wrapped(Monitor) == [True] * 6
        assert make().env_is_wrapped(gymnasium.wrappers.TimeLimit, [0]) == [False]

    def test_images(self, make):
        envs = make(render_mode="rgb_array")
        envs.reset()
        assert envs.render("rgb_array").shape == (3 * 256, 2 * 256, 3)


class TestMaking:
    def test_of_a_task(self, closet):
        assert flockstep.sb3.make_vec(Still(), 3, worlds=closet).reset().shape == (3, 3)

    def test_of_a_ready_env(self, closet):
        ready = flockstep.DroneVectorEnv(3, worlds=closet, autoreset_mode="same_step")
        assert flockstep.sb3.make_vec(ready).num_envs == 3
        with refused(TypeError, "make_vec"):
            flockstep.sb3.make_vec(ready, 5)
        with refused(ValueError, "env", AutoresetMode.NEXT_STEP):
            flockstep.sb3.make_vec(flockstep.DroneVectorEnv(3, worlds=closet))

    def test_of_another_packages_id(self):
        with refused(TypeError, "CartPoleVectorEnv.__init__()", "autoreset_mode"):
            flockstep.sb3.make_vec("CartPole-v1", 2)


def test_training_and_evaluation_run_without_a_warning(make):
    envs = make(num_envs=16)
    model = PPO("MlpPolicy", envs, n_steps=32, batch_size=128, n_epochs=2, seed=0, device="cpu")
    model.learn(32 * 16 * 3)
    assert len(model.ep_info_buffer) > 0
    assert len(model.ep_success_buffer) > 0
    mean, _ = evaluate_policy(model, envs, n_eval_episodes=20)
    assert np.isfinite(mean)


@pytest.mark.filterwarnings("ignore:The environment is already wrapped with a `Monitor`:UserWarning")
def test_sb3_wrappers(make):
    envs = VecNormalize(VecMonitor(make()), norm_obs=True)
    observation = envs.reset()
    for _ in range(30):
        observation, _, done, infos = envs.step(np.zeros(6, int))
        assert np.isfinite(observation).all()
        for i in np.flatnonzero(done):
            assert infos[i]["terminal_observation"].shape == (38,)
            assert infos[i]["episode"]["l"] <= 10


class TestImageFeatures:
    """The network for observations with images; Stable-Baselines3 passes it uint8 (C, H, W) as floats in [0, 1]."""

    @staticmethod
    def twins(one, other):
        """Return extractors for two spaces with the same weights."""
        torch.manual_seed(0)
        first, second = (flockstep.sb3.ImageFeatures(space) for space in (one, other))
        second.load_state_dict(first.state_dict())
        return first, second

    def test_takes_any_number_of_images_and_vectors(self):
        space = spaces.Dict(
            keys=spaces.Box(0, 1, (48, 64), np.float32),  # also the name of a torch.nn.Module attribute
            rgb=spaces.Box(0, 255, (3, 16, 20), np.uint8),
            state=spaces.Box(-np.inf, np.inf, (2, 3), np.float32),
        )
        features = flockstep.sb3.ImageFeatures(space, channels=4, hidden=5)
        assert features.features_dim == 5 + 5 + 6
        seen = {name: torch.rand(7, *part.shape) for name, part in space.items()}
        found = features(seen)
        assert found.shape == (7, 16)
        torch.testing.assert_close(found[:, 10:], seen["state"].flatten(1), rtol=0, atol=0)
        for name in ("keys", "rgb"):
            assert not torch.equal(features({**seen, name: torch.zeros_like(seen[name])}), found)

    def test_images_are_scaled_by_their_bounds(self):
        metres, shares = self.twins(spaces.Box(2, 10, (16, 24), np.float32), spaces.Box(0, 1, (16, 24), np.float32))
        images = torch.rand(3, 16, 24)
        torch.testing.assert_close(metres(2 + 8 * images), shares(images))

    def test_images_scaled_by_sb3_are_not_scaled_again(self):
        colors, shares = self.twins(
            spaces.Box(0, 255, (3, 16, 24), np.uint8), spaces.Box(0, 1, (3, 16, 24), np.float32)
        )
        images = torch.rand(3, 3, 16, 24)
        torch.testing.assert_close(colors(images), shares(images), rtol=0, atol=0)
        flat, shares = self.twins(spaces.Box(0, 255, (16, 24), np.uint8), spaces.Box(0, 1, (16, 24), np.float32))
        torch.testing.assert_close(flat(255 * images[:, 0]), shares(images[:, 0]))  # without channels it is not scaled

    def test_channels_are_first_or_last(self):
        first, last = self.twins(spaces.Box(0, 1, (3, 16, 24), np.float32), spaces.Box(0, 1, (16, 24, 3), np.float32))
        images = torch.rand(3, 3, 16, 24)
        torch.testing.assert_close(first(images), last(images.permute(0, 2, 3, 1)))

    @pytest.mark.parametrize("shape", [(8,), (7, 64), (3, 7, 64), (64, 3, 64), (1, 3, 16, 16)])
    def test_spaces_without_an_image_are_refused(self, shape):
        with refused(ValueError, "ImageFeatures", "8 x 8", shape):
            flockstep.sb3.ImageFeatures(spaces.Box(0, 1, shape, np.float32))

    def test_bounds_have_to_be_finite(self):
        space = spaces.Dict(depth=spaces.Box(0, np.inf, (16, 16), np.float32))
        with refused(ValueError, "ImageFeatures: depth", "[0, inf]"):
            flockstep.sb3.ImageFeatures(space)

    @pytest.mark.parametrize("kind", ["MultiInputPolicy", "CnnPolicy"])
    def test_is_trained(self, room, kind):
        class Look(flockstep.Task):
            camera = flockstep.CameraConfig(width_px=16, height_px=12, outputs=("depth",))
            observation_space = spaces.Box(0, 1, (12, 16), np.float32)
            max_episode_steps = 10

            def step(self, batch):
                return batch.position[:, 0], batch.contact.hit

            def observe(self, batch):
                return 1 / (1 + batch.camera().depth)

        class LookAndKnow(Look):
            observation_space = spaces.Dict(near=Look.observation_space, height=spaces.Box(0, 9, (1,), np.float32))

            def observe(self, batch):
                return {"near": super().observe(batch), "height": batch.position[:, 2:]}

        task = LookAndKnow if kind == "MultiInputPolicy" else Look
        envs = flockstep.sb3.make_vec(task, 4, worlds=room)
        network = {"features_extractor_class": flockstep.sb3.ImageFeatures}
        model = PPO(kind, envs, n_steps=16, batch_size=32, n_epochs=1, policy_kwargs=network, seed=0, device="cpu")
        convolution = model.policy.features_extractor.nets[0][0][1].weight
        before = convolution.detach().clone()
        model.learn(64)
        assert not torch.equal(convolution, before)
        assert flockstep.sb3.success_rates(model, task, worlds=room) == {"room": 0.0}


def test_progress_prints_lines_into_a_file(make, tmp_path):
    model = PPO("MlpPolicy", make(), n_steps=8, batch_size=48, n_epochs=1, device="cpu")
    with open(tmp_path / "log.txt", "w", encoding="utf-8") as file:
        model.learn(96, callback=flockstep.sb3.Progress(interval_s=0, stream=file))
    lines = (tmp_path / "log.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 17  # one for each of 16 steps, and one at the end
    assert lines[0].startswith("6 of 96 steps (6%), 0 s, ")
    assert re.fullmatch(r"96 of 96 steps \(100%\), \d+ s, [\d,]+ steps/s, success rate [01]\.\d\d", lines[-1])


def test_progress_prints_the_end_of_a_training_shorter_than_its_interval(make, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    model = PPO("MlpPolicy", make(), n_steps=8, batch_size=48, n_epochs=1, device="cpu")
    model.learn(48, callback=flockstep.sb3.Progress())
    printed = capsys.readouterr()
    assert printed.err.startswith("48 of 48 steps (100%)")
    assert (printed.err.count("\n"), printed.out) == (1, "")
    terminal = Terminal()
    model.learn(48, callback=flockstep.sb3.Progress(stream=terminal))
    assert terminal.getvalue().startswith("\r48 of 48 steps")
    assert terminal.getvalue().count("\n") == 1
    assert terminal.getvalue().endswith("\n")
    with refused(ValueError, "interval_s", float("nan")):
        flockstep.sb3.Progress(interval_s=float("nan"))


def swaps(envs: int, drones: int, **config: float) -> DroneVecEnv:
    task = flockstep.SwapConfig(**config)
    return DroneVecEnv(flockstep.DroneVectorEnv(envs, task=task, drones_per_env=drones, autoreset_mode="same_step"))


def test_side_by_side_has_the_rows_of_its_environments():
    together, apart = SideBySide([swaps(3, 2), swaps(2, 4)]), [swaps(3, 2), swaps(2, 4)]
    assert together.num_envs == 14
    together.seed(5)
    apart[0].seed(5)
    apart[1].seed(11)
    np.testing.assert_array_equal(together.reset(), np.concatenate([env.reset() for env in apart]))
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(80):
        actions = rng.uniform((0.5, -0.1), (1.0, 0.1), (14, 2)).astype(np.float32)  # towards the middle
        *arrays, infos = together.step(actions)
        first, second = apart[0].step(actions[:6]), apart[1].step(actions[6:])
        for array, one, other in zip(arrays, first[:3], second[:3], strict=True):
            np.testing.assert_array_equal(array, np.concatenate([one, other]))
        assert [set(info) for info in infos] == [set(info) for info in (*first[3], *second[3])]
        ended += int(arrays[2].sum())
    assert ended > 0
    together.close()


def test_side_by_side_refuses_other_spaces():
    with refused(ValueError, "envs"):
        SideBySide([swaps(2, 2), swaps(2, 2, neighbors=3)])
