"""LiDARs whose beams lie along waves and turn from reading to reading, against a NumPy twin of their directions."""

import itertools
import math
import pickle

import numpy as np
import pytest
from conftest import placed, world_of
from messages import refused
from scipy.spatial.transform import Rotation
from test_lidar_outputs import MOUNT, OUTPUTS, along, scanned

import flockstep
from flockstep import LidarConfig, RangeErrors
from flockstep.bridges import BatchSource

SIZE = np.array([8, 8, 4])
ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": SIZE.tolist()}, markers={"start": [4, 4, 2]})
TURN_DEG = 137.50776
ROSETTE = {"channels": 4, "beams": 150, "hfov_deg": 360, "vfov_deg": 59, "vfov_center_deg": 22.5, "waves": 5.5}
BEAMS = {
    "rosette": ROSETTE,
    "line": {"beams": 60, "hfov_deg": 200, "vfov_deg": 80, "waves": 2.5},
    "views": {"channels": 16, "beams": 24, "hfov_deg": 90, "vfov_deg": 40},
    "fan": {"beams": 90, "hfov_deg": 300},
    "flat": {"beams": 90, "hfov_deg": 300, "waves": 3},
    "column": {"channels": 70, "beams": 1, "vfov_deg": 100, "waves": 1},
    "pattern": {"azimuth_deg": [-170, -20, 0, 5, 90], "elevation_deg": [30, -80, 0, 2, -5]},
}


def rotation(quat_wxyz):
    return Rotation.from_quat(quat_wxyz, scalar_first=True)


def rotated(by, vectors):
    return by.apply(np.reshape(vectors, (-1, 3))).reshape(np.shape(vectors))


