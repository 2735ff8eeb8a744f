"""Every operation of the clients, with a server in this process, against the batch itself."""

import io
import itertools
import re
import threading
import time

import numpy as np
import pytest
from conftest import ROOM
from PIL import Image

import flockstep
from flockstep import rotations
from flockstep.client import Angles, ServerError

LIDAR = flockstep.LidarConfig(name="scan", beams=9, channels=2, hfov_deg=120, vfov_deg=20, max_range_m=5)
CAMERA = flockstep.CameraConfig(
    name="eye", width_px=16, height_px=12, outputs=["rgb", "depth"], capture_mode="on_demand"
)
PILLAR = (4, 4.5, 2)
START = np.float32([[2, 4, 2], [2, 4.5, 2], [3, 2, 1], [6, 6, 3]])


def make(room, **keywords):
    batch = flockstep.Batch([room], 4, lidar=LIDAR, cameras=[CAMERA], **keywords)
    batch.set_pose(START)
    batch.sense()
    return batch


@pytest.fixture
def batch(room):
    return make(room)


@pytest.fixture
def client(batch, connect):
    with flockstep.serve(batch, port=0) as server, connect(server.address) as connected:
        yield connected


def test_what_the_server_tells_of_itself(batch, client):
    info = client.info
    assert info.version == flockstep.__version__
    assert (info.num_envs, info.drones_per_env, info.num_drones) == (4, 1, 4)
    assert (info.lidars, info.cameras, info.imus) == (("scan",), ("eye",), ())
    assert (info.flies_by_rotors, info.has_task) == (False, False)
    assert info.step_s == pytest.approx(1 / batch.clock.policy_hz)
    assert info.client > 0
    assert {"position", "quat_wxyz", "active"} <= set(info.array_names)
    client.ping()


def test_get_drones_and_claims(client, batch, connect):
    drones = client.get_drones()
    assert [(drone.index, drone.env, drone.owner) for drone in drones] == [(i, i, 0) for i in range(4)]
    drones[1].claim()
    client.claim([2, np.int64(3)])
    me = client.info.client
    assert [drone.owner for drone in client.get_drones()] == [0, me, me, me]
    drones[1].release()
    client.release([2, 0])
    assert [drone.owner for drone in client.get_drones()] == [0, 0, 0, me]
    assert repr(drones[1]).endswith("Drone 1>")
    with pytest.raises(ServerError) as caught:
        client.claim([99])
    assert caught.value.code == "NOT_FOUND"


def test_ownership(room, connect):
    with (
        flockstep.serve(make(room), port=0, ownership=True) as server,
        connect(server.address) as one,
        connect(server.address) as other,
    ):
        one.drone(0).claim()
        with pytest.raises(ServerError, match="claimed") as caught:
            other.drone(0).set_location((2, 4, 2.1))
        assert caught.value.code == "PERMISSION_DENIED"
        other.drone(1).set_location((2, 4.6, 2))
        one.close()
        end = time.monotonic() + 10
        while other.get_drones()[0].owner != 0 and time.monotonic() < end:
            time.sleep(0.01)
        other.drone(0).set_location((2, 4, 2.1))


def test_location_and_rotation(client, batch, room):
    other = make(room)
    drone = client.drone(0)
    np.testing.assert_array_equal(drone.get_location(), START[0])
    goal = (6.0, 4.3, 2.0)  # behind the pillar
    impact = drone.set_location(goal)
    contact = other.move(np.float32([goal, *START[1:]]), mask=np.array([True, False, False, False]))
    assert impact.hit
    assert contact.hit[0]
    assert impact.fraction == contact.fraction[0]
    np.testing.assert_array_equal(impact.location, other.position[0])
    np.testing.assert_array_equal(impact.quat_wxyz, other.quat_wxyz[0])
    np.testing.assert_array_equal(impact.point, contact.point[0])
    np.testing.assert_array_equal(impact.normal, contact.normal[0])
    np.testing.assert_array_equal(drone.get_location(), batch.position[0])
    np.testing.assert_array_equal(batch.position, other.position)

    free = client.drone(3).set_location((6, 6, 2.5))
    assert (free.hit, free.fraction, free.point, free.normal) == (False, 1.0, None, None)
    assert not drone.set_location(goal, teleport=True).hit
    np.testing.assert_array_equal(batch.position[0], np.float32(goal))


