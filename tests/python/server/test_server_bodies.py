"""Bodies over the server: the same as the calls of a batch in this process, and what is refused."""

import json

import numpy as np
import pytest
from clients import Raw, served
from messages import refused
from test_client_vector_env import both

import flockstep
from flockstep import BodyConfig, BodyMotion
from flockstep.client import ServerError
from flockstep.client import protocol as pb
from flockstep.client.protocol import Request

NAMES = ("active", "position", "quat_wxyz", "velocity", "angular_velocity", "scripted")
DOOR = BodyConfig(
    name="door",
    size_m=[1, 0.1, 2],
    position_m=[5, 2, 1],
    color=[0.1, 0.7, 0.3],
    visibility="visual",
    motion=BodyMotion(kind="hinge", center_m=[5.5, 2, 0], period_s=3.3, random_phase=True),
)
ROUTE = BodyConfig(
    shape="capsule", motion=BodyMotion(kind="waypoints", points_m=[[1 + k / 97, 2.1, 1.5] for k in range(100)])
)
BALL = BodyConfig(name="ball", shape="sphere", size_m=[0.3, 0.3, 0.3], position_m=[6, 6, 2], semantic=7)
LIDAR = flockstep.LidarConfig(name="scan", beams=36)


def make(room, num_drones=4, bodies=(DOOR,), max_bodies=3, **keywords):
    batch = flockstep.Batch([room], num_drones, lidar=LIDAR, bodies=bodies, max_bodies=max_bodies, **keywords)
    batch.set_pose(np.tile(np.float32([2, 4, 2]), (num_drones, 1)))
    return batch


@pytest.fixture
def batch(room):
    return make(room)


@pytest.fixture
def client(server, connect):
    with connect(server.address) as client:
        yield client


def arrays_of(client):
    arrays = client.get_arrays([f"body_{name}" for name in NAMES])
    return [arrays[f"body_{name}"] for name in NAMES]


def assert_same(client, twin):
    for name, got in zip(NAMES, arrays_of(client), strict=True):
        np.testing.assert_array_equal(got, getattr(twin.bodies, name), err_msg=name)


def test_the_calls_are_those_of_the_batch(client, batch, room):
    twin = make(room)
    assert_same(client, twin)
    some = np.array([True, False, True, True])
    at = np.random.default_rng(0).uniform(1, 3, (4, 3))
    tilted = np.float32([[0.6, 0.8, 0, 0]] * 4)
    for call in (
        lambda spawn: spawn(BALL, mask=some),
        lambda spawn: spawn(ROUTE),
        lambda spawn: spawn(BALL, at, tilted, at / 2, at / 3, mask=[False, True, False, False]),
    ):
        slots = call(client.spawn_bodies)
        np.testing.assert_array_equal(slots, call(twin.bodies.spawn))
        assert slots.dtype == np.int64
        assert_same(client, twin)
    for _ in range(3):
        client.set_poses(twin.position)
        twin.move(twin.position)
    assert_same(client, twin)
    random = np.random.default_rng(1)
    position, quats = random.uniform(1, 7, (4, 3, 3)), np.tile(tilted[:, None], (1, 3, 1))
    mask = random.random((4, 3)) < 0.5
    assert client.set_body_poses(position, quats, mask=mask).num_envs == 4
    twin.bodies.set_pose(position, quats, mask)
    client.set_body_poses(quat_wxyz=quats, mask=some)
    twin.bodies.set_pose(quat_wxyz=quats, mask=some)
    assert_same(client, twin)
    client.set_body_velocities(position, mask=mask)
    twin.bodies.set_velocity(position, mask=mask)
    client.set_body_velocities(angular_velocity=-position)
    twin.bodies.set_velocity(angular_velocity=-position)
    client.set_poses(twin.position)
    twin.move(twin.position)
    client.sense()
    twin.sense()
    assert_same(client, twin)
    np.testing.assert_array_equal(client.get_arrays(["ranges"], sensor="scan")["ranges"], twin.lidar("scan").ranges)
    client.remove_bodies(mask)
    twin.bodies.remove(mask)
    assert_same(client, twin)
    client.remove_bodies([False, False, True, False])
    assert not batch.bodies.active[2].any()
    assert batch.bodies.active[0].any()
    client.remove_bodies()
    assert not batch.bodies.active.any()


