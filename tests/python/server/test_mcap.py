"""MCAP files with ROS 2 messages, read by rosbags, which has its own reader and message definitions."""

import io
import signal
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from conftest import begun, placed
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from messages import refused
from PIL import Image
from ros_files import LOOK, STORE, TILT, PlainSource, Tree, cloud_of, quaternion, read, stamp_ns, vector
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

import flockstep
from flockstep.bridges import BatchSource, McapRecorder, Source, mcap, ros_messages

ROLLED = np.roll(Rotation.from_euler("x", 1.0).as_quat(), 1)


def batch_of(num_drones=2, **settings):
    """Two drones of one env with every kind of sensor, mounted off the centre and turned."""
    settings = {"drones_per_env": num_drones} | settings
    return flockstep.Batch(
        "playground/train-1",
        num_drones,
        drone="x500",
        lidar=flockstep.LidarConfig(channels=4, beams=48, vfov_deg=40, offset_m=(0.1, -0.05, 0.2), quat_wxyz=TILT),
        camera=flockstep.CameraConfig(
            width_px=96, height_px=64, outputs=["rgb", "depth"], offset_m=(0.2, 0.1, -0.05), quat_wxyz=LOOK
        ),
        imu=flockstep.ImuConfig(quat_wxyz=ROLLED, accelerometer_noise_density=0.01),
        clock=flockstep.ClockConfig(policy_hz=50, physics_hz=500),
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="position"),
        **settings,
    )


STATE = ("position", "quat_wxyz", "velocity", "angular_velocity", "accelerometer", "gyroscope")


def fly(batch, recorder, steps):
    """Fly and record; return what the batch showed after each step."""
    start = np.array([[3, 3, 2], [4, 3, 2.5]])[: batch.num_drones]
    batch.set_pose(start)
    batch.sense()
    seen = []
    for step in range(steps + 1):
        if step > 0:
            batch.fly(np.c_[start + np.array([2, 1, 0.5]), np.full(len(start), 1.0)])
            batch.sense()
        recorder.write()
        seen.append({name: getattr(batch, name).copy() for name in STATE})
        sensed = {
            "points": batch.lidar().points,
            "rgb": batch.camera().rgb.copy(),
            "depth": batch.camera().depth.copy(),
        }
        seen[-1] |= sensed
    return seen


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "flight.mcap"
    batch = batch_of()
    with McapRecorder(path, batch) as recorder:
        seen = fly(batch, recorder, 60)
    return batch, seen, read(path), path


