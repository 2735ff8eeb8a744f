"""LiDARs that err, against a NumPy twin with the same random words and against the statistics of what they promise."""

import itertools
import math
import pickle
import re

import numpy as np
import pytest
from conftest import ROOT, placed, world_of
from messages import refused
from philox import named_stream, normals, uniform_pairs, words

import flockstep
from flockstep import LidarConfig, RangeErrors

ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": [8, 8, 4]}, markers={"start": [4, 4, 2]})
EVERY = RangeErrors(
    clutter_per_m=0.2,
    noise_std_m=0.02,
    noise_per_m=0.03,
    bias_m=0.1,
    resolution_m=0.001,
    min_range_m=1.5,
    dropout=0.2,
    dropout_per_m=0.1,
)
POSES = [[2, 4, 2], [5, 3, 1], [1, 6, 3], [4, 4, 2]]
BEAMS = {"channels": 3, "beams": 11, "hfov_deg": 200, "vfov_deg": 20, "max_range_m": 4.5}


def words_of(count, reading, seed, *, number=0, **of_drone):
    """Return four random words of each draw of a reading of ``count`` beams."""
    draws = (count + 1) // 2
    return words(named_stream("range errors") ^ (number << 16), draws * reading, draws, seed, **of_drone)


def disturbed(ranges, errors, max_range, drawn):
    """Return readings of these ranges, from the equations of the documents in float64."""
    a, b, c, d = drawn
    normal, uniform = normals(a, b)[: ranges.size], uniform_pairs(c, d)[: ranges.size]
    depth = -np.log((1 - uniform) / (1 - errors.dropout))  # at which a beam ends that does not drop out
    exact = np.where(np.isinf(ranges), max_range, ranges).astype(float).ravel()
    is_clutter = depth < errors.clutter_per_m * exact
    is_lost = np.isinf(ranges.ravel()) | (depth < (errors.clutter_per_m + errors.dropout_per_m) * exact)
    exact = np.where(is_clutter, depth / errors.clutter_per_m, exact)
    read = np.maximum(exact + errors.bias_m + (errors.noise_std_m + errors.noise_per_m * exact) * normal, 0)
    if errors.resolution_m > 0:
        read = np.rint(read / errors.resolution_m) * errors.resolution_m
    misses = (is_lost & ~is_clutter) | (read < errors.min_range_m) | (read > max_range) | (uniform < errors.dropout)
    return np.where(misses, np.inf, read).reshape(ranges.shape)


def batch_of(errors, *, world=ROOM, poses=POSES, **keywords):
    lidars = [LidarConfig(name="exact", **BEAMS), LidarConfig(name="erring", **BEAMS, errors=errors)]
    batch = placed(world, poses, lidars=lidars, **keywords)
    batch.seed(np.arange(batch.num_envs) + 5)
    return batch


@pytest.mark.parametrize("drones_per_env", [1, 2])
def test_readings_are_those_of_the_twin(drones_per_env):
    batch = batch_of(EVERY, drones_per_env=drones_per_env)
    kinds = np.zeros(3, int)
    for reading, episode in enumerate([0, 0, 1]):
        if episode:
            batch.begin_episode()
        batch.sense()
        number = 0 if episode else reading
        for drone in range(len(POSES)):
            env, member = divmod(drone, drones_per_env)
            exact = batch.lidar("exact").ranges[drone]
            drawn = words_of(exact.size, number, env + 5, episode=int(batch.episode[env]), member=member, number=1)
            expected = disturbed(exact, EVERY, BEAMS["max_range_m"], drawn)
            got = batch.lidar("erring").ranges[drone]
            np.testing.assert_array_equal(np.isinf(got), np.isinf(expected))
            hit = np.isfinite(got)
            steps = np.abs(got[hit] - expected[hit])
            assert (steps < 1e-5).mean() > 0.95  # a number between two steps may be rounded to either
            assert steps.max() < 1.01 * EVERY.resolution_m
            kinds += [np.isinf(exact).sum(), (np.isinf(got) & np.isfinite(exact)).sum(), hit.sum()]
    assert kinds.min() > 20  # misses, hits that read as misses, and readings


