"""How a client finds out that the daemon has ended."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from b4mrl import errors
from b4mrl.wire.connection import Connection
from b4mrl.wire.listening import Listening
from b4mrl.wire.messages import Reply, Request

from servers import SocketServer, listen


def done(request: Request, count: int) -> list[Reply]:
    return [Reply(protocol_version=1, request_id=request.request_id)]


def hello() -> Request:
    request = Request()
    request.hello.client = "test"
    return request


@pytest.fixture(params=["door", "ipc", "ipc without a file", "tcp"])
def listener(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    """An address, and the socket that listens there."""
    if request.param == "door":
        name, found = listen()
        address = f"door://{name}"
    elif request.param == "tcp":
        found = socket.create_server(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{found.getsockname()[1]}"
    else:
        path = str(tmp_path / "socket")
        found = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        has_file = request.param == "ipc"
        found.bind(path if has_file else "\0" + path)
        found.listen()
        address = "ipc://" + (path if has_file else "@" + path)
    yield address, found
    found.close()


def test_nobody_listens_after_the_end_and_somebody_before(listener) -> None:
    address, found = listener
    listening = Listening(address)
    assert not listening.is_refused()
    listening.look(1.0)
    assert listening.gone_since == math.inf
    found.close()
    assert listening.is_refused()
    listening.look(1.5)  # too early to look again
    assert listening.gone_since == math.inf
    listening.look(2.5)
    listening.look(4.0)
    assert listening.gone_since == (math.inf if address.startswith("tcp") else 2.5)


def test_a_server_that_listens_again_is_not_gone(tmp_path: Path) -> None:
    path = str(tmp_path / "socket")
    listening = Listening(f"ipc://{path}")
    listening.look(1.0)
    assert listening.gone_since == 1.0
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as again:
        again.bind(path)
        again.listen()
        listening.look(2.5)
    assert listening.gone_since == math.inf


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:99999", "tcp://127.0.0.1:*", "ipc:///" + 200 * "x", "tcp://a b:1"]
)
def test_a_place_that_cannot_be_says_nothing(address: str) -> None:
    assert not Listening(address).is_refused()


def test_requests_to_a_server_that_has_ended_are_given_up_soon_and_may_be_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 100)
    monkeypatch.setattr("b4mrl.wire.connection._QUIET_SECONDS", 0)
    path = str(tmp_path / "socket")
    server = SocketServer(done, path)
    connection = Connection(server.address)
    connection.call(hello(), bytearray(), 60_000)
    server.stop()
    started = time.monotonic()
    request_id = connection.send(hello(), bytearray(), 120_000)
    delivery = connection.await_any((request_id,))
    assert time.monotonic() - started < 60
    assert isinstance(delivery.error, errors.UnavailableError)
    assert f"nobody listens at ipc://{path} any more; has the daemon ended?" in str(delivery.error)
    assert delivery.executed is None
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 60_000)
    server = SocketServer(done, path)
    connection.ask_again(request_id, 120_000)
    assert connection.receive(request_id).error is None
    assert {each.request_id for each in server.requests} == {request_id}
    connection.close()
    server.stop()


def test_through_tcp_requests_wait_until_their_deadline_and_then_say_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 1)
    monkeypatch.setattr("b4mrl.wire.connection._QUIET_SECONDS", 0)
    server = SocketServer(done)
    connection = Connection(server.address)
    connection.call(hello(), bytearray(), 60_000)
    server.stop()
    started = time.monotonic()
    with pytest.raises(errors.UnavailableError, match="nobody listens at tcp.* has the daemon end"):
        connection.call(hello(), bytearray(), 500)
    assert time.monotonic() - started >= 0.5
    connection.close()


def test_a_server_that_listens_and_is_silent_has_not_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 1)
    monkeypatch.setattr("b4mrl.wire.connection._QUIET_SECONDS", 0)
    server = SocketServer(
        lambda request, count: done(request, 1) if count == 1 else [], str(tmp_path / "socket")
    )
    connection = Connection(server.address)
    connection.call(hello(), bytearray(), 60_000)
    with pytest.raises(errors.DeadlineExceededError, match="the same call may be made again"):
        connection.call(hello(), bytearray(), 500)
    connection.close()
    server.stop()
