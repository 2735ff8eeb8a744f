"""The state of tasks written in Python: snapshots, values that are not finite, and what nobody has listed."""

import numpy as np
import pytest
from conftest import begun
from gymnasium import spaces
from messages import refused
from simple_tasks import Climb

import flockstep
from flockstep.testing import CHECKS, check_vector_env


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

        env = begun(3, worlds=room, task=Wild(), autoreset_mode=mode, max_episode_steps=9)
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
        envs = begun(2, worlds=closet, task=task)
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
        envs = begun(2, worlds=closet, task=task)
        envs.snapshot()
        change(task)
        with refused(TypeError, "Wanderer.state", f"({kind})"):
            envs.snapshot()

    def test_the_checker_finds_state_missing_from_snapshots(self, closet):
        class Forgetful(Wanderer):
            def state(self):
                return {}

        with refused(AssertionError, "after a snapshot"):
            check_vector_env(
                lambda n: flockstep.DroneVectorEnv(n, worlds=closet, task=Forgetful()),
                skip=self.SKIP,
            )