def many(errors, distances, *, beams=20_000, readings=50, lidars=1, seed=0):
    """Return readings of a wall at these distances, (lidars, readings, distances, beams)."""
    config = {
        "azimuth_deg": [0] * beams,
        "elevation_deg": [0] * beams,
        "max_range_m": 20,
        "errors": errors,
    }
    hall = world_of(name="hall", room={"min": [0, 0, 0], "max": [16, 8, 4]}, markers={"start": [4, 4, 2]})
    poses = [[16 - distance, 4, 2] for distance in distances]
    batch = placed(hall, poses, lidars=[LidarConfig(name=f"l{i}", **config) for i in range(lidars)])
    batch.seed(np.arange(len(poses)) + seed)
    all_readings = []
    for _ in range(readings):
        batch.sense()
        all_readings.append([batch.lidar(f"l{i}").ranges[:, 0].copy() for i in range(lidars)])
    return np.swapaxes(np.array(all_readings), 0, 1)


def test_mean_and_deviation_are_as_configured():
    distances = [1.0, 4.0, 9.0]
    (readings,) = many(RangeErrors(noise_std_m=0.02, noise_per_m=0.01, bias_m=-0.1), distances)
    for i, distance in enumerate(distances):
        errors = readings[:, i].astype(float) - distance
        sigma, count = 0.02 + 0.01 * distance, errors.size
        assert count == 1_000_000
        assert abs(errors.mean() + 0.1) < 3 * sigma / math.sqrt(count)
        assert abs(errors.std() - sigma) < 3 * sigma / math.sqrt(2 * count)
        tail = math.erfc(3 / math.sqrt(2))
        share = np.mean(np.abs(errors + 0.1) > 3 * sigma)
        assert abs(share - tail) < 3 * math.sqrt(tail / count)


def test_ranges_are_rounded_to_the_nearest_multiple():
    noise = {"noise_std_m": 0.3}
    (fine,), (rounded,) = (many(RangeErrors(**noise, resolution_m=step), [2.0], readings=2) for step in (0, 0.25))
    np.testing.assert_array_equal(rounded, np.rint(fine / 0.25) * 0.25)
    (tenths,) = many(RangeErrors(**noise, resolution_m=0.1), [2.0], readings=2)
    step = np.float32(0.1)
    np.testing.assert_array_equal(tenths, np.rint(tenths / step) * step)
    assert len(np.unique(tenths)) > 15


def test_the_share_of_dropouts_is_as_configured():
    for dropout in (0.03, 0.5):
        (readings,) = many(RangeErrors(dropout=dropout), [5.0])
        share = np.isinf(readings).mean()
        assert abs(share - dropout) < 3 * math.sqrt(dropout * (1 - dropout) / readings.size)
        assert set(np.unique(readings)) == {5.0, np.inf}
    assert np.isinf(many(RangeErrors(dropout=1), [5.0], readings=1)).all()


def is_share(found, expected):
    """Return whether a share of flags is the expected one, within three standard errors."""
    return abs(found.mean() - expected) < 3 * math.sqrt(expected * (1 - expected) / found.size)


@pytest.mark.parametrize("dropout", [0, 0.1])
def test_extinction_loses_beams_by_distance(dropout):
    distances = [1.0, 4.0, 14.0]
    (readings,) = many(RangeErrors(dropout=dropout, dropout_per_m=0.08), distances)
    for i, distance in enumerate(distances):
        assert is_share(np.isfinite(readings[:, i]), (1 - dropout) * math.exp(-0.08 * distance))
        assert set(np.unique(readings[:, i])) == {distance, np.inf}


def test_clutter_is_exponentially_distributed_before_the_surface():
    density, extinction, dropout = 0.1, 0.05, 0.2
    errors = RangeErrors(clutter_per_m=density, dropout_per_m=extinction, dropout=dropout)
    distances = [1.0, 4.0, 14.0]
    (readings,) = many(errors, distances)
    for i, distance in enumerate(distances):
        got = readings[:, i]
        clutter = got[got < distance]
        assert is_share(got < distance, (1 - dropout) * (1 - math.exp(-density * distance)))
        assert is_share(got == distance, (1 - dropout) * math.exp(-(density + extinction) * distance))
        assert np.isinf(got[got > distance]).all()
        for nearer in (0.1, 0.5, 0.9):  # quantiles of an exponential distribution, cut at the surface
            share = (1 - math.exp(-density * nearer * distance)) / (1 - math.exp(-density * distance))
            assert is_share(clutter < nearer * distance, share)


