"""Tasks written in Python, and snapshots of the env."""

import ast
import copy
import dataclasses
import gc
import inspect
import pickle
import weakref

import numpy as np
import pytest
from gymnasium import spaces
from messages import refused

import flockstep
from flockstep.rotations import rotate, yaw_of
from flockstep.testing import CHECKS, check_vector_env

MODES = ["next_step", "same_step", "disabled"]


class Climb(flockstep.Task):
    """A minimal task: earn height, end at 3 m."""

    observation_space = spaces.Box(-np.inf, np.inf, (4,), np.float32)
    max_episode_steps = 12

    def setup(self, batch):
        self.bonus = np.zeros(batch.num_drones)

    def reset(self, batch, mask):
        super().reset(batch, mask)
        self.bonus[mask] = batch.random(0, 1)[mask, 0]

    def step(self, batch):
        self.success[:] = batch.position[:, 2] > 2.35
        return batch.position[:, 2] - 2 + self.bonus, self.success | batch.contact.hit

    def observe(self, batch):
        return np.concatenate([batch.position, self.bonus[:, None]], axis=1)

    def state(self):
        return {"bonus": self.bonus}

    def load(self, state):
        self.bonus[:] = state["bonus"]


class TestRotate:
    def test_agrees_with_rotation_matrices(self):
        rng = np.random.default_rng(0)
        q = rng.normal(size=(50, 4))
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        v = rng.normal(size=(50, 3))
        w, x, y, z = q.T
        matrix = np.moveaxis(
            np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
                ]
            ),
            2,
            0,
        )
        np.testing.assert_allclose(rotate(q, v), np.einsum("nij,nj->ni", matrix, v), atol=1e-12)
        np.testing.assert_allclose(rotate(q, rotate(q, v), inverse=True), v, atol=1e-12)

    def test_identity_is_exact_in_float32(self):
        v = np.random.default_rng(0).normal(size=(100, 3)).astype(np.float32)
        turned = rotate(np.tile(np.float32([1, 0, 0, 0]), (100, 1)), v)
        assert turned.dtype == np.float32
        np.testing.assert_array_equal(turned, v)


class TestYaw:
    @pytest.mark.parametrize("tilt", [0.0, 0.3, -1.2])
    def test_is_where_the_nose_points(self, tilt):
        rng = np.random.default_rng(0)
        yaw = rng.uniform(-np.pi, np.pi, (4, 5))
        turn = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=-1)
        w, pitch = np.cos(tilt / 2), np.sin(tilt / 2)  # about the body's y axis, after the yaw
        quat = turn * w + pitch * np.stack([0 * yaw, -turn[..., 3], turn[..., 0], 0 * yaw], axis=-1)
        np.testing.assert_allclose(yaw_of(quat), yaw, atol=1e-12)
        nose = rotate(quat, np.array([1.0, 0, 0]))
        np.testing.assert_allclose(np.arctan2(nose[..., 1], nose[..., 0]), yaw, atol=1e-12)

    def test_takes_what_a_batch_has(self, room):
        batch = flockstep.Batch([room], 2)
        batch.set_pose([[2, 4, 2]] * 2, [[1, 0, 0, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
        np.testing.assert_allclose(yaw_of(batch.quat_wxyz), [0, np.pi / 2], atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_a_small_task_passes_the_checker(room, mode):
    check_vector_env(
        lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Climb(), autoreset_mode=mode, num_threads=1)
    )


@pytest.mark.parametrize("mode", MODES)
def test_the_numpy_twin_passes_the_checker(closet, mode, example):
    lidar, config = flockstep.LidarConfig(), flockstep.NavigationConfig(action="displacement")
    check_vector_env(
        lambda n: flockstep.DroneVectorEnv(
            n,
            worlds=closet,
            task=example("navigation_numpy").Navigation(config, lidar),
            max_episode_steps=10,
            autoreset_mode=mode,
            num_threads=1,
        )
    )


def test_statistics_of_episodes(room):
    env = flockstep.DroneVectorEnv(2, worlds=room, task=Climb())
    observation, _ = env.reset(seed=0)
    bonus = observation[:, 3].astype(float)
    up, down = np.float32([0, 0, 1]), np.float32([0, 0, -0.5])
    rewards, ended = [], None
    for i in range(12):
        _, reward, terminated, truncated, infos = env.step(np.stack([up, down]))
        rewards.append(reward)
        assert terminated.tolist() == [i in (3, 8), False]  # the step after the end resets
        assert truncated.tolist() == [False, i == 11]
        if i == 3:
            ended = infos
    assert ended["success"].tolist() == [True, False]
    assert ended["crashed"].tolist() == [False, False]
    assert ended["episode_length"].tolist() == [4, 0]
    np.testing.assert_allclose(ended["episode_return"], [1.0 + 4 * bonus[0], 0], rtol=1e-6)
    assert infos["episode_length"].tolist() == [0, 12]
    np.testing.assert_allclose(infos["episode_return"][1], np.sum(rewards, axis=0)[1], rtol=1e-5)


class Lapper(Climb):
    """Reports its maximum height and number of steps; its fourth step is the last if the bonus is above 0.5."""

    reward_terms = ("height", "cost")
    info_names = ("top", "laps")
    max_episode_steps = 6

    def step(self, batch):
        self.truncated[:] = (batch.steps == 4) & (self.bonus > 0.5)
        self.info["top"][:] = np.maximum(self.info["top"], batch.position[:, 2])
        self.info["laps"] += 1
        terms = {"height": batch.position[:, 2] - 2, "cost": np.full(batch.num_drones, -0.25)}
        return terms, batch.contact.hit


class TestWhatATaskReports:
    @pytest.mark.parametrize("mode", MODES)
    def test_passes_the_checker(self, room, mode):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Lapper(), autoreset_mode=mode, num_threads=1)
        )

    @pytest.mark.parametrize("mode", MODES)
    @pytest.mark.parametrize("frame_skip", [1, 2])
    def test_ends_infos_and_terms(self, room, mode, frame_skip):
        env = flockstep.DroneVectorEnv(2, worlds=room, task=Lapper(), autoreset_mode=mode, frame_skip=frame_skip)
        env.reset(seed=0)
        sums = np.zeros((2, 2))
        for step in range(frame_skip, 7, frame_skip):
            _, _, terminated, truncated, infos = env.step(np.float32([[0, 0, 0.5], [0, 0, -0.5]]))
            sums[step <= np.array([6, 4])] += env.batch.reward_terms[step <= np.array([6, 4])]
            assert not terminated.any()
            again = mode == "disabled" and step > 4  # a finished env repeats its results
            assert truncated.tolist() == [step == 6, step == 4 or again]
            if truncated.any():
                env_index, length = (0, 6) if step == 6 else (1, 4)
                ended = infos.get("final_info", infos)
                assert ended["episode_length"][env_index] == ended["laps"][env_index] == length
                assert ended["top"][env_index] == pytest.approx(2.3 if env_index == 0 else 2, abs=0.06)
                assert ended["_laps"].tolist() == truncated.tolist()
                terms = ended["episode_terms"]
                got = [terms["height"][env_index], terms["cost"][env_index]]
                np.testing.assert_allclose(got, sums[env_index], rtol=1e-6)
                assert ended["episode_return"][env_index] == pytest.approx(sum(got))
                assert terms["_cost"].tolist() == truncated.tolist()

    def test_infos_of_a_restored_env(self, room):
        env, other = (flockstep.DroneVectorEnv(2, worlds=room, task=Lapper(), autoreset_mode="disabled") for _ in "ab")
        env.reset(seed=0)
        for _ in range(5):
            env.step(np.zeros((2, 3), np.float32))
        other.restore(env.snapshot())
        for ours, theirs in zip(*[e.step(np.zeros((2, 3), np.float32)) for e in (env, other)], strict=True):
            np.testing.assert_equal(ours, theirs)
        assert env.batch.truncated.all()

    def test_a_single_env_reports_in_every_step(self, room):
        env = flockstep.env.DroneEnv(worlds=room, task=Lapper)
        env.reset(seed=0)
        for step in range(1, 7):
            *_, truncated, info = env.step(np.zeros(3, np.float32))
            assert info["laps"] == info["episode_length"] == step
            assert info["episode_terms"] == {"height": pytest.approx(0, abs=1e-5), "cost": pytest.approx(-0.25 * step)}
        assert truncated

    @pytest.mark.parametrize("names", [("success",), ("_hidden",), ("two words",)])
    def test_names_that_are_taken(self, room, names):
        task = type("Taken", (Climb,), {"info_names": names})
        with refused(ValueError, "Taken.info_names", "taken", names[0]):
            flockstep.DroneVectorEnv(1, worlds=room, task=task)

    @pytest.mark.parametrize(("info", "match"), [({"lops": np.zeros(2)}, "expected top, laps.*got lops"), (3, "shape")])
    def test_infos_of_a_wrong_kind(self, room, info, match):
        class Wrong(Lapper):
            def step(self, batch):
                self.info = info if isinstance(info, dict) else dict.fromkeys(self.info, np.zeros(info))
                return np.zeros(2), np.zeros(2, bool)

            reward_terms = ("reward",)

        env = flockstep.DroneVectorEnv(2, worlds=room, task=Wrong())
        env.reset(seed=0)
        with pytest.raises(ValueError, match=match):
            env.step(np.zeros((2, 3), np.float32))


def test_images_are_observations(closet):
    class Looker(Climb):
        camera = flockstep.CameraConfig(width_px=8, height_px=6, layout="chw", outputs=("rgb", "depth"))
        observation_space = spaces.Dict(
            image=spaces.Box(0, 255, (3, 6, 8), np.uint8), depth=spaces.Box(0, np.inf, (6, 8), np.float32)
        )

        def observe(self, batch):
            return {"image": batch.camera().rgb, "depth": batch.camera().depth}

    check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=closet, task=Looker(), num_threads=1))
    env = flockstep.DroneVectorEnv(2, worlds=closet, task=Looker())
    observation, _ = env.reset(seed=0)
    assert observation["image"].dtype == np.uint8
    assert observation["image"].any()
    np.testing.assert_array_equal(observation["depth"], env.batch.camera().depth)


