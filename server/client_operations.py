"""The operations of the C++ client, from the list in flockstep.proto; `generate` writes them.

An operation takes the fields of its request, in their order, and its arrays: one by itself, several as a struct with
the name of the request. A request of three or more fields that may all be left out is a struct, too.
"""

from __future__ import annotations

from dataclasses import dataclass

from schema import Array, Field, Operation, Schema

# Types of arguments and of a struct's members, by the type of a field.
SCALARS = {
    "bool": "bool",
    "int32": "std::int32_t",
    "int64": "std::int64_t",
    "uint32": "std::uint32_t",
    "uint64": "std::uint64_t",
    "float": "float",
    "double": "double",
}
ENUMS = {"CaptureModeName": "CaptureMode"}  # others have their own names
ONEOFS = {"rotation": "Orientation"}
# Type of a result by the message; others have the message's name.
RESULTS = {
    "Done": "void",
    "Config": "std::string",
    "Visible": "bool",
    "Drones": "std::vector<Drone>",
    "Worlds": "std::vector<World>",
    "Configs": "BodyConfigs",
}
MANY_FIELDS = 3
#: Structs of the client with the fields of messages, and the messages.
MIRRORED = {name: name for name in ("Drone", "Fps", "Rotation", "Time", "World", "Field", "Task")}
MIRRORED["ServerInfo"] = "Welcome"
OTHER_MEMBERS = {"imu_config_json": "imu_configs", "protocol": ""}  # names in the structs; empty: none


@dataclass(frozen=True)
class Argument:
    """An argument of a method: its declaration without and with a default value, and how it gets into the request."""

    name: str
    kind: str
    default: str
    statements: tuple[str, ...]

    def declared(self, with_default: bool) -> str:
        """Return the declaration."""
        return f"{self.kind} {self.name}" + (f" = {self.default}" if with_default and self.default else "")


@dataclass(frozen=True)
class Method:
    """An operation as a method of a class."""

    entry: Operation
    is_of_drone: bool
    arguments: list[Argument]
    structs: list[str]

    @property
    def result(self) -> str:
        """Type of the result."""
        return RESULTS.get(self.entry.value, self.entry.value)

    def parameters(self, *first: str, with_defaults: bool = False, last: tuple[str, ...] = ()) -> str:
        """Return the parameters of the method."""
        return ", ".join([*first, *(one.declared(with_defaults) for one in self.arguments), *last])


def methods(schema: Schema) -> list[Method]:
    """Return the methods of both classes."""
    return [method_of(schema, entry) for entry in schema.operations.values() if entry.way != "session"]


def method_of(schema: Schema, entry: Operation) -> Method:
    """Return an operation as a method."""
    is_of_drone = entry.section == "One drone"
    request, structs = entry.request, list[str]()
    members: dict[str, list[Field]] = {}
    for field in request.fields:
        if not (is_of_drone and field.name == "drone"):
            members.setdefault(field.oneof or field.name, []).append(field)
    can_be_left_out = all(fields[0].label or fields[0].kind not in schema.messages for fields in members.values())
    if len(members) >= MANY_FIELDS and can_be_left_out and not request.arrays and "config_json" not in members:
        lines = []
        statements = []
        for name, (field, *_) in members.items():
            kind = member_type(schema, field)
            lines.append(f"  {kind} {name}{{}};" + (f"  // {field.note}" if field.note else ""))
            statements.append(f'put(message.{name}, request.{name}, "{name}");')
        structs.append("\n".join([f"// Arguments of {entry.name}().", f"struct {request.name} {{", *lines, "};"]))
        return Method(
            entry, is_of_drone, [Argument("request", f"const {request.name}&", "{}", tuple(statements))], structs
        )
    arguments = [
        argument_of(schema, name, fields, n > 0 or bool(request.arrays))
        for n, (name, fields) in enumerate(members.items())
    ]
    own = [one for one in arguments if one.name == "config_json"]
    others = [one for one in arguments if one.name != "config_json"]
    arrays = arrays_of(entry.request.name, entry.name, request.arrays, structs)
    return Method(entry, is_of_drone, [*own, *arrays, *others], structs)


def argument_of(schema: Schema, name: str, fields: list[Field], may_be_left_out: bool) -> Argument:
    """Return the argument of a field or of the fields of a oneof."""
    field = fields[0]
    statement = f'put(message.{name}, {name}, "{name}");'
    if field.oneof:
        return Argument(name, f"const {ONEOFS[name]}&", "", (statement,))
    if field.label == "repeated":
        item = "std::string" if field.kind == "string" else SCALARS[field.kind]
        return Argument(name, f"std::span<const {item}>", "{}" if "empty" in field.note else "", (statement,))
    if field.label == "optional":
        return Argument(name, f"std::optional<{SCALARS[field.kind]}>", "{}", (statement,))
    if field.kind == "string":
        return Argument(name, "std::string_view", "" if name == "config_json" else "{}", (statement,))
    if field.kind in schema.messages:
        return Argument(name, f"const {field.kind}&", "", (statement,))
    kind = SCALARS.get(field.kind) or ENUMS.get(field.kind, field.kind)
    usual = {"bool": "false" if may_be_left_out else "", "uint32": "0"}.get(field.kind, "")
    return Argument(name, kind, usual, (statement,))