def test_beams_that_would_miss_read_clutter_up_to_the_maximum_range():
    errors = RangeErrors(clutter_per_m=0.1, dropout_per_m=1)
    lidar = LidarConfig(azimuth_deg=[0] * 200_000, elevation_deg=[0] * 200_000, max_range_m=20, errors=errors)
    batch = placed(world_of(name="far", boxes=[{"center": [99, 0, 0], "size": [1, 1, 1]}]), [[0, 0, 0]], lidar=lidar)
    batch.sense()
    ranges = batch.lidar().ranges[0]
    assert is_share(ranges < 20, 1 - math.exp(-2))
    assert np.isinf(ranges[ranges >= 20]).all()


def test_errors_are_independent_over_beams_drones_readings_and_lidars():
    readings = many(RangeErrors(noise_std_m=0.1, dropout=0.3), [5.0, 5.0], beams=1000, readings=100, lidars=2)
    drops = np.isinf(readings).astype(float)
    errors = many(RangeErrors(noise_std_m=0.1), [5.0, 5.0], beams=1000, readings=100, lidars=2) - 5.0
    for values in (drops, errors):
        pairs = [
            (values[..., 1:], values[..., :-1]),
            (values[..., ::2], values[..., 1::2]),
            (values[:, :, 0], values[:, :, 1]),
            (values[:, 1:], values[:, :-1]),
            (values[0], values[1]),
        ]
        for one, other in pairs:
            assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 3 / math.sqrt(one.size)
    # The errors of the beams that do not drop out are those of the LiDAR without dropouts.
    seen = np.isfinite(readings)
    np.testing.assert_array_equal(readings[seen], (errors + 5.0).astype(np.float32)[seen])


def test_readings_stay_between_the_minimum_and_the_maximum_range():
    batch = batch_of(RangeErrors(noise_std_m=2.0, min_range_m=0.5))
    for _ in range(20):
        batch.sense()
        ranges, hits = batch.lidar("erring").ranges, np.isfinite(batch.lidar("exact").ranges)
        finite = ranges[np.isfinite(ranges)]
        assert finite.min() >= 0.5
        assert finite.max() <= BEAMS["max_range_m"]
        assert np.isinf(ranges[~hits]).all()
    batch = batch_of(RangeErrors(bias_m=-1000))
    batch.sense()
    assert set(np.unique(batch.lidar("erring").ranges)) == {0.0, np.inf}


def at_an_edge(gap, errors, *, beams=20_000, half_width=0.01, **keywords):
    """Return azimuths and readings of beams near the edge of a wall 4 m ahead and left, with another behind it."""
    walls = [{"center": [5, 25, 0], "size": [2, 50, 50]}, {"center": [5 + gap, -25, 0], "size": [2, 50, 50]}]
    azimuth = np.random.default_rng(2).uniform(-2 * half_width, 2 * half_width, beams)
    lidar = LidarConfig(azimuth_deg=np.degrees(azimuth), elevation_deg=[0] * beams, max_range_m=20, errors=errors)
    batch = placed(world_of(name="edge", boxes=walls), [[0, 0, 0]], lidar=lidar, **keywords)
    batch.sense()
    return azimuth, batch.lidar().ranges[0, 0].copy(), batch


@pytest.mark.parametrize("tracer", ["auto", "embree"])
def test_beams_on_edges_read_between_both_surfaces(tracer):
    wide = RangeErrors(divergence_mrad=20)
    azimuth, ranges, batch = at_an_edge(2, wide, tracer=tracer)
    exact = np.where(azimuth > 0, 4, 6) / np.cos(azimuth)
    is_mixed = np.abs(ranges - exact) > 1e-4
    inside = np.abs(azimuth) < 0.01
    assert not is_mixed[~inside].any()
    # The other side of the edge is |cos t| / 2 of all directions t, 1 / pi on average.
    assert abs(is_mixed[inside].mean() - 1 / math.pi) < 3 * math.sqrt(0.22 / inside.sum())
    share = (ranges[is_mixed] - 4) / 2
    assert share.min() > 0
    assert share.max() < 1.001
    assert abs(share.mean() - 0.5) < 3 / math.sqrt(12 * share.size)
    assert abs(share.var() - 1 / 12) < 3 / math.sqrt(180 * share.size)
    batch.sense()
    again = batch.lidar().ranges[0, 0]
    np.testing.assert_array_equal(np.abs(again - exact) > 1e-4, is_mixed)
    assert (again[is_mixed] != ranges[is_mixed]).all()
    for gap, errors in ((2, RangeErrors()), (0.15, wide)):  # without a width, and with surfaces that are close
        azimuth, ranges, _ = at_an_edge(gap, errors, tracer=tracer)
        np.testing.assert_allclose(ranges, np.where(azimuth > 0, 4, 4 + gap) / np.cos(azimuth), rtol=1e-5)