def test_steps_and_flying_are_what_they_say(room):
    class Probe(Climb):
        def step(self, batch):
            seen.append((self.steps.copy(), self.flying.copy()))
            return super().step(batch)

    seen = []
    env = flockstep.DroneVectorEnv(2, worlds=room, task=Probe(), max_episode_steps=3)
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.zeros((2, 3), np.float32))
    # The fourth step resets both envs: no drone flies, and there is no reward.
    assert [s[0][0] for s in seen] == [1, 2, 3, 1]
    assert [bool(s[1][0]) for s in seen] == [True] * 4


def test_own_tasks_observe_with_a_lidar_of_their_own(room):
    class Seeing(Climb):
        lidar = flockstep.LidarConfig(beams=5)
        observation_space = spaces.Box(0, np.inf, (5,), np.float32)

        def observe(self, batch):
            return batch.lidar().ranges[:, 0]

    env = flockstep.DroneVectorEnv(2, worlds=room, task=Seeing())
    observation, _ = env.reset(seed=0)
    kept = observation.copy()
    env.step(np.ones((2, 3), np.float32))
    np.testing.assert_array_equal(observation, kept)  # even though observe() returned a view


def test_a_task_names_its_worlds(room, closet):
    task = type("AtHome", (Climb,), {"worlds": [room, closet]})
    assert flockstep.DroneVectorEnv(2, task=task).batch.worlds == [room, closet]
    assert flockstep.DroneVectorEnv(2, task=task, worlds=closet).batch.worlds == [closet]


def test_a_task_declares_frame_skip_and_random_world(room, closet):
    task = type("Drawn", (Climb,), {"worlds": [room, closet], "random_world": True, "frame_skip": 3})
    envs = flockstep.DroneVectorEnv(40, task=task)
    envs.reset(seed=0)
    assert set(envs.batch.world_index[::2]) == {0, 1}  # worlds in turn would give only 0
    envs.step(np.zeros((40, 3), np.float32))
    assert envs.batch.steps[envs.batch.world_index == 0].tolist() == [3] * np.sum(envs.batch.world_index == 0)
    given = flockstep.DroneVectorEnv(4, task=task, random_world=False, frame_skip=2)  # the env's keywords win
    given.reset(seed=0)
    given.step(np.zeros((4, 3), np.float32))
    assert given.batch.world_index.tolist() == [0, 1, 0, 1]
    assert given.batch.steps[::2].tolist() == [2, 2]
    with pytest.raises(ValueError, match="frame_skip: expected"):
        flockstep.DroneVectorEnv(1, worlds=room, task=type("Drawn", (Climb,), {"frame_skip": 0}))


