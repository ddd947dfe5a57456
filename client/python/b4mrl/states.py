"""States of environments as dictionaries, which get_state returns and set_state takes.

A MuJoCo state has the parts `time`, `qpos`, `qvel` and `qacc_warmstart`, and the Humanoid's also
what MuJoCo derived from positions and velocities one step before: `com`, `cinert`, `cvel`,
`qfrc_actuator` and `cfrc_ext`. A Highway state has `time` and `vehicles`, a list of dictionaries
with the ego first. In addition, `snapshot` holds everything for an exact continuation: random
streams, delayed actions, the step within the episode.

If the parts are those that came with the snapshot, or missing, set_state uses the snapshot and
continues exactly. If a part was changed, set_state uses the parts and ignores the snapshot. If
`qpos` or `qvel` is among the changed ones, derived parts that were left as they came belong to
another state, and are derived anew. MuJoCo needs at least `qpos` and `qvel`, Highway `vehicles`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from b4mrl.errors import InternalError, InvalidArgumentError
from b4mrl.wire import checks
from b4mrl.wire.arrays import Array

State = dict[str, Any]

# Columns of `vehicles` in messages, which have one row for each vehicle.
VEHICLE_COLUMNS = tuple(
    "x y heading speed lane target_lane timer crashed impact_pending impact_x impact_y "
    "steering acceleration target_speed delta".split()
)
_WHOLE_NUMBERS = {"lane": int, "target_lane": int, "crashed": bool, "impact_pending": bool}

_SNAPSHOT = "snapshot"
# `snapshot` begins with a byte that is 1 if the episode had ended, the number of parts that came
# with it, and their hashes; the server's bytes follow.
_CHECK_BYTES = 16

# MuJoCo derives every part from _MOTION but those of _GIVEN.
_MOTION = {"qpos", "qvel"}
_GIVEN = {"time", "qacc_warmstart"}


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

    `ended` says for each lane whether its episode has ended. InternalError: a part has a size that
    it cannot have.
    """
    states = []
    for lane, is_ended in enumerate(ended):
        parts = {name: rows[lane] for name, rows in found.items() if name != _SNAPSHOT}
        state: State = {name: _readable(name, values.copy()) for name, values in parts.items()}
        hashes = b"".join(_fingerprint(*part) for part in parts.items())
        head = bytes([bool(is_ended), len(parts)]) + hashes
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
    return bool(state[_SNAPSHOT][0] == 1)


def _row_of(state: Mapping[str, Any]) -> dict[str, Array]:
    state = checks.mapping("state", state, "a dict that get_state returned")
    parts = {name: _numbers(name, value) for name, value in state.items() if name != _SNAPSHOT}
    snapshot = state.get(_SNAPSHOT)
    if snapshot is None:
        return parts
    head_bytes = 2 + _CHECK_BYTES * snapshot[1] if _is_long(snapshot, 2) else 0
    if head_bytes == 0 or not _is_long(snapshot, head_bytes):
        raise InvalidArgumentError("snapshot is malformed, allowed: bytes that get_state returned")
    came = {snapshot[i : i + _CHECK_BYTES] for i in range(2, head_bytes, _CHECK_BYTES)}
    kept = {name for name, values in parts.items() if _fingerprint(name, values) in came}
    if len(kept) == len(parts):
        return {_SNAPSHOT: np.frombuffer(snapshot, np.uint8, offset=head_bytes)}
    if _MOTION & parts.keys() <= kept:
        return parts
    stale = kept - _MOTION - _GIVEN
    return {name: values for name, values in parts.items() if name not in stale}


def _is_long(snapshot: Any, size: int) -> bool:
    return isinstance(snapshot, bytes) and len(snapshot) > size


def _fingerprint(name: str, values: Array) -> bytes:
    text = name.encode() + b"\0" + values.tobytes()
    return hashlib.blake2b(text, digest_size=_CHECK_BYTES).digest()


def _readable(name: str, values: Array) -> Any:
    columns = len(VEHICLE_COLUMNS)
    if (name == "time" and values.size != 1) or (name == "vehicles" and values.size % columns):
        raise InternalError(f"the server sent {values.size} numbers as the {name} of a lane")
    if name == "time":
        return float(values[0])
    if name != "vehicles":
        return values
    rows = values.reshape(-1, columns)
    return [
        {column: _WHOLE_NUMBERS.get(column, float)(x) for column, x in zip(VEHICLE_COLUMNS, row)}
        for row in rows
    ]


def _numbers(name: str, value: Any) -> Array:
    """One part as float64 (size,)."""
    try:
        if name == "vehicles":
            value = [[vehicle[column] for column in VEHICLE_COLUMNS] for vehicle in value]
        return checks.real(value).astype(np.float64, copy=False).reshape(-1)
    except (KeyError, *checks.NO_ARRAY) as error:
        raise InvalidArgumentError(
            f"{name} of the state cannot be read ({type(error).__name__}: {error}), "
            "allowed: a part as get_state returns it"
        ) from None
