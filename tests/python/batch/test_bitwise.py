"""The same bits for any number of envs, threads, block size and autoreset mode, and in what is restored or copied.

A feature whose results could depend on any of these has a flight in the list below, which all tests fly.
"""

import copy
import functools
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from rigid_body import FULL, drone_of
from simple_tasks import Climb
from test_env_lights import LIGHTS
from test_mesh_bodies import star_world
from test_seen_drones import RED
from test_world_pool import hall_at_leisure, pad

import flockstep
from flockstep import BodyConfig, BodyMotion, WorldPool, scenes
from flockstep.variations import choice, uniform

EYE = flockstep.CameraConfig(width_px=12, height_px=9, outputs=("rgb", "depth", "instance"), shadows=True)
SENSED = {"position_noise_std_m": 0.01, "orientation_noise_std_deg": 0.5}
NOISY = {
    "task": flockstep.HoverConfig(),
    "wind": flockstep.WindConfig(gusts="dryden"),
    "imu": flockstep.ImuConfig(gyroscope_noise_density=0.1, accelerometer_random_walk=0.1, rate_hz=250),
    "pose_sensor": flockstep.PoseSensorConfig(**SENSED, rate_hz=25),
    "physics_hz": 500,
    "max_episode_steps": 17,
}
DRIFTING = {
    "task": flockstep.HoverConfig(),
    "pose_sensor": flockstep.PoseSensorConfig(
        **SENSED, velocity_noise_std_mps=0.1, position_random_walk=0.1, drift_std_m=0.2, yaw_random_walk=3, rate_hz=100
    ),
    "imu": flockstep.ImuConfig(
        gyroscope_bias_std_radps=0.1, scale_std=0.02, misalignment_std_deg=1, accelerometer_vibration_mps2=1
    ),
    "barometer": flockstep.BarometerConfig(noise_std_pa=1, bias_std_pa=9, drift_std_pa=5, rate_hz=50, latency_s=0.03),
    "magnetometer": flockstep.MagnetometerConfig(noise_std_ut=1, hard_iron_std_ut=2, soft_iron_std=0.1),
    "gps_receiver": flockstep.GpsReceiverConfig(
        noise_std_m=1, drift_std_m=1, outages_per_s=2, outage_s=0.1, rate_hz=25, latency_s=0.05
    ),
    "optical_flow": flockstep.OpticalFlowConfig(noise_std_radps=0.1, max_flow_radps=3),
    "physics_hz": 500,
}
LATE = {"latency_s": 0.03, "jitter_s": 0.09, "loss": 0.3}
OBSERVED = flockstep.ObservationConfig(history=3, past_actions=2, delay_s=0.05, jitter_s=0.08, age=True)
LAWS = {
    "mass_scale": (0.8, 1.2),
    "stretch": (0.9, 1.1),
    "rotor_thrust_scale": (0.95, 1.05),
    "lag_up_scale": (0.6, 1.5),
    "rate_gain_scale": (0.7, 1.4),
    "velocity_gain_scale": (0.8, 1.2),
    "push_mps2": uniform(-0.5, 0.5, when="interval", interval_s=0.05),
    "wind_mps": (-1.0, 1.0),
    "battery_used": (0.0, 0.9),
    "battery_fall": 0.2,
    "battery_sag": 0.05,
    "dead_from_s": choice([0.3, 1e6]),
    "dead_rotor": uniform(0, 3.99, when="start"),
    "action_delay_s": (0.0, 0.03),
    "action_jitter_s": 0.012,
    "action_loss": 0.1,
}
LIDAR = {
    "worlds": "train",
    "random_world": True,
    "random_start": True,
    "stagger_first_episode": True,
    "pose_sensor": flockstep.PoseSensorConfig(**SENSED),
    "max_episode_steps": 25,
}


