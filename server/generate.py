"""Write the C++ that comes from flockstep.proto, the list of operations: ``python3 server/generate.py FOLDER``.

- ``protocol/messages.hpp`` and its ``.cpp``: the messages as plain structs, which server and C++ client read and write
  with protozero. libprotobuf is not used, because its global tables conflict with other copies in one process, such as
  those of PyTorch or TensorBoard.
- ``service/operations.inc``: the declarations of the service's functions, one for each operation.
- ``flockstep/client_operations.hpp``, ``flockstep/client_results.hpp`` and ``client/operations.cpp``: the operations of
  the C++ client, and the structs that some of them return.

The build runs it, so it needs only the standard library.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "envs/flockstep/client"))

from client_operations import definitions, header_of, results_of  # noqa: E402
from schema import Field, Message, Schema, read  # noqa: E402

# Type in C++ and default value, by the name of a type of Protocol Buffers, which protozero uses.
SCALARS = {
    "bool": ("bool", "false"),
    "int32": ("std::int32_t", "0"),
    "int64": ("std::int64_t", "0"),
    "uint32": ("std::uint32_t", "0"),
    "uint64": ("std::uint64_t", "0"),
    "float": ("float", "0.0F"),
    "double": ("double", "0.0"),
    "string": ("std::string", ""),
}
# Function of the service by the way in which an operation is answered.
FUNCTIONS = {
    "now": "void now(Call& call, const protocol::{}& operation);",
    "aside": "void aside(Call& call, const protocol::{}& operation);",
    "read": "void read(Call& call, const protocol::{}& operation, const ArraySource& arrays);",
    "locked": "void locked(Call& call, const protocol::{}& operation);",
    "short": "void locked(Call& call, const protocol::{}& operation);",
    "parts": "void handle(const std::shared_ptr<Call>& call, const protocol::{}& operation);",
    "session": "",
}


def main() -> None:
    """Write the files."""
    folder, schema = Path(sys.argv[1]), read()
    header, body = messages(schema)
    files = {
        "protocol/messages.hpp": header,
        "protocol/messages.cpp": body,
        "service/operations.inc": functions_of(schema),
        "flockstep/client_operations.hpp": header_of(schema),
        "flockstep/client_results.hpp": results_of(schema),
        "client/operations.cpp": definitions(schema),
    }
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text() != text:  # what includes it is not compiled again
            path.write_text(text)


def functions_of(schema: Schema) -> str:
    """Return the declarations of the service's functions."""
    return "".join(FUNCTIONS[entry.way].format(entry.request.name) + "\n" for entry in schema.operations.values())


def messages(schema: Schema) -> tuple[str, str]:
    """Return the texts of header and body."""
    received = reachable(schema, "Request")
    header, body = [HEADER_TOP], [BODY_TOP]
    for name, choices in schema.enums.items():
        values = ", ".join(f"{constant(value)} = {number}" for value, number in choices.items())
        header += [f"enum class {name} : std::int32_t {{ {values} }};"]
        header += [f"inline constexpr std::int32_t kLast{name} = {max(choices.values())};", ""]
    for name in in_order(schema):
        header += struct(schema, schema.messages[name])
        body += functions(schema, schema.messages[name], checked=name in received)
    header += ["template <class Operation>", "inline constexpr bool kIsShort = false;"]
    for entry in schema.operations.values():
        if entry.way == "short":
            header += ["template <>", f"inline constexpr bool kIsShort<{entry.request.name}> = true;"]
    header += [ARRAYS_TOP, "}  // namespace flockstep::protocol"]
    body += ["std::vector<RequestArray> arrays_of(const Request& request) {", "switch (request.operation.index()) {"]
    for index, entry in enumerate(schema.operations.values(), start=1):
        if entry.request.arrays:
            listed = [
                f'{{"{array.name}", DType::{constant("DTYPE_" + array.dtype.upper())}, {{{quoted(array.shape)}}}}}'
                for array in entry.request.arrays
            ]
            body += [f"case {index}:", f"return {{{', '.join(listed)}}};"]
    body += ["default:", "return {};", "}", "}", "}  // namespace flockstep::protocol"]
    return "\n".join(header) + "\n", "\n".join(body) + "\n"


def quoted(texts: tuple[str, ...]) -> str:
    """Return texts as literals."""
    return ", ".join(f'"{text}"' for text in texts)


def constant(name: str) -> str:
    """Return the name of an enumeration's value in C++: ``kInvalidArgument``."""
    return "k" + "".join(part.capitalize() for part in name.split("_"))


def type_name(field: Field) -> str:
    """Return the type of one value of a field in C++."""
    return SCALARS[field.kind][0] if field.kind in SCALARS else field.kind


def reachable(schema: Schema, root: str) -> set[str]:
    """Return the names of a message and of all messages in it."""
    found, pending = set(), [root]
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += [f.kind for f in schema.messages[name].fields if f.kind in schema.messages]
    return found


def in_order(schema: Schema) -> list[str]:
    """Return the names of all messages, each after those that it contains."""
    done: dict[str, None] = {}

    def add(name: str) -> None:
        for field in schema.messages[name].fields:
            if field.kind in schema.messages and field.kind not in done:
                add(field.kind)
        done[name] = None

    for name in schema.messages:
        if name not in done:
            add(name)
    return list(done)


