"""A server whose answers a test writes: for what the real one never does, or does too seldom."""

from __future__ import annotations

import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame
from websockets.server import ServerProtocol
from websockets.sync.server import ServerConnection, serve, unix_serve

from flockstep.client import protocol as pb
from flockstep.client.frames import encode

WELCOME = pb.Reply(
    welcome=pb.Welcome(protocol=2, version="0.0.0", client=7, num_envs=2, drones_per_env=3, lidars=["a"])
)


def message(reply: Any, **arrays: np.ndarray) -> bytes:
    """Return the bytes of a reply."""
    filled = pb.Reply()
    filled.CopyFrom(reply)
    return encode(filled, arrays)


class Script:
    """One connection of a client: what it sent, and functions to answer."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection

    def receive(self) -> Any:
        """Return the next request."""
        data = self.connection.recv()
        size = int.from_bytes(data[:4], "little")
        self.values = data[4 + size :]
        return pb.Request.FromString(data[4 : 4 + size])

    def send(self, request_id: int, reply: Any, **arrays: np.ndarray) -> None:
        filled = pb.Reply()
        filled.CopyFrom(reply)
        filled.id = request_id
        self.connection.send(encode(filled, arrays))

    def answer(self, reply: Any, **arrays: np.ndarray) -> Any:
        """Answer the next request, and return it."""
        request = self.receive()
        self.send(request.id, reply, **arrays)
        return request

    def wait_for_close(self) -> None:
        with pytest.raises(ConnectionClosed):
            self.receive()


@contextmanager
def serving(
    script: Callable[[Script], None], path: Path | None = None, tls: ssl.SSLContext | None = None, port: int = 0
) -> Iterator[str]:
    """Run a script for each client, and yield the server's address. A script's failure fails the test."""
    failures: list[BaseException] = []

    def handle(connection: ServerConnection) -> None:
        try:
            script(Script(connection))
        except ConnectionClosed:
            pass
        except BaseException as error:
            failures.append(error)

    options: dict[str, Any] = {"max_size": None, "compression": None}
    server = (
        serve(handle, "127.0.0.1", port, ssl=tls, **options)
        if path is None
        else unix_serve(handle, str(path), **options)
    )
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"unix:{path}" if path else f"127.0.0.1:{server.socket.getsockname()[1]}"
    finally:
        server.shutdown()
        thread.join()
    if failures:
        raise failures[0]


def greeted(script: Callable[[Script], object] = lambda _: None) -> Callable[[Script], None]:
    """Return a script that welcomes the client, then does this, and then waits until the connection is closed."""

    def whole(s: Script) -> None:
        s.answer(WELCOME)
        script(s)
        s.wait_for_close()

    return whole


@contextmanager
def serving_hello_only() -> Iterator[str]:
    """Answer the Hello of one client, and then read nothing more from its socket. Yields the server's address."""
    is_over = threading.Event()

    def greet() -> None:
        connected, _ = listener.accept()
        protocol, is_greeted = ServerProtocol(), False
        while not is_greeted:
            protocol.receive_data(connected.recv(65536))
            for event in protocol.events_received():
                if isinstance(event, Frame):
                    reply = pb.Reply(id=1)
                    reply.MergeFrom(WELCOME)
                    protocol.send_binary(encode(reply, {}))
                    is_greeted = True
                else:
                    protocol.send_response(protocol.accept(event))
            for data in protocol.data_to_send():
                connected.sendall(data)
        is_over.wait()
        connected.close()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=greet)
        thread.start()
        try:
            yield f"127.0.0.1:{listener.getsockname()[1]}"
        finally:
            is_over.set()
            thread.join()


def certificate(folder: Path, host: str) -> tuple[Path, Path]:
    """Return the files of a new certificate of a host and of its key."""
    files = folder / "certificate.pem", folder / "key.pem"
    kind = "IP" if host[0].isdigit() else "DNS"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-days", "2", "-subj", f"/CN={host}", "-addext", f"subjectAltName={kind}:{host}"]
    subprocess.run([*command, "-out", str(files[0]), "-keyout", str(files[1])], check=True, capture_output=True)
    return files
