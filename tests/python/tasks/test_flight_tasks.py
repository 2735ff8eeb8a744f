"""Hover and track: the engine's tasks against their NumPy twins, closed forms and hand-computed numbers."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused
from rigid_body import CONTROLS, OPEN
from scipy.spatial.transform import Rotation

import flockstep
from flockstep.rotations import rotate

ROOM = world_of(room={"min": [10, -6, 0], "max": [22, 6, 8]}, markers={"goal": [15, 0.5, 4]})
GOAL = ROOM.goal  # target of the tasks: neither the origin nor the middle of the room
NO_GOAL = world_of(room={"min": [-3, -2, 1], "max": [4, 6, 6]})
WORLDS = [ROOM, NO_GOAL, flockstep.World.load("arena/hall")]

WEIGHTS = {"near_weight": 1.5, "spin_weight": 0.7, "change_weight": 0.3, "crash_weight": 4.0}
HOVER = flockstep.HoverConfig(
    start_rate_dps=90.0, max_distance_m=1.2, hold_m=0.6, hold_s=0.07, hold_weight=0.9, speed_weight=0.2, **WEIGHTS
)
TRACK = {"start_offset_m": 0.3, "points": 3, "close_m": 0.4, "close_weight": 0.9, "yaw_weight": 0.4, **WEIGHTS}
STILL = flockstep.HoverConfig(  # begins at the point, level and at rest, and has no distance limit
    start_offset_m=0.0, start_tilt_deg=0.0, start_speed_mps=0.0, start_rate_dps=0.0, max_distance_m=1e4
)
BOTH = pytest.mark.parametrize("config", [flockstep.HoverConfig(), flockstep.TrackConfig()], ids=["hover", "track"])
POLICY_HZ = 100  # of both tasks by default
ROUNDING = 5e-6  # of float32, for values computed from the same state
DRIFT = 1e-2  # after a one-second flight with commands that differ by rounding; yaw relative to the heading drifts most


def tracking(path, yaw):
    return flockstep.TrackConfig(path=path, yaw=yaw, **TRACK)


def make(config, num_envs=1, **keywords):
    envs = begun(num_envs, task=config, **{"worlds": ROOM, "policy_hz": POLICY_HZ, **keywords})
    return envs


def fields_of(config):
    return {name: getattr(config, name) for name in config.__match_args__}


def level(batch, position):
    """Put the drones at a position, level, facing along x, at rest."""
    batch.set_pose(np.broadcast_to(position, (batch.num_drones, 3)), np.tile([1, 0, 0, 0], (batch.num_drones, 1)))


def path_of(batch, steps=0):
    """Positions (N, 3) m of each drone's figure-8 after this many more steps; a lap takes its length over the speed."""
    config = flockstep.TrackConfig()
    turn = np.linspace(0, 2 * np.pi, 10_001)
    lap = config.size_m * np.stack([np.cos(turn), np.sin(2 * turn) / 2], axis=1)
    lap_s = np.linalg.norm(np.diff(lap, axis=0), axis=1).sum() / config.speed_mps
    a = 2 * np.pi * (batch.task_state["phase"].reshape(-1, 9)[:, 0] + (batch.steps + steps) / POLICY_HZ / lap_s)
    return GOAL + config.size_m * np.stack([np.cos(a), np.sin(2 * a) / 2, 0 * a], axis=1)


@pytest.fixture
def twin_of(example):
    hover, track = example("hover_numpy"), example("track_numpy")  # in this order: the latter imports the former

    def make_twin(config, **dynamics):
        twin = hover.Hover(config) if isinstance(config, flockstep.HoverConfig) else track.Track(config)
        twin.dynamics = flockstep.DynamicsConfig(motion="rotors", **dynamics)
        return twin

    return make_twin


