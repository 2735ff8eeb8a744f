"""Bad input is rejected at its entry with the field, the expected and the given value, and nothing changes."""

import re

import gymnasium
import numpy as np
import pytest

import flockstep

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


def refused(batch, call, match):
    before = batch.snapshot()
    observation = batch.observation.copy()
    with pytest.raises(ValueError, match=f"(?s){match}"):
        call()
    assert batch.snapshot() == before, "a refused call changed the batch"
    np.testing.assert_array_equal(batch.observation, observation)


@pytest.mark.parametrize(
    ("actions", "match"),
    [
        ([0], r"actions: expected shape \(2,\), got shape \(1,\)"),
        ([[0], [0]], "actions.*shape"),
        ([0.0, 1.0], "actions.*integers.*float64"),
        ([0, 6], r"actions \(row 1\).*\[0, 6\).*6"),
        ([-1, 0], r"actions \(row 0\)"),
        (None, "actions"),
        (["a", "b"], "actions"),
        ([True, False], "actions.*integers.*bool"),
    ],
)
def test_discrete_actions(batch, actions, match):
    refused(batch, lambda: batch.step(actions), match)


@pytest.mark.parametrize("kind", ["displacement", "displacement_yaw"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, BIG])
def test_continuous_actions_must_be_finite(room, kind, bad):
    task = flockstep.NavigationConfig(action=kind)
    batch = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig(), task=task)
    batch.reset([0, 1])
    actions = np.zeros((2, 3 if kind == "displacement" else 4))
    actions[1, 2] = bad
    refused(batch, lambda: batch.step(actions), r"actions.*finite")


def test_continuous_actions_must_have_their_shape_and_dtype(room):
    batch = flockstep.Batch(
        [room], 2, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig(action="displacement")
    )
    batch.reset([0, 1])
    refused(batch, lambda: batch.step(np.zeros((2, 4), np.float32)), r"actions.*\(2, 3\).*\(2, 4\)")
    refused(batch, lambda: batch.step(np.zeros((2, 3), complex)), "actions.*complex")


