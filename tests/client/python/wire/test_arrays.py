"""Arrays in messages: what goes out comes in, and what does not fit is refused."""

from __future__ import annotations

import numpy as np
import pytest
from b4mrl.errors import InternalError
from b4mrl.wire import arrays
from b4mrl.wire.messages import Reply


def test_arrays_of_every_dtype_and_shape_come_back_as_they_were() -> None:
    given = {
        f"{dtype.name}{shape}": np.arange(np.prod(shape)).reshape(shape).astype(dtype)
        for dtype in arrays._DTYPES.values()
        for shape in [(), (0,), (3,), (2, 5), (2, 1, 3)]
    }
    reply = Reply()
    payload = arrays.pack(given, reply.arrays)
    assert all(entry.offset % 64 == 0 for entry in reply.arrays)
    for name, array in arrays.unpack(reply.arrays, payload).items():
        assert array.dtype == given[name].dtype
        np.testing.assert_array_equal(array, given[name])


def test_an_array_that_is_not_contiguous_travels_in_row_major_order() -> None:
    given = np.arange(12.0).reshape(3, 4).T[::2]
    reply = Reply()
    payload = arrays.pack({"a": given}, reply.arrays)
    np.testing.assert_array_equal(arrays.unpack(reply.arrays, payload)["a"], given)


@pytest.mark.parametrize(
    "entry",
    [
        {"dtype": 1, "shape": [9], "offset": 0},
        {"dtype": 1, "shape": [1], "offset": 64},
        {"dtype": 1, "shape": [1], "offset": 4},
        {"dtype": 1, "shape": [2**63, 2**63], "offset": 0},
        {"dtype": 1, "shape": [2**63, 0], "offset": 0},
        {"dtype": 8, "shape": [1], "offset": 0},
        {"dtype": 1, "shape": [1] * 9, "offset": 0},
    ],
)
def test_a_table_that_does_not_fit_its_payload_is_refused(entry: dict) -> None:
    reply = Reply()
    reply.arrays.add(name="a", **entry)
    with pytest.raises(InternalError, match="unreadable reply"):
        arrays.unpack(reply.arrays, bytearray(32))


@pytest.mark.parametrize("shape", [(3,), (2, 3), (None, 3), (2, None, 1)])
def test_an_array_of_another_shape_is_refused(shape: tuple) -> None:
    found = {"a": np.zeros((2, 4), np.float32)}
    arrays.require(found, "a", "float32", (2, 4))
    arrays.require(found, "a", "float32", (None, 4))
    with pytest.raises(InternalError, match="unreadable reply"):
        arrays.require(found, "a", "float32", shape)


def test_an_array_of_another_dtype_or_none_at_all_is_refused() -> None:
    found = {"a": np.zeros(2, np.float32)}
    with pytest.raises(InternalError):
        arrays.require(found, "a", "float64", (2,))
    with pytest.raises(InternalError):
        arrays.require(found, "b", "float32", (2,))