def test_points_are_at_the_readings():
    batch = batch_of(EVERY)
    batch.sense()
    lidar = batch.lidar("erring")
    away = np.linalg.norm(lidar.points - batch.position[:, None, None], axis=-1)
    np.testing.assert_allclose(away, lidar.ranges, rtol=1e-5)


def flown(steps=4, envs=6, **keywords):
    """Return the observations and rewards of a flight with errors."""
    lidar = LidarConfig(beams=21, errors=EVERY)
    env = flockstep.DroneVectorEnv(envs, worlds="train", lidar=lidar, **keywords)
    found = [env.reset(seed=3)[0]]
    for step in range(steps):
        found.append(env.step((np.arange(envs) + step) % 6)[0].copy())
    return np.array(found)


def test_bits_do_not_depend_on_threads_blocks_and_other_envs():
    first = flown(num_threads=1)
    for keywords in ({"num_threads": 3, "block_size": 1}, {"num_threads": 2, "block_size": 4}):
        np.testing.assert_array_equal(flown(**keywords), first)
    np.testing.assert_array_equal(flown(envs=11, num_threads=2)[:, :6], first)


def test_no_errors_are_the_same_bits():
    batch = batch_of(RangeErrors())
    batch.sense()
    np.testing.assert_array_equal(batch.lidar("erring").ranges, batch.lidar("exact").ranges)
    assert LidarConfig(errors=RangeErrors()) == LidarConfig()


@pytest.mark.parametrize("late", [{}, {"latency_s": 0.2, "jitter_s": 0.1, "loss": 0.2}])
def test_a_snapshot_continues_with_the_same_errors(late):
    lidar = LidarConfig(beams=21, errors=EVERY, **late)
    env, other = (flockstep.DroneVectorEnv(3, worlds="train", lidar=lidar) for _ in range(2))

    def steps(batch):
        found = [batch.lidar().ranges.copy()]
        for _ in range(5):
            batch.step(np.arange(3))
            found.append(batch.lidar().ranges.copy())
        return np.array(found)

    env.reset(seed=3)
    env.step(np.arange(3))
    blob = env.batch.snapshot()
    expected = steps(env.batch)
    other.batch.restore(blob)
    np.testing.assert_array_equal(steps(other.batch), expected)
    assert not np.array_equal(expected[0], expected[-1])


def test_set_lidar_keeps_errors_and_refuses_a_range_below_them():
    batch = placed(ROOM, POSES, lidar=LidarConfig(errors=RangeErrors(resolution_m=0.5, min_range_m=1.0)))
    batch.set_lidar(max_range_m=2.0, mask=[True, False, False, False])
    assert batch.lidar().config_of(0).errors == RangeErrors(resolution_m=0.5, min_range_m=1.0)
    batch.sense()
    before = batch.lidar().ranges.copy()
    assert set(np.unique(before[0])) <= {1.0, 1.5, 2.0, np.inf}
    for max_range_m, field in ((0.4, "lidar.errors.resolution_m"), (0.9, "lidar.errors.min_range_m")):
        with refused(ValueError, field, "lidar.max_range_m"):
            batch.set_lidar(max_range_m=max_range_m)
    assert [batch.lidar().config_of(i).max_range_m for i in (0, 1)] == [2.0, 3.0]


# Before the third drone, the middle beam passes the edge of a box, with another box behind it.
BOXES = [{"center": [3, 6.205, 2], "size": [0.4, 0.4, 4]}, {"center": [5, 6, 2], "size": [0.2, 3, 4]}]
EDGES = world_of(name="edges", room={"min": [0, 0, 0], "max": [8, 8, 4]}, boxes=BOXES, markers={"start": [4, 4, 2]})
EACH = (
    RangeErrors(),
    EVERY,
    RangeErrors(noise_std_m=0.02, divergence_mrad=90),
    RangeErrors(bias_m=-0.1, max_incidence_deg=40, min_intensity=0.02),
)
NEED_MEMORY = RangeErrors(dropout=0.9, divergence_mrad=20, max_incidence_deg=80)