def test_rotations(client, batch):
    drone = client.drone(3)
    impact = drone.set_rotation(Angles(yaw_deg=90, pitch_deg=10, roll_deg=-20))
    expected = rotations.quat_from_rpy(np.deg2rad([-20, 10, 90]))
    np.testing.assert_allclose(impact.quat_wxyz, expected, atol=1e-6)
    rotation = drone.get_rotation()
    np.testing.assert_array_equal(rotation.quat_wxyz, batch.quat_wxyz[3])
    np.testing.assert_allclose(rotation.angles, (-20, 10, 90), atol=1e-4)
    drone.set_rotation((2, 0, 0, 0), teleport=True)  # of any length
    np.testing.assert_array_equal(batch.quat_wxyz[3], [1, 0, 0, 0])
    impact = drone.set_location_and_rotation((6, 6, 2), expected)
    np.testing.assert_array_equal(impact.location, np.float32([6, 6, 2]))
    np.testing.assert_allclose(batch.quat_wxyz[3], expected, atol=1e-6)
    impact = drone.set_location_and_rotation((6, 6, 3), Angles(), teleport=True)
    np.testing.assert_array_equal(batch.quat_wxyz[3], [1, 0, 0, 0])
    assert impact.location[2] == 3


def test_bad_arguments_are_refused(client, batch):
    drone = client.drone(0)
    before = batch.position.copy()
    for bad, error, text in (
        ((1, 2), ValueError, r"location: expected shape \(3,\), got \(2,\)"),
        ("here", TypeError, "location: expected numbers, got 'here'"),
        ((1, 2, np.nan), ValueError, r"location: expected finite numbers, got \[1.0, 2.0, nan\]"),
    ):
        with pytest.raises(error, match=text):
            drone.set_location(bad)
    with pytest.raises(ValueError, match=r"rotation: expected shape \(4,\)"):
        drone.set_rotation((1, 2, 3))
    with pytest.raises(ServerError, match="rotation"):
        drone.set_rotation((0, 0, 0, 0))
    with pytest.raises(ServerError, match="drone: expected the index of an active drone, got 9") as caught:
        client.drone(9).get_location()
    assert caught.value.code == "NOT_FOUND"
    with pytest.raises(ValueError, match="mode: expected 'every_step', 'on_movement', 'on_demand', got 'never'"):
        client.set_camera_capture_mode("never")
    with pytest.raises(ValueError, match="format: expected 'jpeg', 'png', 'raw', got 'gif'"):
        drone.get_camera_data(format="gif")
    with pytest.raises(ValueError, match="quality: expected an integer from 1 to 100, got 0"):
        drone.get_camera_data(quality=0)
    with pytest.raises(TypeError, match="names: expected a list of names, got 'position'"):
        client.get_arrays("position")
    with pytest.raises(ValueError, match=r"mask: expected bools of shape \(N,\), got int64 \(4,\)"):
        client.set_poses(START, mask=[1, 0, 0, 1])
    with pytest.raises(ValueError, match=r"position: expected shape \(N, 3\), got \(3,\)"):
        client.set_poses((1, 2, 3))
    with pytest.raises(ServerError, match="position"):
        client.set_poses(START[:2])
    with pytest.raises(ServerError, match="names"):
        client.get_arrays(["nothing"])
    with pytest.raises(ServerError, match="nothing"):
        client.get_arrays(["ranges"], sensor="nothing")
    np.testing.assert_array_equal(batch.position, before)