class TestTwins:
    CASES = (
        *((HOVER, {"control": control}) for control in CONTROLS),
        (tracking("figure8", "fixed"), {"control": "body_rates"}),
        (tracking("figure8", "along"), {"control": "rotor_thrusts"}),
        (tracking("random", "fixed"), {"control": "attitude"}),
        (tracking("random", "along"), {"control": "position"}),
    )

    @pytest.mark.parametrize("case", range(len(CASES)))
    def test_agree(self, twin_of, case):
        """Compare with noise in the observed poses, non-default limits, and all kinds of episode ends."""
        config, dynamics = self.CASES[case]
        mode = ("next_step", "same_step", "disabled")[case % 3]
        dynamics = {**dynamics, "max_speed_mps": 3.0, "max_tilt_deg": 60.0, "max_rate_dps": 400.0}
        arguments = {
            "worlds": WORLDS,
            "drone": ("crazyflie", "kingfisher", "x500")[case % 3],
            "pose_sensor": flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=2.0),
            "autoreset_mode": mode,
            "max_episode_steps": 60,
            "stagger_first_episode": True,
            "random_world": True,
            "frame_skip": 1 + case % 2,
            "num_threads": 1,
        }
        engine = flockstep.DroneVectorEnv(24, task=config, **dynamics, **arguments)
        twin_task = twin_of(config, **dynamics)
        twin = flockstep.DroneVectorEnv(24, task=twin_task, **arguments)
        np.testing.assert_allclose(engine.reset(seed=0)[0], twin.reset(seed=0)[0], rtol=ROUNDING, atol=ROUNDING)
        rng, ways = np.random.default_rng(case), np.zeros(3, int)
        actions = np.zeros((24, 4))
        for _ in range(100):
            actions = 0.9 * actions + rng.normal(0, 0.2, (24, 4))  # sometimes beyond 1
            ours, theirs = engine.step(actions.astype(np.float32)), twin.step(actions.astype(np.float32))
            ended = ours[2] | ours[3]
            np.testing.assert_array_equal(ours[2], theirs[2])
            np.testing.assert_array_equal(ours[3], theirs[3])
            seen = twin_task.observe(engine.batch)
            np.testing.assert_allclose(engine.batch.observation, seen, rtol=ROUNDING, atol=ROUNDING)
            np.testing.assert_allclose(ours[0], theirs[0], atol=DRIFT)
            np.testing.assert_allclose(ours[1], theirs[1], atol=DRIFT)
            np.testing.assert_allclose(engine.batch.reward_terms, twin.batch.reward_terms, atol=DRIFT)
            assert ours[4].keys() == theirs[4].keys()
            if not ended.any():
                continue
            infos, expected = (s[4].get("final_info", s[4]) for s in (ours, theirs))
            for key in ("episode_length", "success", "crashed", "bad_state", "episode_end"):
                np.testing.assert_array_equal(infos[key], expected[key])
            np.testing.assert_allclose(infos["episode_return"], expected["episode_return"], atol=10 * DRIFT)
            if mode == "same_step":
                for a, b in zip(ours[4]["final_obs"][ended], theirs[4]["final_obs"][ended], strict=True):
                    np.testing.assert_allclose(a, b, atol=DRIFT)
            if mode == "disabled":
                options = {"reset_mask": ended}
                np.testing.assert_allclose(engine.reset(options=options)[0], twin.reset(options=options)[0], atol=DRIFT)
            ways += [infos["success"].sum(), (ours[3] & ~infos["success"]).sum(), ours[2].sum()]
        assert (ways[:2] > 0).all(), ways
        assert ways[2] > 0 or dynamics["control"] == "position", ways


def looks_even(values, low, high):
    """Test 20,000 values for a uniform distribution that reaches both limits, by Kolmogorov's distance."""
    shares = np.sort((np.asarray(values, float) - low) / (high - low))
    even = (np.arange(len(shares)) + 0.5) / len(shares)
    return shares[0] > -1e-5 and shares[-1] < 1 + 1e-5 and np.abs(shares - even).max() < 0.014


