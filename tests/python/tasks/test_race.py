"""Race: the engine's task against its NumPy twin, crossings by hand, the shipped tracks and the generator."""

import gymnasium
import numpy as np
import pytest
from conftest import placed, world_of
from messages import refused
from twins import ESTIMATE, fly_beside

import flockstep
from flockstep.rotations import rotate

TRACKS = ("race/figure-8", "race/split-s", "race/warehouse")
LANE = world_of(
    room={"min": [-30, -10, 0], "max": [30, 10, 10]}, gates=[{"center": [x, 0, 5], "solid": False} for x in (0, 4)]
)
LOOP = world_of(
    room={"min": [-10, -10, 0], "max": [10, 10, 10]},
    gates=[  # counter-clockwise
        {"center": [1.6, 0, 5], "quat_wxyz": [0.5**0.5, 0, 0, 0.5**0.5], "solid": False},
        {"center": [0, 1.6, 5], "quat_wxyz": [0, 0, 0, 1], "shape": "ring", "solid": False},
        {"center": [-1.6, 0, 5], "quat_wxyz": [0.5**0.5, 0, 0, -(0.5**0.5)], "solid": False},
        {"center": [0, -1.6, 5], "solid": False},
    ],
)
OPEN = world_of(gates=[{"center": [0, 0, 5]}, {"center": [8, 0, 5], "shape": "ring"}])
ROUNDING = 5e-6  # of float32, for values computed from the same state
DRIFT = 1e-2  # after a flight of less than a second with commands that differ by rounding


def make(num_envs=1, worlds=LANE, **keywords):
    envs = flockstep.DroneVectorEnv(num_envs, task=flockstep.RaceConfig(), worlds=worlds, **keywords)
    envs.reset(seed=0)
    return envs


def still(num_envs=1):
    return np.zeros((num_envs, 4), np.float32)


def level(batch, position, velocity=(0, 0, 0)):
    """Put the drones at a position, level, facing along x."""
    n = batch.num_drones
    batch.set_pose(np.broadcast_to(position, (n, 3)), np.tile([1, 0, 0, 0], (n, 1)))
    batch.set_velocity(np.broadcast_to(velocity, (n, 3)))


def towards_gates(batch, speed):
    """Velocities (N, 3) from the drones to points behind their next gates."""
    aims = []
    for world, target in zip(batch.world_index, batch.task_state["target"], strict=True):
        gate = batch.worlds[world].gates[target]
        aims.append(gate["center"] + rotate(np.array(gate["quat_wxyz"]), np.array([0.3, 0, 0])))
    way = aims - batch.position
    return speed * way / np.linalg.norm(way, axis=1, keepdims=True)


class TestTwin:
    # With these small offsets no start touches a frame; the twin does not draw starts again.
    CASES = (
        flockstep.RaceConfig(
            start_offset_m=0.2,
            laps=1,
            cap_success=0.2,
            cap_rise_mps=3.0,
            cap_episodes=5,
            speed_cap_mps=(2.0, 16.0),
            crash_weight=2.5,
        ),
        flockstep.RaceConfig(
            start_offset_m=0.2, gates_ahead=3, start="gate", observation_scale=0.5, change_weight=0.3, rates_weight=0.2
        ),
        flockstep.RaceConfig(
            start_offset_m=0.2, laps=1, gates_ahead=1, max_distance_m=9.5, miss_m=1.5, cap_success=0.0, gate_weight=2.0
        ),
    )

    @pytest.mark.parametrize("case", range(len(CASES)))
    def test_agree(self, example, case):
        """Compare with errors in the observed poses and velocities, several tracks, and all kinds of episode ends."""
        race, config = example("race_numpy"), self.CASES[case]
        mode = ("next_step", "same_step", "disabled")[case]
        arguments = {
            "worlds": [LOOP, flockstep.World.race_track(case), *map(flockstep.World.load, TRACKS[:2])],
            "pose_sensor": ESTIMATE,
            "autoreset_mode": mode,
            "max_episode_steps": 40,
            "random_world": True,
            "frame_skip": 1 + case % 2,
            "num_threads": 1,
        }
        engine = flockstep.DroneVectorEnv(40, task=config, **arguments)
        twin_task = race.Race(config)
        twin = flockstep.DroneVectorEnv(40, task=twin_task, **arguments)
        rng, ends, passed = np.random.default_rng(case), np.zeros(len(flockstep.EpisodeEnd), int), 0
        actions = np.zeros((40, 4))

        def actions_of(_):
            velocity = towards_gates(engine.batch, 16)
            # Every second drone is steered through all gates, the others only from their starts.
            mask = (engine.batch.steps == 0) | (np.arange(40) % 2 == 0)
            for envs in (engine, twin):
                envs.batch.set_velocity(velocity, None, None, mask)
            actions[:] = 0.9 * actions + rng.normal(0, 0.1, (40, 4))
            return actions.astype(np.float32)

        for _, ended in fly_beside(engine, twin, actions_of, 200, atol=DRIFT, rewards={"atol": 5e-5}):
            seen = twin_task.observe(engine.batch)
            np.testing.assert_allclose(engine.batch.observation, seen, rtol=ROUNDING, atol=ROUNDING)
            state = engine.batch.task_state
            for name in ("target", "passed"):
                np.testing.assert_array_equal(state[name], getattr(twin_task, name))
            # After an episode the engine changes these when the next one begins, the twin at once.
            history = twin_task.clean @ (1 << np.arange(config.cap_episodes))
            np.testing.assert_array_equal(state["history"][~ended], history[~ended])
            np.testing.assert_allclose(state["speed_cap"][~ended], twin_task.speed_cap[~ended], rtol=1e-6)
            passed += engine.batch.reward_terms[:, 1].astype(bool).sum()
            ends += np.bincount(engine.batch.episode_end[ended], minlength=len(ends))
        kinds = flockstep.EpisodeEnd
        assert passed > 40
        assert ends[kinds.contact] > 2
        assert ends[kinds.task] > 2  # misses
        assert ends[kinds.success] > 2 or config.laps > 1
        assert ends[kinds.left_area] > 0 or config.max_distance_m > 10
        assert (twin_task.speed_cap > config.speed_cap_mps[0]).any() or config.laps > 1


