"""Recordings: what they hold, files that are cut short or hostile, and pages as text."""

import base64
import gzip
import itertools
import json
import random
import re
import struct

import numpy as np
import pytest
from mcap.writer import Writer
from messages import refused
from scipy.spatial.transform import Rotation
from simple_tasks import Still

import flockstep
from flockstep.recordings import Capture, Recording, mcap_files
from flockstep.viewer import page

needs_page = pytest.mark.skipif(not page.is_built(), reason="no page for replays: this build had no Node.js")


def flown(steps=30, num_envs=2, seed=0, **keywords):
    """Envs that were flown at random, their recording, and the arrays after each step."""
    keywords = {"worlds": "playground/train-1", "autoreset_mode": "disabled", **keywords}
    envs = flockstep.DroneVectorEnv(num_envs, **keywords)
    envs.action_space.seed(seed)
    envs.reset(seed=seed)
    capture = Capture(envs)
    capture.add()
    seen = [envs.batch.position.copy()]
    for _ in range(steps):
        actions = envs.action_space.sample()
        envs.step(actions)
        capture.add(actions)
        seen.append(envs.batch.position.copy())
    return envs, capture.recording(), np.array(seen)


@pytest.fixture(scope="module")
def varied():
    """A recording with scans, images, moving objects and rotors."""
    camera = flockstep.CameraConfig(name="front", width_px=16, height_px=12, rate_hz=5)
    bodies = [flockstep.BodyConfig(name=shape, shape=shape, position_m=(3, 3, 2)) for shape in ("box", "sphere")]
    imu = flockstep.ImuConfig()
    task = flockstep.HoverConfig()
    lidar = flockstep.LidarConfig(channels=2, beams=9, vfov_deg=20, max_range_m=6)
    return flown(task=task, camera=camera, bodies=bodies, lidar=lidar, imu=imu, policy_hz=50)


def header_of(text):
    """The header in the first flight of a page."""
    data = gzip.decompress(base64.b64decode(re.split(r'<script type="application/gzip"[^>]*>', text)[1].split("<")[0]))
    return json.loads(data[4 : 4 + struct.unpack("<I", data[:4])[0]]), data


def test_a_recording_holds_what_the_batch_showed(varied):
    envs, recording, seen = varied
    np.testing.assert_array_equal(recording["position"], seen)
    np.testing.assert_array_equal(recording["lidar.lidar.ranges"][-1], envs.batch.lidar().ranges.reshape(2, -1))
    np.testing.assert_array_equal(recording["rotor_speed"][-1], envs.batch.rotor_speed)
    np.testing.assert_array_equal(recording["reward_terms"][-1], envs.batch.reward_terms)
    np.testing.assert_array_equal(recording["bodies.position"][-1], envs.batch.bodies.position)
    np.testing.assert_allclose(recording.times_s, np.arange(31) / 50)
    assert recording.reward_terms == envs.batch.spec.reward_terms
    assert np.isnan(recording["actions"][0]).all()
    assert np.isfinite(recording["actions"][1:]).all()
    assert flockstep.Recipe.from_json(recording.recipe).to_json() == envs.recipe.to_json()


def test_images_are_kept_once(varied):
    envs, recording, _ = varied
    index = recording["camera.front.image"]
    assert len(recording.images["front"]) == len(np.unique(index)) == 2 * 4  # 5 Hz for 0.6 s, and the first
    assert recording.images["front"][index[-1, 1]] == envs.batch.camera().jpeg(1, 85)


def test_files_give_back_every_array(varied, tmp_path):
    _, recording, _ = varied
    recording.save(tmp_path / "flight.mcap")
    read = flockstep.Recording(tmp_path / "flight.mcap")
    assert sorted(read.names) == sorted(recording.names)
    for name in recording.names:
        np.testing.assert_array_equal(read[name], recording[name])
        assert read[name].dtype == recording[name].dtype
    assert (read.images, read.ends, read.title) == (recording.images, recording.ends, recording.title)
    assert [world.to_glb() for world in read.worlds.values()] == [w.to_glb() for w in recording.worlds.values()]


