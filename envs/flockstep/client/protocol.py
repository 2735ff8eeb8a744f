"""Messages and enumerations of the protocol, made from flockstep.proto: `protocol.Request`, `protocol.Code`.

They are in a descriptor pool of their own, so that they do not conflict with other packages, and they work with every
runtime of Protocol Buffers since 4.22.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError as DecodeError
from google.protobuf.message_factory import GetMessageClass

from flockstep.client.schema import Message, Schema, read

PACKAGE = "flockstep.v2"
SCHEMA = read()
#: Field of `Reply` for the result of each operation.
RESULTS = {
    operation.name: field.name
    for operation in SCHEMA.operations.values()
    for field in SCHEMA.messages["Reply"].fields
    if field.kind == operation.result and field.oneof
}


def described(schema: Schema) -> FileDescriptorProto:
    """Return the description of the protocol for a descriptor pool."""
    file = FileDescriptorProto(name="flockstep.proto", package=PACKAGE, syntax="proto3")
    for name, values in schema.enums.items():
        enum = file.enum_type.add(name=name)
        for value, number in values.items():
            enum.value.add(name=value, number=number)
    for message in schema.messages.values():
        _describe(message, schema, file)
    return file


def _describe(message: Message, schema: Schema, file: FileDescriptorProto) -> None:
    described = file.message_type.add(name=message.name)
    optional = ["_" + field.name for field in message.fields if field.label == "optional"]
    oneofs = [*dict.fromkeys(field.oneof for field in message.fields if field.oneof), *optional]
    for name in oneofs:
        described.oneof_decl.add(name=name)
    for field in message.fields:
        label = "LABEL_REPEATED" if field.label == "repeated" else "LABEL_OPTIONAL"
        entry = described.field.add(name=field.name, number=field.number, label=label)
        if field.kind in schema.messages or field.kind in schema.enums:
            entry.type_name = f".{PACKAGE}.{field.kind}"
            kind = "MESSAGE" if field.kind in schema.messages else "ENUM"
        else:
            kind = field.kind.upper()
        entry.type = FieldDescriptorProto.Type.Value(f"TYPE_{kind}")
        if field.oneof or field.label == "optional":
            entry.oneof_index = oneofs.index(field.oneof or "_" + field.name)
            entry.proto3_optional = not field.oneof


_POOL = DescriptorPool()
_POOL.AddSerializedFile(described(SCHEMA).SerializeToString())
globals().update({name: IntEnum(name, values, module=__name__) for name, values in SCHEMA.enums.items()})
globals().update({name: GetMessageClass(_POOL.FindMessageTypeByName(f"{PACKAGE}.{name}")) for name in SCHEMA.messages})


def __getattr__(name: str) -> Any:
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
