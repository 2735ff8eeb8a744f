"""Every operation of the clients, with a server in this process, against the batch itself."""

import io
import itertools
import time

import numpy as np
import pytest
from clients import eventually, served
from conftest import ROOM, placed
from messages import refused
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
    batch = placed([room], START, lidar=LIDAR, cameras=[CAMERA], **keywords)
    batch.sense()
    return batch


@pytest.fixture
def batch(room):
    return make(room)


@pytest.fixture
def client(batch, connect):
    with served(batch, connect) as client:
        yield client


def test_what_the_server_tells_of_itself(batch, client):
    info = client.info
    assert (info.version, info.num_envs, info.drones_per_env, info.num_drones) == (flockstep.__version__, 4, 1, 4)
    assert (info.lidars, info.cameras, info.imus) == (("scan",), ("eye",), ())
    assert info.sensors == ("scan", "eye")
    assert (info.flies_by_rotors, info.has_task, info.client > 0) == (False, False, True)
    assert info.step_s == pytest.approx(1 / batch.clock.policy_hz)
    assert {"position", "quat_wxyz", "active"} <= set(info.array_names)
    client.ping()


def test_get_drones_and_claims(client):
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
    expected = (other.position[0], other.quat_wxyz[0], contact.point[0], contact.normal[0])
    np.testing.assert_equal((impact.location, impact.quat_wxyz, impact.point, impact.normal), expected)
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
    np.testing.assert_array_equal(drone.get_rotation().quat_wxyz, batch.quat_wxyz[3])
    np.testing.assert_allclose(drone.get_rotation().angles, (-20, 10, 90), atol=1e-4)
    drone.set_rotation((2, 0, 0, 0), teleport=True)  # of any length
    np.testing.assert_array_equal(batch.quat_wxyz[3], [1, 0, 0, 0])
    impact = drone.set_location_and_rotation((6, 6, 2), expected)
    np.testing.assert_array_equal(impact.location, np.float32([6, 6, 2]))
    np.testing.assert_allclose(batch.quat_wxyz[3], expected, atol=1e-6)
    impact = drone.set_location_and_rotation((6, 6, 3), Angles(), teleport=True)
    np.testing.assert_array_equal(batch.quat_wxyz[3], [1, 0, 0, 0])
    assert impact.location[2] == 3


