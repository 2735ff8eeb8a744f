"""Write the C++ structs of the messages in flockstep.proto: ``python server/generate.py [--check]``.

They are plain structs, which server and C++ client read and write with protozero. libprotobuf is not used, because its
global tables conflict with other copies in one process, such as those of PyTorch or TensorBoard.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

HERE = Path(__file__).parent
SOURCE = HERE / "flockstep.proto"
HEADER = HERE / "src/protocol/messages.hpp"
BODY = HERE / "src/protocol/messages.cpp"

F = FieldDescriptorProto
# Type in C++, name in protozero's functions, default value.
SCALARS = {
    F.TYPE_BOOL: ("bool", "bool", "false"),
    F.TYPE_INT32: ("std::int32_t", "int32", "0"),
    F.TYPE_INT64: ("std::int64_t", "int64", "0"),
    F.TYPE_UINT32: ("std::uint32_t", "uint32", "0"),
    F.TYPE_UINT64: ("std::uint64_t", "uint64", "0"),
    F.TYPE_FLOAT: ("float", "float", "0.0F"),
    F.TYPE_DOUBLE: ("double", "double", "0.0"),
    F.TYPE_STRING: ("std::string", "string", ""),
}


def main() -> None:
    """Write the two files, or with ``--check`` compare them."""
    parser = argparse.ArgumentParser(description="Write the C++ structs of the messages in flockstep.proto.")
    parser.add_argument("--check", action="store_true", help="fail if the files are out of date")
    check = parser.parse_args().check
    stale = []
    for path, text in zip((HEADER, BODY), generate(parse(SOURCE)), strict=True):
        formatted = subprocess.run(
            [Path(sys.executable).with_name("clang-format"), f"--assume-filename={path}"],
            input=text,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        if check and (not path.exists() or path.read_text() != formatted):
            stale.append(path.name)
        elif not check:
            path.write_text(formatted)
    if stale:
        sys.exit(f"{' and '.join(stale)}: out of date; run python server/generate.py")


def parse(source: Path) -> FileDescriptorProto:
    """Return the description of a .proto file, read by protoc."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "descriptor"
        subprocess.run(["protoc", f"-I{source.parent}", f"--descriptor_set_out={out}", source.name], check=True)
        files = FileDescriptorSet.FromString(out.read_bytes())
    return files.file[0]


def generate(file: FileDescriptorProto) -> tuple[str, str]:
    """Return the texts of header and body."""
    messages = {message.name: message for message in file.message_type}
    received = reachable(messages, "Request")
    header, body = [HEADER_TOP], [BODY_TOP]
    for enum in file.enum_type:
        values = ", ".join(f"{constant(value.name)} = {value.number}" for value in enum.value)
        last = max(value.number for value in enum.value)
        header += [f"enum class {enum.name} : std::int32_t {{ {values} }};"]
        header += [f"inline constexpr std::int32_t kLast{enum.name} = {last};", ""]
    for name in in_order(messages):
        header += struct(messages[name])
        body += functions(messages[name], checked=name in received)
    header += ["}  // namespace flockstep::protocol"]
    body += ["}  // namespace flockstep::protocol"]
    return "\n".join(header) + "\n", "\n".join(body) + "\n"


def constant(name: str) -> str:
    """Return the name of an enumeration's value in C++: ``kInvalidArgument``."""
    return "k" + "".join(part.capitalize() for part in name.split("_"))


def type_name(field: FieldDescriptorProto) -> str:
    """Return the type of one value of a field in C++."""
    if field.type in SCALARS:
        return SCALARS[field.type][0]
    return field.type_name.rsplit(".", 1)[1]


def reachable(messages: dict[str, DescriptorProto], root: str) -> set[str]:
    """Return the names of a message and of all messages in it."""
    found, pending = set(), [root]
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += [type_name(f) for f in messages[name].field if f.type == F.TYPE_MESSAGE]
    return found


def in_order(messages: dict[str, DescriptorProto]) -> list[str]:
    """Return the names of all messages, each after those that it contains."""
    done: dict[str, None] = {}

    def add(name: str) -> None:
        for field in messages[name].field:
            if field.type == F.TYPE_MESSAGE and type_name(field) not in done:
                add(type_name(field))
        done[name] = None

    for name in messages:
        if name not in done:
            add(name)
    return list(done)


def members(message: DescriptorProto) -> list[tuple[str, list[FieldDescriptorProto]]]:
    """Return the members of the struct: a name, and the field or the fields of the oneof."""
    found: dict[str, list[FieldDescriptorProto]] = {}
    for field in message.field:
        is_choice = field.HasField("oneof_index") and not field.proto3_optional
        found.setdefault(message.oneof_decl[field.oneof_index].name if is_choice else field.name, []).append(field)
    return list(found.items())


def is_optional(field: FieldDescriptorProto) -> bool:
    """Return whether the member is a std::optional."""
    return field.proto3_optional or (field.type == F.TYPE_MESSAGE and field.label != F.LABEL_REPEATED)