def member_type(schema: Schema, field: Field) -> str:
    """Return the type of a struct's member."""
    kind = "std::string" if field.kind == "string" else SCALARS.get(field.kind) or ENUMS.get(field.kind, field.kind)
    return f"std::optional<{kind}>" if field.label == "optional" else kind


def arrays_of(name: str, operation: str, arrays: list[Array], structs: list[str]) -> list[Argument]:
    """Return the argument for the arrays of an operation, if it has any."""
    if not arrays:
        return []
    if len(arrays) == 1:
        (array,) = arrays
        usual = "{}" if array.is_optional else ""
        return [Argument(array.name, span_of(array), usual, (added(array, array.name),))]
    lines = [f"  {span_of(array)} {array.name}{{}};  // {about(array)}" for array in arrays]
    structs.append("\n".join([f"// Arrays of {operation}().", f"struct {name} {{", *lines, "};"]))
    usual = "{}" if all(array.is_optional for array in arrays) else ""
    return [
        Argument("arrays", f"const {name}&", usual, tuple(added(array, f"arrays.{array.name}") for array in arrays))
    ]


def about(array: Array) -> str:
    """Return the comment of an array."""
    return f"({', '.join(array.shape)})" + (", or empty" if array.is_optional else "")


def span_of(array: Array) -> str:
    """Return the type of an array's argument. A size that only the task knows needs an Array."""
    if "action" in array.shape:
        return "const Array&"
    item = {"bool": "std::uint8_t", "float32": "float", "float64": "double"}.get(array.dtype, f"std::{array.dtype}_t")
    return f"std::span<const {item}>"


def added(array: Array, value: str) -> str:
    """Return the statement that adds an array to a request."""
    if "action" in array.shape:
        return f'add_array(writer, "{array.name}", {value});'
    known = {"B": "link_->server().bodies_per_env", "C": "command_size(link_->server(), control)"}
    sizes = ", ".join(known.get(size, size) for size in array.shape[1:])
    kind = "add_flags" if array.dtype == "bool" else "add_rows"
    test = f"if (!{value}.empty()) " if array.is_optional else ""
    return f'{test}{kind}(writer, "{array.name}", {value}, {{{sizes}}});'


def header_of(schema: Schema) -> str:
    """Return the header: structs for arguments, and a class for each kind of controller."""
    listed = methods(schema)
    lines = [HEADER_TOP]
    for method in listed:
        for struct in method.structs:
            lines += [struct, ""]
    streams = {field.kind: field.name for field in schema.messages["Subscribe"].fields if field.oneof}
    for name, about, is_of_drone in CLASSES:
        lines += [f"// {about}", f"class FLOCKSTEP_API {name} {{", " public:"]
        for method in listed:
            if method.is_of_drone == is_of_drone or method.entry.name == "ping":
                lines += declared(method)
                if method.entry.request.name in streams:
                    lines += [
                        f"  // Streams what {method.entry.name}() returns, at most rate_hz times per second of wall",
                        "  // time; with only_new only after a change.",
                        f"  Stream<{method.result}> stream_{streams[method.entry.request.name]}("
                        f"{method.parameters('double rate_hz', with_defaults=True, last=('bool only_new = false',))});",
                    ]
        extra = ["  std::int64_t drone_;"] if is_of_drone else []
        drone = ", std::int64_t drone" if is_of_drone else ""
        init = ", drone_(drone)" if is_of_drone else ""
        lines += [
            "",
            " private:",
            f"  friend class {name.replace('Operations', 'Controller')};",
            f"  explicit {name}(std::shared_ptr<detail::Link> link{drone}) : link_(std::move(link)){init} {{}}",
            "  std::shared_ptr<detail::Link> link_;",
            *extra,
            "};",
            "",
        ]
    return "\n".join([*lines, "}  // namespace flockstep::client"]) + "\n"


def declared(method: Method) -> list[str]:
    """Return the declarations of both forms of a method, with the text of its request."""
    name = method.entry.name
    arguments = ", ".join(["later", *(one.name for one in method.arguments)])
    return [
        *(f"  // {line}" for line in method.entry.request.text),
        f"  {method.result} {name}({method.parameters(with_defaults=True)}) {{ return {name}({arguments}).get(); }}",
        f"  Future<{method.result}> {name}({method.parameters('Later', with_defaults=True)});",
    ]


def results_of(schema: Schema) -> str:
    """Return the header of the structs that mirror messages."""
    lines = [RESULTS_TOP]
    for name, of in MIRRORED.items():
        members = [f"  {result_member(field, member)};  // {field.note}" for field, member in members_of(schema, of)]
        lines += [*(f"// {line}" for line in schema.messages[of].text), f"struct {name} {{", *members, "};", ""]
    return "\n".join([*lines, "}  // namespace flockstep::client"]) + "\n"


