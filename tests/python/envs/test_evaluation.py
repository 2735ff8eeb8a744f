"""Ends of episodes, and evaluations: which flights count, and what is refused."""

import gymnasium
import numpy as np
import pytest
import torch
from conftest import begun
from gymnasium import spaces
from messages import refused
from simple_tasks import Still
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

import flockstep
from flockstep import EpisodeEnd

ID = "flockstep/LidarNavigation-v0"

torch.set_num_threads(1)  # the networks are small


def test_any_policy_is_judged(room):
    class Rise(Still):
        max_episode_steps = 30

        def step(self, batch):
            self.success[:] = batch.position[:, 2] > 2.5
            return np.zeros(batch.num_drones), self.success

    def up(observation):
        return np.tile(np.float32([0, 0, 1]), (len(observation), 1))

    assert flockstep.sb3.success_rates(up, Rise, worlds=room, episodes=3) == {"room": 1.0}
    assert flockstep.sb3.success_rates(None, Rise, worlds=room, episodes=3) == {"room": 0.0}
    with refused(TypeError, "policy"):
        flockstep.sb3.success_rates("PPO", Rise, worlds=room)


class Image(Still):
    """Observes images with channels last, which Stable-Baselines3 moves to the front for its models."""

    camera = flockstep.CameraConfig(width_px=40, height_px=36)
    observation_space = spaces.Box(0, 255, (36, 40, 3), np.uint8)
    max_episode_steps = 3

    def observe(self, batch):
        return batch.camera().rgb


def test_a_model_is_judged_in_the_task_it_was_trained_in(room):
    envs = flockstep.sb3.make_vec(Image, 2, worlds=room)
    model = PPO("CnnPolicy", envs, n_steps=4, batch_size=8, device="cpu")
    assert model.observation_space.shape == (3, 36, 40) != Image.observation_space.shape
    for known in (Image, Image()):
        assert flockstep.sb3.evaluate(model, known, episodes=2, worlds=room).episode_length == 3
    pair = type("Pair", (Image,), {"observation_space": spaces.Dict(image=Image.observation_space)})
    for task, name, space in (
        ("flockstep/LidarNavigation-v0", "flockstep/LidarNavigation-v0", "Box(38,)"),
        (Counted, "Counted", "Box(1,)"),
        (pair, "Pair", "Dict(image: Box(36, 40, 3))"),
    ):
        with refused(ValueError, "evaluate", "Box(3, 36, 40)", name, space):
            flockstep.sb3.evaluate(model, task, episodes=2, worlds=room)
    with refused(ValueError, "success_rates", "Box(3, 36, 40)", "Box(38,)"):
        flockstep.sb3.success_rates(model, worlds=room)


def test_a_task_is_flown_in_the_worlds_it_declares(room, closet):
    task = type("AtHome", (Image,), {"worlds": [room, closet]})
    assert list(flockstep.sb3.success_rates(None, task)) == ["room", "closet"]
    assert list(flockstep.sb3.success_rates(None, task())) == ["room", "closet"]
    assert list(flockstep.sb3.success_rates(None, task=task)) == ["room", "closet"]
    assert list(flockstep.sb3.success_rates(None, task, worlds=room)) == ["room"]


@pytest.mark.parametrize("task", [Image, Image()])
def test_a_task_goes_by_the_keyword_of_the_env_too(task, room, tmp_path):
    keywords = {"task": task, "worlds": room}
    assert flockstep.sb3.make_vec(num_envs=2, **keywords).observation_space.shape == (36, 40, 3)
    assert flockstep.sb3.evaluate(None, episodes=2, **keywords).episode_length == 3
    assert flockstep.record(tmp_path / "flight.gif", render_view="top", **keywords) == 4


class Counted(flockstep.Task):
    """Env i ends after i + 1 steps, at most 3; it reports its return, and succeeds if its index is odd."""

    observation_space = spaces.Box(0, 9, (1,), np.float32)
    reward_terms = ("gain", "cost")
    info_names = ("earned",)
    max_episode_steps = 3

    def step(self, batch):
        index = np.arange(batch.num_drones)
        self.info["earned"] += index + 100 * batch.episode
        self.success[:] = index % 2
        return {"gain": 1.0 * index, "cost": np.full(batch.num_drones, -0.5)}, batch.steps > index

    def observe(self, batch):
        return batch.position[:, :1]


def test_an_evaluation_has_the_means_of_what_first_episodes_report(room):
    found = flockstep.sb3.evaluate(None, Counted, episodes=4, worlds=room, reward_scale=0.1)
    lengths = [1, 2, 3, 3]  # of envs 0 to 3; later episodes do not count
    earned = [0, 2, 6, 9]
    assert found == flockstep.sb3.Evaluation(
        episodes=4,
        success_rate=0.5,
        ends=dict.fromkeys((end.name for end in list(flockstep.EpisodeEnd)[1:]), 0.0) | {"success": 0.5, "task": 0.5},
        episode_return=np.mean(earned) - 0.5 * np.mean(lengths),
        episode_length=np.mean(lengths),
        episode_terms={"gain": np.mean(earned), "cost": -0.5 * np.mean(lengths)},
        infos={"earned": np.mean(earned)},
    )


