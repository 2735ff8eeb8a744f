"""Errors of the client."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class ServerError(Exception):
    """The server refused an operation. The message is the server's.

    The connection stays open, except if the server refuses the client itself. A lost connection raises
    `ConnectionError` instead, and a late reply `TimeoutError`.

    Attributes
    ----------
    code
        Reason, one of ``"INVALID_ARGUMENT"``, ``"NOT_FOUND"``, ``"PERMISSION_DENIED"``, ``"UNAUTHENTICATED"``,
        ``"RESOURCE_EXHAUSTED"``, ``"FAILED_PRECONDITION"``, ``"UNIMPLEMENTED"`` and ``"INTERNAL"``.
    operation
        Name of the operation in the protocol, such as ``"set_location"``.
    """

    def __init__(self, code: str, message: str, operation: str = "") -> None:
        super().__init__(code, message, operation)
        self.code = code
        self.operation = operation

    def __str__(self) -> str:
        return str(self.args[1])


@contextmanager
def refusals() -> Iterator[None]:
    """Raise ValueError for what the server refuses as a wrong value."""
    try:
        yield
    except ServerError as error:
        if error.code == "INVALID_ARGUMENT":
            raise ValueError(str(error)) from error
        raise
