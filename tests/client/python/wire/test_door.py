"""The local door, against a worker's side that does what the test says."""

from __future__ import annotations

import errno
import gc
import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from b4mrl import errors
from b4mrl.wire import link as links
from b4mrl.wire.connection import Connection
from b4mrl.wire.door import Door, open_door
from b4mrl.wire.messages import Reply, Request

from servers import RING_BYTES, Answer, DoorServer, SocketServer, greeting, listen, make_memory
from waiting import await_true, descriptor_count

WAIT_MS = 10_000  # for a server on a busy machine


@pytest.fixture
def start() -> Iterator[Callable[[Answer], DoorServer]]:
    servers: list[DoorServer] = []

    def start_server(*arguments: object) -> DoorServer:
        servers.append(DoorServer(*arguments))
        return servers[-1]

    yield start_server
    for server in servers:
        server.stop()


def echo(request: Request, count: int) -> list[Reply]:
    """The server sends a request's payload back with each reply."""
    return [Reply(protocol_version=1, request_id=request.request_id)]


def come_in(server: DoorServer) -> Door:
    door = open_door(server.name, WAIT_MS)
    assert door is not None
    return door


def receive(door: Door) -> links.Message:
    finish = time.monotonic() + WAIT_MS / 1000
    while time.monotonic() < finish:
        message = door.receive(links.LONGEST_BLOCK_MS)
        if message is not None:
            return message
    raise TimeoutError


def await_requests(server: DoorServer, count: int) -> None:
    assert await_true(lambda: len(server.requests) >= count)
    assert len(server.requests) == count


def hello(request_id: int = 0) -> bytes:
    request = Request(request_id=request_id)
    request.hello.client = "test"
    return request.SerializeToString()


def test_messages_of_all_sizes_go_both_ways(start) -> None:
    server = start(echo)
    door = come_in(server)
    draws = random.Random(3)
    for number in range(1, 500):
        payload = bytearray(draws.randbytes(int(2 ** draws.uniform(0, 18 if number % 20 else 21))))
        assert door.send(hello(number), payload)
        envelope, echoed = receive(door)
        assert Reply.FromString(envelope).request_id == number
        assert echoed == payload
    assert server.lost_bells == 0
    door.close()


def test_messages_that_fill_the_ring_are_sent_on_while_replies_are_awaited(start) -> None:
    server = start(echo)
    door = come_in(server)
    payloads = [bytearray([number]) * RING_BYTES for number in range(1, 60)]
    for number, payload in enumerate(payloads, 1):
        assert door.send(hello(number), payload)
    assert [receive(door)[1] for _ in payloads] == payloads
    assert server.lost_bells == 0
    door.close()


def test_a_queue_that_nobody_empties_is_full_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "LONGEST_BLOCK_MS", 1)
    name, listener = listen()
    greeter = threading.Thread(target=greet_once, args=(listener,))
    greeter.start()
    door = open_door(name, WAIT_MS)
    assert door is not None
    monkeypatch.setattr("b4mrl.wire.door.LONGEST_BLOCK_MS", 0)
    sent = 0
    while door.send(b"", bytearray(RING_BYTES)):
        sent += 1
    assert sent == 1000
    door.close()
    greeter.join()
    listener.close()


def greet_once(listener: socket.socket, with_memory: bool = True, text: bytes = b"") -> None:
    """Lets one client in, and waits for its end."""
    guest, _ = listener.accept()
    descriptor = make_memory()
    if with_memory:
        socket.send_fds(guest, [text or greeting()], [descriptor])
    else:
        guest.send(text or greeting())
    os.close(descriptor)
    guest.recv(1)
    guest.close()


@pytest.mark.parametrize(
    ("text", "with_memory"),
    [
        (greeting(magic=1), True),
        (greeting(version=2), True),
        (greeting(up_bytes=2 * RING_BYTES), True),  # not the memory's size
        (greeting(down_bytes=RING_BYTES + 64), True),
        (greeting(up_bytes=32 * 1024, down_bytes=96 * 1024), True),
        (greeting(up_bytes=0), True),
        (greeting()[:-1], True),
        (greeting() + b"\0", True),
        (b"?", True),
        (greeting(), False),
    ],
    ids=range(10),
)
def test_another_greeting_is_no_door(text: bytes, with_memory: bool) -> None:
    name, listener = listen()
    descriptors = descriptor_count()

    def greet() -> None:
        for _ in range(3):
            greet_once(listener, with_memory, text)

    greeter = threading.Thread(target=greet)
    greeter.start()
    assert open_door(name, WAIT_MS) is None
    greeter.join()
    gc.collect()
    assert await_true(lambda: descriptor_count() <= descriptors)
    listener.close()


@pytest.mark.parametrize("seals", [0, 2, 4, 6])
def test_memory_that_may_shrink_is_no_door(monkeypatch: pytest.MonkeyPatch, seals: int) -> None:
    name, listener = listen()
    monkeypatch.setattr(make_memory, "__defaults__", (seals,))
    greeter = threading.Thread(target=lambda: [greet_once(listener) for _ in range(3)])
    greeter.start()
    assert open_door(name, WAIT_MS) is None
    greeter.join()
    listener.close()


def test_a_door_that_is_not_there_or_does_not_open_is_none() -> None:
    assert open_door("b4mrl-test-nobody", WAIT_MS) is None
    assert open_door("x" * 200, WAIT_MS) is None
    name, listener = listen()
    began = time.monotonic()
    assert open_door(name, 50) is None  # nobody greets
    assert time.monotonic() - began < WAIT_MS / 1000
    listener.close()