class TestFlight:
    def test_topics(self, flight):
        _, seen, found, path = flight
        kinds = {
            "/clock": "rosgraph_msgs/msg/Clock",
            "/tf": "tf2_msgs/msg/TFMessage",
            "/tf_static": "tf2_msgs/msg/TFMessage",
        }
        for drone in ("drone0", "drone1"):
            kinds |= {
                f"/{drone}/odom": "nav_msgs/msg/Odometry",
                f"/{drone}/lidar/points": "sensor_msgs/msg/PointCloud2",
                f"/{drone}/front/image/compressed": "sensor_msgs/msg/CompressedImage",
                f"/{drone}/imu/data": "sensor_msgs/msg/Imu",
            }
        with Reader(path) as reader:
            assert {connection.topic: connection.msgtype for connection in reader.connections} == kinds
            qos = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        assert [profile.durability for profile in qos["/tf_static"]] == [QosDurability.TRANSIENT_LOCAL]
        assert {topic: len(found[topic]) for topic in kinds} == {
            topic: 1 if topic == "/tf_static" else len(seen) for topic in kinds
        }

    def test_times(self, flight):
        _, seen, found, _ = flight
        expected = [step * 20_000_000 for step in range(len(seen))]  # 50 Hz
        assert [stamp for stamp, _ in found["/clock"]] == expected
        assert [stamp_ns(message.clock) for _, message in found["/clock"]] == expected
        for messages in found.values():
            assert all(first < second for (first, _), (second, _) in pairwise(messages))
            for stamp, message in messages:
                for part in getattr(message, "transforms", [message]):
                    if hasattr(part, "header"):
                        assert stamp_ns(part.header.stamp) == stamp

    def test_frames_are_one_tree(self, flight):
        _, _, found, _ = flight
        tree = Tree(found, 0)
        for drone in ("drone0", "drone1"):
            for frame in ("base_link", "lidar", "front", "front_optical", "imu"):
                tree.to_map(f"{drone}/{frame}")
        assert len(tree.parents) == 10
        for messages in found.values():
            for _, message in messages:
                if hasattr(message, "header"):
                    tree.to_map(message.header.frame_id)
                if hasattr(message, "child_frame_id"):
                    tree.to_map(message.child_frame_id)

    def test_poses_and_velocities(self, flight):
        _, seen, found, _ = flight
        for drone in range(2):
            for index, (_, message) in enumerate(found[f"/drone{drone}/odom"]):
                state = seen[index]
                assert (message.header.frame_id, message.child_frame_id) == ("map", f"drone{drone}/base_link")
                np.testing.assert_array_equal(vector(message.pose.pose.position), state["position"][drone])
                np.testing.assert_array_equal(quaternion(message.pose.pose.orientation), state["quat_wxyz"][drone])
                turn = Rotation.from_quat(np.roll(state["quat_wxyz"][drone], -1))
                np.testing.assert_allclose(
                    turn.apply(vector(message.twist.twist.linear)), state["velocity"][drone], atol=1e-6
                )
                np.testing.assert_array_equal(vector(message.twist.twist.angular), state["angular_velocity"][drone])
                matrix = Tree(found, index).to_map(f"drone{drone}/base_link")
                np.testing.assert_allclose(matrix[:3, :3], turn.as_matrix(), atol=1e-7)
                np.testing.assert_array_equal(matrix[:3, 3], state["position"][drone])
        assert np.linalg.norm(seen[-1]["velocity"], axis=1).min() > 0.3

    def test_point_clouds(self, flight):
        _, seen, found, _ = flight
        for drone in range(2):
            topic = f"/drone{drone}/lidar/points"
            for index, (_, message) in enumerate(found[topic]):
                layout = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
                assert layout == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
                assert (message.height, message.point_step, message.row_step) == (1, 12, 12 * message.width)
                assert message.is_dense
                assert not message.is_bigendian
                points = cloud_of(message)
                world = seen[index]["points"][drone]
                hits = world[np.isfinite(world).all(axis=-1)]
                placed = Tree(found, index).placed(message.header.frame_id, points.astype(float))
                np.testing.assert_allclose(placed, hits, rtol=0, atol=5e-6)
            assert 0 < len(points) < 4 * 48  # some beams miss

    def test_imu(self, flight):
        _, seen, found, _ = flight
        for drone in range(2):
            for index, (_, message) in enumerate(found[f"/drone{drone}/imu/data"]):
                np.testing.assert_array_equal(vector(message.linear_acceleration), seen[index]["accelerometer"][drone])
                np.testing.assert_array_equal(vector(message.angular_velocity), seen[index]["gyroscope"][drone])
                assert message.orientation_covariance[0] == -1
                assert message.header.frame_id == f"drone{drone}/imu"
        matrix = Tree(found, 0).to_map("drone0/base_link")[:3, :3].T @ Tree(found, 0).to_map("drone0/imu")[:3, :3]
        np.testing.assert_allclose(matrix, Rotation.from_euler("x", 1.0).as_matrix(), atol=1e-6)

    def test_images(self, flight):
        _, seen, found, _ = flight
        for drone in range(2):
            for index, (_, message) in enumerate(found[f"/drone{drone}/front/image/compressed"]):
                assert message.format == "jpeg"
                with Image.open(io.BytesIO(message.data.tobytes())) as file:
                    assert file.format == "JPEG"
                    image = np.asarray(file.convert("RGB"), float)
                error = np.abs(image - seen[index]["rgb"][drone])
                assert error.mean() < 4
                assert np.percentile(error, 99) < 40
        last, first = seen[-1]["rgb"].astype(float), seen[0]["rgb"].astype(float)
        assert np.abs(last - first).mean() > 10  # so that a wrong frame would be noticed

    def test_the_optical_frame(self, flight):
        """A pixel's depth gives a point in the optical frame; it lies where a ray through the pixel hits the world."""
        batch, seen, found, _ = flight
        config = batch.cameras[0]
        tree = Tree(found, -1)
        for u, v in ((3, 5), (48, 32), (90, 10), (20, 60)):
            depth = float(seen[-1]["depth"][0, v, u])
            across, down = (u + 0.5 - config.cx) / config.fx, (v + 0.5 - config.cy) / config.fy
            frame = found["/drone0/front/image/compressed"][-1][1].header.frame_id
            eye, point = tree.placed(frame, np.array([[0, 0, 0], [across * depth, down * depth, depth]]))
            hit = batch.world_of(0).raycast([eye], [point - eye], 100.0)["t_hit"][0]
            assert hit == pytest.approx(np.linalg.norm(point - eye), rel=1e-4)


