"""Scans that take time: each column from the pose that the drone had then, against a room in closed form."""

import math

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from scipy.spatial.transform import Rotation, Slerp

import flockstep
from flockstep import LidarConfig, RangeErrors

SIZE = np.array([8, 8, 4])
ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": SIZE.tolist()}, markers={"start": [4, 4, 2]})
MOUNT = {"offset_m": [0.2, -0.1, 0.05], "quat_wxyz": [0.96, 0, 0.28, 0]}
GRID = {"channels": 3, "beams": 20, "hfov_deg": 360, "vfov_deg": 50, "max_range_m": 20}
STEP_S = 0.02


def make(tracer="auto", seed=3, **fields):
    """Drones that tumble, with a LiDAR whose scans take time."""
    env = flockstep.DroneVectorEnv(
        3,
        task=flockstep.HoverConfig(),
        worlds=ROOM,
        tracer=tracer,
        policy_hz=1 / STEP_S,
        lidar=LidarConfig(**{**GRID, **MOUNT, **fields}),
        max_episode_steps=6,
        autoreset_mode="same_step",
    )
    env.reset(seed=seed)
    return env


def actions(steps):
    return np.float32(np.random.default_rng(1).uniform(-1, 1, (steps, 3, 4)))


def poses(env):
    return env.batch.position.astype(float), Rotation.from_quat(env.batch.quat_wxyz, scalar_first=True)


def in_room(origin, direction):
    """Return the distance to the wall that a ray from inside hits."""
    with np.errstate(divide="ignore"):
        return np.where(direction > 0, (SIZE - origin) / direction, -origin / direction).min()


def expected(env, drone, before, now, scan_time_s):
    """Return the ranges of a scan that ends now; before: None if the drone has not moved."""
    beams = env.batch.lidar().directions[drone].astype(float)
    channels, columns = beams.shape[:2]
    ranges = np.empty((channels, columns))
    for column in range(columns):
        age = scan_time_s * (1 - (column + 1) / columns)
        share = 0.0 if before is None else min(age / STEP_S, 1.0)
        start = now if before is None else before
        position = now[0][drone] + share * (start[0][drone] - now[0][drone])
        rotation = Slerp([0, 1], Rotation.concatenate([now[1][drone], start[1][drone]]))(share)
        origin = position + rotation.apply(MOUNT["offset_m"])
        for channel in range(channels):
            ranges[channel, column] = in_room(origin, rotation.apply(beams[channel, column]))
    return ranges


@pytest.mark.parametrize("scan_time_s", [0.01, 0.02, 0.05])
def test_columns_are_traced_from_the_pose_of_their_time(scan_time_s):
    env, moved = make(scan_time_s=scan_time_s), 0.0
    at_once = make()
    before = None
    for step, action in enumerate([None, *actions(8)]):
        if action is not None:
            _, _, terminated, truncated, _ = env.step(action)
            at_once.step(action)
            ended = terminated | truncated
            assert ended.all() == (step == 6)
            before = None if ended.all() else before
        now = poses(env)
        ranges = env.batch.lidar().ranges.copy()
        for drone in range(env.num_envs):
            truth = expected(env, drone, before, now, scan_time_s)
            np.testing.assert_allclose(ranges[drone], truth, rtol=2e-5, atol=2e-5)
        np.testing.assert_allclose(ranges[..., -1], at_once.batch.lidar().ranges[..., -1], rtol=1e-5)
        moved = max(moved, np.abs(ranges - at_once.batch.lidar().ranges).max())
        env.batch.sense()  # a second reading repeats the first
        np.testing.assert_array_equal(env.batch.lidar().ranges, ranges)
        before = now
    assert moved > 0.01


def test_a_drone_that_was_placed_has_not_moved():
    env, at_once = make(scan_time_s=0.02), make()
    for each in (env, at_once):
        each.step(actions(1)[0])
        each.batch.set_pose([[2, 3, 1]] * 3)
        each.batch.sense()
    np.testing.assert_allclose(env.batch.lidar().ranges, at_once.batch.lidar().ranges, rtol=1e-5)


@pytest.mark.parametrize("tracer", ["auto", "embree"])
def test_outputs_and_errors_go_with_the_columns(tracer):
    fields = {"outputs": ["intensity", "instance"], "scan_time_s": 0.02}
    errors = RangeErrors(divergence_mrad=1, min_intensity=0.02)
    envs = [make(tracer, **fields), make(tracer, **fields, errors=errors)]
    for action in actions(4):
        for env in envs:
            env.step(action)
        exact, erring = (env.batch.lidar() for env in envs)
        assert (exact.instance == 1).all()
        weak = exact.intensity < np.float32(0.02)
        assert 0.01 < weak.mean() < 0.99
        np.testing.assert_array_equal(np.isinf(erring.ranges), weak)
        # No range is mixed: a room has no edges.
        np.testing.assert_allclose(erring.ranges[~weak], exact.ranges[~weak], rtol=1e-6)


def test_snapshots_and_threads():
    fields = {"scan_time_s": 0.02, "latency_s": 0.004}
    env, other = make(**fields), make(seed=9, **fields)
    env.step(actions(1)[0])
    blob = env.batch.snapshot()
    found = []
    for each in (env, other):
        if each is other:
            each.batch.restore(blob)
        for action in actions(4):
            each.step(action)
        found.append(each.batch.lidar().ranges.copy())
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("value", [-0.1, 1.1, math.nan, math.inf])
def test_bad_times_are_refused(value):
    with refused(ValueError, "lidar.scan_time_s"):
        LidarConfig(scan_time_s=value)
