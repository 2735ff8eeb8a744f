"""The engine's navigation task against its NumPy twin and hand-computed numbers."""

import numpy as np
import pytest
from conftest import begun
from messages import refused
from twins import both, fly_beside

import flockstep
from flockstep.rotations import rotate

OVERSHOOT = flockstep.NavigationReward(overshoot_weight=1.0, carry_over_distance=True)
WEIGHTED = flockstep.NavigationReward(
    distance_weight=2.0,
    crash_weight=0.5,
    free_space_weight=3.0,
    step_weight=0.1,
    action_change_weight=0.2,
    goal_reward=500.0,
    waypoint_share=0.3,
    goal_radius_m=0.8,
    min_clearance=0.4,
    step_scale=50.0,
)
ATOL = 2e-4  # of observations: a beam that grazes a pillar amplifies the rounding of a pose
CENTIMETRES = {"rtol": 1e-5, "atol": 3e-3}  # of rewards: of float32 positions


def homing(batch, rng, kind):
    """Actions that mostly lead to the current goal, so that drones reach waypoints and goals; otherwise random ones."""
    n = batch.num_drones
    goals = [np.concatenate([w.waypoints, w.goal[None]]) for w in batch.worlds]
    goal = np.stack([goals[w][g] for w, g in zip(batch.world_index, batch.task_state["goal_index"], strict=True)])
    offset = goal - batch.position
    w, z = batch.quat_wxyz[:, 0], batch.quat_wxyz[:, 3]
    cos, sin = w * w - z * z, 2 * w * z
    offset = np.stack(
        [cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0], offset[:, 2]], axis=1
    )
    wild = rng.random(n) < 0.2
    if kind == "discrete":
        axis = np.abs(offset).argmax(axis=1)
        towards = 2 * axis + (offset[np.arange(n), axis] < 0)
        return np.where(wild, rng.integers(6, size=n), towards)
    size = 3 if kind == "displacement" else 4
    actions = rng.uniform(-1.5, 1.5, (n, size)).astype(np.float32)
    actions[~wild, :3] = (offset / np.linalg.norm(offset, axis=1, keepdims=True))[~wild]
    return np.where(rng.random((n, 1)) < 0.2, np.float32(0.5), actions)  # occasionally repeats an action


@pytest.mark.parametrize("kind", ["discrete", "displacement", "displacement_yaw"])
@pytest.mark.parametrize(
    "reward", [flockstep.NavigationReward(), WEIGHTED, OVERSHOOT], ids=["thesis", "weighted", "overshoot"]
)
def test_agrees_with_its_numpy_twin(room, closet, playgrounds, example, kind, reward, mode):
    lidar = flockstep.LidarConfig()
    config = flockstep.NavigationConfig(action=kind, reward=reward)
    arguments = {"worlds": [room, closet, *playgrounds], "lidar": lidar, "autoreset_mode": mode}
    task = example("navigation_numpy").Navigation(config, lidar)
    engine, twin = both(28, config, task, max_episode_steps=120, **arguments)
    rng = np.random.default_rng(0)
    crashed = succeeded = 0
    beside = fly_beside(engine, twin, lambda _: homing(engine.batch, rng, kind), 400, atol=ATOL, rewards=CENTIMETRES)
    for ours, ended in beside:
        infos = ours[4].get("final_info", ours[4])
        if ended.any():
            expected = twin.batch.episode_return[ended]
            np.testing.assert_allclose(infos["episode_return"][ended], expected, rtol=1e-5, atol=0.5)
            crashed += infos["crashed"].sum()
            succeeded += infos["success"].sum()
        # Otherwise float32 rounding would let the two drift apart.
        twin.batch.set_pose(engine.batch.position, engine.batch.quat_wxyz, ~ended)
    assert crashed > 10
    assert succeeded > 5


@pytest.mark.parametrize("norm", ["euclidean", "maximum"])
def test_the_chosen_norm_of_the_direction_to_the_goal_is_1(playgrounds, norm):
    task = flockstep.NavigationConfig(goal_norm=norm)
    envs = flockstep.DroneVectorEnv(5, worlds=playgrounds, task=task)
    direction = envs.reset(seed=0)[0][:, :3]
    batch = envs.batch
    goals = np.array([world.waypoints[0] for world in batch.worlds])[batch.world_index]
    offset = goals - batch.position
    length = np.abs(offset).max(axis=1) if norm == "maximum" else np.linalg.norm(offset, axis=1)
    np.testing.assert_allclose(direction, offset / length[:, None], atol=1e-6)


