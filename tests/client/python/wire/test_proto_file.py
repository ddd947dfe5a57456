"""The reader of .proto files, against protoc and against what it is to refuse."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from b4mrl.wire import proto_file
from google.protobuf import descriptor_pb2

PROTO = Path(__file__).parents[4] / "proto" / "b4mrl.proto"


@pytest.mark.skipif(shutil.which("protoc") is None, reason="protoc is not installed")
def test_the_messages_are_those_that_protoc_reads(tmp_path: Path) -> None:
    output = tmp_path / "set"
    subprocess.run(
        ["protoc", f"-I{PROTO.parent}", f"--descriptor_set_out={output}", PROTO.name], check=True
    )
    wanted = descriptor_pb2.FileDescriptorSet.FromString(output.read_bytes()).file[0]
    # What concerns C++ alone, JSON names, and numbers that nobody may use.
    wanted.ClearField("options")
    for message in wanted.message_type:
        del message.reserved_range[:]
        for field in message.field:
            field.ClearField("json_name")
    assert proto_file.parse(PROTO.read_text(), PROTO.name) == wanted


def test_a_field_is_set_or_unset_where_it_is_optional() -> None:
    text = 'syntax = "proto3"; package p; message M { optional uint64 seed = 1; uint64 rows = 2; }'
    message = proto_file.load(text, "a.proto")["M"]()
    assert not message.HasField("seed")
    message.seed = 0
    assert message.HasField("seed")
    assert type(message).FromString(message.SerializeToString()).HasField("seed")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("service S {}", "line 1: 'service' at the top level"),
        ("message M {\n  map<string, int32> m = 1;\n}", "line 2: unexpected character '<'"),
        ("message M {\n  uint32 a = b;\n}", "line 2: '.*' where"),
        ("message M { Other a = 1; }", "M.a: unknown type Other"),
        ("message M { uint32 a = 1;", "the end"),
    ],
)
def test_what_it_does_not_know_is_refused_with_its_place(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        proto_file.parse(text, "a.proto")
