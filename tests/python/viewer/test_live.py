"""The live view without a browser: what a client gets and may do, pauses, trainings, and ends."""

import json
import pickle
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from urllib.request import Request, urlopen

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from messages import refused
from simple_tasks import Still
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import flockstep
from flockstep.recordings.moment import Moments
from flockstep.viewer import page

pytestmark = pytest.mark.skipif(not page.is_built(), reason="no page: this build had no Node.js")
PATIENCE_S = 60


class Watcher:
    """A page in Python."""

    def __init__(self, address, **keywords):
        self._open = ExitStack()
        address = address.replace("http", "ws", 1).replace("/?", "/live?")
        self._socket = self._open.enter_context(connect(address, max_size=None, **keywords))
        self.status, self.worlds, self.moments = {}, [], []

    def say(self, **message):
        self._socket.send(json.dumps(message))

    def send(self, text):
        self._socket.send(text)

    def until(self, condition):
        """Take moments and answer until a condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, (self.status, len(self.moments))
            message = self._socket.recv(timeout=PATIENCE_S)
            if isinstance(message, str):
                self.status = json.loads(message)
                continue
            size = struct.unpack("<I", message[:4])[0]
            header = json.loads(message[4 : 4 + size])
            if not header["goes_on"]:
                self.moments = []
            self.worlds[header["first_world"] :] = [world["name"] for world in header["worlds"]]
            begin = -(-(4 + size) // 8) * 8
            arrays = {}
            for array in header["arrays"]:
                kind = np.dtype("<" + array["dtype"]) if array["dtype"] != "u1" else np.uint8
                count = int(np.prod(array["shape"]))
                arrays[array["name"]] = np.frombuffer(message, kind, count, begin + array["at"]).reshape(array["shape"])
            self.moments.append(arrays | {"ends": header["ends"]})
            self.say(got=True)

    def next(self):
        """The moment after those that have come."""
        before = self.moments[-1] if self.moments else None
        self.until(lambda: bool(self.moments) and self.moments[-1] is not before)
        return self.moments[-1]

    def close(self):
        self._open.close()


@contextmanager
def stepping(step):
    """Step in another thread, and give the number of steps so far."""
    count, over = [0], threading.Event()

    def run():
        while not over.is_set():
            step()
            count[0] += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield lambda: count[0]
    finally:
        over.set()
        thread.join()


def made(num_envs=4, **keywords):
    envs = flockstep.DroneVectorEnv(num_envs, **{"worlds": "train", "num_threads": 1, **keywords})
    envs.reset(seed=0)
    return envs


def moved(count):
    """Wait until a program has gone on by two steps."""
    before, end = count(), time.monotonic() + PATIENCE_S
    while count() < before + 2:
        assert time.monotonic() < end
        time.sleep(0.001)


def held(live):
    """Wait until the program stands still."""
    end = time.monotonic() + PATIENCE_S
    while not live._changed._waiters:
        assert time.monotonic() < end
        time.sleep(0.001)


def test_a_page_sees_the_env_that_it_chooses():
    envs = made(drones_per_env=2)
    with flockstep.view(envs, browser=False) as live:
        watcher = Watcher(live.address)
        with stepping(lambda: envs.step(envs.action_space.sample())):
            watcher.until(lambda: len(watcher.moments) > 3)
            assert watcher.worlds == [envs.batch.worlds[0].name]
            watcher.say(paused=True)
            watcher.until(lambda: watcher.status.get("paused"))
            held(live)
            watcher.say(env=3)
            watcher.until(lambda: watcher.status["env"] == 3 and len(watcher.moments) == 1)
            np.testing.assert_array_equal(watcher.moments[0]["position"][0], envs.batch.position[6:8])
            assert watcher.worlds == [envs.batch.worlds[i].name for i in (0, 3)]
            assert watcher.moments[0]["time_s"].tolist() == [0]
            before = envs.batch.steps.copy()
            for number in (1, 2, 3):
                watcher.say(step=True)
                moment = watcher.next()
                assert (envs.batch.steps != before).all()
                np.testing.assert_array_equal(moment["position"][0], envs.batch.position[6:8])
                np.testing.assert_allclose(moment["time_s"], [number / 10])
                before = envs.batch.steps.copy()
            watcher.say(paused=False)
            watcher.next()
    assert envs._watched is envs._live is None


def test_a_slow_page_misses_moments_and_the_last_page_lets_the_program_go_on():
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        assert envs._watched is None
        watcher = Watcher(live.address)
        with stepping(lambda: envs.step(envs.action_space.sample())) as count:
            watcher.until(lambda: watcher.moments)
            (opened,) = live._pages
            moved(count)  # without answers
            assert opened.taken - opened.answered <= 2
            watcher.say(paused=True)
            watcher.until(lambda: watcher.status.get("paused"))
            watcher.close()
            moved(count)
        assert not live.is_watched
        assert envs._watched is None


@pytest.mark.parametrize("wraps", ["vector env", "single env", "Gymnasium", "Stable-Baselines3"])
def test_every_kind_of_env_can_be_watched(wraps):
    if wraps == "Stable-Baselines3":
        pytest.importorskip("stable_baselines3")
        envs = flockstep.sb3.make_vec(num_envs=2, worlds="train")
        envs.reset()
        act = lambda: envs.step(np.zeros(2, np.int64))  # noqa: E731
    elif wraps == "vector env":
        envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(made())
        envs.reset(seed=0)
        act = lambda: envs.step(envs.action_space.sample())  # noqa: E731
    else:
        envs = flockstep.DroneEnv() if wraps == "single env" else gymnasium.make("flockstep/LidarNavigation-v0")
        envs.reset(seed=0)

        def act():
            if any(envs.step(envs.action_space.sample())[2:4]):
                envs.reset()

    live = flockstep.view(envs, browser=False)
    watcher = Watcher(live.address)
    with stepping(act):
        watcher.until(lambda: len(watcher.moments) > 2)
    envs.close()
    assert not live._thread.is_alive()


@pytest.mark.parametrize("learner", ["PPO", "APG"])
def test_trainings_are_watched(learner):
    envs = flockstep.DroneVectorEnv(64, task=flockstep.HoverConfig(), autoreset_mode="same_step", num_threads=1)
    model = getattr(flockstep, learner)("MlpPolicy", envs, seed=0)
    with flockstep.view(model.get_env(), browser=False) as live:
        watcher = Watcher(live.address)
        seen = threading.Event()
        thread = threading.Thread(target=lambda: (watcher.until(lambda: len(watcher.moments) > 3), seen.set()))
        thread.start()
        while not seen.is_set():
            model.learn(64 * 64, reset_num_timesteps=False)
        thread.join()
    assert np.isfinite(watcher.moments[-1]["position"]).all()
    if learner == "PPO":  # APG shows only the end of each window
        chosen = watcher.moments[-1]["actions"]
        assert np.isfinite(chosen).all()
        assert chosen.any()


def test_ends_of_episodes_are_told_once(closet):
    envs = made(1, worlds=closet, autoreset_mode="disabled")
    with flockstep.view(envs, browser=False) as live:
        watcher = Watcher(live.address)
        watcher.say(paused=True)
        watcher.until(lambda: watcher.status.get("paused"))  # or the episode might end before the first moment
        with stepping(lambda: envs.step([0])):
            told = []
            watcher.until(lambda: watcher.moments)
            while not envs.batch.terminated[0]:
                watcher.say(step=True)
                told += watcher.next()["ends"]
            for _ in range(3):
                watcher.say(step=True)
                told += watcher.next()["ends"]
            watcher.say(paused=False)
        assert [end["reason"] for end in told] == ["contact"]


def test_images_are_numbered_through():
    camera = flockstep.CameraConfig(name="front", width_px=16, height_px=12)
    envs = made(1, camera=camera)
    with flockstep.view(envs, browser=False) as live, stepping(lambda: envs.step([2])):
        watcher = Watcher(live.address)
        watcher.until(lambda: len(watcher.moments) > 5)
        numbers = [int(moment["camera.front.image"][0, 0]) for moment in watcher.moments]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_an_image_of_the_next_episode_is_another_one():
    camera = flockstep.CameraConfig(name="front", width_px=16, height_px=12)
    envs = made(1, camera=camera, max_episode_steps=1)
    moments = Moments(envs.batch)
    numbers = []
    for _ in range(4):
        numbers.append(int(moments.now()[0]["camera.front.image"][0]))
        envs.step([2])  # ends the episode
        envs.step([2])  # begins the next one, whose first image has the same step
    assert numbers == [0, 1, 2, 3]


def test_strangers_get_nothing():
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        assert live.address.startswith("http://127.0.0.1:")
        for address in (live.address[:-1], live.address.split("?")[0], f"{live.address}&token=x"):
            with pytest.raises(OSError, match="403"):
                urlopen(address)
            with pytest.raises(InvalidStatus, match="403"):
                Watcher(address if "?" in address else f"{address}?")
        for origin in ("http://example.org", "null", "https://127.0.0.1"):
            with pytest.raises(InvalidStatus, match="403"):
                Watcher(live.address, origin=origin)
            with pytest.raises(OSError, match="403"):
                urlopen(Request(live.address, headers={"Origin": origin}))
        with pytest.raises(OSError, match="404"):
            urlopen(live.address.replace("/?", "/other?"))
        with urlopen(live.address) as answer:
            assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
            assert "connect-src ws://127.0.0.1:" in answer.read().decode()
        Watcher(live.address, origin=live.address.split("/?")[0]).close()


HOSTILE = [
    "",
    "{",
    "[]",
    "null",
    "1e999",
    '{"env": -1}',
    '{"env": 4}',
    '{"env": 1e9}',
    '{"env": true}',
    '{"env": NaN}',
    '{"env": ' + "9" * 4000 + "}",
    '{"env": {"env": 1}}',
    '{"paused": 1}',
    '{"paused": "true"}',
    '{"step": 1}',
    '{"sticks": [NaN, 0, 0, 0]}',
    '{"sticks": [1e999, 0, 0, 0]}',
    '{"sticks": [2, 0, 0, 0]}',
    '{"sticks": [true, 0, 0, 0]}',
    '{"sticks": [0, 0, 0]}',
    '{"sticks": "0000"}',
    '{"reset": 1}',
    '{"got": 7}',
    "[" * 4000,
    b"\xff\xfe",
]


def test_hostile_messages_do_nothing():
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        watcher = Watcher(live.address)
        for text in HOSTILE:
            watcher.send(text)
        for _ in range(100):
            watcher.say(got=True)  # more answers than moments
        with stepping(lambda: envs.step(envs.action_space.sample())):
            watcher.until(lambda: len(watcher.moments) > 2)
            (opened,) = live._pages
            assert opened.env == 0
            assert opened.answered <= opened.taken
        assert live.sticks() == (0, 0, 0, 0)
        assert not live.take_reset()
        assert not live._is_paused
        huge = Watcher(live.address)
        huge.send("x" * 1_000_000)
        for garbage in (b"\0" * 100_000, b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 10_000, b""):
            with socket.create_connection(("127.0.0.1", int(live.address.split(":")[2].split("/")[0]))) as raw:
                raw.sendall(garbage)
        with stepping(lambda: envs.step(envs.action_space.sample())):
            watcher.next()


def test_too_many_pages_are_sent_away():
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        watchers = [Watcher(live.address) for _ in range(9)]
        with stepping(lambda: envs.step(envs.action_space.sample())):
            for watcher in watchers[:8]:
                watcher.next()
        with pytest.raises(Exception, match="At most 8 pages"):
            watchers[8].next()


def test_ctrl_c_ends_a_pause(monkeypatch):
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        live._is_paused = True
        asked = []

        def interrupted(seconds):
            asked.append(seconds)
            raise KeyboardInterrupt  # as the wait of the main thread does

        monkeypatch.setattr(live._changed, "wait", interrupted)
        watcher = Watcher(live.address)
        watcher.until(lambda: watcher.status)
        live._is_paused = True
        with pytest.raises(KeyboardInterrupt):
            envs.step(envs.action_space.sample())
        assert 0 < asked[0] <= 1  # a wait without a limit ignores Ctrl-C on some systems
        monkeypatch.undo()
        watcher.say(paused=False)
        watcher.until(lambda: watcher.status.get("paused") is False)
        envs.step(envs.action_space.sample())


def test_copies_are_not_watched():
    envs = made()
    with flockstep.view(envs, browser=False) as live:
        copy = pickle.loads(pickle.dumps(envs))
        assert copy._live is None
        watcher = Watcher(live.address)
        with stepping(lambda: envs.step(envs.action_space.sample())):
            watcher.next()
            assert pickle.loads(pickle.dumps(copy))._watched is None


def test_bad_arguments():
    envs = made()
    for port in (-1, 1 << 16, 1.5, True, "80"):
        with refused(ValueError, "local_port", port):
            flockstep.view(envs, local_port=port, browser=False)
    with refused(TypeError, "envs", "DroneVectorEnv"):
        flockstep.view(gymnasium.make("CartPole-v1"))
    with flockstep.view(envs, browser=False) as live:
        with refused(ValueError, "envs", live.address):
            flockstep.view(envs)
        port = int(live.address.split(":")[2].split("/")[0])
        with pytest.raises(OSError, match="in use"):
            flockstep.view(made(1), local_port=port, browser=False)
    live.close()  # twice does no harm
    envs.close()
    with refused(ValueError, "envs", "closed"):
        flockstep.view(envs)


def test_without_websockets_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with refused(ModuleNotFoundError, "websockets", "flockstep[client]"):
        flockstep.DroneEnv(render_mode="human")


@pytest.fixture
def headless(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.filterwarnings("error")
def test_human_mode_passes_gymnasiums_check_and_prints_the_address_once(headless, capfd):
    env = gymnasium.make("flockstep/LidarNavigation-v0", render_mode="human", worlds="playground/train-1").unwrapped
    env.reset(seed=0)
    env.reset()
    assert env.render() is None
    assert capfd.readouterr().err.count("flockstep: watch at http://127.0.0.1:") == 1
    check_env(env)
    live = env.envs._live
    env.close()
    assert not live._thread.is_alive()
    envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", 2, render_mode="human", worlds="playground/train-1")
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    assert envs.render() is None
    envs.close()


def test_a_browser_opens_only_where_there_is_a_display(monkeypatch, headless, capfd):
    opened, done = [], threading.Event()
    monkeypatch.setattr("webbrowser.open", lambda address: (opened.append(address), done.set()))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("CI", raising=False)
    with flockstep.view(made(1)) as live:
        assert done.wait(PATIENCE_S)
        assert opened == [live.address]
    monkeypatch.setenv("CI", "true")
    with flockstep.view(made(1)) as live:
        assert live.address in capfd.readouterr().err
    assert len(opened) == 1


def test_a_task_of_ones_own_is_watched():
    envs = made(2, task=Still, worlds="playground/train-1")
    with flockstep.view(envs, browser=False) as live:
        watcher = Watcher(live.address)
        with stepping(lambda: envs.step(envs.action_space.sample())):
            watcher.until(lambda: len(watcher.moments) > 1)


def test_the_command_train_opens_a_view(tmp_path, headless):
    options = ["--view", "--steps", "1000", "--flights", "2", "--threads", "1", "--out", str(tmp_path / "hover.zip")]
    command = [sys.executable, "-m", "flockstep", "train", "hover", *options]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)
    assert "flockstep: watch at http://127.0.0.1:" in ended.stderr


@pytest.mark.parametrize("asked", ["evaluate hover controller --flights 4", "record hover hover {}/flight.html"])
def test_the_commands_evaluate_and_record_fly_for_a_page(asked, tmp_path, headless):
    command = [sys.executable, "-m", "flockstep", *asked.format(tmp_path).split(), "--view"]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    address = next(line.split()[-1] for line in program.stderr if "watch at" in line)
    watcher = Watcher(address)  # nothing flies before it is there
    watcher.until(lambda: len(watcher.moments) > 2 and watcher.status)
    assert watcher.status["real_time"]
    assert np.isnan(watcher.moments[0]["actions"]).all()  # of the reset
    watcher.say(real_time=False)
    with pytest.raises(ConnectionClosed):
        watcher.until(lambda: False)
    out, _ = program.communicate(timeout=PATIENCE_S)
    assert program.returncode == 0
    assert "of 4 flights succeed" in out or "flight.html" in out


def test_waiting_for_a_page_ends_with_the_view_and_by_ctrl_c(monkeypatch):
    envs = made(1)
    live = flockstep.view(envs, browser=False)
    thread = threading.Thread(target=live.wait)
    thread.start()
    held(live)
    live.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    with flockstep.view(envs, browser=False) as live:

        def interrupted(seconds):
            assert 0 < seconds <= 1  # a wait without a limit ignores Ctrl-C on some systems
            raise KeyboardInterrupt

        monkeypatch.setattr(live._changed, "wait", interrupted)
        with pytest.raises(KeyboardInterrupt):
            live.wait()


def test_no_thread_is_left():
    before, envs = set(threading.enumerate()), made(1)
    with flockstep.view(envs, browser=False) as live:
        Watcher(live.address).close()
    for thread in set(threading.enumerate()) - before:  # the watcher's may take a moment
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
    forgotten = made(1)
    live = flockstep.view(forgotten, browser=False)
    del forgotten  # the view keeps no envs alive
    live._thread.join(PATIENCE_S)
    assert not live._thread.is_alive()
