"""The server: what clients may do and when, and faults of clients and of the network."""

import contextlib
import os
import re
import resource
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from conftest import ROOT
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect as connect_websocket

import flockstep
from flockstep.client import protocol as pb
from flockstep.client.frames import decode, encode
from flockstep.client.protocol import Hello, Ping, Reply, Request, Step
from flockstep.client.session import Session

CERTIFICATES = Path(__file__).parent / "certificates"
SECRET = "a-secret"
PONG = encode(Reply(id=4, done=pb.Done()), {})


@pytest.fixture
def batch():
    return flockstep.Batch("playground/train-1", 4, drones_per_env=4, lidar=flockstep.LidarConfig(beams=5))


@pytest.fixture
def server(batch):
    with flockstep.serve(batch, port=0) as server:
        yield server


@pytest.fixture
def client(server):
    with flockstep.connect(server.address) as client:
        yield client


class Raw:
    """A connection that sends any bytes."""

    def __init__(self, server, hello=True):
        self.stack = contextlib.ExitStack()
        opened = connect_websocket(f"ws://{server.address}/", compression=None, max_size=None, max_queue=1, proxy=None)
        self.socket = self.stack.enter_context(opened)
        if hello:
            assert self.ask(Request(id=1, hello=Hello(protocol=2))).welcome.protocol == 2

    def ask(self, request, **arrays):
        self.socket.send(encode(request, arrays))
        return self.reply()

    def reply(self, timeout=10):
        return decode(self.socket.recv(timeout))[0]

    def send(self, data):
        self.socket.send(data)

    def is_closed(self):
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            while True:
                self.socket.recv(10)
        return self.socket.close_code is not None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with contextlib.suppress(OSError):
            self.socket.socket.shutdown(socket.SHUT_RDWR)  # without a closing handshake
        self.stack.close()


def in_thread(function):
    thread = threading.Thread(target=function, daemon=True)
    thread.start()
    return thread


# --- addresses


def test_an_address_of_the_network_needs_a_token(batch):
    with pytest.raises(
        ValueError, match=r"token: expected a secret, because other machines reach the address 0\.0\.0\.0"
    ):
        flockstep.serve(batch, address="0.0.0.0", port=0)
    server = flockstep.serve(batch, address="0.0.0.0", port=0, token=SECRET)
    with server, flockstep.connect(f"127.0.0.1:{server.port}", token=SECRET) as client:
        client.ping()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"address": "nowhere.example"}, "address: expected an IP address, localhost or unix:PATH"),
        ({"address": "unix:"}, "address: expected unix:PATH"),
        ({"port": 65536}, r"port: expected an integer in \[0, 65535\]"),
        ({"certificate_file": "a.pem"}, "private_key_file: expected both a certificate and its private key"),
        ({"rate_hz": float("nan")}, "rate_hz: expected"),
        ({"rate_hz": 1e-300}, r"rate_hz: expected 0 or a number in \[1e-06, 10000\], got 1e-300"),
        ({"max_clients": 0}, "max_clients: expected"),
        ({"token": " "}, "token: expected a secret, got only spaces"),
        ({"lockstep_timeout_s": 0}, "lockstep_timeout_s: expected"),
        ({"tokn": "x"}, "tokn.*Did you mean 'token'"),
    ],
)
def test_bad_configurations_are_refused(batch, fields, message):
    with pytest.raises((ValueError, TypeError), match=message):
        flockstep.serve(batch, **{"port": 0} | fields)
    batch.sense()  # the batch is not shared afterwards


def test_a_port_that_is_taken_says_so(server, batch):
    other = flockstep.Batch("playground/train-1", 1)
    with pytest.raises(RuntimeError, match=r"port \d+: Address already in use; another server may run there"):
        flockstep.serve(other, port=server.port)


def test_a_unix_socket_is_only_for_its_owner(batch, tmp_path):
    path = tmp_path / "socket"
    with flockstep.serve(batch, address=f"unix:{path}") as server:
        assert path.stat().st_mode & 0o777 == 0o600
        with flockstep.connect(server.address) as client:
            assert len(client.get_drones()) == 4
    assert not path.exists()


