"""The server: what clients may do and when, and faults of clients and of the network."""

import contextlib
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from clients import Raw, eventually
from conftest import ROOT
from messages import refused
from websockets.exceptions import ConnectionClosed

import flockstep
from flockstep.client import ServerError
from flockstep.client import protocol as pb
from flockstep.client.frames import encode
from flockstep.client.protocol import Hello, Ping, Request

CERTIFICATES = Path(__file__).parent / "certificates"
SECRET = "a-secret"


@pytest.fixture
def batch():
    return flockstep.Batch("playground/train-1", 4, drones_per_env=4, lidar=flockstep.LidarConfig(beams=5))


# --- addresses


def test_an_address_of_the_network_needs_a_token(batch):
    with refused(ValueError, "token"):
        flockstep.serve(batch, address="0.0.0.0", port=0)
    server = flockstep.serve(batch, address="0.0.0.0", port=0, token=SECRET)
    with server, flockstep.connect(f"127.0.0.1:{server.port}", token=SECRET) as client:
        client.ping()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"address": "nowhere.example"}, ("address", "unix:PATH")),
        ({"address": "unix:"}, ("address", "unix:PATH")),
        ({"port": 65536}, ("port", 0, 65535)),
        ({"certificate_file": "a.pem"}, ("private_key_file",)),
        ({"rate_hz": float("nan")}, ("rate_hz",)),
        ({"rate_hz": 1e-300}, ("rate_hz", 1e-06, 10000, 1e-300)),
        ({"max_clients": 0}, ("max_clients", 0)),
        ({"token": " "}, ("token", "spaces")),
        ({"lockstep_timeout_s": 0}, ("lockstep_timeout_s", 0)),
        ({"tokn": "x"}, ("tokn", "token")),
    ],
)
def test_bad_configurations_are_refused(batch, fields, said):
    with refused((ValueError, TypeError), *said):
        flockstep.serve(batch, **{"port": 0} | fields)
    batch.sense()  # the batch is not shared afterwards


def test_a_port_that_is_taken_says_so(server):
    with refused(RuntimeError, "port", server.port):
        flockstep.serve(flockstep.Batch("playground/train-1", 1), port=server.port)


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
        with refused(ConnectionError, "certificate"):
            flockstep.connect(url, ca_file=CERTIFICATES / "other.crt")
        with pytest.raises(ConnectionError):
            flockstep.connect(server.address, timeout_s=5)
        with flockstep.connect(url, ca_file=CERTIFICATES / "server.crt") as client:
            client.ping()


def test_files_of_tls_that_cannot_be_read_are_named(batch, tmp_path):
    (tmp_path / "bad.pem").write_text("no certificate")
    with refused(RuntimeError, "certificate_file, private_key_file", "cannot be used"):
        flockstep.serve(batch, port=0, certificate_file=str(tmp_path / "bad.pem"), private_key_file="missing.pem")


# --- Hello


@pytest.mark.parametrize("token", ["", "b-secret", SECRET[:-1], SECRET + "x"])
def test_a_wrong_token_is_refused(batch, token):
    with flockstep.serve(batch, port=0, token=SECRET) as server:
        with refused(ServerError, "token") as refusal:
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


def test_what_newer_clients_send(server):
    with Raw(server) as raw:
        raw.send_header(Request(id=2, ping=Ping()).SerializeToString() + bytes([0xF8, 0x3F, 7]))  # field 1023, varint 7
        assert raw.reply().HasField("done")
        raw.send_header(bytes([0x08, 5, 0xFA, 0x3F, 0]))  # id 5; field 1023, an empty message: an unknown operation
        reply = raw.reply()
        assert reply.id == 5 and reply.error.code == pb.Code.UNIMPLEMENTED
        assert raw.ask(Request(id=6, ping=Ping())).HasField("done")


def upgraded(server, *fields):
    """Return a connection that has asked for a WebSocket, with further fields."""
    lines = [
        "GET / HTTP/1.1",
        f"Host: {server.address}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        *fields,
    ]
    connected = socket.create_connection(("127.0.0.1", server.port), timeout=10)
    connected.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
    return connected


