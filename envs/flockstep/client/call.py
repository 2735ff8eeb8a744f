"""A call: a request to the server, and how to read its reply."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import isfinite
from operator import index
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from flockstep.client import protocol as pb
from flockstep.client import schema
from flockstep.client.errors import ServerError
from flockstep.client.frames import Arrays
from flockstep.client.protocol import RESULTS, SCHEMA, Code, Reply, Request, Subscribe
from flockstep.client.readers import server_info
from flockstep.client.results import ServerInfo
from flockstep.errors import refuse_masked

T = TypeVar("T")

PROTOCOL = 2  # version


def nothing(reply: Reply, arrays: Arrays) -> None:
    """Return None, for operations without a result."""


@dataclass(slots=True)
class Call(Generic[T]):
    """A request with its arrays, the name of the result in `Reply`, and the function that reads it."""

    request: Request
    result: str
    read: Callable[[Reply, Arrays], T]
    arrays: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    @property
    def operation(self) -> str:
        """Name of the operation."""
        return self.request.WhichOneof("operation") or ""

    def answer(self, reply: Reply, arrays: Arrays) -> T:
        """Return the result of the call.

        Raises
        ------
        ServerError
            The reply is an error.
        ConnectionError
            The reply does not answer the request.
        """
        kind = reply.WhichOneof("result")
        if kind == self.result:
            try:
                return self.read(reply, arrays)
            except KeyError as error:
                raise ConnectionError(
                    f"{self.operation}: the array {error} is missing in the server's answer"
                ) from None
        if kind == "error":
            code = reply.error.code
            name = Code(code).name if code in {*Code} else f"CODE_{code}"
            advice = ": pass the server's token to connect()" if name == Code.UNAUTHENTICATED.name else ""
            raise ServerError(name, reply.error.text + advice, self.operation)
        raise ConnectionError(f"{self.operation}: the server answered {kind!r}, expected {self.result!r}")


def call(operation: str, read: Callable[[Reply, Arrays], T], /, **values: Any) -> Call[T]:
    """Return the call of an operation by its name, with the fields and arrays of its request that are not None.

    Their types in flockstep.proto say how a value becomes that of a message.
    """
    fields: dict[str, Any] = {}
    arrays: dict[str, npt.NDArray[Any]] = {}
    of_array, of_field = _CONVERTERS[operation]
    for name, value in values.items():
        if value is None:
            continue
        if name in of_array:
            arrays[name] = of_array[name](name, value)
        else:
            fields[name] = of_field[name](name, value)
    return Call(Request(**{operation: fields}), RESULTS[operation], read, arrays)


@dataclass(slots=True)
class Subscription(Generic[T]):
    """A call whose results come again and again."""

    call: Call[T]
    rate_hz: float
    only_new: bool

    def request(self) -> Call[T]:
        """Return the call that subscribes."""
        if not self.rate_hz > 0:
            raise ValueError(f"rate_hz: expected a number above 0, got {self.rate_hz!r}")
        call = self.call
        what: dict[str, Any] = {STREAMED[call.operation]: getattr(call.request, call.operation)}
        request = Request(subscribe=Subscribe(rate_hz=self.rate_hz, only_new=self.only_new, **what))
        return Call(request, call.result, call.read)


#: Field of `Subscribe` for each operation that streams.
STREAMED = {
    operation.name: field.name
    for operation in SCHEMA.operations.values()
    for field in SCHEMA.messages["Subscribe"].fields
    if field.kind == operation.request.name
}


def floats(name: str, values: npt.ArrayLike, *shape: int) -> npt.NDArray[np.float32]:
    """Return numbers of the given shape, in which -1 is any size, as float32."""
    refuse_masked(name, values)
    try:
        array = np.asarray(values, np.float32)
    except (TypeError, ValueError):
        raise TypeError(f"{name}: expected numbers, got {values!r}") from None
    fits = array.ndim == len(shape) and all(a in (-1, b) for a, b in zip(shape, array.shape, strict=True))
    if not fits:
        expected = ", ".join("N" if size < 0 else str(size) for size in shape)
        raise ValueError(f"{name}: expected shape ({expected}{',' * (len(shape) == 1)}), got {array.shape}")
    return array


def finite(name: str, values: npt.ArrayLike, size: int) -> list[float]:
    """Return ``size`` finite numbers. In messages, servers refuse other numbers like malformed bytes."""
    refuse_masked(name, values)
    try:
        numbers = [] if isinstance(values, str) else [*map(float, values)]  # type: ignore[arg-type] # faster than NumPy
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != size:
        numbers = floats(name, values, size).tolist()
    if not all(map(isfinite, numbers)):
        raise ValueError(f"{name}: expected finite numbers, got {numbers}")
    return numbers


def flags(name: str, values: npt.ArrayLike, *sizes: str) -> npt.NDArray[np.bool_]:
    """Return flags, which must be bool, of one dimension, or of as many as ``sizes`` names at most."""
    refuse_masked(name, values)
    array = np.asarray(values)
    if array.dtype != np.bool_ or not 1 <= array.ndim <= len(sizes):
        shapes = [f"({', '.join(sizes[: n + 1])}{',' * (n == 0)})" for n in range(len(sizes))]
        raise ValueError(f"{name}: expected bools of shape {' or '.join(shapes)}, got {array.dtype} {array.shape}")
    return array


def choice(name: str, value: str, choices: type[IntEnum]) -> int:
    """Return the number of a choice."""
    numbers = {choice.name.lower(): choice.value for choice in choices}
    if value not in numbers:
        raise ValueError(f"{name}: expected {', '.join(map(repr, numbers))}, got {value!r}")
    return numbers[value]


def vector(name: str, values: npt.ArrayLike) -> pb.Vector3:
    """Return three numbers as a message."""
    x, y, z = finite(name, values, 3)
    return pb.Vector3(x=x, y=y, z=z)


def quaternion(name: str, values: npt.ArrayLike | pb.Quaternion) -> pb.Quaternion:
    """Return four numbers as a message, which may be one already."""
    if isinstance(values, pb.Quaternion):
        return values
    w, x, y, z = finite(name, values, 4)
    return pb.Quaternion(w=w, x=x, y=y, z=z)


def _as_it_is(name: str, value: Any) -> Any:
    return value


def _of_field(field: schema.Field) -> Callable[[str, Any], Any]:
    """Return the function that makes the value of a field."""
    if field.kind in SCHEMA.enums:
        return lambda name, value: choice(name, value, getattr(pb, field.kind))
    if "int" in field.kind:
        if field.label == "repeated":
            return lambda name, values: [*map(index, values)]
        return lambda name, value: index(value)
    return {"Vector3": vector, "Quaternion": quaternion}.get(field.kind, _as_it_is)


def _of_array(array: schema.Array) -> Callable[[str, Any], npt.NDArray[Any]]:
    """Return the function that makes an array."""
    if array.dtype == "bool":
        return lambda name, values: flags(name, values, *array.shape)
    shape = [int(size) if size.isdigit() else -1 for size in array.shape]
    return (lambda name, values: floats(name, values, *shape)) if array.dtype == "float32" else _as_it_is


_CONVERTERS = {
    name: (
        {array.name: _of_array(array) for array in operation.request.arrays},
        {field.name: _of_field(field) for field in operation.request.fields},
    )
    for name, operation in SCHEMA.operations.items()
}


def unsubscription(stream: int) -> Call[None]:
    """Return the call that ends a subscription."""
    return call("unsubscribe", nothing, stream=stream)


def hello(token: str) -> Call[ServerInfo]:
    """Return the first call of a session."""

    def welcome(reply: Reply, arrays: Arrays) -> ServerInfo:
        if reply.welcome.protocol != PROTOCOL:
            raise ServerError(
                Code.FAILED_PRECONDITION.name,
                f"the server, flockstep {reply.welcome.version}, has version {reply.welcome.protocol} of the protocol, "
                f"this client version {PROTOCOL}: install the same version on both sides",
                "hello",
            )
        return server_info(reply, arrays)

    return call("hello", welcome, protocol=PROTOCOL, token=token, client="flockstep for Python")
