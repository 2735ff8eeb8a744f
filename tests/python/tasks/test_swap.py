"""The swap task: its places, its ends, and the same task in NumPy."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from twins import both, fly_beside

import flockstep
from flockstep import EpisodeEnd

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


class TestObservation:
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
    config = flockstep.SwapConfig(radius_m=2.0, goal_radius_m=1.0, near_m=2.5, goal_weight=3.0, neighbors=4)
    keywords = {"drones_per_env": drones, "autoreset_mode": mode, "pose_sensor": NOISE, "max_episode_steps": 40}
    engine, twin = both(20, config, example("swap_numpy").Swap(config), **keywords)
    rng, ends = np.random.default_rng(0), np.zeros(len(EpisodeEnd), int)

    def actions_of(observation):  # to the goal, and to the right of it
        return observation[:, :2] + np.float32([0, -0.5]) + rng.normal(0, 0.5, (20 * drones, 2)).astype(np.float32)

    for _, ended in fly_beside(engine, twin, actions_of, 150, atol=1e-4, begin=2e-5):
        ends += np.bincount(engine.batch.episode_end[ended], minlength=len(EpisodeEnd))
    assert drones == 8 or ends[EpisodeEnd.success]
    assert drones == 1 or (ends[EpisodeEnd.contact] and ends[EpisodeEnd.teammate])