class Seek(flockstep.Task):
    """Fly ahead among bodies that the task throws."""

    observation_space = spaces.Box(-100, 100, (38,), np.float32)
    lidar = flockstep.LidarConfig()
    max_bodies = 3
    bodies = (BodyConfig(position_m=[3, 3, 1.4], motion=BodyMotion(velocity_mps=[0.3, 0.1, 0])),)

    def reset(self, batch, mask):
        super().reset(batch, mask)
        at = batch.position[:, None] + 2 * batch.random(1, 3)[:, None] - 1
        batch.bodies.spawn(BodyConfig(shape="sphere", size_m=[0.5] * 3), at[:, 0], velocity=-at[:, 0] / 10, mask=mask)

    def step(self, batch):
        return -batch.contact.hit.astype(float), batch.contact.hit

    def observe(self, batch):
        return np.concatenate([batch.bodies.position[:, 1], np.minimum(batch.lidar().ranges[:, 0], 3)], 1).astype("f")


def meshes():
    motion = BodyMotion(turn_rate_dps=[0, 40, 30], velocity_mps=[0, 0.4, 0])
    return [BodyConfig(shape="mesh", mesh=star_world(), position_m=[x, 3, 2], motion=motion) for x in (3.0, 5.0)]


# Functions, because a pool belongs to one batch. A single world, unless it is drawn: env i is env 0 with another seed.
FLIGHTS = {
    "lidar": lambda: LIDAR,
    "lidar by yaw": lambda: LIDAR | {"action": "displacement_yaw"},
    "camera": lambda: {"observation": "blob", "worlds": scenes.load("camera-train")[1:2], "frame_skip": 2},
    "pixels": lambda: {"observation": "pixels", "worlds": scenes.load("camera-train")[:1], "random_start": True},
    "forest": lambda: {"worlds": flockstep.World.forest(3, trees=40), "random_start": True, "camera": EYE},
    "pool": lambda: {"worlds": WorldPool(hall_at_leisure, 9, 0.7, threads=2), "action": "displacement"},
    "pads": lambda: {
        "worlds": WorldPool(pad, 12, 0.5),
        "task": flockstep.HoverConfig(start_offset_m=0.3),
        "ground_effect": True,
        "control": "rotor_thrusts",
    },
    "hover": lambda: NOISY,
    "drifting": lambda: DRIFTING,
    "track": lambda: {"task": flockstep.TrackConfig(path="random"), "drone": "x500", "control": "velocity"},
    "race": lambda: {"task": flockstep.RaceConfig(laps=1, cap_success=0.0, speed_cap_mps=(4.0, 6.0))},
    "corners": lambda: {
        "task": flockstep.RaceConfig(gate_detector=flockstep.GateDetector(noise_std_px=3, dropout=0.3)),
        "drones_per_env": 2,
    },
    "dodge": lambda: {"task": flockstep.DodgeConfig(), "worlds": scenes.load("living_playground/seed-2")},
    "swap": lambda: {"task": flockstep.SwapConfig(), "drones_per_env": 3},
    "formation": lambda: {"task": flockstep.FormationConfig(), "drones_per_env": 3},
    "python": lambda: {"task": Climb, "worlds": "playground/train-1"},
    "bodies": lambda: {"task": Seek, "worlds": "playground/train-1"},
    "meshes": lambda: {"worlds": "playground/train-1", "bodies": meshes(), "camera": EYE},
    "seen": lambda: (
        {"worlds": "playground/train-1", "camera": EYE, "interaction": "both", "drone_mesh": RED}
        | {"drones_per_env": 3, "random_start": True}
    ),
    "lights": lambda: {"worlds": "playground/train-1", "camera": EYE, "lights": LIGHTS},
    "obstacles": lambda: (
        {"task": flockstep.HoverConfig(start_offset_m=1.0), "drone": drone_of(FULL), "control": "velocity"}
        | {"worlds": "playground/train-1", "on_contact": "bounce"}
    ),
    "downwash": lambda: {
        "task": flockstep.HoverConfig(),
        "drones_per_env": 4,
        "control": "rotor_thrusts",
        "downwash": True,
    },
    "variations": lambda: {"task": flockstep.HoverConfig(), "variations": flockstep.vary(**LAWS)},
    "airframes": lambda: {"task": flockstep.HoverConfig(), "airframes": ["crazyflie", "x500", "f550"], "drone": "f550"},
    "observed": lambda: {"task": flockstep.HoverConfig(), "observed": OBSERVED, "policy_hz": 50},
    "privileged": lambda: NOISY | {"variations": flockstep.vary(mass_scale=(0.7, 1.3)), "privileged": "mass_scale"},
    "late": lambda: (
        NOISY
        | {
            "lidar": flockstep.LidarConfig(beams=5, **LATE),
            "camera": flockstep.CameraConfig(width_px=6, height_px=5, **LATE),
        }
        | {"imu": flockstep.ImuConfig(gyroscope_random_walk=0.01, **LATE)}
        | {"pose_sensor": flockstep.PoseSensorConfig(**SENSED, **LATE)}
    ),
}
for kind in ("lidar", "pool", "hover", "dodge", "camera"):
    for separately in ("each", "last"):
        FLIGHTS[f"{kind}, {separately}"] = lambda kind=kind, separately=separately: (
            FLIGHTS[kind]() | {"drones_per_env": 3, "episodes": separately}
        )
