"""`RemoteVectorEnv`: the same bits, infos and errors as the env in the server's process."""

import contextlib

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from messages import refused

import flockstep
from flockstep.client import RemoteVectorEnv, ServerError
from flockstep.testing import check_vector_env
from flockstep.testing.comparing import difference_between

KINDS = {
    "goal": {"action": "displacement"},
    "pixels": {"observation": "pixels", "camera": flockstep.CameraConfig(width_px=8, height_px=6, layout="chw")},
    "hover": {"task": flockstep.HoverConfig()},
    "groups": {"drones_per_env": 3},
}


class Served(RemoteVectorEnv):
    """A remote env with a server of its own, which ends with it."""

    def __init__(self, num_envs, reward_scale=1.0, **keywords):
        self.stack = contextlib.ExitStack()
        self.served = flockstep.DroneVectorEnv(num_envs, **keywords)
        server = self.stack.enter_context(flockstep.serve(self.served, port=0))
        super().__init__(self.stack.enter_context(flockstep.connect(server.address)), reward_scale=reward_scale)

    def close_extras(self, **kwargs):
        super().close_extras(**kwargs)
        self.stack.close()


@contextlib.contextmanager
def both(num_envs, **keywords):
    """The same env in this process and of a server."""
    local = flockstep.DroneVectorEnv(num_envs, **keywords)
    with contextlib.closing(local), contextlib.closing(Served(num_envs, **keywords)) as remote:
        yield local, remote


def assert_equal(a, b):
    assert difference_between(a, b) is None


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_as_in_process(kind, mode, closet):
    keywords = {**KINDS[kind], "worlds": closet, "max_episode_steps": 15, "autoreset_mode": mode}
    with both(5, **keywords, reward_scale=0.5) as (local, remote):
        for name in ("num_envs", "num_groups", "drones_per_env", "autoreset_mode", "observation_space", "action_space"):
            assert getattr(remote, name) == getattr(local, name), name
        assert remote.single_observation_space == local.single_observation_space
        assert remote.single_action_space == local.single_action_space
        assert remote.metadata["autoreset_mode"] is local.autoreset_mode
        assert remote.metadata["render_fps"] == local.metadata["render_fps"]
        assert_equal(local.reset(seed=3), remote.reset(seed=3))
        local.action_space.seed(1)
        ended = np.zeros(local.num_envs, bool)
        for _ in range(60):
            actions = local.action_space.sample()
            a, b = local.step(actions), remote.step(actions)
            assert_equal(a, b)
            if mode == "disabled" and (a[2] | a[3]).any():
                mask = {"reset_mask": a[2] | a[3]}
                ended |= mask["reset_mask"]
                assert_equal(local.reset(options=mask), remote.reset(options=mask))
            ended |= a[2] | a[3]
        assert ended.any()
        seeds = [5, 4, 3, 2, 1]
        assert_equal(local.reset(seed=seeds), remote.reset(seed=seeds))
        assert remote.np_random_seed == local.np_random_seed


class Walk(flockstep.Task):
    """Each drone has its own limit of steps. Row kinds of the checks are those of drones."""

    observation_space = gymnasium.spaces.Box(-40, 40, (4,), np.float32)

    def step(self, batch):
        limit = 4 + 3 * (np.arange(batch.num_drones) % batch.drones_per_env)
        return batch.position[:, 0], self.steps >= limit

    def observe(self, batch):
        return np.column_stack([batch.position, self.steps]).astype(np.float32)


TEAMS = {
    "goal": {"action": "displacement", "random_start": True},
    "hover": {"task": flockstep.HoverConfig(), "interaction": "collide"},
    "own": {"task": Walk, "random_world": True},
}