def test_tls_needs_a_trusted_certificate(batch):
    files = {"certificate_file": str(CERTIFICATES / "server.crt"), "private_key_file": str(CERTIFICATES / "server.key")}
    with flockstep.serve(batch, port=0, **files) as server:
        url = f"wss://localhost:{server.port}"
        with flockstep.connect(url, ca_file=CERTIFICATES / "server.crt") as client:
            assert len(client.get_drones()) == 4
        with pytest.raises(ConnectionError, match="certificate"):
            flockstep.connect(url, ca_file=CERTIFICATES / "other.crt")
        with pytest.raises(ConnectionError):
            flockstep.connect(server.address, timeout_s=5)
        with flockstep.connect(url, ca_file=CERTIFICATES / "server.crt") as client:
            client.ping()


def test_files_of_tls_that_cannot_be_read_are_named(batch, tmp_path):
    (tmp_path / "bad.pem").write_text("no certificate")
    with pytest.raises(RuntimeError, match="certificate_file, private_key_file: cannot be used"):
        flockstep.serve(batch, port=0, certificate_file=str(tmp_path / "bad.pem"), private_key_file="missing.pem")


# --- Hello


@pytest.mark.parametrize("token", ["", "b-secret", SECRET[:-1], SECRET + "x"])
def test_a_wrong_token_is_refused(batch, token):
    with flockstep.serve(batch, port=0, token=SECRET) as server:
        with pytest.raises(flockstep.client.ServerError, match="token") as refusal:
            flockstep.connect(server.address, token=token)
        assert refusal.value.code == "UNAUTHENTICATED"
        with flockstep.connect(server.address, token=SECRET) as client:
            client.ping()


def test_nothing_comes_before_hello(server):
    with Raw(server, hello=False) as raw:
        assert raw.ask(Request(id=9, ping=Ping())).error.code == pb.Code.FAILED_PRECONDITION
        assert raw.is_closed()
    with Raw(server, hello=False) as raw:  # arrays neither
        large = encode(Request(id=9, hello=Hello(protocol=2)), {"actions": np.zeros(5000, np.float32)})
        with contextlib.suppress(ConnectionClosed):
            raw.send(large)
        assert raw.is_closed()


@pytest.mark.parametrize("version", [0, 1, 3, 4294967295])
def test_another_version_is_refused_in_words(server, version):
    with Raw(server, hello=False) as raw:
        error = raw.ask(Request(id=1, hello=Hello(protocol=version))).error
        assert error.code == pb.Code.FAILED_PRECONDITION
        assert f"got {version}; install the same version on both sides" in error.text
        assert raw.is_closed()


def test_fields_of_newer_clients_are_skipped(server):
    with Raw(server) as raw:
        header = Request(id=2, ping=Ping()).SerializeToString() + bytes([0xF8, 0x3F, 7])  # field 1023, varint 7
        raw.send(struct.pack("<I", len(header)) + header)
        assert raw.reply().HasField("done")


def test_operations_of_newer_clients_are_unknown(server):
    with Raw(server) as raw:
        header = bytes([0x08, 5, 0xFA, 0x3F, 0])  # id 5; field 1023, an empty message
        raw.send(struct.pack("<I", len(header)) + header)
        reply = raw.reply()
        assert reply.id == 5 and reply.error.code == pb.Code.UNIMPLEMENTED
        assert raw.ask(Request(id=6, ping=Ping())).HasField("done")


def upgrade(server, *fields):
    """Return the first line of the answer to a request for a WebSocket with further fields."""
    lines = [
        "GET / HTTP/1.1",
        f"Host: {server.address}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        *fields,
    ]
    with socket.create_connection(("127.0.0.1", server.port)) as connected:
        connected.settimeout(10)
        connected.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return connected.recv(4096).decode().partition("\r\n")[0]


