"""Resending, deadlines and giving up, against a server that does what the test says."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from b4mrl import errors
from b4mrl.wire.connection import Connection
from b4mrl.wire.door import open_door
from b4mrl.wire.messages import Reply, Request

from servers import DoorServer, SocketServer


Server = SocketServer | DoorServer


@pytest.fixture(params=[SocketServer, DoorServer])
def start(request: pytest.FixtureRequest) -> Iterator[Callable[..., Server]]:
    servers: list[Server] = []

    def start_server(*arguments: Any) -> Server:
        servers.append(request.param(*arguments))
        return servers[-1]

    yield start_server
    for server in servers:
        server.stop()


@pytest.fixture
def connect() -> Iterator[Callable[..., Connection]]:
    connections: list[Connection] = []

    def open_connection(server: Server | str, token: bytes = b"") -> Connection:
        address = server if isinstance(server, str) else server.address
        link = open_door(server.name, 10_000) if isinstance(server, DoorServer) else None
        connections.append(Connection(address, token, link))
        assert isinstance(server, DoorServer) == (connections[-1].transport == "door")
        return connections[-1]

    yield open_connection
    for connection in connections:
        connection.close()


def done(request: Request) -> Reply:
    return Reply(protocol_version=1, request_id=request.request_id)


def refusal(request: Request, code: int, recoverable: bool = False) -> Reply:
    reply = done(request)
    reply.status.code, reply.status.message, reply.status.recoverable = code, "no", recoverable
    return reply


def hello() -> Request:
    request = Request()
    request.hello.client = "test"
    return request


def test_a_request_carries_version_token_id_and_remaining_time(start, connect) -> None:
    server = start(lambda request, count: [done(request)])
    connection = connect(server, b"0123456789abcdef")
    connection.call(hello(), bytearray(), 5000)
    connection.call(hello(), bytearray(), 5000)
    first, second = server.requests
    assert first.protocol_version == 1
    assert first.session_token == b"0123456789abcdef"
    assert first.request_id != second.request_id
    assert 4000 < first.deadline_ms <= 5000
    assert first.hello.client == "test"


def test_silence_makes_it_ask_again_with_the_same_id_and_less_time(start, connect) -> None:
    server = start(lambda request, count: [done(request)] if count == 2 else [])
    # Asked again after one second; a busy machine may take some of the others.
    connect(server).call(hello(), bytearray(), 8000)
    first, second = server.requests[:2]  # a slow machine may have asked once more
    assert second.request_id == first.request_id
    assert second.deadline_ms < first.deadline_ms


def test_a_request_is_not_sent_again_while_earlier_ones_are_answered(start, connect) -> None:
    deadline_ms = 8000
    patience = deadline_ms / 8 / 1000
    held: list[Request] = []

    def answer(request: Request, count: int) -> list[Reply]:
        if request.hello.client == "held":
            held.append(request)
            return []
        return (
            [done(held.pop(0)), done(request)]
            if request.hello.client == "next"
            else [done(request)]
        )

    connection = connect(start(answer))
    later = hello()
    request = hello()
    request.hello.client = "held"
    earlier = [connection.send(request, bytearray(), 600_000) for _ in range(6)]
    slow = connection.send(request, bytearray(), deadline_ms)
    request.hello.client = "next"
    longest_gap = 0.0
    answered = time.monotonic()
    for request_id in [*earlier, slow]:
        while time.monotonic() < answered + 0.3 * patience:
            connection.call(later, bytearray(), 600_000)
        following = connection.send(request, bytearray(), 600_000)
        assert connection.receive(request_id).error is None
        connection.receive(following)
        longest_gap = max(longest_gap, time.monotonic() - answered)
        answered = time.monotonic()
    # On a machine that stalls the test for that long, the silence was real.
    if longest_gap < patience:
        assert not held


def test_a_lost_request_is_sent_again_though_later_ones_are_answered(start, connect) -> None:
    lost: list[Request] = []

    def answer(request: Request, count: int) -> list[Reply]:
        if request.hello.client != "lost":
            return [done(request)]
        lost.append(request)
        return [done(request)] if len(lost) > 1 else []

    connection = connect(start(answer))
    request = hello()
    request.hello.client = "lost"
    request_id = connection.send(request, bytearray(), 8000)
    started = time.monotonic()
    while len(lost) < 2 and time.monotonic() < started + 6:
        connection.call(hello(), bytearray(), 600_000)
    assert len(lost) == 2
    assert connection.receive(request_id).error is None


def test_each_wait_before_it_asks_again_is_twice_as_long(start, connect) -> None:
    server = start(lambda request, count: [done(request)] if request.hello.client else [])
    connection = connect(server)
    connection.call(hello(), bytearray(), 60_000)
    silent = Request()
    silent.hello.SetInParent()
    request_id = connection.send(silent, bytearray(), 800)
    for asked in range(1, 3):
        assert isinstance(connection.await_any((request_id,)).error, TimeoutError)
        # Sent at once, and when an eighth, three and seven eighths of the deadline are over. A
        # machine that stalls the test delays copies, but makes no more of them.
        assert 2 * asked <= len(server.requests[1:]) <= 4 * asked
        connection.ask_again(request_id, 800)


def test_a_second_copy_of_a_reply_shows_that_later_ones_are_on_their_way(start, connect) -> None:
    """As where the first copies of large replies are still to be carried over a slow link."""
    answered: list[Request] = []
    held: list[Request] = []

    def answer(request: Request, count: int) -> list[Reply]:
        if request.hello.client == "held":
            held.append(request)
            return []
        answered.append(request)
        return [done(request), done(answered[0])]

    connection = connect(start(answer))
    connection.call(hello(), bytearray(), 600_000)
    request = hello()
    request.hello.client = "held"
    deadline_ms = 4000
    patience = deadline_ms / 8 / 1000
    started = heard = time.monotonic()
    connection.send(request, bytearray(), deadline_ms)
    longest_gap = 0.0
    while time.monotonic() < started + 2.5 * patience:
        connection.call(hello(), bytearray(), 600_000)  # the reply to a later one does not count
        longest_gap = max(longest_gap, time.monotonic() - heard)
        heard = time.monotonic()
    # On a machine that stalls the test for that long, the silence was real.
    if longest_gap < patience:
        assert len(held) == 1


def test_a_reconnection_makes_it_ask_again(start, connect) -> None:
    server = start(lambda request, count: [])
    connection = connect(server)
    # An eighth of it is longer than `receive` may take: the handshake alone can trigger the copy.
    request_id = connection.send(hello(), bytearray(), 600_000)
    waited = threading.Event()

    def replace() -> None:
        while not server.requests:
            waited.wait(0.005)
        server.stop()
        start(lambda request, count: [done(request)], server.place)

    replacement = threading.Thread(target=replace)
    replacement.start()
    started = time.monotonic()
    delivery = connection.receive(request_id)
    replacement.join()
    assert time.monotonic() - started < 60
    assert delivery.error is None
    assert connection.handshakes == 2


def test_replies_that_nobody_waits_for_are_dropped(start, connect) -> None:
    def answer(request: Request, count: int) -> list[Reply]:
        stranger = done(request)
        stranger.request_id += 1000
        return [stranger, done(request), done(request)]

    connection = connect(start(answer))
    for _ in range(3):
        request_id = connection.next_id
        delivery = connection.call(hello(), bytearray(), 60_000)
        assert delivery.request_id == delivery.reply.request_id == request_id
    # Neither the strangers nor the second copies are kept for anybody.
    assert not any(connection.is_in_flight(each) for each in range(2 * 1000))


def test_replies_come_in_any_order(start, connect) -> None:
    held: list[Request] = []

    def answer(request: Request, count: int) -> list[Reply]:
        held.append(request)
        return [done(item) for item in reversed(held)] if count == 3 else []

    connection = connect(start(answer))
    ids = [connection.send(hello(), bytearray(), 60_000) for _ in range(3)]
    assert connection.receive_any(ids).request_id == ids[2]
    assert connection.receive(ids[0]).request_id == ids[0]
    assert connection.receive(ids[1]).request_id == ids[1]


def test_no_answer_leaves_open_what_was_executed(start, connect) -> None:
    # The first answer shows that the server was reached, however busy the machine is.
    connection = connect(start(lambda request, count: [done(request)][count - 1 :]))
    connection.call(hello(), bytearray(), 20_000)
    delivery = connection.receive(connection.send(hello(), bytearray(), 200))
    assert isinstance(delivery.error, errors.DeadlineExceededError)
    assert delivery.executed is None and delivery.error.executed_unknown
    for part in ("hello", connection.address, "0.2 s", "deadline_ms"):
        assert part in str(delivery.error)


def test_a_request_that_got_no_answer_is_asked_for_again_by_its_old_id(start, connect) -> None:
    silent = threading.Event()
    server = start(lambda request, count: [] if silent.is_set() else [done(request)])
    connection = connect(server)
    connection.call(hello(), bytearray(), 60_000)
    silent.set()
    request_id = connection.send(hello(), bytearray(), 1)
    for _ in range(2):
        assert connection.await_any((request_id,)).executed is None
        connection.ask_again(request_id, 1)
    assert connection.await_any((request_id,)).executed is None
    silent.clear()
    connection.ask_again(request_id, 60_000)
    delivery = connection.await_any((request_id,))
    assert (delivery.error, delivery.executed, delivery.unsettled) == (None, True, None)
    assert {each.request_id for each in server.requests[1:]} == {request_id}
    connection.ask_again(request_id, 60_000)  # its outcome is here
    assert connection.receive(request_id) is delivery
    assert not connection.is_in_flight(request_id)


def test_a_server_that_is_not_there_or_does_not_speak_is_unavailable(connect) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        connection = connect(f"tcp://127.0.0.1:{port}")
        unreached = f":{port} cannot be reached within 0.2 s"
        with pytest.raises(errors.UnavailableError, match=unreached):
            connection.call(hello(), bytearray(), 200)
    with pytest.raises(errors.UnavailableError, match=f"nobody listens at tcp://.*:{port};"):
        connection.call(hello(), bytearray(), 200)


@pytest.mark.parametrize(
    ("code", "kind", "executed"),
    [
        (1, errors.InvalidArgumentError, False),
        (4, errors.BusyError, False),
        (5, errors.StaleError, None),
        (11, errors.SessionLostError, None),
        (77, errors.InternalError, None),
    ],
)
def test_a_refusal_is_its_exception_and_says_what_was_executed(
    start, connect, code, kind, executed
) -> None:
    connection = connect(start(lambda request, count: [refusal(request, code)]))
    delivery = connection.receive(connection.send(hello(), bytearray(), 5000))
    assert type(delivery.error) is kind
    assert delivery.executed is executed
    assert delivery.error.executed_unknown == (executed is None)


def test_a_passing_refusal_of_one_copy_leaves_the_other_open(start, connect) -> None:
    server = start(
        lambda request, count: [refusal(request, 4, recoverable=True)] if count == 2 else []
    )
    connection = connect(server)
    delivery = connection.receive(connection.send(hello(), bytearray(), 8000))
    assert isinstance(delivery.error, errors.BusyError)
    assert delivery.executed is None and delivery.error.executed_unknown
    assert not errors.BusyError("of a request that was sent once").executed_unknown


def test_noise_is_not_taken_for_an_answer(start, connect) -> None:
    class Noise:
        def SerializeToString(self) -> bytes:
            return b"\xff\xff\xff"

    server = start(lambda request, count: [Noise(), done(request)])
    connection = connect(server)
    request_id = connection.next_id
    delivery = connection.call(hello(), bytearray(), 60_000)
    assert (delivery.request_id, delivery.error, delivery.executed) == (request_id, None, True)
    assert len(server.requests) == 1  # the noise did not make it ask again


def test_an_envelope_beyond_the_limit_is_noise_too(connect) -> None:
    def endless(request: Request) -> Reply:
        reply = refusal(request, 4)
        reply.status.message = "x" * 65_536
        return reply

    server = SocketServer(lambda request, count: [endless(request), done(request)])
    try:
        delivery = connect(server).call(hello(), bytearray(), 60_000)
        assert (delivery.error, delivery.executed) == (None, True)
    finally:
        server.stop()


def test_requests_in_flight_are_bounded(start, connect) -> None:
    connection = connect(start(lambda request, count: []))
    for _ in range(64):
        connection.send(hello(), bytearray(), 60_000)
    for is_awaited in (False, True):
        with pytest.raises(errors.LimitExceededError):
            connection.send(hello(), bytearray(), 60_000, is_awaited=is_awaited)


def test_replies_that_are_kept_for_others_leave_room_for_a_call(start, connect) -> None:
    connection = connect(start(lambda request, count: [done(request)]))
    ids = [connection.send(hello(), bytearray(), 60_000) for _ in range(64)]
    for request_id in ids:
        connection.await_any((request_id,))  # and keeps it
    with pytest.raises(errors.LimitExceededError):
        connection.send(hello(), bytearray(), 60_000)
    connection.call(hello(), bytearray(), 60_000)
    assert all(connection.receive(each).error is None for each in ids)


def test_an_endless_envelope_is_refused_here(start, connect) -> None:
    connection = connect(start(lambda request, count: []))
    request = hello()
    request.hello.client = "x" * 65536
    # Not LimitExceededError, upon which a caller tries again later.
    with pytest.raises(errors.InvalidArgumentError, match="allowed: at most 65472$"):
        connection.send(request, bytearray(), 1000)


def test_ipv6_is_refused_by_name() -> None:
    with pytest.raises(errors.InvalidArgumentError, match="do not speak IPv6"):
        Connection("tcp://[::1]:7700")


@pytest.mark.parametrize("address", ["nonsense", "tcp://", "udp://127.0.0.1:1", "", 7700, None])
def test_an_address_that_is_none_is_refused(address: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="address"):
        Connection(address)
