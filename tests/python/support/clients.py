"""Clients for tests: one that sends any bytes, the asyncio client as an ordinary one, and helpers with threads."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import flockstep
from flockstep.client import AsyncClient, AsyncDrone, AsyncStream
from flockstep.client import protocol as pb
from flockstep.client.frames import decode, encode


class Raw:
    """A connection that sends any bytes."""

    def __init__(self, server: flockstep.Server, hello: bool = True) -> None:
        self.stack = contextlib.ExitStack()
        opened = connect(f"ws://{server.address}/", compression=None, max_size=None, max_queue=1, proxy=None)
        self.socket = self.stack.enter_context(opened)
        if hello:
            assert self.ask(pb.Request(id=1, hello=pb.Hello(protocol=2))).welcome.protocol == 2

    def ask(self, request: Any, **arrays: Any) -> Any:
        self.socket.send(encode(request, arrays))
        return self.reply()

    def reply(self, timeout: float = 10) -> Any:
        return decode(self.socket.recv(timeout))[0]

    def send(self, data: bytes) -> None:
        self.socket.send(data)

    def send_header(self, header: bytes) -> None:
        """Send a message without arrays."""
        self.send(struct.pack("<I", len(header)) + header)

    def is_closed(self) -> bool:
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            while True:
                self.socket.recv(10)
        return self.socket.close_code is not None

    def __enter__(self) -> Raw:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self.socket.socket.shutdown(socket.SHUT_RDWR)  # without a closing handshake
        self.stack.close()


def in_thread(function: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=function, daemon=True)
    thread.start()
    return thread


@contextlib.contextmanager
def repeated(*functions: Callable[[], object]) -> Iterator[None]:
    """Call each function again and again in a thread of its own."""
    stop = threading.Event()

    def repeat(function: Callable[[], object]) -> None:
        while not stop.is_set():
            function()

    threads = [in_thread(lambda function=function: repeat(function)) for function in functions]
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def eventually(is_so: Callable[[], object], seconds: float = 10) -> None:
    """Wait until something is so, and fail if it takes too long."""
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.005)


class Blocking:
    """An object of the asyncio client, with calls that wait."""

    def __init__(self, loop, client):
        self._loop, self._client = loop, client

    def __getattr__(self, name):
        value = getattr(self._client, name)
        if not callable(value):
            return value

        def call(*args, **keywords):
            result = value(*args, **keywords)
            if asyncio.iscoroutine(result):
                result = self._loop.run_until_complete(result)
            return self._blocking(result)

        return call

    def _blocking(self, result):
        if isinstance(result, list):
            return [self._blocking(item) for item in result]
        is_async = isinstance(result, (AsyncClient, AsyncDrone, AsyncStream))
        return Blocking(self._loop, result) if is_async else result

    def __repr__(self):
        return repr(self._client)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __iter__(self):
        return self

    def __next__(self):
        try:
            return self._loop.run_until_complete(self._client.__anext__())
        except StopAsyncIteration:
            raise StopIteration from None


@contextlib.contextmanager
def served(batch, connect):
    """A client of a server of this batch."""
    with flockstep.serve(batch, port=0) as server, connect(server.address) as client:
        yield client
