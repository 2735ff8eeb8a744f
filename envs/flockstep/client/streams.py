"""Streams: values that a server sends again and again."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

T = TypeVar("T")


class Stream(Generic[T]):
    """An iterator with the newest values of a subscription.

    A value that is not fetched before the next is dropped.

    The iteration ends after `close`, and by an error if the server ends the stream or the connection is lost. Leaving
    a ``with`` block closes the stream.
    """

    def __init__(self, receive: Callable[[float | None], T], close: Callable[[], None]) -> None:
        self._receive = receive
        self._close = close
        self._is_closed = False

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T:
        if self._is_closed:
            raise StopIteration
        try:
            return self._receive(None)
        except ConnectionError:
            if self._is_closed:  # meanwhile, by another thread
                raise StopIteration from None
            raise

    def receive(self, timeout_s: float | None = None) -> T:
        """Wait for the next value and return it.

        Raises
        ------
        TimeoutError
            Nothing came within ``timeout_s``. Default: wait without limit.
        ValueError
            The stream is closed.
        """
        if self._is_closed:
            raise ValueError("the stream is closed")
        return self._receive(timeout_s)

    def close(self) -> None:
        """End the subscription. Does nothing the second time, or if the connection has ended."""
        if not self._is_closed:
            self._is_closed = True
            self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()


class AsyncStream(Generic[T]):
    """An asynchronous iterator with the newest values of a subscription, like `Stream`.

    Leaving an ``async with`` block closes it.
    """

    def __init__(self, receive: Callable[[float | None], Awaitable[T]], close: Callable[[], Awaitable[None]]) -> None:
        self._receive = receive
        self._close = close
        self._is_closed = False

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        if self._is_closed:
            raise StopAsyncIteration
        try:
            return await self._receive(None)
        except ConnectionError:
            if self._is_closed:  # meanwhile, by another task
                raise StopAsyncIteration from None
            raise

    async def receive(self, timeout_s: float | None = None) -> T:
        """Wait for the next value and return it. Raises the errors of `Stream.receive`."""
        if self._is_closed:
            raise ValueError("the stream is closed")
        return await self._receive(timeout_s)

    async def close(self) -> None:
        """End the subscription. Does nothing the second time, or if the connection has ended."""
        if not self._is_closed:
            self._is_closed = True
            await self._close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        await self.close()