def test_camera_data(client, batch):
    drone = client.drone(2)
    raw = drone.get_camera_data(format="raw")
    batch.capture()
    image = np.asarray(batch.camera("eye").rgb[2])
    np.testing.assert_array_equal(raw.image, image)
    assert (raw.width_px, raw.height_px) == (16, 12)
    depth = drone.get_camera_data("eye", format="raw", output="depth").image
    np.testing.assert_array_equal(depth.reshape(12, 16), batch.camera("eye").depth[2].reshape(12, 16))
    png = drone.get_camera_data(format="png")
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(bytes(png))).convert("RGB")), image)
    assert isinstance(png.image, bytes)
    files = [drone.get_camera_data(quality=quality).image for quality in (10, 95)]
    assert len(files[0]) < len(files[1])
    for file in files:
        opened = Image.open(io.BytesIO(file))
        assert (opened.format, opened.size) == ("JPEG", (16, 12))
    with pytest.raises(ServerError, match="output"):
        drone.get_camera_data(output="depth")
    with pytest.raises(ServerError, match=r'output: expected an output of camera "eye" \(rgb, depth\), got "semantic"'):
        drone.get_camera_data(format="raw", output="semantic")
    with pytest.raises(ServerError, match="nothing"):
        drone.get_camera_data("nothing")


def test_the_file_of_a_still_camera_follows_every_change(room, connect):
    """The server keeps the files of pictures that stand still."""
    camera = flockstep.CameraConfig(name="eye", width_px=16, height_px=12, capture_mode="on_demand")
    body = flockstep.BodyConfig(size_m=(0.5, 0.5, 0.5), position_m=(4, 3.5, 2))
    batch = flockstep.Batch([room], 4, drones_per_env=4, interaction="sense", cameras=[camera], max_bodies=1)
    batch.set_pose(START)
    snapshots = []
    with flockstep.serve(batch, port=0) as server, connect(server.address) as client:

        def files():
            found = [bytes(client.drone(0).get_camera_data()) for _ in range(2)]
            batch.capture()
            assert found[0] == found[1] == batch.camera("eye").jpeg(0)
            return found[0]

        seen = [files()]
        for change in (
            lambda: client.set_light(gamma=2),
            lambda: (client.set_light(envs=[0], gamma=3), snapshots.append(batch.snapshot())),
            lambda: client.spawn_bodies(body),
            lambda: client.set_body_poses(position=np.float32([[[4, 3.7, 2]]])),
            lambda: client.drone(3).set_location((3, 4.3, 2), teleport=True),
            lambda: client.drone(3).remove(),
            lambda: client.drone(0).set_camera_config(hfov_deg=60),
            lambda: client.drone(0).set_location((2, 4.2, 2), teleport=True),
            lambda: (client.drone(0).remove(), client.spawn_drone((2, 4.1, 2))),
            lambda: batch.restore(snapshots[0]),
        ):
            change()
            seen.append(files())
        assert [one == other for one, other in itertools.pairwise(seen)] == [False] * 10
        assert bytes(client.drone(0).get_camera_data(quality=10)) == batch.camera("eye").jpeg(0, 10)


def test_camera_settings(client, batch):
    assert client.get_camera_capture_mode() == "on_demand"
    client.set_camera_capture_mode("every_step", "eye")
    assert client.get_camera_capture_mode("eye") == "every_step"
    settings = client.drone(0).get_camera_config()
    assert (settings.width_px, settings.height_px, [*settings.outputs]) == (16, 12, ["rgb", "depth"])
    assert settings.hfov_deg == pytest.approx(90)
    assert (settings.near_m, settings.far_m) == pytest.approx((CAMERA.near_m, CAMERA.far_m))
    client.drone(1).set_camera_config(hfov_deg=50, offset_m=(0.1, 0, 0), quat_wxyz=(0.5, 0.5, 0.5, 0.5))
    assert client.drone(0).get_camera_config().hfov_deg == settings.hfov_deg
    changed = client.drone(1).get_camera_config("eye")
    assert changed.hfov_deg == pytest.approx(50)
    np.testing.assert_allclose(changed.offset_m, [0.1, 0, 0])
    np.testing.assert_allclose(changed.quat_wxyz, [0.5] * 4)
    client.set_camera_config(hfov_deg=70)
    assert [client.drone(i).get_camera_config().hfov_deg for i in range(4)] == pytest.approx([70] * 4)