every_flight = pytest.mark.parametrize("name", FLIGHTS)


def make(name, num_envs, **more):
    return flockstep.DroneVectorEnv(num_envs, **{"max_episode_steps": 15, **FLIGHTS[name](), **more})


def action_of(env, step):
    """Actions that depend only on row and step. Choices are kept for a while, which leads to walls."""
    space = env.single_action_space
    if isinstance(space, spaces.Discrete):
        return np.array([np.random.default_rng([row, step // 15]).integers(space.n) for row in range(env.num_envs)])
    rows = [np.random.default_rng([row, step]).uniform(-1, 1, space.shape) for row in range(env.num_envs)]
    return np.array(rows, np.float32)


@functools.lru_cache(maxsize=8)
def names_of(batch):
    """The arrays that the batch has, found once: each other one is an error with a text."""
    return [each["name"] for each in batch._arrays if getattr(batch, each["name"], None) is not None]


def shown(env):
    """Every array of the batch, its sensors and its bodies."""
    batch = env.batch
    arrays = {name: getattr(batch, name) for name in names_of(batch)}
    for sensor in (*batch.lidars, *batch.cameras, *batch.imus):
        arrays |= {f"{sensor.name}: {name}": array for name, array in batch.sensor(sensor.name).items()}
    arrays |= {f"body: {name}": getattr(batch.bodies, name) for name in ("position", "quat_wxyz", "active", "velocity")}
    return {name: array.copy() for name, array in arrays.items() if array is not None}


def stepped(env, step):
    """The results of a step, and what is shown then. With autoreset disabled the rows that ended are reset."""
    observation, *flags, infos = env.step(action_of(env, step))
    ended = flags[1] | flags[2]
    final = np.full(env.num_envs, None)
    final[ended] = infos.get("final_obs", final)[ended]
    if env.autoreset_mode.value == "Disabled" and ended.any():
        observation, _ = env.reset(options={"reset_mask": ended})
    results = dict(zip(("reward", "terminated", "truncated"), flags, strict=True))
    results |= observation if isinstance(observation, dict) else {"observation": observation}
    return {**shown(env), **{f"returned {name}": array for name, array in results.items()}}, list(final)


def flown(env, seed=5, steps=50):
    env.reset(seed=seed)
    return [stepped(env, step) for step in range(steps)]


def assert_same(actual, expected):
    """Bytes are compared first: NumPy's comparison takes many times as long, and only it says what differs."""
    assert actual.keys() == expected.keys()
    for name, array in actual.items():
        if array.tobytes() != expected[name].tobytes():
            np.testing.assert_equal(array, expected[name], name)
            raise AssertionError(f"{name}: equal numbers, but not the same bits")


def assert_first(few, many):
    """Some envs do what the first of more envs do."""
    for (some, some_final), (all_rows, all_final) in zip(few, many, strict=True):
        assert_same(some, {name: all_rows[name][: len(array)] for name, array in some.items()})
        np.testing.assert_equal(some_final, all_final[: len(some_final)])


@every_flight
def test_neither_threads_nor_blocks_nor_other_envs_matter(name, mode):
    many = flown(make(name, 5, num_threads=1, autoreset_mode=mode))
    episodes = np.max([step["episode"].max() + step["own_episodes"].max(initial=0) for step, _ in many])
    assert episodes >= 2
    for num_envs, more in ((5, {"num_threads": 3, "block_size": 2}), (5, {"block_size": 1}), (2, {"num_threads": 1})):
        assert_first(flown(make(name, num_envs, autoreset_mode=mode, **more)), many)


def test_a_thousand_envs():
    many = flown(make("lidar", 1024, num_threads=8))
    assert len(np.unique(many[-1][0]["world_index"])) == 5
    assert sum(step["crashed"].sum() for step, _ in many) > 40
    assert_first(flown(make("lidar", 100, num_threads=3, block_size=7)), many)


@every_flight
def test_what_is_restored_or_copied_goes_on(name, mode):
    """A snapshot is taken in every phase of an episode. One in another env continues for some steps, beside copies."""
    env, other = (make(name, 3, autoreset_mode=mode, num_threads=threads) for threads in (1, 2))
    env.reset(seed=3)
    other.reset(seed=70)
    twins = []
    for step in range(40):
        if step % 4 == 1:
            blob = env.snapshot()
            np.testing.assert_equal(other.restore(blob), env.observation())
            twins = [other, pickle.loads(pickle.dumps(env)) if step % 8 == 1 else copy.deepcopy(env)]
            for twin in twins:
                assert twin.snapshot() == blob
                assert_same(shown(twin), shown(env))
        expected, final = stepped(env, step)
        for twin in twins:
            actual, actual_final = stepped(twin, step)
            assert_same(actual, expected)
            np.testing.assert_equal(actual_final, final)


@pytest.mark.parametrize("name", [name for name in FLIGHTS if not name.startswith(("pool", "pads"))])
def test_a_spec_and_a_recipe_describe_the_flight(name):
    keywords = {"max_episode_steps": 15, **FLIGHTS[name]()}
    envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", 2, **keywords)
    text = envs.spec.to_json()
    again = gymnasium.make_vec(gymnasium.envs.registration.EnvSpec.from_json(text), num_envs=2)
    assert again.unwrapped.spec.to_json() == text
    expected = flown(envs.unwrapped, steps=20)
    np.testing.assert_equal(flown(again.unwrapped, steps=20), expected)
    if not isinstance(keywords.get("task"), type):  # which a recipe names, if it is registered
        recipe = envs.unwrapped.recipe
        read = flockstep.Recipe.from_json(recipe.to_json())
        assert read == recipe
        given = {} if recipe.worlds else {"worlds": envs.unwrapped.batch.worlds}
        np.testing.assert_equal(flown(flockstep.DroneVectorEnv.from_recipe(read, **given), steps=20), expected)


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


@pytest.mark.parametrize(("own_task", "pool"), [(False, False), (True, False), (False, True)])
def test_autoreset_modes_agree_except_in_reset_rows(room, closet, example, own_task, pool):
    def run(mode):
        lidar = flockstep.LidarConfig()
        arguments = {"lidar": lidar, "pose_sensor": LIDAR["pose_sensor"], "autoreset_mode": mode}
        arguments |= {"worlds": WorldPool(hall_at_leisure, 9, 1.0)} if pool else {"worlds": [room, closet]}
        if own_task:
            arguments["task"] = example("navigation_numpy").Navigation(flockstep.NavigationConfig(), lidar)
        else:
            arguments["random_start"] = True
        env = flockstep.DroneVectorEnv(6, max_episode_steps=15, random_world=not pool, **arguments)
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
