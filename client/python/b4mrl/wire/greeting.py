"""The beginning of a connection to a daemon's gateway."""

from __future__ import annotations

import os
from typing import Any

from b4mrl import errors
from b4mrl.wire import limits
from b4mrl.wire.connection import Connection
from b4mrl.wire.messages import Request


def greet(
    endpoint: str, client_name: str, reach_ms: float, deadline_ms: float
) -> tuple[Connection, Any]:
    """Connects to the gateway at `endpoint`: the connection, and the gateway's reply to Hello.

    Args:
        client_name: free text that names the client.
        reach_ms: wait for the connection, in milliseconds.
        deadline_ms: time limit of the Hello, in milliseconds.

    Raises:
        UnavailableError: no daemon answers at `endpoint`.
        VersionMismatchError: the daemon speaks another version of the protocol.
    """
    gateway = Connection(endpoint)
    try:
        if not gateway.await_handshake(reach_ms):
            raise errors.UnavailableError(
                f"nobody answers at {_described(endpoint)} within {reach_ms / 1000:g} s: is the "
                "daemon running? `b4mrl serve` starts one, b4mrl.serve() a private one, whose "
                "address in a saved spec or a pickle holds until it ends",
                recoverable=True,
            )
        request = Request()
        request.hello.client = client_name
        hello = gateway.call(request, bytearray(), deadline_ms).reply.hello
        if hello.protocol_version != limits.PROTOCOL_VERSION:
            raise errors.VersionMismatchError(
                f"{_described(endpoint)}: the server speaks protocol {hello.protocol_version}, "
                f"this client {limits.PROTOCOL_VERSION}"
            )
    except BaseException:
        gateway.close()
        raise
    return gateway, hello


def _described(endpoint: str) -> str:
    """The address, and where it is from if the caller need not have written it."""
    is_found = endpoint == os.environ.get("B4MRL_ENDPOINT")
    return f"{endpoint} (from B4MRL_ENDPOINT)" if is_found else endpoint