@pytest.mark.parametrize("method", ["set_pose", "move"])
@pytest.mark.parametrize(
    ("position", "quat_wxyz", "mask", "match"),
    [
        ([[0, 0, np.nan]] * 2, None, None, r"position \(row 0\).*finite.*nan"),
        ([[0, 0, 1], [np.inf, 0, 0]], None, None, r"position \(row 1\).*finite.*inf"),
        ([[0, 0, BIG]] * 2, None, None, "position.*finite"),
        ([[0, 0]] * 2, None, None, r"position.*shape \(2, 3\).*\(2, 2\)"),
        ([[0, 0, 1]] * 3, None, None, "position.*shape"),
        (["abc"] * 2, None, None, "position"),
        (None, [[0, 0, 0, 0]] * 2, None, r"quat_wxyz \(row 0\).*unit.*0"),
        (None, [[1, 0, 0, 0], [2, 0, 0, 0]], None, r"quat_wxyz \(row 1\).*unit.*2"),
        (None, [[np.nan, 0, 0, 0]] * 2, None, "quat_wxyz"),
        (None, [[1, 0, 0]] * 2, None, "quat_wxyz.*shape"),
        ([[2, 4, 2]] * 2, None, [True], "mask.*shape"),
        ([[2, 4, 2]] * 2, None, [1, 0], "mask.*bool.*int"),
    ],
)
def test_poses(batch, method, position, quat_wxyz, mask, match):
    refused(batch, lambda: getattr(batch, method)(position, quat_wxyz, mask), match)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda b: b.spawn([5], [[0, 0, 0]]), r"indices \(row 0\).*\[0, 2\).*5"),
        (lambda b: b.spawn([-1], [[0, 0, 0]]), "indices"),
        (lambda b: b.spawn([0], [[0, 0, 0], [1, 1, 1]]), "position.*shape"),
        (lambda b: b.spawn([0], [[2, 4, 2]], None, [3]), "world_index.*3"),
        (lambda b: b.spawn([0.5], [[2, 4, 2]]), "indices.*integers"),
        (lambda b: b.remove([2]), "indices"),
        (lambda b: b.set_world([0, 1]), r"world_index \(row 1\).*1"),
        (lambda b: b.set_world([0]), "world_index.*shape"),
        (lambda b: b.set_lidar(max_range_m=0.0), "max_range_m.*> 0"),
        (lambda b: b.set_lidar(np.zeros(2, bool), max_range_m=-1.0), "max_range_m.*> 0.*-1"),
        (lambda b: b.set_lidar(hfov_deg=400.0), "hfov_deg"),
        (lambda b: b.set_lidar(quat_wxyz=(0, 0, 0, 0)), "quat_wxyz"),
        (lambda b: b.set_lidar(offset_m=(np.nan, 0, 0)), "offset_m"),
        (lambda b: b.set_lidar(offset_m=(1e30, 0, 0)), r"lidar.offset_m\[0\]: expected a number within"),
        (lambda b: b.seed([1]), "seeds.*shape"),
        (lambda b: b.seed([0.5, 1.5]), "seeds.*integers"),
        (lambda b: b.random(2**31, 1), "stream"),
        (lambda b: b.random(0, -1), "count"),
        (lambda b: b.reset([1, 2, 3]), "seeds.*shape"),
        (lambda b: b.reset(None, [True, False, True]), "mask.*shape"),
        (lambda b: b.restore(b"nonsense"), "snapshot"),
    ],
)
def test_other_calls(batch, call, match):
    refused(batch, lambda: call(batch), match)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"num_drones": 0, "drones_per_env": 2}, "num_drones.*0"),
        ({"num_drones": -3}, "num_drones.*-3"),
        ({"num_drones": 1 << 21}, "num_drones"),
        ({"num_threads": -1}, "num_threads"),
        ({"block_size": -1}, "block_size"),
        ({"world_index": [1]}, "world_index"),
        ({"world_index": [0, 0]}, "world_index.*shape"),
        ({"task": flockstep.NavigationConfig()}, "lidar"),
    ],
)
def test_invalid_batches(room, arguments, match):
    with pytest.raises(ValueError, match=f"(?s){match}"):
        flockstep.Batch([room], **arguments)


def test_no_worlds():
    with pytest.raises(ValueError, match="worlds"):
        flockstep.Batch([])


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"beams": 0}, "beams.*0"),
        ({"beams": 1_000_000}, "beams.*1000000"),
        ({"channels": 0}, "channels"),
        ({"channels": 1000, "beams": 1000}, "rays"),
        ({"hfov_deg": 0.0}, "hfov_deg"),
        ({"hfov_deg": 361.0}, "hfov_deg"),
        ({"hfov_deg": np.nan}, "hfov_deg.*nan"),
        ({"vfov_deg": -1.0}, "vfov_deg"),
        ({"max_range_m": 0.0}, "max_range_m"),
        ({"max_range_m": np.inf}, "max_range_m"),
        ({"offset_m": (0, np.inf, 0)}, "offset_m"),
        ({"quat_wxyz": (0, 0, 0, 0)}, "quat_wxyz"),
        ({"azimuth_deg": [0, 1], "elevation_deg": [0]}, "elevation_deg"),
        ({"azimuth_deg": [np.nan], "elevation_deg": [0]}, "azimuth_deg"),
        *(
            (
                {"azimuth_deg": [0, 1, 2], "elevation_deg": [0, 0, 0], field: value},
                f"lidar.{field}: expected its default",
            )
            for field, value in (("beams", 5), ("channels", 3), ("hfov_deg", 90.0), ("vfov_deg", 10.0))
        ),
    ],
)
def test_lidars(fields, match):
    with pytest.raises(ValueError, match=f"(?s){match}"):
        flockstep.LidarConfig(**fields)


