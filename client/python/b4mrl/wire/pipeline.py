"""Several requests of one long read or query under way at once."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from typing import Any

from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery


def replies_to(connection: Connection, sent: Iterator[int], in_flight: int) -> Iterator[Delivery]:
    """Yields the replies to requests in the order of sending. Raises the daemon's errors.

    The first requests are sent at once, before the caller asks for a reply. Drops the requests that
    are in flight when the caller stops.

    Args:
        sent: sends the next request and yields its id.
        in_flight: number of requests that are sent before the first reply is awaited.
    """
    replies = _replies_to(connection, sent, in_flight)
    next(replies)
    return replies


def _replies_to(connection: Connection, sent: Iterator[int], in_flight: int) -> Iterator[Any]:
    """Yields None once the first requests are sent, and then their replies."""
    under_way: deque[int] = deque()
    try:
        under_way.extend(itertools.islice(sent, in_flight))
        yield None
        while under_way:
            delivery = connection.reply_to(under_way[0])
            under_way.popleft()
            yield delivery
            under_way.extend(itertools.islice(sent, in_flight - len(under_way)))
    finally:
        for request_id in under_way:
            connection.abandon(request_id)
