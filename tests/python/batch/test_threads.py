"""Threads: a batch has its own and serves one caller at a time; world pools outlive theirs, forks and interrupts."""

import concurrent.futures.thread
import contextlib
import gc
import multiprocessing
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest
from conftest import begun
from gymnasium import spaces
from messages import refused
from test_world_pool import hall, make

import flockstep
from flockstep import WorldPool


def test_two_threads_in_one_batch_get_an_error_and_no_harm():
    world = flockstep.World.load("playground/train-1")
    batch = flockstep.Batch(
        [world], 512, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig(), num_threads=1
    )
    batch.reset(np.arange(512))
    calls = [
        lambda: batch.step(np.zeros(512, int)),
        lambda: batch.set_lidar(hfov_deg=90.0),
        lambda: batch.restore(batch.snapshot()),
        lambda: batch.lidar().points,
        lambda: batch.remove([3]),
        lambda: batch.spawn([3], [[1, 1, 1]]),
        batch.sense,
    ]
    errors = []
    start = threading.Barrier(4)

    def use(seed):
        rng = np.random.default_rng(seed)
        start.wait()
        for _ in range(300):
            try:
                calls[rng.integers(len(calls))]()
            except RuntimeError as error:
                errors.append(str(error))
            except ValueError:
                pass  # with or without a drone of this index

    threads = [threading.Thread(target=use, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors
    assert set(errors) == {"this Batch is in use by another thread: one call at a time"}
    batch.reset(np.arange(512))
    batch.step(np.zeros(512, int))
    assert np.isfinite(batch.observation).all()


class Slow(flockstep.Task):
    """Its methods need the interpreter lock while the batch is locked."""

    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def step(self, batch):
        time.sleep(0.002)
        return batch.position[:, 2], batch.contact.hit

    def observe(self, batch):
        return batch.position


def test_a_thread_waits_for_a_shared_batch_without_the_interpreter_lock(room):
    camera = flockstep.CameraConfig(width_px=4, height_px=4)
    task = Slow()
    task.lidar, task.camera = flockstep.LidarConfig(), camera
    env = begun(4, worlds=room, task=task, num_threads=1)
    batch = env.batch
    served = batch._served()
    calls = [
        lambda: batch.set_pose(np.ones((4, 3))),
        lambda: batch.set_lidar(hfov_deg=90.0),
        lambda: batch.set_camera(hfov_deg=80.0),
        lambda: batch.set_capture_mode("every_step"),
        lambda: batch.set_world(np.zeros(4, int)),
        lambda: batch.seed(np.arange(4)),
        lambda: batch.begin_episode(),
        lambda: batch.random(0, 3),
        lambda: batch.remove(np.zeros(0, int)),
        lambda: batch.lidar().points,
        lambda: batch.lidar().directions,
        lambda: batch.lidar().config_of(0),
        lambda: batch.camera().config_of(0),
        lambda: batch.capture(),
        lambda: batch.camera().jpeg(0),
        lambda: batch.task_state,
        lambda: batch.sense(),
        lambda: batch.restore(batch.snapshot()),
    ]
    ended = threading.Event()
    steps = 0

    def fly():
        nonlocal steps
        while not ended.is_set():
            batch.step(np.zeros((4, 3), np.float32))
            steps += 1

    def use():
        for call in 3 * calls:
            time.sleep(0.003)  # until the other thread is in a step
            call()
        ended.set()

    threads = [threading.Thread(target=target, daemon=True) for target in (fly, use)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert ended.is_set()
    assert steps > len(calls)
    served.end()


def test_more_than_four_threads_per_processor_are_clamped(room):
    processors = len(os.sched_getaffinity(0))
    with refused(RuntimeWarning, "num_threads=4096", 4 * processors):
        batch = flockstep.Batch([room], 8, num_threads=4096)
    assert batch.num_threads == 4 * processors
    with refused(RuntimeWarning, "num_threads=4096"):
        learner = flockstep._core.Learner(flockstep._core.NetworkConfig(), num_threads=4096)
    assert learner.num_threads == 4 * processors


# Leaves less address space than a thread needs for its stack.
IN_A_SMALL_SPACE = """
import resource
import flockstep

def made(threads):
    return flockstep.Batch("arena/hall", 2, num_threads=threads, lidar=flockstep.LidarConfig())

batch = made(1)
batch.sense()
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (32 << 20), -1))
try:
    made(2) if {what!r} == "batch" else flockstep.serve(batch, port=0)
except RuntimeError as error:
    print(error)
resource.setrlimit(resource.RLIMIT_AS, (-1, -1))
made(2).sense()
flockstep.serve(batch, port=0).stop()
"""


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("batch", r"num_threads: the system started 0 of 1 threads \(.+\); lower num_threads, or raise a limit: "),
        ("server", r"the system refused a thread of the server \(.+\); raise a limit: "),
    ],
)
def test_a_thread_that_the_system_refuses_is_an_error(what, message):
    def give_threads_large_stacks():
        resource.setrlimit(resource.RLIMIT_STACK, (64 << 20, resource.getrlimit(resource.RLIMIT_STACK)[1]))

    code = IN_A_SMALL_SPACE.format(what=what)
    done = subprocess.run(
        [sys.executable, "-c", code],
        preexec_fn=give_threads_large_stacks,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(message + r"\d+ MiB of address space \(ulimit -v\), .*", done.stdout.strip())


def test_more_threads_than_processors_are_a_warning_and_nothing_else(room, capfd):
    count = os.cpu_count() + 6
    with refused(RuntimeWarning, f"num_threads={count}", "processors") as caught:
        batch = flockstep.Batch([room], 256, lidar=flockstep.LidarConfig(), num_threads=count, block_size=1)
    assert len(caught) == 1
    batch.sense()
    one = flockstep.Batch([room], 256, lidar=flockstep.LidarConfig(), num_threads=1)
    one.sense()
    np.testing.assert_array_equal(batch.lidar().ranges, one.lidar().ranges)
    assert capfd.readouterr().err == ""


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
    envs = begun(2, worlds=WorldPool(hall, 64))
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
