"""Heads of requests, against those that Protocol Buffers write."""

from __future__ import annotations

import pytest
from b4mrl.wire import limits
from b4mrl.wire.heads import Heads
from b4mrl.wire.messages import Request

EDGES = [1, 127, 128, 16383, 16384, 2**21 - 1, 2**21, 2**31]


@pytest.mark.parametrize("token", [b"", bytes(range(16))])
@pytest.mark.parametrize("request_id", [*EDGES, 2**63, 2**64 - 1])
@pytest.mark.parametrize("deadline_ms", [*EDGES, limits.MAX_DEADLINE_MS])
def test_a_head_is_that_of_a_request_message(
    token: bytes, request_id: int, deadline_ms: int
) -> None:
    request = Request(
        protocol_version=limits.PROTOCOL_VERSION,
        session_token=token,
        request_id=request_id,
        deadline_ms=deadline_ms,
    )
    assert Heads(token).of(request_id, deadline_ms) == request.SerializeToString()