def test_lidar_data(client, batch):
    drone = client.drone(2)
    data = drone.get_lidar_data()
    ranges = np.asarray(batch.lidar("scan").ranges[2]).reshape(2, 9)
    np.testing.assert_array_equal(data.ranges, ranges)
    assert data.directions.shape == (2, 9, 3)
    np.testing.assert_allclose(np.linalg.norm(data.directions, axis=-1), 1, atol=1e-6)
    np.testing.assert_array_equal(data.origin, START[2])
    np.testing.assert_array_equal(data.quat_wxyz, [1, 0, 0, 0])
    world = batch.worlds[0]
    hits = world.raycast(np.broadcast_to(data.origin, (18, 3)), data.directions.reshape(-1, 3), max_range_m=5)
    np.testing.assert_allclose(hits["t_hit"], ranges.ravel(), rtol=1e-5)
    assert drone.get_lidar_data("scan", directions=False).directions is None
    with pytest.raises(ServerError, match="nothing"):
        drone.get_lidar_data("nothing")


def test_lidar_settings(client, batch):
    settings = client.drone(0).get_lidar_config()
    assert (settings.channels, settings.beams) == (2, 9)
    assert (settings.hfov_deg, settings.vfov_deg, settings.max_range_m) == (120, 20, 5)
    client.drone(1).set_lidar_config(max_range_m=3, offset_m=(0, 0, 0.1), quat_wxyz=(0, 0, 0, 1))
    assert client.drone(0).get_lidar_config("scan").max_range_m == 5
    changed = client.drone(1).get_lidar_config()
    assert changed.max_range_m == 3
    np.testing.assert_allclose(changed.offset_m, [0, 0, 0.1])
    np.testing.assert_allclose(changed.quat_wxyz, [0, 0, 0, 1])
    client.set_lidar_config("scan", hfov_deg=90)
    assert [client.drone(i).get_lidar_config().hfov_deg for i in range(4)] == [90] * 4
    with pytest.raises(ServerError, match="max_range_m"):
        client.set_lidar_config(max_range_m=-1)
    with pytest.raises(
        TypeError, match=re.escape("max_range: expected a field of LidarConfig. Did you mean 'max_range_m'?")
    ):
        client.set_lidar_config(max_range=1)
    for wrong in ({"name": "other"}, {"beams": "many"}):
        with pytest.raises(TypeError, match=rf"^{next(iter(wrong))}: expected"):
            client.drone(0).set_lidar_config(**wrong)


def test_resizing_sensors(client, batch):
    client.set_lidar_config(channels=3, beams=4)
    assert client.drone(2).get_lidar_data().ranges.shape == (3, 4)
    client.drone(0).set_camera_config(width_px=20, height_px=10)
    assert client.drone(2).get_camera_data(format="raw").image.shape[:2] == (10, 20)


def test_move_lines(client, batch):
    drone = client.drone(2)
    assert drone.get_move_line_visible() is False
    drone.set_move_line_visible(True)
    assert drone.get_move_line_visible() is True
    assert batch.move_line_visible.tolist() == [False, False, True, False]


def test_spawning_and_removing(client, batch):
    client.drone(1).remove()
    client.remove_drone(3)
    assert [drone.index for drone in client.get_drones()] == [0, 2]
    with pytest.raises(ServerError):
        client.drone(1).get_location()
    drone = client.spawn_drone((3, 4, 1), (0, 0, 0, 1), env=3, claim=True)
    assert (drone.index, drone.env, drone.owner) == (3, 3, client.info.client)
    np.testing.assert_array_equal(batch.position[3], [3, 4, 1])
    np.testing.assert_array_equal(batch.quat_wxyz[3], [0, 0, 0, 1])
    start = client.spawn_drone()
    np.testing.assert_array_equal(start.get_location(), [2, 4, 2])
    assert start.owner == 0


