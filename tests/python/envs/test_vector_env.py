"""The vector env under Gymnasium's rules: the checker, Gymnasium's wrappers, and this env's own promises."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep.testing import check_vector_env

INFOS = {"episode_return", "episode_length", "success", "crashed", "bad_state", "episode_end", "episode_terms"}
ID = "flockstep/LidarNavigation-v0"
PIXELS = {"observation": "pixels", "camera": flockstep.CameraConfig(width_px=8, height_px=6, layout="chw")}
KINDS = ({}, PIXELS)


def make(closet, num_envs=4, **kwargs):
    return gymnasium.make_vec(ID, num_envs, **{"worlds": closet, "max_episode_steps": 12, "num_threads": 1, **kwargs})


def fly(envs, steps, seed=0):
    """Step with random actions; reset finished envs if autoreset is disabled."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        if isinstance(envs.single_action_space, gymnasium.spaces.Discrete):
            actions = rng.integers(6, size=envs.num_envs)
        else:
            actions = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        step = envs.step(actions)
        yield step
        ended = step[2] | step[3]
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            envs.reset(options={"reset_mask": ended})


class TestChecker:
    @pytest.mark.parametrize("action", ["discrete", "displacement", "displacement_yaw"])
    def test_navigation(self, closet, mode, action):
        check_vector_env(lambda n: make(closet, n, action=action, autoreset_mode=mode))

    def test_everything_random(self, room, closet, mode):
        check_vector_env(
            lambda n: make(
                [room, closet],
                n,
                random_world=True,
                random_start=True,
                stagger_first_episode=True,
                pose_sensor=flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=1.0),
                autoreset_mode=mode,
                num_threads=3,
                render_mode="rgb_array",
            )
        )

    def test_shipped_playgrounds(self):
        # The envs of a batch are in different worlds, so env i is not env 0 with another seed.
        check_vector_env(lambda n: gymnasium.make_vec(ID, n, max_episode_steps=30), skip={"seed_offset"})


class TestSingle:
    @pytest.mark.parametrize("action", ["discrete", "displacement", "displacement_yaw"])
    def test_check_env(self, room, action):
        env = gymnasium.make(ID, worlds=room, action=action, render_mode="rgb_array")
        check_env(env.unwrapped)
        env.close()

    def test_is_the_batch_of_one(self, closet):
        env = gymnasium.make(ID, worlds=closet)
        envs = make(closet, 1, autoreset_mode="disabled", max_episode_steps=3000)
        rng = np.random.default_rng(0)
        np.testing.assert_array_equal(env.reset(seed=5)[0], envs.reset(seed=5)[0][0])
        for _ in range(200):
            action = rng.integers(6)
            observation, reward, terminated, truncated, info = env.step(action)
            batched = envs.step([action])
            np.testing.assert_array_equal(observation, batched[0][0])
            assert (reward, terminated, truncated) == (batched[1][0], batched[2][0], batched[3][0])
            if terminated or truncated:
                of_info = {key: value[0] for key, value in batched[4].items() if key in info and key != "episode_terms"}
                terms = {key: value[0] for key, value in batched[4]["episode_terms"].items() if not key.startswith("_")}
                assert info == {**of_info, "episode_terms": terms}
                assert set(info) == INFOS
                np.testing.assert_array_equal(env.reset()[0], envs.reset()[0][0])