def test_a_reset_puts_drones_into_worlds_of_its_choice(room, closet):
    class Harder(Climb):
        def reset(self, batch, mask):
            batch.set_world(np.where(batch.episode > 0, 1, 0), mask)
            super().reset(batch, mask)

    envs = flockstep.DroneVectorEnv(3, worlds=[room, closet], task=Harder)
    envs.reset(seed=0)
    assert envs.batch.world_index.tolist() == [0, 0, 0]
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert envs.batch.world_index.tolist() == [0, 1, 0]
    np.testing.assert_allclose(envs.batch.position[1], closet.start)


@pytest.mark.parametrize("mode", MODES)
def test_the_checker_finds_a_reset_that_ignores_its_mask(room, mode):
    class Forgetful(Climb):
        def setup(self, batch):
            super().setup(batch)
            self.count = np.zeros(batch.num_drones)

        def reset(self, batch, mask):
            super().reset(batch, mask)
            self.count[:] = 0

        def step(self, batch):
            self.count += self.flying
            return np.zeros(batch.num_drones), self.count >= 5

        def state(self):
            return {"count": self.count, "bonus": self.bonus}

        def load(self, state):
            self.count[:], self.bonus[:] = state["count"], state["bonus"]

    with pytest.raises(AssertionError, match=r"after a reset with a mask.*only the rows of its mask"):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Forgetful(), autoreset_mode=mode, num_threads=1)
        )


