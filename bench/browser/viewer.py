"""Time to record flights, to open their page in headless Chromium, without a GPU, and to watch a training.

The flight is one of 16 drones in the office, with LiDAR, for 1,000 steps. A page is ready once its first image is.
Processor times are those of all processes of the browser. A training is watched by a program that takes each
moment, so that no browser competes for the CPU.
"""

from __future__ import annotations

import gzip
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import flockstep
from flockstep.recordings import Capture
from flockstep.viewer import page
from timing import RUNS, Measured, Median

STEPS, DRONES, OPENED = 1000, 16, 3
TRAINED, TRAINED_STEPS = 512, 1_000_000
WATCHER = """
import sys
from websockets.sync.client import connect
with connect(sys.argv[1], max_size=None) as socket:
    for message in socket:
        if isinstance(message, bytes):
            socket.send('{"got": true}')
"""
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def measure() -> Iterator[Measured]:
    """Record and open."""
    yield from trained()
    yield "viewer/page/gzip_bytes", len(gzip.compress(page.template().encode(), 9)), "B", 1
    plain, recorded = [], []
    for _ in range(RUNS):
        plain.append(flown(None)[0])
        seconds, recording = flown(DRONES)
        recorded.append(seconds)
    assert recording is not None
    yield "viewer/record/microseconds_per_step", Median(np.subtract(recorded, plain)) * (1e6 / STEPS), "us", RUNS
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("html", "mcap"):
            path = Path(folder) / f"flight.{suffix}"
            begin = time.process_time()
            recording.save(path)
            yield f"viewer/{suffix}/write_seconds", time.process_time() - begin, "s", 1
            yield f"viewer/{suffix}/bytes", path.stat().st_size, "B", 1
        begin = time.process_time()
        flockstep.Recording(Path(folder) / "flight.mcap")
        yield "viewer/mcap/read_seconds", time.process_time() - begin, "s", 1
        walls, processors = opened(Path(folder) / "flight.html")
        yield "viewer/open/seconds", Median(walls), "s", OPENED
        yield "viewer/open/processor_seconds", Median(processors), "s", OPENED


def trained() -> Iterator[Measured]:
    """Train without a view, with one that nobody watches, and watched, in turns."""
    speeds: dict[str, list[float]] = {"off": [], "unwatched": [], "watched": []}
    for _ in range(RUNS):
        for kind, found in speeds.items():
            found.append(training_speed(kind))
    for kind, found in speeds.items():
        yield f"viewer/live/{kind}/steps_per_second", Median(found), "1/s", RUNS
    for kind in ("unwatched", "watched"):  # of neighbours in time, which the machine slows alike
        shares = [speed / off for speed, off in zip(speeds[kind], speeds["off"], strict=True)]
        yield f"viewer/live/{kind}/share", Median(shares), "1", RUNS


def training_speed(kind: str) -> float:
    """Return the steps of a training in a second."""
    envs = flockstep.DroneVectorEnv(TRAINED, task=flockstep.HoverConfig(), autoreset_mode="same_step")
    model = flockstep.PPO("MlpPolicy", envs, n_steps=32, batch_size=4096, n_epochs=5, seed=0)
    watcher = None
    if kind != "off":
        live = flockstep.view(envs, browser=False)
        if kind == "watched":
            address = live.address.replace("http", "ws", 1).replace("/?", "/live?")
            watcher = subprocess.Popen([sys.executable, "-c", WATCHER, address])
            while not live.is_watched:
                time.sleep(0.01)
    begin = time.perf_counter()
    model.learn(TRAINED_STEPS)
    seconds = time.perf_counter() - begin
    envs.close()
    if watcher is not None:
        watcher.wait()
    return model.num_timesteps / seconds


def flown(recorded: int | None) -> tuple[float, flockstep.Recording | None]:
    """Fly random actions; return the processor time of the steps, and the recording."""
    lidar = flockstep.LidarConfig(beams=35, hfov_deg=270, max_range_m=10)
    keywords = {"worlds": "indoor/office", "drones_per_env": DRONES, "lidar": lidar, "num_threads": 1}
    envs = flockstep.DroneVectorEnv(1, **keywords, max_episode_steps=STEPS, autoreset_mode="next_step")
    envs.reset(seed=0)
    envs.action_space.seed(0)
    capture = None if recorded is None else Capture(envs)
    begin = time.process_time()
    for step in range(STEPS + 1):
        actions = None
        if step > 0:
            actions = envs.action_space.sample()
            envs.step(actions)
        if capture is not None:
            capture.add(actions)
    return time.process_time() - begin, None if capture is None else capture.recording()


def opened(path: Path) -> tuple[list[float], list[float]]:
    """Return the times until a page is ready, by the clock and of processors."""
    from playwright.sync_api import sync_playwright

    walls, processors = [], []
    with sync_playwright() as player:
        for _ in range(OPENED):
            chromium = shutil.which("chromium")
            browser = player.chromium.launch(executable_path=chromium, args=FLAGS, timeout=300_000)
            tab = browser.new_page(viewport={"width": 1280, "height": 720})
            before = processor_seconds()
            tab.goto(f"file://{path}", timeout=300_000)
            tab.wait_for_selector("body[data-state=ready]", state="attached", timeout=300_000)
            processors.append(processor_seconds() - before)
            walls.append(tab.evaluate("flockstep.page.readyMs") / 1000)
            browser.close()
    return walls, processors


def processor_seconds() -> float:
    """Return the processor time of all processes that this one has started, and that live."""
    parents, used = dict[int, int](), dict[int, int]()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = status.read_text().rsplit(")", 1)[1].split()
        except OSError:  # it has ended
            continue
        pid = int(status.parent.name)
        parents[pid], used[pid] = int(words[1]), int(words[11]) + int(words[12])
    total = 0
    for pid, ticks in used.items():
        ancestor = parents[pid]
        while ancestor in parents and ancestor != os.getpid():
            ancestor = parents[ancestor]
        total += ticks if ancestor == os.getpid() else 0
    return total / os.sysconf("SC_CLK_TCK")
