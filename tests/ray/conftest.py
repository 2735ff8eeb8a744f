"""A cluster of two nodes on this machine.

The nodes are processes of `ray start`. They and all processes that they start have a mark in their environment. Only
marked processes are ended, and after the tests none may be left.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path

import pytest

from processes import free_port

CPUS = 2  # of each node
MARK, VALUE = "FLOCKSTEP_RAY_TEST", uuid.uuid4().hex

# Ray reads these when it is imported, hence here. Without a token it would write one into the home folder.
os.environ |= {MARK: VALUE, "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": VALUE}


def marked():
    """Return the processes that began with the mark in their environment and are not zombies."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={VALUE}".encode() in (folder / "environ").read_bytes():
                found.append(int(folder.name))
        except OSError:  # ended, or of another user
            continue
    return found


def wait_until(condition, seconds):
    """Return whether a condition comes true in time."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.1)
    return True


@pytest.fixture(scope="session")
def address():
    """Start two nodes and return the cluster's address."""
    import ray

    folder = Path(tempfile.mkdtemp(prefix="ray"))  # short: it has Unix sockets
    place = f"127.0.0.1:{free_port()}"
    shared = ["--block", f"--num-cpus={CPUS}", f"--object-store-memory={100 << 20}", "--disable-usage-stats"]
    head = ["--head", "--node-ip-address=127.0.0.1", f"--port={place.split(':')[1]}", f"--temp-dir={folder}"]
    head.append("--include-dashboard=false")
    second = [f"--address={place}", "--node-ip-address=127.0.0.2"]
    nodes = []
    try:
        for k, arguments in enumerate((head, second)):
            command = [Path(sys.executable).parent / "ray", "start", *arguments, *shared]
            with (folder / f"node{k}.txt").open("w") as log:
                nodes.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT))
            time.sleep(3 if k else 6)
        ray.init(place, log_to_driver=False)
        assert wait_until(lambda: ray.cluster_resources().get("CPU") == 2 * CPUS, 60), "two nodes joined"
        yield place
    finally:
        ray.shutdown()
        for node in reversed(nodes):
            node.send_signal(signal.SIGTERM)
        for node in nodes:
            node.wait(60)
        gone = wait_until(lambda: not marked(), 30)
        for pid in marked():
            os.kill(pid, signal.SIGKILL)
        shutil.rmtree(folder, ignore_errors=True)
    assert gone, "no process of the nodes was left"
