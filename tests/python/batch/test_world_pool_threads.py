"""Threads and memory of world pools: worlds and threads that go, forks, and programs that end or are interrupted."""

import concurrent.futures.thread
import contextlib
import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest
from test_world_pool import hall, make

import flockstep
from flockstep import WorldPool


def builders():
    return [thread for thread in threading.enumerate() if thread.name.startswith("flockstep-world")]


def eventually(holds):
    end = time.monotonic() + 10
    while not holds() and time.monotonic() < end:
        gc.collect()
        time.sleep(0.01)
    assert holds()


def test_old_worlds_are_dropped():
    made = []

    def counted(number):
        world = hall(number)
        made.append(weakref.ref(world))
        return world

    batch = make(8, WorldPool(counted, 16, 4.0), steps=1)
    batch.reset(np.arange(8))
    for _ in range(60):
        batch.step([4] * 8)
        assert sum(ref() is not None for ref in made) <= 16 + 8 + 2
    assert len(made) > 200
    del batch
    eventually(lambda: all(ref() is None for ref in made))


def test_worlds_are_made_once_where_they_are_drawn_again():
    numbers = []

    def counted(number):
        numbers.append(number)
        return hall(number)

    batch = make(8, WorldPool(counted, 16), steps=1)
    batch.reset(np.arange(8))
    for _ in range(60):
        batch.step([4] * 8)
    assert sorted(numbers) == list(range(16))


def test_threads_go_with_the_batch():
    gate = threading.Event()

    def slow(number):
        if number > 0:
            gate.wait(20)
        return hall(number)

    eventually(lambda: not builders())
    batch = make(pool=WorldPool(slow, 64))
    envs = flockstep.DroneVectorEnv(2, worlds=WorldPool(hall, 64))
    envs.reset(seed=0)
    waiting = threading.Thread(target=batch.reset, args=(np.arange(8),))
    waiting.start()
    assert len(builders()) == 2
    envs.close()
    gate.set()
    waiting.join()
    del batch, waiting
    eventually(lambda: not builders())


def test_a_batch_may_be_collected_while_a_thread_holds_locks():
    # The garbage collector runs at any allocation, including inside an executor that holds its locks.
    batch = make(pool=WorldPool(hall, 64))
    batch.reset(np.arange(8))
    gone = threading.Event()
    weakref.finalize(batch, gone.set)

    def collect(held):
        with contextlib.ExitStack() as locks:
            for executor in [e for e in gc.get_objects() if type(e) is concurrent.futures.ThreadPoolExecutor]:
                locks.enter_context(executor._shutdown_lock)
            locks.enter_context(concurrent.futures.thread._global_shutdown_lock)
            del executor
            held.clear()
            gc.collect()

    held = [batch]
    del batch
    thread = threading.Thread(target=collect, args=(held,), daemon=True)
    thread.start()
    thread.join(20)
    assert not thread.is_alive()
    assert gone.is_set()
    eventually(lambda: not builders())


def test_a_batch_does_not_survive_fork():
    batch = make()
    batch.reset(np.arange(8))

    def use(sender):
        nonlocal batch
        try:
            batch.reset()
        except RuntimeError as error:
            sender.send(str(error))
        batch = None
        make().reset(np.arange(8))  # a new batch of the child works
        sender.send("done")

    receiver, sender = multiprocessing.get_context("fork").Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=use, args=(sender,))
    child.start()
    assert receiver.poll(60), "the child hangs"
    assert "does not survive fork()" in receiver.recv()
    assert receiver.poll(60), "the child hangs"
    assert receiver.recv() == "done"
    child.join(60)
    assert child.exitcode == 0


# Programs import this package's tests, and what tests share.
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}

PROGRAM = """
import signal, sys, time
import numpy as np
import flockstep
from test_world_pool import hall, make

signal.signal(signal.SIGINT, signal.default_int_handler)
stuck = set(range(4, 99))

def slow(number):
    while number in stuck:
        time.sleep(0.01)
    return hall(number)

batch = make(pool=flockstep.WorldPool(slow, 4, 4.0), steps=1, mode=sys.argv[1])
batch.reset(np.arange(8))
batch.step([4] * 8)
print("begun", flush=True)
try:
    batch.reset() if sys.argv[1] == "disabled" else batch.step([4] * 8)
except KeyboardInterrupt:
    print("interrupted", flush=True)
stuck.clear()
batch.reset(np.arange(8))
batch.step([4] * 8)
print("goes on", flush=True)
"""


@pytest.mark.parametrize("mode", ["next_step", "disabled"])
def test_ctrl_c_ends_the_wait(mode):
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, mode],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=ENVIRONMENT,
    ) as child:
        assert child.stdout.readline() == "begun\n"
        time.sleep(0.3)
        child.send_signal(signal.SIGINT)
        asked = time.monotonic()
        assert child.stdout.readline() == "interrupted\n"
        assert time.monotonic() - asked < 5
        assert child.stdout.read() == "goes on\n"
        assert child.wait(60) == 0


def test_a_program_ends_without_what_is_left_to_build():
    program = """
import time, numpy as np, flockstep
from test_world_pool import hall, make
batch = make(64, pool=flockstep.WorldPool(lambda k: (time.sleep(k > 63), hall(k))[1], 64, 64.0), steps=1)
batch.reset(np.arange(64))
"""
    begun = time.monotonic()
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60, env=ENVIRONMENT)
    assert time.monotonic() - begun < 40  # less than the 64 seconds for these 64 worlds
