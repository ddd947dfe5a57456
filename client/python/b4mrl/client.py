"""The connection to a daemon: lists and opens its environments and datasets."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from numpy.typing import ArrayLike, DTypeLike

from b4mrl import catalogue, descriptions
from b4mrl.benchmarks.benchmark import Benchmark
from b4mrl.benchmarks.ledger import Ledger, LedgerLike, number_of
from b4mrl.dataset import Dataset
from b4mrl.descriptions import BenchmarkInfo, DatasetInfo, Perturbation, ServerStatus
from b4mrl.display import Listing, Shown, Table
from b4mrl.environment import Environment
from b4mrl.hosted import shown
from b4mrl.opening import Opening, dataset_request, open_dataset, open_session, plain
from b4mrl.origin import Origin
from b4mrl.query import PendingQuery, QuerySessions, Rows
from b4mrl.serve import PrivateDaemon
from b4mrl.simulators import Simulator
from b4mrl.spec import EnvironmentSpec, spec_of
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.version import __version__
from b4mrl.wire import checks
from b4mrl.wire.connection import DEADLINE_MS, REACH_MS, Connection
from b4mrl.wire.greeting import greet
from b4mrl.wire.messages import Request
from b4mrl.wire.routes import Routes
from b4mrl.wire.session import QueryAnswer, Session

T = TypeVar("T")

_CLIENT_NAME = f"b4mrl-python {__version__}"
_OPEN_DATASET_MS = 300_000  # the first opening of a dataset imports its file


class Client(Shown):
    """A connection to a daemon. Also a context manager.

    Environments and datasets made by a client are independent of the client and of each other;
    each may be used by one thread at a time. A client may be pickled and sent to another process,
    where it connects anew, as it does in a forked child. If only the gateway's port can be reached,
    all requests go through the gateway, which is slower; the first time, a RuntimeWarning says so.

    Args:
        endpoint: "tcp://HOST:PORT" or "ipc://PATH" of the daemon's gateway, or what `serve` has
            returned, which the client then keeps.
        deadline_ms: time limit of each request, in milliseconds. None: two minutes, but ten seconds
            for the first connection.

    Raises:
        UnavailableError: no daemon answers at `endpoint`.
        VersionMismatchError: the daemon speaks another version of the protocol.

    Attributes:
        server, engine: the versions of the daemon and of its physics engine.
    """

    def __init__(self, endpoint: str | PrivateDaemon, deadline_ms: float | None = None) -> None:
        self.endpoint: str = getattr(endpoint, "endpoint", endpoint)
        self._daemon = endpoint  # a private one ends when nothing refers to it any more
        self.deadline_ms = checks.deadline_ms(deadline_ms, DEADLINE_MS)
        self._asked_deadline_ms = deadline_ms
        self._connect()
        self._routes = Routes(self.endpoint, self.hello.capabilities)
        self._query_sessions = QuerySessions(self.endpoint, self._routes, self.deadline_ms)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Client, (self.endpoint, self._asked_deadline_ms))

    def _facts(self) -> Mapping[str, Any]:
        return {"endpoint": self.endpoint, "server": self.server, "engine": self.engine}

    def _connect(self) -> None:
        reach_ms = checks.deadline_ms(self._asked_deadline_ms, REACH_MS)
        self._gateway, self.hello = greet(self.endpoint, _CLIENT_NAME, reach_ms, self.deadline_ms)
        self.server, self.engine = self.hello.server_version, self.hello.engine_version

    def _leave_parent(self) -> None:
        """Connects anew in a forked child, which cannot use its parent's connections."""
        if self._gateway.is_inherited:
            self._connect()

    def _ask(self, connection: Connection, request: Any) -> Any:
        return connection.call(request, bytearray(), self.deadline_ms).reply

    def _ask_gateway(self, request: Any) -> Any:
        self._leave_parent()
        return self._ask(self._gateway, request)

    def environments(self) -> dict[str, EnvironmentSpec]:
        """Name -> specification of every environment, under its default settings."""
        found = catalogue.read(self._ask_gateway)
        return Table((info.name, spec_of(info)) for info in found.environments)

    def perturbations(self) -> list[Perturbation]:
        """All kinds of perturbations, each with its presets."""
        return Listing(map(descriptions.read, catalogue.read(self._ask_gateway).perturbations))

    def benchmarks(self) -> list[BenchmarkInfo]:
        """All benchmarks: of the project's suites and of the daemon's `--suites`."""
        found = catalogue.read(self._ask_gateway, with_benchmarks=True)
        return Listing(map(descriptions.read, found.benchmarks))

    def benchmark(self, name: str) -> Benchmark:
        """The benchmark of that name, such as "HalfCheetah/confounding/hidden-high+medium"."""
        return Benchmark(self, catalogue.find_benchmark(self.benchmarks(), name))

    def server_status(self) -> ServerStatus:
        """The daemon's uptime, processes and sessions."""
        request = Request()
        request.server_status.SetInParent()
        status: ServerStatus = descriptions.read(self._ask_gateway(request).server_status)
        return status

    def ledger(self, number: int = 0) -> Ledger:
        """A ledger, in which the daemon counts what a learner uses: number 0 opens a new one.

        What is opened with the number of a ledger that the daemon has not, or not any more, is
        opened all the same, and counted nowhere.

        UnknownNameError: the daemon has no ledger of that number.
        """
        return Ledger(self._ask_gateway, number)

    def make(
        self,
        environment: str,
        simulator: Simulator = None,
        *,
        seed: int | None = None,
        dtype: DTypeLike = "float32",
        config: Mapping[str, Any] | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
        deadline_ms: float | None = None,
        ledger: LedgerLike = None,
    ) -> Environment:
        """One environment as a gymnasium.Env.

        Args:
            environment: a name from `environments()`, such as "HalfCheetah".
            simulator: perturbations in the order in which they apply: "gravity=1.5,action-delay=2",
                or {"gravity": 1.5, "action-delay": 2}, or ["gravity=1.5", "action-delay=2"].
                `hidden` comes last, wherever it stands. "gravity=0.5..2" draws the factor anew for
                each episode, and info["gravity"] has it. None: the true environment.
            seed: the environment's seed until `reset(seed=...)` sets another one. None: the daemon
                draws one.
            dtype: type of the returned observations, "float32" or "float64". The simulation runs
                in float64.
            config: settings under the names that Gymnasium or highway-env give them.
            max_episode_steps: number of steps after which an episode is truncated. None: the
                environment's own limit. -1: no limit of steps; Highway's `duration` stays.
            render_mode: None, or "rgb_array" for pictures of `width` x `height` pixels, 16 to 1,920
                each; 0 means the environment's default size.
            deadline_ms: time limit of each request, in milliseconds. None: the client's.
            ledger: counts the environment's steps and episodes; see `ledger()`. None: none does.

        Raises:
            UnknownNameError, InvalidArgumentError, UnsupportedError: the message says why.
        """
        asked = plain(
            environment=environment,
            simulator=simulator,
            seed=seed,
            dtype=dtype,
            config=config,
            max_episode_steps=max_episode_steps,
            deadline_ms=deadline_ms,
            ledger=number_of(ledger),
        )
        own = shown(render_mode, width, height)
        origin = self._origin(Client.make, asked | own)
        return Environment(self._open(Opening(**asked)), origin, **own)

    def make_vec(
        self,
        environment: str,
        num_envs: int = 1,
        simulator: Simulator = None,
        *,
        seed: int | None = None,
        dtype: DTypeLike = "float32",
        autoreset_mode: Any = "next_step",
        config: Mapping[str, Any] | None = None,
        max_episode_steps: int | None = None,
        step_past_end: bool = False,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
        deadline_ms: float | None = None,
        ledger: LedgerLike = None,
    ) -> VectorEnvironment:
        """`num_envs` environments as a gymnasium.vector.VectorEnv; environment i has seed + i.

        Args:
            num_envs: 1 to 1,024.
            autoreset_mode: when a finished environment is reset: "next_step", "same_step",
                "disabled", or one of Gymnasium's AutoresetMode or its value.
            step_past_end: allows stepping finished environments in mode "disabled".

        All other arguments, and the exceptions, are those of `make`.
        """
        asked = plain(
            environment=environment,
            num_envs=num_envs,
            simulator=simulator,
            seed=seed,
            dtype=dtype,
            autoreset_mode=autoreset_mode,
            config=config,
            max_episode_steps=max_episode_steps,
            deadline_ms=deadline_ms,
            ledger=number_of(ledger),
        )
        own = {"step_past_end": bool(step_past_end), **shown(render_mode, width, height)}
        origin = self._origin(Client.make_vec, asked | own)
        return VectorEnvironment(self._open(Opening(**asked)), origin, **own)

    def query(
        self,
        environment: str,
        observations: ArrayLike,
        actions: ArrayLike,
        simulator: Simulator = None,
        *,
        seed: int = 0,
        draw: int | None = None,
        first_row: int = 0,
        config: Mapping[str, Any] | None = None,
        ledger: LedgerLike = None,
    ) -> QueryAnswer:
        """Simulates one step from each of the given observations and actions.

        Noise of row i is a function of the simulator and (seed, draw, first_row + i) alone, so a
        long query may be split into several.

        Args:
            observations, actions: (rows, *shape) of the environment's spaces. float64 observations
                give float64 next observations, others float32 ones. The simulation runs in float64.
            draw: None: the number of this client's earlier queries of the simulator without a
                draw, so that each has noise of its own. Parts of a split query share one draw.
                A forked child goes on counting from there, so siblings need different seeds.
            ledger: counts the rows; see `ledger()`.

        Returns:
            next_observations (rows, *shape), rewards, terminated and valid (rows,). A row is not
            valid, and all zeros, if a number of it is not finite or the physics engine warned.

        Raises:
            UnsupportedError: a perturbation depends on earlier steps (action-delay).
            FailedPreconditionError: the client is closed.
        """
        return self.query_async(
            environment,
            observations,
            actions,
            simulator,
            seed=seed,
            draw=draw,
            first_row=first_row,
            config=config,
            ledger=ledger,
        ).result()

    def query_async(
        self,
        environment: str,
        observations: ArrayLike,
        actions: ArrayLike,
        simulator: Simulator = None,
        *,
        seed: int = 0,
        draw: int | None = None,
        first_row: int = 0,
        config: Mapping[str, Any] | None = None,
        ledger: LedgerLike = None,
    ) -> PendingQuery:
        """As `query`, but does not wait for the answer: `query_async(...).result()` returns it.

        The daemon simulates while the caller does something else: all rows of a query of up to
        6,144 rows, the first 6,144 of a longer one. At most ten queries of one simulator may be
        under way. The observations and actions are copied, so the caller may change them.
        """
        rows = Rows.of(observations, actions, copy=True)
        self._leave_parent()
        asked = plain(simulator=simulator, config=config, ledger=number_of(ledger))
        opening = Opening(environment, num_envs=0, seed=0, dtype=rows.dtype, **asked)
        return PendingQuery(self._query_sessions, opening, rows, seed, draw, first_row)

    def datasets(self) -> list[DatasetInfo]:
        """The datasets in the daemon's data folder."""
        with contextlib.closing(self._connect_datasets()) as connection:
            return Listing(catalogue.read_datasets(functools.partial(self._ask, connection)))

    def dataset(
        self,
        name: str,
        corruption: Simulator = None,
        *,
        seed: int = 0,
        transition_rule: str = "stored",
        environment: str = "",
        open_deadline_ms: float = _OPEN_DATASET_MS,
        deadline_ms: float | None = None,
        ledger: LedgerLike = None,
    ) -> Dataset:
        """Opens a dataset. The first opening of a dataset imports its file, which can take minutes.

        Args:
            name: a name from `datasets()`, such as "HalfCheetah/medium". The command
                `b4mrl dataset make NAME` makes one that is missing, if it is the project's.
            corruption: perturbations of the data, written like `simulator` of `make`:
                "obs-noise-high", "hidden=9+10". None: the data as recorded.
            seed: seed of the corruption's noise: each seed gives a dataset one noise matrix.
            transition_rule: "stored" for the file's next observations, "d4rl" for the next row's
                observations, without the rows that end by time-out.
            environment: the environment that the data is for, such as "HalfCheetah". A dataset that
                was recorded in another one is refused, even if its sizes are the same. "": any.
            open_deadline_ms: time limit of the opening, in milliseconds.
            deadline_ms: time limit of each later request, in milliseconds. None: the client's.
            ledger: counts the rows that are sampled and read; see `ledger()`.
        """
        number = number_of(ledger)
        opening_ms = checks.deadline_ms(open_deadline_ms, _OPEN_DATASET_MS, "open_deadline_ms")
        asked = plain(
            name=name,
            corruption=corruption,
            seed=seed,
            transition_rule=transition_rule,
            environment=environment,
            open_deadline_ms=open_deadline_ms,
            deadline_ms=deadline_ms,
            ledger=number,
        )
        request = dataset_request(name, corruption, seed, transition_rule, environment)
        queries = functools.partial(Client._open_queries, ledger=number)
        asked_ms = self._asked_deadline_ms if deadline_ms is None else deadline_ms
        connection = self._connect_datasets()
        try:
            return Dataset(
                connection,
                descriptions.read(open_dataset(connection, request, opening_ms)),
                self._origin(Client.dataset, asked),
                checks.deadline_ms(deadline_ms, self.deadline_ms),
                self._connect_datasets,
                functools.partial(call_once, queries, self.endpoint, asked_ms),
                number,
            )
        except BaseException:
            connection.close()
            raise

    def close(self) -> None:
        """Ends all but environments and datasets; `make` and `make_vec` still open others."""
        self._query_sessions.close()
        self._gateway.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, opening: Opening) -> Session:
        deadline_ms = checks.deadline_ms(opening.deadline_ms, self.deadline_ms)
        return open_session(self.endpoint, self._routes, opening, deadline_ms)

    def _open_queries(self, environment: str, simulator: str, ledger: int | None) -> Session:
        """A session for float32 queries of a simulator."""
        return self._open(Opening(environment, simulator, num_envs=0, seed=0, ledger=ledger))

    def _origin(self, method: Callable[..., Any], arguments: Mapping[str, Any]) -> Origin:
        given = {name: value for name, value in arguments.items() if value is not None}
        opener = functools.partial(call_once, method)
        return Origin(opener, self.endpoint, self._asked_deadline_ms, given)

    def _connect_datasets(self) -> Connection:
        return self._routes.reach(self.hello.dataset_port)


def call_once(
    method: Callable[..., T],
    endpoint: str,
    deadline_ms: float | None,
    /,
    *positional: Any,
    **arguments: Any,
) -> T:
    """Calls a method of Client on a temporary client; what the method opens stays open."""
    with Client(endpoint, deadline_ms) as client:
        return method(client, *positional, **arguments)
