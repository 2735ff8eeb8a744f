"""Delay, jitter, loss and age of readings, against readings of the same flight without them."""

import math

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from philox import named_stream, uniforms

import flockstep
from flockstep import CameraConfig, ImuConfig, LidarConfig, PoseSensorConfig, RangeErrors

ROOM = world_of(name="room", room={"min": [0, 0, 0], "max": [8, 8, 4]}, markers={"start": [4, 4, 2]})
TICKS = 10  # ticks of 2 ms in a step
SEED = 3
NOISE = {"position_noise_std_m": 0.1, "orientation_noise_std_deg": 2.0}
ERRORS = RangeErrors(noise_std_m=0.1, dropout=0.2)
NAMES = ("lidar.lidar", "pose_sensor.pose", "imu.imu", "camera.front")
ALL = {"latency_s": 0.03, "jitter_s": 0.09, "loss": 0.3}


def make(late, rate_hz=None, *, image=None, **keywords):
    """Hovering drones with four sensors whose readings are late in the same way."""
    late = {**late, "rate_hz": rate_hz}
    image = {"width_px": 6, "height_px": 5, "outputs": ("rgb", "depth", "normal"), **(image or {})}
    return flockstep.DroneVectorEnv(
        2,
        task=flockstep.HoverConfig(),
        worlds=ROOM,
        policy_hz=50,
        lidar=LidarConfig(beams=5, hfov_deg=200, max_range_m=9, errors=ERRORS, **late),
        imu=ImuConfig(gyroscope_noise_density=0.01, gyroscope_random_walk=0.01, **late),
        pose_sensor=PoseSensorConfig(**NOISE, **late),
        camera=CameraConfig(**image, **late),
        **{"max_episode_steps": 9, "autoreset_mode": "same_step", **keywords},
    )


def readings(env):
    """Return the arrays that each sensor shows."""
    batch, camera = env.batch, env.batch.camera()
    images = [getattr(camera, name) for name in camera.config.outputs]
    groups = (
        [batch.lidar().ranges],
        [batch.sensed_position, batch.sensed_quat_wxyz],
        [batch.accelerometer, batch.gyroscope],
        [*images, camera.frame_step],
    )
    return [[array.copy() for array in group] for group in groups]


def ages(env):
    batch = env.batch
    every = batch.lidar().ranges_age_s, batch.sensed_age_s, batch.imu_age_s, batch.camera().frame_age_s
    return [age.copy() for age in every]


def actions(steps, rows=2):
    return np.float32(np.random.default_rng(0).uniform(-1, 1, (steps, rows, 4)))


class Line:
    """The readings of a sensor of a drone in an episode, and when they arrive."""

    def __init__(self, late, name, seed, episode, member=0):
        self.latency, self.jitter, self.loss = (
            float(np.float32(late.get(key, 0))) for key in ("latency_s", "jitter_s", "loss")
        )
        self.draw = lambda tick: uniforms(seed, episode, named_stream(f"delay of {name}"), tick, member)
        self.taken = []

    def read(self, tick, reading):
        if not self.taken:
            self.taken.append((tick, tick, reading))
            return
        lost, late = self.draw(tick)[:2]
        if lost >= self.loss:
            late_s = self.latency + late * self.jitter
            self.taken.append((tick, tick + math.ceil(late_s / 0.002 - 1e-3), reading))

    def shown(self, tick):
        """The tick of the newest reading that has arrived, and the reading."""
        return next((taken, reading) for taken, arrival, reading in reversed(self.taken) if arrival <= tick)


FATES = [
    {"latency_s": 0.02},
    {"latency_s": 0.03},
    {"latency_s": 0.1},
    {"jitter_s": 0.1},
    {"loss": 0.5},
    ALL,
]


