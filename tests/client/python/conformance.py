"""Plays the table of tests/conformance (its README says how) with the Python client's messages.

As a script: conformance.py ENDPOINT [CASES.json]
"""

from __future__ import annotations

import itertools
import json
import secrets
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zmq
from b4mrl.errors import InternalError
from b4mrl.wire import arrays, limits
from b4mrl.wire.door import Door, open_door
from b4mrl.wire.messages import Reply, Request
from google.protobuf import json_format

CASES = Path(__file__).resolve().parents[2] / "conformance" / "cases.json"
DTYPES = {
    "FLOAT32": "<f4",
    "FLOAT64": "<f8",
    "INT32": "<i4",
    "INT64": "<i8",
    "UINT8": "u1",
    "UINT32": "<u4",
    "UINT64": "<u8",
}
RECOVERABLE = (4, 7, 8, 9)  # section 6 of PROTOCOL.md
PATIENCE_MS = 60_000

Step = dict[str, Any]


class Answer:
    def __init__(self, frames: list[bytes]) -> None:
        self.envelope = Reply.FromString(frames[0])
        self.code = self.envelope.status.code
        payload = bytearray(frames[1]) if len(frames) > 1 else bytearray()
        self.arrays = arrays.unpack(self.envelope.arrays, payload)

    def content(self) -> tuple[bytes, dict[str, tuple[str, tuple[int, ...], bytes]]]:
        """All of it but what a repeated answer may have anew: its id and its times."""
        message = Reply()
        message.CopyFrom(self.envelope)
        for field in ("timing", "request_id", "arrays"):
            message.ClearField(field)
        values = {name: (x.dtype.str, x.shape, x.tobytes()) for name, x in self.arrays.items()}
        return message.SerializeToString(deterministic=True), values


def bytes_of(dtype: str | int, shape: list[Any], values: Any) -> bytes:
    """Elements of a type that the wire does not know count as bytes."""
    if not isinstance(values, list):
        values = [values] * int(np.prod([int(extent) for extent in shape], dtype=np.int64))
    kind = np.dtype(DTYPES.get(dtype, "u1")) if isinstance(dtype, str) else np.dtype("u1")
    convert = float if kind.kind == "f" else int
    return np.array([convert(value) for value in values], dtype=kind).tobytes()


def contains(whole: Any, part: Any) -> bool:
    if isinstance(part, dict):
        return isinstance(whole, dict) and all(
            key in whole and contains(whole[key], value) for key, value in part.items()
        )
    if isinstance(part, list):
        return len(whole) == len(part) and all(map(contains, whole, part))
    return bool(whole == part)