def test_bad_arguments_are_refused(client, batch):
    drone, before = client.drone(0), batch.position.copy()
    for operation, arguments, error, said in (
        (drone.set_location, {"location": (1, 2)}, ValueError, ("location", (3,), (2,))),
        (drone.set_location, {"location": "here"}, TypeError, ("location", "here")),
        (drone.set_location, {"location": (1, 2, np.nan)}, ValueError, ("location", [1.0, 2.0, float("nan")])),
        (drone.set_rotation, {"rotation": (1, 2, 3)}, ValueError, ("rotation", (4,))),
        (drone.set_rotation, {"rotation": (0, 0, 0, 0)}, ServerError, ("rotation",)),
        (client.drone(9).get_location, {}, ServerError, ("drone", 9)),
        (client.claim, {"drones": [99]}, ServerError, ("drones", 4, 99)),
        (client.set_camera_capture_mode, {"mode": "never"}, ValueError, ("mode", "every_step", "never")),
        (drone.get_camera_data, {"format": "gif"}, ValueError, ("format", "jpeg", "png", "raw", "gif")),
        (drone.get_camera_data, {"quality": 0}, ValueError, ("quality", 1, 100, 0)),
        (drone.get_camera_data, {"output": "depth"}, ServerError, ("output", "depth")),
        (drone.get_camera_data, {"format": "raw", "output": "semantic"}, ServerError, ("output", "eye", "semantic")),
        (drone.get_camera_data, {"camera": "nothing"}, ServerError, ("camera", "nothing")),
        (drone.get_lidar_data, {"lidar": "nothing"}, ServerError, ("lidar", "nothing")),
        (client.get_arrays, {"names": "position"}, TypeError, ("names", "position")),
        (client.get_arrays, {"names": ["nothing"]}, ServerError, ("names", "nothing")),
        (client.get_arrays, {"names": ["ranges"], "sensor": "nothing"}, ServerError, ("sensor", "nothing")),
        (client.set_poses, {"position": START, "mask": [1, 0, 0, 1]}, ValueError, ("mask", "int64 (4,)")),
        (client.set_poses, {"position": (1, 2, 3)}, ValueError, ("position", "(N, 3)", (3,))),
        (client.set_poses, {"position": START[:2]}, ServerError, ("position",)),
        (client.set_lidar_config, {"max_range_m": -1}, ServerError, ("lidar.max_range_m", -1)),
        (client.set_lidar_config, {"max_range": 1}, TypeError, ("max_range", "max_range_m")),
        (drone.set_lidar_config, {"name": "other"}, TypeError, ("name",)),
        (drone.set_lidar_config, {"beams": "many"}, TypeError, ("beams", "many")),
        (client.set_clock, {"rate_hz": -1}, ServerError, ("rate_hz", -1)),
        (client.restore, {"snapshot": batch.snapshot()[:100]}, ServerError, ("snapshot",)),
        (client.get_mesh, {"world": 1}, ServerError, ("world", 1)),
        (client.get_light, {"env": 9}, ServerError, ("env", 4, 9)),
        (client.set_light, {"envs": [4], "gamma": 1.5}, ServerError, ("envs", 4)),
        (client.set_light, {"envs": [0, -1]}, ServerError, ("envs", 4, -1)),
        (client.set_light, {"envs": [0] * 5}, ServerError, ("envs", 4, 5)),
        (client.set_light, {"envs": []}, ValueError, ("envs",)),
        (client.set_light, {"envs": [0], "gamma": 0.5}, ServerError, ("light.gamma", 0.5)),
        (client.set_light, {"envs": [0], "gamma": np.nan}, ValueError, ("gamma",)),
        (client.set_light, {"envs": [0], "sun_glow": "much"}, TypeError, ("sun_glow", "much")),
        (client.set_light, {"envs": [0], "sun_direction": (0, 0, 0)}, ServerError, ("light.sun_direction",)),
    ):
        with refused(error, *said) as caught:
            operation(**arguments)
        if said[0] in ("drone", "drones", "world"):
            assert caught.value.code == "NOT_FOUND"
    np.testing.assert_array_equal(batch.position, before)
    assert batch.world_of(0) is batch.worlds[0]  # whose light is not its own


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


def test_the_file_of_a_still_camera_follows_every_change(room, connect):
    """The server keeps the files of pictures that stand still."""
    camera = flockstep.CameraConfig(name="eye", width_px=16, height_px=12, capture_mode="on_demand")
    body = flockstep.BodyConfig(size_m=(0.5, 0.5, 0.5), position_m=(4, 3.5, 2))
    batch = placed([room], START, drones_per_env=4, interaction="sense", cameras=[camera], max_bodies=1)
    snapshots = []
    with served(batch, connect) as client:

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
    assert (settings.hfov_deg, settings.near_m, settings.far_m) == pytest.approx((90, CAMERA.near_m, CAMERA.far_m))
    client.drone(1).set_camera_config(hfov_deg=50, offset_m=(0.1, 0, 0), quat_wxyz=(0.5, 0.5, 0.5, 0.5))
    assert client.drone(0).get_camera_config().hfov_deg == settings.hfov_deg
    changed = client.drone(1).get_camera_config("eye")
    mounting = [changed.hfov_deg, *changed.offset_m, *changed.quat_wxyz]
    np.testing.assert_allclose(mounting, [50, 0.1, 0, 0, 0.5, 0.5, 0.5, 0.5])
    client.set_camera_config(hfov_deg=70)
    assert [client.drone(i).get_camera_config().hfov_deg for i in range(4)] == pytest.approx([70] * 4)
    client.drone(0).set_camera_config(width_px=20, height_px=10)
    assert client.drone(2).get_camera_data(format="raw").image.shape[:2] == (10, 20)