@pytest.mark.parametrize("late", FATES, ids=str)
@pytest.mark.parametrize(
    ("rate_hz", "keywords"),
    [
        (None, {"num_threads": 2, "block_size": 1}),
        (None, {"drones_per_env": 2, "episodes": "each", "num_threads": 1}),
        (25, {"frame_skip": 3, "num_threads": 1}),
        (None, {"image": {"resize": (3, 2), "outputs": ("rgb", "depth", "hsv", "grey")}}),
        (
            None,
            {"image": {"outputs": ("hsv", "semantic", "instance"), "layout": "chw", "capture_mode": "on_movement"}},
        ),
    ],
    ids=["threads", "drones", "rate", "resized", "on_movement"],
)
def test_readings_are_those_of_a_while_ago(late, rate_hz, keywords):
    exact, delayed = make({}, rate_hz, **keywords), make(late, rate_hz, **keywords)
    for env in (exact, delayed):
        env.reset(seed=SEED)
    batch, rows = exact.batch, exact.num_envs
    held = delayed.batch.lidar().ranges, delayed.batch.camera().frame_step
    members, period = rows // 2, 500 // rate_hz if rate_hz else 1
    lines, begun, ticks = [None] * rows, 0, [0] * rows
    kinds = [3] if rate_hz else range(4)  # sensors that read between steps have a test of their own

    def look(ended):
        nonlocal begun
        now, published, age = readings(exact), readings(delayed), ages(delayed)
        for row in range(rows):
            env, member = divmod(row, members)
            tick = int(batch.tick[env])
            if ended[row]:
                own = int(batch.own_episodes[row]) if keywords.get("episodes") == "each" else 0
                key = (SEED + env, int(batch.episode[env]) + own, member)
                lines[row], begun = [Line(late, name, *key) for name in NAMES], begun + 1
            for kind in kinds:
                line = lines[row][kind]
                if ended[row] or tick // period != ticks[row] // period:
                    line.read(tick, [part[row] for part in now[kind]])
                taken, reading = line.shown(tick)
                for ours, theirs in zip(published[kind], reading, strict=True):
                    np.testing.assert_array_equal(ours[row], theirs, err_msg=NAMES[kind])
                np.testing.assert_allclose(age[kind][row], (tick - taken) * 0.002, rtol=1e-6, err_msg=NAMES[kind])
            ticks[row] = tick

    look([True] * rows)
    for action in actions(40, rows):
        ended = exact.step(action)[3] | batch.terminated
        delayed.step(action)
        look(ended)
        if rate_hz is None:
            for one in ages(exact):
                np.testing.assert_array_equal(one, 0)
    assert begun > rows
    for view, array in zip(held, (delayed.batch.lidar().ranges, delayed.batch.camera().frame_step), strict=True):
        assert np.shares_memory(view, array)
        np.testing.assert_array_equal(view, array)


