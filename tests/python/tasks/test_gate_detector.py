"""GateDetector: the corners that Race observes against NumPy, their errors, and the flyer that needs no policy."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused

import flockstep
from flockstep import GateDetector
from flockstep.rotations import quat_from_rpy, rotate
from flockstep.trainings import CHOOSING_SEEDS, TRAININGS, corners, judge

GATE = world_of(
    room={"min": [-30, -10, 0], "max": [30, 10, 10]},
    gates=[{"center": [x, 0, 5], "shape": shape, "solid": False} for x, shape in ((0, "square"), (6, "ring"))],
)
AHEAD = 2


def make(num_envs=1, worlds=GATE, task=None, **detector):
    race = flockstep.RaceConfig(start="gate", gate_detector=GateDetector(**detector), **(task or {}))
    return flockstep.DroneVectorEnv(num_envs, task=race, worlds=worlds, max_episode_steps=100)


def rays_of(observation):
    """The observed directions to corners, (N, gates, 4, 3)."""
    return observation[:, : 12 * AHEAD].reshape(-1, AHEAD, 4, 3)


def pixels_of(rays, detector):
    """Points in the image of directions (..., 3), body frame: px left and up of its middle; and their part ahead."""
    tilt = quat_from_rpy(np.radians([0, -detector.tilt_deg, 0]))
    points = rotate(tilt, rays.astype(float), inverse=True)
    focal = detector.width_px / 2 / np.tan(np.radians(detector.hfov_deg) / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return focal * points[..., 1:] / points[..., :1], points[..., 0]


def by_hand(batch, detector):
    """The exact directions to the corners of the next gates, body frame, 0 outside of the image."""
    seen = np.zeros((batch.num_drones, AHEAD, 4, 3))
    for drone in range(batch.num_drones):
        gates = batch.worlds[batch.world_index[drone]].gates
        for i in range(AHEAD):
            gate = gates[(batch.task_state["target"][drone] + i) % len(gates)]
            half = gate["size_m"] / (2 if gate["shape"] == "square" else 8**0.5)
            local = half * np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
            offset = gate["center"] + rotate(np.array(gate["quat_wxyz"], float), local) - batch.position[drone]
            seen[drone, i] = rotate(batch.quat_wxyz[drone].astype(float), offset, inverse=True)
    pixels, ahead = pixels_of(seen, detector)
    distance = np.linalg.norm(seen, axis=3)
    half = np.array([detector.width_px, detector.height_px]) / 2
    found = (ahead > 0) & (np.abs(pixels) <= half).all(axis=3) & (distance <= detector.max_range_m)
    return np.where(found[..., None], seen / distance[..., None], 0)


@pytest.mark.parametrize(
    "detector",
    [
        GateDetector(),
        GateDetector(width_px=300, height_px=500, hfov_deg=110, tilt_deg=30, max_range_m=7),
        GateDetector(hfov_deg=40, tilt_deg=-20),
    ],
)
def test_corners_without_errors_are_those_of_numpy(detector):
    fields = {name: getattr(detector, name) for name in detector.__match_args__}
    worlds = [GATE, *map(flockstep.World.load, ("race/figure-8", "race/split-s"))]
    envs = make(60, worlds, {"start_yaw_deg": 120, "start_tilt_deg": 40}, **fields)
    envs.reset(seed=0)
    rng, found, partial = np.random.default_rng(0), 0, 0
    for _ in range(40):
        observation = envs.step(rng.uniform(-1, 1, (60, 4)).astype(np.float32))[0]
        rays, expected = rays_of(observation), by_hand(envs.batch, detector)
        np.testing.assert_allclose(rays, expected, atol=2e-5)
        seen = np.abs(rays).max(axis=3) > 0
        found += seen.sum()
        partial += (seen.any(axis=2) & ~seen.all(axis=2)).sum()
    assert found > 500
    assert partial > 50


def hovering(num_envs, steps, **errors):
    """Errors of many images of the first gate, (steps, N, 4, 2) px, NaN if not found, by drones 3 m before it."""
    detector = GateDetector(hfov_deg=60, tilt_deg=5, **errors)
    envs = make(num_envs, hfov_deg=60, tilt_deg=5, **errors)
    envs.reset(seed=1)
    at, level, rows, images = np.array([-3.0, 0.3, 5.0]), np.array([1.0, 0, 0, 0]), np.arange(num_envs), []
    for _ in range(steps):
        envs.batch.set_pose(np.tile(at, (num_envs, 1)), np.tile(level, (num_envs, 1)))
        rays = rays_of(envs.step(np.zeros((num_envs, 4), np.float32))[0])
        first = envs.batch.task_state["target"]  # 0, or 1 and then the first gate is the one after it
        exact = by_hand(envs.batch, detector)
        assert np.abs(exact[rows, first]).max(axis=2).all()
        images.append((pixels_of(rays, detector)[0] - pixels_of(exact, detector)[0])[rows, first])
    return np.array(images)


def test_errors_have_their_size_and_share():
    error = hovering(400, 20, noise_std_px=2.5, dropout=0.1)
    is_found = ~np.isnan(error[..., 0])
    assert is_found.mean() == pytest.approx(0.9, abs=0.01)
    assert not is_found[:, 0].all()
    assert np.abs(np.nanmean(error, axis=(0, 1))).max() < 0.15
    np.testing.assert_allclose(np.nanstd(error, axis=(0, 1)), 2.5, rtol=0.05)
    flat = np.nan_to_num(error).reshape(20, 400, 8)
    assert np.abs(np.corrcoef(flat.reshape(-1, 8), rowvar=False) - np.eye(8)).max() < 0.05  # of corners and axes
    assert abs(np.corrcoef(flat[1:].ravel(), flat[:-1].ravel())[0, 1]) < 0.02  # of images
    assert abs(np.corrcoef(flat[:, 1:].ravel(), flat[:, :-1].ravel())[0, 1]) < 0.02  # of drones


def test_a_detector_may_find_nothing():
    assert np.isnan(hovering(3, 4, dropout=1.0)).all()


def test_only_the_estimate_and_the_imu_err_besides():
    exact, erring = (
        flockstep.DroneVectorEnv(
            20, task=flockstep.RaceConfig(gate_detector=GateDetector()), worlds=GATE, num_threads=1, **sensors
        )
        for sensors in (
            {},
            {
                "pose_sensor": flockstep.PoseSensorConfig(orientation_noise_std_deg=3, velocity_noise_std_mps=0.5),
                "imu": flockstep.ImuConfig(gyroscope_bias_std_radps=0.5),
            },
        )
    )
    truth, seen = exact.reset(seed=4)[0], erring.reset(seed=4)[0]
    np.testing.assert_array_equal(truth[:, :24], seen[:, :24])
    assert (truth[:, 24:33] != seen[:, 24:33]).all()
    np.testing.assert_allclose(seen[:, 30:33], 0.2 * erring.batch.gyroscope, rtol=1e-6)
    velocity = rotate(erring.batch.sensed_quat_wxyz, erring.batch.sensed_velocity, inverse=True)
    np.testing.assert_allclose(seen[:, 24:27], 0.2 * velocity, atol=1e-5)


@pytest.mark.parametrize("field", GateDetector.__match_args__)
def test_bad_fields_are_refused(field):
    is_whole = isinstance(getattr(GateDetector(), field), int)
    for value in (-100, 8193) if is_whole else (-100, 1e30, np.nan, np.inf):
        with refused(ValueError, f"task.gate_detector.{field}"):
            GateDetector(**{field: value})
    with refused(TypeError, field, "wide"):
        GateDetector(**{field: "wide"})


def test_other_values_are_refused():
    with refused(TypeError, "gate_detector", "flockstep.GateDetector or None"):
        flockstep.RaceConfig(gate_detector={"hfov_deg": 90})
    envs = flockstep.DroneVectorEnv(4, task=flockstep.RaceConfig(gate_detector=GateDetector()), worlds=GATE)
    with refused(ValueError, "task.gate_detector", "GateDetector"):
        flockstep.APG("MlpPolicy", envs, seed=0)


def test_squares_are_located_by_their_corners():
    rng = np.random.default_rng(2)
    local = 0.75 * np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
    quat = quat_from_rpy(rng.uniform(-0.7, 0.7, (50, 3)))
    offset = rng.uniform((2, -3, -2), (9, 3, 2), (50, 3))
    points = offset[:, None] + rotate(quat[:, None], local)
    rays = points / np.linalg.norm(points, axis=2, keepdims=True)
    found, normal, valid = corners.located(rays, np.full(50, 1.5))
    assert valid.all()
    np.testing.assert_allclose(found, offset, atol=1e-6)
    np.testing.assert_allclose(normal, rotate(quat, np.array([1.0, 0, 0])), atol=1e-6)


def test_a_controller_flies_by_corners():
    training = TRAININGS["race_by_corners"]
    verdict = judge(training, training.baselines["controller"][1], 20, CHOOSING_SEEDS.start)
    assert verdict.success >= 0.3  # of flights by the exact pose nearly all succeed
    assert verdict.more["lap_s"] < 16