class TestEpisodes:
    def test_the_environment(self):
        envs = gymnasium.make_vec("flockstep/Race-v0", 4, laps=2)
        assert envs.unwrapped.batch.worlds[0].name == "race/figure-8"
        assert envs.unwrapped.batch.drone.name == "racer5"
        assert envs.single_observation_space.shape == (25,)
        envs.close()

    def test_the_thrust_is_limited(self):
        for most, expected in ((4.0, 4.0), (2.0, 2.0), (100.0, None)):
            envs = make(worlds=OPEN, max_thrust_to_weight=most, max_distance_m=1e4, autoreset_mode="disabled")
            level(envs.batch, (-5, 5, 5))
            for _ in range(25):
                envs.step(np.float32([[1, 0, 0, 0]]))
            upward = envs.batch.acceleration[0, 2] / 9.81 + 1
            frame = envs.batch.drone
            assert upward == pytest.approx(expected or 4 * frame.max_thrust_n / frame.mass_kg / 9.81, rel=0.03)


class TestStarts:
    @pytest.mark.parametrize("track", TRACKS)
    @pytest.mark.parametrize("start", ["between", "gate"])
    def test_touch_nothing(self, track, start):
        envs = make(3000, worlds=track, start=start, start_offset_m=0.7)
        envs.batch.step(still(3000))
        assert not envs.batch.contact.inside.any()


def test_bad_configurations_are_refused():
    with refused(ValueError, "task.speed_cap_mps", "5.000000", "4.000000"):
        make(speed_cap_mps=(5.0, 4.0))
    with refused(ValueError, 'world "arena/hall"', 2, 0):
        make(worlds="arena/hall")
    with refused(ValueError, "control", "body_rates"):
        make(control="attitude")


def frames(world):
    """Centres, normals and sizes of a world's gates."""
    gates = world.gates
    quats = np.array([gate["quat_wxyz"] for gate in gates])
    centers = np.array([gate["center"] for gate in gates], float)
    return centers, rotate(quats, np.array([1.0, 0, 0])), np.array([gate["size_m"] for gate in gates])


def test_the_builder_adds_gates():
    builder = flockstep.WorldBuilder("mine")
    material = builder.material("gate", (0.9, 0.3, 0.1))
    builder.gate((0, 0, 2), material)
    builder.gate((5, 0, 2), material, (0, 0, 0, 1), shape="ring", size_m=2, bar_m=0.2, solid=False)
    first, second = builder.build().gates
    assert (first["center"].tolist(), first["visible"]) == ([0, 0, 2], True)
    assert (first["shape"], first["solid"], first["material"]) == ("square", True, "gate")
    assert (first["size_m"], first["bar_m"]) == (1.5, pytest.approx(0.1))
    assert second["quat_wxyz"] == (0, 0, 0, 1)
    assert (second["shape"], second["size_m"], second["solid"]) == ("ring", 2, False)
    with refused(ValueError, "shape", "square", "ring", "oval"):
        builder.gate((0, 0, 2), material, shape="oval")


