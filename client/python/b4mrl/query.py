"""Queries of a simulator with any number of rows, split into requests, and their sessions."""

from __future__ import annotations

import contextlib
import functools
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from b4mrl import config, simulators
from b4mrl.errors import (
    FailedPreconditionError,
    InvalidArgumentError,
    SessionLostError,
    connection_closed,
)
from b4mrl.opening import Opening, open_session
from b4mrl.wire import checks, limits
from b4mrl.wire.arrays import Array, rows_that_fit
from b4mrl.wire.routes import Routes
from b4mrl.wire.session import QueryAnswer, Session

# Several requests keep every thread of a worker busy while one reply is copied out. Small requests
# are done within their deadline even if a row takes milliseconds.
_REQUESTS_IN_FLIGHT = 6
_ROWS_AT_ONCE = min(1024, limits.MAX_QUERY_ROWS)
_MAX_SESSIONS = 16  # kept open for further queries; the least recently used is closed first


@dataclass(frozen=True)
class Rows:
    """Observations and actions, (rows, ...) each; each of them is float32 or float64."""

    observations: Array
    actions: Array

    @property
    def dtype(self) -> np.dtype[Any]:
        """That of the observations, in which the next ones are answered."""
        return self.observations.dtype

    @classmethod
    def of(cls, observations: ArrayLike, actions: ArrayLike, *, copy: bool = False) -> Rows:
        """Reads a caller's arrays; with `copy`, the caller may change them afterwards.

        Floating-point numbers of more than 32 bits become float64, all others float32.
        InvalidArgumentError: they are no arrays of numbers, or their numbers of rows differ.
        """
        try:
            states, controls = (_floats(given, copy) for given in (observations, actions))
        except checks.NO_ARRAY as error:  # rows of unequal lengths; texts
            raise InvalidArgumentError(
                f"observations or actions are no arrays of numbers ({error}), allowed: (rows, ...)"
            ) from None
        if states.ndim < 2 or controls.ndim < 2 or len(states) != len(controls):
            raise InvalidArgumentError(
                f"observations have shape {states.shape} and actions {controls.shape}, "
                "allowed: (rows, ...) with equally many rows"
            )
        return cls(states, controls)

    def flat(self, observation_size: int, action_size: int) -> Rows:
        """The same numbers as (rows, size). InvalidArgumentError: a row has another size."""
        rows = len(self.observations)
        sizes = self.observations.size, self.actions.size
        if sizes != (rows * observation_size, rows * action_size):
            raise InvalidArgumentError(
                f"observations have shape {self.observations.shape} and actions "
                f"{self.actions.shape}, allowed: {observation_size} and {action_size} values a row"
            )
        return Rows(
            self.observations.reshape(rows, observation_size),
            self.actions.reshape(rows, action_size),
        )


def _floats(given: ArrayLike, copy: bool) -> Array:
    read = checks.real(given, copy)
    is_wide = read.dtype.kind == "f" and read.dtype.itemsize > 4
    return read.astype(np.float64 if is_wide else np.float32, copy=False)


def begin(
    session: Session, rows: Rows, seed: int, draw: int, first_row: int
) -> Callable[[], QueryAnswer]:
    """Sends the first rows to `session`, which has the dtype of `rows`.

    The returned function does the rest, and returns as Client.query does. It may be called once, as
    it gives up what is under way when it raises.
    """
    flat = rows.flat(session.spec.observation.size, session.spec.action.size)
    count, at_once = len(flat.observations), _rows_at_once(flat)
    parts = [slice(i, min(i + at_once, count)) for i in range(0, count, at_once)]
    answers = session.query(
        flat.observations, flat.actions, parts, seed, draw, first_row, _REQUESTS_IN_FLIGHT
    )

    def gather() -> QueryAnswer:
        next_observations = np.empty((count, session.spec.observation.size), session.dtype)
        rewards = np.empty(count)
        terminated, valid = np.empty(count, np.bool_), np.empty(count, np.bool_)
        received = 0
        with contextlib.closing(answers):
            for part, answer in answers:
                next_observations[part], rewards[part], terminated[part], valid[part] = answer
                received += part.stop - part.start
        # The arrays hold whatever was in memory where no answer has been written.
        if received != count:
            raise FailedPreconditionError(
                f"{received} of the query's {count} rows were received here, the others before or "
                "never; send the query again"
            )
        return next_observations.reshape(rows.observations.shape), rewards, terminated, valid

    return gather


