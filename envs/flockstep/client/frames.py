"""The bytes of a message: its header's size, its header, and the values of its arrays."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep.client.protocol_pb2 import DecodeError, DType, Reply, Request

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]

#: NumPy's type of each `DType`.
_TYPES: dict[int, np.dtype[Any]] = {
    DType.DTYPE_BOOL: np.dtype(np.bool_),
    DType.DTYPE_UINT8: np.dtype(np.uint8),
    DType.DTYPE_UINT16: np.dtype("<u2"),
    DType.DTYPE_INT32: np.dtype("<i4"),
    DType.DTYPE_INT64: np.dtype("<i8"),
    DType.DTYPE_UINT64: np.dtype("<u8"),
    DType.DTYPE_FLOAT32: np.dtype("<f4"),
    DType.DTYPE_FLOAT64: np.dtype("<f8"),
}
_DTYPES = {dtype.str: DType(number) for number, dtype in _TYPES.items()}


def numpy_type(dtype: int) -> np.dtype[Any]:
    """Return NumPy's type of a `DType`. Raises ConnectionError if there is none."""
    try:
        return _TYPES[dtype]
    except KeyError:
        raise ConnectionError(f"the server sent an array of the unknown type {dtype}") from None


def encode(request: Request, arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return the message of a request with its arrays, whose descriptions are added to the request."""
    values = []
    for name, array in arrays.items():
        array = np.ascontiguousarray(array).reshape(array.shape)  # the first makes one dimension of none
        request.arrays.add(name=name, dtype=_DTYPES[array.dtype.str], shape=array.shape)
        values.append(array.data)
    header = request.SerializeToString()
    return b"".join((len(header).to_bytes(4, "little"), header, *values))


def decode(message: bytes | bytearray | memoryview) -> tuple[Reply, Arrays]:
    """Return the reply in a message and its arrays.

    An array is a view of the message if its place in memory suits its type, otherwise a copy.

    Raises
    ------
    ConnectionError
        The message is malformed.
    """
    start = 4 + int.from_bytes(message[:4], "little")
    try:
        reply = Reply.FromString(bytes(message[4:start]))
    except DecodeError as error:
        raise ConnectionError(f"the server sent a malformed message: {error}") from None
    arrays: Arrays = {}
    for array in reply.arrays:
        dtype, shape = numpy_type(array.dtype), array.shape[:]  # faster than a tuple
        size = prod(shape) * dtype.itemsize
        if start + size > len(message):
            raise ConnectionError(f"the server sent a malformed message: the values of {array.name!r} are cut off")
        values: npt.NDArray[Any] = np.ndarray(shape, dtype, message if size else None, start if size else 0)
        arrays[array.name] = values if values.flags.aligned else values.copy()
        start += size
    if start != len(message):
        raise ConnectionError(f"the server sent a malformed message: {start} bytes expected, {len(message)} received")
    return reply, arrays
