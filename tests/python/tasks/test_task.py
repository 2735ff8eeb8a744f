"""Tasks written in Python, and snapshots of the env."""

import ast
import copy
import gc
import inspect
import pickle
import weakref

import numpy as np
import pytest
from conftest import begun
from gymnasium import spaces
from messages import refused
from simple_tasks import Climb, Lapper

import flockstep
from flockstep.testing import check_vector_env


class TestWhatATaskReports:
    @pytest.mark.parametrize("frame_skip", [1, 2])
    def test_ends_infos_and_terms(self, room, mode, frame_skip):
        env = begun(2, worlds=room, task=Lapper(), autoreset_mode=mode, frame_skip=frame_skip)
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


def test_steps_and_flying_are_what_they_say(room):
    class Probe(Climb):
        def step(self, batch):
            seen.append((self.steps.copy(), self.flying.copy()))
            return super().step(batch)

    seen = []
    env = begun(2, worlds=room, task=Probe(), max_episode_steps=3)
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


def test_a_task_declares_frame_skip_and_random_world(room, closet):
    task = type("Drawn", (Climb,), {"worlds": [room, closet], "random_world": True, "frame_skip": 3})
    envs = begun(40, task=task)
    assert set(envs.batch.world_index[::2]) == {0, 1}  # worlds in turn would give only 0
    envs.step(np.zeros((40, 3), np.float32))
    assert envs.batch.steps[envs.batch.world_index == 0].tolist() == [3] * np.sum(envs.batch.world_index == 0)
    given = begun(4, task=task, random_world=False, frame_skip=2)
    given.step(np.zeros((4, 3), np.float32))
    assert given.batch.world_index.tolist() == [0, 1, 0, 1]
    assert given.batch.steps[::2].tolist() == [2, 2]


def test_a_reset_puts_drones_into_worlds_of_its_choice(room, closet):
    class Harder(Climb):
        def reset(self, batch, mask):
            batch.set_world(np.where(batch.episode > 0, 1, 0), mask)
            super().reset(batch, mask)

    envs = begun(3, worlds=[room, closet], task=Harder)
    assert envs.batch.world_index.tolist() == [0, 0, 0]
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert envs.batch.world_index.tolist() == [0, 1, 0]
    np.testing.assert_allclose(envs.batch.position[1], closet.start)


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

    with refused(AssertionError, "after a reset with a mask"):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Forgetful(), autoreset_mode=mode, num_threads=1)
        )


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


@pytest.mark.parametrize("task", [Climb, Lapper, Look])
def test_small_tasks_pass_the_checker(room, mode, task):
    check_vector_env(
        lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=task(), autoreset_mode=mode, num_threads=1)
    )


@pytest.mark.parametrize(
    ("name", "limit", "steps"),
    [("Hover", 20, 50), ("Track", 20, 50), ("Race", 20, 50), ("Swap", 30, 100), ("Formation", 30, 100)],
)
def test_the_engines_tasks_pass_the_checker(name, limit, steps):
    config = getattr(flockstep, f"{name}Config")()
    check_vector_env(lambda n: flockstep.DroneVectorEnv(n, task=config, max_episode_steps=limit), steps=steps)


class TestSeveralFields:
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
        envs = begun(2, worlds=room, task=Look(), autoreset_mode="same_step")
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
            (Lost, ("Lost.observe", "height")),
            (Shapeless, ("Shapeless.observe", 2, 1, 3)),
            (Unnamed, ("Unnamed.step", "climb")),
        ):
            with refused(ValueError, *match):
                fly(flockstep.DroneVectorEnv(2, worlds=room, task=task()))


class TestExamples:
    def test_a_task_of_ones_own_takes_at_most_forty_lines(self, example):
        module = example("train_my_task")
        source = inspect.getsource(module)
        (task,) = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)]
        assert task.end_lineno - task.lineno + 1 <= 40

    def test_it_trains(self, example):
        assert example("train_my_task").main(total_timesteps=24_000) > 0.5

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
        example("navigation_numpy").main(steps=300)
        assert capsys.readouterr().out.count("10,500 steps, flags the same") == 2


class TestPromises:
    """Promises of the class documentation."""

    def test_a_batch_with_a_task_is_let_go(self, room):
        task = Climb()
        env = begun(2, worlds=room, task=task)
        env.step(np.zeros((2, 3)))
        batch = weakref.ref(env.batch)
        np.testing.assert_array_equal(task.steps, [1, 1])
        del env
        gc.collect()
        assert batch() is None
        with refused(RuntimeError, "Climb"):
            task.steps  # noqa: B018

    def test_copies_and_pickles_belong_to_no_batch(self, room):
        task = Climb()
        env = flockstep.DroneVectorEnv(2, worlds=room, task=task)
        env.reset(seed=0)
        for other in (copy.deepcopy(task), pickle.loads(pickle.dumps(task))):
            np.testing.assert_array_equal(other.bonus, task.bonus)
            with refused(RuntimeError, "Climb", "no environment"):
                other.steps  # noqa: B018

    def test_actions_beyond_the_space_are_clipped(self, room):
        env = begun(2, worlds=room, task=Climb())
        before = env.batch.position.copy()
        env.step(np.array([[0, 0, 1], [0, 0, 50]], np.float32))
        np.testing.assert_allclose(env.batch.position[:, 2] - before[:, 2], Climb.step_m, rtol=1e-5)

    def test_another_step_length_or_module_is_another_task(self, room):
        one, other = (flockstep.DroneVectorEnv(2, worlds=room, task=Climb()) for _ in range(2))
        one.reset(seed=0)
        other.restore(one.snapshot())
        longer = Climb()
        longer.step_m = 0.2
        moved = type("Climb", (Climb,), {"__module__": "elsewhere"})()
        for task in (longer, moved):
            stranger = flockstep.DroneVectorEnv(2, worlds=room, task=task)
            with refused(ValueError, "snapshot", "task"):
                stranger.restore(one.snapshot())
