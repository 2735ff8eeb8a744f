"""Reads flight logs: the binary files that Crazyflies write to their SD cards, and CSV files."""

from __future__ import annotations

import csv
import io
import struct
import zlib
from collections.abc import Iterator
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flockstep.errors import did_you_mean
from flockstep.identification.columns import ACCELERATION, ACCELEROMETER, NAMES, column_of, rotors_of

Array = npt.NDArray[np.float64]

#: First byte of a Crazyflie's log, and the version of the format that is read.
_MAGIC, _VERSION = 0xBC, 2
#: Codes of the types of values, which Python's struct shares.
_TYPES = frozenset("BHIQbhiqfd")
_TIME = struct.Struct("<HQ")  # of a record: its event, and microseconds
_CRC = struct.Struct("<I")
_MOST_BYTES = 1 << 30
#: Beyond any time since 1970 in seconds, and any measurement.
_MOST = 1e10


class Table(NamedTuple):
    """A log as its file has it: columns by the names of ``columns``, in their units, one number for each time."""

    path: str
    columns: dict[str, Array]


def read_table(path: str | PathLike[str]) -> Table:
    """Return the columns of a log: a Crazyflie's binary file, or a CSV file with a line of names.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is cut short or damaged, lacks a column, or has a value that is not a number. The message names file and
        column.
    """
    name = fspath(path)
    with Path(path).open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f"{name}: expected at most {_MOST_BYTES >> 20} MiB, got more")
    if not data:
        raise ValueError(f"{name}: expected a flight log, got an empty file")
    table = Table(name, _binary(name, data) if data[0] == _MAGIC else _text(name, data))
    _check(table)
    return table


def _binary(path: str, data: bytes) -> dict[str, Array]:
    """Return the columns of the event with most records."""
    if len(data) < 9 or zlib.crc32(data[: -_CRC.size]) != _CRC.unpack(data[-_CRC.size :])[0]:
        raise ValueError(
            f"{path}: expected a Crazyflie log that ends with its checksum, got one that is cut or damaged"
        )
    version, events = struct.unpack_from("<HH", data, 1)
    if version != _VERSION:
        raise ValueError(f"{path}: expected version {_VERSION} of Crazyflie logs, got {version}")
    try:
        kinds, at = _events(path, data, events)
    except (struct.error, ValueError) as error:
        if str(error).startswith(path):
            raise
        raise ValueError(f"{path}: expected the names of the columns of {events} events, got {error}") from error
    records: dict[int, list[bytes]] = {event: [] for event in kinds}
    end = len(data) - _CRC.size
    while at < end:
        event = int.from_bytes(data[at : at + 2], "little")
        if event not in kinds or at + kinds[event][1].itemsize > end:
            raise ValueError(f"{path}: expected a record of a known event at byte {at}, got event {event}")
        size = kinds[event][1].itemsize
        records[event].append(data[at : at + size])
        at += size
    event = max(records, key=lambda each: len(records[each]))
    names, kind = kinds[event]
    rows = np.frombuffer(b"".join(records[event]), kind)
    columns = {"time_s": rows["time"] / 1e6}
    for k, told in enumerate(names):
        if column := column_of(told):
            columns[column.name] = rows[f"v{k}"].astype(float) * column.factor
    return columns


def _events(path: str, data: bytes, count: int) -> tuple[dict[int, tuple[list[str], np.dtype[Any]]], int]:
    """Return names and layout of the records of each event, and where the records begin."""
    at = 5
    kinds = {}

    def text() -> str:
        nonlocal at
        end = data.index(b"\0", at)
        at, word = end + 1, data[at:end].decode("ascii", "replace")
        return word

    for _ in range(count):
        (event,) = struct.unpack_from("<H", data, at)
        at += 2
        text()  # the event's name
        (size,) = struct.unpack_from("<H", data, at)
        at += 2
        names, fields = [], [("event", "<u2"), ("time", "<u8")]
        for k in range(size):
            word = text()
            if word[-3:-2] + word[-1:] != "()" or word[-2] not in _TYPES:
                raise ValueError(f"{path}: expected a column such as motor.m1(I), got {word!r}")
            names.append(word[:-3])
            fields.append((f"v{k}", f"<{np.dtype(word[-2]).str[1:]}"))
        kinds[event] = (names, np.dtype(fields))
    return kinds, at


def _text(path: str, data: bytes) -> dict[str, Array]:
    """Return the columns of a CSV file."""
    try:
        lines = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""))
        names = next(lines, [])
        used = [(k, column) for k, name in enumerate(names) if (column := column_of(name))]
        if not used:
            raise ValueError(f"{path}: expected a Crazyflie log, or a line of names such as time_s, got {names[:3]}")
        doubled = [name for name in (column.name for _, column in used) if [c.name for _, c in used].count(name) > 1]
        if doubled:
            raise ValueError(f"{path}: expected one column {doubled[0]}, got {doubled.count(doubled[0])}")
        rows = np.array(list(_rows(path, lines, names, [k for k, _ in used])), float).reshape(-1, len(used))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: expected a Crazyflie log or a CSV file, got {error}") from error
    return {column.name: rows[:, k] * column.factor for k, (_, column) in enumerate(used)}


def _rows(path: str, lines: Any, names: list[str], used: list[int]) -> Iterator[list[float]]:
    """Yield the numbers of the used columns of each line."""
    for line in lines:
        if not line:
            continue
        if len(line) != len(names):
            raise ValueError(f"{path}, line {lines.line_num}: expected {len(names)} columns, got {len(line)}")
        row = []
        for k in used:
            try:
                row.append(float(line[k]))
            except ValueError:
                raise ValueError(
                    f"{path}, line {lines.line_num}: {names[k].strip()}: expected a number, got {line[k]!r}"
                ) from None
        yield row


def _check(table: Table) -> None:
    """Refuse a table that nothing can be fitted to."""
    path, columns = table
    names = set(columns)
    if "time_s" not in names:
        raise ValueError(f"{path}: time_s: expected this column, got {', '.join(sorted(names))}")
    if not rotors_of(names, "motor") and not rotors_of(names, "duty"):
        hint = next((did for name in sorted(names) if (did := did_you_mean(name, ["motor_1", "duty_1"]))), "")
        raise ValueError(f"{path}: motor_1: expected this column, or motor.m1, got {', '.join(sorted(names))}{hint}")
    if not {ACCELEROMETER[2], ACCELERATION[2]} & names:
        raise ValueError(f"{path}: {ACCELEROMETER[2]}: expected this column, or acc.z, got {', '.join(sorted(names))}")
    for name in sorted(names, key=NAMES.index):
        bad = np.flatnonzero(~(np.abs(columns[name]) <= _MOST))
        if bad.size:
            raise ValueError(
                f"{path}: {name}: expected numbers up to {_MOST:g}, got {columns[name][bad[0]]:g} in row {bad[0] + 1}"
            )
        if name.startswith(("motor_", "duty_")):
            low, high = columns[name].min(initial=0.0), columns[name].max(initial=0.0)
            if low < 0 or high > 1:
                raise ValueError(f"{path}: {name}: expected commands from 0 to 1, got {low if low < 0 else high:.6g}")
    time_s = columns["time_s"]
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        k = back[0] + 1
        raise ValueError(f"{path}: time_s: expected times that grow, got {time_s[k]:.6f} after {time_s[k - 1]:.6f}")
