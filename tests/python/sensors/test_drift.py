"""Errors that last from reading to reading, against twins in NumPy with the same random numbers."""

import math

import numpy as np
from conftest import flat_batch, world_of
from philox import named_stream, philox, uniform

import flockstep
from flockstep.rotations import rotate

HALL = world_of(room={"min": [-50, -50, 0], "max": [50, 50, 50]})
STEP_S = 0.1
SEEDS = (3, 2**40 + 7)


def normals(seed, episode, stream, index, count):
    """Standard normal numbers of a reading, two from each draw (Box and Muller)."""
    numbers = []
    for k in range(count // 2):
        words = philox([count // 2 * index + k, stream, episode, 0], [seed & 0xFFFFFFFF, seed >> 32])
        radius, angle = math.sqrt(-2 * math.log((words[0] + 1) / 2**32)), 2 * math.pi * words[1] / 2**32
        numbers += [radius * math.cos(angle), radius * math.sin(angle)]
    return np.array(numbers)


def moments_of(**sensors):
    """Fly two episodes of 20 readings, and yield the batch, the episode and the number of the reading."""
    batch = flat_batch([HALL], len(SEEDS), policy_hz=1 / STEP_S, **sensors)
    batch.seed(SEEDS)
    rng = np.random.default_rng(0)
    for episode in range(2):
        if episode:
            batch.begin_episode()
        for reading in range(20):
            if reading:
                batch.move(rng.uniform(1, 9, (len(SEEDS), 3)), np.tile([0.5, 0.5, -0.5, 0.5], (len(SEEDS), 1)))
            batch.sense()
            yield batch, episode, reading


def test_pose_estimates():
    sensor = flockstep.PoseSensorConfig(position_random_walk=0.3, yaw_random_walk=5, drift_std_m=0.4, drift_time_s=2)
    keep = math.exp(-STEP_S / 2)
    gain = np.array(
        [0.3 * math.sqrt(STEP_S)] * 3 + [0.4 * math.sqrt(1 - keep**2)] * 3 + [math.radians(5) * STEP_S**0.5]
    )
    drift = np.zeros((len(SEEDS), 7))
    for batch, episode, reading in moments_of(pose_sensor=sensor):
        for env, seed in enumerate(SEEDS):
            if reading == 0:
                drift[env] = 0
            else:
                numbers = normals(seed, episode, named_stream("pose estimate"), reading, 10)[:7]
                drift[env] = drift[env] * [1, 1, 1, keep, keep, keep, 1] + gain * numbers
            expected = batch.position[env] + drift[env, :3] + drift[env, 3:6]
            np.testing.assert_allclose(batch.sensed_position[env], expected, atol=1e-5)
            yaw = drift[env, 6]
            turned = rotate(batch.quat_wxyz[env].astype(float), np.eye(3))
            level = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
            np.testing.assert_allclose(rotate(batch.sensed_quat_wxyz[env], np.eye(3)), turned @ level.T, atol=1e-5)


def test_outages():
    receiver = flockstep.GpsReceiverConfig(outages_per_s=2, outage_s=0.3)
    fixes = []
    for batch, episode, reading in moments_of(gps_receiver=receiver):
        for env, seed in enumerate(SEEDS):
            tick = changes = 0
            while True:
                mean_s = 0.3 if changes % 2 else 0.5
                left = 1 - uniform(seed, episode, named_stream("gps outages"), changes)
                tick += max(math.ceil(-mean_s * math.log(left) / STEP_S), 1)
                if tick > reading:
                    break
                changes += 1
            assert batch.gps_fix[env] == (changes % 2 == 0)
            fixes.append(changes % 2 == 0)
            if changes % 2 == 0:
                np.testing.assert_array_equal(batch.gps_position[env], batch.position[env])
    assert 5 < sum(fixes) < len(fixes) - 5