def test_drones_that_collide_begin_at_free_places(room, connect):
    batch = flockstep.Batch([room], 0, drones_per_env=0, interaction="collide")
    with flockstep.serve(batch, port=0) as server, connect(server.address) as client:
        drones = [client.spawn_drone() for _ in range(6)]
        places = [drone.get_location() for drone in drones]
        np.testing.assert_array_equal(places[0], room.start)
        assert batch.is_free(batch.position)[batch.active].all()
        for place in places[1:]:
            assert np.linalg.norm(place - room.start) < 16 * np.sqrt(3)
        client.drone(0).remove()
        np.testing.assert_array_equal(client.spawn_drone().get_location(), room.start)


def test_places_inside_something_are_refused(room, connect):
    touched = flockstep.Batch([room], 2, interaction="collide", drones_per_env=2)
    touched.set_pose([[2, 4, 2], [6, 6, 3]])
    batch = flockstep.Batch([room], 4, lidar=LIDAR)
    offices = flockstep.Batch("bench/complex", 0, drones_per_env=0)
    for served, places in (
        (batch, [PILLAR, (2, 4, -1), (100, 4, 2)]),
        (touched, [PILLAR, (2.1, 4, 2)]),
        (offices, [(12, 12, -1)]),
    ):
        size = served.num_drones
        with flockstep.serve(served, port=0) as server, connect(server.address) as client:
            for place in places:
                with pytest.raises(
                    ServerError, match="location: expected a place where the drone touches nothing, got"
                ) as refusal:
                    client.spawn_drone(place)
                assert refusal.value.code == "INVALID_ARGUMENT"
                assert served.num_drones == size
            for bad in ((np.nan, 0, 0), (0, 0, 1e9)):
                with pytest.raises((ServerError, ValueError), match=r"position|location"):
                    client.spawn_drone(bad)


def test_a_start_inside_something_is_not_used(connect):
    data = dict(ROOM) | {"markers": {"start": PILLAR}}
    batch = flockstep.Batch([flockstep.World.from_dict(data)], 0, drones_per_env=0)
    with flockstep.serve(batch, port=0) as server, connect(server.address) as client:
        client.spawn_drone()
        assert batch.is_free(batch.position)[batch.active].all()


def test_arrays(client, batch):
    arrays = client.get_arrays(["position", "active", "tick"])
    assert sorted(arrays) == ["active", "position", "tick"]
    assert len(arrays) == 3
    for name in arrays:
        np.testing.assert_array_equal(arrays[name], getattr(batch, name))
        assert arrays[name].dtype == getattr(batch, name).dtype
    scan = client.get_arrays(["ranges"], sensor="scan")["ranges"]
    np.testing.assert_array_equal(scan.reshape(4, -1), batch.lidar("scan").ranges.reshape(4, -1))
    kept = arrays["position"].copy()
    batch.set_pose(START + 1)
    np.testing.assert_array_equal(arrays["position"], kept)


def test_poses(client, batch, room):
    other = make(room)
    goals = START + np.float32([2.0, 0.2, 0])
    impacts = client.set_poses(goals)
    contact = other.move(goals)
    np.testing.assert_array_equal(impacts.position, other.position)
    np.testing.assert_array_equal(impacts.hit, contact.hit)
    np.testing.assert_array_equal(impacts.point, contact.point)
    np.testing.assert_array_equal(impacts.normal, contact.normal)
    assert impacts.time.step == 0
    quats = np.tile(np.float32([0, 0, 0, 1]), (4, 1))
    client.set_poses(quat_wxyz=quats, mask=[True, False, True, False], teleport=True)
    np.testing.assert_array_equal(batch.quat_wxyz[:, 0], [0, 1, 0, 1])
    client.set_poses(START, quats, teleport=True)
    np.testing.assert_array_equal(batch.position, START)


