"""Connects to the processes of a daemon: to each on its own port, or through the gateway."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from b4mrl import errors
from b4mrl.wire import limits
from b4mrl.wire.connection import Connection
from b4mrl.wire.door import open_door


class Routes:
    """Connects to the ports that the gateway's replies name.

    The gateway names a worker's local door to clients that seem to run on its machine. Where it
    does not open, as behind a tunnel, the worker's socket is used, without a word.

    If a port cannot be reached and the daemon has a relay, requests go through the gateway, which
    is slower; the first time, a RuntimeWarning says so.

    Args:
        endpoint: the gateway's address.
        capabilities: the daemon's capabilities, from the reply to Hello.
    """

    def __init__(self, endpoint: str, capabilities: Sequence[str]) -> None:
        self._endpoint = endpoint
        self._can_relay = "relay" in capabilities
        self._unreachable: set[str] = set()  # addresses that did not answer; not tried again
        self._has_warned = False

    def reach(self, port: Any, token: bytes = b"") -> Connection:
        """A connection to the process that listens on a Port of b4mrl.proto.

        UnavailableError: the process does not listen, and the daemon has no relay.
        """
        address = self._address_of(port)
        if address and address not in self._unreachable:
            door = open_door(port.door, limits.DIRECT_CONNECT_MS) if port.door else None
            if door is not None:
                return Connection(address, token, door)
            direct = Connection(address, token)
            # Without a relay, the first request waits for the connection until its deadline.
            if not self._can_relay or direct.await_handshake(limits.DIRECT_CONNECT_MS):
                return direct
            direct.close()
            self._unreachable.add(address)
        if not self._can_relay:
            raise errors.UnavailableError(
                "the daemon offers no port for this request; is its dataset worker running?"
            )
        self._warn(address)
        return Connection(self._endpoint, token, is_relayed=True)

    def _address_of(self, port: Any) -> str:
        """The address of a Port, on the gateway's host; "" if the process does not listen there."""
        kind, _, place = self._endpoint.partition("://")
        if kind == "ipc":
            return f"ipc://{port.ipc}" if port.ipc else ""
        return f"tcp://{place.rpartition(':')[0]}:{port.tcp}" if port.tcp else ""

    def _warn(self, address: str) -> None:
        if self._has_warned:
            return
        self._has_warned = True
        reason = (
            f"{address} does not answer within {limits.DIRECT_CONNECT_MS} ms"
            if address
            else "the daemon's other processes have no port of their own"
        )
        errors.warn(
            f"{reason}; requests go through {self._endpoint}, which makes each request slower"
        )
