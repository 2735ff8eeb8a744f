"""A server beside the calls of its program; claims, lockstep and the clock."""

import contextlib
import itertools
import os
import subprocess
import sys
import time
from typing import ClassVar

import numpy as np
import pytest
from clients import Raw, eventually, in_thread, repeated
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep.client import ServerError
from flockstep.client import protocol as pb
from flockstep.client.frames import encode
from flockstep.client.protocol import Ping, Request


@pytest.fixture
def batch():
    return flockstep.Batch("playground/train-1", 4, drones_per_env=4, lidar=flockstep.LidarConfig(beams=5))


def test_reads_run_beside_a_step_and_see_one_moment():
    batch = flockstep.Batch("playground/train-1", 64, drones_per_env=64, lidar=flockstep.LidarConfig(beams=2000))
    start, steps = batch.position.copy(), itertools.count()

    def move():
        batch.set_pose(start + np.float32([0, 0, 0.001 * (next(steps) % 100)]))
        batch.sense()

    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        client.get_arrays(["position", "tick"])
        with repeated(move):
            seen = set()
            for _ in range(500):
                heights = client.get_arrays(["position"])["position"][:, 2]
                assert np.ptp(heights) == 0  # all drones are moved together
                seen.add(float(heights[0]))
            assert len(seen) > 3


def test_the_program_and_clients_take_turns(client, batch):
    calls = []
    with repeated(lambda: calls.append(batch.sense())):
        for i in range(200):
            impact = client.drone(i % 4).set_location([1.0, 0.001 * i, 1.5], teleport=True)
            np.testing.assert_allclose(impact.location, [1.0, 0.001 * i, 1.5], rtol=1e-6)
    assert calls


def test_a_snapshot_under_load_restores(server, batch, client):
    random = np.random.default_rng(0)
    with contextlib.ExitStack() as stack:
        others = [stack.enter_context(flockstep.connect(server.address)).drone(0) for _ in range(3)]
        moves = [
            lambda drone=drone: drone.set_location([random.uniform(0.9, 1.1), 0, 1.5], teleport=True)
            for drone in others
        ]
        with repeated(*moves):
            for _ in range(20):
                client.restore(client.snapshot())
    blob, position = client.snapshot(), batch.position.copy()
    client.drone(0).set_location([1.0, 0.5, 1.0], teleport=True)
    client.restore(blob)
    np.testing.assert_array_equal(batch.position, position)
    with refused(ServerError, "snapshot", "corrupt"):
        client.restore(blob[:-1] + bytes([blob[-1] ^ 1]))
    np.testing.assert_array_equal(batch.position, position)


def test_a_placed_drone_keeps_its_attitude(room):
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    batch = flockstep.Batch([room], 2, dynamics=dynamics, clock=flockstep.ClockConfig(policy_hz=50))
    tilted = np.float32([0.6, 0, 0.8, 0])
    batch.set_pose([2, 4, 2], tilted)
    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        client.drone(0).set_location([3, 4, 2], teleport=True)
        client.set_poses(position=[[3, 4, 2], [4, 4, 2]], teleport=True)
    np.testing.assert_allclose(batch.quat_wxyz, [tilted, tilted], atol=1e-6)
    np.testing.assert_array_equal(batch.position, [[3, 4, 2], [4, 4, 2]])


def test_a_large_snapshot_restores():
    batch = flockstep.Batch("playground/train-1", 10_000, lidar=flockstep.LidarConfig())
    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        blob, position = client.snapshot(), batch.position.copy()
        assert len(blob) > 2**21  # messages of more than 2^20 bytes are received in another way
        client.drone(0).set_location([1.0, 0.5, 1.0], teleport=True)
        client.restore(blob)
        np.testing.assert_array_equal(batch.position, position)
        assert client.snapshot() == blob
        request = Request(id=2, restore=pb.Restore())
        whole = encode(request, {"snapshot": np.frombuffer(blob, np.uint8)})
        for wrong, text in ((whole[:-1], "cut short"), (whole + b"1", "got more")):
            with Raw(server) as raw:
                raw.send(wrong)
                assert text in raw.reply().error.text
                assert raw.is_closed()


def test_a_batch_that_its_program_enlarges_is_followed(server, client, batch):
    assert client.sense()[2:] == (batch.num_envs, 0)
    batch.spawn([5], position=[[1.0, 0.0, 1.5]])
    assert client.get_arrays(["active"]).time[2:] == (batch.num_envs, batch.generation) == (batch.num_envs, 1)
    assert client.sense()[2:] == (batch.num_envs, 1)
    assert len(client.get_drones()) == 5
    client.set_poses(position=np.tile(np.float32([1.0, 0.0, 1.0]), (8, 1)), teleport=True)
    np.testing.assert_array_equal(batch.position[5], [1.0, 0.0, 1.0])
    drone = client.spawn_drone([1.0, 0.5, 1.5])
    assert drone.index == 4 and batch.active.sum() == 6


