"""Requests about lanes, of which each kind with the same arrays repeats the same envelope."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from b4mrl.wire import arrays
from b4mrl.wire.arrays import Array
from b4mrl.wire.messages import Request

_Column = tuple[str, "np.dtype[Any]", tuple[int, ...]]  # an array's name, dtype and shape


def pack(kind: str, columns: Mapping[str, Array]) -> tuple[bytes, bytearray]:
    """The envelope and the payload of a request; raises the errors of arrays.pack.

    Args:
        kind: "step", "reset" or "restore": the request's payload message, which has no fields.
        columns: the request's arrays.
    """
    described = tuple((name, array.dtype, array.shape) for name, array in columns.items())
    envelope, gaps = _plan(kind, described)
    payload = bytearray()
    for gap, array in zip(gaps, columns.values()):
        payload += gap
        payload += array.tobytes()
    return envelope, payload


@functools.lru_cache(maxsize=64)
def _plan(kind: str, columns: tuple[_Column, ...]) -> tuple[bytes, tuple[bytes, ...]]:
    """The envelope, and the zeros before each array in the payload, which align it."""
    request = Request()
    getattr(request, kind).SetInParent()
    empty = {name: np.broadcast_to(np.zeros((), dtype), shape) for name, dtype, shape in columns}
    arrays.pack(empty, request.arrays)
    ends = [0, *(entry.offset + empty[entry.name].nbytes for entry in request.arrays)]
    gaps = tuple(bytes(entry.offset - end) for entry, end in zip(request.arrays, ends))
    return request.SerializeToString(), gaps