class TestMistakes:
    def env(self, room, **members):
        task = type("Broken", (Climb,), members)()
        return flockstep.DroneVectorEnv(2, worlds=room, task=task)

    def test_reward_of_a_wrong_shape(self, room):
        env = self.env(room, step=lambda self, batch: (np.zeros(3), np.zeros(2, bool)))
        env.reset(seed=0)
        with refused(ValueError, "Broken.step", "reward", (2,), (3,)):
            env.step(np.zeros((2, 3)))

    def test_a_step_that_returns_no_pair(self, room):
        task = type("Half", (Climb,), {"step": lambda self, batch: {"reward": np.zeros(2)}})
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        with refused(ValueError, "Half.step", "pair", "dict"):
            env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize(("returned", "got"), [((0, 1, 2, 3), "a tuple of 4"), (None, "None")])
    def test_a_step_that_returns_another_number(self, room, returned, got):
        env = self.env(room, step=lambda self, batch: returned)
        env.reset(seed=0)
        with refused(ValueError, "Broken.step", "pair", got):
            env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize(
        ("returned", "got"),
        [
            (lambda batch: (batch.position, batch.quat_wxyz, 7), "a tuple of 3"),
            (lambda batch: (batch.position,), "a tuple of 1"),
            (lambda batch: None, "None"),
            (lambda batch: (None, batch.quat_wxyz), "a tuple of 2"),
            (lambda batch: np.zeros((2, 4)), "shape (2, 4): control is 'pose'; for commands"),
        ],
    )
    def test_an_act_that_returns_no_target(self, room, returned, got):
        env = self.env(room, act=lambda self, batch, actions: returned(batch))
        env.reset(seed=0)
        with refused(ValueError, "Broken.act", "positions", got):
            env.step(np.zeros((2, 3), np.float32))

    def test_an_act_that_returns_no_commands(self, room):
        flying = {"drone": "crazyflie", "dynamics": flockstep.DynamicsConfig(motion="rotors", control="velocity")}
        env = self.env(room, act=lambda self, batch, actions: None, **flying)
        env.reset(seed=0)
        with refused(ValueError, "Broken.act", "commands", None):
            env.step(np.zeros((2, 3), np.float32))
        with refused(TypeError, "Broken.act", "default act", "velocity"):
            self.env(room, **flying)

    @pytest.mark.parametrize("space", [spaces.Box(-1, 1, (4,)), spaces.Box(-1, 1, (2,)), spaces.Discrete(6)])
    def test_actions_that_the_default_act_does_not_take(self, room, space):
        with refused(TypeError, "Broken.action_space", "default act"):
            self.env(room, action_space=space)
        self.env(room, action_space=space, act=lambda self, batch, actions: batch.position)

    @pytest.mark.parametrize(
        ("declared", "advice"),
        [
            ({"policy_hz": 20}, "write clock = flockstep.ClockConfig(policy_hz=...), or give it to the env"),
            (
                {"control": "velocity"},
                "write dynamics = flockstep.DynamicsConfig(control=...), or give it to the env",
            ),
            ({"wind": np.ones(3)}, "write dynamics = "),
            ({"imu": flockstep.ImuConfig()}, "give it to the env"),
            ({"stagger_first_episode": True}, "give it to the env"),
            ({"pose_sensor": flockstep.PoseSensorConfig()}, "give it to the env"),
            ({"control": "velocity", "dynamics": flockstep.DynamicsConfig(motion="rotors")}, "write dynamics = "),
        ],
    )
    def test_keywords_of_the_env_on_the_class(self, room, declared, advice):
        name = next(iter(declared))
        with refused(TypeError, f"Broken.{name}", advice):
            self.env(room, **declared)

    def test_own_names_that_are_keywords_elsewhere(self, room):
        class Own(Climb):
            policy_hz = 20  # for its own use; the env takes it from the clock
            clock = flockstep.ClockConfig(policy_hz=policy_hz)
            reward, action, observation = 3.0, None, "of its own"

            def __init__(self):
                self.control = "velocity"

            def friction(self):
                return 0.5

            @property
            def motion(self):
                return "kinematic"

        assert flockstep.DroneVectorEnv(2, worlds=room, task=Own).batch.clock.policy_hz == 20

    def test_a_name_that_is_not_among_the_infos(self, room):
        task = type("Lost", (Lapper,), {"step": lambda self, batch: self.info["lapse"]})
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        with pytest.raises(KeyError, match=r"'lapse' is not among the task's info_names \('top', 'laps'\)"):
            env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize(("dtype", "got"), [(np.uint8, np.float32), (np.uint8, np.int64), (np.int32, np.float64)])
    def test_an_observation_that_would_be_cut(self, room, dtype, got):
        space = spaces.Box(0, 9, (4,), dtype)
        task = type("Cut", (Climb,), {"observation_space": space, "observe": lambda self, batch: np.ones((2, 4), got)})
        with refused(ValueError, "Cut.observe", space.dtype, np.dtype(got)):
            flockstep.DroneVectorEnv(2, worlds=room, task=task).reset(seed=0)

    def test_a_limit_of_the_env_reaches_the_task(self, room):
        assert flockstep.DroneVectorEnv(2, worlds=room, task=Climb, max_episode_steps=5).task.max_episode_steps == 5
        assert flockstep.DroneVectorEnv(2, worlds=room, task=Climb).task.max_episode_steps == 12

    def test_a_type_that_no_observation_has(self, room):
        space = spaces.Dict(ids=spaces.Box(0, 9, (4,), np.uint16))
        with refused(TypeError, "observation_space: ids", "uint16"):
            flockstep.DroneVectorEnv(2, worlds=room, task=type("Ids", (Climb,), {"observation_space": space}))

    def test_observation_of_a_wrong_shape(self, room):
        with refused(ValueError, "Broken.observe", (2, 4), (2, 3)):
            self.env(room, observe=lambda self, batch: batch.position).reset(seed=0)

    def test_no_observation_space(self, room):
        with pytest.raises(TypeError, match="observation_space"):
            self.env(room, observation_space=None)

    def test_values_other_than_tasks(self, room):
        for task in (int, 3, "Climb"):
            with pytest.raises(TypeError, match=r"task: expected a flockstep\.Task"):
                flockstep.DroneVectorEnv(2, worlds=room, task=task)

    @pytest.mark.parametrize("field", ["reward_terms", "info_names", "markers"])
    def test_names_are_a_tuple_of_different_names(self, room, field):
        with refused(TypeError, f"Broken.{field}", "goal"):
            self.env(room, **{field: ("goal")})
        for no_names in (3, None, {"goal"}, ("goal", 3)):
            with refused(TypeError, f"Broken.{field}", "tuple of names"):
                self.env(room, **{field: no_names})
        with refused(ValueError, f"Broken.{field}", "twice", "goal"):
            self.env(room, **{field: ["goal", "start", "goal"]})

    def test_invalid_names(self, room):
        with refused(ValueError, "Broken.reward_terms", ()):
            self.env(room, reward_terms=())
        with refused(ValueError, "Broken.markers", "start", "home"):
            self.env(room, markers=("start", "home"))

    @pytest.mark.parametrize("field", ["observation_space", "action_space"])
    def test_a_box_without_values(self, room, field):
        act = {"act": lambda self, batch, actions: batch.position}
        with refused(ValueError, {"action_space": "Broken.action_space"}.get(field, field), "Box", (3, 0)):
            self.env(room, **{field: spaces.Box(-1, 1, (3, 0))}, **act)

    @pytest.mark.parametrize("limit", [2**31, 2**40, -1, True, 2.0, "9"])
    def test_an_invalid_limit(self, room, limit):
        with refused(ValueError, "max_episode_steps", 0, 2**31 - 1, limit):
            self.env(room, max_episode_steps=limit)

    def returned_by_step(self, room, reward, terminated):
        env = self.env(room, step=lambda self, batch: (reward, terminated))
        env.reset(seed=0)
        return env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize(
        ("reward", "got"),
        [
            (np.ones(2) * 1j, "real numbers, got dtype complex128"),
            (np.array([1, 2], "m8[s]"), "real numbers, got dtype timedelta64[s]"),
            (np.array(["1", "2"]), "real numbers, got dtype <U1"),
            (np.array([1, None]), "real numbers, got dtype object"),
        ],
    )
    def test_an_invalid_reward(self, room, reward, got):
        with refused(ValueError, "Broken.step", "reward", got):
            self.returned_by_step(room, reward, np.zeros(2, bool))

    def test_arrays_with_a_mask(self, room):
        masked = np.ma.array(np.zeros((2, 4)), mask=True)
        with refused(ValueError, "Broken.step: reward", "mask"):
            self.returned_by_step(room, masked[:, 0], np.zeros(2, bool))
        with refused(ValueError, "Broken.step: terminated", "mask"):
            self.returned_by_step(room, np.zeros(2), masked[:, 0] > 0)
        with refused(ValueError, "Broken.observe", "mask"):
            self.env(room, observe=lambda self, batch: masked).reset(seed=0)
        for target in (masked[:, :3], (np.zeros((2, 3)), masked)):
            env = self.env(room, act=lambda self, batch, actions, target=target: target)
            env.reset(seed=0)
            with refused(ValueError, "Broken.act", "mask"):
                env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize("given", [[0.0, 1.0], [0, 0.5], np.array([0, 1], np.float32), [0, 1], [np.nan, 0]])
    def test_flags_as_numbers(self, room, given):
        dtype = np.asarray(given).dtype
        with refused(ValueError, "Broken.step", bool, "terminated", dtype):
            self.returned_by_step(room, np.zeros(2), given)

    @pytest.mark.parametrize("given", [[False, True], np.array([False, True])])
    def test_flags(self, room, given):
        assert self.returned_by_step(room, [1, 2], given)[2].tolist() == [False, True]

    def test_an_observation_outside_its_space_warns_once(self, room):
        beyond = [0.0, 2.5, 3.5]  # of the first reset, the first step and a later one

        def observe(self, batch):
            place = np.zeros((2, 4))
            place[1, 3] = beyond.pop(0)
            return place.astype(np.float32)

        env = self.env(room, observation_space=spaces.Box(0, 1, (4,)), observe=observe)
        env.reset(seed=0)
        actions = np.zeros((2, 3), np.float32)
        with refused(RuntimeWarning, "Broken.observe", 0.0, 1.0, 2.5, 1, [3]):
            env.step(actions)
        env.step(actions)  # not compared
        assert not beyond

    @pytest.mark.parametrize("name", ["success", "truncated"])
    @pytest.mark.parametrize("value", [True, np.zeros(3, bool)])
    def test_a_flag_of_a_wrong_shape(self, room, name, value):
        def step(self, batch):
            setattr(self, name, value)
            return np.zeros(2), np.zeros(2, bool)

        env = self.env(room, step=step)
        env.reset(seed=0)
        with refused(ValueError, "Broken.step", name, (2,), np.shape(value)):
            env.step(np.zeros((2, 3), np.float32))

    @pytest.mark.parametrize(("dtype", "value"), [(np.int32, 2**40), (np.int32, -(2**31) - 1), (np.int64, 2**63)])
    def test_integers_that_do_not_fit_the_space(self, room, dtype, value):
        given = np.full((2, 4), value, np.uint64 if value > 2**62 else np.int64)
        space = spaces.Box(0, 9, (4,), dtype)
        env = self.env(room, observation_space=space, observe=lambda self, batch: given)
        with refused(ValueError, "Broken.observe", space.dtype, value):
            env.reset(seed=0)
        fitting = np.array([[0, 1, 2**31 - 1, -(2**31)]] * 2)
        space = spaces.Box(-(2**31), 2**31 - 1, (4,), np.int32)
        env = self.env(room, observation_space=space, observe=lambda self, batch: fitting)
        np.testing.assert_array_equal(env.reset(seed=0)[0], fitting)

    def test_a_reset_that_begins_outside_the_room(self, room):
        def reset(self, batch, mask):
            batch.set_pose([[2, 4, 2], [20, 4, 2]], None, mask)

        expected = r'drones within the room of world "room", \(0 0 0\) to \(8 8 4\), got \(20  4  2\) of drone 1'
        with pytest.raises(ValueError, match=rf"^reset: position: expected {expected}"):
            self.env(room, reset=reset).reset(seed=0)
        no_room = {"flockstep_scene": 1, "name": "open", "boxes": [{"center": [0, 0, 0], "size": [1, 1, 1]}]}
        self.env(flockstep.World.from_dict(no_room), reset=reset).reset(seed=0)

    def test_a_reset_that_closes_its_env(self, room):
        opened = []
        env = self.env(room, reset=lambda self, batch, mask: opened.pop().close())
        opened.append(env)
        with pytest.raises(RuntimeError, match="the task closed this env during reset"):
            env.reset(seed=0)
        with pytest.raises(RuntimeError, match="this env is closed"):
            env.reset(seed=0)

    @pytest.mark.parametrize(
        ("control", "command", "expected"),
        [
            ("attitude", [9.81, 45, 0, 0], r"a roll within \+-pi rad \(not degrees\), got 45"),
            ("attitude", [9.81, 0, -45, 0], r"a pitch within \+-pi rad \(not degrees\), got -45"),
            *((control, [1, 0, 0, 1e5], "a yaw within") for control in ("attitude", "acceleration", "position")),
        ],
    )
    def test_an_act_whose_angles_are_in_degrees(self, room, control, command, expected):
        dynamics = flockstep.DynamicsConfig(motion="rotors", control=control)
        rows = np.array([[0, 0, 0, 0], command], float)
        env = self.env(room, dynamics=dynamics, act=lambda self, batch, actions: rows)
        env.reset(seed=0)
        with pytest.raises(ValueError, match=rf"^act: command \(row 1\): expected {expected}"):
            env.step(np.zeros((2, 3), np.float32))

    def test_fields_of_the_navigation_task(self, room):
        with pytest.raises(TypeError, match="action"):
            flockstep.DroneVectorEnv(2, worlds=room, task=Climb(), action="discrete")

    def test_a_world_without_a_start(self):
        world = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [3, 3, 3]}})
        with pytest.raises(ValueError, match="start marker"):
            flockstep.DroneVectorEnv(2, worlds=world, task=Climb()).reset(seed=0)

    @pytest.mark.parametrize(
        ("actions", "match"),
        [
            (np.zeros((2, 2)), r"actions.*\(2, 3\)"),
            (np.full((2, 3), np.nan), "actions.*finite"),
            (np.full((2, 3), "x"), "actions.*floats"),
        ],
    )
    def test_bad_actions_change_nothing(self, room, actions, match):
        env = self.env(room)
        env.reset(seed=0)
        before = env.snapshot()
        with pytest.raises(ValueError, match=match):
            env.step(actions)
        assert env.snapshot() == before

    @pytest.mark.parametrize(("actions", "match"), [([0, 6], r"\[0, 6\)"), ([0.0, 1.0], "integers"), ([0], "shape")])
    def test_bad_discrete_actions(self, room, actions, match, example):
        task = example("navigation_numpy").Navigation(flockstep.NavigationConfig(), flockstep.LidarConfig())
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        with pytest.raises(ValueError, match=f"actions.*{match}"):
            env.step(actions)


