"""The tables of arrays that one connection's replies have in common, read once and then recognised.

The envelope of a reply to Step or Reset ends with the table of its arrays and its empty payload
message, and these last bytes repeat from reply to reply. Protocol Buffers read two concatenated
messages as one message with the fields of both. So an envelope that ends with bytes which were
read as a table before, and whose other bytes are a message without arrays and payload, has exactly
that table. Every other envelope is read in full.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from b4mrl.wire import arrays
from b4mrl.wire.arrays import Array
from b4mrl.wire.messages import Reply

_MOST_LEARNT = 32  # a reset, a step, and steps that end one, two, three ... episodes
_LEARNT_PAYLOADS = ("step", "reset")  # messages without fields, so a reply is whole without them


class Table:
    """Where the arrays of a reply are in its payload. Does not change.

    InternalError: the entries do not fit the payload.

    Args:
        entries: Reply.arrays.
        payload: the reply's payload.

    Attributes:
        places: name -> (shape, dtype, offset in bytes) of each array.
        size: smallest number of bytes of a payload with these arrays.
    """

    __slots__ = ("places", "size")

    def __init__(self, entries: Sequence[Any], payload: bytearray) -> None:
        views = arrays.unpack(entries, payload)
        offsets = {entry.name: entry.offset for entry in entries}
        self.places = {
            name: (view.shape, view.dtype, offsets[name]) for name, view in views.items()
        }
        self.size = max((offsets[name] + it.nbytes for name, it in views.items()), default=0)

    def unpack(self, payload: bytearray) -> dict[str, Array]:
        """The arrays, as writable views of a payload of at least `size` bytes."""
        return {
            name: np.ndarray(shape, dtype, payload, offset)
            for name, (shape, dtype, offset) in self.places.items()
        }


class Tables:
    """The tables of a connection's latest replies to Step and Reset.

    Thread rule: one thread at a time.
    """

    def __init__(self) -> None:
        self._learnt: list[tuple[bytes, Table]] = []  # last bytes of envelopes; latest learnt first

    def read(self, envelope: bytes, payload: bytearray) -> tuple[Any, Table | None]:
        """The Reply of an envelope, and its table if it was learnt; DecodeError: it is no Reply.

        With a learnt table, the Reply lacks its arrays and its payload message.
        """
        for tail, table in self._learnt:
            if envelope.endswith(tail) and len(payload) >= table.size:
                head = _head(envelope[: -len(tail)])
                if head is not None:
                    return head, table
        return Reply.FromString(envelope), None

    def learn(self, envelope: bytes, reply: Any, payload: bytearray) -> Table:
        """The table of a reply that was read in full; InternalError: it does not fit its payload.

        It is learnt if the reply's last bytes are its arrays and an empty payload message.
        """
        table = Table(reply.arrays, payload)
        kind = reply.WhichOneof("payload")
        if kind in _LEARNT_PAYLOADS:
            rest = Reply(arrays=reply.arrays)
            getattr(rest, kind).SetInParent()
            tail = rest.SerializeToString()
            if envelope.endswith(tail):
                self._learnt = [(tail, table), *self._learnt[: _MOST_LEARNT - 1]]
        return table


def _head(envelope: bytes) -> Any:
    """The Reply without arrays and payload message in the bytes, or None if they are none."""
    try:
        head = Reply.FromString(envelope)
    except DecodeError:
        return None
    return None if head.arrays or head.WhichOneof("payload") is not None else head