def test_configurations(client, batch):
    client.spawn_bodies(ROUTE, mask=[False, True, False, False])
    client.spawn_bodies(BALL, mask=[False, True, True, False])
    assert client.get_body_configs() == [
        [DOOR, None, None],
        [DOOR, ROUTE, BALL],
        [DOOR, BALL, None],
        [DOOR, None, None],
    ]
    assert client.get_body_configs([2, 1]) == [[DOOR, BALL, None], [DOOR, ROUTE, BALL]]
    expected = [[batch.bodies.config(env, body) for body in range(3)] for env in range(4)]
    assert client.get_body_configs() == expected
    assert client.get_body_configs(np.array([3])) == expected[3:]


def test_a_mesh(room, connect):
    builder = flockstep.WorldBuilder("wedge")
    material = builder.material("red", (0.7, 0.1, 0.1))
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    builder.mesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], material)
    wedge = BodyConfig(shape="mesh", mesh=builder.build(), position_m=[5, 5, 1])
    batch = make(room)
    with served(batch, connect) as client:
        client.spawn_bodies(wedge)
        assert batch.bodies.config(0, 1) == wedge
        assert client.get_body_configs()[0][1] == wedge


def test_the_server_tells_the_rows_of_arrays(client, room, connect):
    assert client.info.bodies_per_env == 3
    rows = client.info.array_rows
    assert set(rows) == set(client.info.array_names)
    sizes = {"drone": (4,), "env": (4,), "body": (4, 3)}
    for name, array in client.get_arrays(list(rows)).items():
        expected = sizes[rows[name]]
        assert array.shape[: len(expected)] == expected, name
    assert rows["position"] == "drone"
    assert rows["body_position"] == "body"
    with served(make(room, bodies=(), max_bodies=0), connect) as without:
        assert without.info.bodies_per_env == 0
        assert not any(name.startswith("body_") for name in without.info.array_names)


def test_bad_values_change_nothing(client, batch, room):
    client.spawn_bodies(BALL, mask=[False, False, True, False])
    client.spawn_bodies(BALL, mask=[False, False, True, False])
    twin = make(room)
    for _ in range(2):
        twin.bodies.spawn(BALL, mask=np.array([False, False, True, False]))
    before, places = batch.snapshot(), batch.bodies.position.copy()
    far, nan = np.zeros((4, 3, 3)), np.zeros((4, 3))
    far[2, 1, 0] = 2e6
    nan[1, 2] = np.nan
    zeros = np.zeros((4, 3, 4))
    for remote, local, arguments, keywords in (
        (client.spawn_bodies, twin.bodies.spawn, (BALL,), {}),
        (client.spawn_bodies, twin.bodies.spawn, (BALL, nan), {}),
        (client.set_body_poses, twin.bodies.set_pose, (), {"position": far}),
        (client.set_body_poses, twin.bodies.set_pose, (), {"quat_wxyz": zeros}),
        (client.set_body_velocities, twin.bodies.set_velocity, (), {"velocity": far}),
        (client.set_body_velocities, twin.bodies.set_velocity, (), {"angular_velocity": far}),
    ):
        with refused(ValueError, "env") as expected:
            local(*arguments, **keywords)
        with pytest.raises(ServerError) as caught:
            remote(*arguments, **keywords)
        assert caught.value.code == "INVALID_ARGUMENT"
        assert str(expected.value) in str(caught.value)
    for call, arguments, error, field in (
        (client.get_body_configs, ([4],), ServerError, "env"),
        (client.get_body_configs, ([-1],), ServerError, "env"),
        (client.get_body_configs, ([0] * 5,), ServerError, "envs"),
        (client.get_body_configs, ([],), ValueError, "envs"),
        (client.set_body_poses, (np.zeros((4, 2, 3)),), ServerError, "position"),
        (client.set_body_poses, (np.zeros((12, 3)),), ValueError, "position"),
        (client.set_body_velocities, (np.zeros((3, 3, 3)),), ServerError, "velocity"),
        (client.spawn_bodies, (BALL, np.zeros((3, 3))), ServerError, "position"),
        (client.spawn_bodies, (BALL, [1, 2, 3]), ValueError, "position"),
        (client.spawn_bodies, (BALL, "here"), TypeError, "position"),
        (client.spawn_bodies, ({"name": "ball"},), TypeError, "body"),
        (client.remove_bodies, ([True],), ServerError, "mask"),
        (client.remove_bodies, (np.ones((4, 2), bool),), ServerError, "mask"),
        (client.remove_bodies, ([1, 0, 0, 0],), ValueError, "mask"),
    ):
        with refused(error, field) as caught:
            call(*arguments)
        assert getattr(caught.value, "code", "INVALID_ARGUMENT") == "INVALID_ARGUMENT"
    assert batch.snapshot() == before
    np.testing.assert_array_equal(batch.bodies.position, places)