class TestHover:
    def test_starts(self):
        config = flockstep.HoverConfig(
            start_offset_m=0.7, start_tilt_deg=120.0, start_speed_mps=3.0, start_rate_dps=200.0
        )
        batch = make(config, 20_000).batch
        turn = Rotation.from_quat(batch.quat_wxyz, scalar_first=True)
        for axis in range(3):
            assert looks_even(batch.position[:, axis] - GOAL[axis], -0.7, 0.7)
            assert looks_even(np.degrees(batch.angular_velocity[:, axis]), -200, 200)
        up, ahead = turn.as_matrix()[:, :, 2], turn.as_matrix()[:, :, 0]
        assert looks_even(np.degrees(np.arccos(np.clip(up[:, 2], -1, 1))), 0, 120)
        assert looks_even(np.arctan2(up[:, 1], up[:, 0]), -np.pi, np.pi)
        assert looks_even(np.arctan2(ahead[:, 1], ahead[:, 0]), -np.pi, np.pi)
        speed = np.linalg.norm(batch.velocity, axis=1)
        assert looks_even(speed, 0, 3)
        assert looks_even(batch.velocity[:, 2] / speed, -1, 1)  # uniform on a sphere
        assert looks_even(np.arctan2(batch.velocity[:, 1], batch.velocity[:, 0]), -np.pi, np.pi)
        np.testing.assert_allclose(batch.rotor_speed, batch.drone.hover_speed_radps, rtol=1e-6)

    def test_starts_touch_nothing(self):
        config = flockstep.HoverConfig(start_offset_m=0.3, start_tilt_deg=30.0, start_speed_mps=0.0)
        batch = make(config, 1000, worlds=world_of(room={"min": [0, 0, 0], "max": [0.5, 0.5, 0.3]})).batch
        assert np.ptp(batch.position, axis=0) == pytest.approx([0.4, 0.4, 0.25], abs=0.05)
        assert len(np.unique(batch.position, axis=0)) == 1000
        batch.step(np.zeros((1000, 4), np.float32))
        assert not batch.contact.inside.any()

    def test_the_observation_does_not_depend_on_the_heading(self):
        """Two drones in the open with the same commands; one is rotated about the point by any angle."""
        n = 16
        envs = make(flockstep.HoverConfig(max_distance_m=1e4), 2 * n, worlds=OPEN)
        batch, rng = envs.batch, np.random.default_rng(0)
        yaw = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (n, 1)) * [0, 0, 1])
        turn = Rotation.from_quat(batch.quat_wxyz[:n], scalar_first=True)
        place, velocity = batch.position[:n].astype(float), batch.velocity[:n].copy()
        quats = np.concatenate([turn.as_quat(scalar_first=True), (yaw * turn).as_quat(scalar_first=True)])
        batch.set_pose(np.concatenate([place, yaw.apply(place)]), quats)
        rates = np.tile(rng.uniform(-3, 3, (n, 3)), (2, 1))
        batch.set_velocity(np.concatenate([velocity, yaw.apply(velocity)]), rates)
        for _ in range(50):
            observation, *_ = envs.step(np.tile(rng.uniform(-1, 1, (n, 4)).astype(np.float32), (2, 1)))
            np.testing.assert_allclose(observation[:n], observation[n:], atol=1e-3)
        assert np.ptp(observation[:n], axis=0).min() > 0.05  # the flights differ

    def test_success_is_to_have_held_the_point_to_the_end(self):
        config = flockstep.HoverConfig(hold_m=0.1, hold_s=0.05, max_distance_m=1.0)  # 5 steps
        at = 0.5 * np.ones((20, 6))  # m from the point in each step, by drone
        at[15:, 0] = 0.099  # never close enough
        at[14:, 1] = 0.101  # never near enough
        at[16:, 2] = 0.0  # one step too short
        at[:19, 3] = 0.0  # not at the end
        at[:, 4] = 0.0
        at[19, 4] = 1.1  # a crash in the last step
        at[:, 5] = 0.0
        envs = make(config, 6, max_episode_steps=20, autoreset_mode="disabled")
        for distances in at:
            level(envs.batch, GOAL + distances[:, None] * [0.6, 0, -0.8])
            _, _, terminated, truncated, infos = envs.step(np.zeros((6, 4), np.float32))
        assert infos["success"].tolist() == [True, False, False, False, False, True]
        assert terminated.tolist() == [False] * 4 + [True, False]
        assert truncated.tolist() == [True] * 4 + [False, True]

    @pytest.mark.parametrize(
        ("hold_s", "policy_hz", "steps"), [(0.3, 100, 30), (0.09, 100, 9), (1.0, 240, 240), (1e-4, 50, 1)]
    )
    def test_hold_s_is_counted_in_steps(self, hold_s, policy_hz, steps):
        config = flockstep.HoverConfig(**{**fields_of(STILL), "hold_s": hold_s})
        for limit in (steps, steps - 1):
            if limit > 0:
                envs = make(config, policy_hz=policy_hz, max_episode_steps=limit)
                for _ in range(limit):
                    *_, truncated, infos = envs.step(np.zeros((1, 4), np.float32))
                assert truncated[0]
                assert infos["success"][0] == (limit == steps)


