"""The asyncio client as an ordinary one, so that one test serves both clients, and a client of a batch."""

from __future__ import annotations

import asyncio
import contextlib

import flockstep
from flockstep.client import AsyncClient, AsyncDrone, AsyncStream


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
