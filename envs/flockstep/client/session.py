"""A connection to a server, without its socket: bytes in, bytes out."""

from __future__ import annotations

from websockets.client import ClientProtocol
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

_MAX_MESSAGE_BYTES = 1 << 31  # a server that announces more is not one of ours


class Session:
    """A WebSocket connection as bytes. The owner moves them to and from a socket.

    Attributes
    ----------
    is_open
        True after the handshake and until the connection ends.
    reason
        Reason for the end of the connection, or None while it lasts.
    """

    def __init__(self, uri: str) -> None:
        self._protocol = ClientProtocol(parse_uri(uri), max_size=_MAX_MESSAGE_BYTES)
        self._parts: list[bytes | bytearray | memoryview] = []  # of a message in several frames
        self.is_open = False
        self.reason: str | None = None
        self._protocol.send_request(self._protocol.connect())

    def to_send(self) -> bytes:
        """Return the bytes to send: the request of the handshake, answers to pings, the end."""
        return b"".join(self._protocol.data_to_send())

    def frame(self, message: bytes) -> bytes:
        """Return the bytes that send a message."""
        self._protocol.send_binary(message)
        return self.to_send()

    def close(self) -> None:
        """End the connection in an orderly way, if it is open."""
        if self._protocol.state is State.OPEN:
            self._protocol.send_close(1000)
        self.end("this client is closed")

    def end(self, reason: str) -> None:
        """Note the end of the connection; the first reason stays."""
        self.is_open = False
        if self.reason is None:
            self.reason = reason

    def receive(self, data: bytes | memoryview) -> list[bytes | bytearray | memoryview]:
        """Take bytes from the socket, none at its end, and return the messages that are now complete."""
        if self.reason is not None:
            return []
        if data:
            self._protocol.receive_data(data)  # type: ignore[arg-type,unused-ignore] # any buffer will do
        else:
            self._protocol.receive_eof()
        messages = []
        for event in self._protocol.events_received():
            if not isinstance(event, Frame):
                continue  # the response of the handshake
            if event.opcode in (Opcode.BINARY, Opcode.TEXT, Opcode.CONT):
                if event.fin and not self._parts:
                    messages.append(event.data)
                    continue
                self._parts.append(event.data)
                if event.fin:
                    messages.append(bytearray().join(self._parts))
                    self._parts.clear()
            elif event.opcode is Opcode.CLOSE:
                close = self._protocol.close_rcvd
                assert close is not None
                self.end(f"closed the connection: {close.reason or f'code {close.code}'}")
        failure = self._protocol.handshake_exc
        if isinstance(failure, InvalidStatus):
            self.end(f"is not a flockstep server, or refused the connection: HTTP {failure.response.status_code}")
        elif failure is not None:
            self.end("is not a flockstep server, or expects another kind of address (ws://, wss://)")
        elif self._protocol.parser_exc is not None and data:
            self.end(f"sent a malformed message: {self._protocol.parser_exc}")
        elif not data:
            self.end("is gone: it closed the connection without a reason")
        self.is_open = self.reason is None and self._protocol.state is State.OPEN
        return messages
