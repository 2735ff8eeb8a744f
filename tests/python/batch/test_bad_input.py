"""Bad input is rejected at its entry with the field, the expected and the given value, and nothing changes."""

import re

import gymnasium
import numpy as np
import pytest
from messages import refused

import flockstep
from flockstep import _core

BIG = np.float64(1e39)  # beyond float32


@pytest.fixture
def batch(room):
    batch = flockstep.Batch(
        [room],
        2,
        lidar=flockstep.LidarConfig(),
        task=flockstep.NavigationConfig(),
        episode=flockstep.EpisodeConfig(autoreset_mode="disabled"),
        num_threads=1,
    )
    batch.reset([0, 1])
    batch.step([0, 2])
    return batch


def unchanged_by(batch, call, field, *values):
    before = batch.snapshot()
    observation = batch.observation.copy()
    with refused(ValueError, field, *values):
        call()
    assert batch.snapshot() == before, "a refused call changed the batch"
    np.testing.assert_array_equal(batch.observation, observation)


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        ([0], ["actions", (2,), (1,)]),
        ([[0], [0]], ["actions", (2,), (2, 1)]),
        ([0.0, 1.0], ["actions", "integers", "float64"]),
        ([0, 6], ["actions (row 1)", 0, "got 6"]),
        ([-1, 0], ["actions (row 0)", 0, 6, -1]),
        (None, ["actions"]),
        (["a", "b"], ["actions"]),
        ([True, False], ["actions", "integers", "bool"]),
    ],
)
def test_discrete_actions(batch, actions, said):
    unchanged_by(batch, lambda: batch.step(actions), *said)


@pytest.mark.parametrize("kind", ["displacement", "displacement_yaw"])
def test_continuous_actions(room, kind):
    task = flockstep.NavigationConfig(action=kind)
    batch = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig(), task=task)
    batch.reset([0, 1])
    columns = 3 if kind == "displacement" else 4
    for bad in (np.nan, np.inf, -np.inf, BIG):
        actions = np.zeros((2, columns))
        actions[1, 2] = bad
        unchanged_by(batch, lambda actions=actions: batch.step(actions), "actions", "finite")
    unchanged_by(batch, lambda: batch.step(np.zeros((2, 5), np.float32)), "actions", (2, columns), (2, 5))
    unchanged_by(batch, lambda: batch.step(np.zeros((2, columns), complex)), "actions", "complex128")