def test_lidar_data(client, batch):
    drone = client.drone(2)
    data = drone.get_lidar_data()
    ranges = np.asarray(batch.lidar("scan").ranges[2]).reshape(2, 9)
    np.testing.assert_array_equal(data.ranges, ranges)
    assert data.directions.shape == (2, 9, 3)
    np.testing.assert_allclose(np.linalg.norm(data.directions, axis=-1), 1, atol=1e-6)
    np.testing.assert_array_equal([*data.origin, *data.quat_wxyz], [*START[2], 1, 0, 0, 0])
    world = batch.worlds[0]
    hits = world.raycast(np.broadcast_to(data.origin, (18, 3)), data.directions.reshape(-1, 3), max_range_m=5)
    np.testing.assert_allclose(hits["t_hit"], ranges.ravel(), rtol=1e-5)
    assert drone.get_lidar_data("scan", directions=False).directions is None


def test_lidar_settings(client, batch):
    settings = client.drone(0).get_lidar_config()
    assert (settings.channels, settings.beams) == (2, 9)
    assert (settings.hfov_deg, settings.vfov_deg, settings.max_range_m) == (120, 20, 5)
    client.drone(1).set_lidar_config(max_range_m=3, offset_m=(0, 0, 0.1), quat_wxyz=(0, 0, 0, 1))
    assert client.drone(0).get_lidar_config("scan").max_range_m == 5
    changed = client.drone(1).get_lidar_config()
    mounting = [changed.max_range_m, *changed.offset_m, *changed.quat_wxyz]
    np.testing.assert_allclose(mounting, [3, 0, 0, 0.1, 0, 0, 0, 1])
    errors = flockstep.RangeErrors(noise_std_m=0.5, dropout=0.25)
    client.drone(1).set_lidar_config(errors=errors)
    assert [client.drone(i).get_lidar_config().errors for i in range(2)] == [flockstep.RangeErrors(), errors]
    client.set_lidar_config("scan", hfov_deg=90)
    assert [client.drone(i).get_lidar_config().hfov_deg for i in range(4)] == [90] * 4
    client.set_lidar_config(channels=3, beams=4)
    assert client.drone(2).get_lidar_data().ranges.shape == (3, 4)


def test_sensors_that_err(room, connect):
    lidar = flockstep.LidarConfig(errors=flockstep.RangeErrors(noise_std_m=0.5, dropout=0.2))
    errors = flockstep.DepthErrors(noise_std_m=0.5, hole_m=0)
    camera = flockstep.CameraConfig(width_px=8, height_px=6, outputs=["depth"], depth_errors=errors)
    batch = placed([room], START, lidar=lidar, camera=camera)
    batch.sense()
    with served(batch, connect) as client:
        assert client.drone(1).get_lidar_config() == batch.lidar().config
        np.testing.assert_array_equal(client.drone(1).get_lidar_data().ranges, batch.lidar().ranges[1])
        assert client.drone(1).get_camera_config().depth_errors == errors
        depth = client.drone(1).get_camera_data(format="raw", output="depth").image
        np.testing.assert_array_equal(depth, batch.camera().depth[1])


def test_a_fisheye_with_events(room, connect):
    lens = {"projection": "fisheye", "hfov_deg": 120, "vfov_deg": 75, "distortion": [-0.02, 0.01, 0, 0]}
    pixels = flockstep.EventPixels(threshold=0.5, leak_hz=2)
    camera = flockstep.CameraConfig(width_px=16, height_px=10, outputs=("grey", "events"), event_pixels=pixels, **lens)
    batch = placed([room], START, camera=camera)
    batch.sense()
    with served(batch, connect) as client:
        settings = client.drone(1).get_camera_config()
        assert (settings.hfov_deg, settings.vfov_deg) == pytest.approx((120, 75))
        assert (settings.projection, settings.distortion) == ("fisheye", camera.distortion)
        assert settings.event_pixels == pixels
        assert client.drone(1).get_camera_data(format="raw", output="events").image.shape == (10, 16, 2)


def test_move_lines(client, batch):
    drone = client.drone(2)
    assert drone.get_move_line_visible() is False
    drone.set_move_line_visible(True)
    assert drone.get_move_line_visible() is True
    assert batch.move_line_visible.tolist() == [False, False, True, False]


