"""training/forest_flight.py: observation, reward and ends of the flight through a forest."""

import numpy as np
import pytest
from conftest import world_of

import flockstep
from flockstep.rotations import rotate
from flockstep.testing import check_vector_env
from training.forest_flight import DEPTH, FAR_M, GOAL_RADIUS_M, ForestFlight, straight

AHEAD = np.zeros((1, 3), np.float32)
DOWN = np.float32([[0, -1, 0]])
UPWARDS = np.float32([[0, 1, 0]])
ASIDE = np.float32([[1, 0, 0]])


def clearing(**parts):
    """A flat field with a start, a goal 20 m ahead, and these parts."""
    parts["boxes"] = [{"center": [15, 0, -0.5], "size": [40, 20, 1]}, *parts.get("boxes", [])]
    return world_of(**{"markers": {"start": [2, 0, 1.5], "goal": [22, 0, 1.5]}} | parts)


TRUNK = {"center": [12, 0, 2], "size": [0.4, 0.4, 6]}


@pytest.fixture
def fly():
    """Fly the same action in a world to the end of the episode; return the envs and each step's return values."""

    def fly(world, act, **keywords):
        envs = flockstep.DroneVectorEnv(1, task=ForestFlight(), worlds=world, autoreset_mode="disabled", **keywords)
        observation, _ = envs.reset(seed=0)
        steps = []
        while not steps or not (steps[-1][2] | steps[-1][3]).any():
            observation, *rest = envs.step(act(observation) if callable(act) else act)
            steps.append((observation.copy(), *rest))
        return envs, steps

    return fly


def end_of(steps):
    infos = steps[-1][-1]
    return flockstep.EpisodeEnd(infos["episode_end"][0]).name


def terms_of(steps):
    return {name: values[0] for name, values in steps[-1][-1]["episode_terms"].items() if not name.startswith("_")}


def test_the_contract_of_vector_envs_holds():
    world = flockstep.World.forest(3, trees=30, size_m=(30, 20))
    check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=world, task=ForestFlight(), max_episode_steps=30))


def test_straight_flight_reaches_the_goal_at_the_commanded_speed(fly):
    envs, steps = fly(clearing(), straight)
    terms = terms_of(steps)
    assert end_of(steps) == "success"
    flown_m = 20 - envs.batch.terms.goal_distance()[0]
    assert terms["progress"] == pytest.approx(0.5 * flown_m, abs=1e-4)
    assert flown_m > 20 - GOAL_RADIUS_M
    assert (terms["reached"], terms["crash"]) == (5, 0)
    speeds = [step[0][0, 196] for step in steps]  # 0.4 times the forward velocity in the body frame, less 2
    assert 4.7 < np.max(speeds) / 0.4 + 5 < ForestFlight.commanded_mps
    assert steps[-1][-1]["speed_mps"][0] == pytest.approx(flown_m / (len(steps) / 10), rel=0.01)


def test_a_trunk_in_the_way_ends_the_flight(fly):
    envs, steps = fly(clearing(boxes=[TRUNK]), straight)
    assert end_of(steps) == "contact"
    assert terms_of(steps)["crash"] == -10
    assert terms_of(steps)["reached"] == 0
    assert terms_of(steps)["near"] < 0
    assert envs.batch.position[0, 0] < 12


def test_flights_out_of_the_forest_end(fly):
    envs, steps = fly(clearing(), UPWARDS)
    assert end_of(steps) == "left_area"
    assert 1.5 + 2.5 < envs.batch.position[0, 2] < 1.5 + 2.5 + 0.5
    assert terms_of(steps)["crash"] == -10
    envs, steps = fly(clearing(), ASIDE)
    assert end_of(steps) == "left_area"
    assert envs.batch.position[0, 1] > 10
    _, steps = fly(clearing(), DOWN)
    assert end_of(steps) == "contact"


def test_height_is_measured_from_the_line_to_the_goal():
    high = clearing(markers={"start": [2, 0, 1.5], "goal": [22, 0, 5.5]})
    envs = flockstep.DroneVectorEnv(2, task=ForestFlight(), worlds=high)
    envs.reset(seed=0)
    envs.batch.set_pose([[12, 0, 3.5], [7, 3, 1.5]])
    np.testing.assert_allclose(envs.task.above_line(envs.batch), [0, -1], atol=1e-5)


def test_the_observation_by_hand(fly):
    world = clearing(boxes=[TRUNK])
    envs, steps = fly(world, np.float32([[0.1, 0.05, 0.3]]), max_episode_steps=8)
    observation, batch = steps[-1][0][0], envs.batch
    quat = batch.quat_wxyz[0]
    way = np.float32([22, 0, 1.5]) - batch.position[0]
    depth = flockstep.render(
        world,
        batch.position[0],
        quat,
        camera=flockstep.CameraConfig(width_px=32, height_px=24, hfov_deg=90, far_m=FAR_M, outputs=("depth",)),
    )["depth"]
    pooled = depth.reshape(12, 2, 16, 2).min(axis=(1, 3))
    expected = [
        2 * rotate(quat, way / np.linalg.norm(way), inverse=True),
        [0.1 * np.linalg.norm(way)],
        3 / (1 + pooled.ravel()),
        0.4 * rotate(quat, batch.velocity[0], inverse=True) - [2, 0, 0],
        rotate(quat, np.float32([0, 0, 1]), inverse=True),
        0.5 * batch.angular_velocity[0],
        [0.1, 0.05, 0.3],
        [0.5 * (batch.position[0, 2] - 1.5)],
    ]
    assert 0.1 * np.linalg.norm(way) < 2  # the limit of the observed distance is not in force
    assert np.isinf(pooled).any()
    assert pooled.min() < 10
    np.testing.assert_allclose(observation, np.concatenate(expected), atol=2e-5)
    assert observation[DEPTH].max() > 0.3


def test_commands_have_one_speed():
    envs = flockstep.DroneVectorEnv(3, task=ForestFlight(), worlds=clearing())
    actions = np.float32([[0, 0, 0], [1, 1, 1], [-3, 0.5, -0.5]])
    commands = envs.task.act(envs.batch, actions)
    np.testing.assert_allclose(np.linalg.norm(commands[:, :3], axis=1), ForestFlight.commanded_mps, rtol=1e-6)
    np.testing.assert_allclose(commands[1, 1:3] / commands[1, 0], [1, 0.5], rtol=1e-6)
    np.testing.assert_allclose(commands[2, 1:3] / commands[2, 0], [-1, 0.25], rtol=1e-6)
    np.testing.assert_allclose(commands[:, 3], [0, 2, -1])