def test_web_pages_need_a_token(server, batch):
    """A browser lets every page connect to this machine, but adds the page's origin."""
    assert upgrade(server) == "HTTP/1.1 101 Switching Protocols"
    for origin in ("http://evil.example", f"http://{server.address}", "null", ""):
        assert upgrade(server, f"Origin: {origin}") == "HTTP/1.1 403 Forbidden"
    assert upgrade(server, "oRiGiN: file://") == "HTTP/1.1 403 Forbidden"
    other = flockstep.Batch("playground/train-1")
    with flockstep.serve(other, port=0, token=SECRET) as guarded:
        assert upgrade(guarded, "Origin: http://evil.example") == "HTTP/1.1 101 Switching Protocols"
        with pytest.raises(flockstep.client.ServerError, match="token"):
            flockstep.connect(guarded.address)


def test_requests_that_are_no_websockets_are_refused(server, client):
    for request in (b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", b"\x16\x03\x01\x02\x00" * 100, b"A" * 100_000):
        with socket.create_connection(("127.0.0.1", server.port)) as connected:
            connected.settimeout(10)
            with contextlib.suppress(OSError):
                connected.sendall(request)
                connected.shutdown(socket.SHUT_WR)
                while connected.recv(4096):
                    pass
    client.ping()


def test_connections_without_hello_keep_nobody_out(batch):
    with flockstep.serve(batch, port=0, token=SECRET, max_clients=2) as server:
        silent = [Raw(server, hello=False) for _ in range(5)]
        with flockstep.connect(server.address, token=SECRET) as client:
            client.ping()
        for raw in silent:
            raw.__exit__()


def test_too_many_connections_without_hello_make_room(batch):
    with flockstep.serve(batch, port=0, max_clients=2) as server, flockstep.connect(server.address) as client:
        silent = [socket.create_connection(("127.0.0.1", server.port), timeout=5) for _ in range(75)]
        for oldest in silent[:10]:  # 66 connections may stay
            assert oldest.recv(1) == b""  # the time for Hello is 10 s
        client.ping()
        flockstep.connect(server.address).close()
        for connection in silent:
            connection.close()


def test_connections_without_hello_leave_files_for_clients():
    serve = [sys.executable, "-m", "flockstep", "serve", "--port", "0", "--world", "playground/train-1"]
    limited = ["sh", "-c", 'ulimit -n 64; exec "$@"', "sh", *serve]
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(subprocess.Popen(limited, stdout=subprocess.PIPE, text=True))
        stack.callback(process.terminate)
        address = process.stdout.readline().split(" at ")[1].split(";")[0]
        host, port = address.split(":")
        for _ in range(100):
            stack.enter_context(socket.create_connection((host, int(port))))
        with flockstep.connect(address, timeout_s=5) as client:
            client.ping()


def test_replies_that_are_not_read_do_not_fill_the_memory(batch):
    def peak_kib():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        points = client.get_point_cloud(spacing_m=0.02)  # about 30 MB
        before = peak_kib()
        size_kib = points.points.nbytes // 1024
        assert size_kib > 1000
        with Raw(server) as raw:
            for i in range(60):
                request = Request(id=2 + i, get_point_cloud=pb.GetPointCloud(spacing_m=0.02))
                raw.send(encode(request, {}))
            time.sleep(3)
            assert peak_kib() - before < 20 * size_kib


# --- messages


def test_numbers_that_are_not_finite_are_refused(server, client):
    before = client.get_arrays(["position"])["position"]
    with Raw(server) as raw:
        for value in (float("nan"), float("inf"), -float("inf")):
            location = pb.Vector3(x=value)
            error = raw.ask(Request(id=2, set_location=pb.SetLocation(drone=0, location=location))).error
            assert error.code == pb.Code.INVALID_ARGUMENT
            raw.__exit__()
            raw = Raw(server)
            error = raw.ask(Request(id=2, set_poses=pb.SetPoses()), position=np.full((4, 3), value, np.float32)).error
            assert error.code == pb.Code.INVALID_ARGUMENT and "finite" in error.text
    np.testing.assert_array_equal(client.get_arrays(["position"])["position"], before)


@pytest.mark.parametrize("drone", [-1, 4, 1 << 40, -(1 << 63)])
def test_foreign_drones_are_not_found(client, drone):
    for ask in (
        lambda: client.drone(drone).get_location(),
        lambda: client.drone(drone).set_location([0, 0, 1]),
        lambda: client.drone(drone).get_lidar_data(),
        lambda: client.drone(drone).remove(),
        lambda: client.drone(drone).claim(),
    ):
        with pytest.raises(flockstep.client.ServerError) as refusal:
            ask()
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
    with Raw(server) as raw:
        arrays = {"position": np.zeros((1000, 3), np.float32)}
        error = raw.ask(Request(id=2, set_poses=pb.SetPoses()), **arrays).error
        assert error.code == pb.Code.RESOURCE_EXHAUSTED and "got 12000" in error.text
        assert raw.is_closed()
    with Raw(server) as raw:
        raw.send(struct.pack("<I", 1 << 31) + bytes(100))
        assert "header of at most 65536 bytes" in raw.reply().error.text
        assert raw.is_closed()
    with Raw(server) as raw:
        raw.send(encode(Request(id=2, ping=Ping()), {}) + bytes(10))
        assert raw.reply().error.code == pb.Code.INVALID_ARGUMENT
        assert raw.is_closed()


def test_claimed_sizes_are_not_allocated(server):
    for shape in ([1 << 62, 4], [1 << 33], [1 << 30], [0, 1 << 63], [2] * 9):
        is_too_long = shape in ([1 << 33], [1 << 30])
        header = Request(id=2, restore=pb.Restore(), arrays=[pb.Array(name="snapshot", dtype=2, shape=shape)])
        data = header.SerializeToString()
        with Raw(server) as raw:
            raw.send(struct.pack("<I", len(data)) + data)
            code = pb.Code.RESOURCE_EXHAUSTED if is_too_long else pb.Code.INVALID_ARGUMENT
            assert raw.reply().error.code == code


@pytest.mark.parametrize("size", [1 << 62, 1 << 63, (1 << 64) - 1])
def test_frames_of_absurd_sizes_end_the_session(server, size):
    with Raw(server) as raw:
        raw.socket.socket.sendall(b"\x82\xff" + size.to_bytes(8, "big") + bytes(4))
        assert raw.is_closed()


def test_requests_of_many_arrays_are_refused(server):
    header = Request(id=2, ping=Ping(), arrays=[pb.Array(dtype=1, shape=[0])] * 9).SerializeToString()
    with Raw(server) as raw:
        raw.send(struct.pack("<I", len(header)) + header)
        error = raw.reply().error
        assert (error.code, error.text) == (
            pb.Code.INVALID_ARGUMENT,
            "message: arrays: expected at most 8, got 9",
        )
        assert raw.ask(Request(id=3, ping=Ping())).id == 3


def test_text_messages_end_the_session(server):
    with Raw(server) as raw:
        raw.socket.send("hello")
        assert raw.is_closed()


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


def test_unanswered_requests_are_limited(batch):
    server = flockstep.serve(batch, port=0, max_requests=8)
    with server, Raw(server) as raw, flockstep.connect(server.address) as other:
        other.join_lockstep()
        raw.ask(Request(id=2, join_lockstep=pb.JoinLockstep()))
        for i in range(12):  # the first waits for the other client, seven wait in the queue
            raw.send(encode(Request(id=10 + i, step=Step()), {}))
        replies = [raw.reply() for _ in range(4)]
        assert [reply.id for reply in replies] == [18, 19, 20, 21]
        assert all(reply.error.code == pb.Code.RESOURCE_EXHAUSTED for reply in replies)
        assert "8 unanswered requests" in replies[0].error.text
        other.leave_lockstep()
        assert [raw.reply().id for _ in range(8)] == list(range(10, 18))


def test_waiting_requests_do_not_fill_the_memory():
    """A client can send about 16 MiB before its first request is answered."""
    batch = flockstep.Batch("playground/train-1", 40_000)
    wrong = encode(Request(id=3, set_poses=pb.SetPoses()), {"position": np.zeros(7 * 40_000, np.float32)})
    server = flockstep.serve(batch, port=0, max_requests=100)
    with server, Raw(server) as raw, flockstep.connect(server.address) as other:
        other.join_lockstep()
        raw.ask(Request(id=2, join_lockstep=pb.JoinLockstep()))
        raw.send(encode(Request(id=2, step=Step()), {}))  # waits for the other client
        sent = []
        thread = in_thread(lambda: [sent.append(raw.send(wrong)) for _ in range(60)])
        before = -1
        while len(sent) > before:
            before = len(sent)
            time.sleep(0.3)
        assert len(sent) < 45  # 60 would be 64 MiB; some are in the buffers of the sockets
        other.leave_lockstep()
        assert raw.reply().HasField("time")
        for _ in range(60):
            assert "position: expected shape" in raw.reply().error.text
        thread.join(10)


def test_waiting_headers_are_counted_as_what_they_become(batch):
    """A name of no length takes 2 bytes in a message and 32 in memory."""
    names = encode(Request(id=3, get_arrays=pb.GetArrays(names=[""] * 32_000)), {})
    server = flockstep.serve(batch, port=0, max_requests=2000)
    with server, Raw(server) as raw, flockstep.connect(server.address) as other:
        other.join_lockstep()
        raw.ask(Request(id=2, join_lockstep=pb.JoinLockstep()))
        raw.send(encode(Request(id=2, step=Step()), {}))  # waits for the other client
        raw.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 16)
        before = resident_bytes()
        sent = []

        def send():
            with contextlib.suppress(ConnectionClosed, OSError):  # at the end
                for _ in range(400):
                    sent.append(raw.send(names))

        in_thread(send)
        count = -1
        while len(sent) > count:
            count = len(sent)
            time.sleep(0.3)
        assert resident_bytes() - before < 60 << 20  # as messages of 16 MiB they would become 256 MiB