def members(message: Message) -> list[tuple[str, list[Field]]]:
    """Return the members of the struct: a name, and the field or the fields of the oneof."""
    found: dict[str, list[Field]] = {}
    for field in message.fields:
        found.setdefault(field.oneof or field.name, []).append(field)
    return list(found.items())


def is_optional(schema: Schema, field: Field) -> bool:
    """Return whether the member is a std::optional."""
    return field.label == "optional" or field.kind in schema.messages


def struct(schema: Schema, message: Message) -> list[str]:
    """Return the definition of a struct."""
    lines = [f"struct {message.name} {{"]
    for name, fields in members(message):
        field = fields[0]
        kind = type_name(field)
        if field.oneof:
            lines += [f"std::variant<std::monostate, {', '.join(map(type_name, fields))}> {name};"]
        elif field.label == "repeated":
            lines += [f"std::vector<{kind}> {name};"]
        elif is_optional(schema, field):
            lines += [f"std::optional<{kind}> {name};"]
        elif field.kind in schema.enums:
            lines += [f"{kind} {name} = {{}};"]
        elif field.kind == "string":
            lines += [f"std::string {name};"]
        else:
            lines += [f"{kind} {name} = {SCALARS[field.kind][1]};"]
    if message.fields:
        lines += [""]
    lines += ["void write(protozero::pbf_writer& writer) const;", "void read(protozero::pbf_reader reader);", "};", ""]
    return lines


def functions(schema: Schema, message: Message, checked: bool) -> list[str]:
    """Return the definitions of a struct's functions. checked: numbers that are not finite are refused."""
    if not message.fields:
        return [
            f"void {message.name}::write(protozero::pbf_writer&) const {{}}",
            f"void {message.name}::read(protozero::pbf_reader reader) {{ skip_all(reader); }}",
            "",
        ]
    write, read = [], []
    for name, fields in members(message):
        for field in fields:
            if field.oneof:
                write += [f"if (const auto* const value = std::get_if<{type_name(field)}>(&{name})) {{"]
                write += [one_written(schema, field, "*value"), "}"]
            elif field.label == "repeated":
                write += repeated_written(schema, field)
            elif is_optional(schema, field):
                write += [f"if ({name}) {one_written(schema, field, '*' + name)}"]
            elif field.kind == "string":
                write += [f"if (!{name}.empty()) {one_written(schema, field, name)}"]
            else:
                write += [f"if ({name} != {type_name(field)}{{}}) {one_written(schema, field, name)}"]
            read += [f"case {field.number}:", *field_read(schema, name, field, checked), "break;"]
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


def one_written(schema: Schema, field: Field, value: str) -> str:
    """Return the statement that writes one value of a field."""
    if field.kind in schema.messages:
        return f"write_message(writer, {field.number}, {value});"
    if field.kind in schema.enums:
        return f"writer.add_enum({field.number}, static_cast<std::int32_t>({value}));"
    return f"writer.add_{field.kind}({field.number}, {value});"


def repeated_written(schema: Schema, field: Field) -> list[str]:
    """Return the statements that write a repeated field."""
    name = field.name
    if field.kind in schema.messages or field.kind == "string":
        return [f"for (const auto& value : {name}) {one_written(schema, field, 'value')}"]
    return [f"writer.add_packed_{field.kind}({field.number}, {name}.begin(), {name}.end());"]


def field_read(schema: Schema, name: str, field: Field, checked: bool) -> list[str]:
    """Return the statements that read a field whose tag has been read."""
    label = f'"{field.name}"'
    if field.kind in schema.messages:
        kind = "protozero::pbf_wire_type::length_delimited"
        if field.oneof:
            target = f"{name}.emplace<{type_name(field)}>()"
        elif field.label == "repeated":
            target = f"{name}.emplace_back()"
        else:
            target = f"{name}.emplace()"
        return [f"require_type(reader, {kind}, {label});", f"{target}.read(reader.get_message());"]
    if field.kind in schema.enums:
        last = f"kLast{type_name(field)}"
        return [f"{name} = static_cast<{type_name(field)}>(read_enum(reader, {last}, {label}));"]
    kind = field.kind
    is_real = kind in ("float", "double")
    if field.label == "repeated" and kind != "string":
        lines = [f"for (const auto value : packed_{kind}(reader, {label})) {name}.push_back(value);"]
        return lines
    value = f"read_{kind}(reader, {label})"
    if is_real and checked:
        value = f"finite({value}, {label})"
    if field.kind == "string" and checked:
        reader = "long_text" if field.name.endswith("_json") else "short_text"
        value = f"{reader}({value}, {label})"
    if field.label == "repeated":
        return [f"{name}.push_back({value});"]
    return [f"{name} = {value};"]


ARRAYS_TOP = """
// An array that a request may have. Its sizes are numbers, or names, such as E for the number of envs.
struct RequestArray {
  std::string_view name;
  DType dtype;
  std::vector<std::string_view> shape;
};
std::vector<RequestArray> arrays_of(const Request& request);
"""

HEADER_TOP = """// Messages of the protocol, as structs. Generated from flockstep.proto by server/generate.py.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
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
