"""Reasons for the end of episodes: one each, in the batch, in infos, in evaluations."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

import flockstep
from flockstep import EpisodeEnd

MODES = ["next_step", "same_step", "disabled"]


class Ways(flockstep.Task):
    """Env i ends its first step in the i-th way, or at its limit of two steps."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float32)
    max_episode_steps = 2

    def step(self, batch):
        way = np.arange(batch.num_drones)
        self.success[:] = way == 1
        self.left_area[:] = (way == 3) | (way == 7)
        self.truncated[:] = way >= 6
        reward = np.where(way == 4, 1e31, 0.0)
        return reward, (way == 1) | (way == 2) | (way == 3) | (way == 5)

    def act(self, batch, actions):
        far = np.zeros((batch.num_drones, 3))
        far[2] = [100, 0, 0]  # through the wall
        return batch.position + far

    def observe(self, batch):
        return np.zeros((batch.num_drones, 1), np.float32)


FIRST = ["none", "success", "contact", "left_area", "bad_state", "task", "task", "left_area"]


def names(codes):
    return [EpisodeEnd(code).name for code in codes]


@pytest.mark.filterwarnings("ignore:Ways.step")
@pytest.mark.parametrize("mode", MODES)
def test_each_reason_of_a_task_in_python(room, mode):
    envs = flockstep.DroneVectorEnv(8, worlds=room, task=Ways, autoreset_mode=mode)
    envs.reset(seed=0)
    actions = np.zeros((8, 3), np.float32)
    infos = envs.step(actions)[4]
    infos = infos.get("final_info", infos)
    assert names(envs.batch.episode_end) == names(infos["episode_end"]) == FIRST
    assert infos["_episode_end"].tolist() == [name != "none" for name in FIRST]
    blob = envs.snapshot()
    ended = envs.step(actions)[4]
    ended = ended.get("final_info", ended)
    assert EpisodeEnd(ended["episode_end"][0]) is EpisodeEnd.time
    second = {"next_step": ["none"] * 7, "same_step": FIRST[1:], "disabled": FIRST[1:]}[mode]
    assert names(envs.batch.episode_end)[1:] == second
    envs.restore(blob)
    assert names(envs.batch.episode_end) == FIRST
    envs.reset(seed=1)
    assert not envs.batch.episode_end.any()


def test_a_limit_comes_before_a_cut_by_the_task_and_after_success(room):
    class Late(Ways):
        max_episode_steps = 1

        def step(self, batch):
            self.success[:] = np.arange(batch.num_drones) == 0
            self.truncated[:] = True
            return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)

        act = flockstep.Task.act

    envs = flockstep.DroneVectorEnv(2, worlds=room, task=Late)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 3), np.float32))
    assert names(envs.batch.episode_end) == ["success", "time"]


@pytest.mark.parametrize("config", [flockstep.HoverConfig(max_distance_m=0.4), flockstep.TrackConfig(path="random")])
def test_flights_that_are_lost(config):
    found = flockstep.sb3.evaluate(None, "flockstep/Hover-v0", episodes=20, task=config)
    assert sum(found.ends.values()) == pytest.approx(1)
    assert found.ends["left_area"] > 0.5
    assert set(found.ends) == {end.name for end in EpisodeEnd} - {"none"}


def test_an_untrained_hover_says_how_its_flights_were_lost():
    envs = flockstep.sb3.make_vec("flockstep/Hover-v0", 20)
    envs.seed(0)
    envs.reset()
    while True:
        _, _, done, infos = envs.step(np.stack([envs.action_space.sample() for _ in range(20)]))
        if done.any():
            break
    for info in (infos[i] for i in np.flatnonzero(done)):
        assert EpisodeEnd(info["episode_end"]) is (EpisodeEnd.contact if info["crashed"] else EpisodeEnd.left_area)


def test_navigation(room, closet):
    def end_of(action, worlds, **keywords):
        env = gymnasium.make("flockstep/LidarNavigation-v0", worlds=worlds, **keywords)
        env.reset(seed=0)
        while True:
            _, _, terminated, truncated, info = env.step(action)
            if terminated or truncated:
                return EpisodeEnd(info["episode_end"])
            assert info["episode_end"] == EpisodeEnd.none

    assert end_of(0, room) is EpisodeEnd.contact  # ahead, into the pillar
    assert end_of(2, room, max_episode_steps=3) is EpisodeEnd.time
    assert end_of(0, closet, reward=flockstep.NavigationReward(goal_radius_m=3)) is EpisodeEnd.success
    overshoot = flockstep.NavigationReward(overshoot_weight=1, goal_radius_m=0.05)
    beside = closet.with_markers(start=[1, 1, 0.6], goal=[1.1, 1.2, 0.6])
    assert end_of(0, beside, reward=overshoot) is EpisodeEnd.left_area


def test_an_env_of_several_steps_per_action_reports_its_last(room):
    envs = flockstep.DroneVectorEnv(1, worlds=room, frame_skip=4, max_episode_steps=6)
    envs.reset(seed=0)
    assert names(envs.step([2])[4].get("episode_end", [0])) == ["none"]
    assert names(envs.step([2])[4]["episode_end"]) == ["time"]