@pytest.mark.parametrize("track", TRACKS)
def test_shipped_tracks(track):
    """The straight way from gate to gate is free, and no gate lies in the miss zone of the next."""
    world = flockstep.World.load(track)
    centers, normals, sizes = frames(world)
    ways = np.roll(centers, -1, axis=0) - centers
    lengths = np.linalg.norm(ways, axis=1)
    assert lengths.min() >= 4
    assert lengths.max() < 12
    # Someone who leaves a gate forwards does not cross the plane of the next one within its miss zone.
    beyond = ((np.roll(centers, 1, axis=0) - centers) * normals).sum(axis=1)
    is_apart = np.roll(lengths, 1) - np.roll(sizes, 1) / 2 > 3
    assert ((beyond < -1) | is_apart).all()
    batch = placed([world], centers, np.tile([1, 0, 0, 0], (len(centers), 1)), drone="racer5")
    following = np.roll(centers, -1, axis=0)
    for place in (centers + 0.8 * normals, following - 0.8 * np.roll(normals, -1, axis=0), following):
        assert not batch.move(place).hit.any()


class TestGenerator:
    def test_promises(self):
        """Spacing, turns and climbs of many tracks; no gate is in the miss zone of the next; the ways are free."""
        for seed in range(60):
            world = flockstep.World.race_track(seed, gates=4 + seed % 9, size_m=(30, 24, 9))
            centers, normals, _ = frames(world)
            assert len(centers) == 4 + seed % 9
            ways = np.roll(centers, -1, axis=0) - centers
            lengths = np.linalg.norm(ways, axis=1)
            assert lengths.min() > 4.49
            assert lengths.max() < 12.01
            level_ways = ways[:, :2] / np.linalg.norm(ways[:, :2], axis=1, keepdims=True)
            np.testing.assert_allclose(normals[:, 2], 0, atol=1e-6)
            for adjacent in (level_ways, np.roll(level_ways, 1, axis=0)):
                assert ((adjacent * normals[:, :2]).sum(axis=1) > np.cos(np.radians(60.1))).all()
            assert (np.abs(ways[:, 2]) < 0.401 * np.linalg.norm(ways[:, :2], axis=1)).all()
            beyond = ((np.roll(centers, 1, axis=0) - centers) * normals).sum(axis=1)
            assert beyond.max() < -2
            batch = placed([world], centers, np.tile([1, 0, 0, 0], (len(centers), 1)), drone="racer5")
            assert not batch.move(np.roll(centers, -1, axis=0)).hit.any()
            assert world.start is not None
            assert world.goal is not None

    def test_races_start_in_many(self):
        envs = make(60, worlds=[flockstep.World.race_track(seed) for seed in range(30)])
        envs.step(still(60))
        assert not envs.batch.contact.inside.any()

    def test_rings(self):
        def share(rings):
            gates = [gate for seed in range(20) for gate in flockstep.World.race_track(seed, rings=rings).gates]
            return np.mean([gate["shape"] == "ring" for gate in gates])

        assert share(0.0) == 0
        assert share(1.0) == 1
        assert 0.3 < share(0.5) < 0.7

    def test_the_same_arguments_make_the_same_world(self):
        first = flockstep.World.race_track(3)
        assert first.to_dict() == flockstep.World.race_track(3).to_dict()
        assert first.to_dict() != flockstep.World.race_track(4).to_dict()
        assert flockstep.World.load("race_track/seed-3").to_dict() == first.to_dict()
        # Computed with correctly rounded operations, so it is the same on every machine.
        centers = np.array([gate["center"] for gate in first.gates])
        np.testing.assert_allclose(centers.astype(float).sum(axis=0), CENTERS_OF_SEED_3, atol=1e-4)

    @pytest.mark.parametrize(
        ("fields", "said"),
        [
            ({"gates": 3}, ("gates", 4, 20, 3)),
            ({"rings": 1.5}, ("rings", 0, 1, 1.5)),
            ({"gate_size_m": 1.0}, ("gate_size_m", 1.2, 2, 1)),
            ({"size_m": (11, 20, 8)}, ("size_m[0]", 12, 200, 11)),
            ({"size_m": (12, 12, 4), "gates": 20}, ("gates", "12 x 12 x 4 m", 20)),
        ],
    )
    def test_bad_arguments_are_refused(self, fields, said):
        with refused(ValueError, "race_track", *said):
            flockstep.World.race_track(0, **fields)


CENTERS_OF_SEED_3 = (80.99, 74.13, 24.9)
