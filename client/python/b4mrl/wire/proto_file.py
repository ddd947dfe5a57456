"""Makes message classes from the text of a .proto file, without protoc.

The package carries b4mrl.proto and reads it when it is imported. So it needs neither protoc nor a
generated module, which would work with one major version of protobuf's runtime only, and all
languages share one description of the messages.

This module understands the part of proto3 that b4mrl.proto uses: top-level messages and enums,
scalar fields, `optional`, `repeated`, `oneof`; it skips `option` and `reserved`. Anything else is a
ValueError with the line. A test compares the result with protoc's.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NoReturn

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

_Field = descriptor_pb2.FieldDescriptorProto
_SCALARS = {
    name: getattr(_Field, "TYPE_" + name.upper())
    for name in ("double", "float", "int32", "int64", "uint32", "uint64", "bool", "string", "bytes")
}
_TOKEN = re.compile(r'//[^\n]*|\s+|(?P<token>[A-Za-z_][\w.]*|\d+|"[^"\n]*"|[{}=;,])')


class _Tokens:
    """The tokens of a text, in order, each with its line."""

    def __init__(self, text: str) -> None:
        self._items: list[tuple[str, int]] = []
        self._next = 0
        position, line = 0, 1
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                raise ValueError(f"line {line}: unexpected character {text[position]!r}")
            if match["token"] is not None:
                self._items.append((match["token"], line))
            line += match[0].count("\n")
            position = match.end()
        self._items.append(("", line))

    def peek(self) -> str:
        """The next token; "" at the end."""
        return self._items[self._next][0]

    def take(self, expected: str | None = None) -> str:
        """Takes the next token and returns it; ValueError if it is not `expected`."""
        token = self.peek()
        if not token or (expected is not None and token != expected):
            self.refuse(f"{token or 'the end'!r} where {expected or 'more'!r} belongs")
        self._next += 1
        return token

    def take_number(self) -> int:
        token = self.take()
        return int(token) if token.isdigit() else self.refuse(f"{token!r} where a number belongs")

    def skip_statement(self) -> None:
        while self.take() != ";":
            pass

    def refuse(self, what: str) -> NoReturn:
        raise ValueError(f"line {self._items[self._next][1]}: {what}")


def parse(text: str, name: str) -> descriptor_pb2.FileDescriptorProto:
    """The descriptor of the .proto file `text`. ValueError: the file uses other syntax."""
    tokens = _Tokens(text)
    file = descriptor_pb2.FileDescriptorProto(name=name, syntax="proto3")
    while keyword := tokens.peek():
        if keyword in ("syntax", "option"):
            tokens.skip_statement()
        elif keyword == "package":
            tokens.take()
            file.package = tokens.take()
            tokens.take(";")
        elif keyword == "message":
            _parse_message(tokens, file.message_type.add())
        elif keyword == "enum":
            _parse_enum(tokens, file.enum_type.add())
        else:
            tokens.refuse(f"{keyword!r} at the top level")
    _resolve_types(file)
    return file


def load(text: str, name: str) -> dict[str, Any]:
    """The message classes of a .proto file, by their names without the package."""
    file = parse(text, name)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    return {
        message.name: message_factory.GetMessageClass(
            pool.FindMessageTypeByName(f"{file.package}.{message.name}")
        )
        for message in file.message_type
    }


def _statements(tokens: _Tokens, declaration: Any) -> Iterator[str]:
    """Reads a declaration: keyword, name, and statements in braces.

    Yields the first token of each statement, which the caller takes; skips options.
    """
    tokens.take()
    declaration.name = tokens.take()
    tokens.take("{")
    while (first := tokens.peek()) != "}":
        if first in ("option", "reserved"):
            tokens.skip_statement()
        else:
            yield first
    tokens.take("}")


def _parse_enum(tokens: _Tokens, enum: descriptor_pb2.EnumDescriptorProto) -> None:
    for name in _statements(tokens, enum):
        value = enum.value.add(name=tokens.take(name))
        tokens.take("=")
        value.number = tokens.take_number()
        tokens.take(";")


def _parse_message(tokens: _Tokens, message: descriptor_pb2.DescriptorProto) -> None:
    optional_fields = []
    for first in _statements(tokens, message):
        if first == "oneof":
            _parse_oneof(tokens, message)
            continue
        field = _parse_field(tokens, message)
        if field.proto3_optional:
            optional_fields.append(field)
    # Protobuf represents a proto3 optional field as a oneof of its own, after the written oneofs.
    for field in optional_fields:
        field.oneof_index = len(message.oneof_decl)
        message.oneof_decl.add(name="_" + field.name)


def _parse_oneof(tokens: _Tokens, message: descriptor_pb2.DescriptorProto) -> None:
    index = len(message.oneof_decl)
    for _ in _statements(tokens, message.oneof_decl.add()):
        _parse_field(tokens, message).oneof_index = index


def _parse_field(
    tokens: _Tokens, message: descriptor_pb2.DescriptorProto
) -> descriptor_pb2.FieldDescriptorProto:
    field = message.field.add(label=_Field.LABEL_OPTIONAL)
    if tokens.peek() in ("optional", "repeated"):
        if tokens.take() == "repeated":
            field.label = _Field.LABEL_REPEATED
        else:
            field.proto3_optional = True
    kind = tokens.take()
    if kind in _SCALARS:
        field.type = _SCALARS[kind]
    else:
        field.type_name = kind  # a message or an enum; _resolve_types finds out which
    field.name = tokens.take()
    tokens.take("=")
    field.number = tokens.take_number()
    tokens.take(";")
    return field


def _resolve_types(file: descriptor_pb2.FileDescriptorProto) -> None:
    enums = {enum.name for enum in file.enum_type}
    messages = {message.name for message in file.message_type}
    for message in file.message_type:
        for field in message.field:
            if not field.type_name:
                continue
            if field.type_name not in enums | messages:
                raise ValueError(f"{message.name}.{field.name}: unknown type {field.type_name}")
            field.type = _Field.TYPE_ENUM if field.type_name in enums else _Field.TYPE_MESSAGE
            field.type_name = f".{file.package}.{field.type_name}"