class TestTrack:
    def begun(self, num_envs, **fields):
        """A batch, and the observed points relative to the middle, (N, points, 3) m."""
        batch = make(flockstep.TrackConfig(**fields), num_envs).batch
        ways = batch.observation[:, : 3 * fields["points"]].reshape(num_envs, -1, 3).astype(float)
        return batch, batch.position[:, None] + rotate(batch.quat_wxyz[:, None].astype(float), ways) - GOAL

    @pytest.mark.parametrize("yaw", ["fixed", "along"])
    def test_figure_8(self, yaw):
        """x = s cos a, y = s sin a cos a, so x^4 = s^2 (x^2 - y^2); a lap takes its length over the mean speed."""
        size, speed = 1.7, 2.3
        turn = np.linspace(0, 2 * np.pi, 10_001)
        lap = size * np.stack([np.cos(turn), np.sin(turn) * np.cos(turn)], axis=1)
        length = np.linalg.norm(np.diff(lap, axis=0), axis=1).sum()
        batch, seen = self.begun(
            200, size_m=size, speed_mps=speed, yaw=yaw, points=20, ahead_s=length / speed / 19, start_offset_m=0.0
        )
        x, y, z = np.moveaxis(seen, 2, 0)
        np.testing.assert_allclose(x**4, size**2 * (x**2 - y**2), atol=1e-4)
        np.testing.assert_allclose(z, 0, atol=1e-5)
        np.testing.assert_allclose(seen[:, 0], seen[:, 19], atol=1e-4)  # one lap later
        chords = np.linalg.norm(np.diff(seen, axis=1), axis=2).sum(axis=1)
        assert ((chords > 0.95 * length) & (chords < length)).all()  # not two laps
        np.testing.assert_allclose(seen[:, 0], batch.position - GOAL, atol=1e-5)
        farthest = seen[:, 0, 0].argmax()  # a is nearly 0 here
        assert batch.velocity[farthest, 1] > 0

    def test_random_paths(self):
        batch, seen = self.begun(20_000, path="random", size_m=1.3, speed_mps=2.0, points=2, ahead_s=50.0)
        for moment in range(2):
            assert np.abs(seen[:, moment]).max(axis=0) == pytest.approx([1.3, 1.3, 0.65], rel=0.05)
            assert (np.abs(seen[:, moment]).max(axis=0) < [1.3001, 1.3001, 0.6501]).all()
            np.testing.assert_allclose(seen[:, moment].mean(axis=0), 0, atol=0.02)
        # Each of nine waves has a mean square speed of half its maximum. An average over many phases equals one over a
        # long time.
        assert np.sqrt((batch.velocity.astype(float) ** 2).sum(axis=1).mean()) == pytest.approx(2.0, rel=0.01)

    @pytest.mark.parametrize("path", ["figure8", "random"])
    def test_velocity_is_that_of_the_path(self, path):
        batch, seen = self.begun(500, path=path, points=2, ahead_s=0.01, start_offset_m=0.0)
        flown = (seen[:, 1] - seen[:, 0]) / 0.01
        np.testing.assert_allclose(flown, batch.velocity, atol=0.15)  # allows acceleration times 5 ms
        np.testing.assert_allclose(flown.mean(axis=0), batch.velocity.mean(axis=0), atol=0.01)

    @pytest.mark.parametrize("yaw", ["fixed", "along"])
    def test_starts(self, yaw):
        batch = make(flockstep.TrackConfig(yaw=yaw, start_offset_m=0.2), 20_000).batch
        off = batch.position - path_of(batch)
        for axis in range(3):
            assert looks_even(off[:, axis], -0.2, 0.2)
        assert looks_even(batch.task_state["phase"].reshape(-1, 9)[:, 0], 0, 1)
        heading = np.arctan2(batch.velocity[:, 1], batch.velocity[:, 0]) if yaw == "along" else np.zeros(20_000)
        quat = np.stack([np.cos(heading / 2), 0 * heading, 0 * heading, np.sin(heading / 2)], axis=1)
        np.testing.assert_allclose(batch.quat_wxyz, quat, atol=1e-5)
        np.testing.assert_allclose(batch.observation[:, -2:], np.tile([0, 1], (20_000, 1)), atol=1e-5)
        np.testing.assert_array_equal(batch.angular_velocity, 0)

    def test_success_is_a_small_root_mean_square(self):
        """Distances alternate between 0 m and d, with a root mean square of d over the root of 2."""
        config = flockstep.TrackConfig()
        d = np.sqrt(2) * config.close_m * np.array([0.99, 1.01, 0.0, 0.5])
        envs = make(config, 4, max_episode_steps=20, autoreset_mode="disabled")
        for step in range(20):
            off = (step % 2) * d
            off[3] += 2 * config.max_distance_m * (step == 19)  # a crash in the last step
            level(envs.batch, path_of(envs.batch, 1) + off[:, None] * [0, 0, 1])
            _, _, terminated, _, infos = envs.step(np.zeros((4, 4), np.float32))
        assert infos["success"].tolist() == [True, False, True, False]
        assert terminated.tolist() == [False, False, False, True]