def test_another_users_door_is_none(start, monkeypatch: pytest.MonkeyPatch) -> None:
    server = start(echo)
    monkeypatch.setattr("b4mrl.wire.door._is_trusted", lambda link: False)
    assert open_door(server.name, WAIT_MS) is None


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_a_door_behind_which_another_user_listens_is_refused() -> None:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.setuid(65534)
        name, _ = listen()
        os.write(writing, name.encode())
        signal.pause()
    try:
        door = Door(os.read(reading, 100).decode())
        door.connect(0)
        assert door.is_refused
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("head", [63, RING_BYTES + 64, 2**63])
def test_a_ring_whose_head_cannot_be_is_left_for_a_new_one(start, head: int) -> None:
    server = start(lambda request, count: echo(request, count)[: count - 1])
    connection = Connection(server.address, b"", come_in(server))
    request_id = connection.send(hello(), bytearray(), 60_000)
    await_requests(server, 1)
    server.guests[0].words[24] = head
    assert connection.receive(request_id).error is None
    assert (connection.transport, connection.handshakes) == ("door", 2)
    connection.close()


@pytest.mark.parametrize("tail", [1, RING_BYTES, 2**63])
def test_a_ring_whose_tail_cannot_be_is_left_for_a_new_one(start, tail: int) -> None:
    server = start(lambda request, count: echo(request, count)[: count - 1])
    connection = Connection(server.address, b"", come_in(server))
    first = connection.send(hello(), bytearray(), 60_000)
    await_requests(server, 1)
    server.guests[0].words[16] = tail
    second = connection.send(hello(), bytearray(), 60_000)
    assert connection.receive(first).error is None
    assert connection.receive(second).error is None
    assert (connection.transport, connection.handshakes) == ("door", 2)
    connection.close()


def test_a_worker_that_has_gone_for_good_is_sought_at_its_address(start) -> None:
    server = start(lambda request, count: [])
    successor = SocketServer(echo)
    connection = Connection(successor.address, b"", come_in(server))
    request_id = connection.send(hello(), bytearray(), 60_000)
    assert connection.transport == "door"
    server.stop()
    server.place[1].close()
    assert connection.receive(request_id).error is None
    assert (connection.transport, connection.handshakes) == ("tcp", 2)
    connection.close()
    successor.stop()


def test_what_a_worker_said_before_its_end_is_read(start) -> None:
    server = start(echo)
    door = come_in(server)
    door.send(hello(7), bytearray())
    await_requests(server, 1)
    server.stop()
    assert Reply.FromString(receive(door)[0]).request_id == 7
    door.close()


def test_a_forked_child_leaves_the_parents_door_alone(start) -> None:
    server = start(echo)
    connection = Connection(server.address, b"", come_in(server))
    child = os.fork()
    if child == 0:
        try:
            connection.send(hello(), bytearray(), 1000)
        except errors.FailedPreconditionError:
            connection.close()
            os._exit(0)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert connection.call(hello(), bytearray(), 60_000).error is None
    assert connection.handshakes == 1
    connection.close()


def test_collected_connections_leave_no_descriptor(start) -> None:
    server = start(echo)

    def use() -> None:
        assert Connection(server.address, b"", come_in(server)).call(hello(), bytearray(), 60_000)

    use()  # the server keeps what it had of its latest guest
    gc.collect()
    descriptors = descriptor_count()
    for _ in range(5):
        use()
    gc.collect()
    assert await_true(lambda: descriptor_count() <= descriptors)  # the server closes its side


def test_what_is_sent_before_the_greeting_arrives_after_it() -> None:
    place = listen()
    door = Door(place[0])
    door.connect(0)  # nobody greets yet
    assert not door.is_open and door.take_handshakes() == 1
    sent = 0
    while door.send(hello(sent + 1), bytearray()):
        sent += 1
    assert sent == 1000
    server = DoorServer(echo, place)
    for number in range(sent):
        assert Reply.FromString(receive(door)[0]).request_id == number + 1
    assert door.take_handshakes() == 0
    door.close()
    server.stop()


def test_an_interrupted_close_closes_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    name, listener = listen()
    greeter = threading.Thread(target=greet_once, args=(listener,))  # reads nothing
    greeter.start()
    door = open_door(name, WAIT_MS)
    assert door is not None and door.send(hello(), bytearray())
    monkeypatch.setattr("b4mrl.wire.door.time.sleep", interrupt)
    with pytest.raises(KeyboardInterrupt):
        door.close(WAIT_MS)
    assert not door.is_open
    greeter.join()
    listener.close()


def test_a_process_without_free_descriptors_finds_no_door(
    start, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    server = start(echo)
    monkeypatch.setattr("b4mrl.wire.door.socket.socket", refuse)
    assert open_door(server.name, WAIT_MS) is None


@pytest.mark.parametrize("place", ["_is_trusted", "_can_shrink"])
def test_an_alarm_in_the_handshake_is_not_taken_for_a_refusal(
    start, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    def ring(_: object) -> bool:
        raise TimeoutError

    server = start(echo)
    door = Door(server.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"b4mrl.wire.door.{place}", ring)
        with pytest.raises(TimeoutError):
            while not door.is_open and not door.is_refused:
                door.connect(WAIT_MS)
    assert not door.is_refused
    door.connect(WAIT_MS)  # not to the connection whose greeting is lost
    assert door.is_open
    door.close()
