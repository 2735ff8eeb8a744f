"""The same bits for any number of envs, threads, block size and autoreset mode."""

import numpy as np
import pytest

import flockstep

OUTPUTS = (
    "observation",
    "final_observation",
    "reward",
    "terminated",
    "truncated",
    "reward_terms",
    "success",
    "crashed",
    "episode_end",
)
OUTPUTS += ("episode_return", "episode_length", "position", "quat_wxyz", "world_index", "goal_index", "ranges")
STEPS = 60


def actions_of(num_drones, kind="displacement_yaw"):
    """(STEPS, N, k) actions with columns that do not depend on N."""
    if kind == "discrete":
        return np.stack([np.random.default_rng([7, i]).integers(6, size=STEPS) for i in range(num_drones)], axis=1)
    rows = [np.random.default_rng([7, i]).uniform(-1, 1, (STEPS, 4)) for i in range(num_drones)]
    return np.stack(rows, axis=1).astype(np.float32)


def outputs(batch):
    """Copies of all outputs; final observations are zeroed except after an end."""
    own = {"goal_index": batch.task_state["goal_index"], "ranges": batch.lidar().ranges}
    copies = {name: (own[name] if name in own else getattr(batch, name)).copy() for name in OUTPUTS}
    copies["final_observation"][~(batch.terminated | batch.truncated)] = 0
    return copies


def history(worlds, num_drones, kind="displacement_yaw", **arguments):
    """Every output of every step, (STEPS + 1, N, ...)."""
    task = flockstep.NavigationConfig(action=kind, random_start=True)
    mode = arguments.pop("autoreset_mode", "same_step")
    episode = flockstep.EpisodeConfig(
        autoreset_mode=mode, max_episode_steps=25, random_world=True, stagger_first_episode=True
    )
    noise = flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=0.5)
    arguments = {"num_threads": 1, **arguments}
    batch = flockstep.Batch(
        worlds, num_drones, lidar=flockstep.LidarConfig(), pose_sensor=noise, task=task, episode=episode, **arguments
    )
    batch.reset(np.arange(num_drones) + 1000)
    rows = [outputs(batch)]
    for actions in actions_of(num_drones, kind):
        batch.step(actions)
        rows.append(outputs(batch))
    return {name: np.stack([row[name] for row in rows]) for name in OUTPUTS}


@pytest.fixture(scope="module")
def worlds(room, closet, playgrounds):
    return [room, closet, *playgrounds]


@pytest.fixture(scope="module", params=["discrete", "displacement_yaw"])
def wide(request, worlds):
    run = history(worlds, 1024, request.param)
    assert (run["terminated"] | run["truncated"]).sum() > 1000
    assert run["crashed"].sum() > 40
    assert len(np.unique(run["world_index"])) == 7
    return request.param, run


@pytest.mark.parametrize("num_drones", [1, 16, 100])
def test_env_i_of_few_is_env_i_of_many(wide, worlds, num_drones):
    kind, many = wide
    few = history(worlds, num_drones, kind)
    np.testing.assert_equal(few, {name: many[name][:, :num_drones] for name in OUTPUTS})


@pytest.mark.parametrize("arguments", [{"num_threads": 8}, {"block_size": 1}, {"block_size": 7, "num_threads": 3}])
def test_threads_and_blocks_do_not_matter(wide, worlds, arguments):
    kind, run = wide
    np.testing.assert_equal(history(worlds, 1024, kind, **arguments), run)


def episodes(env, num_envs, action_of):
    """For each env, the results of each step of each episode, with actions as a function of (env, episode, step)."""
    mode = env.metadata["autoreset_mode"].value
    observation, _ = env.reset(seed=3)
    rows = [[] for _ in range(num_envs)]
    episode, step = np.zeros(num_envs, int), np.zeros(num_envs, int)
    starts = [[observation[i]] for i in range(num_envs)]
    ended = np.zeros(num_envs, bool)
    for _ in range(80):
        actions = np.array([action_of(i, episode[i], step[i]) for i in range(num_envs)])
        waiting = ended if mode == "NextStep" else np.zeros(num_envs, bool)
        observation, reward, terminated, truncated, infos = env.step(actions)
        ended = terminated | truncated
        for i in range(num_envs):
            if waiting[i]:
                starts[i].append(observation[i])
                continue
            last = infos["final_obs"][i] if mode == "SameStep" and ended[i] else observation[i]
            rows[i].append((last, reward[i], terminated[i], truncated[i]))
            step[i] += 1
            if ended[i]:
                episode[i] += 1
                step[i] = 0
                if mode == "SameStep":
                    starts[i].append(observation[i])
        if mode == "Disabled" and ended.any():
            observation, _ = env.reset(options={"reset_mask": ended})
            for i in np.flatnonzero(ended):
                starts[i].append(observation[i])
            ended = np.zeros(num_envs, bool)
    return starts, rows


@pytest.mark.parametrize("own_task", [False, True])
def test_autoreset_modes_agree_except_in_reset_rows(room, closet, example, own_task):
    def run(mode):
        lidar = flockstep.LidarConfig()
        noise = flockstep.PoseSensorConfig(position_noise_std_m=0.01)
        arguments = {"worlds": [room, closet], "lidar": lidar, "pose_sensor": noise, "autoreset_mode": mode}
        if own_task:
            twin = example("navigation_numpy").Navigation(flockstep.NavigationConfig(), lidar)
            env = flockstep.DroneVectorEnv(6, task=twin, max_episode_steps=15, random_world=True, **arguments)
        else:
            env = flockstep.DroneVectorEnv(6, max_episode_steps=15, random_start=True, random_world=True, **arguments)
        return episodes(env, 6, lambda i, e, s: np.random.default_rng([i, e, s]).integers(6))

    first_starts, first_rows = run("next_step")
    assert min(len(starts) for starts in first_starts) > 3
    for mode in ("same_step", "disabled"):
        starts, rows = run(mode)
        for i in range(6):
            for a, b in zip(first_starts[i], starts[i], strict=False):
                np.testing.assert_array_equal(a, b)
            for (obs_a, *rest_a), (obs_b, *rest_b) in zip(first_rows[i], rows[i], strict=False):
                np.testing.assert_array_equal(obs_a, obs_b)
                assert rest_a == rest_b


def test_restored_equals_uninterrupted(worlds):
    task = flockstep.NavigationConfig(random_start=True)
    episode = flockstep.EpisodeConfig(max_episode_steps=25, random_world=True)
    arguments = {"lidar": flockstep.LidarConfig(), "task": task, "episode": episode, "num_threads": 2}
    noise = flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=0.5)
    one = flockstep.Batch(worlds, 64, pose_sensor=noise, **arguments)
    one.reset(np.arange(64))
    actions = actions_of(64, "discrete")
    for a in actions[:30]:
        one.step(a)
    other = flockstep.Batch(worlds, 64, pose_sensor=noise, **arguments)
    other.restore(one.snapshot())
    for a in actions[30:]:
        np.testing.assert_equal(outputs(one), outputs(other))
        one.step(a)
        other.step(a)