def struct(message: DescriptorProto) -> list[str]:
    """Return the definition of a struct."""
    lines = [f"struct {message.name} {{"]
    for name, fields in members(message):
        field = fields[0]
        kind = type_name(field)
        if len(fields) > 1:
            lines += [f"std::variant<std::monostate, {', '.join(map(type_name, fields))}> {name};"]
        elif field.label == F.LABEL_REPEATED:
            lines += [f"std::vector<{kind}> {name};"]
        elif is_optional(field):
            lines += [f"std::optional<{kind}> {name};"]
        elif field.type == F.TYPE_ENUM:
            lines += [f"{kind} {name} = {{}};"]
        elif field.type == F.TYPE_STRING:
            lines += [f"std::string {name};"]
        else:
            lines += [f"{kind} {name} = {SCALARS[field.type][2]};"]
    if message.field:
        lines += [""]
    lines += ["void write(protozero::pbf_writer& writer) const;", "void read(protozero::pbf_reader reader);", "};", ""]
    return lines


def functions(message: DescriptorProto, checked: bool) -> list[str]:
    """Return the definitions of a struct's functions. checked: numbers that are not finite are refused."""
    if not message.field:
        return [
            f"void {message.name}::write(protozero::pbf_writer&) const {{}}",
            f"void {message.name}::read(protozero::pbf_reader reader) {{ skip_all(reader); }}",
            "",
        ]
    write, read = [], []
    for name, fields in members(message):
        for field in fields:
            if len(fields) > 1:
                write += [f"if (const auto* const value = std::get_if<{type_name(field)}>(&{name})) {{"]
                write += [one_written(field, "*value"), "}"]
            elif field.label == F.LABEL_REPEATED:
                write += repeated_written(field)
            elif is_optional(field):
                write += [f"if ({name}) {one_written(field, '*' + name)}"]
            elif field.type == F.TYPE_STRING:
                write += [f"if (!{name}.empty()) {one_written(field, name)}"]
            else:
                write += [f"if ({name} != {type_name(field)}{{}}) {one_written(field, name)}"]
            read += [f"case {field.number}:", *field_read(message, name, field, len(fields) > 1, checked), "break;"]
    return [
        f"void {message.name}::write(protozero::pbf_writer& writer) const {{",
        *write,
        "}",
        f"void {message.name}::read(protozero::pbf_reader reader) {{",
        "while (reader.next()) {",
        "switch (reader.tag()) {",
        *read,
        "default:",
        "reader.skip();",
        "}",
        "}",
        "}",
        "",
    ]


def one_written(field: FieldDescriptorProto, value: str) -> str:
    """Return the statement that writes one value of a field."""
    if field.type == F.TYPE_MESSAGE:
        return f"write_message(writer, {field.number}, {value});"
    if field.type == F.TYPE_ENUM:
        return f"writer.add_enum({field.number}, static_cast<std::int32_t>({value}));"
    return f"writer.add_{SCALARS[field.type][1]}({field.number}, {value});"


def repeated_written(field: FieldDescriptorProto) -> list[str]:
    """Return the statements that write a repeated field."""
    name = field.name
    if field.type in (F.TYPE_MESSAGE, F.TYPE_STRING):
        return [f"for (const auto& value : {name}) {one_written(field, 'value')}"]
    return [f"writer.add_packed_{SCALARS[field.type][1]}({field.number}, {name}.begin(), {name}.end());"]


def field_read(
    message: DescriptorProto, name: str, field: FieldDescriptorProto, choice: bool, checked: bool
) -> list[str]:
    """Return the statements that read a field whose tag has been read."""
    label = f'"{field.name}"'
    if field.type == F.TYPE_MESSAGE:
        kind = "protozero::pbf_wire_type::length_delimited"
        if choice:
            target = f"{name}.emplace<{type_name(field)}>()"
        elif field.label == F.LABEL_REPEATED:
            target = f"{name}.emplace_back()"
        else:
            target = f"{name}.emplace()"
        return [f"require_type(reader, {kind}, {label});", f"{target}.read(reader.get_message());"]
    if field.type == F.TYPE_ENUM:
        last = f"kLast{type_name(field)}"
        return [f"{name} = static_cast<{type_name(field)}>(read_enum(reader, {last}, {label}));"]
    _, kind, _ = SCALARS[field.type]
    is_real = field.type in (F.TYPE_FLOAT, F.TYPE_DOUBLE)
    if field.label == F.LABEL_REPEATED and field.type != F.TYPE_STRING:
        lines = [f"for (const auto value : packed_{kind}(reader, {label})) {name}.push_back(value);"]
        return lines
    value = f"read_{kind}(reader, {label})"
    if is_real and checked:
        value = f"finite({value}, {label})"
    if field.type == F.TYPE_STRING and checked:
        reader = "long_text" if field.name.endswith("_json") else "short_text"
        value = f"{reader}({value}, {label})"
    if field.label == F.LABEL_REPEATED:
        return [f"{name}.push_back({value});"]
    return [f"{name} = {value};"]


HEADER_TOP = """// Messages of the protocol, as structs. Generated from flockstep.proto by server/generate.py.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <protozero/pbf_reader.hpp>
#include <protozero/pbf_writer.hpp>

// read() throws std::invalid_argument or protozero::exception if the bytes are not such a message. Unknown fields are
// skipped. flockstep.proto documents the fields.
namespace flockstep::protocol {
"""

BODY_TOP = """// Generated from flockstep.proto by server/generate.py.
#include "protocol/messages.hpp"

#include "protocol/read_values.hpp"

namespace flockstep::protocol {
"""

if __name__ == "__main__":
    main()