class TestWrappers:
    def test_record_episode_statistics_agrees_with_the_infos(self, closet, mode):
        envs = wrappers.RecordEpisodeStatistics(make(closet, autoreset_mode=mode))
        envs.reset(seed=0)
        ended = 0
        rng = np.random.default_rng(0)
        for _ in range(150):
            _, _, terminated, truncated, infos = envs.step(rng.integers(6, size=4))
            done = terminated | truncated
            if done.any():
                ended += done.sum()
                ours = infos.get("final_info", infos)
                np.testing.assert_array_equal(infos["episode"]["l"][done], ours["episode_length"][done])
                np.testing.assert_allclose(
                    infos["episode"]["r"][done], ours["episode_return"][done], rtol=1e-5, atol=1e-2
                )
                if mode == "disabled":
                    envs.reset(options={"reset_mask": done})
        assert ended > 20

    def test_normalize_observation(self, closet):
        envs = wrappers.NormalizeObservation(make(closet))
        envs.reset(seed=0)
        observations = np.concatenate([step[0] for step in fly(envs, 100)])
        assert np.abs(observations.mean(axis=0)).max() < 1

    @pytest.mark.parametrize(
        "wrap",
        [
            wrappers.NormalizeReward,
            lambda e: wrappers.ClipReward(e, -1, 1),
            lambda e: wrappers.TransformReward(e, lambda r: r / 10),
            wrappers.FlattenObservation,
            lambda e: wrappers.RescaleObservation(e, -1, 1),
            wrappers.DictInfoToList,
        ],
    )
    def test_others_without_a_warning(self, closet, wrap):
        envs = wrap(make(closet))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            envs.reset(seed=0)
            steps = list(fly(envs, 60))
        assert all(len(step) == 5 for step in steps)
        if wrap is wrappers.DictInfoToList:
            infos = [info for step in steps for info in step[4] if info]
            assert infos and all(set(info) == INFOS for info in infos)
        envs.close()

    def test_clip_and_rescale_action(self, closet):
        envs = wrappers.RescaleAction(
            make(closet, action="displacement"), np.full(3, -2, np.float32), np.full(3, 2, np.float32)
        )
        envs.reset(seed=0)
        before = envs.unwrapped.batch.position.copy()
        envs.step(np.full((4, 3), 1.0, np.float32))
        np.testing.assert_allclose(envs.unwrapped.batch.position - before, 0.05, atol=1e-6)


class TestReset:
    def test_without_a_seed_the_next_episode_follows(self, room):
        envs = make(room, random_start=True)
        first, _ = envs.reset(seed=1)
        second, _ = envs.reset()
        assert not np.isin(second, first).all(axis=1).any()
        np.testing.assert_array_equal(envs.reset(seed=1)[0], first)
        np.testing.assert_array_equal(envs.reset()[0], second)

    def test_never_seeded_envs_differ_and_np_random_seeds_them(self, room):
        a, b = make(room, random_start=True), make(room, random_start=True)
        assert (a.reset()[0] != b.reset()[0]).any()
        a, b = make(room, random_start=True), make(room, random_start=True)
        a.np_random, b.np_random = np.random.default_rng(3), np.random.default_rng(3)
        np.testing.assert_array_equal(a.reset()[0], b.reset()[0])

    def test_a_mask_resets_only_its_envs(self, room, mode):
        envs = make(room, random_start=True, autoreset_mode=mode)
        envs.reset(seed=0)
        observation = envs.step([0, 1, 2, 3])[0]
        mask = np.array([False, True, False, True])
        options = {"reset_mask": mask}
        after, infos = envs.reset(seed=[7, 8, 9, 10], options=options)
        assert list(options) == ["reset_mask"]
        assert mask.tolist() == [False, True, False, True]
        assert infos == {}
        np.testing.assert_array_equal(after[~mask], observation[~mask])
        expected, _ = make(room, random_start=True).reset(seed=[7, 8, 9, 10])
        np.testing.assert_array_equal(after[mask], expected[mask])

    @pytest.mark.parametrize(
        ("mask", "said"),
        [
            ([True] * 4, "list"),
            (np.ones(3, bool), "bool (3,)"),
            (np.ones(4, int), "int64"),
            (np.zeros(4, bool), "at least one"),
        ],
    )
    def test_bad_masks(self, room, mask, said):
        envs = make(room)
        envs.reset(seed=0)
        with refused(ValueError, "options['reset_mask']", said):
            envs.reset(options={"reset_mask": mask})

    def test_a_partial_first_reset_needs_a_seed(self, room):
        mask = np.array([True, False, False, False])
        envs = make(room)
        with pytest.raises(ResetNeeded):
            envs.reset(options={"reset_mask": mask})
        with pytest.raises(ResetNeeded):
            envs.step([0] * 4)
        envs.reset(seed=0, options={"reset_mask": mask})
        envs.step([0, 0, 0, 0])


