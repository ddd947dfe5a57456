"""The arrays of a message: raw little-endian numbers in its second frame, the payload.

The first frame has a table with each array's name, dtype, shape and offset in the payload. Arrays
are row-major. A received table that does not fit its payload raises an InternalError.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl.errors import InternalError, InvalidArgumentError
from b4mrl.wire import limits

Array = NDArray[Any]

# Number of DType in b4mrl.proto -> numpy dtype.
_DTYPES: dict[int, np.dtype[Any]] = {
    1: np.dtype("<f4"),
    2: np.dtype("<f8"),
    3: np.dtype("<i4"),
    4: np.dtype("<i8"),
    5: np.dtype("u1"),
    6: np.dtype("<u4"),
    7: np.dtype("<u8"),
}
_NUMBERS = {dtype: number for number, dtype in _DTYPES.items()}


def dtype_number(dtype: np.dtype[Any]) -> int:
    """The DType number of a numpy dtype. KeyError: messages cannot have this dtype."""
    return _NUMBERS[dtype]


def dtype_of(number: int) -> np.dtype[Any]:
    """The numpy dtype of a DType number that dtype_number returned."""
    return _DTYPES[number]


def rows_that_fit(row_bytes: int, payload_bytes: int = limits.MAX_PAYLOAD_BYTES) -> int:
    """The largest number of rows, of that many bytes in all arrays, that a payload can hold."""
    padding = limits.MAX_ARRAYS_PER_MESSAGE * limits.ARRAY_ALIGNMENT
    return (payload_bytes - padding) // row_bytes


def pack(arrays: Mapping[str, Array], table: Any) -> bytearray:
    """Returns a payload with `arrays` and appends their entries to `table` (Request.arrays).

    Arrays may have any memory order, and a dtype that DType has. InvalidArgumentError: the arrays
    take more than 64 MiB.
    """
    offsets = []
    end = 0
    for name, array in arrays.items():
        start = -(-end // limits.ARRAY_ALIGNMENT) * limits.ARRAY_ALIGNMENT
        table.add(name=name, dtype=_NUMBERS[array.dtype], shape=array.shape, offset=start)
        offsets.append(start)
        end = start + array.nbytes
    if end > limits.MAX_PAYLOAD_BYTES:
        raise InvalidArgumentError(
            f"the arrays have {end} bytes, allowed: at most {limits.MAX_PAYLOAD_BYTES}"
        )
    payload = bytearray(end)
    for start, array in zip(offsets, arrays.values()):
        np.ndarray(array.shape, array.dtype, payload, start)[...] = array
    return payload


def unpack(table: Sequence[Any], payload: bytearray) -> dict[str, Array]:
    """The arrays in `table` (Reply.arrays), as writable views of `payload`."""
    arrays = {}
    for entry in table:
        dtype = _DTYPES.get(entry.dtype)
        shape = tuple(entry.shape)
        if dtype is None or len(shape) > limits.MAX_ARRAY_DIMENSIONS:
            raise InternalError(f"unreadable reply: array {entry.name!r} of an unknown kind")
        end = entry.offset + math.prod(shape) * dtype.itemsize
        if entry.offset % limits.ARRAY_ALIGNMENT or end > len(payload):
            raise InternalError(
                f"unreadable reply: array {entry.name!r} ends at byte {end} of {len(payload)}"
            )
        try:
            arrays[entry.name] = np.ndarray(shape, dtype, payload, entry.offset)
        except ValueError as error:  # an empty array with an extent that numpy cannot hold
            raise InternalError(f"unreadable reply: array {entry.name!r}: {error}") from error
    return arrays


def require(
    arrays: Mapping[str, Array],
    name: str,
    dtype: str | np.dtype[Any],
    shape: tuple[int | None, ...],
) -> Array:
    """The array `name`, which must have `dtype` and `shape`; None in `shape` fits any extent.

    InternalError: the reply lacks the array, or it has another dtype or shape.
    """
    array = arrays.get(name)
    if array is None:
        raise InternalError(f"unreadable reply: no array {name!r}")
    fits = array.dtype == dtype and len(array.shape) == len(shape)
    if not fits or any(want not in (None, have) for want, have in zip(shape, array.shape)):
        raise InternalError(
            f"unreadable reply: array {name!r} is {array.dtype}{array.shape}, not {dtype}{shape}"
        )
    return array


def put_rows(whole: dict[str, Array], part: dict[str, Array], position: int, rows: int) -> None:
    """Copies the rows of `part` to `position` of `whole`; makes missing columns of `rows` rows."""
    for name, column in part.items():
        if name not in whole:
            whole[name] = np.empty((rows, *column.shape[1:]), column.dtype)
        whole[name][position : position + len(column)] = column


def joined(parts: list[dict[str, Array]]) -> dict[str, Array]:
    """The rows of `parts`, which have the same columns, one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def episodes_in(
    parts: Generator[tuple[int, dict[str, Array]], None, None],
) -> Generator[tuple[dict[str, Array], int], None, None]:
    """Yields the episodes in `parts`, each with the number of the row behind it.

    Args:
        parts: rows that follow one another, from the first one of an episode on: (number of a
            part's first row, its rows). Closed with this generator.
    """
    rest: list[dict[str, Array]] = []  # rows of an episode whose end is in a later part
    behind = 0
    with contextlib.closing(parts):
        for start, part in parts:
            ends = np.flatnonzero(part["terminals"] | part["timeouts"]) + 1
            first = 0
            for end in ends.tolist():
                rest.append({name: column[first:end] for name, column in part.items()})
                yield joined(rest), start + end
                rest, first = [], end
            count = len(part["rewards"])
            if first < count:
                rest.append({name: column[first:] for name, column in part.items()})
            behind = start + count
    if rest:
        yield joined(rest), behind
