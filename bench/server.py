"""Times the server: round trips, steps of a remote vector environment, and camera streams.

Servers are programs of their own, ``python -m flockstep serve``; bench/server.cpp has the echo and the C++ client.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import flockstep
from timing import Measured, Median, in_turns, median_ratio, native, program, timed

ROUNDS, CALLS = 9, 1000  # of round trips: medians of the rounds; calls in a round
STREAM_S, STEPS_S = 5.0, 0.5
WORLD: dict[str, Any] = {"task": None, "worlds": ["playground/train-1"], "num_envs": 1}
DRONES = 1024
CAMERAS, STREAM_HZ = 8, 30.0


def measure() -> Iterator[Measured]:
    """Measure everything. It takes five minutes, and the machine must have nothing else to do."""
    for name, place in (("pinned", pinned), ("unpinned", contextlib.nullcontext)):
        with place():
            yield from measure_round_trips(f"server/round_trip/{name}")
            yield from measure_vector_env(f"server/vector_env/{name}")
    yield from measure_streams("server/streams")


# --- programs


@contextlib.contextmanager
def pinned() -> Iterator[None]:
    """Run this thread, and what it starts, on one processor."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextlib.contextmanager
def running(command: Sequence[object]) -> Iterator[tuple[str, int]]:
    """Run a program, and give its first line and its process id."""
    with subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            line = process.stdout.readline()
            if not line:
                raise SystemExit(f"{command[0]}: it ended at once")
            yield line, process.pid
        finally:
            process.terminate()
            process.wait()


class Served(NamedTuple):
    address: str
    pid: int


@contextlib.contextmanager
def serving(recipe: dict[str, Any] | str, *options: str) -> Iterator[Served]:
    """Serve a recipe from another process."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recipe.json"
        path.write_text(recipe if isinstance(recipe, str) else json.dumps(recipe))
        command = [sys.executable, "-m", "flockstep", "serve", path, "--port", "0", *options]
        with running(command) as (line, pid):
            found = re.search(r" at (\S+);", line)
            assert found, line
            yield Served(found[1], pid)


# --- round trips


def measure_round_trips(prefix: str) -> Iterator[Measured]:
    """Time one call after the other, by every client in turns with the echo of messages of the same size."""
    with contextlib.ExitStack() as stack:
        drone_at = stack.enter_context(serving({**WORLD, "drones_per_env": 1, "lidars": [{}]})).address
        arrays_at = stack.enter_context(serving({**WORLD, "num_envs": DRONES, "lidars": [{"beams": 38}]})).address
        port = stack.enter_context(running([program("server"), "echo"]))[0].strip()
        loop = asyncio.new_event_loop()
        stack.callback(loop.close)
        sync = [stack.enter_context(flockstep.connect(address)) for address in (drone_at, arrays_at)]
        others = [loop.run_until_complete(flockstep.connect_async(address)) for address in (drone_at, arrays_at)]
        for other in others:
            stack.callback(lambda other=other: loop.run_until_complete(other.close()))
        calls = operations(*sync)
        awaited = operations(*others)
        sizes = {name: message_sizes(sync[name == "get_arrays"], call) for name, call in calls.items()}
        sizes["step_envs"] = step_sizes()
        cases = [word for name, both in sizes.items() for word in (name, *both)]
        found: dict[tuple[str, str], list[float]] = {}
        for _ in range(ROUNDS):
            for f in native("server", "round-trips", drone_at, arrays_at, port, CALLS, *cases):
                name, by, _ = f["name"].split("/")
                found.setdefault((name, by), []).append(f["value"])
            for name in calls:
                found.setdefault((name, "python"), []).append(1e6 * time_calls(calls[name]))
                seconds = loop.run_until_complete(time_awaited(awaited[name]))
                found.setdefault((name, "asyncio"), []).append(1e6 * seconds)
    for name, (request, reply) in sizes.items():
        yield f"{prefix}/{name}/request", request, "B", 1
        yield f"{prefix}/{name}/reply", reply, "B", 1
    for (name, by), values in found.items():
        yield f"{prefix}/{name}/{by}/p50", Median(values), "us", ROUNDS
        if by != "tcp":
            yield f"{prefix}/{name}/{by}/ratio_to_tcp", median_ratio(values, found[name, "tcp"]), "1", ROUNDS


def operations(of_drone: Any, of_arrays: Any) -> dict[str, Callable[[], Any]]:
    """Return the operations to time, of clients for one drone and for many, either synchronous or not."""
    drone = of_drone.drone(0)
    locations = itertools.cycle(np.float32([[x, 0, 1.5] for x in (0.0, 0.1)]))
    return {
        "set_location": lambda: drone.set_location(next(locations)),
        "get_location": lambda: drone.get_location(),
        "get_lidar_data": lambda: drone.get_lidar_data(directions=False),
        "get_arrays": lambda: of_arrays.get_arrays(["ranges"], sensor="lidar"),
    }


def message_sizes(client: flockstep.client.Client, call: Callable[[], object]) -> tuple[int, int]:
    """Return the bytes of an operation's messages, without those of WebSocket."""
    sizes = [0, 0]
    frame, deliver = client._session.frame, client._deliver

    def counted_frame(message: bytes) -> bytes:
        sizes[0] += len(message)
        return frame(message)

    def counted_deliver(message: bytes | bytearray | memoryview) -> None:
        sizes[1] += len(message)
        deliver(message)

    client._session.frame, client._deliver = counted_frame, counted_deliver  # type: ignore[method-assign]
    try:
        call()
    finally:
        del client._session.frame, client._deliver
    return sizes[0], sizes[1]