def test_files_hold_the_readings_of_every_sensor(tmp_path):
    """By the engine's list of arrays: those of the first of a kind by their names, of others with its name before."""
    scanner = {"channels": 2, "beams": 5, "vfov_deg": 20, "outputs": ("semantic", "intensity")}
    outputs = ("rgb", "depth", "events")
    sensors = {
        "lidar": [flockstep.LidarConfig(name=name, **scanner) for name in ("top", "low")],
        "camera": flockstep.CameraConfig(name="front", width_px=8, height_px=6, outputs=outputs),
        "imu": [flockstep.ImuConfig(), flockstep.ImuConfig(name="second", latency_s=0.04)],
        "barometer": [flockstep.BarometerConfig(noise_std_pa=3), flockstep.BarometerConfig(name="top")],
        "magnetometer": flockstep.MagnetometerConfig(noise_std_ut=1),
        "gps_receiver": flockstep.GpsReceiverConfig(noise_std_m=1),
        "optical_flow": flockstep.OpticalFlowConfig(noise_std_radps=0.1),
    }
    envs = flockstep.DroneVectorEnv(2, task=flockstep.HoverConfig(), worlds="playground/train-1", **sensors)
    envs.reset(seed=0)
    capture, seen = Capture(envs), []
    with Recording.writer(tmp_path / "flight.mcap", envs) as writer:
        for _ in range(4):
            envs.step(envs.action_space.sample())
            writer.add()
            capture.add()
            batch, now = envs.batch, {}
            for name in ("accelerometer", "pressure", "magnetic_field", "gps_position", "gps_velocity", "gps_fix"):
                now[name] = getattr(batch, name).copy()
            for name in ("optical_flow", "flow_distance", "imu_age_s"):
                now[name] = getattr(batch, name).copy()
            for lidar, name in itertools.product(("top", "low"), ("ranges", "semantic", "intensity")):
                now[f"lidar.{lidar}.{name}"] = getattr(batch.lidar(lidar), name).reshape(2, 10).copy()
            for name in ("depth", "events", "frame_step"):
                now[f"camera.front.{name}"] = getattr(batch.camera(), name).copy()
            for name in ("accelerometer", "gyroscope", "imu_age_s"):
                now[f"imu.second.{name}"] = batch.sensor("second")[name].copy()
            now["barometer.top.pressure"] = batch.sensor("barometer.top")["pressure"].copy()
            seen.append(now)
    read, kept = Recording(tmp_path / "flight.mcap"), capture.recording()
    for name in seen[0]:
        expected = np.array([now[name] for now in seen])
        np.testing.assert_array_equal(read[name], expected, err_msg=name)
        assert read[name].dtype == expected.dtype
    assert read._contents.units["lidar.low.ranges"] == "m"
    assert read._contents.units["imu.second.gyroscope"] == "rad/s"
    # A page shows of cameras only colours.
    extra = {name for name in read.names if name.startswith("camera.front.")} - {"camera.front.image"}
    assert sorted(kept.names) == sorted({*read.names} - extra)
    doubled = {"lidar.top.max_range_m", "imu.imu.accelerometer", "barometer.barometer.pressure", "camera.front.rgb"}
    assert not doubled & {*read.names}


@pytest.mark.parametrize("mountings", [1, 2])
def test_beams_that_turn_are_kept_with_their_turns(mountings, tmp_path):
    lidar = {"channels": 2, "beams": 9, "vfov_deg": 40, "waves": 2, "turn_deg": 137.5, "quat_wxyz": (0.8, 0.6, 0, 0)}
    envs = flockstep.DroneVectorEnv(2, worlds="playground/train-1", lidar=flockstep.LidarConfig(**lidar))
    envs.reset(seed=0)
    if mountings == 2:
        envs.batch.set_lidar([False, True], quat_wxyz=(0.96, 0, 0.28, 0))
    envs.step(envs.action_space.sample())
    capture, seen = Capture(envs), []
    for _ in range(4):
        envs.step(envs.action_space.sample())
        capture.add()
        seen.append(envs.batch.lidar().directions.reshape(2, -1, 3))
    capture.recording().save(tmp_path / "flight.mcap")
    for each in (capture.recording(), Recording(tmp_path / "flight.mcap")):
        (scanner,) = each._contents.settings["scanners"]
        directions, axes = scanner["directions"], scanner["turn_axes"]
        assert len(directions) == len(axes) == mountings
        turns = np.radians(each["lidar.lidar.turn_deg"])
        for moment, drone in np.ndindex(4, 2):
            turn = Rotation.from_rotvec(turns[moment, drone] * np.array(axes[drone % mountings]))
            np.testing.assert_allclose(turn.apply(directions[drone % mountings]), seen[moment][drone], atol=2e-6)
    wrong = capture.recording()
    wrong._contents.settings["scanners"][0]["turn_axes"] = [[0, 1]]
    wrong.save(tmp_path / "wrong.mcap")
    with refused(ValueError, "settings", "(1, 3)", "(1, 2)"):
        Recording(tmp_path / "wrong.mcap")


