"""The ways to the processes of a daemon: each on its own port, or through the gateway."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from b4mrl import errors
from b4mrl.wire import limits
from b4mrl.wire.connection import Connection


class Routes:
    """Connects to what the gateway's replies name.

    Where a port cannot be reached and the daemon has a relay, requests go through the gateway,
    which is slower; the first time that this happens, a RuntimeWarning says so.

    Args:
        endpoint: the gateway's.
        capabilities: of its Hello.
    """

    def __init__(self, endpoint: str, capabilities: Sequence[str]) -> None:
        self._endpoint = endpoint
        self._can_relay = "relay" in capabilities
        self._unreachable: set[str] = set()  # addresses that did not answer; not tried again
        self._has_warned = False

    def reach(self, port: Any, token: bytes = b"") -> Connection:
        """A connection to the process behind a Port.

        UnavailableError: it does not listen, and there is no relay.
        """
        address = self._address_of(port)
        if address and address not in self._unreachable:
            direct = Connection(address, token)
            # Without a relay, the first request waits as long as its deadline allows.
            if not self._can_relay or direct.await_handshake(limits.DIRECT_CONNECT_MS):
                return direct
            direct.close()
            self._unreachable.add(address)
        if not self._can_relay:
            raise errors.UnavailableError(
                "the server offers no port for this; is that part of it running?"
            )
        self._warn(address)
        return Connection(self._endpoint, token)

    def _address_of(self, port: Any) -> str:
        """On the host by which the gateway was reached; "" if the process does not listen there."""
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
            else "the server has no port of its own for this"
        )
        warnings.warn(
            f"{reason}; requests go through {self._endpoint}, which makes each of them slower",
            RuntimeWarning,
            stacklevel=2,
        )
