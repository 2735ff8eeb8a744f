"""The swap task: its places, its ends, and the same task in NumPy."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused

import flockstep
from flockstep import EpisodeEnd

ROUNDING = 2e-5
NOISE = flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=2.0)


def make(num_envs=4, drones=6, **keywords):
    envs = flockstep.DroneVectorEnv(num_envs, task=flockstep.SwapConfig(), drones_per_env=drones, **keywords)
    envs.reset(seed=0)
    return envs


def goals(envs):
    return envs.batch.task_state["goal"].reshape(envs.num_groups, envs.drones_per_env, 3)


class TestPlaces:
    @pytest.mark.parametrize("drones", [1, 2, 3, 5, 8, 32])
    def test_goals_are_a_permutation_of_the_places_that_moves_every_drone(self, drones):
        envs = make(drones=drones)
        start, goal = envs.batch.position.reshape(goals(envs).shape), goals(envs)
        shift = drones // 2
        if drones == 1:  # the opposite place
            np.testing.assert_allclose(np.linalg.norm(goal - start, axis=2), 8, atol=0.3)
            return
        apart = np.linalg.norm(np.roll(start, -shift, axis=1) - goal, axis=2)
        assert apart.max() <= np.sqrt(2) * 0.1 + 1e-5
        assert np.linalg.norm(goal - start, axis=2).min() > 1

    def test_starts_differ_between_episodes_and_face_their_goals(self):
        envs = make()
        first = envs.batch.position.copy()
        way = envs.batch.task_state["goal"] - envs.batch.position
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        np.testing.assert_allclose(envs.batch.terms.rotate_to_body(way), np.tile([1, 0, 0], (24, 1)), atol=1e-5)
        envs.reset()
        assert (np.abs(envs.batch.position - first).max(axis=1) > 1e-3).all()

    def test_many_drones_have_a_larger_circle(self):
        envs = make(1, 32)
        goal = goals(envs)[0]
        np.testing.assert_allclose(np.linalg.norm(goal[:, :2], axis=1), 32 * 1.3 / (2 * np.pi), rtol=1e-5)

    def test_a_small_world_is_refused(self):
        room = world_of(name="closet", room={"min": [-3, -3, 0], "max": [3, 3, 3]})
        with refused(ValueError, "worlds", 'world "closet'):
            make(worlds=room)


class TestEnds:
    def test_all_at_their_goals_are_a_success_for_all(self):
        envs = make(2, autoreset_mode="disabled")
        place = envs.batch.task_state["goal"].copy()
        place[3, :2] *= 0.8
        envs.batch.set_pose(place)
        _, _, terminated, truncated, _ = envs.step(np.zeros((12, 2), np.float32))
        assert (terminated | truncated).tolist() == [False] * 6 + [True] * 6
        assert envs.batch.success.tolist() == [False] * 6 + [True] * 6
        assert envs.batch.reward_terms[6:, 1].tolist() == [10.0] * 6
        envs.batch.set_pose(envs.batch.task_state["goal"])
        _, _, terminated, _, infos = envs.step(np.zeros((12, 2), np.float32))
        assert terminated.all()
        assert (infos["episode_end"] == EpisodeEnd.success).all()

    def test_a_touch_is_a_contact_of_two_and_ends_the_episode_of_the_others(self):
        envs = make(1, autoreset_mode="disabled")
        place = envs.batch.task_state["goal"].copy()
        place[1] = place[0] + [1.0, 0, 0]
        envs.batch.set_pose(place, np.tile(np.float32([1, 0, 0, 0]), (6, 1)))
        action = np.zeros((6, 2), np.float32)
        action[1] = [-1, 0]
        _, _, terminated, truncated, infos = envs.step(action)
        assert terminated.tolist() == [True, True, False, False, False, False]
        assert truncated.tolist() == [False, False, True, True, True, True]
        assert infos["episode_end"].tolist() == [EpisodeEnd.contact] * 2 + [EpisodeEnd.teammate] * 4
        assert envs.batch.reward_terms[:, 2].tolist() == [-20.0, -20.0, 0, 0, 0, 0]
        assert not envs.batch.success.any()


class TestObservation:
    def test_lies_in_its_space(self):
        envs = make(pose_sensor=NOISE)
        envs.action_space.seed(0)
        for _ in range(100):
            observation = envs.step(envs.action_space.sample())[0]
            assert envs.observation_space.contains(observation)

    def test_the_task_has_its_defaults(self):
        envs = flockstep.DroneVectorEnv(3, task=flockstep.SwapConfig())
        assert (envs.num_groups, envs.drones_per_env, envs.num_envs) == (3, 8, 24)
        assert envs.recipe.interaction == "collide"
        assert flockstep.DroneVectorEnv(1, task=flockstep.SwapConfig(), interaction="none").recipe.interaction == "none"

    def test_rotor_driven_drones_fly_too(self):
        envs = flockstep.DroneVectorEnv(2, task=flockstep.SwapConfig(), motion="rotors", drone="x500")
        observation, _ = envs.reset(seed=0)
        height = envs.batch.position[:, 2].copy()
        distance = observation[:, 2].copy()
        for _ in range(20):
            observation, *_ = envs.step(0.5 * observation[:, :2])
        assert (observation[:, 2] < distance - 0.05).all()
        np.testing.assert_allclose(envs.batch.position[:, 2], height, atol=0.1)


@pytest.mark.parametrize(("mode", "drones"), [("next_step", 5), ("same_step", 8), ("disabled", 1)])
def test_the_engine_and_numpy_agree(example, mode, drones):
    swap = example("swap_numpy")
    config = flockstep.SwapConfig(radius_m=2.0, goal_radius_m=1.0, near_m=2.5, goal_weight=3.0, neighbors=4)
    keywords = {
        "drones_per_env": drones,
        "autoreset_mode": mode,
        "pose_sensor": NOISE,
        "max_episode_steps": 40,
        "num_threads": 1,
    }
    engine = flockstep.DroneVectorEnv(20, task=config, **keywords)
    twin_task = swap.Swap(config)
    twin = flockstep.DroneVectorEnv(20, task=twin_task, **keywords)
    observation, _ = engine.reset(seed=0)
    np.testing.assert_allclose(observation, twin.reset(seed=0)[0], atol=ROUNDING)
    rng, ends = np.random.default_rng(0), np.zeros(len(EpisodeEnd), int)
    for _ in range(150):
        noise = rng.normal(0, 0.5, (20 * drones, 2)).astype(np.float32)
        actions = observation[:, :2] + np.float32([0, -0.5]) + noise
        ours, theirs = engine.step(actions), twin.step(actions)
        observation = ours[0]
        np.testing.assert_allclose(ours[0], theirs[0], atol=1e-4)
        np.testing.assert_allclose(engine.batch.reward_terms, twin.batch.reward_terms, atol=1e-4)
        np.testing.assert_array_equal(ours[2], theirs[2])
        np.testing.assert_array_equal(ours[3], theirs[3])
        np.testing.assert_array_equal(engine.batch.success, twin.batch.success)
        ended = ours[2] | ours[3]
        ends += np.bincount(engine.batch.episode_end[ended], minlength=len(EpisodeEnd))
        if mode == "disabled" and ended.any():
            for envs in (engine, twin):
                envs.reset(options={"reset_mask": ended.copy()})
            observation = engine.observation().copy()
    assert drones == 8 or ends[EpisodeEnd.success]
    assert drones == 1 or (ends[EpisodeEnd.contact] and ends[EpisodeEnd.teammate])