def replaced_objects():
    """A recording of one slot with a red box, a green ball, the box again, one that is invisible, and nothing."""
    envs = flockstep.DroneVectorEnv(1, worlds="playground/train-1", max_bodies=2)
    envs.reset(seed=0)
    capture, places = Capture(envs), {"position_m": (3, 3, 2)}
    red = flockstep.BodyConfig(name="red", color=(1, 0, 0), **places)
    green = flockstep.BodyConfig(name="green", color=(0, 1, 0), shape="sphere", **places)
    for body in (red, green, red, flockstep.BodyConfig(visibility="solid", **places), None):
        envs.batch.bodies.remove()
        if body is not None:
            envs.batch.bodies.spawn(body)
        capture.add()
    return capture.recording()


def test_a_slot_that_is_used_again_gets_its_new_look(tmp_path, monkeypatch):
    recording = replaced_objects()
    recording.save(tmp_path / "flight.mcap")
    for each in (recording, Recording(tmp_path / "flight.mcap")):
        np.testing.assert_array_equal(each["bodies.look"][:, 0], [[0, -1], [1, -1], [0, -1], [-1, -1], [-1, -1]])
        assert [look.name for look in each._contents.bodies] == ["red", "green"]
    attach = mcap_files.ArrayChannels._attach
    monkeypatch.setattr(
        mcap_files.ArrayChannels,
        "_attach",
        lambda channels, name, look: name != "body-0.glb" and attach(channels, name, look),
    )
    recording.save(tmp_path / "damaged.mcap")
    with refused(ValueError, "bodies", "0 to 0", "[1]"):
        Recording(tmp_path / "damaged.mcap")


