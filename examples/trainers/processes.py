"""Several processes that train together: their shares of drones and processors, their port, their end."""

import os
import socket
import sys

from lidar_task import NUM_ENVS


def drones_of_each(processes: int) -> int:
    """Return the number of drones of each of several processes that fly together."""
    if processes < 1 or NUM_ENVS % processes:
        raise SystemExit(f"expected a number of processes that divides {NUM_ENVS} drones, got {processes}")
    return NUM_ENVS // processes


def threads_of_each(processes: int) -> int:
    """Return the share of this machine's processors for each of several processes on it, at least 1."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(processors // processes, 1)


def free_port() -> int:
    """Return a TCP port of this machine that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


def end_process() -> None:
    """End this process, without an error.

    Threads of gloo may hold tensors for a while, and then crash a process that ends as usual (pytorch/pytorch#179291).
    """
    sys.stdout.flush()
    os._exit(0)