def test_steps_and_time(client, batch):
    assert client.step().step == 1
    time_ = client.step()
    assert time_ == (2, pytest.approx(2 * client.info.step_s), batch.num_envs, batch.generation)
    batch.set_pose(START + np.float32([0.5, 0, 0]))
    client.sense()
    fresh = client.get_arrays(["ranges"], sensor="scan")["ranges"]
    np.testing.assert_array_equal(fresh.reshape(4, -1), batch.lidar("scan").ranges.reshape(4, -1))
    with pytest.raises(ServerError, match="rate_hz"):
        client.set_clock(-1)
    assert client.set_clock(200).step >= 2
    end = time.monotonic() + 10
    while client.get_arrays(["position"]).time.step < 12 and time.monotonic() < end:
        time.sleep(0.01)
    assert client.get_arrays(["position"]).time.step >= 12
    with pytest.raises(ServerError, match="steps by itself") as caught:
        client.step()
    assert caught.value.code == "FAILED_PRECONDITION"
    assert client.get_fps().fps > 0
    client.set_clock(0)
    stopped = client.get_arrays(["position"]).time.step
    time.sleep(0.05)
    assert client.get_arrays(["position"]).time.step == stopped


def test_lockstep(client, batch):
    with (
        flockstep.serve(make(batch.worlds[0]), port=0) as server,
        flockstep.connect(server.address) as one,
        flockstep.connect(server.address) as other,
    ):
        one.join_lockstep()
        other.join_lockstep()
        steps = []
        thread = threading.Thread(target=lambda: steps.append(one.step().step))
        thread.start()
        time.sleep(0.1)
        assert steps == []
        assert other.step().step == 1
        thread.join(10)
        assert steps == [1]
        other.leave_lockstep()
        assert one.step().step == 2
    client.join_lockstep()
    assert client.step().step == 1
    client.leave_lockstep()


def test_flying_by_rotors(room, connect):
    batches = [make(room, drone="racer5", dynamics=flockstep.DynamicsConfig(motion="rotors")) for _ in range(2)]
    command = np.float32([[0.5, 0, 0.2, 0]] * 4)
    with flockstep.serve(batches[0], port=0) as server, connect(server.address) as client:
        assert client.info.flies_by_rotors
        client.fly(command, control="velocity", ticks=50)
        batches[1].fly(command, 50, control="velocity")
        np.testing.assert_array_equal(batches[0].position, batches[1].position)
        client.fly(command, control="velocity", mask=[True, False, False, True])
        batches[1].fly(command, mask=np.array([True, False, False, True]), control="velocity")
        np.testing.assert_array_equal(batches[0].position, batches[1].position)
        client.set_command(command, control="velocity")
        client.step()
        batches[1].fly(command, control="velocity")
        np.testing.assert_array_equal(batches[0].position, batches[1].position)
        client.drone(2).set_command((0, 0, -0.5, 0), control="velocity")
        client.step()
        command[2] = (0, 0, -0.5, 0)
        batches[1].fly(command, control="velocity")
        np.testing.assert_array_equal(batches[0].position, batches[1].position)
        client.set_command(command, control="velocity", mask=[True] * 4)
        with pytest.raises(ServerError, match="control"):
            client.fly(command, control="telepathy")
        with pytest.raises(ServerError, match="rotors"):
            client.drone(0).set_location((1, 1, 1))
        client.drone(0).set_location((2, 4, 2), teleport=True)


def test_snapshots(client, batch):
    blob = client.snapshot()
    assert blob == batch.snapshot()
    client.drone(0).set_location((2, 4, 2.5))
    client.restore(blob)
    np.testing.assert_array_equal(batch.position, START)
    with pytest.raises(ServerError, match="snapshot"):
        client.restore(blob[:100])


