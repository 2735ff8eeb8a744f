"""The client for programs with asyncio."""

from __future__ import annotations

import asyncio
import socket
import time
from os import PathLike
from typing import TYPE_CHECKING, TypeVar

from flockstep.client.address import Address, ended, parse_address
from flockstep.client.call import Call, Subscription, hello, unsubscription
from flockstep.client.drones import AsyncDrone
from flockstep.client.forms import Awaits
from flockstep.client.frames import Arrays, decode, encode
from flockstep.client.operations import Operations
from flockstep.client.protocol import Reply
from flockstep.client.session import Session
from flockstep.client.streams import AsyncStream
from flockstep.client.sync_client import RETRY_S, connection_error

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

T = TypeVar("T")

_FLUSH_S = 1.0  # for what close() still has to send


async def connect_async(
    address: str = "127.0.0.1",
    *,
    token: str = "",
    timeout_s: float = 60.0,
    retry_s: float = 0.0,
    ca_file: str | PathLike[str] | None = None,
    check_hostname: bool = True,
) -> AsyncClient:
    """Connect to a server, with asyncio. Parameters and errors are those of `connect`.

    Returns
    -------
    client
        An `AsyncClient`. Its `close`, or leaving an ``async with`` block, ends the connection.
    """
    client = AsyncClient(parse_address(address, ca_file, check_hostname), token, timeout_s)
    await client.reconnect(retry_s=retry_s)
    return client


class AsyncClient(Operations[AsyncDrone], Awaits):
    """A connection to a server, for asyncio; `connect_async` makes it. Several operations may wait at the same time.

    The server executes the operations in the order in which they were called.

    Attributes
    ----------
    info
        `ServerInfo`: the server and its batch, as they were when the client connected.
    """

    def __init__(self, address: Address, token: str, timeout_s: float) -> None:
        if not timeout_s > 0:
            raise ValueError(f"timeout_s: expected a number above 0, got {timeout_s!r}")
        self._address = address
        self._token = token
        self._timeout_s = timeout_s
        self._connection = _Connection(address)
        self._connection.session.end("this client is not connected")

    def __repr__(self) -> str:
        reason = self._connection.session.reason
        return f"<AsyncClient of {self._address.text}{'' if reason is None else f': {reason}'}>"

    async def reconnect(self, *, retry_s: float = 0.0) -> None:
        """Connect again, as `Client.reconnect` does."""
        end = time.monotonic() + retry_s
        while True:
            self._connection.close()
            try:
                self._connection = await self._open()
                self.info = await self._call(hello(self._token))
            except BaseException as error:
                self._connection.close()
                if not isinstance(error, ConnectionError) or time.monotonic() >= end:
                    raise
            else:
                return
            await asyncio.sleep(RETRY_S)

    async def close(self) -> None:
        """End the connection: claims and streams end. `reconnect` begins another one."""
        connection = self._connection
        connection.close()
        try:
            await asyncio.wait_for(connection.closed.wait(), _FLUSH_S)
        except asyncio.TimeoutError:  # the server does not read
            connection.abort()
            await connection.closed.wait()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        await self.close()

    async def _open(self) -> _Connection:
        """Return a connection after the handshake."""
        loop, address = asyncio.get_running_loop(), self._address
        connection = _Connection(address)
        try:
            if address.path:
                opening = loop.create_unix_connection(lambda: connection, address.path)
            else:
                opening = loop.create_connection(
                    lambda: connection,
                    address.host,
                    address.port,
                    ssl=address.tls,
                    server_hostname=address.server_name,
                )
            await asyncio.wait_for(opening, self._timeout_s)
            await asyncio.wait_for(connection.opened.wait(), self._timeout_s)
        except asyncio.TimeoutError:
            connection.close()
            raise TimeoutError(f"no answer from {address.text}: {address.advice()}") from None
        except OSError as error:
            raise connection_error(address, error) from error
        except BaseException:
            connection.close()
            raise
        connection.require_open()
        return connection

    async def _call(self, call: Call[T]) -> T:
        connection = self._connection
        inbox = connection.send(call, call.operation)
        try:
            if not connection.is_writable.is_set():
                try:
                    await asyncio.wait_for(connection.is_writable.wait(), self._timeout_s)
                except asyncio.TimeoutError:
                    raise connection.late(call.operation, self._timeout_s) from None
            reply, arrays = await inbox.take(self._timeout_s)
        finally:
            connection.inboxes.pop(inbox.request_id, None)
        return call.answer(reply, arrays)

    def _handle(self, index: int, env: int | None = None, owner: int | None = None) -> AsyncDrone:
        return AsyncDrone(self, index, env, owner)

    def _subscribe(self, subscription: Subscription[T]) -> AsyncStream[T]:
        call, subscribed = subscription.call, subscription.request()
        connection = self._connection
        inbox = connection.send(subscribed, call.operation)

        async def receive(timeout_s: float | None) -> T:
            reply, arrays = await inbox.take(timeout_s)
            if reply.WhichOneof("result") == "error":
                connection.inboxes.pop(inbox.request_id, None)
                inbox.end()
            return subscribed.answer(reply, arrays)

        async def close() -> None:
            is_over = connection.inboxes.pop(inbox.request_id, None) is None or connection.session.reason is not None
            inbox.end()
            if not is_over:
                await self._call(unsubscription(inbox.request_id))

        return AsyncStream(receive, close)