@pytest.mark.parametrize("method", ["set_pose", "move"])
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([[[0, 0, np.nan]] * 2], ["position (row 0)", "finite", np.nan]),
        ([[[0, 0, 1], [np.inf, 0, 0]]], ["position (row 1)", "finite", np.inf]),
        ([[[0, 0, BIG]] * 2], ["position", "finite", BIG]),
        ([[[0, 0]] * 2], ["position", (2, 3), (2, 2)]),
        ([[[0, 0, 1]] * 3], ["position", (2, 3), (3, 3)]),
        ([["abc"] * 2], ["position"]),
        ([None, [[0, 0, 0, 0]] * 2], ["quat_wxyz (row 0)", "unit", "0.000000"]),
        ([None, [[1, 0, 0, 0], [2, 0, 0, 0]]], ["quat_wxyz (row 1)", "unit", "2.000000"]),
        ([None, [[np.nan, 0, 0, 0]] * 2], ["quat_wxyz (row 0)", np.nan]),
        ([None, [[1, 0, 0]] * 2], ["quat_wxyz", (2, 4), (2, 3)]),
        ([[[2, 4, 2]] * 2, None, [True]], ["mask", (2,), (1,)]),
        ([[[2, 4, 2]] * 2, None, [1, 0]], ["mask", "bool", "int64"]),
    ],
)
def test_poses(batch, method, arguments, said):
    unchanged_by(batch, lambda: getattr(batch, method)(*arguments), *said)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda b: b.spawn([5], [[0, 0, 0]]), ["indices (row 0)", 0, 2, 5]),
        (lambda b: b.spawn([-1], [[0, 0, 0]]), ["indices (row 0)", 0, 2, -1]),
        (lambda b: b.spawn([0], [[0, 0, 0], [1, 1, 1]]), ["position", (1, 3), (2, 3)]),
        (lambda b: b.spawn([0], [[2, 4, 2]], None, [3]), ["world_index (row 0)", 0, 1, 3]),
        (lambda b: b.spawn([0.5], [[2, 4, 2]]), ["indices", "integers", "float64"]),
        (lambda b: b.remove([2]), ["indices (row 0)", 0, "got 2"]),
        (lambda b: b.set_world([0, 1]), ["world_index (row 1)", 0, "got 1"]),
        (lambda b: b.set_world([0]), ["world_index", (2,), (1,)]),
        (lambda b: b.set_lidar(max_range_m=0.0), ["lidar.max_range_m", 0]),
        (lambda b: b.set_lidar(np.zeros(2, bool), max_range_m=-1.0), ["lidar.max_range_m", -1]),
        (lambda b: b.set_lidar(hfov_deg=400.0), ["lidar.hfov_deg", 0, 360, 400]),
        (lambda b: b.set_lidar(quat_wxyz=(0, 0, 0, 0)), ["lidar.quat_wxyz", "unit", "0.000000"]),
        (lambda b: b.set_lidar(offset_m=(np.nan, 0, 0)), ["lidar.offset_m[0]", np.nan]),
        (lambda b: b.set_lidar(offset_m=(1e30, 0, 0)), ["lidar.offset_m[0]", "-100", 1e30]),
        (lambda b: b.seed([1]), ["seeds", (2,), (1,)]),
        (lambda b: b.seed([0.5, 1.5]), ["seeds", "integers", "float64"]),
        (lambda b: b.random(2**31, 1), ["stream", 0, f"got {2**31}"]),
        (lambda b: b.random(0, -1), ["count", 0, -1]),
        (lambda b: b.reset([1, 2, 3]), ["seeds", (2,), (3,)]),
        (lambda b: b.reset(None, [True, False, True]), ["mask", (2,), (3,)]),
        (lambda b: b.restore(b"nonsense"), ["snapshot"]),
    ],
)
def test_other_calls(batch, call, said):
    unchanged_by(batch, lambda: call(batch), *said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"num_drones": 0, "drones_per_env": 2}, ["num_drones", 0]),
        ({"num_drones": -3}, ["num_drones", -3]),
        ({"num_drones": 3, "drones_per_env": 0}, ["num_drones", 3]),
        ({"num_drones": 0, "drones_per_env": -1}, ["drones_per_env", -1]),
        ({"num_drones": 0, "task": flockstep.NavigationConfig()}, ["num_drones", "at least one drone"]),
        ({"num_drones": 1 << 21}, ["num_drones", 1 << 21]),
        ({"num_threads": -1}, ["num_threads", 0, 4096, -1]),
        ({"block_size": -1}, ["block_size", 0, -1]),
        ({"world_index": [1]}, ["world_index (row 0)", 0, "got 1"]),
        ({"world_index": [0, 0]}, ["world_index", (1,), (2,)]),
        ({"task": flockstep.NavigationConfig()}, ["lidar"]),
        ({"worlds": []}, ["worlds"]),
    ],
)
def test_invalid_batches(room, arguments, said):
    with refused(ValueError, *said):
        flockstep.Batch(**{"worlds": [room]} | arguments)


LIMITS = re.compile(r"(?:0 or )?([\[(]|>=? )(-?[\d.e-]+)(?:, ([\d.]+)[)\]])?|within \+-([\d.e+]+)")
NUMBER = re.compile(r"(Sequence\[)?(int|float)\]?(?: \| None)?")
NUMBERS = [
    (config, field["name"], *number.groups(), field["values"])
    for config in vars(_core).values()
    for field in getattr(config, "_fields", [])
    if (number := NUMBER.fullmatch(field["type"])) and LIMITS.match(field["values"]) and field["name"] != "azimuth_deg"
]


@pytest.mark.parametrize(("config", "name", "many", "kind", "values"), NUMBERS)
def test_numbers_beyond_the_limits_of_their_field(config, name, many, kind, values):
    """Also those that are set later, and reach an env with the configuration of its task."""
    opens, low, high, wide = LIMITS.match(values).groups()
    step = 1 if kind == "int" else 1e-3
    bads = [] if kind == "int" else [np.nan, np.inf, -np.inf]
    if wide:
        bads += [1.001 * float(wide), -1.001 * float(wide)]
    else:
        bads += [float(low) - (0 if opens in ("(", "> ") else step), *(float(h) * 1.001 + step for h in [high] if h)]
    for bad in bads:
        bad = bad if kind == "float" else int(bad)
        value = [bad, *getattr(config(), name)[1:]] if many else bad
        said = pytest.raises(ValueError, match=rf"^(\w+[.:] ?)*({name}|low)\b")  # a highest value below the lowest
        with said:
            config(**{name: value})
        if config in (flockstep.HoverConfig, flockstep.TrackConfig):
            task = config()
            setattr(task, name, value)
            with said:
                flockstep.DroneVectorEnv(1, task=task)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"channels": 1000, "beams": 1000}, ["lidar", "262144 rays", 1_000_000]),
        ({"quat_wxyz": (0, 0, 0, 0)}, ["lidar.quat_wxyz", "unit", "0.000000"]),
        ({"azimuth_deg": [0, 1], "elevation_deg": [0]}, ["lidar.elevation_deg", 2, 1]),
        ({"azimuth_deg": [np.nan], "elevation_deg": [0]}, ["lidar.azimuth_deg[0]", np.nan]),
        *(
            ({"azimuth_deg": [0, 1, 2], "elevation_deg": [0, 0, 0], field: value}, [f"lidar.{field}", "its default"])
            for field, value in (("beams", 5), ("channels", 3), ("hfov_deg", 90.0), ("vfov_deg", 10.0))
        ),
    ],
)
def test_lidars(fields, said):
    with refused(ValueError, *said):
        flockstep.LidarConfig(**fields)