@pytest.mark.parametrize("kind", TEAMS)
@pytest.mark.parametrize("episodes", ["team", "each", "last"])
def test_episodes_of_several_drones_are_the_same_as_in_process(kind, episodes, mode, closet):
    """Ended rows are reset if autoreset is disabled, and with "each" any rows now and then."""
    keywords = {"worlds": closet, "drones_per_env": 3, "max_episode_steps": 15, **TEAMS[kind]}
    keywords |= {"episodes": episodes, "autoreset_mode": mode}
    with both(4, **keywords) as (local, remote):
        masks = np.random.default_rng(0).random((80, 12)) < 0.2
        partial = rests = 0
        assert_equal(local.reset(seed=3), remote.reset(seed=3))
        local.action_space.seed(1)
        for mask in masks:
            actions = local.action_space.sample()
            a, b = local.step(actions), remote.step(actions)
            assert_equal(a, b)
            np.testing.assert_array_equal(remote._waiting(), local.batch.waiting)
            ended = a[2] | a[3]
            rests += np.count_nonzero(a[4].get("finished", False))
            resets = ended if mode == "disabled" else mask & (episodes == "each")
            partial += len(set(np.count_nonzero(resets.reshape(4, 3), axis=1)) - {0, 3})
            if resets.any():
                options = {"reset_mask": resets}
                assert_equal(local.reset(options=options), remote.reset(options=options))
        assert (partial > 0) == (episodes == "each" or (episodes == "last" and mode == "disabled"))
        assert (rests > 0) == (episodes == "last")
        blob = remote.snapshot()
        expected = [remote.step(actions) for _ in range(20)]
        assert_equal(remote.restore(blob), local.restore(blob))
        for step in expected:
            assert_equal(remote.step(actions), step)
            assert_equal(local.step(actions), step)


def test_masks_of_many_drones(closet):
    keywords = {"worlds": closet, "drones_per_env": 50, "episodes": "each"}
    with contextlib.closing(Served(1, **keywords)) as remote:
        remote.reset(seed=0)
        remote.step(np.zeros(50, np.int64))
        mask = np.arange(50) % 3 == 0
        remote.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal(remote.served.batch.own_episodes, mask)


@pytest.mark.parametrize("episodes", ["team", "each", "last"])
def test_masks_of_drones_are_refused_as_in_process(episodes, closet):
    keywords = {"worlds": closet, "drones_per_env": 3, "episodes": episodes, "autoreset_mode": "disabled"}
    with both(2, **keywords) as (local, remote):
        for env in (local, remote):
            env.reset(seed=0)
            observation, *_ = env.step(np.zeros(6, np.int64))
            first = {"reset_mask": np.arange(6) == 1}
            if episodes == "each":
                assert (env.reset(options=first)[0][0] == observation[0]).all()
            else:
                expected = "together" if episodes == "team" else "or some whose episodes have ended"
                with pytest.raises(ValueError, match=f"mask'?]?: expected all .*{expected}"):
                    env.reset(options=first)
            with refused(ValueError, "options['reset_mask']", "all 3 drones"):
                env.reset(seed=1, options=first)
        assert remote.served.batch.steps.tolist() == ([1, 0, 1, 1, 1, 1] if episodes == "each" else [1] * 6)


@pytest.mark.parametrize("episodes", ["team", "each", "last"])
def test_the_checker_finds_no_fault(episodes, mode, closet):
    drones = {} if episodes == "team" else {"drones_per_env": 2, "episodes": episodes}

    def make(num_envs):
        return Served(num_envs, worlds=closet, max_episode_steps=10, autoreset_mode=mode, **drones)

    check_vector_env(make, num_envs=3, steps=40)


def test_gymnasium_wrappers(closet):
    with contextlib.closing(Served(3, worlds=closet, max_episode_steps=10)) as remote:
        wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(remote)
        wrapped.reset(seed=0)
        infos = [wrapped.step(wrapped.action_space.sample())[4] for _ in range(30)]
        assert any("episode" in info for info in infos)
        assert RemoteVectorEnv.__base__ is gymnasium.vector.VectorEnv  # some libraries look at the direct base


def test_statistics_of_some_of_the_ended_episodes(closet):
    keywords = {"worlds": closet, "max_episode_steps": 5, "autoreset_mode": "same_step"}
    with both(6, **keywords) as (local, remote):
        local.reset(seed=1)
        remote.reset(seed=1)
        ended = np.zeros(6, bool)
        while ended.sum() < 2:
            _, _, terminated, truncated, _ = local.step(np.zeros(6, np.int64))
            remote.step(np.zeros(6, np.int64))
            ended = terminated | truncated
        indices = np.flatnonzero(ended)
        for some in (indices, indices[1:], indices[::-1]):
            assert_equal(local.episode_infos(some), remote.episode_infos(some))
            assert_equal(local.final_observations(some), remote.final_observations(some))
        assert_equal(remote.episode_infos(), remote.episode_infos(indices))
        local.step(np.zeros(6, np.int64))
        remote.step(np.zeros(6, np.int64))
        with refused(ValueError, "indices"):
            remote.episode_infos(np.array([0]))


