"""Threads that share a connection."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.wire.connection import Connection
from b4mrl.wire.door import open_door
from b4mrl.wire.messages import Reply, Request

from equality import assert_same
from servers import DoorServer, SocketServer


def hello() -> Request:
    request = Request()
    request.hello.client = "test"
    return request


class Server:
    """Answers once `may_answer` is set; `is_asked` is set when a request has come."""

    def __init__(self, kind: type[SocketServer] | type[DoorServer]) -> None:
        self.may_answer, self.is_asked = threading.Event(), threading.Event()
        self._server = kind(self._answer)
        is_door = isinstance(self._server, DoorServer)
        link = open_door(self._server.name, 10_000) if is_door else None
        self.connection = Connection(self._server.address, b"", link)

    def _answer(self, request: Request, count: int) -> list[Reply]:
        self.is_asked.set()
        self.may_answer.wait(60)
        return [Reply(protocol_version=1, request_id=request.request_id)]

    def stop(self) -> None:
        self.connection.close()
        self.may_answer.set()
        self._server.stop()


@pytest.fixture(params=[SocketServer, DoorServer])
def server(request: pytest.FixtureRequest) -> Iterator[Server]:
    server = Server(request.param)
    yield server
    server.stop()


def run(call) -> tuple[threading.Thread, list]:
    results: list = []
    thread = threading.Thread(target=lambda: results.append(call()))
    thread.start()
    return thread, results


def test_a_second_thread_is_refused_while_the_first_one_waits(server: Server) -> None:
    connection = server.connection
    first, results = run(lambda: connection.call(hello(), bytearray(), 60_000))
    assert server.is_asked.wait(60)
    for call in (
        lambda: connection.send(hello(), bytearray(), 60_000),
        lambda: connection.call(hello(), bytearray(), 60_000),
        lambda: connection.receive(connection.next_id - 1),
    ):
        with pytest.raises(errors.FailedPreconditionError, match="another thread is in a call"):
            call()
    server.may_answer.set()
    first.join()
    assert [delivery.error for delivery in results] == [None]
    assert connection.call(hello(), bytearray(), 60_000).error is None  # and then it may


def test_an_environment_is_neither_stepped_nor_closed_by_a_second_thread(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_inside, may_go_on = threading.Event(), threading.Event()
    read = Connection._read

    def slow_read(connection: Connection) -> object:
        is_inside.set()
        may_go_on.wait(60)
        return read(connection)

    with client.make("HalfCheetah") as env, client.make("HalfCheetah") as twin:
        env.reset(seed=1)
        twin.reset(seed=1)
        monkeypatch.setattr(Connection, "_read", slow_read)
        first, results = run(lambda: env.step(np.ones(6)))
        assert is_inside.wait(60)
        for call in (lambda: env.step(np.ones(6)), env.reset, env.get_state, env.close):
            with pytest.raises(errors.FailedPreconditionError, match="another thread is in a call"):
                call()
        may_go_on.set()
        first.join()
        assert_same(results[0], twin.step(np.ones(6)))
        assert_same(env.step(np.zeros(6)), twin.step(np.zeros(6)))


def test_one_thread_may_send_and_another_one_receive_later(server: Server) -> None:
    connection = server.connection
    server.may_answer.set()
    sender, sent = run(lambda: connection.send(hello(), bytearray(), 60_000))
    sender.join()
    assert connection.receive(sent[0]).error is None
