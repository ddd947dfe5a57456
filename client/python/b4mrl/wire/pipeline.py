"""Several requests of one long read or query under way at once."""

from __future__ import annotations

import itertools
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator
from typing import Any, TypeVar

from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery

T = TypeVar("T")


def replies_to(
    connection: Connection, sent: Iterator[int], in_flight: int
) -> Generator[Delivery, None, None]:
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


def _replies_to(
    connection: Connection, sent: Iterator[int], in_flight: int
) -> Generator[Any, None, None]:
    """Yields None once the first requests are sent, and then their replies."""
    under_way: deque[int] = deque()
    try:
        _send(connection, sent, in_flight, under_way)
        yield None
        while under_way:
            delivery = connection.reply_to(under_way[0])
            under_way.popleft()
            yield delivery
            _send(connection, sent, in_flight - len(under_way), under_way)
    finally:
        for request_id in under_way:
            connection.abandon(request_id)


def _send(connection: Connection, sent: Iterator[int], count: int, under_way: deque[int]) -> None:
    """Sends up to `count` requests, and adds their ids to `under_way`."""
    first = connection.next_id
    try:
        under_way.extend(itertools.islice(sent, count))
    except BaseException:
        # Ctrl-C may come while a request that the connection already keeps has told nobody its id.
        for request_id in range(first, connection.next_id):
            connection.abandon(request_id)
        raise


class Resumed(Iterator[T]):
    """An iterator that an exception does not end.

    A generator that has raised, be it by a deadline or by Ctrl-C, only ever raises StopIteration
    afterwards, which its reader takes for the end. After an exception, the next call of this
    iterator goes on with the item whose call has failed. Otherwise it is used like a generator:
    `close` or its collection drops what is under way. A forked child, which cannot receive what its
    parent has sent, goes on with the item that its parent would get next.

    Args:
        begin: makes a generator of the items from a position on, each with the position behind it.
            What an item is must depend on its position alone.
        position: of the first item.
    """

    def __init__(
        self, begin: Callable[[int], Generator[tuple[T, int], None, None]], position: int
    ) -> None:
        self._begin = begin
        self._position = position
        self._items: Generator[tuple[T, int], None, None] | None = None
        self._process_id = os.getpid()  # that has begun `_items`
        self._is_closed = False

    def __next__(self) -> T:
        if self._is_closed:
            raise StopIteration
        # Wherever an exception comes, the generator is not put back, and the next call begins anew.
        items, self._items = self._items, None
        if items is None or self._process_id != os.getpid():
            items, self._process_id = self._begin(self._position), os.getpid()
        item, position = next(items)
        self._position, self._items = position, items
        return item

    def close(self) -> None:
        """Drops what is under way; there are no more items. May be called again."""
        self._is_closed = True
        if self._items is not None:
            self._items.close()