class TestCopies:
    @pytest.mark.parametrize("keywords", KINDS)
    def test_slots_last_for_one_more_step(self, closet, keywords):
        plain, slots = make(closet, **keywords), make(closet, copy=False, **keywords)
        plain.reset(seed=0)
        last = slots.reset(seed=0)[0]
        expected_last = copy.deepcopy(last)
        rng = np.random.default_rng(0)
        for _ in range(50):
            actions = rng.integers(3, size=4)
            expected, got = plain.step(actions), slots.step(actions)
            np.testing.assert_equal(last, expected_last)
            np.testing.assert_equal(expected[:4], got[:4])
            last, expected_last = got[0], expected[0]

    @pytest.mark.parametrize("keywords", KINDS)
    def test_slots_are_views_that_take_turns(self, closet, keywords):
        envs = make(closet, copy=False, **keywords)
        a, b, c = envs.reset(seed=0)[0], envs.step([0] * 4)[0], envs.step([0] * 4)[0]
        a, b, c = (each["image"] if keywords else each for each in (a, b, c))
        assert np.shares_memory(a, c)
        assert not np.shares_memory(a, b)

    @pytest.mark.parametrize("keywords", KINDS)
    def test_slots_outlive_the_env(self, closet, keywords):
        envs = make(closet, 300, copy=False, **keywords)
        observation = envs.reset(seed=0)[0]
        expected = copy.deepcopy(observation)
        envs.close()
        del envs
        np.testing.assert_equal(observation, expected)

    @pytest.mark.parametrize("num_envs", [1, 3, 5000])
    def test_other_libraries_take_the_slots_as_they_are(self, closet, num_envs):
        envs = make(closet, num_envs, copy=False)
        envs.reset(seed=0)
        for _ in range(2):
            observation, reward, terminated, truncated, _ = envs.step(np.zeros(num_envs, int))
            batch = envs.batch
            more = (batch.success, batch.crashed, batch.reward_terms, batch.episode_return, batch.episode_terms)
            for array in (observation, reward, terminated, truncated, *more):
                assert array.ctypes.data % 64 == 0
                assert np.shares_memory(np.from_dlpack(array), array)
                tensor = torch.from_dlpack(array)
                assert tensor.data_ptr() == array.ctypes.data


class TestEpisodes:
    def test_infos_only_where_episodes_end(self, closet):
        envs = make(closet, 8)
        envs.reset(seed=0)
        lengths = np.zeros(8, int)
        returns = np.zeros(8)
        ended = np.zeros(8, bool)
        for step in fly(envs, 100):
            lengths = np.where(ended, 0, lengths + 1)
            returns = np.where(ended, 0, returns + step[1])
            ended = step[2] | step[3]
            infos = step[4]
            if not ended.any():
                assert infos == {}
                continue
            for key in ("episode_return", "episode_length", "success", "crashed", "bad_state"):
                np.testing.assert_array_equal(infos[f"_{key}"], ended)
                assert not infos[key][~ended].any()
            np.testing.assert_array_equal(infos["episode_length"][ended], lengths[ended])
            np.testing.assert_allclose(infos["episode_return"][ended], returns[ended], rtol=1e-6, atol=1e-2)
            np.testing.assert_array_equal(infos["success"] | infos["crashed"], step[2])
            assert not (infos["success"] & infos["crashed"]).any()

    def test_a_reward_scale_changes_what_step_returns_and_nothing_else(self, closet, mode):
        plain, scaled = (make(closet, 8, autoreset_mode=mode, reward_scale=scale) for scale in (1.0, 0.01))
        for envs in (plain, scaled):
            envs.reset(seed=0)
        for one, other in zip(fly(plain, 50), fly(scaled, 50), strict=True):
            assert other[1].dtype == np.float32
            np.testing.assert_array_equal(one[1] * np.float32(0.01), other[1])
            np.testing.assert_array_equal(plain.batch.reward_terms, scaled.batch.reward_terms)
            one_infos, other_infos = (step[4].get("final_info", step[4]) for step in (one, other))
            assert one_infos.keys() == other_infos.keys()
            for key in one_infos:
                np.testing.assert_equal(one_infos[key], other_infos[key])

    @pytest.mark.parametrize("scale", [0, -1.0, np.nan, np.inf, "large", None])
    def test_bad_reward_scales(self, closet, scale):
        with refused(ValueError, "reward_scale", scale):
            make(closet, reward_scale=scale)

    def test_a_reward_scale_of_one_env(self, closet):
        plain = gymnasium.make(ID, worlds=closet)
        scaled = gymnasium.make(ID, worlds=closet, reward_scale=0.5)
        rewards = [(env.reset(seed=0), env.step(0))[1][1] for env in (plain, scaled)]
        assert rewards[1] == 0.5 * rewards[0] != 0

    def test_time_limit(self, room):
        envs = make(room, 2, max_episode_steps=3, autoreset_mode="same_step")
        envs.reset(seed=0)
        truncated = [envs.step([0, 1])[3].tolist() for _ in range(6)]
        assert truncated == [[False] * 2, [False] * 2, [True] * 2] * 2