def test_worlds(client, batch, room):
    (world,) = client.get_worlds()
    assert world.name == room.name
    np.testing.assert_array_equal([world.min, world.max], room.bounds)
    np.testing.assert_array_equal(world.start, room.start)
    np.testing.assert_array_equal(world.goal, room.goal)
    boxes = client.get_boxes()
    assert boxes.min.shape == boxes.max.shape == (*boxes.materials.shape, 3)
    assert (boxes.min <= boxes.max).all()
    mesh = client.get_mesh()
    assert mesh.triangles.max() < len(mesh.vertices)
    assert mesh.objects.shape == mesh.triangles.shape[:1]
    cloud, expected = client.get_point_cloud(spacing_m=0.5), room.point_cloud(0.5)
    np.testing.assert_array_equal(cloud.points, expected["points"])
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1, atol=1e-5)
    assert cloud.semantic.shape == cloud.objects.shape == cloud.points.shape[:1]
    with pytest.raises(ServerError, match="world") as caught:
        client.get_mesh(1)
    assert caught.value.code == "NOT_FOUND"


def test_content_hashes(room, closet, connect):
    renamed = flockstep.World.from_dict({**ROOM, "name": "chamber"})
    with (
        flockstep.serve(flockstep.Batch([room, renamed, closet], 3), port=0) as server,
        connect(server.address) as client,
    ):
        hashes = [world.content_hash for world in client.get_worlds()]
    assert hashes[0] == hashes[1] != hashes[2]


def test_changing_worlds(room, closet, connect):
    batch = flockstep.Batch([room, closet], 4)
    with flockstep.serve(batch, port=0) as server, connect(server.address) as client:
        assert [world.name for world in client.get_worlds()] == ["room", "closet"]
        assert batch.world_index.tolist() == [0, 1, 0, 1]
        client.set_world(2, 1)
        assert batch.world_index.tolist() == [0, 1, 1, 1]
        with pytest.raises(ServerError):
            client.set_world(2, 2)


