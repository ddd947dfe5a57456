"""States of environments as dictionaries: what get_state returns and set_state takes.

A MuJoCo state has `time`, `qpos`, `qvel` and `qacc_warmstart`; a Highway state has `time` and
`vehicles`, a list of dictionaries with the ego first. Beside these, `snapshot` holds all that an
exact continuation needs: random streams, delayed actions, the step within the episode.

set_state continues exactly while the readable parts are still those that came with the snapshot,
and otherwise goes by the parts: changing `qpos` changes the state. Of the parts, MuJoCo needs
`qpos` and `qvel`, Highway `vehicles`. A dictionary with `snapshot` alone is exact, too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from b4mrl.errors import InvalidArgumentError
from b4mrl.wire.arrays import Array

State = dict[str, Any]

# Columns of `vehicles` on the wire, one row a vehicle.
VEHICLE_COLUMNS = (
    "x",
    "y",
    "heading",
    "speed",
    "lane",
    "target_lane",
    "timer",
    "crashed",
    "impact_pending",
    "impact_x",
    "impact_y",
    "steering",
    "acceleration",
    "target_speed",
    "delta",
)
_WHOLE_NUMBERS = {"lane": int, "target_lane": int, "crashed": bool, "impact_pending": bool}

_SNAPSHOT = "snapshot"
# In front of the server's bytes: a check of the readable parts that they came with, and a byte that
# is 1 where the episode had ended.
_CHECK_BYTES = 16
_HEAD_BYTES = _CHECK_BYTES + 1


@dataclass(frozen=True)
class Restoration:
    """The arrays of one Restore.

    Attributes:
        positions: of its states in the list that was given.
        parts: what Session.restore takes, first axes the positions.
        ended: for each, whether it continues behind the end of its episode.
    """

    positions: list[int]
    parts: dict[str, Array]
    ended: list[bool]


def read_states(found: Mapping[str, Array], ended: Sequence[bool]) -> list[State]:
    """One state a lane from the arrays of a Snapshot; first axes the lanes, like `ended`."""
    states = []
    for lane, is_ended in enumerate(ended):
        parts = {name: rows[lane] for name, rows in found.items() if name != _SNAPSHOT}
        state: State = {name: _readable(name, values.copy()) for name, values in parts.items()}
        head = _fingerprint(parts) + bytes([bool(is_ended)])
        state[_SNAPSHOT] = head + found[_SNAPSHOT][lane].tobytes()
        states.append(state)
    return states


def write_states(states: Sequence[Mapping[str, Any]]) -> list[Restoration]:
    """The Restores that `states` need.

    States that continue exactly and states by parts travel apart, and so do states with different
    parts. InvalidArgumentError: a state is malformed.
    """
    rows = [_row_of(state) for state in states]
    groups: dict[tuple[tuple[str, int], ...], list[int]] = {}
    for position, row in enumerate(rows):
        kind = tuple(sorted((name, values.size) for name, values in row.items()))
        groups.setdefault(kind, []).append(position)
    return [
        Restoration(
            positions=positions,
            parts={name: np.stack([rows[i][name] for i in positions]) for name, _ in kind},
            ended=[_SNAPSHOT in rows[i] and _is_ended(states[i]) for i in positions],
        )
        for kind, positions in groups.items()
    ]


def _is_ended(state: Mapping[str, Any]) -> bool:
    return bool(state[_SNAPSHOT][_CHECK_BYTES] == 1)


def _row_of(state: Mapping[str, Any]) -> dict[str, Array]:
    parts = {name: _numbers(name, value) for name, value in state.items() if name != _SNAPSHOT}
    snapshot = state.get(_SNAPSHOT)
    if snapshot is None:
        return parts
    if not isinstance(snapshot, bytes) or len(snapshot) <= _HEAD_BYTES:
        raise InvalidArgumentError("snapshot is not what get_state returned, allowed: those bytes")
    if not parts or _fingerprint(parts) == snapshot[:_CHECK_BYTES]:
        return {_SNAPSHOT: np.frombuffer(snapshot, np.uint8, offset=_HEAD_BYTES)}
    return parts


def _fingerprint(parts: Mapping[str, Array]) -> bytes:
    digest = hashlib.blake2b(digest_size=_CHECK_BYTES)
    for name in sorted(parts):
        digest.update(name.encode() + b"\0" + parts[name].tobytes())
    return digest.digest()


def _readable(name: str, values: Array) -> Any:
    if name == "time":
        return float(values[0])
    if name != "vehicles":
        return values
    rows = values.reshape(-1, len(VEHICLE_COLUMNS))
    return [
        {column: _WHOLE_NUMBERS.get(column, float)(x) for column, x in zip(VEHICLE_COLUMNS, row)}
        for row in rows
    ]


def _numbers(name: str, value: Any) -> Array:
    """The float64 (size,) of one part."""
    try:
        if name == "vehicles":
            value = [[vehicle[column] for column in VEHICLE_COLUMNS] for vehicle in value]
        return np.asarray(value, np.float64).reshape(-1)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"{name} of the state cannot be read ({type(error).__name__}: {error}), "
            "allowed: what get_state returns"
        ) from None
