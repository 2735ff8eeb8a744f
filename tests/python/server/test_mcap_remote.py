"""MCAP files of the drones of a server, and those of the command, read by rosbags."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from clients import eventually
from conftest import WITHOUT
from messages import refused
from PIL import Image
from ros_files import LOOK, TILT, Tree, cloud_of, matrix_of, quaternion, read, stamp_ns, vector

import flockstep
from flockstep.bridges import ClientSource, McapRecorder, Source

SECRET = "a-secret"
EMPTY_SKY = """{"flockstep_recipe": 1, "task": null, "worlds": ["playground/train-1"], "num_envs": 1,
  "drones_per_env": 0, "lidars": [{}]}"""


@pytest.fixture
def batch():
    return flockstep.Batch(
        "playground/train-1",
        2,
        drones_per_env=2,
        lidar=flockstep.LidarConfig(channels=4, beams=48, vfov_deg=40, offset_m=(0.1, -0.05, 0.2), quat_wxyz=TILT),
        cameras=[
            flockstep.CameraConfig(width_px=96, height_px=64, offset_m=(0.2, 0.1, -0.05), quat_wxyz=LOOK),
            flockstep.CameraConfig(name="far", width_px=8, height_px=8, outputs=["depth"]),
        ],
    )


def hits(scan):
    """Return the points of a scan in the frame map."""
    is_hit = np.isfinite(scan.ranges)
    beams = (scan.ranges[..., None] * scan.directions)[is_hit]
    frame = matrix_of(scan.origin, scan.quat_wxyz)
    return beams @ frame[:3, :3].T + frame[:3, 3]


class TestClientSource:
    def test_a_flight(self, client, batch, tmp_path):
        source = ClientSource(client, clock="simulated")
        assert isinstance(source, Source)
        seen = []
        with McapRecorder(tmp_path / "a.mcap", source) as recorder:
            for step in range(6):
                at = np.float32([[3 + 0.1 * step, 3, 2], [4, 3 + 0.1 * step, 2.5]])
                client.set_poses(at, [[np.cos(0.1 * step), 0, 0, np.sin(0.1 * step)]] * 2)
                client.step()
                recorder.write()
                scans = [drone.get_lidar_data() for drone in client.get_drones()]
                seen.append((batch.position.copy(), batch.quat_wxyz.copy(), scans, batch.camera("front").rgb.copy()))
        found = read(tmp_path / "a.mcap")
        assert {topic: len(messages) for topic, messages in found.items()} == {
            "/clock": 6,
            "/tf": 6,
            "/tf_static": 1,
            **{f"/drone{drone}/lidar/points": 6 for drone in range(2)},
            **{f"/drone{drone}/front/image/compressed": 6 for drone in range(2)},
        }
        assert [stamp for stamp, _ in found["/clock"]] == [round(1e9 * client.info.step_s) * n for n in range(1, 7)]
        for index, (position, quat, scans, rgb) in enumerate(seen):
            tree = Tree(found, index)
            for drone in range(2):
                frame = tree.to_map(f"drone{drone}/base_link")
                np.testing.assert_array_equal(frame[:3, 3], position[drone])
                w, _, _, z = quat[drone].astype(float)
                np.testing.assert_allclose(np.arctan2(frame[1, 0], frame[0, 0]), 2 * np.arctan2(z, w), atol=1e-6)
                message = found[f"/drone{drone}/lidar/points"][index][1]
                placed = tree.placed(message.header.frame_id, cloud_of(message).astype(float))
                np.testing.assert_allclose(placed, hits(scans[drone]), rtol=0, atol=5e-6)
                assert 0 < len(placed) < 4 * 48
                image = found[f"/drone{drone}/front/image/compressed"][index][1]
                with Image.open(io.BytesIO(image.data.tobytes())) as file:
                    assert np.abs(np.asarray(file.convert("RGB"), float) - rgb[drone]).mean() < 4
        mounting = Tree(found, 0).to_map("drone0/base_link")
        np.testing.assert_allclose(
            (np.linalg.inv(mounting) @ Tree(found, 0).to_map("drone0/lidar"))[:3, 3], [0.1, -0.05, 0.2], atol=1e-6
        )

    def test_velocities_of_drones_with_rotors(self, tmp_path):
        dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
        imu = flockstep.ImuConfig(offset_m=(0.1, -0.05, 0.2), quat_wxyz=TILT)
        batch = flockstep.Batch("playground/train-1", drone="x500", dynamics=dynamics, imu=imu)
        with (
            flockstep.serve(batch, port=0) as server,
            flockstep.connect(server.address) as client,
            McapRecorder(tmp_path / "a.mcap", ClientSource(client)) as recorder,
        ):
            client.set_poses([[3, 3, 2]], teleport=True)
            client.set_command([[0.5, 0, 0.2, 0]])
            for _ in range(10):
                client.step()
            recorder.write()
        found = read(tmp_path / "a.mcap")
        assert sorted(found) == ["/clock", "/drone0/imu/data", "/drone0/odom", "/tf", "/tf_static"]
        ((_, reading),) = found["/drone0/imu/data"]
        assert reading.header.frame_id == "drone0/imu"
        np.testing.assert_array_equal(vector(reading.linear_acceleration), batch.sensor("imu")["accelerometer"][0])
        np.testing.assert_array_equal(vector(reading.angular_velocity), batch.sensor("imu")["gyroscope"][0])
        assert np.linalg.norm(vector(reading.linear_acceleration)) > 1
        ((_, static),) = found["/tf_static"]
        (mounting,) = (transform for transform in static.transforms if transform.child_frame_id == "drone0/imu")
        np.testing.assert_allclose(vector(mounting.transform.translation), [0.1, -0.05, 0.2], atol=1e-6)
        np.testing.assert_allclose(quaternion(mounting.transform.rotation), TILT, atol=1e-6)
        ((_, odometry),) = found["/drone0/odom"]
        np.testing.assert_array_equal(vector(odometry.pose.pose.position), batch.position[0])
        assert np.linalg.norm(batch.velocity[0]) > 0.1
        np.testing.assert_allclose(
            np.linalg.norm(vector(odometry.twist.twist.linear)), np.linalg.norm(batch.velocity[0]), rtol=1e-5
        )
        np.testing.assert_array_equal(vector(odometry.twist.twist.angular), batch.angular_velocity[0])

    def test_drones_come_and_go(self, tmp_path):
        batch = flockstep.Batch.from_recipe(flockstep.Recipe.from_json(EMPTY_SKY))
        with (
            flockstep.serve(batch, port=0) as server,
            flockstep.connect(server.address) as client,
            McapRecorder(tmp_path / "a.mcap", ClientSource(client)) as recorder,
        ):
            recorder.write()
            first = client.spawn_drone([3, 3, 2])
            recorder.write()
            second = client.spawn_drone([4, 3, 2])
            recorder.write()
            first.remove()
            recorder.write()
            second.remove()
            recorder.write()
        found = read(tmp_path / "a.mcap")
        frames = [[part.child_frame_id for part in message.transforms] for _, message in found["/tf"]]
        both = ["drone0/base_link", "drone1/base_link"]
        assert frames == [[], both[:1], both, both[1:], []]
        static = [[part.child_frame_id for part in message.transforms] for _, message in found["/tf_static"]]
        assert static == [[], ["drone0/lidar"], ["drone0/lidar", "drone1/lidar"], ["drone1/lidar"], []]
        stamps = [stamp for stamp, _ in found["/clock"]]
        assert len(stamps) == 5
        assert [stamp for stamp, _ in found["/drone0/lidar/points"]] == stamps[1:3]
        assert [stamp for stamp, _ in found["/drone1/lidar/points"]] == stamps[2:4]
        for _, message in found["/tf_static"]:
            for part in message.transforms:
                assert stamp_ns(part.header.stamp) in stamps

    def test_a_drone_that_moves_or_leaves_between_two_requests(self, client):
        """Its points are where the beams hit, and a drone that is gone has neither points nor an image."""
        source = ClientSource(client)
        client.drone(0).set_location([3, 3, 2], teleport=True)
        source.time_s()
        client.drone(0).set_location_and_rotation([3.5, 3.2, 2.1], [1, 0.1, 0.2, 0.3], teleport=True)
        points = source.points("lidar", 0).astype(float)
        (place, *_), (quat_wxyz, *_) = source.poses()
        frame = matrix_of(place, quat_wxyz) @ matrix_of(*source.mounting("lidar", 0))
        placed = points @ frame[:3, :3].T + frame[:3, 3]
        np.testing.assert_array_equal(source.poses()[0][0], [3, 3, 2])
        np.testing.assert_allclose(placed, hits(client.drone(0).get_lidar_data()), atol=1e-5)
        assert len(points) > 0
        client.drone(0).remove()
        assert source.points("lidar", 0).shape == (0, 3)
        assert source.jpeg("front", 0) is None
        assert source.jpeg("front", 1) is not None
        assert source.jpeg("far", 1) is None
        source.time_s()
        assert source.drones == ["drone1"]

    def test_chosen_drones(self, client):
        source = ClientSource(client, [1, 7])
        assert source.drones == ["drone1"]
        np.testing.assert_array_equal(source.poses()[0][0], client.drone(1).get_location())

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            ({"drones": []}, ("drones",)),
            ({"drones": [-1]}, ("drones", [-1])),
            ({"clock": "wall"}, ("clock", "wall")),
            ({"jpeg_quality": 0}, ("jpeg_quality", 0)),
        ],
    )
    def test_refusals(self, client, arguments, said):
        with refused(ValueError, *said):
            ClientSource(client, **arguments)


def start(folder, *arguments, **environment):
    """Start a command of flockstep in a folder; return the process and its first line."""
    process = subprocess.Popen(
        [sys.executable, "-m", "flockstep", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | environment,
    )
    return process, process.stdout.readline()


class TestCommand:
    def test_three_terminals(self, tmp_path):
        """The recorded positions are those that were flown."""
        served, line = start(tmp_path, "serve", "--port", "0", FLOCKSTEP_TOKEN=SECRET)
        with served:
            address = re.search(r"at (\S+);", line)[1]
            arguments = ["mcap", "--connect", address, "--rate", "front=5", "square.mcap"]
            recording, line = start(tmp_path, *arguments, FLOCKSTEP_TOKEN=SECRET)
            with recording, flockstep.connect(address, token=SECRET) as client:
                assert "recording" in line
                drone = client.spawn_drone()
                x, y, z = drone.get_location()
                flown = []
                for corner in [(x + 0.5, y, z), (x + 0.5, y + 0.5, z), (x, y + 0.5, z), (x, y, z)]:
                    flown.append(drone.set_location(corner).location)
                    time.sleep(0.5)
                drone.remove()
                time.sleep(0.5)
                recording.send_signal(signal.SIGINT)
                assert recording.wait(20) == 0
                assert re.fullmatch(
                    r"square\.mcap: \d+ moments, 1 drone, sensors lidar, front\n", recording.stdout.read()
                )
            served.send_signal(signal.SIGINT)
            assert served.wait(20) == 0
        found = read(tmp_path / "square.mcap")
        positions = [vector(part.transform.translation) for _, tf in found["/tf"] for part in tf.transforms]
        changes = [
            at for at, before in zip(positions, [None, *positions], strict=False) if not np.array_equal(at, before)
        ]
        np.testing.assert_array_equal(changes[-4:], flown)
        stamps = np.array([stamp for stamp, _ in found["/clock"]]) / 1e9
        assert stamps[0] < 0.5
        assert 2.3 < stamps[-1] < 10
        assert 8 <= len(found["/drone0/front/image/compressed"]) < len(found["/drone0/lidar/points"])
        assert found["/drone0/lidar/points"][0][1].width > 0

    def test_it_ends_after_its_seconds(self, tmp_path):
        with flockstep.serve(flockstep.Batch("playground/train-1"), port=0) as server:
            recording, _ = start(tmp_path, "mcap", "--connect", server.address, "--seconds", "0.5", "a.mcap")
            with recording:
                assert recording.wait(20) == 0
        stamps = [stamp for stamp, _ in read(tmp_path / "a.mcap")["/clock"]]
        assert 0.3e9 < stamps[-1] < 0.6e9
        assert len(stamps) > 5

    def test_a_server_that_stops_ends_a_whole_file(self, tmp_path):
        with flockstep.serve(flockstep.Batch("playground/train-1"), port=0) as server:
            recording, _ = start(tmp_path, "mcap", "--connect", server.address, "a.mcap")
            time.sleep(0.5)
        with recording:
            assert recording.wait(20) == 1
            assert re.fullmatch(r"flockstep mcap: .*the server stops\n", recording.stdout.read())
        assert len(read(tmp_path / "a.mcap")["/clock"]) > 5

    def test_refusals_are_one_line(self, tmp_path):
        with flockstep.serve(flockstep.Batch("playground/train-1"), port=0, token=SECRET) as server:
            connect = ["--connect", server.address]
            for arguments, text in (
                (connect, "token: this server requires one"),
                (["recipe.json", *connect], "recipe: expected none together with --connect"),
                ([*connect, "--seconds", "0"], "seconds: expected a number > 0, got 0"),
                (["--ca-file", "a.pem"], "ca-file: expected together with --connect only"),
            ):
                process, line = start(tmp_path, "mcap", "a.mcap", *arguments)
                rest, _ = process.communicate(timeout=60)
                assert process.returncode == 1
                assert text in line
                assert rest == ""
        assert not (tmp_path / "a.mcap").exists()


class TestPackages:
    def test_the_missing_package_is_named(self):
        code = WITHOUT.format(names=["mcap", "mcap_ros2"]) + (
            "import flockstep\n"
            "from flockstep.bridges import McapRecorder\n"
            "try:\n"
            "    McapRecorder('a.mcap', flockstep.Batch('playground/train-1'))\n"
            "except ModuleNotFoundError as error:\n"
            "    print(error)\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stdout.strip().endswith("which is not installed: pip install mcap mcap-ros2-support")

    def test_the_command(self, tmp_path):
        recipe = tmp_path / "recipe.json"
        recipe.write_text(json.dumps({"task": {"name": "hover"}, "clock": {"policy_hz": 50}, "imus": [{}]}))
        path = tmp_path / "a.mcap"
        command = [sys.executable, "-m", "flockstep", "mcap"]
        arguments = [str(path), str(recipe), "--seconds", "2", "--rate", "imu=10", "--seed", "4"]
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=True)
        assert done.stdout == f"{path}: 100 steps of drone0, sensors imu\n"
        found = read(path)
        assert (len(found["/clock"]), len(found["/drone0/imu/data"])) == (101, 21)
        endless = [*command, str(path), "--seconds", "1e9"]
        with subprocess.Popen(endless, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            size = path.stat().st_size
            eventually(lambda: process.poll() is not None or path.stat().st_size not in (0, size), 60)
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate()
        assert (process.returncode, err) == (0, "")
        steps = int(out.split(": ")[1].split()[0])
        assert len(read(path)["/clock"]) == steps + 1
        for wrong, message in (
            (["--rate", "imu"], "rate: expected NAME=HZ, such as lidar=10, got 'imu'"),
            (["--rate", "imu=nan"], "rates_hz['imu']: expected a number > 0, got nan"),
            (["--seconds", "-1"], "seconds: expected a number > 0, got -1"),
        ):
            done = subprocess.run([*command, *arguments, *wrong], capture_output=True, text=True, check=False)
            assert (done.returncode, done.stderr) == (1, f"flockstep mcap: {message}\n")
        done = subprocess.run([*command, str(path), "--env", "nope-v0"], capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert re.fullmatch(r"flockstep mcap: .*nope.*\n", done.stderr)