@BOTH
def test_an_episode_ends_as_a_crash_too_far_off_and_on_a_contact(config):
    config = copy.copy(config)
    config.max_distance_m, config.crash_weight = 2.0, 3.0
    envs = make(config, 3, autoreset_mode="disabled")
    middle = GOAL if isinstance(config, flockstep.HoverConfig) else path_of(envs.batch, 1)
    place = middle + np.array([[0, 0, 1.9], [0, 0, 2.1], [0, 0, 0]])
    place[2] = [21.9, 0, 4]  # one step before a wall
    level(envs.batch, place)
    envs.batch.set_velocity([[0, 0, 0], [0, 0, 0], [20, 0, 0]])
    _, _, terminated, truncated, infos = envs.step(np.zeros((3, 4), np.float32))
    assert terminated.tolist() == [False, True, True]
    assert not truncated.any()
    assert not infos["success"].any()
    assert infos["crashed"].tolist() == [False, False, True]  # only drones that touched something
    np.testing.assert_array_equal(envs.batch.reward_terms[:, -1], [0, -3, -3])


class TestActions:
    def env(self, control, num_envs=1, **keywords):
        return make(STILL, num_envs, worlds=OPEN, control=control, **keywords)

    @pytest.mark.parametrize("control", CONTROLS)
    @pytest.mark.parametrize("drone", ["crazyflie", "t650"])
    def test_zero_hovers(self, control, drone):
        envs = self.env(control, drone=drone)
        for _ in range(100):  # 1 s
            observation, *_ = envs.step(np.zeros((1, 4), np.float32))
        np.testing.assert_allclose(observation[0, :6], [0, 0, 0, 0, 0, 0], atol=0.01)
        np.testing.assert_allclose(observation[0, 6:], [0, 0, 1, *[0] * 7], atol=0.01)

    @pytest.mark.parametrize("control", ["attitude", "acceleration", "position"])
    def test_yaw_is_from_the_present_heading(self, control):
        envs = self.env(control, 2, drone="x500")
        for _ in range(20):
            envs.step(np.float32([[0, 0, 0, 0.5], [0, 0, 0, -0.5]]))
        rates = envs.batch.angular_velocity[:, 2]
        assert rates[0] > 0.3  # left
        assert rates[1] < -0.3

    @BOTH
    def test_bad_actions(self, config):
        envs = make(config, 2)
        before = envs.snapshot()
        for bad, expected in [(np.zeros((2, 3)), "shape"), (np.full((2, 4), np.nan), "finite")]:
            with refused(ValueError, "actions", expected):
                envs.step(bad.astype(np.float32))
        assert envs.snapshot() == before


