"""The bytes of a message: its header's size, its header, and the values of its arrays."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from flockstep.client.protocol import Array, DecodeError, DType, Reply, Request

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]


class ArrayProperty:
    """A property with the array of its name, which its object's ``_array`` returns."""

    def __init__(self, about: str) -> None:
        self.__doc__ = about

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self._name = name

    def __get__(self, of: Any, owner: type[Any] | None = None) -> npt.NDArray[Any]:
        return cast("npt.NDArray[Any]", self if of is None else of._array(self._name))


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
    """Return the message of a request with its arrays, whose descriptions are added to the request if it has none."""
    values = []
    is_described = len(request.arrays) > 0
    for name, array in arrays.items():
        if not array.flags.c_contiguous:
            array = np.ascontiguousarray(array)
        if not is_described:
            request.arrays.add(name=name, dtype=_DTYPES[array.dtype.str], shape=array.shape)
        values.append(array.data)
    header = request.SerializeToString()
    return b"".join((len(header).to_bytes(4, "little"), header, *values))


#: Name, type, shape and bytes of each array of a message.
Layout: TypeAlias = list[tuple[str, np.dtype[Any], tuple[int, ...], int]]

_MAX_LAYOUTS = 1024
_MAX_DIMENSIONS, _MAX_VALUES = 8, 1 << 40  # of an array


class _Layouts:
    """The layouts of earlier replies, by the bytes that describe their arrays, which Python reads slowly."""

    def __init__(self) -> None:
        self._known: dict[bytes, Layout] = {}
        self._size = 0  # bytes of the last description

    def of(self, reply: Reply, header: bytes) -> Layout:
        """Return the layout of a reply with arrays. Servers write the id first, then the arrays."""
        begin = 1 + _varint_size(reply.id) if reply.id else 0
        layout = self._known.get(header[begin : begin + self._size])
        if layout is None or len(layout) != len(reply.arrays):
            sizes = [len(array.SerializeToString()) for array in reply.arrays]
            self._size = sum(1 + _varint_size(size) + size for size in sizes)
            if len(self._known) >= _MAX_LAYOUTS:
                self._known.clear()
            layout = [_described(array) for array in reply.arrays]
            self._known[header[begin : begin + self._size]] = layout
        return layout


def _described(array: Array) -> tuple[str, np.dtype[Any], tuple[int, ...], int]:
    dtype, shape = numpy_type(array.dtype), tuple(array.shape)
    if len(shape) > _MAX_DIMENSIONS or prod(size or 1 for size in shape) > _MAX_VALUES:  # NumPy refuses empty ones, too
        raise ConnectionError(f"the server sent an array of the shape {shape}")
    return array.name, dtype, shape, prod(shape) * dtype.itemsize


def _varint_size(value: int) -> int:
    """Return the bytes of an integer in a message of Protocol Buffers."""
    return max(1, (value.bit_length() + 6) // 7)


_layouts = _Layouts()


def decode(message: bytes | bytearray | memoryview) -> tuple[Reply, Arrays]:
    """Return the reply in a message and its arrays.

    An array is a view of the message if its place in memory suits its type, otherwise a copy.

    Raises
    ------
    ConnectionError
        The message is malformed.
    """
    start = 4 + int.from_bytes(message[:4], "little")
    header = bytes(message[4:start])
    try:
        reply = Reply.FromString(header)
    except DecodeError as error:
        raise ConnectionError(f"the server sent a malformed message: {error}") from None
    arrays: Arrays = {}
    for name, dtype, shape, size in _layouts.of(reply, header) if reply.arrays else ():
        if start + size > len(message):
            raise ConnectionError(f"the server sent a malformed message: the values of {name!r} are cut off")
        values: npt.NDArray[Any] = np.ndarray(shape, dtype, message if size else None, start if size else 0)
        arrays[name] = values if values.flags.aligned else values.copy()
        start += size
    if start != len(message):
        raise ConnectionError(f"the server sent a malformed message: {start} bytes expected, {len(message)} received")
    return reply, arrays