# Names that tasks may define for themselves.
OWN_NAMES = """
goal_radius target laps last_distance max_speed max_episode_time_s n_steps reward rewards action actions
action_scale action_dim action_shape observation observation_shape obs_dim state_size states loads draws acts resets
successes infos info_scale lidar_m lidar_range_m lidar_beams clock_s clock_hz camera_name drone_mass drone_kg
drone_ids world_size world_name step_ms step_s step_size steps_left flight flock block radar marker_ids frame frames
skip random_start random_seed dynamics_noise time_limit_s name num_episodes episode_steps max_reward
num_waypoints kp gains hold_s
"""


class TestMisspeltNames:
    """Names of a subclass that nearly match those of `Task`, and names that are its own."""

    @pytest.mark.parametrize(
        ("name", "meant"),
        [
            *(("max_episode_step", "max_episode_steps"), ("maxEpisodeSteps", "max_episode_steps")),
            *(("max_epsiode_steps", "max_episode_steps"), ("max_episodes_steps", "max_episode_steps")),
            *(("info_name", "info_names"), ("lidars", "lidar"), ("lidr", "lidar"), ("Lidar", "lidar")),
            *(
                ("world", "worlds"),
                ("wrolds", "worlds"),
                ("drones", "drone"),
                ("clocks", "clock"),
                ("marker", "markers"),
            ),
            *(("action_spaces", "action_space"), ("frameskip", "frame_skip"), ("random_worlds", "random_world")),
            *(("max_steps", "max_episode_steps"), ("episode_length", "max_episode_steps")),
            *(("max_ep_steps", "max_episode_steps"), ("act_space", "action_space")),
            *(("reward_term", "reward_terms"), ("dynamic", "dynamics"), ("stepm", "step_m"), ("Step_M", "step_m")),
        ],
    )
    @pytest.mark.parametrize("on_the_class", [True, False])
    def test_attributes(self, room, name, meant, on_the_class):
        members = {"observation_space": Climb.observation_space, "step": Climb.step, "observe": Climb.observe}
        if on_the_class:
            members[name] = 3
        else:
            members["__init__"] = lambda self: setattr(self, name, 3)
        task = type("Odd", (flockstep.Task,), members)
        with refused(TypeError, f"Odd.{name}", meant):
            flockstep.DroneVectorEnv(2, worlds=room, task=task)

    @pytest.mark.parametrize(
        ("name", "method", "meant"),
        [
            ("Reset", lambda self, batch, mask: None, "reset"),
            ("rest", lambda self, batch, mask: None, "reset"),
            ("set_up", lambda self, batch: None, "setup"),
            ("setUp", lambda self, batch: None, "setup"),
            ("Act", lambda self, batch, actions: None, "act"),
            ("Draw", lambda self, batch, env, drawing: None, "draw"),
            ("State", lambda self: {}, "state"),
            ("Reset", staticmethod(lambda batch, mask: None), "reset"),
        ],
    )
    def test_methods(self, room, name, method, meant):
        members = {"observation_space": Climb.observation_space, "step": Climb.step, "observe": Climb.observe}
        task = type("Odd", (flockstep.Task,), {**members, name: method})
        with refused(TypeError, f"Odd.{name}", meant):
            flockstep.DroneVectorEnv(2, worlds=room, task=task)

    def test_names_of_its_own(self, room):
        methods = {
            "distance": lambda self, batch: 0,
            "states": lambda self: {},
            "actor": lambda self, batch: 0,
            "observed": lambda self, batch: 0,
            "observation_of": lambda self, batch: 0,
            "drawn": lambda self, batch: 0,
            "reset_goal": lambda self, batch, mask: 0,
            "stepped": lambda self, batch: 0,
            "start": lambda self, batch, mask: 0,
            "react": lambda self, batch: 0,
            "camera_of": lambda self, batch: 0,
            "worlds_of": staticmethod(lambda seed: 0),
            "loaded": classmethod(lambda cls: 0),
            "lidars": property(lambda self: 0),
            "Lidar": type("Lidar", (), {}),
            "_reset": lambda self, batch, mask: 0,
            "_max_episode_step": 3,
        }

        needed = {
            "observation_space": spaces.Box(-9, 9, (3,), np.float32),
            "step": lambda self, batch: (np.zeros(2), np.zeros(2, bool)),
            "observe": lambda self, batch: batch.position,
        }
        task = type("Own", (flockstep.Task,), {**dict.fromkeys(OWN_NAMES.split(), 1), **methods, **needed})
        task.squash, task.largest = np.tanh, staticmethod(max)  # Python cannot count the parameters of these
        flockstep.DroneVectorEnv(2, worlds=room, task=task).reset(seed=0)
        # A name is also accepted if the task has the other name, or once setup has begun.
        both = {"world": room, "worlds": room, "setup": lambda self, batch: setattr(self, "lidars", 3)}
        flockstep.DroneVectorEnv(2, task=type("Both", (flockstep.Task,), {**needed, **both})).reset(seed=0)

    def test_a_dataclass(self, room):
        @dataclasses.dataclass(eq=False)
        class Wide(Climb):
            goal_radius: float = 1.0
            steps_per_goal: int = 3

        assert flockstep.DroneVectorEnv(2, worlds=room, task=Wide(2.0)).task.goal_radius == 2
        wrong = dataclasses.make_dataclass("Wrong", [("reward_term", str, "a")], bases=(Climb,), eq=False)
        with refused(TypeError, "Wrong.reward_term", "reward_terms"):
            flockstep.DroneVectorEnv(2, worlds=room, task=wrong())