BEYOND = {  # numbers out of the range of their field
    **dict.fromkeys(("start_speed_mps", "start_rate_dps", "ahead_s"), (-0.1,)),
    **dict.fromkeys(("max_distance_m", "hold_m", "hold_s", "close_m"), (0, -1)),
    **dict.fromkeys(("size_m", "speed_mps"), (0, -1, 1001)),
    **{"start_offset_m": (-0.1, 1001), "start_tilt_deg": (-0.1, 180.1), "points": (0, 21)},
}


class TestBadInput:
    @BOTH
    def test_numbers(self, config):
        assert fields_of(flockstep.HoverConfig()).keys() | fields_of(flockstep.TrackConfig()).keys() > BEYOND.keys()
        for name, value in fields_of(config).items():
            not_finite = [(bad, []) for bad in (np.nan, np.inf, -np.inf, 1e39) if isinstance(value, float)]
            for bad, said in [*not_finite, *((bad, [bad]) for bad in BEYOND.get(name, ()))]:
                broken = copy.copy(config)
                setattr(broken, name, bad)
                with refused(ValueError, f"task.{name}", *said):
                    flockstep.DroneVectorEnv(1, task=broken)

    @pytest.mark.parametrize(("field", "known"), [("path", ("figure8", "random")), ("yaw", ("fixed", "along"))])
    def test_names(self, field, known):
        with refused(ValueError, field, *known, "straight"):
            flockstep.TrackConfig(**{field: "straight"})

    @BOTH
    def test_drones_must_fly(self, config):
        for control in ({}, {"control": "pose"}, {"control": "velocity"}):  # kinematic motion supports none of these
            with refused(ValueError, "motion", "rotors", "kinematic"):
                flockstep.DroneVectorEnv(1, task=config, motion="kinematic", **control)
        with refused(ValueError, "control", *CONTROLS, "pose"):
            flockstep.DroneVectorEnv(1, task=config, control="pose")
        with refused(ValueError, "drone"):
            flockstep.DroneVectorEnv(1, task=config, drone=flockstep.DroneModel(flockstep.DroneModel().hull))
        with refused(TypeError, "random_start"):
            flockstep.DroneVectorEnv(1, task=config, random_start=True)


HALL = {"flockstep_scene": 1, "name": "odd", "room": {"min": [0, 0, 0], "max": [8, 8, 4]}}
BLOCK = {"boxes": [{"center": [4, 4, 2], "size": [2, 2, 2]}]}


class TestWorlds:
    """Worlds in which no episode can be flown."""

    def refuses(self, config, scene, *said, **keywords):
        world = flockstep.World.from_dict({**HALL, **scene})
        with refused(ValueError, 'world "odd"', *said):
            flockstep.DroneVectorEnv(1, task=config, worlds=world, **keywords)

    @BOTH
    def test_a_middle_that_is_solid(self, config):
        expected = "room for the drone", "where it touches an obstacle"
        self.refuses(config, BLOCK, "the middle (markers.goal sets another point)", *expected)
        marked = {"markers": {"goal": [3.2, 4, 2]}}
        self.refuses(config, {**BLOCK, **marked}, "markers.goal", *expected)
        beside = flockstep.World.from_dict({**HALL, **BLOCK, "markers": {"goal": [1.5, 1.5, 2]}})
        make(config, worlds=beside)

    @BOTH
    def test_a_room_that_the_hull_does_not_fit(self, config):
        small = {"room": {"min": [0, 0, 0], "max": [0.4, 0.4, 0.4]}}
        self.refuses(config, small, "the middle", "room for the drone", drone="t650")
        self.refuses(config, {"markers": {"goal": [4, 4, 5]}}, "markers.goal", "within the world")

    def test_a_path_that_leaves_the_room_or_meets_an_obstacle(self):
        eight = flockstep.TrackConfig(size_m=1.5)
        path = "the path about its middle (task.size_m sets its size)"
        self.refuses(eight, {"room": {"min": [0, 0, 0], "max": [2.5, 9, 4]}}, path, "within the world")
        pillar = {"pillars": [{"center": [5.5, 4], "radius": 0.2}]}
        self.refuses(eight, pillar, path, "room for the drone")
        make(flockstep.TrackConfig(size_m=1.0), worlds=flockstep.World.from_dict({**HALL, **pillar}))

    def test_random_paths_that_leave_the_room(self):
        world = flockstep.World.from_dict(HALL)
        make(flockstep.TrackConfig(path="random", size_m=3.9), worlds=world)
        with refused(ValueError, "task.size_m", "odd"):
            make(flockstep.TrackConfig(path="random", size_m=4.1), worlds=world)

    @BOTH
    def test_a_world_without_a_room_has_no_end(self, config):
        make(config, worlds=world_of(**BLOCK, markers={"goal": [40, 4, 2]}))


