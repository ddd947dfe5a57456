"""Checks of arguments that travel to the daemon; errors name the value and the allowed range."""

from __future__ import annotations

import contextlib
import operator
import os
import reprlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from b4mrl.errors import InvalidArgumentError
from b4mrl.wire.arrays import Array

# What numpy raises where something does not become an array: OverflowError for an integer beyond
# float64. RuntimeError is PyTorch's, of a tensor that requires grad, and says what is to be called.
NO_ARRAY = (TypeError, ValueError, RuntimeError, OverflowError)


def text(name: str, value: Any) -> str:
    """`value`. InvalidArgumentError: it is not a text that a message can hold."""
    try:
        if isinstance(value, str) and value.encode() is not None:
            return value
    except UnicodeEncodeError:
        pass
    raise InvalidArgumentError(f"{name} is {reprlib.repr(value)}, allowed: a text")


def path(name: str, value: Any) -> Path:
    """`value` as a Path. InvalidArgumentError: it names no file or folder, whatever is there."""
    try:
        given = os.fsdecode(value)
        os.fsencode(given)
    except (TypeError, UnicodeError):
        given = None
    if given is None or "\0" in given:
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, allowed: a path, as a text or a pathlib.Path"
        )
    return Path(given)


def mapping(name: str, value: Any, allowed: str) -> Mapping[str, Any]:
    """`value`. InvalidArgumentError: it is no dict with texts as keys; `allowed` says what is."""
    if not isinstance(value, Mapping):
        raise InvalidArgumentError(f"{name} is {reprlib.repr(value)}, allowed: {allowed}")
    for key in value:
        text(f"a name in {name}", key)
    return value


def array(name: str, value: Any, allowed: str, dtype: DTypeLike | None = None) -> Array:
    """`value` as an array. InvalidArgumentError: it cannot become one; `allowed` says what can."""
    try:
        return np.asarray(value) if dtype is None else real(value).astype(dtype, copy=False)
    except NO_ARRAY as error:
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, allowed: {allowed} ({error})"
        ) from error


def real(value: Any, copy: bool = False) -> Array:
    """`value` as an array, of its own memory with `copy`.

    TypeError: its numbers are complex, of which numpy would drop the imaginary parts. One of the
    other errors in NO_ARRAY: it cannot become an array.
    """
    given = np.array(value) if copy else np.asarray(value)
    if given.dtype.kind == "c":
        raise TypeError("complex numbers")
    return given


def numbers(name: str, value: Any) -> NDArray[np.float64]:
    """`value` as an array. InvalidArgumentError: it is neither a number nor an array of numbers."""
    allowed = "a number or an array of numbers"
    given = array(name, value, allowed)
    if given.dtype.kind not in "iuf":
        raise InvalidArgumentError(f"{name} is {reprlib.repr(value)}, allowed: {allowed}")
    return given.astype(np.float64)


def unsigned(name: str, value: Any, bits: int = 64) -> int:
    """`value` as an int. InvalidArgumentError: it is not an integer of 0..2**bits - 1."""
    return integer(name, value, 0, 2**bits - 1)


def integer(name: str, value: Any, low: int, high: int | None) -> int:
    """`value` as an int. InvalidArgumentError: it is not an integer of low..high (None: no end)."""
    try:
        number = operator.index(value)
    except TypeError:
        number = low - 1
    if number < low or (high is not None and number > high):
        allowed = f"of at least {low}" if high is None else f"in {low}..{high}"
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, allowed: an integer {allowed}"
        )
    return number


def row_slice(rows: Any, count: int) -> range:
    """The numbers of the rows that `rows` takes of `count` rows.

    InvalidArgumentError: it is no slice of whole numbers, or has a step.
    """
    try:
        chosen = range(*rows.indices(count))
    except (AttributeError, TypeError, ValueError):
        chosen = None
    if chosen is None or chosen.step != 1:
        raise InvalidArgumentError(
            f"the index is {rows!r}, allowed: a slice of rows without a step, dataset[5:6]; "
            "load() has all rows of each column, episodes() the episodes, stream() random batches"
        )
    return chosen


def deadline_ms(value: Any, default: float, name: str = "deadline_ms") -> float:
    """A deadline's milliseconds: `value`, or `default` for None.

    InvalidArgumentError: `value` is not a positive finite number.
    """
    return default if value is None else positive(name, value)


def positive(name: str, value: Any) -> float:
    """`value`. InvalidArgumentError: it is not a positive finite number."""
    is_number = isinstance(value, int | float | np.integer | np.floating)
    number = 0.0
    if is_number and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # an integer that is too large for a float
            number = float(value)
    if not 0 < number <= sys.float_info.max:
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, allowed: a finite number above 0"
        )
    return number


def action_row(action: ArrayLike, shape: tuple[int, ...]) -> Array:
    """One environment's action as (1, size), float32 if it is float32 and float64 otherwise."""
    return _actions("action", action, shape).reshape(1, -1)


def action_rows(actions: ArrayLike, count: int, shape: tuple[int, ...]) -> Array:
    """The actions of `count` lanes as (count, size), float32 if they are and float64 otherwise."""
    return _actions("actions", actions, (count, *shape)).reshape(count, -1)


def _actions(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    allowed = f"allowed: numbers of shape {shape}"
    try:
        given = real(value)
        if given.dtype != np.float32:
            given = given.astype(np.float64, copy=False)
    except NO_ARRAY as error:
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, {allowed} ({error})"
        ) from error
    if given.shape != shape:
        what = f"has shape {given.shape}" if given.ndim else f"is {reprlib.repr(value)}"
        raise InvalidArgumentError(f"{name} {what}, {allowed}")
    return given