def test_a_batch_without_bodies_refuses_all(room, connect):
    batch = make(room, bodies=(), max_bodies=0)
    with served(batch, connect) as client:
        for call in (
            lambda: client.spawn_bodies(BALL, np.zeros((4, 3)), mask=[True] * 4),
            lambda: client.remove_bodies([True] * 4),
            lambda: client.set_body_poses(np.zeros((4, 0, 3))),
            lambda: client.set_body_velocities(),
            lambda: client.get_body_configs(),
        ):
            with refused(ServerError, "no slots for bodies", "max_bodies=1") as caught:
                call()
            assert caught.value.code == "INVALID_ARGUMENT"
        client.ping()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "config_json: expected a JSON object"),
        ("{", "config_json"),
        ("[1]", "config_json: expected an object"),
        ("null", "config_json: expected an object"),
        ('{"colour": [1, 0, 0]}', "config_json.colour: expected one of name, shape, "),
        ('{"size_m": [1, 2]}', "config_json.size_m: expected an array of 3"),
        ('{"size_m": [1, 2, -1]}', "config_json.size_m"),
        ('{"size_m": [1, 2, NaN]}', "config_json"),
        ('{"motion": {"kind": "teleport"}}', "config_json.motion.kind: expected one of velocity, "),
        ('{"shape": "sphere", "size_m": [1, 2, 1]}', "size_m"),
        ('{"motion": {"kind": "waypoints"}}', "points_m"),
        ("[" * 60000, "config_json"),
    ],
)
def test_configurations_are_checked(server, batch, text, message):
    with Raw(server) as raw:
        error = raw.ask(Request(id=2, spawn_bodies=pb.SpawnBodies(config_json=text))).error
        assert error.code == pb.Code.INVALID_ARGUMENT
        assert message in error.text
        assert len(error.text) < 2000
        done = raw.ask(Request(id=3, spawn_bodies=pb.SpawnBodies(config_json='{"name": "fine"}')))
        assert done.time.num_envs == 4
    assert batch.bodies.config(0, 1) == BodyConfig(name="fine")
    assert batch.bodies.config(0, 2) is None