def flown(envs, steps, first=0):
    """Results of `steps` steps, with actions that depend only on env and step."""
    rows = []
    for step in range(first, first + steps):
        actions = [np.random.default_rng([i, step]).uniform(-1, 1, 4) for i in range(envs.num_envs)]
        observation, reward, terminated, truncated, _ = envs.step(np.array(actions, np.float32))
        flags = np.stack([terminated, truncated, envs.batch.success], axis=1)
        rows.append(np.concatenate([observation, reward[:, None], envs.batch.reward_terms, flags], axis=1))
    return np.array(rows)


def shaken(config, num_envs=6, **keywords):
    arguments = {"max_episode_steps": 15, "worlds": WORLDS, "random_world": True, **keywords}
    envs = begun(num_envs, task=config, **arguments, seed=4)
    return envs


class TestRepeats:
    @BOTH
    def test_for_any_threads_and_number_of_envs_and_from_a_snapshot_or_a_pickle(self, config):
        settings = {"drone": "x500", "control": "velocity", "num_threads": 1}
        envs, other = shaken(config, **settings), shaken(config, **settings)
        first = flown(envs, 20)
        other.restore(envs.snapshot())
        copied = pickle.loads(pickle.dumps(envs))
        expected = flown(envs, 30, 20)
        for each in (other, copied):
            np.testing.assert_array_equal(flown(each, 30, 20), expected)
        envs.restore(shaken(config, **settings).snapshot())
        for each in (envs, shaken(config, **settings | {"num_threads": 2}), shaken(config, 70, **settings)):
            np.testing.assert_array_equal(flown(each, 50)[:, :6], [*first, *expected])

    @BOTH
    def test_a_snapshot_of_another_configuration_is_refused(self, config):
        for name, value in fields_of(config).items():
            changed = copy.copy(config)
            setattr(changed, name, {"figure8": "random", "fixed": "along"}.get(value) or value + 1)
            with refused(ValueError, "snapshot", "task"):
                shaken(config, 1).restore(shaken(changed, 1).snapshot())

    @pytest.mark.parametrize(
        ("name", "config"), [("Hover", HOVER), ("Track", tracking("random", "along"))], ids=["hover", "track"]
    )
    def test_after_a_spec_in_json(self, name, config):
        env = gymnasium.make(f"flockstep/{name}-v0", task=config, drone="x500", policy_hz=50)
        assert env.observation_space.shape == ((16,) if name == "Hover" else (15 + 3 * config.points,))
        text = env.unwrapped.spec.to_json()
        again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(text))
        assert again.unwrapped.spec.to_json() == text
        for each in (env, again):
            each.reset(seed=3)
        for _ in range(10):
            action = env.action_space.sample()
            np.testing.assert_array_equal(env.step(action)[0], again.step(action)[0])


@pytest.mark.parametrize(("name", "control"), [("Hover", "rotor_thrusts"), ("Track", "body_rates")])
def test_ids(name, control):
    envs = gymnasium.make_vec(f"flockstep/{name}-v0", num_envs=3)
    config = getattr(flockstep, f"{name}Config")()
    by_config = flockstep.DroneVectorEnv(3, task=config, worlds="arena/hall", drone="crazyflie", control=control)
    np.testing.assert_array_equal(envs.reset(seed=0)[0], by_config.reset(seed=0)[0])
    assert envs.unwrapped.batch.drone.name == "crazyflie"
    np.testing.assert_array_equal(flown(envs.unwrapped, 10), flown(by_config, 10))