def test_a_race_is_recorded_with_the_gates_that_were_passed():
    policy = flockstep.policies.load("race")
    envs = flockstep.DroneVectorEnv(2, task=flockstep.RaceConfig(start="gate"), autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    capture, rewards = Capture(envs), np.zeros((1, 2))
    capture.add()
    for _ in range(100):
        observation, *_ = envs.step(policy.predict(observation, deterministic=True)[0])
        capture.add()
        rewards = np.vstack([rewards, envs.batch.reward_terms[:, envs.batch.spec.reward_terms.index("gate")]])
    recording = capture.recording()
    passed = np.round(np.cumsum(rewards, axis=0) / flockstep.RaceConfig().gate_weight)
    assert passed[-1].min() > 0
    np.testing.assert_array_equal(recording["gate.passed"], passed)
    np.testing.assert_array_equal((recording["gate.next"] - recording["gate.next"][0]) % 7, passed % 7)
    assert "gate.next" not in flown(steps=1)[1]


@pytest.mark.parametrize("suffix", [".mcap", ".html"])
def test_planned_paths_are_kept(suffix, tmp_path):
    if suffix == ".html" and not page.is_built():
        pytest.skip("no page for replays: this build had no Node.js")
    path = tmp_path / f"flight{suffix}"
    planned = [flockstep.plan("playground/train-1", (2, 2, 2), [(6, 6, 2)]), [(0, 0, 1), (1, 0.1, 1)]]
    flockstep.record(path, steps=2, worlds="playground/train-1", paths=planned, quiet=True)
    found = Recording(path).paths if suffix == ".mcap" else header_of(path.read_text())[0]["paths"]
    assert len(found) == 2
    for kept, given in zip(found, planned, strict=True):
        np.testing.assert_array_equal(kept, given)


@pytest.mark.parametrize("wrong", [[None], [[(0, 0, 0)]], [[(0, 0), (1, 1)]], [[(0, 0, 0), (0, 0, np.nan)]], [["<b>"]]])
def test_what_is_no_path_is_refused_before_there_is_a_file(wrong, tmp_path):
    for suffix in (".mcap", ".html") if page.is_built() else (".mcap",):
        with refused(ValueError, "paths[1]: expected an array (P, 3) of finite numbers with P >= 2, got "):
            path, paths = tmp_path / f"flight{suffix}", [[(0, 0, 0), (1, 1, 1)], *wrong]
            flockstep.record(path, steps=2, worlds="playground/train-1", paths=paths, quiet=True)
    with refused(ValueError, "paths: expected none for .mp4, got 1"):
        flockstep.record(tmp_path / "film.mp4", paths=wrong)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_cut_short_is_read_up_to_its_end(tmp_path):
    _, recording, _ = flown(steps=300, num_envs=4)
    recording.save(tmp_path / "flight.mcap")
    whole = (tmp_path / "flight.mcap").read_bytes()
    lengths = []
    for cut in (0.2, 0.5, 0.8, 0.99):
        (tmp_path / "cut.mcap").write_bytes(whole[: int(cut * len(whole))])
        try:
            read = Recording(tmp_path / "cut.mcap")
        except ValueError:  # no moment is whole
            lengths.append(0)
            continue
        lengths.append(len(read))
        for name in read.names:
            np.testing.assert_array_equal(read[name], recording[name][: len(read)])
    assert lengths == sorted(lengths)
    assert lengths[-1] > 150


def test_random_damage_is_refused_or_harmless(varied, tmp_path):
    _, recording, _ = varied
    recording.save(tmp_path / "flight.mcap")
    whole = bytearray((tmp_path / "flight.mcap").read_bytes())
    chance = random.Random(0)
    refusals = 0
    for _ in range(150):
        damaged = bytearray(whole)
        for _ in range(chance.choice((1, 4, 30))):
            damaged[chance.randrange(8, len(damaged))] = chance.randrange(256)
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        try:
            assert len(Recording(tmp_path / "damaged.mcap")) <= len(recording)
        except ValueError:
            refusals += 1
    assert refusals > 5


def test_a_file_that_would_fill_the_memory_is_refused(varied, tmp_path, monkeypatch):
    _, recording, _ = varied
    recording.save(tmp_path / "flight.mcap")
    with open(tmp_path / "bomb.mcap", "wb") as stream:
        writer = Writer(stream, chunk_size=1 << 24)
        writer.start()
        channel = writer.register_channel("/flockstep/position", "flockstep", 0)
        for moment in range(64):
            writer.add_message(channel, moment, bytes(1 << 24), moment)
        writer.finish()
    assert (tmp_path / "bomb.mcap").stat().st_size < 1 << 20
    with refused(ValueError, "path", "500-fold"):
        Recording(tmp_path / "bomb.mcap")


def test_other_files_are_refused(tmp_path):
    for name, content in (("empty", b""), ("text", b"no recording" * 100)):
        (tmp_path / f"{name}.mcap").write_bytes(content)
        with refused(ValueError, "path", "flockstep", "another file"):
            Recording(tmp_path / f"{name}.mcap")
    with refused(ValueError, "path", ".mcap", "flight.html"):
        Recording("flight.html")
    with pytest.raises(FileNotFoundError):
        Recording(tmp_path / "none.mcap")


def test_ends_say_why(closet, tmp_path):
    _, recording, _ = flown(steps=250, num_envs=3, worlds=closet)
    assert [end.reason.name for end in recording.ends] == ["contact"] * 3
    for end in recording.ends:
        assert recording["terminated"][end.moment, end.row]
        assert not recording["terminated"][end.moment - 1, end.row]
        assert recording["contact.hit"][end.moment, end.row]
        assert end.episode_length == end.moment


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_ends_are_counted_once_with_every_autoreset_mode(mode, closet):
    _, recording, _ = flown(steps=300, num_envs=2, worlds=closet, autoreset_mode=mode)
    episodes = recording["episode"][-1] + (recording["terminated"][-1] if mode == "next_step" else 0)
    counts = np.bincount([end.row for end in recording.ends], minlength=2)
    np.testing.assert_array_equal(counts, episodes)
    assert counts.min() > 1


def test_an_evaluation_is_the_same_when_it_is_recorded(room, tmp_path):
    plain = flockstep.evaluate(None, episodes=5, worlds=room, seed=3, max_episode_steps=50)
    kept = flockstep.evaluate(None, episodes=5, worlds=room, seed=3, max_episode_steps=50, record=tmp_path / "e.mcap")
    assert plain == kept
    recording = Recording(tmp_path / "e.mcap")
    assert recording.num_envs == 5
    assert np.mean([end.episode_return for end in recording.ends]) == pytest.approx(plain.episode_return)
    shares = {reason: share for reason, share in plain.ends.items() if share}
    assert {end.reason.name for end in recording.ends} == set(shares)


def test_flights_that_an_evaluation_cannot_record(room, tmp_path):
    keywords = {"worlds": room, "drones_per_env": 2, "drone_episodes": "each", "record": tmp_path / "e.mcap"}
    with refused(ValueError, "record", "None", "each"):
        flockstep.evaluate(None, "flockstep/Hover-v0", 2, **keywords)


def test_record_writes_a_file_step_by_step_with_ros_messages(room, tmp_path):
    count = flockstep.record(tmp_path / "flight.mcap", worlds=room, steps=12, quiet=True)
    recording = Recording(tmp_path / "flight.mcap")
    assert count == len(recording) == 13
    np.testing.assert_allclose(recording.times_s, np.arange(13) / 10, atol=1e-9)
    content = (tmp_path / "flight.mcap").read_bytes()
    assert b"sensor_msgs/msg/PointCloud2" in content
    assert b"/flockstep/position" in content


@needs_page
def test_a_page_is_the_same_from_memory_and_from_a_file(varied, tmp_path):
    _, recording, _ = varied
    recording.save(tmp_path / "flight.mcap")
    text = page.page([recording])
    assert text == page.page([Recording(tmp_path / "flight.mcap")])
    header, _ = header_of(text)
    assert header["steps"] == 31
    assert {body["name"] for body in header["bodies"]} == {"box", "sphere"}


@needs_page
def test_a_page_holds_positions_bit_by_bit_and_ranges_to_a_hundred_thousandth(varied):
    _, recording, _ = varied
    header, data = header_of(page.page([recording]))
    begin = -(-(4 + struct.unpack("<I", data[:4])[0]) // 8) * 8
    arrays = {array["name"]: array for array in header["arrays"]}

    def values(name, dtype):
        array = arrays[name]
        return np.frombuffer(data, dtype, int(np.prod(array["shape"])), begin + array["at"]).reshape(array["shape"])

    np.testing.assert_array_equal(values("position", "<f4"), recording["position"])
    ranges = recording["lidar.lidar.ranges"]
    numbers = values("lidar.lidar.ranges", "<u2")
    is_hit = np.isfinite(ranges)
    np.testing.assert_array_equal(numbers != 65535, is_hit)
    shown = numbers[is_hit] * arrays["lidar.lidar.ranges"]["scale"]
    np.testing.assert_allclose(shown, ranges[is_hit], atol=6 * 1e-5)


@needs_page
def test_names_never_become_markup(varied):
    _, recording, _ = varied
    recording.title = '</script><script>alert("x")</script><!-- flights -->'
    text = page.page([recording])
    assert "alert(" not in text
    assert header_of(text)[0]["title"] == recording.title


@needs_page
def test_the_page_is_small_and_connects_to_nothing():
    text = page.template()
    assert len(gzip.compress(text.encode())) < 1_000_000
    policy = text.split('Content-Security-Policy" content="')[1].split('"')[0]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
    assert "connect-src" not in policy
    assert "<script src" not in text


@needs_page
def test_a_notebook_gets_the_page_in_a_frame(varied, monkeypatch):
    shown = []
    module = type("display", (), {"HTML": staticmethod(shown.append)})
    monkeypatch.setitem(__import__("sys").modules, "IPython", type("IPython", (), {"display": module}))
    monkeypatch.setitem(__import__("sys").modules, "IPython.display", module)
    _, recording, _ = varied
    flockstep.show(recording, recording, height=300)
    assert shown[0].startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert shown[0].count("application/gzip") >= 2
    with refused(ValueError, "recordings", "one or two", "3"):
        flockstep.show(recording, recording, recording)


def test_a_build_without_a_page_says_so(varied, monkeypatch, tmp_path):
    _, recording, _ = varied
    monkeypatch.setattr(page, "PAGE", tmp_path / "page.html")
    with refused(FileNotFoundError, "page.html", "./dev viewer"):
        recording.save(tmp_path / "flight.html")
    with refused(FileNotFoundError, "page.html", "./dev viewer"):
        flockstep.record(tmp_path / "flight.html", env=Still)
    assert not (tmp_path / "flight.html").exists()


def test_captures_need_a_moment():
    envs = flockstep.DroneVectorEnv(1, worlds="playground/train-1")
    envs.reset(seed=0)
    with refused(RuntimeError, "capture", "empty"):
        Capture(envs).recording()
    with refused(ValueError, "path", ".html", ".mcap", "flight.mp4"):
        flockstep.Recording.writer("flight.mp4", envs)
