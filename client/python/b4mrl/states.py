"""States of environments as dictionaries, which get_state returns and set_state takes.

A MuJoCo state has the parts `time`, `qpos`, `qvel` and `qacc_warmstart`; a Highway state has `time`
and `vehicles`, a list of dictionaries with the ego first. In addition, `snapshot` holds everything
for an exact continuation: random streams, delayed actions, the step within the episode.

If the parts are those that came with the snapshot, or missing, set_state uses the snapshot and
continues exactly. If a part was changed, set_state uses the parts and ignores the snapshot. MuJoCo
needs at least `qpos` and `qvel`, Highway `vehicles`.
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

# Columns of `vehicles` in messages, which have one row for each vehicle.
VEHICLE_COLUMNS = tuple(
    "x y heading speed lane target_lane timer crashed impact_pending impact_x impact_y "
    "steering acceleration target_speed delta".split()
)
_WHOLE_NUMBERS = {"lane": int, "target_lane": int, "crashed": bool, "impact_pending": bool}

_SNAPSHOT = "snapshot"
# `snapshot` begins with a hash of the parts that came with it, and a byte that is 1 if the episode
# had ended; the server's bytes follow.
_CHECK_BYTES = 16
_HEAD_BYTES = _CHECK_BYTES + 1


@dataclass(frozen=True)
class Restoration:
    """The arrays of one Restore request.

    Attributes:
        positions: of the restored states in the list given to write_states; k of them.
        parts: arrays for Session.restore, with first axis k.
        ended: for each state, whether its episode had ended.
    """

    positions: list[int]
    parts: dict[str, Array]
    ended: list[bool]


def read_states(found: Mapping[str, Array], ended: Sequence[bool]) -> list[State]:
    """One state for each lane, from the arrays of a Snapshot reply; their first axis is the lanes.

    `ended` says for each lane whether its episode has ended.
    """
    states = []
    for lane, is_ended in enumerate(ended):
        parts = {name: rows[lane] for name, rows in found.items() if name != _SNAPSHOT}
        state: State = {name: _readable(name, values.copy()) for name, values in parts.items()}
        head = _fingerprint(parts) + bytes([bool(is_ended)])
        state[_SNAPSHOT] = head + found[_SNAPSHOT][lane].tobytes()
        states.append(state)
    return states


def write_states(states: Sequence[Mapping[str, Any]]) -> list[Restoration]:
    """The Restore requests for `states`: one for each set of array names and sizes among them.

    InvalidArgumentError: a state is malformed.
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
        raise InvalidArgumentError("snapshot is malformed, allowed: bytes that get_state returned")
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
    """One part as float64 (size,)."""
    try:
        if name == "vehicles":
            value = [[vehicle[column] for column in VEHICLE_COLUMNS] for vehicle in value]
        return np.asarray(value, np.float64).reshape(-1)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"{name} of the state cannot be read ({type(error).__name__}: {error}), "
            "allowed: a part as get_state returns it"
        ) from None