class Summed(flockstep.Task):
    """The reward is the action. Env i begins a new episode after 2 + i % 3 steps."""

    observation_space = spaces.Box(-1, 1, (1,), np.float32)
    action_space = spaces.Box(-1, 1, (1,), np.float32)

    def setup(self, batch):
        self.earned = np.zeros(batch.num_drones)

    def act(self, batch, actions):
        self.earned[:] = actions[:, 0]
        return batch.position.copy()

    def step(self, batch):
        return self.earned.copy(), self.steps >= 2 + np.arange(batch.num_drones) % 3

    def observe(self, batch):
        return np.full((batch.num_drones, 1), 0.5, np.float32)


def test_an_evaluation_flies_a_recurrent_policy_with_its_memory(room):
    from sb3_contrib import RecurrentPPO

    envs = flockstep.sb3.make_vec(Summed, 6, worlds=room)
    network = {"lstm_hidden_size": 8, "net_arch": [4]}
    model = RecurrentPPO("MlpLstmPolicy", envs, n_steps=2, batch_size=4, policy_kwargs=network, seed=0, device="cpu")
    model.policy.action_net.weight.data *= 50  # an untrained network hardly reacts
    expected, _ = evaluate_policy(model, envs, n_eval_episodes=6)
    found = flockstep.evaluate(model, Summed, episodes=6, worlds=room)
    assert found.episode_return == pytest.approx(expected, abs=1e-6)
    forgetful = flockstep.evaluate(lambda seen: model.predict(seen, deterministic=True)[0], Summed, 6, worlds=room)
    assert abs(forgetful.episode_return - expected) > 0.01


class CountedTeam(flockstep.Task):
    """Drone m of an env ends after m + 1 steps; it succeeds in the first world, in its first episode."""

    observation_space = spaces.Box(0, 9, (1,), np.float32)

    def step(self, batch):
        drone = np.arange(batch.num_drones)
        env = drone // batch.drones_per_env
        own = batch.own_episodes if len(batch.own_episodes) else np.zeros(batch.num_drones)
        self.success[:] = (batch.world_index[env] == 0) & (batch.episode[env] + own == 0)
        return np.ones(batch.num_drones), self.steps > drone % batch.drones_per_env

    def observe(self, batch):
        return np.zeros((batch.num_drones, 1), np.float32)


@pytest.mark.parametrize("kind", ["team", "each", "last"])
def test_an_evaluation_counts_the_first_episode_of_each_drone(kind, room, closet):
    """Two envs of three drones, one in each world."""
    keywords = {"worlds": [closet, room], "drones_per_env": 3, "drone_episodes": kind}
    found = flockstep.evaluate(None, CountedTeam, episodes=2, **keywords)
    assert found.episodes == 6
    assert found.episode_length == pytest.approx(1 if kind == "team" else 2)
    assert found.success_rate == found.ends["success"] == 0.5
    assert found.ends["task" if kind != "team" else "teammate"] == pytest.approx(1 / 2 if kind != "team" else 1 / 3)
    for worlds, rates in (([closet, room], {"closet": 1, "room": 0}), ([room, closet], {"closet": 0, "room": 1})):
        keywords["worlds"] = worlds
        assert flockstep.success_rates(None, CountedTeam, episodes=3, **keywords) == rates
    one = flockstep.evaluate(None, CountedTeam, episodes=2, worlds=[closet, room])
    assert (one.episodes, one.episode_length) == (2, 1)


def test_an_evaluation_of_a_task_of_several_drones():
    def straight(observation):
        assert len(observation) == 4 * 8
        return observation[:, :2]

    found = flockstep.evaluate(straight, "flockstep/Swap-v0", episodes=4)
    assert found.episodes == 32
    assert found.ends["contact"] + found.ends["teammate"] == 1
    with refused(ValueError, "episodes", "each", "drone_episodes='each'"):
        flockstep.evaluate(straight, "flockstep/Swap-v0", episodes="each")
    with refused(ValueError, "episodes", "all"):
        flockstep.evaluate(straight, "flockstep/Swap-v0", drone_episodes="all")


def test_an_evaluation_of_a_built_in_task(room, closet):
    """Straight ahead: into the pillar of the room, into the wall of the closet; seeds change the start."""

    def ahead(observation):
        return np.zeros(len(observation), int)

    found = flockstep.sb3.evaluate(ahead, episodes=2, worlds=[room, closet])
    assert (found.success_rate, found.ends["contact"], found.infos) == (0.0, 1.0, {})
    assert found.episode_return == pytest.approx(sum(found.episode_terms.values()))
    starts = {"worlds": room, "random_start": True, "episodes": 3}
    one, same, other = (flockstep.sb3.evaluate(ahead, seed=seed, **starts) for seed in (0, 0, 1000))
    assert one == same != other
    for wrong in (0, 2.5):
        with refused(ValueError, "episodes", wrong):
            flockstep.sb3.evaluate(ahead, episodes=wrong)


# --- reasons for the end of episodes: one each, in the batch, in infos, in evaluations


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
def test_each_reason_of_a_task_in_python(room, mode):
    envs = begun(8, worlds=room, task=Ways, autoreset_mode=mode)
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

    envs = begun(2, worlds=room, task=Late)
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
    envs = begun(1, worlds=room, frame_skip=4, max_episode_steps=6)
    assert names(envs.step([2])[4].get("episode_end", [0])) == ["none"]
    assert names(envs.step([2])[4]["episode_end"]) == ["time"]