class _Connection(asyncio.BufferedProtocol):
    """The connection's end of a transport, and the requests that wait for a reply."""

    def __init__(self, address: Address) -> None:
        self.session = Session(address.uri)
        self.inboxes: dict[int, _Inbox] = {}
        self.opened = asyncio.Event()  # also if the handshake fails
        self.closed = asyncio.Event()
        self.closed.set()
        self.is_writable = asyncio.Event()
        self.is_writable.set()
        self._address = address
        self._transport: asyncio.Transport | None = None
        self._closing: asyncio.Transport | None = None  # what close() closes
        self._last_id = 0

    def require_open(self) -> None:
        """Raise ConnectionError if the connection has ended."""
        reason = self.session.reason
        if reason is not None:
            raise ConnectionError(ended(self._address, reason))

    def send(self, call: Call[T], operation: str) -> _Inbox:
        """Send a request and return the inbox of its replies. Errors name the operation."""
        self.require_open()
        assert self._transport is not None
        self._last_id += 1
        call.request.id = self._last_id
        message = encode(call.request, call.arrays)
        inbox = self.inboxes[self._last_id] = _Inbox(self, self._last_id, operation)
        self._transport.write(self.session.frame(message))
        return inbox

    def close(self) -> None:
        """Say goodbye and close the transport, as soon as everything is sent."""
        transport, self._transport = self._transport, None
        self._closing = transport or self._closing
        if self.session.reason is None:
            self.session.close()
            if transport is not None and not transport.is_closing():
                transport.write(self.session.to_send())
        self._end("this client is closed")
        if transport is not None:
            transport.close()

    def abort(self) -> None:
        """Close the transport now."""
        if self._closing is not None:
            self._closing.abort()

    def late(self, operation: str, timeout_s: float) -> TimeoutError:
        """Return the error for a reply that did not come in time."""
        return TimeoutError(f"{operation}: no reply from {self._address.text} within {timeout_s:g} s")

    def _end(self, reason: str) -> None:
        self.session.end(reason)
        self.opened.set()
        self.is_writable.set()
        for inbox in self.inboxes.values():
            inbox.end()
        self.inboxes.clear()

    # --- called by asyncio

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.closed.clear()
        connected = transport.get_extra_info("socket")
        if not self._address.path:
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._transport = transport
        transport.write(self.session.to_send())

    def get_buffer(self, sizehint: int) -> memoryview:
        return self.session.space()

    def buffer_updated(self, nbytes: int) -> None:
        session = self.session
        for message in session.received(nbytes):
            try:
                reply, arrays = decode(message)
            except ConnectionError as error:
                session.end(str(error).removeprefix("the server "))
                break
            inbox = self.inboxes.get(reply.id)
            if inbox is not None:  # otherwise the reply is late, or of a closed stream
                inbox.put(reply, arrays)
        if session.has_to_send and self._transport is not None:
            self._transport.write(session.to_send())
        if session.is_open:
            self.opened.set()
        elif session.reason is not None:
            self._end(session.reason)
            if self._transport is not None:
                self._transport.close()

    def connection_lost(self, error: Exception | None) -> None:
        self.closed.set()
        if error is None:
            self.session.received(0)
        self._end(f"is gone: {error or 'it closed the connection without a reason'}")

    def pause_writing(self) -> None:
        self.is_writable.clear()

    def resume_writing(self) -> None:
        self.is_writable.set()


class _Inbox:
    """Place for the reply to a request. In a stream, a later reply replaces one that has not been taken."""

    def __init__(self, connection: _Connection, request_id: int, operation: str) -> None:
        self.request_id = request_id
        self._connection = connection
        self._operation = operation
        self._content: tuple[Reply, Arrays] | None = None
        self._waiter: asyncio.Future[None] | None = None
        self._is_over = False

    def put(self, reply: Reply, arrays: Arrays) -> None:
        """Keep a reply."""
        self._content = reply, arrays
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def end(self) -> None:
        """Note that nothing more will come."""
        self._is_over = True
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    async def take(self, timeout_s: float | None) -> tuple[Reply, Arrays]:
        """Wait for a reply and return it."""
        if self._content is None and not self._is_over:
            await self._wait(timeout_s)
        if self._content is None:
            self._connection.require_open()
            raise ConnectionError("the stream has ended")
        content, self._content = self._content, None
        return content

    async def _wait(self, timeout_s: float | None) -> None:
        if self._waiter is not None:
            raise RuntimeError("another task already waits for this stream")
        loop = asyncio.get_running_loop()
        waiter = self._waiter = loop.create_future()

        def stop() -> None:
            if not waiter.done():
                assert timeout_s is not None
                waiter.set_exception(self._connection.late(self._operation, timeout_s))

        timer = None if timeout_s is None else loop.call_later(timeout_s, stop)
        try:
            await waiter
        finally:
            self._waiter = None
            if timer is not None:
                timer.cancel()