class Look(flockstep.Task):
    """Several observations and several reward terms."""

    observation_space = spaces.Dict(
        {"image": spaces.Box(0, 255, (6, 8), np.uint8), "height": spaces.Box(0, 10, (1,), np.float32)}
    )
    camera = flockstep.CameraConfig(width_px=8, height_px=6, outputs=("grey",))
    reward_terms = ("climb", "alive")
    max_episode_steps = 9

    def step(self, batch):
        return {"alive": np.full(batch.num_drones, 0.5), "climb": batch.position[:, 2]}, batch.contact.hit

    def observe(self, batch):
        return {"height": batch.position[:, 2:], "image": batch.camera().grey}


class TestSeveralFields:
    @pytest.mark.parametrize("mode", MODES)
    def test_passes_the_checker(self, room, mode):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Look(), autoreset_mode=mode, num_threads=1)
        )

    def test_of_observation_and_reward(self, room):
        envs = flockstep.DroneVectorEnv(3, worlds=room, task=Look, copy=False)
        observation, _ = envs.reset(seed=0)
        assert envs.observation_space["image"].shape == (3, 6, 8)
        before = {name: part.copy() for name, part in observation.items()}
        after, reward, *_ = envs.step(np.tile(np.float32([0, 0, 1]), (3, 1)))
        np.testing.assert_array_equal(observation["height"], before["height"])  # the other buffer
        np.testing.assert_array_equal(observation["image"], before["image"])
        np.testing.assert_array_equal(after["height"], envs.batch.position[:, 2:])
        np.testing.assert_array_equal(after["image"], envs.batch.camera().grey)
        np.testing.assert_allclose(
            envs.batch.reward_terms, np.stack([envs.batch.position[:, 2], np.full(3, 0.5)], axis=1)
        )
        np.testing.assert_allclose(reward, envs.batch.position[:, 2] + 0.5)
        assert envs.batch.spec.reward_terms == ["climb", "alive"]

    def test_final_observations(self, room):
        envs = flockstep.DroneVectorEnv(2, worlds=room, task=Look(), autoreset_mode="same_step")
        envs.reset(seed=0)
        for _ in range(9):
            observation, *_, infos = envs.step(np.tile(np.float32([0, 0, 1]), (2, 1)))
        assert infos["final_obs"][1]["height"] == pytest.approx(2.9, abs=1e-5)
        assert observation["height"][1] == 2

    def test_mistakes_are_named(self, room):
        def fly(envs):
            envs.reset(seed=0)
            envs.step(np.zeros((2, 3), np.float32))

        class Lost(Look):
            def observe(self, batch):
                return {"height": batch.position[:, 2:]}

        class Shapeless(Look):
            def observe(self, batch):
                return {**super().observe(batch), "height": batch.position}

        class Unnamed(Look):
            def step(self, batch):
                return {"climb": batch.position[:, 2]}, batch.contact.hit

        for task, match in (
            (Lost, "Lost.observe: expected a mapping of height, image, got height"),
            (Shapeless, r"Shapeless.observe: height: expected shape \(2, 1\), got \(2, 3\)"),
            (Unnamed, "Unnamed.step: expected the reward terms climb, alive, got climb"),
        ):
            with pytest.raises(ValueError, match=match):
                fly(flockstep.DroneVectorEnv(2, worlds=room, task=task()))


