"""Dataclasses with arrays that can be compared and hashed."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


class Value:
    """A dataclass that equals another one of its class whose fields are equal, arrays included.

    Needs `@dataclass(frozen=True, eq=False)`: the methods of dataclasses fail for arrays. NaN
    equals nothing, as everywhere.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_is_same(mine, theirs) for mine, theirs in zip(_parts(self), _parts(other)))

    def __hash__(self) -> int:
        return hash(tuple(map(_hashable, _parts(self))))


def _parts(value: Any) -> list[Any]:
    return [getattr(value, field.name) for field in fields(value)]


def _is_same(mine: Any, theirs: Any) -> bool:
    if isinstance(mine, np.ndarray):
        return np.array_equal(mine, theirs)
    return bool(mine == theirs)


def _hashable(part: Any) -> Any:
    return tuple(part.ravel().tolist()) if isinstance(part, np.ndarray) else part
