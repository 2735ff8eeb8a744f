"""Loads a server with clients of all kinds, and checks that its memory and its open files do not grow.

`./dev try soak [--seconds 1800]` runs it. Clients connect, spawn drones, move, read, step, stream, send malformed
messages, and end: in an orderly way, or with requests and a stream under way. It exits with status 1 if the server
leaks, or fails a client that has made no mistake.
"""

from __future__ import annotations

import contextlib
import os
import random
import socket
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep.client import ServerError
from flockstep.client import protocol as pb
from flockstep.client.frames import encode
from server import Served, serving

RECIPE: dict[str, Any] = {
    "task": None,
    "worlds": ["playground/train-1"],
    "num_envs": 1,  # with more, spawning could change the indices of drones
    "drones_per_env": 8,
    "lidars": [{}],
    "cameras": [{"width_px": 160, "height_px": 120, "capture_mode": "on_demand"}],
}
THREADS = 6
SAMPLE_S = 1.0
#: Growth that is no leak: of the median memory in the last quarter of the time over that in the second quarter.
ALLOWED_BYTES = 4 << 20


def resources(pid: int) -> tuple[int, int]:
    """Return the resident bytes and the open files of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE"), len(list(Path(f"/proc/{pid}/fd").iterdir()))


class Visitor:
    """A thread that is one client after the other until the time is over."""

    def __init__(self, address: str, seed: int, is_over: threading.Event) -> None:
        self.counts: Counter[str] = Counter()
        self.error: BaseException | None = None
        self._address = address
        self._random = random.Random(seed)
        self._is_over = is_over
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def join(self) -> None:
        self._thread.join()

    def _run(self) -> None:
        visits = (self.fly, self.read, self.stream, self.step, self.spawn, self.break_off, self.talk_nonsense)
        try:
            while not self._is_over.is_set():
                visit = self._random.choice(visits)
                visit()
                self.counts[visit.__name__] += 1
        except BaseException as error:
            self.error = error
            self._is_over.set()

    def _client(self) -> flockstep.client.Client:
        return flockstep.connect(self._address, timeout_s=30)

    def _drone(self, client: flockstep.client.Client) -> flockstep.client.Drone:
        return client.drone(self._random.randrange(RECIPE["drones_per_env"]))

    # --- visits

    def fly(self) -> None:
        """Move a drone and scan."""
        with self._client() as client:
            drone = self._drone(client)
            for _ in range(100):
                drone.set_location(drone.get_location() + np.float32([self._random.uniform(-0.1, 0.1), 0, 0]))
                drone.get_lidar_data()

    def read(self) -> None:
        """Read arrays, images, the world, and a snapshot."""
        with self._client() as client:
            client.get_arrays(client.info.array_names)
            for image_format in ("jpeg", "png", "raw"):
                self._drone(client).get_camera_data(format=image_format)
            client.get_mesh()
            client.snapshot()

    def stream(self) -> None:
        """Read streams, and close one of them."""
        with self._client() as client:
            arrays = client.subscribe_arrays(["position"], rate_hz=200)
            images = self._drone(client).subscribe_camera(rate_hz=50)
            for _ in range(20):
                arrays.receive(timeout_s=30)
            images.receive(timeout_s=30)
            images.close()

    def step(self) -> None:
        """Step the simulation."""
        with self._client() as client:
            for _ in range(100):
                client.step()

    def spawn(self) -> None:
        """Spawn a drone and remove it: one that stays would enlarge the simulation."""
        with self._client() as client:
            drone = client.spawn_drone(claim=True)
            drone.get_location()
            drone.remove()

    def break_off(self) -> None:
        """End the connection with requests and a stream under way, without a word."""
        client = self._client()
        client.subscribe_arrays(["position"], rate_hz=1000)
        with client._changed:
            for i in range(20):
                request = pb.Request(id=1_000_000 + i, get_arrays=pb.GetArrays(names=["position"]))
                client._write(client._session.frame(encode(request, {})))
            assert client._socket
            client._socket.shutdown(socket.SHUT_RDWR)
        client.close()

    def talk_nonsense(self) -> None:
        """Send bytes that are no message, before or after the handshake; the server ends the connection."""
        if self._random.random() < 0.5:
            host, port = self._address.rsplit(":", 1)
            with socket.create_connection((host, int(port)), timeout=30) as raw, contextlib.suppress(ConnectionError):
                raw.sendall(self._random.randbytes(2000) + b"\r\n\r\n")
                while raw.recv(4096):
                    pass
            return
        with self._client() as client:
            with client._changed:
                client._write(client._session.frame(self._random.randbytes(self._random.randrange(1, 200))))
            try:
                client.ping()
            except (ConnectionError, ServerError):
                return
            raise AssertionError("the server has gone on after a malformed message")


def soak(served: Served, seconds: float) -> tuple[dict[str, Any], str]:
    """Load a server, and return what was found, and what is wrong with it, if anything."""
    is_over = threading.Event()
    with flockstep.connect(served.address) as witness:
        witness.get_arrays(["position"])
        files_before = resources(served.pid)[1]
        visitors = [Visitor(served.address, seed, is_over) for seed in range(THREADS)]
        end, samples = time.monotonic() + seconds, []
        while time.monotonic() < end and not is_over.wait(min(SAMPLE_S, seconds / 40)):
            samples.append(resources(served.pid)[0])
        is_over.set()
        for visitor in visitors:
            visitor.join()
        witness.ping()
        deadline = time.monotonic() + 10  # sessions end a little later than their clients
        while (files := resources(served.pid)[1]) > files_before and time.monotonic() < deadline:
            time.sleep(0.1)
    for visitor in visitors:
        if visitor.error is not None:
            raise visitor.error
    quarter = len(samples) // 4
    memory = [float(np.median(part)) for part in (samples[quarter : 2 * quarter], samples[-quarter:])]
    visits = sum((visitor.counts for visitor in visitors), Counter())
    found = {
        "count": sum(visits.values()),
        "unit": "clients",
        "seconds": seconds,
        "visits": dict(visits),
        "memory_bytes": memory,
        "files": [files_before, files],
    }
    wrong = []
    if memory[1] - memory[0] > ALLOWED_BYTES:
        wrong.append(f"memory has grown by {(memory[1] - memory[0]) / 2**20:.1f} MiB")
    if files > files_before:
        wrong.append(f"{files - files_before} files are still open")
    return found, ", ".join(wrong)


def run(seconds: float) -> dict[str, Any]:
    """Soak a new server and print a line. Exits with status 1 if something is wrong."""
    with serving(RECIPE) as served:
        found, wrong = soak(served, seconds)
    memory, files = found["memory_bytes"], found["files"]
    print(
        f"soak: {found['count']:,} clients in {seconds:.0f} s; memory {memory[0] / 2**20:.1f} to "
        f"{memory[1] / 2**20:.1f} MiB, files {files[0]} to {files[1]}: {wrong or 'no growth'}"
    )
    if wrong:
        raise SystemExit(1)
    return found