def test_messages_are_checked(server):
    spawn, remove = {"spawn_bodies": pb.SpawnBodies(config_json="{}")}, {"remove_bodies": pb.RemoveBodies()}
    poses, velocities = {"set_body_poses": pb.SetBodyPoses()}, {"set_body_velocities": pb.SetBodyVelocities()}
    for request, name, array, text in (
        (spawn, "places", np.zeros((4, 3), np.float32), "arrays: expected"),
        (spawn, "mask", np.ones((4, 1), np.bool_), "mask: expected shape"),
        (remove, "mask", np.ones((4, 3, 1), np.bool_), "mask: expected shape (4, 3)"),
        (remove, "mask", np.ones((4, 3), np.uint8), "mask: expected values of type"),
        (remove, "mask", np.full(4, 2, np.uint8).view(np.bool_), "mask: expected flags"),
        (poses, "velocity", np.ones((4, 3, 3), np.float32), "arrays: expected position"),
        (poses, "position", np.ones((12, 3), np.float32), "position: expected shape (4, 3, 3)"),
        (velocities, "velocity", np.ones((4, 3, 3)), "velocity: expected values"),
        ({"get_body_configs": pb.GetBodyConfigs()}, "mask", np.ones(4, np.bool_), "arrays: expected"),
    ):
        with Raw(server) as raw:
            error = raw.ask(Request(id=2, **request), **{name: array}).error
            assert text in error.text, error.text
    with Raw(server) as raw:
        error = raw.ask(Request(id=2, set_body_poses=pb.SetBodyPoses()), position=np.zeros((9, 3, 9), np.float32)).error
        assert error.code == pb.Code.RESOURCE_EXHAUSTED
        assert "at most 348 bytes" in error.text
        assert raw.is_closed()
    with Raw(server) as raw:  # not UTF-8
        message = Request(id=2, spawn_bodies=pb.SpawnBodies(config_json='{"name": "?"}')).SerializeToString()
        message = message.replace(b"?", b"\xff")
        raw.send_header(message)
        error = raw.reply().error
        assert error.code == pb.Code.INVALID_ARGUMENT
        assert "config_json: expected UTF-8" in error.text


def test_a_long_configuration_is_one_message(server, batch):
    points = [[1 + k / 1000, 2.0, 1.0] for k in range(2000)]
    text = json.dumps({"motion": {"kind": "waypoints", "points_m": points}})
    assert 1024 < len(text) < 65000
    with Raw(server) as raw:
        assert raw.ask(Request(id=2, spawn_bodies=pb.SpawnBodies(config_json=text))).time.num_envs == 4
    assert batch.bodies.config(3, 1).motion.points_m == np.float32(points).tolist()


def test_ownership(room, connect):
    batch = make(room, 8, drones_per_env=2, bodies=(DOOR, BALL))
    with (
        flockstep.serve(batch, port=0, ownership=True) as server,
        connect(server.address) as owner,
        connect(server.address) as other,
    ):
        owner.claim([3])  # of env 1
        bodies = np.zeros((4, 3), bool)
        bodies[1, 1] = True
        for call in (
            lambda: other.spawn_bodies(BALL),
            lambda: other.spawn_bodies(BALL, mask=[False, True, False, False]),
            lambda: other.remove_bodies(),
            lambda: other.remove_bodies(bodies),
            lambda: other.set_body_poses(np.ones((4, 3, 3)), mask=bodies),
            lambda: other.set_body_velocities(np.ones((4, 3, 3)), mask=[True, True, False, False]),
        ):
            with refused(ServerError, "drone 3 is claimed") as caught:
                call()
            assert caught.value.code == "PERMISSION_DENIED"
        others = [True, False, True, True]
        assert other.spawn_bodies(BALL, mask=others).tolist() == [2, -1, 2, 2]
        other.set_body_poses(np.ones((4, 3, 3)), mask=~bodies & np.array(others)[:, None])
        other.remove_bodies(others)
        assert other.get_body_configs([1]) == [[DOOR, BALL, None]]
        assert owner.spawn_bodies(BALL, mask=[False, True, False, False]).tolist() == [-1, 2, -1, -1]
        assert batch.bodies.active.tolist() == [[False] * 3, [True] * 3, [False] * 3, [False] * 3]


