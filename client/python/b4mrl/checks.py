"""Checks of arguments, with errors in the words of the server's own."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from b4mrl.arrays import Array
from b4mrl.errors import InvalidArgumentError


def unsigned(name: str, value: Any, bits: int = 64) -> int:
    """`value` as an int of 0..2**bits - 1."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if not 0 <= number < 2**bits:
        raise InvalidArgumentError(f"{name} is {value!r}, allowed: 0..{2**bits - 1}")
    return number


def action_rows(actions: ArrayLike, count: int, shape: tuple[int, ...]) -> Array:
    """Actions of `count` lanes as (count, size), float32 if they are that and float64 otherwise."""
    given = np.asarray(actions)
    if given.shape != (count, *shape):
        raise InvalidArgumentError(f"actions have shape {given.shape}, allowed: {(count, *shape)}")
    if given.dtype != np.float32:
        try:
            given = given.astype(np.float64, copy=False)
        except (TypeError, ValueError):
            raise InvalidArgumentError(
                f"actions have dtype {given.dtype}, allowed: numbers"
            ) from None
    return given.reshape(count, -1)