KINDS = {"rosgraph_msgs/Clock", "tf2_msgs/TFMessage", "nav_msgs/Odometry", *(kind for kind, _ in mcap._TOPICS.values())}


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_definitions(kind):
    """Compare the whole definition with that of rosbags."""
    full = kind.replace("/", "/msg/")
    other = get_typestore(Stores.EMPTY)
    other.register(get_types_from_msg(ros_messages.definition(kind), full))
    assert other.generate_msgdef(full, ros_version=2) == STORE.generate_msgdef(full, ros_version=2)


class TestRates:
    def recorded(self, path, drones, rates):
        batch = batch_of(drones)
        with McapRecorder(path, batch, rates_hz=rates) as recorder:
            fly(batch, recorder, 50)
        return {topic: [stamp for stamp, _ in messages] for topic, messages in read(path).items()}

    def test_sensors_have_their_own_rates(self, tmp_path):
        found = self.recorded(tmp_path / "a.mcap", 2, {"lidar": 10, "front": 5, "pose": 25.0, "imu": 50})
        for topic, period_ms in (
            ("/clock", 20),
            ("/tf", 40),
            ("/drone1/odom", 40),
            ("/drone0/lidar/points", 100),
            ("/drone1/front/image/compressed", 200),
            ("/drone0/imu/data", 20),
        ):
            assert found[topic] == [milliseconds * 10**6 for milliseconds in range(0, 1001, period_ms)]

    def test_rates_that_are_no_divisors(self, tmp_path):
        stamps = np.array(self.recorded(tmp_path / "a.mcap", 1, {"lidar": 30})["/drone0/lidar/points"]) / 1e9
        assert len(stamps) == 31
        np.testing.assert_allclose(stamps, np.ceil(np.arange(31) / 30 * 50 - 1e-6) / 50, atol=1e-9)
        found = self.recorded(tmp_path / "b.mcap", 1, {"lidar": 1000})  # above that of the writes
        assert len(found["/drone0/lidar/points"]) == 51

    def test_nothing_is_written_twice(self, tmp_path):
        batch = batch_of(1)
        batch.sense()
        with McapRecorder(tmp_path / "a.mcap", batch) as recorder:
            for _ in range(3):
                recorder.write()
        assert [len(messages) for messages in read(tmp_path / "a.mcap").values()] == [1] * 7


class TestEnvironments:
    def test_time_goes_on_in_the_next_episode(self, mode, tmp_path):
        envs = begun(4, worlds="train", autoreset_mode=mode, max_episode_steps=7, seed=3)
        with McapRecorder(tmp_path / "a.mcap", envs) as recorder:
            recorder.write()
            for _ in range(40):
                _, _, terminated, truncated, _ = envs.step(envs.action_space.sample())
                if mode == "disabled" and (terminated | truncated).any():
                    envs.reset(options={"reset_mask": terminated | truncated})
                recorder.write()
        found = read(tmp_path / "a.mcap")
        stamps = [stamp for stamp, _ in found["/clock"]]
        assert envs.batch.episode[0] > 1
        assert stamps == [100_000_000 * step for step in range(41)]  # 10 Hz
        assert [name for name in found if name.startswith("/drone")] == ["/drone0/lidar/points"]

    def test_chosen_drones_of_several_envs(self, tmp_path):
        envs = begun(4, worlds="train", max_episode_steps=5)
        with McapRecorder(tmp_path / "a.mcap", BatchSource(envs.batch, [2, 0])) as recorder:
            for _ in range(20):
                envs.step(envs.action_space.sample())
                recorder.write()
                expected = envs.batch.position.copy()
        found = read(tmp_path / "a.mcap")
        for drone in (0, 2):
            place = Tree(found, -1).to_map(f"drone{drone}/base_link")[:3, 3]
            np.testing.assert_array_equal(place, expected[drone])
        assert "/drone1/lidar/points" not in found
        assert len({stamp for stamp, _ in found["/clock"]}) == 20

    def test_a_changed_lidar(self, tmp_path):
        """Directions follow `Batch.set_lidar`."""
        batch = placed("playground/train-1", [[3, 3, 2]], lidar=flockstep.LidarConfig(max_range_m=20))
        source = BatchSource(batch)
        for hfov_deg in (270, 90):
            batch.set_lidar(hfov_deg=hfov_deg)
            batch.sense()
            expected = batch.lidar().points[0, 0] - [3, 3, 2]
            np.testing.assert_allclose(source.points("lidar", 0), expected, atol=1e-5)

    def test_removed_drones_and_stale_images(self, tmp_path):
        batch = batch_of(2, drones_per_env=1)
        batch.sense()
        batch.remove([1])
        with McapRecorder(tmp_path / "a.mcap", BatchSource(batch, [0, 1])) as recorder:
            recorder.write()
        found = read(tmp_path / "a.mcap")
        assert found["/drone0/lidar/points"][0][1].width > 0
        assert found["/drone1/lidar/points"][0][1].width == 0
        assert "/drone0/front/image/compressed" in found
        assert "/drone1/front/image/compressed" not in found


