"""A connection to a server, without its socket: bytes in, bytes out."""

from __future__ import annotations

import os
from typing import TypeAlias

import numpy as np
from websockets.client import ClientProtocol
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode, apply_mask  # type: ignore[attr-defined] # it chooses the fastest
from websockets.protocol import State
from websockets.uri import parse_uri

Message: TypeAlias = bytes | bytearray | memoryview

_MAX_MESSAGE_BYTES = 1 << 31  # a server that announces more is not one of ours
_BUFFER_BYTES = 1 << 13
_MAX_BUFFER_BYTES = 1 << 20
_ALIGNMENT = 8
_WHOLE_BINARY_MESSAGE = 0x82  # first byte of a frame
_MASKED = 0x80  # in the second byte, beside the size; clients mask
_SHORT = 126  # size from which the second byte says where the size is
_MEDIUM = 1 << 16  # size from which it takes 8 bytes


class Session:
    """A WebSocket connection as bytes. Its owner moves them to and from a socket.

    The package websockets does the handshake, answers pings and ends the connection. It would copy each message that
    comes three times. Therefore whole binary messages, which are all that our servers send, do not pass through it. A
    large one stays in the memory into which it is received: the buffer, if the one before was about as large.

    Attributes
    ----------
    is_open
        True after the handshake and until the connection ends.
    has_to_send
        True if `to_send` would return something.
    reason
        Reason for the end of the connection, or None while it lasts.
    """

    def __init__(self, uri: str) -> None:
        self._protocol = ClientProtocol(parse_uri(uri), max_size=_MAX_MESSAGE_BYTES)
        self._protocol.send_request(self._protocol.connect())
        self._buffer = memoryview(bytearray(_BUFFER_BYTES))
        self._filled = 0  # bytes in the buffer: the beginning of a frame, or of the response to the handshake
        self._message: memoryview | None = None  # of which some bytes are still missing
        self._missing = 0
        self._foreign = 0  # bytes to come of a frame for the package
        self._parts: list[Message] = []  # of a message in several frames
        self.is_open = False
        self.has_to_send = True
        self.reason: str | None = None

    def to_send(self) -> bytes:
        """Return the bytes to send: the request of the handshake, answers to pings, the end."""
        self.has_to_send = False
        return b"".join(self._protocol.data_to_send())

    def frame(self, message: bytes) -> bytes:
        """Return the bytes that send a message."""
        size = len(message)
        if size < _SHORT:
            header = bytes((_WHOLE_BINARY_MESSAGE, _MASKED | size))
        elif size < _MEDIUM:
            header = bytes((_WHOLE_BINARY_MESSAGE, _MASKED | 126)) + size.to_bytes(2, "big")
        else:
            header = bytes((_WHOLE_BINARY_MESSAGE, _MASKED | 127)) + size.to_bytes(8, "big")
        mask = os.urandom(4)
        return b"".join((header, mask, apply_mask(message, mask)))

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

    def space(self) -> memoryview:
        """Return the memory for the next bytes from the socket."""
        if self._message is not None:
            return self._message[-self._missing :]
        return self._buffer[self._filled :]

    def received(self, size: int) -> list[Message]:
        """Take the bytes that came into `space`, none at the end, and return the messages that are now complete."""
        if self.reason is not None:
            return []
        if size == 0:
            return self._ended()
        if self._message is not None:
            self._missing -= size
            if self._missing:
                return []
            message, self._message = self._message, None
            return [message]
        self._filled += size
        buffer = self._buffer
        size = self._filled
        if buffer[0] == _WHOLE_BINARY_MESSAGE and buffer[1] == size - 2 < _SHORT and self.is_open and not self._foreign:
            self._filled = 0
            return [bytearray(buffer[2:size])]  # a short message, as most replies are
        messages: list[Message] = []
        used = 0 if self.is_open else self._shake_hands(messages)
        while self.is_open and used < self._filled and (end := self._take(buffer, used, messages)) > used:
            used = end
        rest = self._filled - used
        if used and rest:
            self._buffer[:rest] = buffer[used : self._filled]
        self._filled = rest
        return messages

    def _shake_hands(self, messages: list[Message]) -> int:
        """Give the response to the package when it is complete. Returns the number of its bytes."""
        response = bytes(self._buffer[: self._filled])
        size = response.find(b"\r\n\r\n") + 4
        if size == 3 and self._filled < _BUFFER_BYTES:
            return 0
        size = size if size > 3 else self._filled
        self._pass_on(response[:size], messages)
        self.is_open = self.reason is None and self._protocol.state is State.OPEN
        if not self.is_open:
            self.end("is not a flockstep server: its answer is too long")
        return size

    def _take(self, buffer: memoryview, begin: int, messages: list[Message]) -> int:
        """Take a frame that begins there in the buffer. Returns where it ends, or ``begin`` if it is incomplete."""
        size = self._filled - begin
        if self._foreign:
            size = min(size, self._foreign)
            self._foreign -= size
            self._pass_on(bytes(buffer[begin : begin + size]), messages)
            return begin + size
        if size < 2:
            return begin
        length = buffer[begin + 1] & 0x7F
        header = 2
        if length >= 126:
            header = 4 if length == 126 else 10
            if size < header:
                return begin
            length = int.from_bytes(buffer[begin + 2 : begin + header], "big")
        if length > _MAX_MESSAGE_BYTES or buffer[begin + 1] & 0x80 or buffer[begin] != _WHOLE_BINARY_MESSAGE:
            self._foreign = header + length
            return self._take(buffer, begin, messages)
        frame = header + length
        if frame > size and frame <= len(self._buffer):
            return begin
        payload = buffer[begin + header : begin + min(frame, size)]
        if frame <= size and 2 * frame > len(buffer) and buffer is self._buffer:
            messages.append(payload)  # which keeps this buffer
            self._buffer = _memory(payload, len(buffer), header)
            return begin + frame
        message = _memory(payload, length)
        message[: len(payload)] = payload
        if frame <= size:
            messages.append(message)
        else:
            self._message, self._missing = message, frame - size
            if frame <= _MAX_BUFFER_BYTES:
                self._buffer = _memory(payload, frame + frame // 16, header)  # for the next message
        return begin + header + len(payload)

    def _pass_on(self, data: bytes, messages: list[Message]) -> None:
        """Give bytes to the package, and take what it made of them."""
        self._protocol.receive_data(data)
        self.has_to_send = True
        self._take_events(messages)
        if self.reason is None and self._protocol.parser_exc is not None:
            self.end(f"sent a malformed message: {self._protocol.parser_exc}")

    def _ended(self) -> list[Message]:
        """Note that the socket has ended."""
        messages: list[Message] = []
        if not self.is_open and self._filled:
            self._pass_on(bytes(self._buffer[: self._filled]), messages)
        if self.reason is None:
            self._protocol.receive_eof()
            self._take_events(messages)
        self.end("is gone: it closed the connection without a reason")
        return messages

    def _take_events(self, messages: list[Message]) -> None:
        for event in self._protocol.events_received():
            if not isinstance(event, Frame):
                continue  # the response of the handshake
            if event.opcode in (Opcode.BINARY, Opcode.TEXT, Opcode.CONT):
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


def _memory(begin: memoryview, size: int, header: int = 0) -> memoryview:
    """Return memory for a message, in which its first array begins at a multiple of 8: see `decode`.

    ``begin`` is the beginning of this message, or of one with the same arrays; ``header`` bytes come before it.
    """
    arrays = header + 4 + int.from_bytes(begin[:4], "little")
    offset = -arrays % _ALIGNMENT  # NumPy's memory begins at a multiple of 16
    return np.empty(offset + size, np.uint8).data[offset:]  # a bytearray would be set to 0 first