class TestActions:
    def test_refused_actions_change_nothing(self, closet):
        a, b = make(closet, action="displacement"), make(closet, action="displacement")
        a.reset(seed=0)
        b.reset(seed=0)
        for step in range(5):
            actions = np.full((4, 3), 0.1 * step, np.float32)
            for bad in (np.full((4, 3), np.nan), np.zeros((3, 3)), np.zeros((4, 4)), None, "up"):
                with refused(ValueError, "actions"):
                    b.step(bad)
            np.testing.assert_equal(a.step(actions)[:4], b.step(actions)[:4])


class TestMaking:
    def test_metadata_and_counts(self, room, closet):
        assert make(room, autoreset_mode="same_step").metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        assert make(room).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP  # an instance's own
        assert make(room, autoreset_mode=AutoresetMode.DISABLED).autoreset_mode is AutoresetMode.DISABLED
        assert make([room, closet], 5).batch.world_index.tolist() == [0, 1, 0, 1, 0]
        envs = flockstep.DroneVectorEnv(2, worlds=room, drones_per_env=4, random_start=True)
        assert (envs.num_groups, envs.num_rows, envs.num_envs) == (2, 8, 8)
        assert flockstep.DroneVectorEnv.__base__ is gymnasium.vector.VectorEnv

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            ({"render_mode": "window"}, ("render_mode", "window")),
            ({"action": "jump"}, ("action", "jump")),
            ({"max_episode_steps": -1}, ("max_episode_steps", -1)),
            ({"colour": "red"}, ("DroneVectorEnv.__init__()", "colour")),
            ({"task": object()}, ("task",)),
            ({"worlds": "playground/none"}, ("unknown scene", "playground/none")),
        ],
    )
    def test_bad_arguments(self, room, arguments, said):
        with refused((ValueError, TypeError), *said):
            flockstep.DroneVectorEnv(**{"worlds": room, **arguments})

    def test_attributes_per_env(self, room):
        envs = make(room, 3, render_mode="rgb_array")
        assert envs.get_attr("render_mode") == ("rgb_array",) * 3
        envs.reset(seed=0)
        assert [frame.shape for frame in envs.call("render")] == [(256, 256, 3)] * 3
        envs.set_attr("reward_scale", [2, 2, 2])
        assert envs.get_attr("reward_scale") == (2, 2, 2)
        with refused(ValueError, "reward_scale"):
            envs.set_attr("reward_scale", [1, 2, 3])

    def test_a_closed_env_says_so(self, room):
        envs = make(room)
        envs.reset(seed=0)
        envs.close()
        envs.close()
        for call in (envs.reset, envs.render, envs.snapshot, lambda: envs.step([0] * 4)):
            for error in (RuntimeError, gymnasium.error.ClosedEnvironmentError):
                with refused(error, "closed"):
                    call()

    def test_pictures_without_a_render_mode_warn(self, room):
        for envs in (make(room), gymnasium.make(ID, worlds=room).unwrapped):
            envs.reset(seed=0)
            with refused(UserWarning, "render() returns None"):
                assert envs.render() is None

    def test_the_navigation_task_may_be_given(self, room):
        config = flockstep.NavigationConfig(step_m=0.2, action="displacement")
        envs = flockstep.DroneVectorEnv(2, worlds=room, task=config, yaw_step_deg=5)
        assert (envs.task.step_m, envs.task.yaw_step_deg, config.yaw_step_deg) == (np.float32(0.2), 5, 10)
        same = flockstep.DroneVectorEnv(2, worlds=room, step_m=0.2, action="displacement", yaw_step_deg=5)
        assert envs.recipe == same.recipe
        assert envs.single_action_space == same.single_action_space
        again = pickle.loads(pickle.dumps(envs))
        assert again.recipe == flockstep.DroneVectorEnv.from_recipe(envs.recipe, worlds=room).recipe == envs.recipe
        made = gymnasium.make_vec(ID, 2, worlds=room, task=config)
        assert made.single_action_space == same.single_action_space
        pixels = flockstep.NavigationConfig.observing("pixels")
        assert set(flockstep.DroneVectorEnv(2, worlds=room, task=pixels).observation_space) == {"image", "ranges"}
        with refused(TypeError, "observation", "NavigationConfig"):
            flockstep.DroneVectorEnv(2, worlds=room, task=config, observation="pixels")