def resident_bytes():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_many_waiting_requests_are_answered_at_once(batch):
    server = flockstep.serve(batch, port=0, max_requests=40_000)
    with server, Raw(server) as raw, flockstep.connect(server.address) as other:
        other.join_lockstep()
        raw.ask(Request(id=2, join_lockstep=pb.JoinLockstep()))
        raw.send(encode(Request(id=3, step=Step()), {}))  # waits for the other client
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
        with pytest.raises(flockstep.client.ServerError, match="2 clients, its maximum"):
            flockstep.connect(server.address)
        for client in clients:
            client.close()
        deadline = time.monotonic() + 10
        while server.num_clients > 0 and time.monotonic() < deadline:
            time.sleep(0.01)
        flockstep.connect(server.address).close()


# --- broken connections


def open_files():
    return len(os.listdir("/proc/self/fd"))


def test_a_thousand_clients_at_once(batch):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    count = 1000 if hard >= 4096 else (hard - 200) // 2
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    try:
        with flockstep.serve(batch, port=0, max_clients=count) as server:
            clients = [socket.create_connection((server.address.split(":")[0], server.port)) for _ in range(count - 50)]
            clients += [flockstep.connect(server.address) for _ in range(50)]
            assert server.num_clients >= 50
            for client in clients[-50:]:
                assert client.get_arrays(["position"])["position"].shape == (4, 3)
            for client in clients:
                client.close()
            deadline = time.monotonic() + 20
            while server.num_clients > 0 and time.monotonic() < deadline:
                time.sleep(0.01)
            assert server.num_clients == 0
            with flockstep.connect(server.address) as client:
                client.ping()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_clients_that_die_in_a_request_leave_nothing_behind(server, client):
    for i in range(50):
        raw = Raw(server)
        raw.send(encode(Request(id=2, get_arrays=pb.GetArrays(names=["position"])), {})[: 4 + i % 20])
        raw.__exit__()
    deadline = time.monotonic() + 10
    while server.num_clients > 1 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert server.num_clients == 1
    client.ping()