def test_each_drone_errs_in_its_own_way():
    batch, other = (batch_of(NEED_MEMORY, world=EDGES, num_threads=2, block_size=3) for _ in range(2))
    for drone, errors in enumerate(EACH):
        batch.set_lidar(np.arange(len(EACH)) == drone, "erring", errors=errors)
    assert [batch.lidar("erring").config_of(drone).errors for drone in range(len(EACH))] == [*EACH]
    assert batch.lidar("erring").config.errors == NEED_MEMORY
    batch.sense()
    first, blob = batch.lidar("erring").ranges.copy(), batch.snapshot()
    batch.sense()
    for drone, errors in enumerate(EACH):
        alike = batch_of(errors, world=EDGES)
        alike.sense()
        np.testing.assert_array_equal(first[drone], alike.lidar("erring").ranges[drone])
        alike.sense()
        np.testing.assert_array_equal(batch.lidar("erring").ranges[drone], alike.lidar("erring").ranges[drone])
    other.restore(blob)
    other.sense()
    np.testing.assert_array_equal(other.lidar("erring").ranges, batch.lidar("erring").ranges)
    # The width of beams and the angle to surfaces matter here.
    for drone, errors in ((2, RangeErrors(noise_std_m=0.02)), (3, RangeErrors(bias_m=-0.1))):
        without = batch_of(errors, world=EDGES)
        without.sense()
        assert (without.lidar("erring").ranges[drone] != first[drone]).any()
    batch.remove([1])
    batch.spawn([1], POSES[1:2])
    assert batch.lidar("erring").config_of(1).errors == NEED_MEMORY  # a new drone


def test_errors_that_a_drone_cannot_have_are_refused_before_any_changes():
    batch = batch_of(RangeErrors(noise_std_m=0.1))
    batch.set_lidar([True, False, False, False], "erring", max_range_m=1.0)
    before, absent = batch.snapshot(), RangeErrors()
    absent.dropout = math.nan
    for errors, *said in (
        (RangeErrors(divergence_mrad=1), "lidar.errors.divergence_mrad", 0, 1),
        (RangeErrors(max_incidence_deg=80), "lidar.errors.max_incidence_deg", 80),
        (RangeErrors(min_intensity=0.5), "lidar.errors.min_intensity", 0.5),
        (RangeErrors(min_range_m=2), "lidar.errors.min_range_m", "lidar.max_range_m", 2),
        (absent, "lidar.errors.dropout", math.nan),
    ):
        with refused(ValueError, *said):
            batch.set_lidar(lidar="erring", errors=errors)
    with refused(TypeError, "errors", "flockstep.RangeErrors or None"):
        batch.set_lidar(lidar="erring", errors={"dropout": 0.5})
    assert batch.snapshot() == before
    batch.set_lidar([False, True, True, True], "erring", errors=RangeErrors(min_range_m=2))
    seeing = LidarConfig(outputs=["semantic"], errors=RangeErrors(divergence_mrad=1))
    for drones in (0, 2):
        batch = flockstep.Batch([ROOM], drones, lidar=seeing)
        batch.set_lidar(errors=RangeErrors(divergence_mrad=2, max_incidence_deg=80, min_intensity=0.5))


def test_configurations_survive_recipes_pickles_and_snapshots():
    lidar = LidarConfig(errors=EVERY)
    assert pickle.loads(pickle.dumps(lidar)) == lidar != LidarConfig()
    env = flockstep.DroneVectorEnv(2, worlds="train", lidar=lidar)
    assert flockstep.Recipe.from_json(env.recipe.to_json()).lidars[0].errors == EVERY
    with pytest.raises(ValueError, match="snapshot"):
        flockstep.DroneVectorEnv(2, worlds="train").batch.restore(env.batch.snapshot())
    text = env.recipe.to_json().replace('"dropout": 0.2', '"dropout": 2')
    with refused(ValueError, "lidars[0].errors.dropout", 2):
        flockstep.Recipe.from_json(text)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *itertools.product([*RangeErrors.__match_args__], [math.nan]),
        *itertools.product([name for name in RangeErrors.__match_args__ if name != "bias_m"], [-1]),
        *itertools.product([name for name in RangeErrors.__match_args__ if name != "min_range_m"], [math.inf, 1e30]),
        ("clutter_per_m", 1.01),
        ("dropout_per_m", 1.01),
        ("resolution_m", 1e-9),
        ("resolution_m", 3.5),  # longer than the range
        ("min_range_m", 3.0),
        ("dropout", 1.01),
        ("max_incidence_deg", 90.1),
        ("min_intensity", 1.01),
    ],
)
def test_bad_errors_are_refused(field, value):
    with refused(ValueError, f"lidar.errors.{field}"):
        LidarConfig(errors=RangeErrors(**{field: value}))
    errors = RangeErrors()
    setattr(errors, field, value)
    lidar = LidarConfig()
    lidar.errors = errors
    with refused(ValueError, f"lidar.errors.{field}"):
        flockstep.Batch(ROOM, 1, lidar=lidar)