class TestSources:
    def test_any_source(self, tmp_path):
        remote = PlainSource()
        assert isinstance(remote, Source)
        with McapRecorder(tmp_path / "a.mcap", remote) as recorder:
            recorder.write()
            remote.now = 2.25
            recorder.write()
        found = read(tmp_path / "a.mcap")
        assert [stamp for stamp, _ in found["/clock"]] == [1_500_000_000, 2_250_000_000]
        cloud = found["/scout/top/points"][1][1]
        np.testing.assert_array_equal(np.frombuffer(cloud.data.tobytes(), "<f4"), range(6))
        assert found["/scout/eye/image/compressed"][0][1].data.tobytes() == b"image"
        odometry = found["/scout/odom"][0][1]
        np.testing.assert_array_equal(vector(odometry.twist.twist.angular), [7, 8, 9])
        np.testing.assert_array_equal(Tree(found, 1).to_map("scout/top")[:3, 3], [1, 2, 4])

    @pytest.mark.parametrize("now", [1.0, -1.0, float("nan"), float("inf")])
    def test_bad_times_are_refused_and_write_nothing(self, now, tmp_path):
        remote = PlainSource()
        with McapRecorder(tmp_path / "a.mcap", remote) as recorder:
            recorder.write()
            remote.now = now
            with refused(ValueError, "time_s"):
                recorder.write()
        assert len(read(tmp_path / "a.mcap")["/clock"]) == 1

    def test_a_source_that_fails_writes_nothing(self, tmp_path):
        batch = batch_of(1)
        with McapRecorder(tmp_path / "a.mcap", batch) as recorder:
            with refused(RuntimeError, "has not scanned yet"):
                recorder.write()  # before the first scan
            batch.sense()
            recorder.write()
        assert {topic: len(messages) for topic, messages in read(tmp_path / "a.mcap").items()}["/clock"] == 1


class TestRefusals:
    @pytest.mark.parametrize("rate", [0, -1.0, float("nan"), float("inf"), "10", None, True])
    def test_rates(self, rate, tmp_path):
        with refused(ValueError, "rates_hz['lidar']", rate):
            McapRecorder(tmp_path / "a.mcap", batch_of(), rates_hz={"lidar": rate})
        assert not (tmp_path / "a.mcap").exists()

    def test_names(self, tmp_path):
        with refused(ValueError, "rates_hz", "lidr", "lidar"):
            McapRecorder(tmp_path / "a.mcap", batch_of(), rates_hz={"lidr": 10})

        def batch_with(lidar, *cameras):
            cameras = [flockstep.CameraConfig(name=name, width_px=8, height_px=8) for name in cameras]
            return flockstep.Batch("playground/train-1", lidar=flockstep.LidarConfig(name=lidar), cameras=cameras)

        for names, *said in (
            (["top-left"], "sensors", "top-left"),
            (["base_link"], "sensors", "drone0/base_link"),
            (["a_optical", "a"], "sensors", "drone0/a_optical"),
        ):
            with refused(ValueError, *said):
                McapRecorder(tmp_path / "a.mcap", batch_with(*names))
        with refused(ValueError, "sensors"):
            BatchSource(batch_with("a", "a"))
        assert not (tmp_path / "a.mcap").exists()

    def test_other_arguments(self, tmp_path):
        batch, path = batch_of(), tmp_path / "a.mcap"
        for make, arguments, kind, *said in (
            (McapRecorder, {"path": tmp_path / "a.bag", "source": batch}, ValueError, "path", ".mcap"),
            (McapRecorder, {"path": path, "source": batch, "chunk_bytes": 0}, ValueError, "chunk_bytes", 0),
            (McapRecorder, {"path": path, "source": 3}, TypeError, "source"),
            *(
                (BatchSource, {"batch": batch, "drones": some}, ValueError, "drones")
                for some in ([], [0, 0], [2], [-1])
            ),
            *((BatchSource, {"batch": batch, "jpeg_quality": q}, ValueError, "jpeg_quality", q) for q in (0, 101)),
        ):
            with refused(kind, *said):
                make(**arguments)
        recorder = McapRecorder(path, batch)
        recorder.close()
        recorder.close()
        with refused(RuntimeError, "the recorder is closed"):
            recorder.write()