class PendingQuery:
    """A query that is under way: Client.query_async returns it.

    Thread rule: that of the client which sent it.

    Args:
        draw: None: the simulator's next one of `sessions`.
    """

    def __init__(
        self,
        sessions: QuerySessions,
        opening: Opening,
        rows: Rows,
        seed: int,
        draw: int | None,
        first_row: int,
    ) -> None:
        seed = checks.unsigned("seed", seed)
        first_row = checks.unsigned("first_row", first_row)
        is_next = draw is None
        if draw is None:
            draw = sessions.next_draw(opening)
        self._ask = functools.partial(begin, rows=rows, seed=seed, draw=draw, first_row=first_row)
        self._sessions = sessions
        self._opening = opening
        self._session = sessions.find(opening)
        # None once it was called: after a failure it would have nothing left to receive.
        self._gather: Callable[[], QueryAnswer] | None = self._ask(self._session)
        if is_next:
            sessions.count_draw(opening)  # a query that was refused takes none
        self._answer: QueryAnswer | None = None

    def result(self) -> QueryAnswer:
        """Waits for the answer, and returns it as Client.query does; always the same arrays.

        After an error, or an interruption such as Ctrl-C, the next call asks the daemon again, with
        the same draw, and returns the same numbers: a query changes nothing. A forked child, which
        cannot receive what its parent has sent, asks for itself.
        """
        if self._answer is None:
            gather, self._gather = self._gather, None
            if self._session.is_foreign:
                gather, self._session = None, self._sessions.find(self._opening)
            try:
                self._answer = (gather or self._ask(self._session))()
            except SessionLostError:  # idle for longer than its lease
                self._sessions.forget(self._opening, self._session)
                self._session = self._sessions.find(self._opening)
                self._answer = self._ask(self._session)()
        return self._answer


class QuerySessions:
    """Sessions that are kept open for further queries of the same simulators.

    Args:
        endpoint, routes: of the daemon.
        deadline_ms: time limit of each request, in milliseconds.
    """

    def __init__(self, endpoint: str, routes: Routes, deadline_ms: float) -> None:
        self._open = functools.partial(open_session, endpoint, routes, deadline_ms=deadline_ms)
        self._sessions: OrderedDict[tuple[str | int | None, ...], Session] = OrderedDict()
        self._draws: Counter[tuple[str, str, str]] = Counter()
        self._is_closed = False

    def find(self, opening: Opening) -> Session:
        """The session of that opening; opens it if there is none.

        FailedPreconditionError: close was called; nobody would close what is opened now.
        """
        if self._is_closed:
            raise connection_closed()
        key = _key_of(opening)
        session = self._sessions.pop(key, None)
        if session is None or session.is_foreign:
            session = self._open(opening)
        self._sessions[key] = session
        while len(self._sessions) > _MAX_SESSIONS:
            self._sessions.popitem(last=False)  # closes it, unless a query of it is under way
        return session

    def next_draw(self, opening: Opening) -> int:
        """0, 1, 2, ... for each simulator, whatever the dtype and the ledger."""
        return self._draws[_simulator_of(opening)]

    def count_draw(self, opening: Opening) -> None:
        """The next draw has been taken."""
        self._draws[_simulator_of(opening)] += 1

    def forget(self, opening: Opening, session: Session) -> None:
        """Does not find `session` any more, which the daemon has closed."""
        key = _key_of(opening)
        if self._sessions.get(key) is session:
            del self._sessions[key]

    def close(self) -> None:
        """Closes all sessions, and opens no more."""
        self._is_closed = True
        while self._sessions:
            self._sessions.popitem()[1].close()


def _key_of(opening: Opening) -> tuple[str | int | None, ...]:
    return *_simulator_of(opening), np.dtype(opening.dtype).name, opening.ledger


def _simulator_of(opening: Opening) -> tuple[str, str, str]:
    perturbed = simulators.text_of(simulators.parse(opening.simulator))
    return opening.environment, perturbed, config.to_json(opening.config)


def _rows_at_once(rows: Rows) -> int:
    """The largest number of rows of a request that fits the request and its reply."""
    observation, action = (
        given.itemsize * given.shape[1] for given in (rows.observations, rows.actions)
    )
    # Beside the observation, a request has the action, a reply the reward and two flags.
    row_bytes = observation + max(action, 8 + 2)
    return min(_ROWS_AT_ONCE, rows_that_fit(row_bytes))