@pytest.mark.parametrize("capture_mode", ["on_demand", "on_movement", "every_step"])
def test_cameras_see_a_change(room, connect, capture_mode):
    camera = {"name": "eye", "width_px": 24, "height_px": 16, "outputs": ["depth"]}
    camera = flockstep.CameraConfig(**camera, capture_mode=capture_mode)
    batch = make(room, 1, bodies=(), max_bodies=1, cameras=[camera])
    wall = BodyConfig(size_m=[0.5, 2, 2], position_m=[3, 4, 2])
    with served(batch, connect) as client:

        def depth():
            if capture_mode != "on_demand":
                client.sense()
            return client.drone(0).get_camera_data(format="raw", output="depth").image

        empty = depth()
        assert empty.min() == pytest.approx(1.75, abs=0.01)
        client.spawn_bodies(wall)
        near = depth()
        assert near.min() == pytest.approx(0.75)
        client.set_body_poses([[[5, 4, 2]]])
        far = depth()
        assert far.min() == empty.min()  # the pillar before it
        assert (far < empty).any()
        client.remove_bodies()
        np.testing.assert_array_equal(depth(), empty)
        batch.bodies.spawn(wall)  # by the program
        np.testing.assert_array_equal(depth(), near)


def test_streams_see_a_change(client, batch):
    stream = client.subscribe_arrays(["body_active"], rate_hz=100, only_new=True)
    assert next(stream)["body_active"].sum() == 4
    for change, count in ((lambda: client.spawn_bodies(BALL), 8), (batch.bodies.remove, 0)):
        change()
        client.sense()
        while next(stream)["body_active"].sum() != count:
            pass
    stream.close()


def test_a_batch_that_grows(client, batch):
    assert client.spawn_drone().index == 4
    assert client.spawn_bodies(BALL, np.full((5, 3), 2)).tolist() == [1, 1, 1, 1, 1]
    client.set_body_poses(np.full((5, 3, 3), 3), mask=np.ones((5, 3), bool))
    np.testing.assert_array_equal(batch.bodies.position[:, :2], np.full((5, 2, 3), 3))
    assert client.get_body_configs([4]) == [[DOOR, BALL, None]]
    with refused(ServerError, "position"):
        client.set_body_poses(np.zeros((4, 3, 3)))


def test_the_batch_of_a_remote_env(closet):
    keywords = {"worlds": closet, "bodies": [BALL], "max_bodies": 2, "max_episode_steps": 5}
    with both(3, **keywords) as (local, remote):
        for envs in (local, remote):
            envs.reset(seed=1)
        here, there = local.batch.bodies, remote.batch.bodies
        assert len(there) == len(here) == 2
        mask = np.array([True, False, True])
        at = np.full((3, 2, 3), 0.5)
        for bodies in (here, there):
            assert bodies.spawn(ROUTE, velocity=at[:, 0], mask=mask).tolist() == [1, -1, 1]
            bodies.set_pose(at, mask=mask)
            bodies.set_velocity(at)
            bodies.remove(np.array([[True, False]] * 3))
            assert [bodies.config(0, body) for body in range(2)] == [None, ROUTE]
            first = np.array([True, False, False])
            assert bodies.spawn(BALL, mask=first).tolist() == [0, -1, -1]
            with refused(ValueError, "env 0"):
                bodies.spawn(BALL, mask=first)
            for place in ((3, 0), (0, 2), (-1, 0), (0, -1)):
                with refused(ValueError, "env" if place[0] in (3, -1) else "body", 0):
                    bodies.config(*place)
        for _ in range(8):  # into the next episode
            actions = local.action_space.sample()
            np.testing.assert_array_equal(local.step(actions)[1], remote.step(actions)[1])
            for name in NAMES:
                np.testing.assert_array_equal(getattr(there, name), getattr(here, name), err_msg=name)