def test_the_light_that_the_program_sets_is_followed(client, batch):
    before = client.get_light(0)
    batch.set_light(0, sun_color=(0.1, 0.2, 0.3))
    np.testing.assert_allclose(client.get_light(0).sun_color, [0.1, 0.2, 0.3])
    content_hash = client.get_worlds()[0].content_hash
    batch.set_light(0, sun_color=(0.3, 0.2, 0.1))
    assert client.get_worlds()[0].content_hash != content_hash
    batch.set_light(0, sun_color=(0.2, 0.2, 0.1))
    client.set_light(0, sky_ambient=(0.5, 0.6, 0.7))
    light = client.get_light(0)
    np.testing.assert_allclose(light.sun_color, [0.2, 0.2, 0.1])
    np.testing.assert_allclose(light.sky_ambient, [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(light.ground_ambient, before.ground_ambient)


@pytest.fixture
def fleet():
    """Drones with rotors: one env, with room for one more."""
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    return flockstep.Batch("playground/train-1", 2, drones_per_env=2, drone="x500", dynamics=dynamics)


def test_steps_follow_a_batch_that_its_program_enlarges(fleet):
    fleet.set_pose([[3, 3, 2], [4, 3, 2]])
    with flockstep.serve(fleet, port=0) as server, flockstep.connect(server.address) as client:
        client.drone(0).set_command([0.5, 0, 0, 0])
        client.step()
        fleet.spawn([5], position=[[5, 3, 2]])
        before = fleet.position.copy()
        assert client.step().step == 2
        assert fleet.position[0, 0] > before[0, 0] + 0.005
        fleet.spawn([9], position=[[5, 4, 2]])
        client.set_clock(100)
        time.sleep(0.3)
        assert client.set_clock(0).step > 5


def test_a_new_drone_has_no_command_and_no_owner(fleet):
    fleet.set_pose([[3, 3, 2], [4, 3, 2]])
    server = flockstep.serve(fleet, port=0, ownership=True)
    with server, flockstep.connect(server.address) as owner, flockstep.connect(server.address) as other:
        owner.claim([0])
        owner.drone(0).set_command([0.5, 0, 0, 0])
        owner.step()
        fleet.remove([0])
        drone = other.spawn_drone([3, 3, 2])
        assert (drone.index, drone.owner) == (0, 0)
        owner.step()
        np.testing.assert_array_equal(fleet.position[0], [3, 3, 2])
        drone.set_command([0, 0, 0.5, 0])


def test_a_command_that_steps_would_refuse_is_refused(fleet):
    with flockstep.serve(fleet, port=0) as server, flockstep.connect(server.address) as client:
        for control, command in (
            ("velocity", [1e7, 0, 0, 0]),
            ("attitude", [9.8, 90, 0, 0]),
            ("position", [0, 0, 1, 1e5]),
        ):
            with refused(ServerError, "command") as refusal:
                client.drone(0).set_command(command, control=control)
            assert refusal.value.code == "INVALID_ARGUMENT"
            with refused(ServerError, "command"):
                client.set_command([[0, 0, 0, 0], command], control=control)
        client.set_command([[0, 0, 0, 0], [1e7, 0, 0, 0]], mask=[True, False])
        assert client.step().step == 1


@pytest.mark.parametrize("is_by_program", [False, True])
def test_the_command_of_a_removed_drone_concerns_nobody(fleet, is_by_program):
    fleet.set_pose([[3, 3, 2], [4, 3, 2]])
    with flockstep.serve(fleet, port=0) as server, flockstep.connect(server.address) as client:
        client.drone(0).set_command([5, 4, 0, 0])  # as angles, 4 would be too large
        client.step()
        if is_by_program:
            fleet.remove([0])
        else:
            client.drone(0).remove()
        client.drone(1).set_command([9.8, 0, 0, 0], control="attitude")
        assert client.step().step == 2


def test_indices_stay():
    """A client cannot change the indices of drones, and claims follow those that the program changes."""
    batch = flockstep.Batch("playground/train-1", 4, drones_per_env=2)
    server = flockstep.serve(batch, port=0, ownership=True)
    with server, flockstep.connect(server.address) as owner, flockstep.connect(server.address) as other:
        owner.claim([2])
        with refused(ServerError, "no slot"):
            other.spawn_drone([1, 1, 1.5], env=0)
        other.drone(1).remove()
        assert other.spawn_drone([1, 1, 1.5], env=0).index == 1
        batch.spawn(position=[[1, 0, 1.5]], env=[0])
        owners = [(drone.index, drone.env, drone.owner) for drone in other.get_drones()]
        assert owners == [(0, 0, 0), (1, 0, 0), (2, 0, 0), (4, 1, owner.info.client), (5, 1, 0)]
        with refused(ServerError, "drone 4 is claimed"):
            other.drone(4).set_location([1, 0, 1])


def test_a_batch_has_one_server_at_a_time(batch):
    server = flockstep.serve(batch, port=0)
    with refused(ValueError, "batch", "one that another server serves"):
        flockstep.serve(batch, port=0)
    server.stop()
    with flockstep.serve(batch, port=0) as later, flockstep.connect(later.address) as client:
        del server  # its end does not end the sharing
        thread = in_thread(lambda: [batch.sense() for _ in range(500)])
        for _ in range(500):
            client.sense()
        thread.join()


class EndOfServers(Still):
    """Calls a function of the list of servers in each step."""

    servers: ClassVar[list] = []
    end = staticmethod(list.clear)

    def step(self, batch):
        type(self).end(self.servers)
        return super().step(batch)


def test_a_task_cannot_stop_its_server(monkeypatch):
    monkeypatch.setattr(EndOfServers, "end", staticmethod(lambda servers: servers[0].stop()))
    envs = flockstep.DroneVectorEnv(1, worlds="train", task=EndOfServers)
    with flockstep.serve(envs, port=0) as server, flockstep.connect(server.address) as client:
        monkeypatch.setattr(EndOfServers, "servers", [server])
        remote = client.vector_env()
        remote.reset(seed=0)
        with refused(ServerError, "RuntimeError", "stop()"):
            remote.step(remote.action_space.sample())
        client.ping()


def test_a_task_can_drop_its_server(monkeypatch):
    envs = flockstep.DroneVectorEnv(1, worlds="train", task=EndOfServers)
    monkeypatch.setattr(EndOfServers, "servers", [flockstep.serve(envs, port=0)])
    client = flockstep.connect(EndOfServers.servers[0].address)
    remote = client.vector_env()
    remote.reset(seed=0)
    with contextlib.suppress(ConnectionError, ServerError):
        remote.step(remote.action_space.sample())
        while True:  # until the server has stopped
            client.ping()

    def is_free():
        with contextlib.suppress(ValueError):  # another server serves the batch
            flockstep.serve(envs, port=0).stop()
            return True
        return False

    eventually(is_free)


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_child_process_can_drop_the_server_and_a_client(batch):
    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        pid = os.fork()
        if pid == 0:
            server.stop()
            del server, client
            os._exit(0)
        assert os.waitpid(pid, 0) == (pid, 0)
        client.ping()
        flockstep.connect(server.address).close()


def test_ctrl_c_of_the_program_ends_its_wait_for_a_client():
    code = """
import os, signal, sys, threading, time, numpy, flockstep
dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
batch = flockstep.Batch("playground/train-1", 256, drone="x500", dynamics=dynamics)
with flockstep.serve(batch, port=0) as server:
    client = flockstep.connect(server.address)
    fly = lambda: client.fly(numpy.zeros((256, 4)), ticks=1_000_000)
    threading.excepthook = lambda _: None
    threading.Thread(target=fly, daemon=True).start()
    time.sleep(0.3)
    started = time.monotonic()
    try:
        threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        batch.sense()
    except KeyboardInterrupt:
        print("interrupted")
print("ended", time.monotonic() - started < 2)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\nended True\n", "")


@pytest.mark.parametrize("is_python", [False, True])
def test_the_interpreter_ends_with_a_running_server(is_python):
    """Also while the threads of the server run a task in Python."""
    code = """
import sys, threading, time, numpy as np, flockstep
from gymnasium import spaces
class Climb(flockstep.Task):
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    def step(self, batch):
        time.sleep(0.001)
        return batch.position[:, 2], batch.contact.hit
    def observe(self, batch):
        return batch.position
threading.excepthook = lambda _: None  # clients lose their server
task = Climb if sys.argv[1] == "True" else None
envs = flockstep.DroneVectorEnv(4, worlds="train", **({"task": task} if task else {}))
envs.reset(seed=0)
server = flockstep.serve(envs, port=0)
def load():
    with flockstep.connect(server.address) as client:
        remote = client.vector_env()
        remote.reset(seed=1)
        while True:
            remote.step(remote.action_space.sample())
for _ in range(3):
    threading.Thread(target=load, daemon=True).start()
deadline = time.monotonic() + 30
while server.num_steps <= 10 and time.monotonic() < deadline:
    time.sleep(0.01)
assert server.num_steps > 10, server.num_steps
for _ in range(20):
    envs.step(envs.action_space.sample())
print("end")
"""
    for _ in range(3):
        arguments = [sys.executable, "-c", code, str(is_python)]
        done = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (0, "end\n", "")


# --- ownership and time


def test_ownership(batch):
    server = flockstep.serve(batch, port=0, ownership=True)
    with server, flockstep.connect(server.address) as owner, flockstep.connect(server.address) as other:
        owner.claim([1])
        owner.drone(1).set_location([1.0, 0.0, 1.5], teleport=True)
        assert [drone.owner for drone in other.get_drones()] == [0, owner.info.client, 0, 0]
        for ask in (
            lambda: other.drone(1).set_location([1.0, 0.0, 1.0]),
            lambda: other.drone(1).set_rotation([1.0, 0.0, 0.0, 0.0]),
            lambda: other.drone(1).set_lidar_config(hfov_deg=90.0),
            lambda: other.drone(1).set_move_line_visible(True),
            lambda: other.drone(1).remove(),
            lambda: other.drone(1).claim(),
            lambda: other.set_poses(position=batch.position.copy()),
            lambda: other.set_lidar_config(beams=7),
            lambda: other.restore(other.snapshot()),
            lambda: other.set_world(0, 0),
        ):
            with refused(ServerError, "drone 1 is claimed") as refusal:
                ask()
            assert refusal.value.code == "PERMISSION_DENIED"
        other.drone(0).set_location([1.0, 0.5, 1.5], teleport=True)
        other.drone(1).get_location()
        other.step()
        owner.release([1])
        other.drone(1).set_location([1.0, 0.0, 1.0], teleport=True)
        owner.claim([2])
        owner.close()
        eventually(lambda: not other.get_drones()[2].owner)
        other.drone(2).set_location([1.0, 0.0, 1.2], teleport=True)


def test_without_ownership_a_claim_only_shows(server, client):
    with flockstep.connect(server.address) as other:
        client.claim([1])
        assert other.get_drones()[1].owner == client.info.client
        other.drone(1).set_location([1.0, 0.0, 1.0], teleport=True)


def test_lockstep_waits_for_all_members(server):
    with flockstep.connect(server.address) as a, flockstep.connect(server.address) as b:
        a.join_lockstep()
        b.join_lockstep()
        done = []
        thread = in_thread(lambda: done.append(a.step().step))
        time.sleep(0.2)
        assert not done
        with flockstep.connect(server.address) as outsider, refused(ServerError, "JoinLockstep"):
            outsider.step()
        assert b.step().step == 1
        thread.join(10)
        thread = in_thread(lambda: done.append(a.step().step))
        time.sleep(0.1)
        b.close()  # a member that is gone does not hold up the others
        thread.join(10)
        assert done == [1, 2]


def test_a_member_that_does_not_step_leaves_the_lockstep(batch):
    server = flockstep.serve(batch, port=0, lockstep_timeout_s=0.3)
    with server, flockstep.connect(server.address) as a, flockstep.connect(server.address) as b:
        a.join_lockstep()
        b.join_lockstep()
        assert a.step().step == 1
        with refused(ServerError, "JoinLockstep", "lockstep_timeout_s", 0.3):
            b.step()
        assert a.step().step == 2  # nobody is waited for any more
        b.join_lockstep()
        for step in (3, 4):  # both are members again
            thread = in_thread(b.step)
            assert a.step().step == step
            thread.join(10)


def test_the_clock_steps_in_real_time(client):
    client.set_clock(100)
    before = client.get_arrays(["position"]).time.step
    time.sleep(1.0)
    after = client.get_arrays(["position"]).time.step
    assert 30 <= after - before <= 110
    fps = client.get_fps()
    assert 30 <= fps.fps <= 110
    assert fps.real_time_factor == pytest.approx(fps.fps * client.info.step_s, rel=0.01)
    with refused(ServerError, "steps by itself") as refusal:
        client.step()
    assert refusal.value.code == "FAILED_PRECONDITION"
    client.set_clock(0)
    client.step()


@pytest.mark.parametrize("rate_hz", [1e-12, 1e-300, -1.0, 1e5])
def test_rates_without_a_period_are_refused(server, rate_hz):
    with Raw(server) as raw:
        error = raw.ask(Request(id=2, set_clock=pb.SetClock(rate_hz=rate_hz))).error
        assert error.code == pb.Code.INVALID_ARGUMENT and "rate_hz: expected 0 or a number in" in error.text
        error = raw.ask(Request(id=3, subscribe=pb.Subscribe(rate_hz=rate_hz, fps=pb.GetFps()))).error
        assert error.code == pb.Code.INVALID_ARGUMENT and "rate_hz: expected a number in [1e-06, 1000]" in error.text
        slow = pb.Subscribe(rate_hz=1e-6, fps=pb.GetFps())
        assert raw.ask(Request(id=4, subscribe=slow)).HasField("fps")
        assert raw.ask(Request(id=5, ping=Ping())).id == 5  # no second value
