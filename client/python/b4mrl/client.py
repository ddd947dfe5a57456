"""The entrance to a daemon: says Hello, lists what there is, opens environments and datasets."""

from __future__ import annotations

import os
import secrets
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from b4mrl import arrays, checks, errors, limits, query
from b4mrl import config as settings
from b4mrl.connection import Connection
from b4mrl.dataset import Dataset
from b4mrl.environment import Environment
from b4mrl.messages import AUTORESET_MODES, Request
from b4mrl.routes import Routes
from b4mrl.session import Session, close_request
from b4mrl.spec import EnvironmentSpec, parse_named, spec_of
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.version import __version__

_CLIENT_NAME = f"b4mrl-python {__version__}"
_MAX_QUERY_SESSIONS = 16  # kept open for further queries; the longest unused one goes first
_OPEN_DATASET_DEADLINE_MS = 300_000  # the first opening of a file imports it


class Client:
    """A connection to a daemon. Also a context manager.

    Environments and datasets that it made are independent of it and of each other, each for one
    thread at a time. It may be pickled and sent to another process, which then connects anew.
    Where only the gateway's port can be reached, requests go through it, which is slower; the first
    time that this happens, a RuntimeWarning says so.

    Args:
        endpoint: "tcp://HOST:PORT" or "ipc://PATH".
        deadline_ms: of each request of this client, the first one included.

    Raises:
        UnavailableError: nobody answers at `endpoint`.
        VersionMismatchError: it speaks another version of the protocol.
    """

    def __init__(self, endpoint: str, deadline_ms: float = limits.DEFAULT_DEADLINE_MS) -> None:
        self.endpoint = endpoint
        self.deadline_ms = deadline_ms
        self._process_id = os.getpid()
        self._query_sessions: OrderedDict[tuple[str, ...], Session] = OrderedDict()
        self._connect()

    def __reduce__(self) -> tuple[Any, ...]:
        return (Client, (self.endpoint, self.deadline_ms))

    def _connect(self) -> None:
        self._gateway = Connection(self.endpoint)
        request = Request()
        request.hello.client = _CLIENT_NAME
        try:
            reply = self._gateway.call(request, bytearray(), self.deadline_ms).reply
        except errors.UnavailableError as error:
            raise errors.UnavailableError(f"{self.endpoint}: {error}", recoverable=True) from None
        self.hello = reply.hello
        self._routes = Routes(self.endpoint, self.hello.capabilities)
        if self.hello.protocol_version != limits.PROTOCOL_VERSION:
            raise errors.VersionMismatchError(
                f"the server speaks protocol {self.hello.protocol_version}, "
                f"this client {limits.PROTOCOL_VERSION}"
            )

    def _leave_parent(self) -> None:
        """After a fork, the child gets connections of its own."""
        if os.getpid() != self._process_id:
            self._process_id = os.getpid()
            self._query_sessions.clear()
            self._connect()

    def _ask_gateway(self, request: Any) -> Any:
        self._leave_parent()
        return self._gateway.call(request, bytearray(), self.deadline_ms).reply

    def environments(self) -> dict[str, EnvironmentSpec]:
        """The environments of the catalogue by name, each with its default configuration."""
        return {info.name: spec_of(info) for info in self._catalogue().environments}

    def perturbations(self) -> list[Any]:
        """The perturbations of the catalogue: messages PerturbationInfo of b4mrl.proto."""
        return list(self._catalogue().perturbations)

    def server_status(self) -> Any:
        """Uptime, processes and sessions: a message ServerStatusReply of b4mrl.proto."""
        request = Request()
        request.server_status.SetInParent()
        return self._ask_gateway(request).server_status

    def make(
        self,
        environment: str,
        simulator: str | None = None,
        *,
        seed: int | None = None,
        dtype: DTypeLike = "float32",
        config: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
        deadline_ms: float | None = None,
    ) -> Environment:
        """One environment as a gymnasium.Env.

        Args:
            environment: a name of the catalogue, "HalfCheetah".
            simulator: perturbations, joined by commas and applied in order: "gravity=1.5",
                "hidden-high,action-delay=2". None: the true environment.
            seed: of the first episodes, until `reset(seed=...)`. None: the daemon draws one.
            dtype: of observations, "float32" or "float64". It is computed in float64.
            config: the environment's settings under the names that its original uses.
            render_mode: None or "rgb_array"; then of `width` x `height` pixels, where 0 is the
                environment's default.
            deadline_ms: of each request. None: the client's.

        Raises:
            UnknownNameError, InvalidArgumentError, UnsupportedError: with the server's reason.
        """
        session = self.open_session(
            environment, simulator, 1, seed, "disabled", dtype, config, deadline_ms
        )
        return Environment(session, render_mode, width, height)

    def make_vec(
        self,
        environment: str,
        num_envs: int = 1,
        simulator: str | None = None,
        *,
        seed: int | None = None,
        dtype: DTypeLike = "float32",
        autoreset_mode: Any = "next_step",
        config: Mapping[str, Any] | None = None,
        step_past_end: bool = False,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
        deadline_ms: float | None = None,
    ) -> VectorEnvironment:
        """`num_envs` environments as a gymnasium.vector.VectorEnv; environment i has seed + i.

        Args:
            autoreset_mode: "next_step", "same_step", "disabled", or Gymnasium's AutoresetMode.
            step_past_end: in mode "disabled", finished environments may be stepped on.

        The others and what is raised: see make.
        """
        if num_envs == 0:
            raise errors.InvalidArgumentError("num_envs is 0, allowed: at least 1")
        mode = str(getattr(autoreset_mode, "name", autoreset_mode)).lower()
        session = self.open_session(
            environment, simulator, num_envs, seed, mode, dtype, config, deadline_ms
        )
        return VectorEnvironment(session, step_past_end, render_mode, width, height)

    def query(
        self,
        environment: str,
        observations: ArrayLike,
        actions: ArrayLike,
        simulator: str | None = None,
        *,
        seed: int = 0,
        draw: int = 0,
        first_row: int = 0,
        config: Mapping[str, Any] | None = None,
    ) -> tuple[arrays.Array, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """What one step of a simulator makes of arbitrary observations and actions (T_sim).

        Noise of row i is a function of the simulator and (seed, draw, first_row + i) alone, so a
        long query may be cut anywhere.

        Args:
            observations, actions: (rows, *shape). Computed, and returned, in float64 if
                `observations` are float64, else returned in float32.

        Returns:
            next_observations (rows, *shape), rewards (rows,), terminated (rows,), valid (rows,). A
            row that is not valid was not finite or made the engine warn; it holds zeros.

        Raises:
            UnsupportedError: the simulator remembers something between steps (action-delay).
        """
        rows = query.Rows.of(observations, actions)
        key = (environment, simulator or "", settings.to_json(config), rows.dtype.name)
        session = self._query_session(key, config)
        try:
            return query.run(session, rows, seed, draw, first_row)
        except errors.SessionLostError:  # idle for longer than its lease; a query changes nothing
            self._query_sessions.pop(key).close()
            session = self._query_session(key, config)
            return query.run(session, rows, seed, draw, first_row)

    def datasets(self) -> list[Any]:
        """The datasets that the daemon has: messages DatasetInfo of b4mrl.proto."""
        found: list[Any] = []
        connection = self._connect_datasets()
        try:
            while True:
                request = Request()
                request.list_datasets.first = len(found)
                request.list_datasets.SetInParent()
                page = connection.call(request, bytearray(), self.deadline_ms).reply.list_datasets
                found.extend(page.datasets)
                if not page.datasets or len(found) >= page.total:
                    return found
        finally:
            connection.close()

    def dataset(
        self,
        name: str,
        corruption: str | None = None,
        *,
        seed: int = 0,
        transition_rule: str = "stored",
        open_deadline_ms: float = _OPEN_DATASET_DEADLINE_MS,
        deadline_ms: float | None = None,
    ) -> Dataset:
        """Opens a dataset, "HalfCheetah/medium"; the first opening of a file imports it.

        Args:
            corruption: as `simulator` of make: "obs-noise-high", "hidden=9+10".
            seed: of the corruption's noise.
            transition_rule: "stored" or "d4rl" (the next row is the next observation).
        """
        request = Request()
        request.open_dataset.dataset = name
        for item, argument in parse_named(corruption):
            request.open_dataset.corruptions.add(name=item, argument=argument)
        request.open_dataset.seed = checks.unsigned("seed", seed)
        request.open_dataset.transition_rule = transition_rule
        connection = self._connect_datasets()
        try:
            reply = connection.call(request, bytearray(), open_deadline_ms).reply.open_dataset
            return Dataset(connection, reply, self, deadline_ms or self.deadline_ms)
        except BaseException:
            connection.close()
            raise

    def open_session(
        self,
        environment: str,
        simulator: str | None,
        num_envs: int,
        seed: int | None,
        autoreset_mode: str,
        dtype: DTypeLike,
        config: Mapping[str, Any] | None,
        deadline_ms: float | None = None,
    ) -> Session:
        """The layer under make and make_vec; `num_envs` 0 is a session for queries alone."""
        mode = AUTORESET_MODES.values_by_name.get(autoreset_mode.upper())
        if mode is None:
            known = ", ".join(name.lower() for name in AUTORESET_MODES.values_by_name)
            raise errors.InvalidArgumentError(
                f"autoreset_mode is {autoreset_mode!r}, allowed: {known}"
            )
        request = Request()
        request.open.environment = environment
        for item, argument in parse_named(simulator):
            request.open.perturbations.add(name=item, argument=argument)
        request.open.num_envs = checks.unsigned("num_envs", num_envs, bits=32)
        if seed is not None:
            request.open.seed = checks.unsigned("seed", seed)
        request.open.autoreset_mode = mode.number
        request.open.observation_dtype = _float_dtype(dtype)
        request.open.config = settings.to_json(config)
        request.open.with_infos = True
        return self._open(request, self.deadline_ms if deadline_ms is None else deadline_ms)

    def close(self) -> None:
        """Closes the connection and the sessions of queries. Environments stay open."""
        while self._query_sessions:
            self._query_sessions.popitem()[1].close()
        self._gateway.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _catalogue(self) -> Any:
        request = Request()
        request.catalogue.SetInParent()
        return self._ask_gateway(request).catalogue

    def _open(self, request: Any, deadline_ms: float) -> Session:
        # The token goes with Open, which the gateway answers, and with all that the worker answers.
        token = secrets.token_bytes(limits.TOKEN_BYTES)
        opener = Connection(self.endpoint, token)
        asked = request.open
        try:
            reply = opener.call(request, bytearray(), deadline_ms).reply.open
            if (reply.num_envs, reply.observation_dtype) != (
                asked.num_envs,
                asked.observation_dtype,
            ):
                raise errors.InternalError("the server's reply does not fit what was opened")
            worker = self._routes.reach(reply.port, token)
        except BaseException:
            opener.farewell(close_request())  # it is open, or may still be, and of no use
            raise
        opener.close()
        return Session(worker, reply, spec_of(reply.info), deadline_ms)

    def _query_session(self, key: tuple[str, ...], config: Mapping[str, Any] | None) -> Session:
        self._leave_parent()
        session = self._query_sessions.pop(key, None)
        if session is None:
            environment, simulator, _, dtype = key
            session = self.open_session(environment, simulator, 0, 0, "disabled", dtype, config)
        self._query_sessions[key] = session
        while len(self._query_sessions) > _MAX_QUERY_SESSIONS:
            self._query_sessions.popitem(last=False)[1].close()
        return session

    def _connect_datasets(self) -> Connection:
        return self._routes.reach(self.hello.dataset_port)


def _float_dtype(dtype: DTypeLike) -> int:
    kind = np.dtype(dtype)
    if kind not in (np.float32, np.float64):
        raise errors.InvalidArgumentError(f"dtype is {kind.name}, allowed: float32, float64")
    return arrays.dtype_number(kind)