def interrupted(**_):
    raise KeyboardInterrupt


def recovered(data):
    """Return time and content of the messages in the beginning of a file, in order."""
    found = []
    records = StreamReader(io.BytesIO(data)).records
    while True:
        try:
            record = next(records)
        except (McapError, StopIteration):
            return found
        if isinstance(record, Message):
            found.append((record.log_time, record.data))


class TestCutFiles:
    def test_every_whole_chunk_can_be_read(self, tmp_path):
        path = tmp_path / "a.mcap"
        batch = batch_of(1)
        with McapRecorder(path, batch, chunk_bytes=20_000) as recorder:
            fly(batch, recorder, 60)
        data = path.read_bytes()
        whole = recovered(data)
        assert len(whole) == 61 * 6 + 1  # clock, tf, odom and three sensors; tf_static
        counts = []
        for length in range(50, len(data), len(data) // 40):
            part = recovered(data[:length])
            assert part == whole[: len(part)]
            counts.append(len(part))
        assert counts == sorted(counts)
        assert counts[0] == 0
        assert len(set(counts)) > 5
        assert counts[-1] == len(whole)

    def test_whole_chunks_are_on_disk_after_a_write(self, tmp_path):
        path = tmp_path / "a.mcap"
        remote = PlainSource()
        with McapRecorder(path, remote, chunk_bytes=1) as recorder:  # each message is a chunk
            for step in range(3):
                remote.now = float(step)
                recorder.write()
                stamps = [log_time for log_time, _ in recovered(path.read_bytes())]
                assert stamps.count(step * 10**9) == 6 + (step == 0)

    def test_an_interrupted_write_keeps_the_chunks_before_it(self, tmp_path, monkeypatch):
        path = tmp_path / "a.mcap"
        remote = PlainSource()
        with McapRecorder(path, remote, chunk_bytes=4000) as recorder:
            for step in range(15):
                remote.now = float(step)
                recorder.write()
            monkeypatch.setattr(recorder._writer._writer, "add_message", interrupted)
            remote.now = 15.0
            with pytest.raises(KeyboardInterrupt):
                recorder.write()
        stamps = [log_time // 10**9 for log_time, _ in recovered(path.read_bytes())]
        assert stamps == sorted(stamps)
        assert 10 < stamps[-1] < 15
        with refused(RuntimeError, "the recorder is closed"):
            recorder.write()

    def test_a_killed_program_leaves_a_readable_file(self, tmp_path):
        path = tmp_path / "a.mcap"
        code = (
            "import flockstep, sys\n"
            "from flockstep.bridges import McapRecorder\n"
            "envs = flockstep.DroneVectorEnv(1, lidar=flockstep.LidarConfig(beams=360, max_range_m=20))\n"
            "envs.reset(seed=0)\n"
            f"recorder = McapRecorder({str(path)!r}, envs, chunk_bytes=50_000)\n"
            "for step in range(10**6):\n"
            "    envs.step(envs.action_space.sample())\n"
            "    recorder.write()\n"
            "    print(step, flush=True)\n"
        )
        written = 0
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
            while written < 200 and (line := process.stdout.readline()):
                written = int(line)
            process.send_signal(signal.SIGKILL)
            written = int((process.stdout.read().splitlines() or [written])[-1])
        stamps = {log_time for log_time, _ in recovered(path.read_bytes())}
        assert written >= 200
        assert written - 20 <= len(stamps) <= written + 2  # a chunk of 50 kB holds about 11 steps
        assert stamps == {100_000_000 * (step + 1) for step in range(len(stamps))}

    def test_recordings_are_read_up_to_anywhere(self, tmp_path):
        path = tmp_path / "a.mcap"
        envs = begun(worlds="playground/train-1", lidar=flockstep.LidarConfig(beams=64))
        seen = []
        with McapRecorder(path, envs, arrays=True, chunk_bytes=20_000) as recorder:
            for _ in range(60):
                actions = envs.action_space.sample()
                envs.step(actions)
                recorder.write(actions)
                seen.append(envs.batch.position.copy())
        whole = path.read_bytes()
        counts = []
        for size in range(len(whole) // 2, len(whole), max(1, len(whole) // 61)):
            path.write_bytes(whole[:size])
            position = flockstep.Recording(path)["position"]
            np.testing.assert_array_equal(position, seen[: len(position)])
            counts.append(len(position))
        assert len(counts) > 20
        assert counts == sorted(counts)
        assert 10 < counts[0] < counts[-1] <= 60
