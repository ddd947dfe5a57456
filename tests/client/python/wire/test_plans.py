"""Repeated envelopes of requests, against requests that are made anew."""

from __future__ import annotations

import numpy as np
import pytest
from b4mrl.errors import InvalidArgumentError
from b4mrl.wire import arrays, plans
from b4mrl.wire.messages import Request


def test_a_repeated_request_is_the_one_that_is_made_anew() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        n, kind = int(rng.integers(1, 4)), str(rng.choice(["step", "reset", "restore"]))
        dtype = rng.choice([np.float32, np.float64])
        columns = {
            "numbers": rng.integers(0, 2**64, n, np.uint64),
            "actions": rng.normal(size=(2 * n, 3))[::2].astype(dtype),
        }
        if rng.integers(0, 2):
            columns["lanes"] = np.arange(n, dtype=np.uint32)
        anew = Request()
        getattr(anew, kind).SetInParent()
        payload = arrays.pack(columns, anew.arrays)
        assert plans.pack(kind, columns) == (anew.SerializeToString(), payload)


def test_an_array_in_another_memory_order_travels_row_by_row() -> None:
    given = np.arange(6.0).reshape(2, 3)
    rows = plans.pack("step", {"actions": given})
    assert plans.pack("step", {"actions": np.asfortranarray(given)}) == rows


def test_arrays_above_the_limit_are_refused_each_time() -> None:
    endless = np.broadcast_to(np.zeros((), np.float64), (2**23 + 1,))
    for _ in range(2):
        with pytest.raises(InvalidArgumentError):
            plans.pack("restore", {"qpos": endless})
