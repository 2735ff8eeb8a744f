"""Messages of clients to the server that no client of ours would send, and too many of them."""

import contextlib
import resource
import socket
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from clients import Raw, eventually, in_thread
from messages import refused
from websockets.exceptions import ConnectionClosed

import flockstep
from flockstep.client import ServerError
from flockstep.client import protocol as pb
from flockstep.client.frames import encode
from flockstep.client.protocol import Ping, Reply, Request, Step
from flockstep.client.session import Session

PONG = encode(Reply(id=4, done=pb.Done()), {})


@pytest.fixture
def batch():
    return flockstep.Batch("playground/train-1", 4, drones_per_env=4, lidar=flockstep.LidarConfig(beams=5))


def test_numbers_that_are_not_finite_are_refused(server, client):
    before = client.get_arrays(["position"])["position"]
    for value in (float("nan"), float("inf"), -float("inf")):
        place = pb.SetLocation(drone=0, location=pb.Vector3(x=value))
        for request, arrays in (
            (Request(id=2, set_location=place), {}),
            (Request(id=2, set_poses=pb.SetPoses()), {"position": np.full((4, 3), value, np.float32)}),
        ):
            with Raw(server) as raw:
                error = raw.ask(request, **arrays).error
            assert error.code == pb.Code.INVALID_ARGUMENT and "finite" in error.text
    np.testing.assert_array_equal(client.get_arrays(["position"])["position"], before)


@pytest.mark.parametrize("drone", [-1, 4, 1 << 40, -(1 << 63)])
def test_foreign_drones_are_not_found(client, drone):
    place = ("set_location", [0, 0, 1])
    for operation, *arguments in (("get_location",), place, ("get_lidar_data",), ("remove",), ("claim",)):
        with pytest.raises(ServerError) as refusal:
            getattr(client.drone(drone), operation)(*arguments)
        assert refusal.value.code == "NOT_FOUND"


def test_arrays_are_checked(server):
    wrong = {
        "position: expected shape (4, 3)": {"position": np.zeros((3, 3), np.float32)},
        "position: expected values of type": {"position": np.zeros((4, 3))},
        "arrays: expected position, quat_wxyz, mask": {"positions": np.zeros((4, 3), np.float32)},
        "mask: expected flags": {"mask": np.full(4, 2, np.uint8).view(np.bool_)},
    }
    for text, arrays in wrong.items():
        with Raw(server) as raw:
            error = raw.ask(Request(id=2, set_poses=pb.SetPoses(teleport=True)), **arrays).error
            assert text in error.text


@pytest.mark.parametrize("size", [0, 3, 4, 5, 30])
def test_messages_that_are_cut_short_end_the_session(server, size):
    whole = encode(Request(id=2, set_poses=pb.SetPoses()), {"mask": np.zeros(4, np.bool_)})
    with Raw(server) as raw:
        raw.send(whole[: min(size, len(whole) - 1)])
        assert raw.reply().error.code == pb.Code.INVALID_ARGUMENT
        assert raw.is_closed()


def test_messages_that_are_too_long_end_the_session(server):
    poses = encode(Request(id=2, set_poses=pb.SetPoses()), {"position": np.zeros((1000, 3), np.float32)})
    for data, code, text in (
        (poses, pb.Code.RESOURCE_EXHAUSTED, "got 12000"),
        (struct.pack("<I", 1 << 31) + bytes(100), pb.Code.INVALID_ARGUMENT, "header of at most 65536 bytes"),
        (encode(Request(id=2, ping=Ping()), {}) + bytes(10), pb.Code.INVALID_ARGUMENT, ""),
    ):
        with Raw(server) as raw:
            raw.send(data)
            error = raw.reply().error
            assert error.code == code and text in error.text
            assert raw.is_closed()


def test_claimed_sizes_are_not_allocated(server):
    invalid, exhausted = pb.Code.INVALID_ARGUMENT, pb.Code.RESOURCE_EXHAUSTED
    sizes = (([1 << 62, 4], invalid), ([1 << 33], exhausted), ([1 << 30], exhausted))
    for shape, code in (*sizes, ([0, 1 << 63], invalid), ([2] * 9, invalid)):
        header = Request(id=2, restore=pb.Restore(), arrays=[pb.Array(name="snapshot", dtype=2, shape=shape)])
        with Raw(server) as raw:
            raw.send_header(header.SerializeToString())
            assert raw.reply().error.code == code


@pytest.mark.parametrize("size", [1 << 62, 1 << 63, (1 << 64) - 1, None])
def test_text_and_frames_of_absurd_sizes_end_the_session(server, size):
    with Raw(server) as raw:
        if size is None:
            raw.socket.send("hello")
        else:
            raw.socket.socket.sendall(b"\x82\xff" + size.to_bytes(8, "big") + bytes(4))
        assert raw.is_closed()


def test_requests_of_many_arrays_are_refused(server):
    with Raw(server) as raw:
        raw.send_header(Request(id=2, ping=Ping(), arrays=[pb.Array(dtype=1, shape=[0])] * 9).SerializeToString())
        error = raw.reply().error
        assert (error.code, error.text) == (pb.Code.INVALID_ARGUMENT, "message: arrays: expected at most 8, got 9")
        assert raw.ask(Request(id=3, ping=Ping())).id == 3


