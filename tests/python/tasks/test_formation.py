"""The formation task: its places, its leader, its ends, and the same task in NumPy."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from twins import both, fly_beside

import flockstep
from flockstep import EpisodeEnd

SHAPES = ("line", "column", "v", "circle")
NOISE = flockstep.PoseSensorConfig(position_noise_std_m=0.01, orientation_noise_std_deg=2.0)
ROOM = world_of(
    room={"min": [-12, -12, 0], "max": [12, 12, 4]},
    boxes=[{"center": [0, -3, 2], "size": [1, 12, 4]}],
    markers={"start": [-6, -6, 1.5], "goal": [6, -6, 1.5], "radius": 0.2},
)


def make(num_envs=3, config=None, **keywords):
    envs = flockstep.DroneVectorEnv(num_envs, task=config or flockstep.FormationConfig(), **keywords)
    envs.reset(seed=0)
    return envs


def to_places(observation, step_m=0.15):
    """Actions that fly to where the places will be."""
    fastest = np.sqrt(3) * step_m / 0.1
    return (2 * observation[:, :3] + 0.1 * fastest * observation[:, 3:6]) / step_m


def places(envs, observation):
    """The places of all drones, (N, 3) m."""
    offset = 2 * observation[:, :3].astype(float)
    return envs.batch.position + flockstep.rotations.rotate(envs.batch.quat_wxyz.astype(float), offset)


def flown_places(envs, step_m=0.15):
    """Fly to the places until the first episode ends; return all places (1 + steps, N, 3)."""
    observation = envs.observation().copy()
    found = [places(envs, observation)]
    ended = False
    while not ended:
        observation, _, terminated, truncated, _ = envs.step(to_places(observation, step_m))
        found.append(places(envs, observation))
        assert not terminated.any()
        ended = truncated.any()
    return np.array(found)


class TestPlaces:
    @pytest.mark.parametrize("shape", SHAPES)
    @pytest.mark.parametrize("count", [1, 2, 5, 12])
    def test_neighbours_are_spaced(self, shape, count):
        places = flockstep.formation_places(shape, count, 1.5)
        assert places.shape == (count, 3)
        assert not places[:, 2].any()
        with_leader = np.concatenate([np.zeros((1, 3)), places])
        apart = np.linalg.norm(with_leader[:, None] - with_leader, axis=2) + 99 * np.eye(count + 1)
        assert apart.min() == pytest.approx(1.5, abs=1e-5)
        least = apart[1:].min(axis=1)
        assert (least < 1.5001).all()

    def test_have_their_shapes(self):
        places = {shape: flockstep.formation_places(shape, 4, 2.0) for shape in SHAPES}
        np.testing.assert_allclose(places["line"][:, :2], [[0, 2], [0, -2], [0, 4], [0, -4]], atol=1e-6)
        np.testing.assert_allclose(places["column"][:, :2], [[-2, 0], [-4, 0], [-6, 0], [-8, 0]], atol=1e-6)
        diagonal = np.float64([[-1, 1], [-1, -1], [-2, 2], [-2, -2]])
        np.testing.assert_allclose(places["v"][:, :2], np.sqrt(2) * diagonal, atol=1e-6)
        np.testing.assert_allclose(places["circle"][:, :2], [[2, 0], [0, 2], [-2, 0], [0, -2]], atol=1e-6)

    def test_bad_input_is_refused(self):
        with refused(ValueError, "shape", "w"):
            flockstep.formation_places("w", 3)
        with refused(ValueError, "count", 0, -1):
            flockstep.formation_places("v", -1)
        with refused(ValueError, "spacing_m", 0):
            flockstep.formation_places("v", 3, float("nan"))


class TestLeader:
    def test_drones_that_fly_to_their_places_hold_them(self):
        envs = make(config=flockstep.FormationConfig(spacing_m=1.2), max_episode_steps=300, autoreset_mode="disabled")
        observation = envs.observation().copy()
        for step in range(300):
            observation, _, terminated, truncated, infos = envs.step(to_places(observation))
            assert step < 40 or 2 * np.linalg.norm(observation[:, :3], axis=1).max() < 0.05
        assert truncated.all()
        assert not terminated.any()
        assert infos["success"].all()
        assert (infos["episode_end"] == EpisodeEnd.success).all()

    def test_drones_that_go_on_after_the_end_of_another_one_may_succeed(self):
        config = flockstep.FormationConfig(spacing_m=1.2, max_distance_m=50.0)
        envs = make(1, config, episodes="last", autoreset_mode="disabled", max_episode_steps=60)
        place = envs.batch.position.copy()
        place[3, 2] = 0.3
        envs.batch.set_pose(place, envs.batch.quat_wxyz)
        observation = envs.observation().copy()
        ends = np.zeros(4, int)
        for _ in range(60):
            action = to_places(observation)
            action[3] = [0, 0, -1]
            observation, _, terminated, truncated, _ = envs.step(action)
            ended = terminated | truncated
            ends[ended] = envs.batch.episode_end[ended]
        assert ends.tolist() == [EpisodeEnd.success] * 3 + [EpisodeEnd.contact]

    @pytest.mark.parametrize(
        ("worlds", "config"),
        [
            (None, flockstep.FormationConfig(spacing_m=1.2)),
            (None, flockstep.FormationConfig(shape="column")),
            (ROOM, flockstep.FormationConfig(route="path", spacing_m=1.2)),
        ],
    )
    def test_the_observed_velocity_leads_to_the_place_one_step_later(self, worlds, config):
        envs = make(2, config, worlds=worlds or "arena/hall", autoreset_mode="disabled")
        observation = envs.observation().copy()
        for step in range(150):
            observation, _, terminated, _, _ = envs.step(to_places(observation))
            assert not terminated.any()
            assert step < 10 or 2 * np.abs(observation[:, :3]).max() < 1e-4

    def test_a_path_leads_around_obstacles_to_the_goal_and_ends_there(self):
        config = flockstep.FormationConfig(route="path", shape="column", spacing_m=1.2)
        envs = make(2, config, worlds=ROOM, autoreset_mode="disabled", max_episode_steps=600)
        observation = envs.observation().copy()
        starts = places(envs, observation)
        np.testing.assert_allclose(starts[:4, 2], 1.5, atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(starts[3] - ROOM.start), 0.4, atol=0.01)
        flown = flown_places(envs)
        ends = flown[-1, :4]
        np.testing.assert_allclose(np.linalg.norm(ends[0] - ROOM.goal), 1.6, atol=0.07)
        wide = [[1.1 * x, 1.1 * y, z] for x, y, z in envs.batch.drone.hull]
        path = flockstep.plan(ROOM, ROOM.start, [ROOM.goal], drone=flockstep.DroneModel(wide))
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert len(flown) - 1 == pytest.approx((length - 4 * 1.2 - 2 * 0.4) / 0.06, rel=0.05)
        assert envs.batch.success.all()

    def test_a_world_without_a_path_is_refused(self):
        walled = flockstep.World.from_dict(
            ROOM.to_dict() | {"boxes": [{"center": [0, 0, 2], "size": [1, 24, 4]}], "name": "walled"}
        )
        config = flockstep.FormationConfig(route="path")
        with refused(ValueError, "worlds", 'world "walled'):
            make(worlds=walled, config=config)
        with refused(ValueError, "worlds"):
            make(worlds=ROOM, config=flockstep.FormationConfig(loop_radius_m=9.0))


def wide_room(length=60.0, width=60.0, gap=2.0):
    """A room with a wall across, and a gap in its middle."""
    side = (width - gap) / 2
    boxes = [{"center": [0, sign * (gap + side) / 2, 2], "size": [1, side, 4]} for sign in (-1, 1)]
    return world_of(
        room={"min": [-length / 2, -width / 2, 0], "max": [length / 2, width / 2, 4]},
        boxes=boxes,
        markers={"start": [1 - length / 2, 0, 2], "goal": [length / 2 - 1, 0, 2], "radius": 0.2},
    )


class TestRoom:
    """A formation on a path becomes a column where its shape has no room."""

    @pytest.mark.parametrize("shape", SHAPES)
    @pytest.mark.parametrize("count", [2, 3, 4, 7, 16, 32])
    def test_a_gap_makes_it_a_column_that_stays_apart(self, shape, count):
        spacing, speed = 1.5, 1.2
        world = wide_room(length=60 + 3 * spacing * count)
        config = flockstep.FormationConfig(
            shape=shape, spacing_m=spacing, route="path", leader_speed_mps=speed, jitter_m=0, step_m=0.5
        )
        drone = flockstep.DroneModel.load("crazyflie")
        envs = make(1, config, worlds=world, drones_per_env=count, drone=drone, max_episode_steps=5000)
        flown = flown_places(envs, step_m=0.5)
        assert envs.batch.success.all()
        apart = np.linalg.norm(flown[:, :, None] - flown[:, None], axis=3) + 99 * np.eye(count)
        least = 0.7 * spacing
        assert apart.min() > least - 1e-4
        # At both ends it has its shape, and in the gap it is a column.
        offsets = flockstep.formation_places(shape, count, spacing)
        for ends in (flown[0], flown[-1]):
            np.testing.assert_allclose(ends - ends[0], offsets - offsets[0], atol=1e-3)
        through = np.abs(flown[:, :, 0]) < 0.5
        assert np.abs(flown[through][:, 1]).max() < 1.0 - 0.1
        assert through.any(axis=0).all()
        # No place moves faster than twice the leader.
        speeds = np.linalg.norm(np.diff(flown, axis=0), axis=2) / 0.1
        assert speeds.max() < 2 * speed + 1e-3

    @pytest.mark.parametrize(("kind", "count"), [("playground", 12), ("warehouse", 2)])
    def test_all_places_in_generated_worlds_are_free(self, kind, count):
        for seed in range(7_000_000, 7_000_000 + count):
            generated = getattr(flockstep.World, kind)(seed)
            # At a waypoint a path may turn back, and the drones of a column then come near each other.
            for world in (generated, generated.with_markers(start=generated.start, goal=generated.goal)):
                config = flockstep.FormationConfig(route="path", jitter_m=0)
                envs = make(1, config, worlds=world, interaction="none", max_episode_steps=5000)
                checked = flockstep.Batch([world], 4)
                observation, ended, nearest = envs.observation().copy(), False, np.inf
                while not ended:
                    found = places(envs, observation)
                    assert checked.is_free(found, envs.batch.quat_wxyz).all()
                    apart = np.linalg.norm(found[:, None] - found, axis=2) + 99 * np.eye(4)
                    nearest = min(nearest, apart.min())
                    observation, _, terminated, truncated, _ = envs.step(to_places(observation))
                    assert not terminated.any()
                    ended = truncated.any()
                assert envs.batch.success.all()
            assert nearest > 0.7 * 1.5 - 1e-3

    def test_a_path_shorter_than_the_column_is_refused(self):
        config = flockstep.FormationConfig(route="path", spacing_m=8.0)
        with refused(ValueError, "worlds", "24.800000"):
            make(worlds=ROOM, config=config)
        config = flockstep.FormationConfig(shape="column", spacing_m=4.0)
        with refused(ValueError, "spacing_m", "14.400001 m"):
            make(config=config)


class TestObservation:
    def test_the_task_has_its_defaults(self):
        envs = make(2)
        assert (envs.num_groups, envs.drones_per_env, envs.num_envs) == (2, 4, 8)
        assert envs.recipe.interaction == "both"
        assert (envs.batch.lidar().ranges < 4).any()  # drones see each other


@pytest.mark.parametrize(
    ("mode", "config", "worlds"),
    [
        ("next_step", flockstep.FormationConfig(jitter_m=0.6, close_m=0.1), None),
        ("same_step", flockstep.FormationConfig(shape="circle", neighbors=2, close_m=0.5), None),
        ("same_step", flockstep.FormationConfig(shape="column", neighbors=2), None),
        ("disabled", flockstep.FormationConfig(route="path", leader_speed_mps=4.0, shape="line"), [ROOM]),
    ],
)
def test_the_engine_and_numpy_agree(example, mode, config, worlds):
    keywords = {"drones_per_env": 3, "autoreset_mode": mode, "pose_sensor": NOISE, "max_episode_steps": 45}
    lidar = flockstep.DroneVectorEnv(1, task=config, worlds=worlds).lidar
    task = example("formation_numpy").Formation(config, lidar)
    engine, twin = both(6, config, task, worlds=worlds or "arena/hall", **keywords)
    rng, steps, ends = np.random.default_rng(0), iter(range(120)), np.zeros(len(EpisodeEnd), int)

    def actions_of(observation):
        wild = 0.3 + (next(steps) % 60 > 45)
        return to_places(observation) + rng.normal(0, wild, (18, 3)).astype(np.float32)

    def observed(ours, theirs):
        np.testing.assert_allclose(ours[..., :33], theirs[..., :33], atol=2e-4)
        share = 0.01 if ours.ndim > 1 else 0.05  # of rays that pass a hull on the other side of its edge
        assert np.mean(np.abs(ours - theirs) > 2e-3) < share

    for _, ended in fly_beside(engine, twin, actions_of, 120, atol=2e-4, begin=1e-4, observed=observed):
        terms = [envs.batch.reward_terms[:, [0, 1, 3]] for envs in (engine, twin)]  # "near" is made of ranges
        np.testing.assert_allclose(*terms, atol=1e-3)
        ends += np.bincount(engine.batch.episode_end[ended], minlength=len(EpisodeEnd))
    assert ends.sum() > 10
    assert mode != "next_step" or 0 < ends[EpisodeEnd.success] < ends.sum()