def test_the_thesis_rewards_come_about_with_its_switch(playgrounds):
    """A flight along a shortest path earns about the reward in the thesis: 11,435.5 on train-3."""
    env = flockstep.DroneVectorEnv(
        1, worlds=playgrounds[2], action="displacement", reward=flockstep.NavigationReward(carry_over_distance=True)
    )
    world = playgrounds[2]
    path = flockstep.plan(world, world.start, [*world.waypoints, world.goal])
    env.reset(seed=0)
    total, target = 0.0, 1
    for _ in range(1000):
        while target < len(path) - 1 and np.linalg.norm(path[target] - env.batch.position[0]) < 1e-3:
            target += 1
        offset = (path[target] - env.batch.position[0]) / 0.1
        action = offset / max(1.0, float(np.abs(offset).max()))
        _, reward, terminated, _, infos = env.step(action[None].astype(np.float32))
        total += float(reward[0])
        if terminated[0]:
            break
    assert infos["success"][0]
    assert 10_500 < total < 12_000


def test_a_task_in_python_has_the_same_episodes(room, closet, playgrounds, example, mode):
    """Frame skip, staggered time limits and random worlds belong to the engine, for tasks in any language."""
    lidar, config = flockstep.LidarConfig(), flockstep.NavigationConfig()
    arguments = {"worlds": [room, closet, *playgrounds], "lidar": lidar, "autoreset_mode": mode, "num_threads": 2}
    arguments |= {"max_episode_steps": 40, "frame_skip": 3, "stagger_first_episode": True, "random_world": True}
    engine, twin = both(32, config, example("navigation_numpy").Navigation(config, lidar), **arguments)
    rng = np.random.default_rng(1)
    lengths, worlds = set(), set()

    def actions_of(_):
        return np.where(rng.random(32) < 0.5, 0, rng.integers(6, size=32))

    for _, ended in fly_beside(engine, twin, actions_of, 120, atol=ATOL, rewards=CENTIMETRES):
        np.testing.assert_array_equal(engine.batch.world_index, twin.batch.world_index)
        np.testing.assert_array_equal(engine.batch.episode_length, twin.batch.episode_length)
        lengths |= set(engine.batch.episode_length[ended].tolist())
        worlds |= set(engine.batch.world_index.tolist())
    assert len(lengths) > 10
    assert len(worlds) == 7


def test_the_engines_terms_are_those_of_the_twin(room, playgrounds, example):
    task = example("navigation_numpy").Navigation(flockstep.NavigationConfig(), flockstep.LidarConfig())
    envs = begun(40, worlds=[room, *playgrounds], task=task)
    batch, rng = envs.batch, np.random.default_rng(2)
    for _ in range(60):
        envs.step(rng.integers(6, size=40))
        terms, index = batch.terms, task.goal_index
        np.testing.assert_allclose(terms.goal(index), task.goal(batch), rtol=1e-6)
        np.testing.assert_allclose(terms.goal_distance(index), task.distance(batch), rtol=1e-6)
        np.testing.assert_allclose(terms.goal_direction(index), task.direction(batch), atol=1e-6)
        ranges = task.ranges(batch)
        np.testing.assert_allclose(terms.ranges(), ranges, rtol=1e-6)
        np.testing.assert_allclose(terms.clearance(), ranges.min(axis=1), rtol=1e-6)
        displacement = rng.normal(size=(40, 3)).astype(np.float32)
        there = batch.position + rotate(batch.quat_wxyz, displacement)
        np.testing.assert_allclose(terms.displaced(displacement), there, atol=1e-6)
        free = (ranges / 0.2 - 1).sum(axis=1) / (35 / 0.2 - 35)
        np.testing.assert_allclose(terms.free_space(0.2), free, rtol=1e-5)
    np.testing.assert_allclose(terms.goal(), [world.goal for world in np.array(batch.worlds)[batch.world_index]])
    np.testing.assert_array_equal(terms.start(), [world.start for world in np.array(batch.worlds)[batch.world_index]])
    with refused(ValueError, "goal_index"):
        terms.goal(np.full(40, -1))
    with refused(ValueError, "LiDAR"):
        flockstep.Batch([room]).terms.clearance()