def test_mutated_messages_change_nothing_but_what_they_say(server, client):
    random = np.random.default_rng(0)
    messages = [
        encode(Request(id=2, set_poses=pb.SetPoses()), {"mask": np.zeros(4, np.bool_)}),
        encode(Request(id=3, get_lidar_data=pb.GetLidarData(drone=1, lidar="lidar")), {}),
        encode(Request(id=4, get_arrays=pb.GetArrays(names=["position", "active"])), {}),
        encode(Request(id=5, subscribe=pb.Subscribe(rate_hz=1, fps=pb.GetFps())), {}),
        encode(Request(id=6, set_lidar_config=pb.SetLidarConfig(drone=0, config_json='{"hfov_deg": 90}')), {}),
    ]
    raw = Raw(server)
    for _ in range(600):
        data = bytearray(messages[random.integers(len(messages))])
        for _ in range(random.integers(1, 4)):
            data[random.integers(4 if random.random() < 0.9 else 0, len(data))] = random.integers(256)
        try:
            raw.send(bytes(data))
            raw.reply()
        except (ConnectionClosed, TimeoutError):
            raw.__exit__()
            raw = Raw(server)
    raw.__exit__()
    client.ping()
    assert len(client.get_drones()) >= 0


@contextlib.contextmanager
def waiting(batch, max_requests):
    """A client whose first step waits for another one, so that its further requests queue. Yields it and the other."""
    server = flockstep.serve(batch, port=0, max_requests=max_requests)
    with server, Raw(server) as raw, flockstep.connect(server.address) as other:
        other.join_lockstep()
        raw.ask(Request(id=2, join_lockstep=pb.JoinLockstep()))
        raw.send(encode(Request(id=3, step=Step()), {}))
        yield raw, other


def sent_until_full(raw, message, times):
    """Send a message again and again, until nothing is taken any more; return a list that grows with what was sent."""
    sent = []

    def send():
        with contextlib.suppress(ConnectionClosed, OSError):  # at the end
            for _ in range(times):
                sent.append(raw.send(message))

    in_thread(send)
    count = -1
    while len(sent) > count:
        count = len(sent)
        time.sleep(0.3)
    return sent


def test_unanswered_requests_are_limited(batch):
    with waiting(batch, 8) as (raw, other):
        for i in range(11):  # seven wait in the queue
            raw.send(encode(Request(id=10 + i, step=Step()), {}))
        replies = [raw.reply() for _ in range(4)]
        assert [reply.id for reply in replies] == [17, 18, 19, 20]
        assert all(reply.error.code == pb.Code.RESOURCE_EXHAUSTED for reply in replies)
        assert "8 unanswered requests" in replies[0].error.text
        other.leave_lockstep()
        assert [raw.reply().id for _ in range(8)] == [3, *range(10, 17)]


def test_waiting_requests_do_not_fill_the_memory():
    """A client can send about 16 MiB before its first request is answered."""
    wrong = encode(Request(id=4, set_poses=pb.SetPoses()), {"position": np.zeros(7 * 40_000, np.float32)})
    with waiting(flockstep.Batch("playground/train-1", 40_000), 100) as (raw, other):
        sent = sent_until_full(raw, wrong, 60)
        assert len(sent) < 45  # 60 would be 64 MiB; some are in the buffers of the sockets
        other.leave_lockstep()
        assert raw.reply().HasField("time")
        for _ in range(60):
            assert "position: expected shape" in raw.reply().error.text


def test_waiting_headers_are_counted_as_what_they_become(batch):
    """A name of no length takes 2 bytes in a message and 32 in memory."""

    def resident_bytes():
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    names = encode(Request(id=4, get_arrays=pb.GetArrays(names=[""] * 32_000)), {})
    with waiting(batch, 2000) as (raw, _):
        raw.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 16)
        before = resident_bytes()
        sent_until_full(raw, names, 400)
        assert resident_bytes() - before < 60 << 20  # as messages of 16 MiB they would become 256 MiB


def test_many_waiting_requests_are_answered_at_once(batch):
    with waiting(batch, 40_000) as (raw, other):
        ping = Session("ws://a/").frame(encode(Request(id=4, ping=Ping()), {}))
        raw.socket.socket.sendall(40_000 * ping)
        assert raw.reply().error.code == pb.Code.RESOURCE_EXHAUSTED  # the last one: all have come
        other.leave_lockstep()
        assert raw.reply().id == 3
        for _ in range(39_999):
            assert raw.socket.recv(10) == PONG


def test_clients_are_limited(batch):
    with flockstep.serve(batch, port=0, max_clients=2) as server:
        clients = [flockstep.connect(server.address) for _ in range(2)]
        assert len({client.info.client for client in clients}) == 2
        with refused(ServerError, "2 clients") as refusal:
            flockstep.connect(server.address)
        assert refusal.value.code == "RESOURCE_EXHAUSTED"
        for client in clients:
            client.close()
        eventually(lambda: server.num_clients == 0)
        flockstep.connect(server.address).close()