def test_beams(client, batch):
    drone, frames = client.drone(2), []
    for visible in (False, True):
        drone.set_beams_visible(visible)
        assert [drone.get_beams_visible(), *batch.beams_visible] == [visible, False, False, visible, False]
        frames.append(np.asarray(Image.open(io.BytesIO(bytes(drone.get_camera_data(format="png")))).convert("RGB")))
        np.testing.assert_array_equal(frames[-1], batch.picture(2))
    assert (frames[0] != frames[1]).any()


def test_spawning_and_removing(client, batch):
    client.drone(1).remove()
    client.remove_drone(3)
    assert [drone.index for drone in client.get_drones()] == [0, 2]
    with pytest.raises(ServerError):
        client.drone(1).get_location()
    drone = client.spawn_drone((3, 4, 1), (0, 0, 0, 1), env=3, claim=True)
    assert (drone.index, drone.env, drone.owner) == (3, 3, client.info.client)
    np.testing.assert_array_equal([*batch.position[3], *batch.quat_wxyz[3]], [3, 4, 1, 0, 0, 0, 1])
    start = client.spawn_drone()
    np.testing.assert_array_equal(start.get_location(), [2, 4, 2])
    assert start.owner == 0


def test_drones_that_collide_begin_at_free_places(room, connect):
    batch = flockstep.Batch([room], 0, drones_per_env=0, interaction="collide")
    with served(batch, connect) as client:
        drones = [client.spawn_drone() for _ in range(6)]
        places = [drone.get_location() for drone in drones]
        np.testing.assert_array_equal(places[0], room.start)
        assert batch.is_free(batch.position)[batch.active].all()
        assert all(np.linalg.norm(place - room.start) < 16 * np.sqrt(3) for place in places)
        client.drone(0).remove()
        np.testing.assert_array_equal(client.spawn_drone().get_location(), room.start)
    batch = flockstep.Batch([flockstep.World.from_dict(ROOM | {"markers": {"start": PILLAR}})], 0, drones_per_env=0)
    with served(batch, connect) as client:
        client.spawn_drone()
        assert batch.is_free(batch.position)[batch.active].all()


def test_places_inside_something_are_refused(room, connect):
    touched = placed([room], [[2, 4, 2], [6, 6, 3]], interaction="collide", drones_per_env=2)
    far = [(np.nan, 0, 0), (0, 0, 1e9)]  # the second is refused by the batch, as a position
    for batch, places in (
        (flockstep.Batch([room], 4, lidar=LIDAR), [PILLAR, (2, 4, -1), (100, 4, 2)]),
        (touched, [PILLAR, (2.1, 4, 2)]),
        (flockstep.Batch("bench/complex", 0, drones_per_env=0), [(12, 12, -1)]),
    ):
        size = batch.num_drones
        with served(batch, connect) as client:
            for place in places + far:
                with refused((ServerError, ValueError), "position" if 1e9 in place else "location") as refusal:
                    client.spawn_drone(place)
                assert getattr(refusal.value, "code", "INVALID_ARGUMENT") == "INVALID_ARGUMENT"
                assert batch.num_drones == size


def test_arrays(client, batch):
    arrays = client.get_arrays(["position", "active", "tick"])
    assert sorted(arrays) == ["active", "position", "tick"]
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
    expected = (other.position, contact.hit, contact.point, contact.normal)
    np.testing.assert_equal((impacts.position, impacts.hit, impacts.point, impacts.normal), expected)
    assert impacts.time.step == 0
    quats = np.tile(np.float32([0, 0, 0, 1]), (4, 1))
    client.set_poses(quat_wxyz=quats, mask=[True, False, True, False], teleport=True)
    np.testing.assert_array_equal(batch.quat_wxyz[:, 0], [0, 1, 0, 1])


