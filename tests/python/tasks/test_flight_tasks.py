"""Hover and track: the engine's tasks against their NumPy twins, closed forms and hand-computed numbers."""

import gymnasium
import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused
from rigid_body import CONTROLS, OPEN
from twins import ESTIMATE, fly_beside

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


@pytest.fixture
def twin_of(example):
    hover, track = example("hover_numpy"), example("track_numpy")

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
        """Compare with errors in observed poses and velocities, non-default limits, and all kinds of episode ends."""
        config, dynamics = self.CASES[case]
        mode = ("next_step", "same_step", "disabled")[case % 3]
        dynamics = {**dynamics, "max_speed_mps": 3.0, "max_tilt_deg": 60.0, "max_rate_dps": 400.0}
        arguments = {
            "worlds": WORLDS,
            "drone": ("crazyflie", "kingfisher", "x500")[case % 3],
            "pose_sensor": ESTIMATE,
            "autoreset_mode": mode,
            "max_episode_steps": 60,
            "stagger_first_episode": True,
            "random_world": True,
            "frame_skip": 1 + case % 2,
            "num_threads": 1,
        }
        twin_task = twin_of(config, **dynamics)
        engine = flockstep.DroneVectorEnv(24, task=config, **dynamics, **arguments)
        twin = flockstep.DroneVectorEnv(24, task=twin_task, **arguments)
        rng, ways = np.random.default_rng(case), np.zeros(3, int)
        actions = np.zeros((24, 4))

        def actions_of(_):  # sometimes beyond 1
            actions[:] = 0.9 * actions + rng.normal(0, 0.2, (24, 4))
            return actions.astype(np.float32)

        for ours, ended in fly_beside(engine, twin, actions_of, 100, atol=DRIFT, rewards={"atol": 1e-3}):
            seen = twin_task.observe(engine.batch)
            np.testing.assert_allclose(engine.batch.observation, seen, rtol=ROUNDING, atol=ROUNDING)
            if ended.any():
                infos, expected = (ours[4].get("final_info", ours[4])["episode_return"], twin.batch.episode_return)
                np.testing.assert_allclose(infos[ended], expected[ended], atol=10 * DRIFT)
                success = engine.batch.success & ended
                ways += [success.sum(), (ours[3] & ~success).sum(), ours[2].sum()]
        assert (ways[:2] > 0).all(), ways
        assert ways[2] > 0 or dynamics["control"] == "position", ways


class TestHover:
    def test_starts_touch_nothing(self):
        config = flockstep.HoverConfig(start_offset_m=0.3, start_tilt_deg=30.0, start_speed_mps=0.0)
        batch = make(config, 1000, worlds=world_of(room={"min": [0, 0, 0], "max": [0.5, 0.5, 0.3]})).batch
        assert np.ptp(batch.position, axis=0) == pytest.approx([0.4, 0.4, 0.25], abs=0.05)
        assert len(np.unique(batch.position, axis=0)) == 1000
        batch.step(np.zeros((1000, 4), np.float32))
        assert not batch.contact.inside.any()

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

    @BOTH
    def test_bad_actions(self, config):
        envs = make(config, 2)
        before = envs.snapshot()
        for bad, expected in [(np.zeros((2, 3)), "shape"), (np.full((2, 4), np.nan), "finite")]:
            with refused(ValueError, "actions", expected):
                envs.step(bad.astype(np.float32))
        assert envs.snapshot() == before


class TestBadInput:
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


@pytest.mark.parametrize(("name", "control"), [("Hover", "rotor_thrusts"), ("Track", "body_rates")])
def test_ids(name, control):
    envs = gymnasium.make_vec(f"flockstep/{name}-v0", num_envs=3)
    config = getattr(flockstep, f"{name}Config")()
    by_config = flockstep.DroneVectorEnv(3, task=config, worlds="arena/hall", drone="crazyflie", control=control)
    np.testing.assert_array_equal(envs.reset(seed=0)[0], by_config.reset(seed=0)[0])
    assert envs.unwrapped.batch.drone.name == "crazyflie"
    np.testing.assert_array_equal(flown(envs.unwrapped, 10), flown(by_config, 10))