def twin(config, turn_deg):
    """Return the directions (channels, beams, 3) of a LiDAR's beams in its own frame, by the words of its fields."""
    channel, beam = np.mgrid[: config.shape[0], : config.shape[1]]
    if config.azimuth_deg:
        azimuth, elevation = np.array([config.azimuth_deg]), np.array([config.elevation_deg])
    else:
        intervals = config.beams - (config.hfov_deg < 360)
        azimuth = config.hfov_deg * (beam / intervals - 0.5) if config.beams > 1 else np.zeros(beam.shape)
        if config.waves:
            phase = config.waves * beam / config.beams + channel / config.channels
            elevation = config.vfov_center_deg + config.vfov_deg / 2 * np.sin(2 * np.pi * phase)
        else:
            step = config.vfov_deg / max(config.channels - 1, 1)
            elevation = config.vfov_center_deg + step * (channel - (config.channels - 1) / 2)
    azimuth, elevation = np.radians(azimuth + turn_deg), np.radians(elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def turn_of(config, reading):
    return math.fmod(reading * config.turn_deg, 360)


def in_room(origin, direction):
    """Return the distances (...) to the walls that rays from inside hit."""
    along_axes = np.where(direction == 0, 1e-300, direction)
    return ((np.where(direction > 0, SIZE, 0) - origin) / along_axes).min(axis=-1)


@pytest.mark.parametrize("fields", BEAMS.values(), ids=BEAMS)
def test_directions_ranges_and_points_are_those_of_the_twin(fields):
    config = LidarConfig(**fields, **MOUNT, turn_deg=TURN_DEG, max_range_m=20)
    position = np.random.default_rng(2).uniform([2, 2, 1], [6, 6, 3], (4, 3))
    quat = Rotation.random(4, random_state=1).as_quat(scalar_first=True)
    batch = placed(ROOM, position, quat, drones_per_env=2, lidar=config)
    view = {} if "azimuth_deg" in fields else {"hfov_deg": 77, "vfov_deg": 30}
    batch.set_lidar([False, False, True, False], quat_wxyz=[0.6, 0, 0, 0.8], offset_m=[0, 0.1, 0.2], **view)
    for reading in (0, 1, 2, 0, 1):
        if reading == 0:
            batch.begin_episode()
            batch.set_pose(position, quat)
        batch.sense()
        turn_deg, lidar = turn_of(config, reading), batch.lidar()
        np.testing.assert_array_equal(lidar.turn_deg, np.full(4, turn_deg, np.float32))
        for drone in range(4):
            own, body = lidar.config_of(drone), rotation(batch.quat_wxyz[drone])
            directions = rotated(rotation(own.quat_wxyz), twin(own, turn_deg))
            np.testing.assert_allclose(lidar.directions[drone], directions, atol=1e-6)
            origin, in_world = batch.position[drone] + body.apply(own.offset_m), rotated(body, directions)
            ranges = in_room(origin, in_world)
            np.testing.assert_allclose(lidar.ranges[drone], ranges, rtol=3e-5)
            np.testing.assert_allclose(lidar.points[drone], origin + ranges[..., None] * in_world, atol=1e-4)


def test_points_of_bridges_are_in_the_frame_of_the_lidar_which_does_not_turn():
    batch = placed(
        ROOM, [[3, 3, 2], [4, 3, 2]], lidar=LidarConfig(**ROSETTE, **MOUNT, turn_deg=TURN_DEG, max_range_m=5)
    )
    source = BatchSource(batch, [0, 1])
    for _ in range(3):
        batch.sense()
        for drone in range(2):
            points = batch.lidar().points[drone] - batch.position[drone] - np.float32(MOUNT["offset_m"])
            hits = points[np.isfinite(batch.lidar().ranges[drone])]
            expected = rotation(MOUNT["quat_wxyz"]).inv().apply(hits)
            np.testing.assert_allclose(source.points("lidar", drone), expected, atol=1e-5)


@pytest.mark.parametrize("tracer", ["auto", "slices", "tiles", "embree"])
def test_hits_are_those_of_beams_that_are_listed(tracer):
    """By LiDARs that list the turned directions of one reading each, in a world of all kinds of surfaces."""
    lidars = [
        LidarConfig(name=name, **fields, **MOUNT, turn_deg=TURN_DEG, max_range_m=50, outputs=OUTPUTS)
        for name, fields in BEAMS.items()
    ]
    readings = (1, 2)
    listed = [
        along(twin(lidar, turn_of(lidar, reading)), name=f"{lidar.name}-{reading}", **MOUNT)
        for lidar, reading in itertools.product(lidars, readings)
    ]
    batch = scanned([*lidars, *listed], tracer=tracer)
    for reading in readings:
        batch.sense()
        for name in BEAMS:
            one, other = batch.lidar(name), batch.lidar(f"{name}-{reading}")
            same = one.instance.reshape(12, -1) == other.instance[:, 0]
            assert same.mean() > 0.98  # all but some at silhouettes
            for array in ("ranges", *OUTPUTS):
                got, expected = getattr(one, array).reshape(12, -1)[same], getattr(other, array)[:, 0][same]
                assert np.isclose(got, expected, rtol=1e-3, atol=1e-4).mean() > 0.99, (name, array)


@pytest.mark.parametrize("tracer", ["auto", "embree"])
def test_the_edges_of_beams_turn_with_them(tracer):
    """Only the second reading looks at the edge of a wall, with another one behind it."""
    walls = [{"center": [5, 25, 0], "size": [2, 50, 50]}, {"center": [7, -25, 0], "size": [2, 50, 50]}]
    azimuth = np.random.default_rng(2).uniform(-0.02, 0.02, 20_000)
    beams = {"azimuth_deg": np.degrees(azimuth) - 90, "elevation_deg": np.zeros(20_000)}
    lidar = LidarConfig(**beams, turn_deg=90, max_range_m=20, errors=RangeErrors(divergence_mrad=20))
    batch = placed(world_of(name="edge", boxes=walls), [[0, 0, 0]], lidar=lidar, tracer=tracer)
    batch.sense()
    batch.sense()
    ranges = batch.lidar().ranges[0, 0]
    is_mixed = np.abs(ranges - np.where(azimuth > 0, 4, 6) / np.cos(azimuth)) > 1e-4
    inside = np.abs(azimuth) < 0.01
    assert not is_mixed[~inside].any()
    # The other side of the edge is |cos t| / 2 of all directions t, 1 / pi on average.
    assert abs(is_mixed[inside].mean() - 1 / math.pi) < 3 * math.sqrt(0.22 / inside.sum())
    assert 3.99 < ranges[is_mixed].min() < ranges[is_mixed].max() < 6.01


LATE = {"latency_s": 0.05, "jitter_s": 0.05, "loss": 0.3}


@pytest.mark.parametrize("late", [{"latency_s": 0.05}, {"rate_hz": 25}, {"rate_hz": 25, **LATE}], ids=str)
def test_a_late_reading_has_its_own_turn(late):
    config = LidarConfig(name="late", **ROSETTE, turn_deg=TURN_DEG, max_range_m=20, **late)
    prompt = LidarConfig(name="prompt", **ROSETTE, turn_deg=TURN_DEG, max_range_m=20, rate_hz=config.rate_hz)
    env = flockstep.DroneVectorEnv(
        2,
        task=flockstep.HoverConfig(),
        worlds=ROOM,
        policy_hz=50,
        lidar=[config, prompt],
        max_episode_steps=9,
        autoreset_mode="same_step",
    )
    env.reset(seed=3)
    period = 500 // config.rate_hz if config.rate_hz else 10  # ticks between two readings
    batch, read, shown = env.batch, {}, set()
    for action in [None, *np.random.default_rng(0).uniform(-1, 1, (30, 2, 4)).astype(np.float32)]:
        if action is not None:
            env.step(action)
        for drone in range(2):
            tick, episode, lidar = int(batch.tick[drone]), int(batch.episode[drone]), batch.lidar("late")
            if tick % period == 0:
                read[drone, episode, tick] = batch.lidar("prompt").ranges[drone].copy()
            taken = tick - round(lidar.ranges_age_s[drone] / 0.002)
            turn_deg = turn_of(config, taken // period)
            assert lidar.turn_deg[drone] == np.float32(turn_deg)
            np.testing.assert_array_equal(lidar.ranges[drone], read[drone, episode, taken])
            np.testing.assert_allclose(lidar.directions[drone], twin(config, turn_deg), atol=1e-6)
            shown.add((episode, taken))
    assert len(shown) > 6
    assert {taken for _, taken in shown} >= {0, period}


def test_scans_cover_more_and_more():
    turning = LidarConfig.preset("mid-360")
    turning.errors = RangeErrors()
    still = pickle.loads(pickle.dumps(turning))
    still.name, still.turn_deg = "still", 0
    batch = placed(ROOM, [[4, 3.9, 2.1]], lidars=[turning, still])

    def cells(directions):
        """The numbers of the cells of equal solid angle, a degree wide, that rays pass through."""
        x, y, z = np.reshape(directions / np.linalg.norm(directions, axis=-1, keepdims=True), (-1, 3)).T
        column = (np.degrees(np.arctan2(y, x)) + 0.3001) % 360 // 1
        return set((1000 * column + z // 0.01).tolist())

    bottom, top = (math.sin(math.radians(elevation)) // 0.01 for elevation in (-7, 52))
    count = 360 * (top - bottom + 1)
    covered, expected, unturned, shares = set(), set(), set(), []
    for reading in range(12):
        batch.sense()
        covered |= cells(batch.lidar("mid-360").points[0] - batch.position[0])
        unturned |= cells(batch.lidar("still").points[0] - batch.position[0])
        expected |= cells(twin(turning, turn_of(turning, reading)))
        assert len(covered ^ expected) < 0.01 * len(expected)  # rays on the boundary of two cells
        shares.append(len(covered) / count)
        if reading == 0:
            np.testing.assert_array_equal(batch.lidar("mid-360").ranges, batch.lidar("still").ranges)
    assert len(unturned) / count == pytest.approx(shares[0], abs=0.01)
    assert (np.diff(shares[:4]) > 0.03).all()
    assert shares[0] < 0.6
    assert shares[-1] > 0.95


def readings(lidar):
    return [getattr(lidar, name).copy() for name in ("turn_deg", "ranges", "directions", "points", *OUTPUTS)]


def flown(batch, steps=5):
    found = readings(batch.lidar())
    for step in range(steps):
        batch.step((np.arange(3) + step) % 6)
        found += readings(batch.lidar())
    return found


def navigators(**keywords):
    errors = RangeErrors(divergence_mrad=20, dropout=0.1, min_intensity=0.01)
    late = keywords.pop("late", {})
    lidar = LidarConfig(**ROSETTE, **MOUNT, **late, turn_deg=TURN_DEG, max_range_m=20, outputs=OUTPUTS, errors=errors)
    return flockstep.DroneVectorEnv(3, worlds="train", lidar=lidar, **keywords)


@pytest.mark.parametrize("late", [{}, LATE, {"scan_time_s": 0.1}], ids=str)
def test_a_snapshot_continues_with_the_same_turns(late):
    env, other = (navigators(late=late) for _ in range(2))
    env.reset(seed=3)
    env.step(np.arange(3))
    blob = env.batch.snapshot()
    expected = flown(env.batch)
    other.batch.restore(blob)
    for got, array in zip(flown(other.batch), expected, strict=True):
        np.testing.assert_array_equal(got, array)
    assert len({float(turn_deg[0]) for turn_deg in expected[::7]}) > 2


def test_bits_do_not_depend_on_threads_and_blocks():
    found = []
    for keywords in ({"num_threads": 1}, {"num_threads": 3, "block_size": 1}, {"num_threads": 2, "block_size": 2}):
        env = navigators(**keywords)
        env.reset(seed=3)
        found.append(flown(env.batch))
    for other in found[1:]:
        for got, expected in zip(other, found[0], strict=True):
            np.testing.assert_array_equal(got, expected)


def test_growth_and_removal_keep_the_turns_of_the_others():
    config = LidarConfig(**ROSETTE, turn_deg=TURN_DEG, max_range_m=20)
    batch = placed(ROOM, [[2, 2, 2], [4, 4, 2]], lidar=config)
    batch.sense()
    batch.sense()
    before = batch.lidar().ranges.copy()
    batch.spawn([2], [[5, 5, 1]])
    first, second = (np.float32(turn_of(config, reading)) for reading in (1, 2))
    assert batch.lidar().turn_deg.tolist() == [first, first, 0]
    np.testing.assert_array_equal(batch.lidar().ranges[:2], before)
    batch.sense()
    assert batch.lidar().turn_deg.tolist() == [second, second, first]
    batch.remove([1])
    assert batch.lidar().turn_deg.tolist() == [second, 0, first]
    batch.set_lidar(beams=21, channels=2)
    batch.sense()
    for drone, reading in ((0, 3), (2, 2)):
        expected = twin(batch.lidar().config, turn_of(config, reading))
        np.testing.assert_allclose(batch.lidar().directions[drone], expected, atol=1e-6)


def test_beams_that_do_not_turn_have_no_angle():
    batch = placed(ROOM, [[4, 4, 2]], lidar=LidarConfig(**ROSETTE))
    batch.sense()
    before = batch.lidar().ranges.copy()
    batch.sense()
    np.testing.assert_array_equal(batch.lidar().ranges, before)
    assert batch.lidar().turn_deg.shape == (0,)
    assert "turn_deg" not in batch.sensor("lidar")


@pytest.mark.parametrize(
    ("field", "value"),
    [("waves", bad) for bad in (math.nan, math.inf, -1, 1001)]
    + [("turn_deg", bad) for bad in (math.nan, math.inf, -361, 361)],
)
def test_bad_numbers_are_refused(field, value):
    with refused(ValueError, f"lidar.{field}"):
        LidarConfig(**{field: value})


def test_what_does_not_go_together_is_refused():
    with refused(ValueError, "lidar.waves", 2):
        LidarConfig(azimuth_deg=[0, 1], elevation_deg=[0, 1], waves=2)
    LidarConfig(vfov_deg=60, vfov_center_deg=80)  # a single channel without waves lies at the middle
    with refused(ValueError, "lidar.vfov_center_deg", 80):
        LidarConfig(vfov_deg=60, vfov_center_deg=80, waves=1)
    batch = placed(ROOM, [[4, 4, 2]], lidar=LidarConfig(**ROSETTE, turn_deg=-90))
    batch.sense()
    before = batch.lidar().directions
    with refused(ValueError, "lidar.vfov_center_deg", 22.5):
        batch.set_lidar(vfov_deg=140)
    np.testing.assert_array_equal(batch.lidar().directions, before)
    lidar = batch.lidar().config
    assert pickle.loads(pickle.dumps(lidar)) == lidar != LidarConfig(**ROSETTE)
    assert eval(repr(lidar), vars(flockstep)) == lidar