def upgrade(server, *fields):
    """Return the first line of the answer to a request for a WebSocket."""
    with upgraded(server, *fields) as connected:
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
        with refused(ServerError, "token"):
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
    limited = ["sh", "-c", 'ulimit -n 64; exec "$@"', "sh"]
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(run_command("--world", "playground/train-1", before=limited))
        stack.callback(process.terminate)
        host, port = (address := address_of(process)).split(":")
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
            time.sleep(1.5)
            assert peak_kib() - before < 20 * size_kib


# --- broken connections


def test_clients_that_die_in_a_request_leave_nothing_behind(server, client):
    for i in range(50):
        with Raw(server) as raw:
            raw.send(encode(Request(id=2, get_arrays=pb.GetArrays(names=["position"])), {})[: 4 + i % 20])
    eventually(lambda: server.num_clients == 1)
    client.ping()


def test_a_half_open_connection_is_closed(batch):
    with flockstep.serve(batch, port=0, idle_timeout_s=0.5) as server:
        with upgraded(server) as silent:
            while silent.recv(4096):  # the handshake, a ping, then the end
                pass
        eventually(lambda: server.num_clients == 0)


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


def test_stop_tells_clients_and_a_new_server_takes_the_port(batch, connect):
    server = flockstep.serve(batch, port=0)
    port = server.port
    with connect(server.address) as client:
        server.stop()
        server.stop()
        time.sleep(0.2)
        with refused(ConnectionError, "the server stops"):
            client.ping()
        with flockstep.serve(batch, port=port):
            client.reconnect(retry_s=5)
            client.ping()


# --- the documents

THESIS = (
    "Ping GetDrones SpawnDrone RemoveDrone GetCameraCaptureMode SetCameraCaptureMode GetFps GetLocation SetLocation "
    "GetCameraData GetRotation SetRotation SetLocationAndRotation GetLidarData GetLidarConfig SetLidarConfig "
    "GetCameraConfig SetCameraConfig GetMoveLineVisible SetMoveLineVisible"
)


def test_the_table_has_every_operation_of_the_thesis():
    text = (ROOT / "docs" / "how-to" / "connect" / "server.md").read_text()
    table = text.split("<!-- operations -->")[1].split("<!-- end of operations -->")[0]
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.strip().splitlines()[2:]]
    assert {row[0].split(" (")[0] for row in rows} == set(THESIS.split())
    tests = (ROOT / "tests" / "python" / "server" / "test_client_operations.py").read_text()
    for name, call in rows:
        method = re.search(r"\.(\w+)\(", call)[1]
        assert f".{method}(" in tests, name


# --- the command


def run_command(*arguments, before=(), **environment):
    command = [*before, sys.executable, "-m", "flockstep", "serve", "--port", "0", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, **pipes, env=os.environ | environment)


def address_of(process):
    return process.stdout.readline().split(" at ")[1].split(";")[0]


def test_the_command_serves_until_ctrl_c():
    options = ("--world", "playground/train-1", "--outputs", "rgb", "depth", "--max-bodies", "2")
    with run_command(*options, FLOCKSTEP_TOKEN=SECRET) as process:
        with flockstep.connect(address_of(process), token=SECRET) as client:
            assert client.get_drones() == []
            drone = client.spawn_drone()
            assert len(client.get_drones()) == 1
            assert drone.get_lidar_data().ranges.shape == (1, 35)
            assert drone.get_camera_data().image[:2] == b"\xff\xd8"
            assert np.isfinite(drone.get_camera_data(format="raw", output="depth").image).any()
            assert client.spawn_bodies(flockstep.BodyConfig(position_m=(5, 5, 1))).tolist() == [0]
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        assert "stopped after" in process.stdout.read()


def test_the_command_refuses_in_one_line():
    """The refusals of the server itself are tested above."""
    for arguments, text in ((["--outputs", "colour"], "outputs"), (["missing.json"], "missing.json")):
        with run_command(*arguments) as process:
            output, _ = process.communicate(timeout=60)
        assert process.returncode != 0
        assert text in output and "Traceback" not in output