def test_a_pattern_may_say_how_many_beams_it_has():
    config = flockstep.LidarConfig(azimuth_deg=[0, 1, 2], elevation_deg=[0, 0, 0], beams=3)
    assert config.shape == (1, 3)


CONFIGS = [
    *(flockstep.LidarConfig, flockstep.CameraConfig, flockstep.PoseSensorConfig, flockstep.ImuConfig),
    *(flockstep.EpisodeConfig, flockstep.ClockConfig, flockstep.WindConfig, flockstep.DynamicsConfig),
    *(flockstep.NavigationReward, flockstep.NavigationConfig, flockstep.HoverConfig, flockstep.TrackConfig),
    *(flockstep.RaceConfig, flockstep.BarometerConfig, flockstep.MagnetometerConfig),
    *(flockstep.GpsReceiverConfig, flockstep.OpticalFlowConfig, flockstep.GateDetector),
]


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("flag", [True, np.False_])
def test_bools_are_not_numbers(config, flag):
    """Every numeric field rejects bools: single numbers, optional numbers and sequences."""
    looked_at = 0
    for name, kind in ((field["name"], field["type"]) for field in config._fields):
        if not re.search(r"\b(int|float)\b", kind):
            continue
        looked_at += 1
        default = getattr(config(), name)
        values = [flag, *([[flag, *default[1:]]] if isinstance(default, list) else [])]
        for value in values:
            with refused(TypeError, name, value):
                config(**{name: value})
    assert looked_at > 0


def test_arguments_that_are_bools(room):
    with refused(TypeError, "num_drones", True):
        flockstep.Batch([room], True)


@pytest.mark.parametrize(
    ("field", "value", "gusts"),
    [
        ("gust_std_mps", 3, "ornstein_uhlenbeck"),
        ("gust_time_s", 3, "ornstein_uhlenbeck"),
        ("wind_at_6m_mps", 3, "dryden"),
        ("height_m", 30, "dryden"),
    ],
)
def test_settings_of_gusts_that_are_not_used(field, value, gusts):
    other = {"dryden": "ornstein_uhlenbeck", "ornstein_uhlenbeck": "dryden"}[gusts]
    for without in ({}, {"gusts": "none"}, {"gusts": other}):
        with refused(ValueError, f"wind.{field}", "its default", gusts):
            flockstep.WindConfig(**{field: value}, **without)
    assert getattr(flockstep.WindConfig(**{field: value}, gusts=gusts), field) == value


def test_ranges_before_the_first_scan(room):
    def reads(batch):
        lidar, terms = batch.lidar(), batch.terms
        return [
            lambda: lidar.ranges,
            lambda: lidar.points,
            terms.ranges,
            terms.clearance,
            lambda: terms.free_space(0.5),
        ]

    batch = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig())
    for read in reads(batch):
        with refused(RuntimeError, "not scanned yet"):
            read()
    unread = batch.lidar()
    batch.sense()
    assert np.isfinite(unread.ranges).any()
    assert all(np.isfinite(read()).any() for read in reads(batch))
    other = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig())
    other.restore(batch.snapshot())
    np.testing.assert_array_equal(other.lidar().ranges, batch.lidar().ranges)


@pytest.mark.parametrize("config", [flockstep.LidarConfig, flockstep.NavigationReward, flockstep.NavigationConfig])
def test_unknown_fields(config):
    with refused(TypeError, "nonsense"):
        config(nonsense=1)