@pytest.mark.parametrize(
    ("config", "fields", "match"),
    [
        (flockstep.NavigationReward, {"goal_radius_m": 0.0}, "goal_radius_m"),
        (flockstep.NavigationReward, {"min_clearance": 1.0}, "min_clearance"),
        (flockstep.NavigationReward, {"step_scale": 0.0}, "step_scale"),
        (flockstep.NavigationReward, {"crash_weight": np.nan}, "crash_weight"),
        (flockstep.NavigationConfig, {"action": "jump"}, "action.*jump"),
        (flockstep.NavigationConfig, {"step_m": 0.0}, "step_m"),
        (flockstep.NavigationConfig, {"step_m": np.nan}, "step_m"),
        (flockstep.NavigationConfig, {"yaw_step_deg": 181.0}, "yaw_step_deg"),
        (flockstep.EpisodeConfig, {"autoreset_mode": "sometimes"}, "autoreset_mode.*sometimes"),
        (flockstep.EpisodeConfig, {"max_episode_steps": -1}, "max_episode_steps"),
        (flockstep.EpisodeConfig, {"frame_skip": 0}, "frame_skip"),
        (flockstep.ClockConfig, {"policy_hz": 0.0}, "policy_hz"),
        (flockstep.ClockConfig, {"physics_hz": 15.0}, "physics_hz"),
        (flockstep.PoseSensorConfig, {"position_noise_std_m": -1.0}, "position_noise_std_m"),
        (flockstep.PoseSensorConfig, {"orientation_noise_std_deg": np.inf}, "orientation_noise_std_deg"),
    ],
)
def test_configs(config, fields, match):
    with pytest.raises(ValueError, match=f"(?s){match}"):
        config(**fields)


def test_a_pattern_may_say_how_many_beams_it_has():
    config = flockstep.LidarConfig(azimuth_deg=[0, 1, 2], elevation_deg=[0, 0, 0], beams=3)
    assert config.shape == (1, 3)


@pytest.mark.parametrize("config", [flockstep.LidarConfig, flockstep.CameraConfig, flockstep.ImuConfig])
def test_offsets_of_sensors(config):
    for bad in (100.1, -1e30, np.nan):
        with pytest.raises(ValueError, match=r"offset_m\[\d\]: expected a number within \+-100, got "):
            config(offset_m=(0, 0, bad))
    assert config(offset_m=(0, 0, -100)).offset_m[2] == -100