def test_other_types_are_refused():
    with refused(TypeError, "errors"):
        LidarConfig(errors={"noise_std_m": 1.0})
    with refused(TypeError, "dropout"):
        RangeErrors(dropout="often")
    with pytest.raises(TypeError, match="noise_std_m"):
        RangeErrors(noise_std=1.0)


PAGE = (ROOT / "docs/reference/sensors.md").read_text(encoding="utf-8")
PRODUCTS = re.findall(r"^\| `([\w-]+)` \|", PAGE.partition("| product")[2].partition("\n\n")[0], re.MULTILINE)


def test_presets_are_the_products_of_the_documents():
    with refused(ValueError, "LidarConfig.preset", "Did you mean vlp-16?") as said:
        LidarConfig.preset("vlp16")
    assert re.findall(r"[\w-]+", str(said.value).partition("one of ")[2].partition(", got")[0]) == PRODUCTS
    with refused(ValueError, "LidarConfig.preset"):
        LidarConfig.preset("<b>" * 100)


def test_presets_of_other_sensors_are_those_of_the_documents():
    listed = re.findall(r"^\| `(\w+Config)` \| (.*?) \|", PAGE.partition("| others")[2], re.MULTILINE)
    assert len(listed) == 5
    for config, names in listed:
        with refused(ValueError, f"{config}.preset") as said:
            getattr(flockstep, config).preset("none")
        known = str(said.value).partition("one of ")[2].partition(", got")[0]
        assert known.split(", ") == names.replace("`", "").split(", ")
        for name in known.split(", "):
            preset = getattr(flockstep, config).preset(name)
            assert preset.name == name
            assert preset != getattr(flockstep, config)(name=name)


@pytest.mark.parametrize("name", PRODUCTS)
def test_presets_scan_and_err(name):
    lidar = LidarConfig.preset(name)
    exact = pickle.loads(pickle.dumps(lidar))
    exact.name, exact.errors = "exact", RangeErrors()
    batch = placed(ROOM, [[6.5, 4, 2]], lidars=[lidar, exact])
    batch.sense()
    assert lidar.name == name
    assert eval(repr(lidar), vars(flockstep)) == lidar
    got, truth = batch.lidar(name).ranges, batch.lidar("exact").ranges
    both = np.isfinite(got) & np.isfinite(truth)
    assert both.any()
    assert 0 < np.abs(got - truth)[both].max() < 0.5


DIRECTIONS = {"multi-ranger-front": (1, 0, 0), "multi-ranger-up": (0, 0, 1), "flow-deck": (0, 0, -1)}


def test_rangefinders_look_where_their_names_say():
    batch = placed(ROOM, POSES[:1], lidars=[LidarConfig.preset(name) for name in DIRECTIONS])
    for name, axis in DIRECTIONS.items():
        np.testing.assert_allclose(batch.lidar(name).directions, [[[axis]]], atol=1e-7)


def test_fields_of_view_of_presets():
    mid360 = LidarConfig.preset("mid-360")
    assert mid360.vfov_center_deg - mid360.vfov_deg / 2 == -7
    assert mid360.vfov_center_deg + mid360.vfov_deg / 2 == 52
    assert math.prod(mid360.shape) == 20_000
    assert LidarConfig.preset("os0-128").shape == (128, 512)
    spacing = LidarConfig.preset("vlp-16")
    assert spacing.vfov_deg / (spacing.channels - 1) == 2.0
    zones = LidarConfig.preset("vl53l5cx")
    assert zones.hfov_deg + zones.hfov_deg / 7 == zones.vfov_deg + zones.vfov_deg / 7 == 45.0