def test_arrays_belong_to_the_caller(closet):
    with contextlib.closing(Served(3, worlds=closet, action="displacement")) as remote:
        first, _ = remote.reset(seed=0)
        kept = first.copy()
        observation, reward, *_ = remote.step(np.ones((3, 3), np.float32))
        remote.step(-np.ones((3, 3), np.float32))
        np.testing.assert_array_equal(first, kept)
        for array in (first, observation, reward):
            assert array.flags.writeable
            assert array.flags.aligned
        observation[:] = 0
        reward[:] = 0


def test_bad_actions_change_nothing(closet):
    with contextlib.closing(Served(3, worlds=closet)) as remote:
        for call in (remote.snapshot, lambda: remote.step(np.zeros(3, np.int64))):
            with pytest.raises(gymnasium.error.ResetNeeded):
                call()
        remote.reset(seed=0)
        for bad in (np.zeros(2, np.int64), np.zeros(3), [[0], [1, 2]], None, "up", [0, 1, 99], [0, -1, 0]):
            with refused(ValueError, "actions"):
                remote.step(bad)
        assert remote.served.batch.steps.tolist() == [0, 0, 0]
        remote.step([0, 1, 2])
        remote.step(np.array([0, 1, 2], np.uint8))
        for seed, error in ((-1, ValueError), ("a", ValueError), (1.5, TypeError), ([1, 2], ValueError)):
            with refused(error, "seed"):
                remote.reset(seed=seed)
        with refused(ValueError, "options['reset_mask']"):
            remote.reset(options={"reset_mask": np.zeros(3, bool)})
        with refused(ValueError, "snapshot"):
            remote.restore(b"nothing")
    for call in (remote.reset, lambda: remote.restore(b"nothing")):
        with refused(RuntimeError, "this env is closed"):
            call()


def test_the_first_reset_of_some_envs(closet):
    with contextlib.closing(Served(3, worlds=closet)) as remote:
        mask = {"reset_mask": np.array([True, False, True])}
        with pytest.raises(gymnasium.error.ResetNeeded):
            remote.reset(options=mask)
        observation, _ = remote.reset(seed=4, options=mask)
        local = flockstep.DroneVectorEnv(3, worlds=closet)
        np.testing.assert_array_equal(observation, local.reset(seed=4, options=mask)[0])


def test_a_client_may_outlive_its_env(closet):
    envs = flockstep.DroneVectorEnv(3, worlds=closet)
    with flockstep.serve(envs, port=0) as server, flockstep.connect(server.address) as client:
        remote = client.vector_env()
        remote.reset(seed=0)
        remote.close()
        client.ping()
        assert client.vector_env().reset(seed=0)[0].shape == (3, 38)
        with refused(ValueError, "reward_scale", 0):
            client.vector_env(reward_scale=0)
        assert client.vector_env().autoreset_mode is AutoresetMode.NEXT_STEP


def test_a_batch_without_a_task(room):
    with (
        flockstep.serve(flockstep.Batch([room], 2), port=0) as server,
        flockstep.connect(server.address) as client,
        refused(ServerError, "task") as caught,
    ):
        client.vector_env()
    assert caught.value.code == "FAILED_PRECONDITION"


def test_a_task_with_integers_and_an_own_task(closet):
    class Count(flockstep.Task):
        observation_space = gymnasium.spaces.Dict(
            {
                "place": gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32),
                "near": gymnasium.spaces.Box(0, 255, (2, 2), np.uint8),
            }
        )
        action_space = gymnasium.spaces.Discrete(3, start=-1)

        def act(self, batch, actions):
            self.last = actions.copy()
            return batch.position

        def step(self, batch):
            return np.ones(batch.num_drones), np.zeros(batch.num_drones, bool)

        def observe(self, batch):
            return {"place": batch.position, "near": np.ones((batch.num_drones, 2, 2), np.uint8)}

    with contextlib.closing(Served(2, worlds=closet, task=Count(), max_episode_steps=4)) as remote:
        assert remote.single_action_space == Count.action_space
        assert remote.single_observation_space == Count.observation_space
        remote.reset(seed=0)
        for _ in range(6):
            observation, reward, *_ = remote.step([-1, 1])
        assert remote.served.task.last.tolist() == [-1, 1]
        assert (observation["near"] == 1).all()
        np.testing.assert_array_equal(observation["place"], remote.served.batch.position)
        assert reward.tolist() == [1, 1]