def step_sizes() -> tuple[int, int]:
    """Return the bytes of the messages of a step of the vector environment: its actions and its observations."""
    return DRONES * 8, DRONES * 38 * 4


def time_calls(call: Callable[[], object]) -> float:
    """Return the median seconds of a call."""
    once = timed(call, clock=time.perf_counter)
    return statistics.median([once() for _ in range(50 + CALLS)][50:])


async def time_awaited(call: Callable[[], Awaitable[object]]) -> float:
    times = []
    for _ in range(50 + CALLS):
        before = time.perf_counter()
        await call()
        times.append(time.perf_counter() - before)
    return statistics.median(times[50:])


# --- a remote vector environment


def measure_vector_env(prefix: str) -> Iterator[Measured]:
    """Step the LiDAR task in this process, over TCP and by a Unix socket, in turns, on one thread each."""
    own = flockstep.DroneVectorEnv(DRONES, num_threads=1)
    recipe = own.recipe.to_json()
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        envs: dict[str, Any] = {"in_process": own}
        for name, options in (("remote", ()), ("unix", ("--address", f"unix:{folder}/server"))):
            served = stack.enter_context(serving(recipe, *options))
            envs[name] = stack.enter_context(flockstep.connect(served.address)).vector_env()
        actions = np.random.default_rng(0).integers(0, 6, (64, DRONES))
        for env in envs.values():
            env.reset(seed=0)
            for i in range(300):  # until drones are spread out and episodes end at a steady rate
                env.step(actions[i % 64])
        turns = itertools.cycle(actions)
        timers = {
            name: timed(lambda env=env: env.step(next(turns)), at_least_s=STEPS_S, clock=time.perf_counter)
            for name, env in envs.items()
        }
        rates = {name: [DRONES / s for s in seconds] for name, seconds in in_turns(timers, ROUNDS).items()}
    for name, values in rates.items():
        yield f"{prefix}/{name}", Median(values), "1/s", ROUNDS
    for name, ratio in (("remote", "ratio"), ("unix", "unix_ratio")):
        yield f"{prefix}/{ratio}", median_ratio(rates[name], rates["in_process"]), "1", ROUNDS


# --- streams


def measure_streams(prefix: str) -> Iterator[Measured]:
    """Step with cameras as fast as possible.

    In turns, nobody watches, a client reads a stream of each camera, and another process encodes as many images.
    """
    camera = {"width_px": 640, "height_px": 480}
    recipe = {**WORLD, "drones_per_env": CAMERAS, "cameras": [camera]}
    unwatched, watched, lost, images, beside = [], [], [], [], []
    with serving(recipe, "--rate-hz", "10000") as served, flockstep.connect(served.address) as client:
        stepping_rate(client)
        for _ in range(ROUNDS):
            unwatched.append(stepping_rate(client))
            with watching(served.address) as count:
                stepping_rate(client, 0.5)
                before, start = count(), time.perf_counter()
                watched.append(stepping_rate(client))
                images.append((count() - before) / (time.perf_counter() - start))
            lost.append(1 - watched[-1] / unwatched[-1])
            with running([program("server"), "encode", CAMERAS, STREAM_HZ]):
                stepping_rate(client, 0.5)
                beside.append(1 - stepping_rate(client) / unwatched[-1])
    yield f"{prefix}/steps_per_second", Median(unwatched), "1/s", ROUNDS
    yield f"{prefix}/steps_per_second_watched", Median(watched), "1/s", ROUNDS
    yield f"{prefix}/images_per_second", Median(images), "1/s", ROUNDS
    yield f"{prefix}/steps_lost", Median(lost), "1", ROUNDS
    yield f"{prefix}/steps_lost_beside_encoding", Median(beside), "1", ROUNDS


def stepping_rate(client: flockstep.client.Client, seconds: float = STREAM_S) -> float:
    """Return the steps that a server does in a second."""
    before, start = client.get_arrays(["tick"]).time.step, time.perf_counter()
    time.sleep(seconds)
    return (client.get_arrays(["tick"]).time.step - before) / (time.perf_counter() - start)


@contextlib.contextmanager
def watching(address: str) -> Iterator[Callable[[], int]]:
    """Read a stream of JPEG files of each drone in a thread. Yields a function that returns the number of files."""
    count = 0
    with flockstep.connect(address) as client:
        streams = [client.drone(i).subscribe_camera(rate_hz=STREAM_HZ) for i in range(CAMERAS)]

        def read() -> None:
            nonlocal count
            for stream in streams:
                stream.receive(timeout_s=30)
                count += 1

        with beside(read):
            yield lambda: count


@contextlib.contextmanager
def beside(work: Callable[[], object]) -> Iterator[None]:
    """Repeat a function in a thread while the block runs."""
    is_over = threading.Event()

    def repeat() -> None:
        while not is_over.is_set():
            work()

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