def members_of(schema: Schema, message: str) -> list[tuple[Field, str]]:
    """Return the fields of a message that a struct has, with the names of its members."""
    named = ((field, OTHER_MEMBERS.get(field.name, field.name)) for field in schema.messages[message].fields)
    return [(field, name) for field, name in named if name]


def result_member(field: Field, name: str) -> str:
    """Return the declaration of a member of a result."""
    kind = {"string": "std::string"}.get(field.kind) or SCALARS.get(field.kind, field.kind)
    if field.label == "repeated":
        return f"std::vector<{'std::size_t' if field.kind == 'uint64' else kind}> {name}"
    if field.label == "optional":
        return f"std::optional<{kind}> {name}"
    usual = {"DType": "DType::float32", "Quaternion": "1.0F, 0.0F, 0.0F, 0.0F"}
    return f"{kind} {name}{{{usual.get(field.kind, '')}}}"


def result_value(schema: Schema, field: Field) -> str:
    """Return the value of a member of a result, from the message."""
    value = f"message.{field.name}"
    if field.label == "repeated":
        return (
            f"values_of<{field.kind}>({value})"
            if field.kind in schema.messages
            else f"{{{value}.begin(), {value}.end()}}"
        )
    if field.kind in schema.messages:
        return f"value_of({value})" if field.label else f'value_of(required({value}, "{field.name}"))'
    return f"static_cast<{field.kind}>({value})" if field.kind in schema.enums else value


def readers(schema: Schema) -> list[str]:
    """Return the functions that read results: declared, or defined for structs that mirror messages."""
    converted = {"Angles": "Angles"} | MIRRORED
    lines = [*(f"{name} value_of(const protocol::{of}& message);" for name, of in converted.items()), VALUES_OF]
    for name, of in converted.items():
        values = ", ".join(f".{name} = {result_value(schema, field)}" for field, name in members_of(schema, of))
        lines += [f"{name} value_of(const protocol::{of}& message) {{ return {{{values}}}; }}"]
    messages = {method.result: method.entry.result for method in methods(schema)}
    for result, name in messages.items():
        (field, *others) = schema.messages[name].fields or (None,)
        lines += ["template <>", f"{result} read<{result}>(Call& call)"]
        if result in MIRRORED:
            lines += [f"{{ return value_of(ReplyOf<protocol::{name}>(call).message()); }}"]
        elif field is not None and not others and field.kind in MIRRORED:
            value = f"ReplyOf<protocol::{name}>(call).message().{field.name}"
            lines += [f"{{ return values_of<{field.kind}>({value}); }}"]
        else:
            lines[-1] += ";"
    return lines


def definitions(schema: Schema) -> str:
    """Return the definitions of the methods."""
    lines = [BODY_TOP, "namespace detail {", *readers(schema), "}"]
    streams = {field.kind: field.name for field in schema.messages["Subscribe"].fields if field.oneof}
    for name, _, is_of_drone in CLASSES:
        for method in methods(schema):
            if method.is_of_drone != is_of_drone and method.entry.name != "ping":
                continue
            request = method.entry.request.name
            message = [f"protocol::{request} message;"]
            message += ["message.drone = drone_;"] if method.is_of_drone else []
            puts = [line for one in method.arguments for line in one.statements if line.startswith("put(")]
            adds = [line for one in method.arguments for line in one.statements if not line.startswith("put(")]
            add = f", [&](protocol::FrameWriter& writer) {{ {' '.join(adds)} }}" if adds else ""
            lines += [
                f"Future<{method.result}> {name}::{method.entry.name}({method.parameters('Later')}) {{",
                *message,
                *puts,
                f"return {{link_->send(request_of(std::move(message)){add}), read<{method.result}>}};",
                "}",
            ]
            if request in streams:
                lines += [
                    f"Stream<{method.result}> {name}::stream_{streams[request]}("
                    f"{method.parameters('double rate_hz', last=('bool only_new',))}) {{",
                    *message,
                    *puts,
                    'return {link_->subscribe({.rate_hz = finite(rate_hz, "rate_hz"), .what = std::move(message), '
                    f".only_new = only_new}}), read<{method.result}>}};",
                    "}",
                ]
    return "\n".join([*lines, "}  // namespace flockstep::client"]) + "\n"


CLASSES = (
    ("GameModeOperations", "The operations on the simulation: its drones, time, worlds and task.", False),
    ("DroneOperations", "The operations on one drone.", True),
)
RESULTS_TOP = """// Results that the server sends as messages with the same fields, which client.hpp includes.
// server/generate.py makes this file from flockstep.proto.
#pragma once

namespace flockstep::client {
"""
VALUES_OF = """template <class T, class Message>
std::vector<T> values_of(const std::vector<Message>& messages) {
  std::vector<T> values;
  for (const Message& message : messages) values.push_back(value_of(message));
  return values;
}"""
HEADER_TOP = """// The operations of the client, which client.hpp includes.
// server/generate.py makes this file from flockstep.proto.
#pragma once

namespace flockstep::client {
"""
BODY_TOP = """// Generated from flockstep.proto by server/generate.py.
#include "client/convert.hpp"

namespace flockstep::client {

using namespace detail;
"""