class Player:
    """Plays cases against one server. AssertionError: it did not answer as it should.

    Args:
        through_doors: whether messages to workers go through their local doors.
    """

    def __init__(self, endpoint: str, through_doors: bool = False) -> None:
        self._endpoint = endpoint
        self._through_doors = through_doors
        self._doors: dict[str, Door] = {}  # by the worker's address
        self._context = zmq.Context()
        self._sockets: dict[str, zmq.Socket[bytes]] = {}
        self._ids = itertools.count(1000)
        self._dataset = endpoint
        self._start()
        self.run([{"to": "gateway", "request": {"hello": {}}, "label": "hello"}])
        self._dataset = self._address_of(self._labels["hello"].envelope.hello.dataset_port)

    def close(self) -> None:
        for door in self._doors.values():
            door.close()
        self._context.destroy(linger=0)

    def play(self, case: dict[str, Any]) -> None:
        self._start()
        try:
            self.run(case["steps"])
        except BaseException:
            for place in (*self._sockets.values(), *self._doors.values()):
                place.close(0)  # late replies would answer the next case
            self._sockets.clear()
            self._doors.clear()
            self._due.clear()
            raise
        finally:
            if self._workers:
                self.run(
                    [{"session": name, "request": {"close": {}}} for name in list(self._tokens)]
                )

    def run(self, steps: list[Step]) -> None:
        for step in steps:
            self._send(step)
            if not step.get("later"):
                self._collect()

    def _start(self) -> None:
        self._workers: dict[str, str] = {}  # addresses, by the session's name
        self._tokens: dict[str, bytes] = {}
        self._labels: dict[str, Answer] = {}
        self._due: dict[int, Step] = {}

    def _address_of(self, port: Any) -> str:
        kind, _, place = self._endpoint.partition("://")
        if not (port.ipc if kind == "ipc" else port.tcp):
            return self._endpoint
        return (
            f"ipc://{port.ipc}" if kind == "ipc" else f"tcp://{place.rpartition(':')[0]}:{port.tcp}"
        )

    def _place_of(self, step: Step) -> str:
        """The address to which a request goes."""
        places = {"gateway": self._endpoint, "dataset": self._dataset}
        last = next(reversed(self._workers.values()), "")
        worker = self._workers.get(step.get("session", "a"), last)
        return places.get(step.get("to", "worker"), worker)

    def _socket_for(self, address: str) -> zmq.Socket[bytes]:
        if address not in self._sockets:
            socket = self._sockets[address] = self._context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.set(zmq.MAXMSGSIZE, limits.MAX_PAYLOAD_BYTES)
            socket.connect(address)
        return self._sockets[address]

    def _send(self, step: Step) -> None:
        address = self._place_of(step)
        if "raw" in step:
            parts = [part if isinstance(part, list) else [part, 1] for part in step["raw"]]
            self._due[step.get("id", 0)] = step
            frames = [bytes.fromhex(text) * times for text, times in parts]
            self._socket_for(address).send_multipart(frames)
            return
        # Made before the first is sent, so that the server is not done with it when the last comes.
        ids = [next(self._ids) for _ in range(step.get("times", 1))]
        messages = [self._frames_of(step, request_id) for request_id in ids]
        self._due |= dict.fromkeys(ids, step)
        for frames in messages:
            if address in self._doors:
                assert self._doors[address].send(frames[0], bytearray(b"".join(frames[1:])))
            else:
                self._socket_for(address).send_multipart(frames)

    def _frames_of(self, step: Step, request_id: int) -> list[bytes]:
        request = json_format.ParseDict({"protocol_version": 1} | step["request"], Request())
        name = step.get("session", "a")
        request.session_token = (
            bytes.fromhex(step["token"])
            if "token" in step
            else self._tokens.setdefault(name, secrets.token_bytes(limits.TOKEN_BYTES))
        )
        request.request_id = request_id
        payload = b""
        for name, dtype, shape, *rest in step.get("arrays", []):
            if isinstance(shape, str):
                source = self._labels[shape].arrays[name]
                shape, values = source.shape, source.tobytes()
            else:
                values = bytes_of(dtype, shape, rest[0])
            payload += bytes(-len(payload) % limits.ARRAY_ALIGNMENT)
            entry = request.arrays.add(name=name, offset=int(rest[1]) if rest[1:] else len(payload))
            entry.shape.extend(int(extent) for extent in shape)
            entry.dtype = dtype
            payload += values
        return [request.SerializeToString()] + ([payload] if payload else [])

    def _collect(self) -> None:
        got: dict[int, Answer] = {}
        finish = time.monotonic() + PATIENCE_MS / 1000
        while not got.keys() >= self._due.keys():
            assert time.monotonic() < finish, f"no reply within {PATIENCE_MS} ms"
            for frames in self._receive():
                answer = Answer(frames)
                got[answer.envelope.request_id] = answer
        for request_id, step in self._due.items():
            self._check(step, got[request_id])
        for step in self._due.values():
            codes = [got[i].code for i, other in self._due.items() if other is step]
            some = step.get("expect", {}).get("some", codes[0])
            assert some in codes, f"no reply has code {some}"
        self._due.clear()

    def _receive(self) -> Iterator[list[bytes]]:
        """Messages that are here, or that come soon."""
        for door in self._doors.values():
            message = door.receive(1)
            if message is not None:
                yield list(map(bytes, message))
        poller = zmq.Poller()
        for socket in self._sockets.values():
            poller.register(socket, zmq.POLLIN)
        for socket, _ in poller.poll(0 if self._doors else 20):
            yield socket.recv_multipart()

    def _check(self, step: Step, answer: Answer) -> None:
        want = step.get("expect", {})
        status = answer.envelope.status
        assert answer.envelope.protocol_version == limits.PROTOCOL_VERSION
        codes = want.get("code", 0)
        assert answer.code in (codes if isinstance(codes, list) else [codes]), status.message
        for word in want.get("text", []):
            assert word in status.message
        if answer.code:
            assert status.message.isascii() and status.message.isprintable() and status.message
            assert not answer.arrays and answer.envelope.WhichOneof("payload") is None
            assert status.recoverable == (answer.code in RECOVERABLE)
            return
        self._check_success(step, answer, want)
        if "label" in step:
            self._labels[step["label"]] = answer
        if answer.envelope.HasField("open"):
            port = answer.envelope.open.port
            address = self._workers[step.get("session", "a")] = self._address_of(port)
            if self._through_doors and address not in self._doors:
                door = open_door(port.door, PATIENCE_MS)
                assert door is not None
                self._doors[address] = door

    def _check_success(self, step: Step, answer: Answer, want: dict[str, Any]) -> None:
        if "request" in step:
            assert answer.envelope.WhichOneof("payload") in step["request"]
        for name, dtype, shape, *values in want.get("arrays", []):
            got = answer.arrays[name]
            assert (got.dtype, list(got.shape)) == (np.dtype(DTYPES[dtype]), shape), name
            if values:
                assert got.tobytes() == bytes_of(dtype, shape, values[0]), name
        assert not answer.arrays.keys() & want.get("no_arrays", [])
        if "same_as" in want:
            assert answer.content() == self._labels[want["same_as"]].content()
        if "reply" in want:
            # Defaults are written out, by whichever name this version of protobuf has for that.
            names = json_format.MessageToDict.__code__.co_varnames
            defaults = "always_print_fields_with_no_presence"
            if defaults not in names:
                defaults = "including_default_value_fields"
            form = json_format.MessageToDict(
                answer.envelope, preserving_proto_field_name=True, **{defaults: True}
            )
            assert contains(form, want["reply"]), form


def main(endpoint: str, path: str = str(CASES)) -> int:
    player = Player(endpoint)
    failed = 0
    for case in json.loads(Path(path).read_text()):
        try:
            player.play(case)
            print(f"ok     {case['name']}")
        except (AssertionError, InternalError, KeyError) as error:
            failed += 1
            print(f"FAILED {case['name']}: {error}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
