"""The client for programs without asyncio."""

from __future__ import annotations

import os
import select
import socket
import ssl
import threading
import time
import weakref
from contextlib import suppress
from os import PathLike
from typing import TYPE_CHECKING, TypeVar

from flockstep.client.address import Address, ended, parse_address
from flockstep.client.call import Call, Subscription, hello, unsubscription
from flockstep.client.frames import Arrays, decode, encode
from flockstep.client.operations import BlockingOperations
from flockstep.client.protocol import Reply
from flockstep.client.session import Session
from flockstep.client.streams import Stream
from flockstep.client.vector_env import RemoteVectorEnv

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

T = TypeVar("T")

_ATTEND_S = 2.0  # how often a client that its program does not use answers the server's pings
RETRY_S = 0.1
_WOULD_BLOCK = (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


def connect(
    address: str = "127.0.0.1",
    *,
    token: str = "",
    timeout_s: float = 60.0,
    retry_s: float = 0.0,
    ca_file: str | PathLike[str] | None = None,
    check_hostname: bool = True,
) -> Client:
    """Connect to a server.

    Parameters
    ----------
    address
        ``"HOST:PORT"``, ``"ws://HOST:PORT"``, ``"wss://HOST:PORT"`` for TLS, or ``"unix:PATH"``. Default port: 41451.
    token
        Secret that the server requires, if it was started with one.
    timeout_s
        Maximum time for connecting and for each reply in s. After that, `TimeoutError` is raised.
    retry_s
        Wait for this long for a server that does not listen yet, in s.
    ca_file
        PEM file with the certificates to trust, for a ``wss://`` address. Default: those of the system.
    check_hostname
        Require that the certificate names the address's host.

    Returns
    -------
    client
        A `Client`. Its `close`, or leaving a ``with`` block, ends the connection.

    Raises
    ------
    ConnectionError
        There is no server, or it is no flockstep server, or its certificate is not trusted.
    ServerError
        The server refuses the client: ``"UNAUTHENTICATED"`` for a wrong token, ``"RESOURCE_EXHAUSTED"`` if it has its
        maximum of clients, ``"FAILED_PRECONDITION"`` if it has another version of the protocol.
    TimeoutError
        The server does not answer.
    ValueError
        The address is not valid.
    """
    client = Client(parse_address(address, ca_file, check_hostname), token, timeout_s)
    client.reconnect(retry_s=retry_s)
    return client


class _Slot:
    """Place for the reply to a request. In a stream, a later reply replaces one that has not been taken."""

    __slots__ = ("content",)

    def __init__(self) -> None:
        self.content: tuple[Reply, Arrays] | None = None


class Client(BlockingOperations):
    """A connection to a server; `connect` makes it. Threads may share it.

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
        # One lock for socket, session and slots. Only the thread that has set _is_reading waits for the socket, without
        # the lock; the others wait for the condition.
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._is_reading = False
        self._session = Session(address.uri)
        self._session.end("this client is not connected")
        self._socket: socket.socket | None = None
        self._readiness: _Readiness
        self._num_waiting = 0  # threads that wait for the condition
        self._slots: dict[int, _Slot] = {}
        self._last_id = 0
        self._process = os.getpid()
        self._closed = threading.Event()
        threading.Thread(
            target=_attend, args=(weakref.ref(self), self._closed), name="flockstep client", daemon=True
        ).start()

    def __repr__(self) -> str:
        reason = self._session.reason
        return f"<Client of {self._address.text}{'' if reason is None else f': {reason}'}>"

    def reconnect(self, *, retry_s: float = 0.0) -> None:
        """Connect again, for instance to a server that was restarted. Earlier claims and streams have ended.

        Parameters
        ----------
        retry_s
            Wait for this long for a server that does not listen yet, in s.

        Raises
        ------
        ConnectionError, ServerError, TimeoutError
            As for `connect`.
        """
        end = time.monotonic() + retry_s
        while True:
            self._disconnect()
            try:
                self._open()
                self.info = self._call(hello(self._token))
            except BaseException as error:
                self._disconnect()
                if not isinstance(error, ConnectionError) or time.monotonic() >= end:
                    raise
            else:
                return
            time.sleep(RETRY_S)

    def close(self) -> None:
        """End the connection: claims and streams end. `reconnect` begins another one."""
        self._disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        # A child of fork() has a copy of the connection; its goodbye would end the connection of the parent.
        if hasattr(self, "_closed") and self._process == os.getpid():
            self._closed.set()
            self._disconnect()

    def vector_env(self, *, reward_scale: float = 1.0) -> RemoteVectorEnv:
        """Return the envs of the server's batch, which must have a task, as a Gymnasium vector environment.

        Parameters
        ----------
        reward_scale
            The env returns the rewards multiplied by this.
        """
        return RemoteVectorEnv(self, reward_scale=reward_scale)

    # --- calls

    def _call(self, call: Call[T]) -> T:
        slot = _Slot()
        with self._lock:
            request_id = self._send(call, slot)
            try:
                reply, arrays = self._wait(slot, request_id, self._timeout_s, call)
            finally:
                self._slots.pop(request_id, None)
        return call.answer(reply, arrays)

    def _subscribe(self, subscription: Subscription[T]) -> Stream[T]:
        call, subscribed = subscription.call, subscription.request()
        slot = _Slot()
        with self._lock:
            stream_id = self._send(subscribed, slot)
        session = self._session

        def receive(timeout_s: float | None) -> T:
            with self._lock:
                if session is not self._session:
                    raise ConnectionError("the stream has ended: the client has connected again")
                while not self._is_reading and session.reason is None and self._receive():
                    pass  # the newest value may still be in the socket
                reply, arrays = self._wait(slot, stream_id, timeout_s, call)
                if reply.WhichOneof("result") == "error":
                    self._slots.pop(stream_id, None)
            return subscribed.answer(reply, arrays)

        def close() -> None:
            with self._lock:
                is_over = self._slots.pop(stream_id, None) is None or self._session.reason is not None
            if not is_over:
                self._call(unsubscription(stream_id))

        return Stream(receive, close)

    # --- the connection. What follows needs the lock, except _open and _disconnect.

    def _open(self) -> None:
        """Connect the socket and shake hands."""
        end = time.monotonic() + self._timeout_s
        connected = open_socket(self._address, self._timeout_s)
        connected.setblocking(False)
        with self._lock:
            self._socket, self._session = connected, Session(self._address.uri)
            self._readiness = _Readiness(connected)
            self._write(self._session.to_send())
            while not self._session.is_open:
                self._require_session()
                if not self._read(end - time.monotonic()):
                    raise TimeoutError(
                        f"the server at {self._address.text} did not answer within {self._timeout_s:g} s"
                    )

    def _disconnect(self) -> None:
        """Say goodbye, if there is a connection, and close the socket."""
        with self._lock:
            if self._socket is not None and self._session.reason is None:
                self._session.close()
                with suppress(OSError):  # also if it would block: the end of the socket says the same
                    self._socket.send(self._session.to_send())
            self._session.end("this client is closed")
            self._slots.clear()
            if self._socket is not None:
                if self._is_reading:  # wakes the thread that waits for the socket
                    with suppress(OSError):
                        self._socket.shutdown(socket.SHUT_RDWR)
                    self._num_waiting += 1
                    self._changed.wait_for(lambda: not self._is_reading)
                    self._num_waiting -= 1
                self._socket.close()
                self._socket = None
            self._changed.notify_all()

    def _require_session(self) -> None:
        reason = self._session.reason
        if reason is not None:
            raise ConnectionError(ended(self._address, reason))

    def _send(self, call: Call[T], slot: _Slot) -> int:
        """Send a request and return its id, under which the reply gets into the slot."""
        self._require_session()
        self._last_id += 1
        call.request.id = self._last_id
        message = encode(call.request, call.arrays)
        self._slots[self._last_id] = slot
        self._write(self._session.frame(message))
        return self._last_id

    def _wait(self, slot: _Slot, request_id: int, timeout_s: float | None, call: Call[T]) -> tuple[Reply, Arrays]:
        end = None if timeout_s is None else time.monotonic() + timeout_s
        while slot.content is None:
            self._require_session()
            if request_id not in self._slots:
                raise ConnectionError("the stream has ended")
            rest = None if end is None else end - time.monotonic()
            if rest is not None and rest <= 0:
                raise TimeoutError(f"{call.operation}: no reply from {self._address.text} within {timeout_s:g} s")
            if self._is_reading:
                self._num_waiting += 1
                try:
                    self._changed.wait(rest)
                finally:
                    self._num_waiting -= 1
            else:
                self._read(rest)
        content, slot.content = slot.content, None
        return content

    def _read(self, timeout_s: float | None) -> bool:
        """Wait for the socket without the lock, then read. Returns False if nothing came."""
        readiness, session = self._readiness, self._session
        self._is_reading = True
        self._lock.release()
        try:
            is_ready = readiness.wait(timeout_s)
        finally:
            self._lock.acquire()
            self._is_reading = False
            if self._num_waiting:
                self._changed.notify_all()
        if is_ready and session is self._session and session.reason is None:
            self._receive()
        return is_ready

    def _receive(self) -> bool:
        """Read what has come, without waiting. Returns False if there is nothing more."""
        connected, session = self._socket, self._session
        assert connected is not None
        is_more = True
        while is_more:
            space = session.space()
            try:
                size = connected.recv_into(space)
            except _WOULD_BLOCK:
                return False
            except OSError as error:
                session.end(f"is gone: {error}")
                return False
            messages = session.received(size)
            for message in messages:
                self._deliver(message)
            if session.has_to_send:
                self._write(session.to_send())
            if session.reason is not None:
                return False
            # TLS may hold more than the socket, and then nothing wakes the thread that waits for the socket.
            is_more = size == len(space) or self._address.tls is not None
            if messages and self._address.tls is None:
                return is_more
        return False

    def _deliver(self, message: bytes | bytearray | memoryview) -> None:
        try:
            reply, arrays = decode(message)
        except ConnectionError as error:
            self._session.end(str(error).removeprefix("the server "))
            return
        slot = self._slots.get(reply.id)
        if slot is not None:  # otherwise the reply is late, or of a closed stream
            slot.content = reply, arrays

    def _write(self, data: bytes) -> None:
        """Send everything, and wait if the socket is full."""
        connected = self._socket
        assert connected is not None
        rest = memoryview(data)
        try:
            while rest:
                try:
                    rest = rest[connected.send(rest) :]
                except _WOULD_BLOCK as error:
                    to_write = not isinstance(error, ssl.SSLWantReadError)
                    if not self._readiness.wait(self._timeout_s, to_write=to_write):
                        self._session.end(f"does not read: a request took longer than {self._timeout_s:g} s")
                        self._require_session()
                except OSError as error:
                    while self._session.reason is None and self._receive():
                        pass  # the server may have sent a reason
                    self._session.end(f"is gone: {error}")
                    return
        except KeyboardInterrupt:
            self._session.end("this client was interrupted within a request")  # the server waits for the rest of it
            raise


def _attend(owner: weakref.ref[Client], closed: threading.Event) -> None:
    """Read what comes for a client that its program does not use for a while, and answer the server's pings."""
    while not closed.wait(_ATTEND_S):
        client = owner()
        if client is None:
            return
        with client._lock, suppress(ConnectionError):
            if client._socket is not None and client._session.is_open and not client._is_reading:
                while client._receive():
                    pass
        del client


class _Readiness:
    """Waits until a socket can be read or written. Only one thread may wait to read."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._reading = self._poll(select.POLLIN) if hasattr(select, "poll") else None

    def wait(self, timeout_s: float | None, *, to_write: bool = False) -> bool:
        """Wait. Returns False if it takes longer than ``timeout_s``."""
        if timeout_s is not None and timeout_s < 0.0:
            timeout_s = 0.0
        if self._reading is not None:
            poll = self._poll(select.POLLOUT) if to_write else self._reading
            return bool(poll.poll(None if timeout_s is None else 1000.0 * timeout_s))
        sockets = [self._socket]
        return any(select.select([] if to_write else sockets, sockets if to_write else [], [], timeout_s))  # Windows

    def _poll(self, events: int) -> select.poll:
        poll = select.poll()
        poll.register(self._socket, events)
        return poll


def open_socket(address: Address, timeout_s: float) -> socket.socket:
    """Return a connected socket, after the handshake of TLS if the address asks for it."""
    try:
        if address.path:
            connected = socket.socket(socket.AF_UNIX)
            connected.settimeout(timeout_s)
            try:
                connected.connect(address.path)
            except BaseException:
                connected.close()
                raise
            return connected
        connected = socket.create_connection((address.host, address.port), timeout_s)
    except OSError as error:
        raise connection_error(address, error) from error
    try:
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if address.tls is not None:
            return address.tls.wrap_socket(connected, server_hostname=address.server_name)
        return connected
    except OSError as error:
        connected.close()
        raise connection_error(address, error) from error
    except BaseException:
        connected.close()
        raise


def connection_error(address: Address, error: OSError) -> OSError:
    """Return what to raise if a connection could not be made."""
    if isinstance(error, ssl.SSLCertVerificationError):
        advice = "" if error.verify_code == 62 else "; pass ca_file to connect()"  # 62: another host name
        return ConnectionError(
            f"the certificate of the server at {address.text} is not trusted: {error.verify_message}{advice}"
        )
    if isinstance(error, (ssl.SSLError, ConnectionResetError)) and address.tls is not None:
        return ConnectionError(f"the server at {address.text} does not speak TLS: {error}; is it a ws:// address?")
    if isinstance(error, socket.gaierror):
        return ConnectionError(f"no host {address.host!r}: {error.strerror}")
    if isinstance(error, TimeoutError):
        return TimeoutError(f"no answer from {address.text}: {address.advice()}")
    return ConnectionError(f"{address.advice()} ({os.strerror(error.errno) if error.errno else error})")