class TestLimits:
    """`gymnasium.make`, `make_vec` and ``max_episode_steps`` set the same limit: the engine's."""

    IDS = ("LidarNavigation", "CameraNavigation", "CameraPixels", "Hover", "Track")

    @staticmethod
    def length(env, action):
        """Fly one episode; return its steps, the truncated flag and its info."""
        env.reset(seed=0)
        for step in range(1, 1000):
            _, _, terminated, truncated, info = env.step(action)
            if terminated or truncated:
                return step, truncated, info
        raise AssertionError("the episode does not end")

    @pytest.mark.parametrize("name", IDS)
    def test_the_spec_has_the_limit_of_the_engine(self, name):
        default = gymnasium.spec(f"flockstep/{name}-v0").max_episode_steps
        for limit, keywords in ((default, {}), (7, {"max_episode_steps": 7}), (9999, {"max_episode_steps": 9999})):
            env = gymnasium.make(f"flockstep/{name}-v0", **keywords)
            envs = gymnasium.make_vec(f"flockstep/{name}-v0", 1, **keywords)
            assert env.spec.max_episode_steps == limit
            for each in (env.unwrapped.envs, envs):
                assert isinstance(each.batch, flockstep.Batch)
                assert each._arguments.get("max_episode_steps") == limit
        assert flockstep.DroneVectorEnv(1)._arguments.get("max_episode_steps") is None

    @pytest.mark.parametrize("limit", [3, 310])  # the task's own limit is 300
    def test_an_end_at_the_limit_is_the_engines(self, limit):
        still = {"start_offset_m": 0, "start_tilt_deg": 0, "start_speed_mps": 0, "hold_s": 0.02}
        env = gymnasium.make("flockstep/Hover-v0", max_episode_steps=limit, **still)
        steps, truncated, info = self.length(env, np.zeros(4, np.float32))
        assert (steps, truncated, info["success"]) == (limit, True, True)
        again = gymnasium.make(env.spec)
        assert self.length(again, np.zeros(4, np.float32))[0] == limit

    def test_no_limit(self, room):
        env = gymnasium.make(ID, worlds=room, max_episode_steps=-1)
        assert env.unwrapped.envs._arguments.get("max_episode_steps") == 0
        assert env.spec.max_episode_steps is None

    def test_frame_skip_counts_flown_steps(self, room):
        env = gymnasium.make(ID, worlds=room, max_episode_steps=6, frame_skip=3)
        assert self.length(env, 2)[:2] == (2, True)

    def test_a_registered_task(self, room):
        wait = type("Wait", (Still,), {"max_episode_steps": 4})
        for version, (keywords, limit) in enumerate([({}, 4), ({"max_episode_steps": 2}, 2)]):
            name = f"tests/Wait-v{version}"
            flockstep.register_task(name, wait, worlds=room, **keywords)
            assert gymnasium.spec(name).max_episode_steps == limit
            assert self.length(gymnasium.make(name), np.zeros(3))[0] == limit
            assert self.length(gymnasium.make(name, max_episode_steps=6), np.zeros(3))[0] == 6
            assert gymnasium.make_vec(name, 1)._arguments.get("max_episode_steps") == limit
        flockstep.register_task("tests/Wait-v9", wait, worlds=room, max_episode_steps=0)
        assert gymnasium.spec("tests/Wait-v9").max_episode_steps is None
        assert gymnasium.make("tests/Wait-v9").unwrapped.envs.task.max_episode_steps == 0
        assert gymnasium.make_vec("tests/Wait-v9", 1).task.max_episode_steps == 0

    def test_sync_vectorization(self, room):
        alike = {"worlds": room, "max_episode_steps": 5}
        sync = gymnasium.make_vec(ID, 2, vectorization_mode="sync", **alike)
        ours = gymnasium.make_vec(ID, 2, **alike)
        np.testing.assert_array_equal(sync.reset(seed=3)[0], ours.reset(seed=3)[0])
        for _ in range(12):
            np.testing.assert_equal(sync.step([2, 3])[:4], ours.step([2, 3])[:4])
        sync.close()


def test_numpy_to_torch(closet):
    envs = wrappers.NumpyToTorch(make(closet, max_episode_steps=3))
    observation, _ = envs.reset(seed=0)
    assert isinstance(observation, torch.Tensor)
    infos = [envs.step(torch.zeros(4, dtype=torch.int64))[4] for _ in range(4)]
    (ends,) = (info for info in infos if info)
    assert ends["episode_end"].tolist() == [flockstep.EpisodeEnd.time] * 4


def test_an_id_belongs_to_gymnasium():
    with refused(ValueError, "num_envs", "gymnasium.make_vec('flockstep/Hover-v0', num_envs=...)"):
        flockstep.DroneVectorEnv("flockstep/Hover-v0")
