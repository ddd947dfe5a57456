"""Makes Gymnasium's info dictionaries from the columns of numbers in replies.

A column's name says where its number belongs: "x_position" is a key; "tendon_length[1]" is the
second entry of an array; "rewards.collision_reward" is an entry of a dictionary in the dictionary.
Flags, which travel as numbers like everything else, become bools.

As in Gymnasium's vector environments, the dictionary of a batch has for every key `k` an array with
one entry for each environment, and a boolean mask `_k` of the environments that reported it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl.errors import InternalError
from b4mrl.wire.messages import CAUSES

Mask = NDArray[np.bool_]

CAUSE_NAMES = {value.number: value.name.lower() for value in CAUSES.values}
_FLAGS = frozenset({"crashed"})  # keys that are bools in the original tasks
_MOST_NESTED = 8  # dictionaries inside each other
_ENTRY = re.compile(r"(.*)\[\d+\]")

# Key -> number of its column, numbers of an array's columns, or items of a dictionary.
_Items = dict[str, "int | list[int] | _Items"]


def check_info_names(names: Iterable[str]) -> None:
    """InternalError: a server's names of columns make no dictionary."""
    kinds: dict[str, str] = {}
    for name in names:
        *folders, key = name.split(".")
        if len(folders) > _MOST_NESTED:
            raise InternalError(
                f"the server names an info {name[:80]!r}, which is nested too deeply"
            )
        places = [(".".join(folders[: i + 1]), "dictionary") for i in range(len(folders))]
        entry = _ENTRY.fullmatch(key)
        places.append(
            (".".join([*folders, entry[1] if entry else key]), "array" if entry else "number")
        )
        for place, kind in places:
            if kinds.setdefault(place, kind) != kind:
                raise InternalError(f"the server names an info {name[:80]!r} beside another kind")
    for place in kinds:
        *folders, key = place.split(".")
        if ".".join([*folders, "_" + key]) in kinds:
            raise InternalError(f"the server names an info {place[:80]!r} and its mask's")


class InfoLayout:
    """Where each column's number belongs in the dictionary.

    Args:
        names: names of the columns.
        reset_names: names of the columns that a reset reports; its dictionary lacks the others.
    """

    def __init__(self, names: Iterable[str], reset_names: Iterable[str]) -> None:
        columns = list(enumerate(names))
        reported = set(reset_names)
        self._flags = [name for _, name in columns if name in _FLAGS]
        self._step = _tree(columns)
        self._reset = _tree([(i, name) for i, name in columns if name in reported])

    def single(self, row: Sequence[float] | None, is_reset: bool) -> dict[str, Any]:
        """The dictionary of one environment from its (columns,) numbers."""
        if row is None:
            return {}
        infos = _read(self._reset if is_reset else self._step, row)
        for key in self._flags:
            if key in infos:
                infos[key] = bool(infos[key])
        return infos

    def batch(self, rows: NDArray[np.float64] | None, is_reset: Mask) -> dict[str, Any]:
        """The dictionary of a batch from (n, columns) numbers; `is_reset` (n,) marks resets."""
        infos: dict[str, Any] = {}
        if rows is None:
            return infos
        if not is_reset.any():
            infos = _columns(self._step, rows)
        else:
            if not is_reset.all():
                _merge(infos, self._step, rows, ~is_reset)
            _merge(infos, self._reset, rows, is_reset)
        for key in self._flags:
            if key in infos:
                infos[key] = infos[key].astype(np.bool_)
        return infos


def add_causes(infos: dict[str, Any], causes: NDArray[np.uint8]) -> None:
    """Adds the key "cause": why an episode ended, as a word, for environments whose episode did."""
    ended = causes != 0
    if ended.any():
        infos["cause"] = np.array(
            [cause_name(cause) if cause else None for cause in causes], object
        )
        infos["_cause"] = ended


def cause_name(cause: int) -> str:
    """The word for a cause of an episode's end; its number if this client knows no word for it."""
    return str(CAUSE_NAMES.get(int(cause), int(cause)))


def scatter(infos: dict[str, Any], positions: NDArray[np.uint32], count: int) -> dict[str, Any]:
    """Spreads the infos of m environments over `count`: entry i moves to positions[i].

    The other entries are zero or None, and their masks False.
    """
    wide: dict[str, Any] = {}
    for key, value in infos.items():
        if isinstance(value, dict):
            wide[key] = scatter(value, positions, count)
            continue
        empty = None if value.dtype == object else 0
        wide[key] = np.full((count, *value.shape[1:]), empty, value.dtype)
        wide[key][positions] = value
    return wide


def row_of(infos: dict[str, Any], position: int) -> dict[str, Any]:
    """The dictionary of the environment at `position` in a batch."""
    row = {}
    for key, value in infos.items():
        mask = infos.get("_" + key)
        if mask is None or not mask[position]:
            continue
        if isinstance(value, dict):
            row[key] = row_of(value, position)
        else:
            entry = value[position]
            row[key] = entry.item() if isinstance(entry, np.generic) else entry
    return row


def _tree(columns: list[tuple[int, str]]) -> _Items:
    tree: _Items = {}
    for column, name in columns:
        *path, key = name.split(".")
        items = tree
        for part in path:
            items = items.setdefault(part, {})  # type: ignore[assignment]
        entry = _ENTRY.fullmatch(key)
        if entry:
            items.setdefault(entry[1], []).append(column)  # type: ignore[union-attr]
        else:
            items[key] = column
    return tree


def _read(items: _Items, row: Sequence[float]) -> dict[str, Any]:
    infos: dict[str, Any] = {}
    for key, place in items.items():
        if isinstance(place, int):
            infos[key] = row[place]
        elif isinstance(place, dict):
            infos[key] = _read(place, row)
        else:
            infos[key] = np.array([row[column] for column in place])
    return infos


def _columns(items: _Items, rows: NDArray[np.float64]) -> dict[str, Any]:
    """The dictionary of a batch of which every environment reported `items`."""
    infos: dict[str, Any] = {}
    everyone = np.ones(len(rows), np.bool_)
    for key, place in items.items():
        infos[key] = _columns(place, rows) if isinstance(place, dict) else rows[:, place].copy()
        infos["_" + key] = everyone.copy()
    return infos


def _merge(infos: dict[str, Any], items: _Items, rows: NDArray[np.float64], reported: Mask) -> None:
    """Adds columns to `infos`, with numbers of the environments in the mask `reported` alone."""
    for key, place in items.items():
        if isinstance(place, dict):
            _merge(infos.setdefault(key, {}), place, rows, reported)
        else:
            shape = (len(rows),) if isinstance(place, int) else (len(rows), len(place))
            array = infos.setdefault(key, np.zeros(shape))
            array[reported] = rows[reported][:, place]
        mask = infos.setdefault("_" + key, np.zeros(len(rows), np.bool_))
        mask |= reported