CONFIGS = [
    *(flockstep.LidarConfig, flockstep.CameraConfig, flockstep.PoseSensorConfig, flockstep.ImuConfig),
    *(flockstep.EpisodeConfig, flockstep.ClockConfig, flockstep.WindConfig, flockstep.DynamicsConfig),
    *(flockstep.NavigationReward, flockstep.NavigationConfig, flockstep.HoverConfig, flockstep.TrackConfig),
    flockstep.RaceConfig,
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
            with pytest.raises(TypeError, match=rf"^{name}: expected .*(number|integer).*, got "):
                config(**{name: value})
    assert looked_at > 0


def test_arguments_that_are_bools(room):
    with pytest.raises(TypeError, match="num_drones: expected an integer, got True"):
        flockstep.Batch([room], True)


def test_integers_that_are_too_large():
    expected = "expected an integer from -2147483648 to 2147483647, got 1099511627776"
    for config, field in ((flockstep.EpisodeConfig, "max_episode_steps"), (flockstep.CameraConfig, "width_px")):
        with pytest.raises(ValueError, match=f"^{field}: {expected}"):
            config(**{field: 2**40})


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
        with pytest.raises(ValueError, match=rf'^wind.{field}: expected its default unless gusts="{gusts}"'):
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
        with pytest.raises(RuntimeError, match=r"the LiDAR has not scanned yet: call sense\(\), or reset\(\) a task"):
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
    with pytest.raises(TypeError, match="nonsense"):
        config(nonsense=1)


@pytest.mark.parametrize(
    ("markers", "match"),
    [
        ({"start": [1, 1, 0.6]}, "goal"),
        ({"goal": [1, 1, 0.6]}, "start"),
        ({"start": [1.9, 1, 0.6], "goal": [1, 1, 0.6]}, "start"),  # in the wall
    ],
)
def test_worlds_that_cannot_be_navigated(closet, markers, match):
    world = flockstep.World.from_dict({**closet.to_dict(), "markers": markers})
    with pytest.raises(ValueError, match=match):
        flockstep.Batch([world], lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())


def test_a_start_inside_a_pillar(room):
    scene = room.to_dict()
    scene["markers"]["start"] = [4, 4.5, 2]
    with pytest.raises(ValueError, match="start"):
        flockstep.DroneVectorEnv(1, worlds=flockstep.World.from_dict(scene))


@pytest.mark.parametrize(
    ("hull", "match"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "hull"),  # flat
        ([[0, 0, 0]], "hull"),
        (np.random.default_rng(0).normal(size=(33, 3)), "hull"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]], "hull"),
        ([[0, 0]], "hull"),
    ],
)
def test_hulls(hull, match):
    with pytest.raises(ValueError, match=match):
        flockstep.DroneModel(hull)


@pytest.mark.parametrize(
    ("origins", "directions", "max_range_m", "match"),
    [
        ([[0, 0, 1]], [[0, 0, 0]], 1.0, "directions"),
        ([[0, 0, 1]], [[np.nan, 0, 0]], 1.0, "directions"),
        ([[0, 0, np.inf]], [[1, 0, 0]], 1.0, "origins"),
        ([[0, 0, 1]], [[1, 0, 0]], -1.0, "max_range_m"),
        ([[0, 0, 1]], [[1, 0, 0]], np.nan, "max_range_m"),
        ([[0, 0, 1]], [[1, 0, 0]] * 2, 1.0, "directions"),
        ([0, 0, 1], [[1, 0, 0]], 1.0, "origins"),
    ],
)
def test_rays(room, origins, directions, max_range_m, match):
    with pytest.raises(ValueError, match=match):
        room.raycast(origins, directions, max_range_m)


def test_a_batch_without_a_task_has_no_step(room):
    batch = flockstep.Batch([room])
    with pytest.raises(RuntimeError, match="task"):
        batch.step([0])
    with pytest.raises(RuntimeError, match="task"):
        batch.observation  # noqa: B018


def test_step_before_reset(room):
    batch = flockstep.Batch([room], lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())
    with pytest.raises(RuntimeError, match="reset"):
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
    refused(batch, lambda: call(batch), f"{field}.*: expected an array without a mask, got a masked array")


def test_a_masked_array_is_refused_by_environments(room):
    envs = flockstep.DroneVectorEnv(2, worlds=room, autoreset_mode="disabled")
    envs.reset(seed=0)
    parallel = flockstep.parallel_env(num_drones=1, worlds=room, random_start=True)
    parallel.reset(seed=0)
    single = gymnasium.make("flockstep/LidarNavigation-v0", worlds=room, action="displacement").unwrapped
    single.reset(seed=0)
    for call, field in (
        (lambda: envs.step(masked(2, dtype=int)), "actions"),
        (lambda: envs.reset(options={"reset_mask": masked(2, dtype=bool)}), r"options\['reset_mask'\]"),
        (lambda: envs.reset(seed=masked(2, dtype=int)), "seed"),
        (lambda: parallel.step({"drone_0": masked(dtype=int)}), r"actions\['drone_0'\]"),
        (lambda: single.step(masked(3)), "action"),
    ):
        with pytest.raises(ValueError, match=f"^{field}: expected an array without a mask"):
            call()
