"""The fields that all requests have in common, written without a message object for each."""

from __future__ import annotations

import functools

from b4mrl.wire import limits
from b4mrl.wire.messages import Request


class Heads:
    """The heads of one connection's requests: version, token, id and deadline.

    Protocol Buffers read two concatenated messages as one message with the fields of both, so a
    head is put before a Request that lacks these fields.

    Args:
        token: the session's 16 bytes, or b"" for requests that belong to no session.
    """

    def __init__(self, token: bytes) -> None:
        common = Request(protocol_version=limits.PROTOCOL_VERSION, session_token=token)
        self._common: bytes = common.SerializeToString() + _tag("request_id")

    def of(self, request_id: int, deadline_ms: int) -> bytes:
        """The head of one request; both numbers are above 0."""
        return self._common + varint(request_id) + _deadline(deadline_ms)


def varint(number: int) -> bytes:
    """A whole number from 0 on as Protocol Buffers encode it: 7 bits a byte, lowest first."""
    if number < 0x80:
        return bytes((number,))
    digits = bytearray()
    while number >= 0x80:
        digits.append(number & 0x7F | 0x80)
        number >>= 7
    digits.append(number)
    return bytes(digits)


def _tag(field: str) -> bytes:
    """The tag of a field of Request that holds a number; the wire type of numbers is 0."""
    return varint(Request.DESCRIPTOR.fields_by_name[field].number << 3)


@functools.lru_cache(maxsize=16)  # a program uses few deadlines
def _deadline(deadline_ms: int) -> bytes:
    return _tag("deadline_ms") + varint(deadline_ms)
