"""Reads flockstep.proto, the list of a server's operations. The build runs it: only the standard library is needed."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

SOURCE = Path(__file__).with_name("flockstep.proto")
_START = re.compile(r"(message|enum) (\w+) \{(\})?")
_ONEOF = re.compile(r"oneof (\w+) \{")
_FIELD = re.compile(r"(?:(optional|repeated) )?(\w+) (\w+) = (\d+);")
_VALUE = re.compile(r"(\w+) = (\d+);")
_ARRAY = re.compile(r"(\w+)(\?)? \(([\w, ]+)\) (\w+)(?:, |$)")


@dataclass(frozen=True)
class Field:
    """A field of a message. ``label`` is ``"optional"``, ``"repeated"`` or empty; ``note`` is the comment behind it."""

    name: str
    kind: str
    number: int
    label: str
    oneof: str
    note: str


@dataclass(frozen=True)
class Array:
    """An array that a request may have: its sizes are numbers, or names such as ``"E"``."""

    name: str
    is_optional: bool
    shape: tuple[str, ...]
    dtype: str


@dataclass
class Message:
    """A message with the lines of the comment above it, and the arrays of an operation."""

    name: str
    text: list[str]
    arrays: list[Array]
    fields: list[Field] = field(default_factory=list)


@dataclass(frozen=True)
class Operation:
    """An operation: its name, its request, the message that answers it, and how it is answered.

    ``value`` is the type that the C++ client makes of the answer, ``section`` the comment above a group of operations.
    """

    name: str
    request: Message
    result: str
    value: str
    way: str
    section: str


@dataclass
class Schema:
    """The messages, enumerations and operations of the protocol, by name."""

    messages: dict[str, Message] = field(default_factory=dict)
    enums: dict[str, dict[str, int]] = field(default_factory=dict)
    operations: dict[str, Operation] = field(default_factory=dict)


def read(text: str | None = None) -> Schema:
    """Return what a text lists, by default flockstep.proto.

    Raises
    ------
    ValueError
        A line is no statement that this reader knows.
    """
    schema = Schema()
    fields: list[Field] | None = None
    values: dict[str, int] = {}
    oneof, section, comment = "", "", list[str]()
    sections: dict[str, str] = {}
    for line in (SOURCE.read_text(encoding="utf-8") if text is None else text).splitlines():
        code, _, note = (part.strip() for part in line.partition("//"))
        if not code:
            comment = [*comment, note] if note else []
            section = " ".join(comment) if oneof and note else section
        elif start := _START.fullmatch(code):
            values, fields = {}, None
            if start[1] == "enum":
                schema.enums[start[2]] = values
            else:
                listed = [line.removeprefix("Arrays: ") for line in comment if line.startswith("Arrays: ")]
                arrays = [
                    Array(name, bool(mark), tuple(shape.split(", ")), dtype)
                    for name, mark, shape, dtype in _ARRAY.findall(", ".join(listed))
                ]
                about = [line for line in comment if not line.startswith("Arrays: ")]
                schema.messages[start[2]] = message = Message(start[2], about, arrays)
                fields = message.fields
        elif choice := _ONEOF.fullmatch(code):
            oneof = choice[1]
        elif code == "}":
            oneof = ""
        elif fields is not None and (found := _FIELD.fullmatch(code)):
            sections[found[3]] = section
            fields.append(Field(found[3], found[2], int(found[4]), found[1] or "", oneof, note))
        elif fields is None and (value := _VALUE.fullmatch(code)):
            values[value[1]] = int(value[2])
        elif not re.match(r"(syntax|package|option) ", code):
            raise ValueError(f"flockstep.proto: expected a statement of one line, got {line!r}")
        if code:
            comment = []
    for entry in schema.messages["Request"].fields:
        if entry.oneof:
            answer, _, way = entry.note.partition("; ")
            result, _, client_type = answer.partition(" as ")
            request = schema.messages[entry.kind]
            schema.operations[entry.name] = Operation(
                entry.name, request, result, client_type or result, way or "locked", sections[entry.name]
            )
    return schema
