"""Scans that take time: each column from the pose that the drone had then, against a room in closed form."""

import math

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation, Slerp

import flockstep
from flockstep import LidarConfig, RangeErrors

SIZE = np.array([8, 8, 4])
ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": SIZE.tolist()}, markers={"start": [4, 4, 2]})
MOUNT = {"offset_m": [0.2, -0.1, 0.05], "quat_wxyz": [0.96, 0, 0.28, 0]}
GRID = {"channels": 3, "beams": 20, "hfov_deg": 360, "vfov_deg": 50, "max_range_m": 20}
STEP_S = 0.02


def make(tracer="auto", seed=3, worlds=ROOM, **fields):
    """Drones that tumble, with a LiDAR whose scans take time."""
    env = flockstep.DroneVectorEnv(
        3,
        task=flockstep.HoverConfig(),
        worlds=worlds,
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
    """Return the distance to the wall that a ray from inside hits, and the cosine of the angle to its normal."""
    with np.errstate(divide="ignore"):
        distances = np.where(direction > 0, (SIZE - origin) / direction, -origin / direction)
    axis = distances.argmin()
    return distances[axis], abs(direction[axis])


def expected(env, drone, before, now, scan_time_s):
    """Return ranges and cosines of a scan that ends now; before: None if the drone has not moved."""
    beams = env.batch.lidar().directions[drone].astype(float)
    channels, columns = beams.shape[:2]
    hits = np.empty((2, channels, columns))
    for column in range(columns):
        age = scan_time_s * (1 - (column + 1) / columns)
        share = 0.0 if before is None else min(age / STEP_S, 1.0)
        start = now if before is None else before
        position = now[0][drone] + share * (start[0][drone] - now[0][drone])
        rotation = Slerp([0, 1], Rotation.concatenate([now[1][drone], start[1][drone]]))(share)
        origin = position + rotation.apply(MOUNT["offset_m"])
        for channel in range(channels):
            hits[:, channel, column] = in_room(origin, rotation.apply(beams[channel, column]))
    return hits


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
            truth, _ = expected(env, drone, before, now, scan_time_s)
            np.testing.assert_allclose(ranges[drone], truth, rtol=2e-5, atol=2e-5)
        np.testing.assert_allclose(ranges[..., -1], at_once.batch.lidar().ranges[..., -1], rtol=1e-5)
        moved = max(moved, np.abs(ranges - at_once.batch.lidar().ranges).max())
        env.batch.sense()  # a second reading repeats the first
        np.testing.assert_array_equal(env.batch.lidar().ranges, ranges)
        before = now
    assert moved > 0.01


def test_columns_of_turned_beams_are_traced_from_the_pose_of_their_time():
    """In a room that is a mesh, whose intensities are read by the rotation of the beams."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * SIZE
    walls = {"vertices": corners.tolist(), "triangles": ConvexHull(corners).simplices.tolist(), "material": "grey"}
    materials = {"grey": {"base_color": [0.2, 0.4, 0.6]}}
    room = world_of(name="mesh room", materials=materials, meshes=[walls], markers={"start": [4, 4, 2]})
    waves = {"waves": 2.5, "turn_deg": 137.5, "outputs": ["intensity"]}
    env, before, turns = make(worlds=room, scan_time_s=0.02, **waves), None, set()
    for action in [None, *actions(4)]:
        if action is not None:
            env.step(action)
        now, lidar = poses(env), env.batch.lidar()
        for drone in range(env.num_envs):
            ranges, cosines = expected(env, drone, before, now, 0.02)
            np.testing.assert_allclose(lidar.ranges[drone], ranges, rtol=2e-5, atol=2e-5)
            intensity = 0.4 * cosines / np.maximum(ranges, 1) ** 2
            assert np.isclose(lidar.intensity[drone], intensity, rtol=1e-3, atol=1e-5).mean() > 0.99
        before = now
        turns.add(float(lidar.turn_deg[0]))
    assert len(turns) == 5


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