def test_its_batch_does_not_step_from_within(room):
    class Eager(Climb):
        def act(self, batch, actions):
            batch.step(actions)
            return super().act(batch, actions)

    envs = flockstep.DroneVectorEnv(1, worlds=room, task=Eager())
    envs.reset(seed=0)
    with pytest.raises(RuntimeError, match=r"step\(\) was called by a task"):
        envs.step(np.zeros((1, 3), np.float32))


class TestSnapshot:
    @pytest.fixture(params=["engine", "python"])
    def make(self, request, room):
        def make(**arguments):
            if request.param == "python":
                return flockstep.DroneVectorEnv(5, worlds=room, task=Climb(), **arguments)
            return flockstep.DroneVectorEnv(
                5,
                **{
                    "worlds": room,
                    "action": "displacement",
                    "max_episode_steps": 12,
                    "random_start": True,
                    **arguments,
                },
            )

        return make

    @pytest.mark.parametrize("mode", MODES)
    def test_restored_equals_uninterrupted(self, make, mode):
        one, other = make(autoreset_mode=mode), make(autoreset_mode=mode)
        rng = np.random.default_rng(0)
        last = one.reset(seed=0)
        for i in range(60):
            if i % 7 == 3:
                other = make(autoreset_mode=mode)
                observation = other.restore(one.snapshot())
                np.testing.assert_array_equal(observation, last[0])
            actions = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
            last = one.step(actions)
            if i >= 3:
                for a, b in zip(last[:4], other.step(actions)[:4], strict=True):
                    np.testing.assert_array_equal(a, b)
            ended = last[2] | last[3]
            if mode == "disabled" and ended.all():
                last = one.reset()
                if i >= 3:
                    np.testing.assert_array_equal(last[0], other.reset()[0])

    def test_is_refused_by_another_configuration(self, make):
        env = make()
        env.reset(seed=0)
        for other in (make(autoreset_mode="same_step"), make(max_episode_steps=13)):
            other.reset(seed=1)
            before = other.snapshot()
            with pytest.raises(ValueError, match="snapshot"):
                other.restore(env.snapshot())
            assert other.snapshot() == before

    def test_invalid_snapshots_are_refused(self, make):
        env = make()
        env.reset(seed=0)
        with pytest.raises(ValueError, match="snapshot"):
            env.restore(b"nonsense")


class TestExamples:
    def test_a_task_of_ones_own_takes_at_most_forty_lines(self, example):
        module = example("train_my_task")
        source = inspect.getsource(module)
        (task,) = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)]
        assert task.end_lineno - task.lineno + 1 <= 40

    def test_it_trains(self, example):
        assert example("train_my_task").main(total_timesteps=40_000) > 0.5

    @pytest.mark.parametrize("mode", MODES)
    def test_the_lidar_task_of_terms_is_the_built_in_one(self, example, mode):
        task = example("navigation_terms").Navigation()
        twin, engine = (
            flockstep.DroneVectorEnv(35, worlds="train", task=its, max_episode_steps=150, autoreset_mode=mode)
            for its in (task, None)
        )
        np.testing.assert_array_equal(twin.reset(seed=0)[0], engine.reset(seed=0)[0])
        rng = np.random.default_rng(0)
        ends = 0
        for _ in range(400):
            actions = rng.choice(6, 35, p=[0.5, *5 * [0.1]])
            ours, theirs = twin.step(actions), engine.step(actions)
            np.testing.assert_array_equal(ours[0], theirs[0])
            np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-5, atol=1e-6)
            np.testing.assert_array_equal(ours[2:4], theirs[2:4])
            ends += np.count_nonzero(ours[2])
        assert ends > 35

    def test_the_twin_stays_close(self, example, capsys):
        example("navigation_numpy").main()
        assert "flags the same" in capsys.readouterr().out


class TestPromises:
    """Promises of the class documentation."""

    def test_a_batch_with_a_task_is_let_go(self, room):
        task = Climb()
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        env.step(np.zeros((2, 3)))
        batch = weakref.ref(env.batch)
        np.testing.assert_array_equal(task.steps, [1, 1])
        del env
        gc.collect()
        assert batch() is None
        with pytest.raises(RuntimeError, match="Climb: this task belongs to no environment"):
            task.steps  # noqa: B018

    def test_copies_and_pickles_belong_to_no_batch(self, room):
        task = Climb()
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        for other in (copy.deepcopy(task), pickle.loads(pickle.dumps(task))):
            np.testing.assert_array_equal(other.bonus, task.bonus)
            with pytest.raises(RuntimeError, match="this task belongs to no environment"):
                other.steps  # noqa: B018

    def test_missing_methods_are_named(self, room):
        class Nothing(flockstep.Task):
            observation_space = Climb.observation_space

        env = flockstep.DroneVectorEnv(2, worlds=room, task=Nothing())
        with refused(NotImplementedError, "Nothing.observe"):
            env.reset(seed=0)

    def test_actions_beyond_the_space_are_clipped(self, room):
        env = flockstep.DroneVectorEnv(2, worlds=room, task=Climb())
        env.reset(seed=0)
        before = env.batch.position.copy()
        env.step(np.array([[0, 0, 1], [0, 0, 50]], np.float32))
        np.testing.assert_allclose(env.batch.position[:, 2] - before[:, 2], Climb.step_m, rtol=1e-5)

    @pytest.mark.parametrize("quat", [(0, 0, 0, 0), (2, 0, 0, 0)])
    def test_a_quaternion_that_is_not_unit_is_refused(self, room, quat):
        class Turned(Climb):
            def act(self, batch, actions):
                return batch.position, np.tile(np.float32(quat), (2, 1))

        env = flockstep.DroneVectorEnv(2, worlds=room, task=Turned())
        env.reset(seed=0)
        with pytest.raises(ValueError, match="unit quaternions"):
            env.step(np.zeros((2, 3)))

    def test_another_step_length_or_module_is_another_task(self, room):
        one, other = (flockstep.DroneVectorEnv(2, worlds=room, task=Climb()) for _ in range(2))
        one.reset(seed=0)
        other.restore(one.snapshot())
        longer = Climb()
        longer.step_m = 0.2
        moved = type("Climb", (Climb,), {"__module__": "elsewhere"})()
        for task in (longer, moved):
            stranger = flockstep.DroneVectorEnv(2, worlds=room, task=task)
            with pytest.raises(ValueError, match="configuration"):
                stranger.restore(one.snapshot())