def test_a_half_open_connection_is_closed(batch):
    with flockstep.serve(batch, port=0, idle_timeout_s=0.5) as server:
        with socket.create_connection(("127.0.0.1", server.port)) as silent:
            key = b"GET / HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            silent.sendall(key + b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n")
            silent.settimeout(10)
            while silent.recv(4096):  # the handshake, a ping, then the end
                pass
        deadline = time.monotonic() + 10
        while server.num_clients > 0 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert server.num_clients == 0


def test_a_reader_that_never_reads_disturbs_nobody(batch):
    with flockstep.serve(batch, port=0) as server:
        raw = Raw(server)
        names = ["position", "quat_wxyz", "point", "normal"]
        for i in range(20):
            what = pb.GetArrays(names=names)
            raw.send(encode(Request(id=100 + i, subscribe=pb.Subscribe(rate_hz=1000, arrays=what)), {}))
        with flockstep.connect(server.address) as client:
            times = []
            for _ in range(300):
                started = time.perf_counter()
                client.ping()
                times.append(time.perf_counter() - started)
            assert np.median(times) < 0.05
        raw.__exit__()


def test_stop_tells_clients_and_a_new_server_takes_the_port(batch):
    server = flockstep.serve(batch, port=0)
    port = server.port
    client = flockstep.connect(server.address)
    server.stop()
    server.stop()
    time.sleep(0.2)
    with pytest.raises(ConnectionError, match="the server stops"):
        client.ping()
    with flockstep.serve(batch, port=port):
        client.reconnect()
        client.ping()
        client.close()


