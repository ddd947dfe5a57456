"""Sessions that are opened at a daemon, and those that cannot be."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import b4mrl
import pytest
from b4mrl import errors
from b4mrl.wire import limits
from b4mrl.wire.messages import Reply, Request

from servers import SocketServer
from waiting import await_true


def answer(request: Request) -> Reply:
    reply = Reply(protocol_version=limits.PROTOCOL_VERSION, request_id=request.request_id)
    getattr(reply, request.WhichOneof("payload")).SetInParent()
    if request.HasField("hello"):
        reply.hello.protocol_version = limits.PROTOCOL_VERSION
    return reply


@pytest.fixture
def start() -> Iterator[Callable[[Callable[[Reply], None]], SocketServer]]:
    """Starts a server whose replies a function changes before they are sent."""
    servers = []

    def start_one(change: Callable[[Reply], None]) -> SocketServer:
        def changed(request: Request, count: int) -> list[Reply]:
            reply = answer(request)
            change(reply)
            return [reply]

        servers.append(SocketServer(changed))
        return servers[-1]

    yield start_one
    for server in servers:
        server.stop()


def test_a_server_of_another_version_is_named(start) -> None:
    def other_version(reply: Reply) -> None:
        reply.hello.protocol_version = limits.PROTOCOL_VERSION + 1

    server = start(other_version)
    with pytest.raises(
        errors.VersionMismatchError, match=f"^{server.address}: .* protocol 2, .* 1"
    ):
        b4mrl.connect(server.address)


def test_a_session_that_does_not_fit_what_was_opened_is_given_back(start) -> None:
    def more_lanes(reply: Reply) -> None:
        if reply.HasField("open"):
            reply.open.num_envs = 7

    server = start(more_lanes)
    with b4mrl.connect(server.address) as client:
        with pytest.raises(errors.InternalError, match="does not fit what was opened"):
            client.make("HalfCheetah")
        assert await_true(lambda: server.requests[-1].HasField("close"))
    opened, closed = server.requests[-2:]
    assert opened.HasField("open")
    assert opened.session_token == closed.session_token


def test_a_step_limit_that_is_refused_leaves_no_session() -> None:
    with b4mrl.serve(workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with pytest.raises(errors.InvalidArgumentError):
            client.make("Highway", max_episode_steps=10**8)
        assert await_true(lambda: client.server_status().session_count == 0)
