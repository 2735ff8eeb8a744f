"""Worlds, env factories and examples shared by the tests."""

from __future__ import annotations

import asyncio
import importlib
import logging
import os
import runpy
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from chromium import CHROMIUM, FLAGS, TIME_LIMIT_MS
from clients import Blocking

import flockstep

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a job in the background, whose children ignore Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Otherwise each program that a test starts compiles all modules that it imports: 2 s of CPU time for PyTorch's.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

ROOT = Path(__file__).resolve().parents[2]

# A program that begins so imports none of these modules.
WITHOUT = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Without())
"""

# Small, so that random flight ends soon: one pillar, one waypoint.
ROOM: dict[str, Any] = {
    "flockstep_scene": 1,
    "name": "room",
    "room": {"min": [0, 0, 0], "max": [8, 8, 4]},
    "pillars": [{"center": [4, 4.5], "radius": 0.25}],
    "markers": {
        "start": [2, 4, 2],
        "waypoints": [[4, 2.5, 2]],
        "goal": [6, 4, 2],
        "spawn_box": {"min": [1, 3, 1], "max": [3, 5, 3]},
    },
}


@pytest.fixture(params=["next_step", "same_step", "disabled"])
def mode(request: pytest.FixtureRequest) -> str:
    """Each autoreset mode."""
    return request.param


def begun(num_envs: int = 1, *, seed: int = 0, **keywords: Any) -> flockstep.DroneVectorEnv:
    """A vector env after its first reset."""
    envs = flockstep.DroneVectorEnv(num_envs, **keywords)
    envs.reset(seed=seed)
    return envs


def flat_batch(worlds: Any, num_drones: int = 1, **fields: Any) -> flockstep.Batch:
    """A batch of which the dynamics, the clock and the episodes may be given by their fields."""
    for name, config in (
        ("dynamics", flockstep.DynamicsConfig),
        ("clock", flockstep.ClockConfig),
        ("episode", flockstep.EpisodeConfig),
    ):
        own = {field: fields.pop(field) for field in config.__match_args__ if field in fields}
        if own:
            fields[name] = config(**own)
    return flockstep.Batch(worlds, num_drones, **fields)


def world_of(**parts: Any) -> flockstep.World:
    """The world of a scene with these parts."""
    return flockstep.World.from_dict({"flockstep_scene": 1, **parts})


def placed(worlds: Any, position: Any, quat_wxyz: Any = None, **keywords: Any) -> flockstep.Batch:
    """A batch with a drone at each of these positions."""
    position = np.atleast_2d(np.float32(position))
    batch = flockstep.Batch(worlds, len(position), **keywords)
    batch.set_pose(position, quat_wxyz)
    return batch


@pytest.fixture(scope="session")
def room() -> flockstep.World:
    return flockstep.World.from_dict(ROOM)


@pytest.fixture(scope="session")
def closet() -> flockstep.World:
    """Barely larger than the drone, so that a random walk crashes within a few steps."""
    markers = {"start": [1, 1, 0.6], "goal": [1.3, 1.65, 0.6]}
    return world_of(name="closet", room={"min": [0, 0, 0], "max": [2, 2, 1.2]}, markers=markers)


@pytest.fixture(scope="session")
def playgrounds() -> list[flockstep.World]:
    return flockstep.scenes.load("train")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """Import a script of examples/ by name."""
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    return importlib.import_module


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str, str]]:
    """Run the command ``flockstep``: returns its exit status or message, standard output and standard error."""

    def run(*arguments: object) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", ["flockstep", *map(str, arguments)])
        status: Any = 0
        try:
            runpy.run_module("flockstep", run_name="__main__")
        except SystemExit as stop:
            status = stop.code
        return status, *capsys.readouterr()

    return run


@pytest.fixture(params=["blocking", "asyncio"])
def connect(request: pytest.FixtureRequest) -> Iterator[Callable[..., Any]]:
    """Both clients: `flockstep.connect`, and `flockstep.connect_async` with calls that wait."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    if request.param == "blocking":
        yield flockstep.connect
        return
    loop = asyncio.new_event_loop()

    def connected(*args: Any, **keywords: Any) -> Blocking:
        return Blocking(loop, loop.run_until_complete(flockstep.connect_async(*args, **keywords)))

    yield connected
    loop.run_until_complete(loop.shutdown_asyncgens())
    loop.close()


@pytest.fixture
def server(batch: flockstep.Batch) -> Iterator[flockstep.Server]:
    """A server of the batch of a module."""
    with flockstep.serve(batch, port=0) as server:
        yield server


@pytest.fixture
def client(server: flockstep.Server) -> Iterator[flockstep.client.Client]:
    with flockstep.connect(server.address) as client:
        yield client


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, for the tests of a module."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=TIME_LIMIT_MS)
        yield browser
        browser.close()