def test_a_server_that_is_gone_is_named():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(ConnectionError, match=r"python -m flockstep serve"):
        flockstep.connect(address)


# --- the program beside it


def test_reads_run_beside_a_step_and_see_one_moment(batch):
    batch = flockstep.Batch("playground/train-1", 64, drones_per_env=64, lidar=flockstep.LidarConfig(beams=2000))
    start = batch.position.copy()
    with flockstep.serve(batch, port=0) as server, flockstep.connect(server.address) as client:
        client.get_arrays(["position", "tick"])
        stop = threading.Event()

        def program():
            step = 0
            while not stop.is_set():
                step += 1
                target = start.copy()
                target[:, 2] += 0.001 * (step % 100)
                batch.set_pose(target)
                batch.sense()

        thread = in_thread(program)
        try:
            seen = set()
            for _ in range(500):
                heights = client.get_arrays(["position"])["position"][:, 2]
                assert np.ptp(heights) == 0  # all drones are moved together
                seen.add(float(heights[0]))
            assert len(seen) > 3
        finally:
            stop.set()
            thread.join()


def test_the_program_and_clients_take_turns(server, client, batch):
    stop = threading.Event()
    counts = {"program": 0}

    def program():
        while not stop.is_set():
            batch.sense()
            counts["program"] += 1

    thread = in_thread(program)
    try:
        for i in range(200):
            impact = client.drone(i % 4).set_location([1.0, 0.001 * i, 1.5], teleport=True)
            np.testing.assert_allclose(impact.location, [1.0, 0.001 * i, 1.5], rtol=1e-6)
    finally:
        stop.set()
        thread.join()
    assert counts["program"] > 0


def test_a_snapshot_under_load_restores(server, batch):
    stop = threading.Event()

    def move():
        with flockstep.connect(server.address) as other:
            while not stop.is_set():
                other.drone(0).set_location([np.random.default_rng().uniform(0.9, 1.1), 0.0, 1.5], teleport=True)

    threads = [in_thread(move) for _ in range(3)]
    try:
        with flockstep.connect(server.address) as client:
            for _ in range(20):
                blob = client.snapshot()
                client.restore(blob)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    with flockstep.connect(server.address) as client:
        blob, position = client.snapshot(), batch.position.copy()
        client.drone(0).set_location([1.0, 0.5, 1.0], teleport=True)
        client.restore(blob)
        np.testing.assert_array_equal(batch.position, position)
        with pytest.raises(flockstep.client.ServerError, match="corrupt"):
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
            with pytest.raises(flockstep.client.ServerError, match="command") as refusal:
                client.drone(0).set_command(command, control=control)
            assert refusal.value.code == "INVALID_ARGUMENT"
            with pytest.raises(flockstep.client.ServerError, match="command"):
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
        with pytest.raises(flockstep.client.ServerError, match="no slot is free"):
            other.spawn_drone([1, 1, 1.5], env=0)
        other.drone(1).remove()
        assert other.spawn_drone([1, 1, 1.5], env=0).index == 1
        batch.spawn(position=[[1, 0, 1.5]], env=[0])
        owners = [(drone.index, drone.env, drone.owner) for drone in other.get_drones()]
        assert owners == [(0, 0, 0), (1, 0, 0), (2, 0, 0), (4, 1, owner.info.client), (5, 1, 0)]
        with pytest.raises(flockstep.client.ServerError, match="drone 4 is claimed"):
            other.drone(4).set_location([1, 0, 1])