def test_steps_and_time(client, batch):
    assert client.step().step == 1
    time_ = client.step()
    assert time_ == (2, pytest.approx(2 * client.info.step_s), batch.num_envs, batch.generation)
    batch.set_pose(START + np.float32([0.5, 0, 0]))
    client.sense()
    fresh = client.get_arrays(["ranges"], sensor="scan")["ranges"]
    np.testing.assert_array_equal(fresh.reshape(4, -1), batch.lidar("scan").ranges.reshape(4, -1))
    assert client.set_clock(200).step >= 2
    eventually(lambda: client.get_arrays(["position"]).time.step >= 12)
    with refused(ServerError, "steps by itself"):
        client.step()
    assert client.get_fps().fps > 0
    client.set_clock(0)
    stopped = client.get_arrays(["position"]).time.step
    time.sleep(0.05)
    assert client.get_arrays(["position"]).time.step == stopped


def test_lockstep(client):
    client.join_lockstep()
    assert client.step().step == 1
    client.leave_lockstep()
    assert client.step().step == 2


def test_snapshots(client, batch):
    blob = client.snapshot()
    assert blob == batch.snapshot()
    client.drone(0).set_location((2, 4, 2.5))
    client.restore(blob)
    np.testing.assert_array_equal(batch.position, START)


def test_worlds(client, batch, room):
    (world,) = client.get_worlds()
    assert world.name == room.name
    np.testing.assert_array_equal(
        [world.min, world.max, world.start, world.goal], [*room.bounds, room.start, room.goal]
    )
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


def test_several_worlds(room, closet, connect):
    renamed = flockstep.World.from_dict({**ROOM, "name": "chamber"})
    batch = flockstep.Batch([room, closet, renamed], 4)
    with served(batch, connect) as client:
        worlds = client.get_worlds()
        assert [world.name for world in worlds] == ["room", "closet", "chamber"]
        assert worlds[0].content_hash == worlds[2].content_hash != worlds[1].content_hash
        assert batch.world_index.tolist() == [0, 1, 2, 0]
        client.set_world(2, 1)
        assert batch.world_index.tolist() == [0, 1, 1, 0]
        with pytest.raises(ServerError):
            client.set_world(2, 3)


def test_light(client, batch):
    values = {
        "sun_color": (0.5, 0.25, 0.125),
        "gamma": 1.5,
        "sun_radius_deg": 2.0,
        "sun_glow": 0.25,
        "fog_visibility_m": 16.0,
    }
    first, picture = client.get_light(), client.drone(2).get_camera_data(format="raw").image
    client.set_light(**values)
    light = client.get_light()
    for name, value in values.items():
        np.testing.assert_array_equal(getattr(light, name), value)
        np.testing.assert_array_equal(batch.worlds[0].light[name], value)
    np.testing.assert_array_equal(light.sky_ambient, first.sky_ambient)
    assert set(batch.worlds[0].light) == {*flockstep.Light.__match_args__}
    client.set_light(0, fog_visibility_m=0)
    assert batch.worlds[0].light["fog_visibility_m"] == 0
    assert batch.worlds[0].light["gamma"] == 1.5
    assert (client.drone(2).get_camera_data(format="raw").image != picture).any()


def test_light_of_envs(client, batch):
    client.set_light(fog_visibility_m=16)
    client.set_light(envs=[1, 3], sun_color=(0.5, 0.25, 0.125))
    client.set_light(envs=[3], gamma=1.5)
    expected = [batch.worlds[0].light["sun_color"], (0.5, 0.25, 0.125)]
    for env in range(4):
        light = client.get_light(env=env)
        np.testing.assert_array_equal(light.sun_color, expected[env % 2])
        np.testing.assert_array_equal(batch.world_of(env).light["sun_color"], expected[env % 2])
        assert (light.fog_visibility_m, light.gamma) == (16, 1.5 if env == 3 else batch.worlds[0].light["gamma"])
    client.set_light(envs=[1])
    assert batch.world_of(1) is batch.worlds[0]


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
    with refused(ServerError, "rate_hz"):
        client.subscribe_fps(rate_hz=1e6).receive(timeout_s=10)
    with pytest.raises(ServerError):
        client.drone(99).subscribe_lidar().receive(timeout_s=10)