@pytest.mark.parametrize(
    ("rate_hz", "late"),
    [
        (125, {}),
        (125, {"latency_s": 0.01}),
        (500, {"latency_s": 0.006}),
        (500, {"latency_s": 0.05}),
        (25, {"latency_s": 0.02}),
        (500, ALL),
        (125, {"jitter_s": 0.1, "loss": 0.5}),
    ],
    ids=str,
)
def test_readings_at_their_own_rate(rate_hz, late):
    """A reading of every tick, without noise, tells which one has arrived."""
    config = PoseSensorConfig(rate_hz=rate_hz, **late)
    env = flockstep.DroneVectorEnv(
        1, task=flockstep.HoverConfig(), worlds=ROOM, policy_hz=50, max_episode_steps=0, pose_sensor=config
    )
    path = flockstep.DroneVectorEnv(  # a step for each tick
        1, task=flockstep.HoverConfig(), worlds=ROOM, policy_hz=500, controller_hz=500, max_episode_steps=0
    )
    for one in (env, path):
        one.reset(seed=SEED)
    line = Line(late, NAMES[1], SEED, int(env.batch.episode[0]))
    line.read(0, path.batch.position[0].copy())
    for step in range(20):
        action = np.full((1, 4), 0.2 * (-1) ** step, np.float32)
        env.step(action)
        for _ in range(TICKS):
            path.step(action)
            now = int(path.batch.tick[0])
            if now % (500 // rate_hz) == 0:
                line.read(now, path.batch.position[0].copy())
        taken, position = line.shown(now)
        np.testing.assert_allclose(env.batch.sensed_age_s, (now - taken) * 0.002, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(env.batch.sensed_position[0], position, atol=2e-6)


def older_than(late, age_s):
    """Return which of more than 100,000 readings of pose sensors are shown this late, and the greatest age."""
    config = PoseSensorConfig(**late)
    keywords = {"policy_hz": 50, "max_episode_steps": 0, "pose_sensor": config}
    envs = flockstep.DroneVectorEnv(4096, task=flockstep.HoverConfig(), worlds=ROOM, **keywords)
    envs.reset(seed=SEED)
    found, greatest = [], 0.0
    for _ in range(40):
        envs.step(np.zeros((4096, 4), np.float32))
        is_old = envs.batch.steps >= 10  # the first reading, which is never late, is forgotten
        found.append(envs.batch.sensed_age_s[is_old] > age_s + 1e-4)
        greatest = max(greatest, envs.batch.sensed_age_s.max())
    found = np.concatenate(found)
    assert found.size > 1e5
    return found, greatest


@pytest.mark.parametrize("loss", [0.1, 0.5, 0.97])
def test_a_share_of_readings_is_lost(loss):
    late, greatest = older_than({"loss": loss}, 0.0)
    assert abs(late.mean() - loss) < 3 * math.sqrt(loss * (1 - loss) / late.size)
    assert greatest > 0.02 * min(math.floor(math.log(1e-4) / math.log(loss)), 30)  # without a limit


@pytest.mark.parametrize("jitter_s", [0.03, 0.04, 0.08])
def test_jitter_is_uniform(jitter_s):
    """The reading of the step before has arrived if it was late by at most a step."""
    late, greatest = older_than({"jitter_s": jitter_s}, 0.02)
    expected = 1 - 0.02 / jitter_s
    assert abs(late.mean() - expected) < 3 * math.sqrt(expected * (1 - expected) / late.size)
    assert greatest <= math.ceil(jitter_s / 0.02) * 0.02 + 1e-6


def test_drones_that_come_have_no_old_readings():
    camera = CameraConfig(width_px=8, height_px=6, outputs=("depth",), latency_s=0.2)
    batch = flockstep.Batch(ROOM, 1, lidar=LidarConfig(beams=3, latency_s=0.2), cameras=[camera])
    batch.sense()
    old, image = batch.lidar().ranges[0].copy(), batch.camera().depth[0].copy()
    batch.spawn(position=[[2, 2, 1]])
    batch.sense()
    assert (batch.lidar().ranges[1] != old).any()
    assert (batch.camera().depth[1] != image).any()
    np.testing.assert_array_equal(batch.lidar().ranges[0], old)
    np.testing.assert_array_equal(batch.camera().depth[0], image)
    batch.set_lidar(max_range_m=2.0)
    np.testing.assert_array_equal(batch.lidar().max_range_m, 2)
    batch.set_lidar(beams=7)
    batch.set_camera(width_px=4)
    batch.sense()
    assert np.isfinite(batch.lidar().ranges).sum() > 0
    assert np.isfinite(batch.camera().depth).all()


def test_readings_between_steps_are_never_early():
    """A ring has a place for each step. When all are under way, a new reading takes the place of the last."""
    clock = flockstep.ClockConfig(policy_hz=50, physics_hz=500)
    late = {"latency_s": 0.05}
    batch = flockstep.Batch(
        ROOM, 1, drone="x500", dynamics=flockstep.DynamicsConfig(motion="rotors"), clock=clock,
        pose_sensor=PoseSensorConfig(**late), cameras=[CameraConfig(width_px=4, height_px=3, **late)],
    )  # fmt: skip
    batch.set_pose([[4, 4, 2]])
    batch.sense()
    taken = []
    for tick in range(1, 200):
        batch.fly(np.float32([[1, 0, 0, 0]]), 1, control="velocity")
        batch.sense()
        assert batch.sensed_age_s[0] == batch.camera().frame_age_s[0]
        taken.append(tick - round(batch.sensed_age_s[0] / 0.002))
        assert taken[-1] == 0 or 25 <= tick - taken[-1] <= 50
    assert np.all(np.diff(taken) >= 0)
    assert len(set(taken)) > 10


def test_late_images_on_demand():
    camera = CameraConfig(width_px=8, height_px=6, outputs=("rgb", "depth"), capture_mode="on_demand", latency_s=0.2)
    batch = flockstep.Batch(ROOM, 1, cameras=[camera], dynamics=flockstep.DynamicsConfig(motion="rotors"))
    depth = batch.camera().depth
    batch.set_pose([[4, 4, 2]])
    batch.capture()
    first = depth.copy()  # arrives at once
    batch.fly(np.float32([[2, 0, 0, 0]]), 100, control="velocity")
    batch.capture()
    np.testing.assert_array_equal(depth, first)
    batch.fly(np.float32([[2, 0, 0, 0]]), 100, control="velocity")
    batch.sense()  # the image arrives, and none is taken
    assert (depth != first).any()
    np.testing.assert_allclose(batch.camera().frame_age_s, 0.2, rtol=1e-6)
    batch.set_move_line_visible(True)
    np.testing.assert_array_equal(batch.picture(0), batch.camera().rgb[0])
    batch.set_camera(hfov_deg=60)  # what is under way does not arrive
    assert batch.camera().frame_step[0] == -1
    assert batch.camera().frame_age_s[0] == 0
    batch.capture()
    assert batch.camera().frame_age_s[0] == 0
    assert (depth != first).any()


@pytest.mark.parametrize("sensor", ["camera", "lidar"])
def test_rings_fit_into_memory(sensor):
    large = {
        "camera": {"cameras": [CameraConfig(width_px=8192, height_px=8192, latency_s=1.0, jitter_s=1.0)]},
        "lidar": {"lidar": LidarConfig(beams=262144, hfov_deg=360, latency_s=1.0, jitter_s=1.0)},
    }[sensor]
    drones = {"camera": 20, "lidar": 4096}[sensor]
    with refused(ValueError, f"{sensor}.latency_s, {sensor}.jitter_s", "memory"):
        flockstep.Batch(ROOM, drones, clock=flockstep.ClockConfig(policy_hz=1000), **large)