def test_a_batch_has_one_server_at_a_time(batch):
    server = flockstep.serve(batch, port=0)
    with pytest.raises(
        ValueError, match="batch: expected one that no server serves, got one that another server serves"
    ):
        flockstep.serve(batch, port=0)
    server.stop()
    with flockstep.serve(batch, port=0) as later, flockstep.connect(later.address) as client:
        del server  # its end does not end the sharing
        thread = in_thread(lambda: [batch.sense() for _ in range(500)])
        for _ in range(500):
            client.sense()
        thread.join()


def test_stop_ends_long_operations(fleet):
    server = flockstep.serve(fleet, port=0)
    client = flockstep.connect(server.address)
    failures = []

    def fly():
        while True:
            try:
                client.fly(np.zeros((2, 4)), ticks=1_000_000)
            except (flockstep.client.ServerError, ConnectionError) as error:
                failures.append(error)
                return

    thread = in_thread(fly)
    time.sleep(0.3)
    started = time.monotonic()
    server.stop()
    assert time.monotonic() - started < 1.5
    thread.join(10)
    assert len(failures) == 1
    fleet.fly(np.zeros((2, 4)))  # the program goes on


class EndOfServers(flockstep.Task):
    """Calls a function of the list of servers in each step."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    servers: ClassVar[list] = []
    end = staticmethod(list.clear)

    def step(self, batch):
        type(self).end(self.servers)
        return batch.position[:, 2], batch.contact.hit

    def observe(self, batch):
        return batch.position


def test_a_task_cannot_stop_its_server(monkeypatch):
    monkeypatch.setattr(EndOfServers, "end", staticmethod(lambda servers: servers[0].stop()))
    envs = flockstep.DroneVectorEnv(1, worlds="train", task=EndOfServers)
    with flockstep.serve(envs, port=0) as server, flockstep.connect(server.address) as client:
        monkeypatch.setattr(EndOfServers, "servers", [server])
        remote = client.vector_env()
        remote.reset(seed=0)
        with pytest.raises(flockstep.client.ServerError, match=r"stop\(\) was called by an operation of a client"):
            remote.step(remote.action_space.sample())
        client.ping()


def test_a_task_can_drop_its_server(monkeypatch):
    envs = flockstep.DroneVectorEnv(1, worlds="train", task=EndOfServers)
    monkeypatch.setattr(EndOfServers, "servers", [flockstep.serve(envs, port=0)])
    client = flockstep.connect(EndOfServers.servers[0].address)
    remote = client.vector_env()
    remote.reset(seed=0)
    with contextlib.suppress(ConnectionError, flockstep.client.ServerError):
        remote.step(remote.action_space.sample())
        while True:  # until the server has stopped
            client.ping()
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        with contextlib.suppress(ValueError):  # another server serves the batch
            flockstep.serve(envs, port=0).stop()
            return
        time.sleep(0.01)
    pytest.fail("the batch is still shared")


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_child_process_can_drop_the_server(batch):
    server = flockstep.serve(batch, port=0)
    pid = os.fork()
    if pid == 0:
        server.stop()
        del server
        os._exit(0)
    assert os.waitpid(pid, 0) == (pid, 0)
    with flockstep.connect(server.address) as client:
        client.ping()
    server.stop()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_child_process_can_drop_a_client(server):
    client = flockstep.connect(server.address)
    pid = os.fork()
    if pid == 0:
        del client
        os._exit(0)
    assert os.waitpid(pid, 0) == (pid, 0)
    client.ping()
    client.close()


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
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    started = time.monotonic()
    try:
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
        refused = (
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
        )
        for ask in refused:
            with pytest.raises(flockstep.client.ServerError, match="drone 1 is claimed by client") as refusal:
                ask()
            assert refusal.value.code == "PERMISSION_DENIED"
        other.drone(0).set_location([1.0, 0.5, 1.5], teleport=True)
        other.drone(1).get_location()
        other.step()
        owner.release([1])
        other.drone(1).set_location([1.0, 0.0, 1.0], teleport=True)
        owner.claim([2])
        owner.close()
        deadline = time.monotonic() + 10
        while other.get_drones()[2].owner and time.monotonic() < deadline:
            time.sleep(0.01)
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
        with (
            flockstep.connect(server.address) as outsider,
            pytest.raises(flockstep.client.ServerError, match="JoinLockstep"),
        ):
            outsider.step()
        assert b.step().step == 1
        thread.join(10)
        assert done == [1]
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
        with pytest.raises(
            flockstep.client.ServerError, match=r"the others waited 0\.3 s \(lockstep_timeout_s\).*JoinLockstep again"
        ):
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
    with pytest.raises(flockstep.client.ServerError, match="steps by itself"):
        client.step()
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


# --- the documents

THESIS = (
    "Ping GetDrones SpawnDrone RemoveDrone GetCameraCaptureMode SetCameraCaptureMode GetFps GetLocation SetLocation "
    "GetCameraData GetRotation SetRotation SetLocationAndRotation GetLidarData GetLidarConfig SetLidarConfig "
    "GetCameraConfig SetCameraConfig GetMoveLineVisible SetMoveLineVisible"
)


def test_the_table_has_every_operation_of_the_thesis():
    text = (ROOT / "docs" / "server.md").read_text()
    table = text.split("<!-- operations -->")[1].split("<!-- end of operations -->")[0]
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.strip().splitlines()[2:]]
    assert {row[0].split(" (")[0] for row in rows} == set(THESIS.split())
    tests = (ROOT / "tests" / "python" / "server" / "test_client_operations.py").read_text()
    for name, call, _, test in rows:
        assert f"def {test.strip('`')}(" in tests, name
        method = re.search(r"\.(\w+)\(", call)[1]
        assert f".{method}(" in tests, name


# --- the command


def run_command(*arguments, **environment):
    return subprocess.Popen(
        [sys.executable, "-m", "flockstep", "serve", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | environment,
    )


def test_the_command_serves_until_ctrl_c():
    with run_command("--port", "0", "--world", "playground/train-1", FLOCKSTEP_TOKEN=SECRET) as process:
        check_command(process)


def check_command(process):
    line = process.stdout.readline()
    address = line.split(" at ")[1].split(";")[0]
    with flockstep.connect(address, token=SECRET) as client:
        assert client.get_drones() == []
        drone = client.spawn_drone()
        assert len(client.get_drones()) == 1
        assert drone.get_lidar_data().ranges.shape == (1, 35)
        assert drone.get_camera_data().image[:2] == b"\xff\xd8"
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    assert "stopped after" in process.stdout.read()


def test_the_command_has_options_for_what_cameras_measure_and_for_moving_objects():
    options = ("--port", "0", "--world", "bench/simple", "--outputs", "rgb", "depth", "--max-bodies", "2")
    with run_command(*options) as process:
        address = process.stdout.readline().split(" at ")[1].split(";")[0]
        with flockstep.connect(address) as client:
            depth = client.spawn_drone().get_camera_data(format="raw", output="depth").image
            assert np.isfinite(depth).any()
            assert client.spawn_bodies(flockstep.BodyConfig(position_m=(5, 5, 1))).tolist() == [0]
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def test_the_command_refuses_in_one_line(server):
    for arguments, text in (
        (["--outputs", "colour"], "outputs"),
        (["--world", "city/seed-0..100"], "worlds: expected at most 10000 worlds"),
        (["--port", str(server.port)], "another server may run there"),
        (["--address", "0.0.0.0"], "token: expected a secret"),
        (["missing.json"], "missing.json"),
        (["--world", "no/such"], "no/such"),
    ):
        process = run_command(*arguments)
        output, _ = process.communicate(timeout=60)
        assert process.returncode != 0
        assert text in output and "Traceback" not in output