class TestBadStates:
    """A non-finite value ends the episode of its env and affects no other env."""

    @staticmethod
    def fly(room, mode, **methods):
        """Fly with a fault in the third step of env 1; return the env and the results of its steps."""

        class Wild(Climb):
            observation_space = spaces.Box(-10, 10, (4,), np.float32)
            reward_terms = ("height", "bonus")

            def act(self, batch, actions):
                return methods["act"](batch, actions) if "act" in methods else super().act(batch, actions)

            def step(self, batch):
                reward = {"height": np.zeros(3), "bonus": np.full(3, 0.5)}
                if "reward" in methods and batch.steps[1] == 3:
                    reward["bonus"][1] = methods["reward"]
                return reward, np.zeros(3, bool)

            def observe(self, batch):
                observation = super().observe(batch).copy()
                if "observation" in methods and batch.steps[1] == 3:
                    observation[1, 0] = methods["observation"]
                return observation

        env = flockstep.DroneVectorEnv(3, worlds=room, task=Wild(), autoreset_mode=mode, max_episode_steps=9)
        env.reset(seed=0)
        steps = [env.step(np.zeros((3, 3), np.float32)) for _ in range(5)]
        return env, steps

    @pytest.mark.parametrize("mode", ["next_step", "same_step"])
    @pytest.mark.parametrize("bad", [{"reward": np.nan}, {"observation": np.inf}, {"observation": np.nan}])
    def test_a_reward_or_an_observation(self, room, mode, bad):
        which = {"reward": "step: reward term 'bonus'", "observation": "observe: 'observation'"}[next(iter(bad))]
        with refused(RuntimeWarning, f"Wild.{which}", next(iter(bad.values())), 1):
            env, steps = self.fly(room, mode, **bad)
        _, reward, terminated, truncated, infos = steps[2]
        assert terminated.tolist() == [False, True, False]
        assert not truncated.any()
        assert reward.tolist() == [0.5, 0.0 if "reward" in bad else 0.5, 0.5]
        ended = infos if mode == "next_step" else infos["final_info"]
        assert ended["bad_state"].tolist() == [False, True, False]
        assert ended["episode_length"].tolist() == [0, 3, 0]
        assert all(np.isfinite(step[0]).all() for step in steps)
        assert env.batch.bad_states.tolist() == [0, 1, 0]
        assert not any(step[2].any() for i, step in enumerate(steps) if i != 2)

    @pytest.mark.parametrize("target", [float("nan"), -float("inf"), 1e9])
    def test_a_target(self, room, target):
        def act(batch, actions):
            position = batch.position.copy()
            position[1, 2] = np.where(batch.steps[1] == 3, target, position[1, 2])
            return position

        with refused(RuntimeWarning, "Wild.act: target", target, 1):
            env, steps = self.fly(room, "next_step", act=act)
        assert [step[2].tolist() for step in steps] == [[False, i == 2, False] for i in range(5)]
        assert env.batch.bad_states.tolist() == [0, 1, 0]
        assert np.isfinite(env.batch.position).all()

    def test_the_infinity_of_a_lidar_is_none(self, room):
        class Far(Climb):
            lidar = flockstep.LidarConfig(beams=4, max_range_m=0.5)
            observation_space = spaces.Box(0, np.inf, (4,))

            def observe(self, batch):
                return batch.lidar().ranges[:, 0]

        env = flockstep.DroneVectorEnv(2, worlds=room, task=Far())
        observation, _ = env.reset(seed=0)
        assert np.isinf(observation).any()
        observation, *_ = env.step(np.zeros((2, 3), np.float32))
        assert np.isinf(observation).any()
        assert not env.batch.bad_states.any()


class Wanderer(flockstep.Task):
    """Keeps all kinds of state without listing any of it."""

    observation_space = spaces.Box(-np.inf, np.inf, (4,), np.float32)
    max_episode_steps = 7

    def __init__(self):
        self.names = ["never", "changes"]

    def setup(self, batch):
        self.walked = np.zeros(batch.num_drones)
        self.before = np.zeros((batch.num_drones, 3), np.float32)
        self.calls = 0
        self.gain = 0.5

    def reset(self, batch, mask):
        super().reset(batch, mask)
        self.walked[mask] = 0
        self.before[mask] = batch.position[mask]

    def step(self, batch):
        self.walked = self.walked + np.linalg.norm(batch.position - self.before, axis=1)
        self.before = batch.position.copy()
        self.calls += 1
        self.gain *= 0.9
        return self.gain * self.walked + self.calls, np.zeros(batch.num_drones, bool)

    def observe(self, batch):
        return np.column_stack([batch.position, self.walked]).astype(np.float32)


class TestStateThatIsNotListed:
    # Its reward counts the calls, so a run depends on the previous ones.
    SKIP = tuple(set(CHECKS) - {"snapshot"})

    def test_is_kept(self, closet):
        check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=closet, task=Wanderer()), skip=self.SKIP)

    def test_keeps_the_types_of_numbers(self, closet):
        task = Wanderer()
        envs = flockstep.DroneVectorEnv(2, worlds=closet, task=task)
        envs.reset(seed=0)
        kept = envs.snapshot()
        for _ in range(3):
            envs.step(envs.action_space.sample())
        envs.restore(kept)
        assert (type(task.calls), task.calls, type(task.gain), task.gain) == (int, 0, float, 0.5)

    @pytest.mark.parametrize(
        ("change", "kind"),
        [
            (lambda task: task.names.append("changed"), "list"),
            (lambda task: setattr(task, "names", None), "NoneType"),
            (lambda task: setattr(task, "rng", np.random.default_rng()), "Generator"),
            (lambda task: setattr(task, "calls", 1 << 70), "int"),
            (lambda task: setattr(task, "walked", np.array([None, None])), "ndarray"),
        ],
    )
    def test_is_refused_where_it_cannot_be_kept(self, change, kind, closet):
        task = Wanderer()
        envs = flockstep.DroneVectorEnv(2, worlds=closet, task=task)
        envs.reset(seed=0)
        envs.snapshot()
        change(task)
        with pytest.raises(TypeError, match=rf"the attribute '\w+' \({kind}\) has changed since setup"):
            envs.snapshot()

    def test_the_checker_finds_state_missing_from_snapshots(self, closet):
        class Forgetful(Wanderer):
            def state(self):
                return {}

        with pytest.raises(AssertionError, match="a run after a snapshot should repeat"):
            check_vector_env(
                lambda n: flockstep.DroneVectorEnv(n, worlds=closet, task=Forgetful()),
                skip=self.SKIP,
            )