@pytest.mark.parametrize(
    ("markers", "field"),
    [
        ({"start": [1, 1, 0.6]}, "markers.goal"),
        ({"goal": [1, 1, 0.6]}, "markers.start"),
        ({"start": [1.9, 1, 0.6], "goal": [1, 1, 0.6]}, "markers.start"),  # in the wall
    ],
)
def test_worlds_that_cannot_be_navigated(closet, markers, field):
    world = flockstep.World.from_dict({**closet.to_dict(), "markers": markers})
    with refused(ValueError, 'world "closet"', field):
        flockstep.Batch([world], lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())


@pytest.mark.parametrize(
    ("hull", "said"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], ["hull", "volume", "0.000000"]),
        ([[0, 0, 0]], ["hull", 4, 32, 1]),
        (np.random.default_rng(0).normal(size=(33, 3)), ["hull", 4, 32, 33]),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]], ["hull[3]", "finite", 100]),
        ([[0, 0]], ["hull", "(N, 3)", (1, 2)]),
    ],
)
def test_hulls(hull, said):
    with refused(ValueError, *said):
        flockstep.DroneModel(hull)


@pytest.mark.parametrize(
    ("said", "arguments"),
    [
        (["directions", "zero in row 0"], {"directions": [[0, 0, 0]]}),
        (["directions", np.nan, 0], {"directions": [[np.nan, 0, 0]]}),
        (["directions", 3, 6], {"directions": [[1, 0, 0]] * 2}),
        (["origins", np.inf, 0], {"origins": [[0, 0, np.inf]]}),
        (["origins", "(N, 3)", (3,)], {"origins": [0, 0, 1]}),
        (["max_range_m", 0, -1], {"max_range_m": -1.0}),
        (["max_range_m", 0, np.nan], {"max_range_m": np.nan}),
    ],
)
def test_rays(room, said, arguments):
    with refused(ValueError, *said):
        room.raycast(**{"origins": [[0, 0, 1]], "directions": [[1, 0, 0]], "max_range_m": 1.0} | arguments)


def test_a_batch_without_a_task_has_no_step(room):
    batch = flockstep.Batch([room])
    for call in (lambda: batch.step([0]), lambda: batch.observation):
        with refused(RuntimeError, "task"):
            call()


def test_step_before_reset(room):
    batch = flockstep.Batch([room], lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())
    with refused(RuntimeError, "reset"):
        batch.step([0])


def masked(*shape, dtype=np.float32):
    return np.ma.masked_less(np.ones(shape, dtype), 2)


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda b: b.step(masked(2, dtype=int)), "actions"),
        (lambda b: b.set_pose(masked(2, 3)), "position"),
        (lambda b: b.set_pose(masked(3)), "position"),
        (lambda b: b.move(quat_wxyz=masked(2, 4)), "quat_wxyz"),
        (lambda b: b.sense(masked(2, dtype=bool)), "mask"),
        (lambda b: b.remove(masked(1, dtype=int)), "indices"),
        (lambda b: b.set_light(sun_color=(0.5, 0.5, 0.5), envs=masked(2, dtype=bool)), "envs"),
        (lambda b: flockstep.LidarConfig(offset_m=masked(3)), "offset_m"),
        (lambda b: flockstep.LidarConfig(azimuth_deg=masked(3)), "azimuth_deg"),
        (lambda b: flockstep.color_blob(masked(8, 8, 3, dtype=np.uint8), flockstep.ColorRange()), "image"),
        (lambda b: flockstep.rotations.yaw_of(masked(4)), "quat_wxyz"),
        (lambda b: flockstep.rotations.quat_from_rpy(masked(3)), "rpy"),
    ],
)
def test_a_masked_array_is_refused(batch, call, field):
    unchanged_by(batch, lambda: call(batch), field, "without a mask")


def test_a_masked_array_is_refused_by_environments(room):
    envs = flockstep.DroneVectorEnv(2, worlds=room, autoreset_mode="disabled")
    envs.reset(seed=0)
    parallel = flockstep.parallel_env(num_drones=1, worlds=room, random_start=True)
    parallel.reset(seed=0)
    single = gymnasium.make("flockstep/LidarNavigation-v0", worlds=room, action="displacement").unwrapped
    single.reset(seed=0)
    for call, field in (
        (lambda: envs.step(masked(2, dtype=int)), "actions"),
        (lambda: envs.reset(options={"reset_mask": masked(2, dtype=bool)}), "options['reset_mask']"),
        (lambda: envs.reset(seed=masked(2, dtype=int)), "seed"),
        (lambda: parallel.step({"drone_0": masked(dtype=int)}), "actions['drone_0']"),
        (lambda: single.step(masked(3)), "action"),
    ):
        with refused(ValueError, field, "without a mask"):
            call()
