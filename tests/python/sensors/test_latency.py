"""Latency and age of readings, against readings of the same flight without latency."""

import math

import numpy as np
import pytest
from conftest import world_of
from messages import refused

import flockstep
from flockstep import ImuConfig, LidarConfig, PoseSensorConfig

ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": [8, 8, 4]}, markers={"start": [4, 4, 2]})
TICKS = 10  # ticks of 2 ms in a step
NOISE = {"position_noise_std_m": 0.1, "orientation_noise_std_deg": 2.0}


def make(latency_s, rate_hz=None, **keywords):
    """Hovering drones with three sensors that are late by the same time."""
    late = {"latency_s": latency_s, "rate_hz": rate_hz}
    return flockstep.DroneVectorEnv(
        2,
        task=flockstep.HoverConfig(),
        worlds=ROOM,
        policy_hz=50,
        lidar=LidarConfig(beams=5, hfov_deg=200, max_range_m=9, **late),
        imu=ImuConfig(gyroscope_noise_density=0.01, gyroscope_random_walk=0.01, **late),
        pose_sensor=PoseSensorConfig(**NOISE, **late),
        max_episode_steps=9,
        autoreset_mode="same_step",
        **keywords,
    )


def readings(env):
    batch = env.batch
    arrays = batch.lidar().ranges, batch.sensed_position, batch.sensed_quat_wxyz, batch.accelerometer, batch.gyroscope
    return [array.copy() for array in arrays]


def ages(env):
    return [age.copy() for age in (env.batch.lidar().ranges_age_s, env.batch.sensed_age_s, env.batch.imu_age_s)]


def actions(steps):
    return np.float32(np.random.default_rng(0).uniform(-1, 1, (steps, 2, 4)))


@pytest.mark.parametrize("latency_s", [0.02, 0.03, 0.1])
@pytest.mark.parametrize("threads", [1, 2])
def test_readings_are_those_of_a_while_ago(latency_s, threads):
    exact, late = make(0), make(latency_s, num_threads=threads, block_size=1)
    for env in (exact, late):
        env.reset(seed=3)
    seen = [[part[row] for part in readings(exact)] for row in range(2)]
    seen = [[first] for first in seen]  # of each drone, since its episode began
    steps, begun = math.ceil(round(latency_s * 500) / TICKS), 0
    for action in actions(30):
        ended = exact.step(action)[3] | exact.batch.terminated
        late.step(action)
        now, published, age = readings(exact), readings(late), ages(late)
        for row in range(2):
            if ended[row]:
                seen[row], begun = [], begun + 1
            seen[row].append([part[row] for part in now])
            shown = max(len(seen[row]) - 1 - steps, 0)
            for ours, theirs in zip(published, seen[row][shown], strict=True):
                np.testing.assert_array_equal(ours[row], theirs)
            np.testing.assert_allclose([one[row] for one in age], (len(seen[row]) - 1 - shown) * 0.02, rtol=1e-6)
        for one in ages(exact):
            np.testing.assert_array_equal(one, 0)
    assert begun > 3


@pytest.mark.parametrize(("rate_hz", "latency_s"), [(125, 0), (125, 0.01), (500, 0.006), (500, 0.05), (25, 0.02)])
def test_readings_at_their_own_rate(rate_hz, latency_s):
    """A reading of every tick, without noise, tells which one has arrived."""
    config = PoseSensorConfig(rate_hz=rate_hz, latency_s=latency_s)
    env = flockstep.DroneVectorEnv(
        1, task=flockstep.HoverConfig(), worlds=ROOM, policy_hz=50, max_episode_steps=0, pose_sensor=config
    )
    path = flockstep.DroneVectorEnv(  # a step for each tick
        1, task=flockstep.HoverConfig(), worlds=ROOM, policy_hz=500, controller_hz=500, max_episode_steps=0
    )
    period, latency = 500 // rate_hz, round(latency_s * 500)
    for one in (env, path):
        one.reset(seed=3)
    true = [path.batch.position[0].copy()]
    for step in range(8):
        action = np.full((1, 4), 0.2 * (-1) ** step, np.float32)
        env.step(action)
        for _ in range(TICKS):
            path.step(action)
            true.append(path.batch.position[0].copy())
        now = len(true) - 1
        taken = max((tick for tick in range(0, now + 1, period) if tick + latency <= now), default=0)
        np.testing.assert_allclose(env.batch.sensed_age_s, (now - taken) * 0.002, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(env.batch.sensed_position[0], true[taken], atol=2e-6)


def test_a_restored_batch_has_its_late_readings():
    env, other = make(0.05), make(0.05, num_threads=2, block_size=1)
    for one in (env, other):
        one.reset(seed=1)
    for action in actions(6):
        env.step(action)
    snapshot = env.snapshot()
    expected = []
    for action in actions(12):
        env.step(action)
        expected.append([*readings(env), *ages(env)])
    for one in (env, other):
        one.restore(snapshot)
        for action, there in zip(actions(12), expected, strict=True):
            one.step(action)
            for ours, theirs in zip([*readings(one), *ages(one)], there, strict=True):
                np.testing.assert_array_equal(ours, theirs)


def test_drones_that_come_have_no_old_readings():
    batch = flockstep.Batch(ROOM, 1, lidar=LidarConfig(beams=3, latency_s=0.2))
    batch.sense()
    old = batch.lidar().ranges[0].copy()
    batch.spawn(position=[[2, 2, 1]])
    batch.sense()
    assert (batch.lidar().ranges[1] != old).any()
    np.testing.assert_array_equal(batch.lidar().ranges[0], old)
    batch.set_lidar(max_range_m=2.0)
    np.testing.assert_array_equal(batch.lidar().max_range_m, 2)
    batch.set_lidar(beams=7)
    batch.sense()
    assert np.isfinite(batch.lidar().ranges).sum() > 0


@pytest.mark.parametrize(
    ("config", "name"), [(LidarConfig, "lidar"), (ImuConfig, "imu"), (PoseSensorConfig, "pose_sensor")]
)
def test_bad_input(config, name):
    for bad in (-0.1, 1.01, math.nan):
        with refused(ValueError, f"{name}.latency_s", bad):
            config(latency_s=bad)
    with refused(TypeError, "latency_s"):
        flockstep.CameraConfig(latency_s=0.1)