def test_light(client, batch):
    light = client.get_light()
    assert len(light.sun_direction) == 3
    client.set_light(0, sun_color=(0.1, 0.2, 0.3))
    changed = client.get_light(0)
    np.testing.assert_allclose(changed.sun_color, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(changed.sky_ambient, light.sky_ambient)
    before = client.drone(2).get_camera_data(format="raw").image
    client.set_light(
        sun_color=(3, 3, 3),
        sun_direction=(0, 0, 1),
        sky_ambient=(1, 0, 0),
        ground_ambient=(1, 0, 0),
        zenith_color=(0, 0, 1),
        horizon_color=(0, 1, 0),
    )
    assert (client.drone(2).get_camera_data(format="raw").image != before).any()


def test_every_field_of_a_light(client, batch):
    values = {
        "sun_color": (0.5, 0.25, 0.125),
        "gamma": 1.5,
        "sun_radius_deg": 2.0,
        "sun_glow": 0.25,
        "fog_visibility_m": 16.0,
    }
    client.set_light(**values)
    light = client.get_light()
    for name, value in values.items():
        np.testing.assert_array_equal(getattr(light, name), value)
        np.testing.assert_array_equal(batch.worlds[0].light[name], value)
    assert set(batch.worlds[0].light) == {*flockstep.Light.__match_args__}
    client.set_light(0, fog_visibility_m=0)
    assert batch.worlds[0].light["fog_visibility_m"] == 0
    assert batch.worlds[0].light["gamma"] == 1.5


def test_light_of_envs(client, batch):
    client.set_light(fog_visibility_m=16)
    client.set_light(envs=[1, 3], sun_color=(0.5, 0.25, 0.125))
    client.set_light(envs=[3], gamma=1.5)
    expected = [batch.worlds[0].light["sun_color"], (0.5, 0.25, 0.125)]
    for env in range(4):
        light = client.get_light(env=env)
        np.testing.assert_array_equal(light.sun_color, expected[env % 2])
        np.testing.assert_array_equal(batch.world_of(env).light["sun_color"], expected[env % 2])
        assert light.fog_visibility_m == 16
        assert light.gamma == (1.5 if env == 3 else batch.worlds[0].light["gamma"])
    client.set_light(envs=[1])
    assert batch.world_of(1) is batch.worlds[0]
    before = batch.snapshot()
    for envs, change, match in (
        ([4], {"gamma": 1.5}, "envs: expected an index below 4, got 4"),
        ([0, -1], {}, "envs: expected an index below 4, got -1"),
        ([0] * 5, {}, "envs: expected at most 4 indices, got 5"),
        ([0], {"gamma": 0.5}, "light.gamma: expected"),
        ([0], {"sun_direction": (0, 0, 0)}, "light.sun_direction: expected"),
    ):
        with pytest.raises(ServerError, match=re.escape(match)):
            client.set_light(envs=envs, **change)
    with pytest.raises(ServerError, match="env: expected an index below 4, got 9"):
        client.get_light(env=9)
    with pytest.raises(ValueError, match="gamma: expected finite numbers"):
        client.set_light(envs=[0], gamma=np.nan)
    with pytest.raises(TypeError, match="sun_glow: expected a number, got 'much'"):
        client.set_light(envs=[0], sun_glow="much")
    with pytest.raises(ValueError, match="envs: expected at least one index"):
        client.set_light(envs=[], gamma=1.5)
    assert batch.snapshot() == before


def test_streams(client, batch):
    with client.subscribe_arrays(["position"], rate_hz=200, only_new=True) as stream:
        first = stream.receive(timeout_s=10)
        np.testing.assert_array_equal(first["position"], batch.position)
        client.drone(3).set_location((6, 6, 2))
        np.testing.assert_array_equal(stream.receive(timeout_s=10)["position"][3], [6, 6, 2])
        with pytest.raises(TimeoutError):
            stream.receive(timeout_s=0.1)
    lidar = client.drone(2).subscribe_lidar(rate_hz=100)
    camera = client.drone(2).subscribe_camera(format="raw", rate_hz=100)
    fps = client.subscribe_fps(rate_hz=100)
    for _ in range(3):
        assert lidar.receive(timeout_s=10).ranges.shape == (2, 9)
        assert camera.receive(timeout_s=10).image.shape == (12, 16, 3)
        assert fps.receive(timeout_s=10).fps >= 0
    for stream in (lidar, camera, fps):
        stream.close()
    client.ping()
    with pytest.raises(ServerError, match="rate_hz"):
        client.subscribe_fps(rate_hz=1e6).receive(timeout_s=10)
    with pytest.raises(ServerError):
        client.drone(99).subscribe_lidar().receive(timeout_s=10)


def test_tokens(room, connect):
    with flockstep.serve(make(room), port=0, token="secret") as server:
        connect(server.address, token="secret").close()
        for token in ("", "wrong"):
            with pytest.raises(ServerError, match="pass the server's token to connect") as caught:
                connect(server.address, token=token)
            assert caught.value.code == "UNAUTHENTICATED"


def test_unix_sockets(room, connect, tmp_path):
    with flockstep.serve(make(room), address=f"unix:{tmp_path}/drones") as server, connect(server.address) as client:
        np.testing.assert_array_equal(client.drone(0).get_location(), START[0])


def test_a_server_that_stops(room, connect):
    server = flockstep.serve(make(room), port=0)
    with connect(server.address) as client:
        client.ping()
        server.stop()
        with pytest.raises(ConnectionError, match=r"stop|closed|gone"):
            client.ping()
        again = flockstep.serve(make(room), port=int(server.address.rpartition(":")[2]))
        client.reconnect(retry_s=5)
        client.ping()
        again.stop()


def test_an_idle_client_stays(room, monkeypatch):
    monkeypatch.setattr("flockstep.client.sync_client._ATTEND_S", 0.1)
    with (
        flockstep.serve(make(room), port=0, idle_timeout_s=0.6) as server,
        flockstep.connect(server.address) as client,
    ):
        time.sleep(2.0)
        client.ping()


def test_many_clients(room):
    with flockstep.serve(make(room), port=0, max_clients=20) as server:
        clients = [flockstep.connect(server.address) for _ in range(20)]
        assert len({client.info.client for client in clients}) == 20
        with pytest.raises(ServerError) as caught:
            flockstep.connect(server.address)
        assert caught.value.code == "RESOURCE_EXHAUSTED"
        for client in clients:
            client.close()
