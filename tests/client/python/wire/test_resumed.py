"""Queries, streams and episodes go on after an error or Ctrl-C in the middle of them."""

from __future__ import annotations

import contextlib
import functools
import gc
import itertools
import pkgutil
from collections.abc import Iterator
from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.query import Rows, begin
from b4mrl.wire import limits

from equality import assert_same
from made_dataset import EXAMPLE_EPISODE, EXAMPLE_ROWS, write_example

CONNECTION = "b4mrl.wire.connection.Connection."
# Where it fails while requests are sent, while a reply is waited for, and while it is read.
PLACES = [
    (CONNECTION + "send", "before"),
    (CONNECTION + "_transmit", "after"),
    (CONNECTION + "send", "after"),
    (CONNECTION + "await_any", "before"),
    (CONNECTION + "await_any", "after"),
    ("b4mrl.wire.deliveries.Delivery.arrays", "before"),
]
everywhere = pytest.mark.parametrize(("place", "when"), PLACES)
each_failure = pytest.mark.parametrize("failure", [KeyboardInterrupt, errors.DeadlineExceededError])


@contextlib.contextmanager
def failing(place: str, when: str, failure: type[BaseException], calls: int = 0) -> Iterator[None]:
    """Has the function or property at `place` raise `failure`, but for its first `calls` calls.

    The block must raise it, too.
    """
    original = pkgutil.resolve_name(place)
    count = itertools.count()

    def fail(*arguments: object, **options: object) -> object:
        is_due = next(count) >= calls
        if is_due and when == "before":
            raise failure("on purpose")
        work = original.fget if isinstance(original, property) else original
        result = work(*arguments, **options)
        if is_due:
            raise failure("on purpose")
        return result

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, property(fail) if isinstance(original, property) else fail)
        with pytest.raises(failure, match="on purpose"):
            yield


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[b4mrl.Client]:
    folder = tmp_path_factory.mktemp("data")
    write_example(folder / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=folder) as endpoint, b4mrl.connect(endpoint) as client:
        yield client


@pytest.fixture
def dataset(own: b4mrl.Client) -> Iterator[b4mrl.Dataset]:
    with own.dataset("HalfCheetah/medium") as dataset:
        yield dataset


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what is simulated once for all tests."""
    return tmp_path_factory.mktemp("pairs")


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, np.ndarray]:
    """More than are sent at once, so that a query both sends and receives in `result`."""
    monkeypatch.setattr("b4mrl.query._ROWS_AT_ONCE", 16)
    rng = np.random.default_rng(3)
    return rng.normal(scale=0.1, size=(150, 17)), rng.uniform(-1, 1, (150, 6))


@each_failure
@everywhere
def test_a_query_that_has_failed_is_asked_again_with_its_draw(
    client: b4mrl.Client,
    rows: tuple[np.ndarray, np.ndarray],
    place: str,
    when: str,
    failure: type[BaseException],
) -> None:
    query = functools.partial(client.query, "HalfCheetah", *rows, "obs-noise=0.1")
    query()  # so that the draw of the next one is not 0
    pending = client.query_async("HalfCheetah", *rows, "obs-noise=0.1")
    for calls in (0, 1):
        with failing(place, when, failure, calls):
            pending.result()
        (session,) = client._query_sessions._sessions.values()
        assert not session._connection._pending and not session._connection._arrived
    assert_same(pending.result(), query(draw=1))
    assert pending.result() is pending.result()
    assert_same(query(), query(draw=2))  # it has taken one draw, however often it was asked


def test_a_closed_client_says_so_again_of_a_query_under_way(endpoint: str) -> None:
    client = b4mrl.connect(endpoint)
    query = client.query_async("HalfCheetah", np.zeros((2, 17)), np.zeros((2, 6)))
    client.close()
    for _ in range(3):
        with pytest.raises(errors.FailedPreconditionError, match="^the connection is closed"):
            query.result()


def test_rows_of_a_query_that_did_not_come_are_never_returned(client: b4mrl.Client) -> None:
    rows = Rows.of(np.zeros((5, 17)), np.zeros((5, 6)))
    with client.make_vec("HalfCheetah", 1, dtype="float64") as vec:
        gather = begin(vec.session, rows, 0, 0, 0)
        assert len(gather()[0]) == 5
        with pytest.raises(errors.FailedPreconditionError, match="^0 of the query's 5 rows"):
            gather()
        assert begin(vec.session, Rows.of(np.zeros((0, 17)), np.zeros((0, 6))), 0, 0, 0)()


@each_failure
@everywhere
@pytest.mark.parametrize("pair_with", [None, "gravity"])
def test_a_stream_goes_on_with_the_batch_that_it_kept_back(
    dataset: b4mrl.Dataset,
    pairs: Path,
    place: str,
    when: str,
    failure: type[BaseException],
    pair_with: str | None,
) -> None:
    paired = {"pair_with": pair_with, "pair_folder": pairs}
    stream = dataset.stream(64, seed=3, first_batch=5, credits=3, **paired)
    for batch in range(5, 9):
        for _ in range(2):
            with failing(place, when, failure):
                next(stream)
            assert not dataset._connection._pending and not dataset._connection._arrived
        found = next(stream)
        wanted = dataset.sample(64, seed=3, batch=batch, with_indices=True)
        indices = wanted.pop("indices")
        if pair_with is not None:
            simulated = dataset.pair(pair_with, folder=pairs)
            wanted |= {name: column[indices] for name, column in simulated.items()}
        assert_same(found, wanted)
    connection = dataset._connection
    assert 0 < len(connection._pending) + len(connection._arrived) <= 3  # it reads ahead


def test_a_stream_may_fail_at_the_first_batch_as_often_as_it_will(dataset: b4mrl.Dataset) -> None:
    stream = dataset.stream(8)
    for _ in range(limits.MAX_REQUESTS_IN_FLIGHT + 1):
        with failing(CONNECTION + "_transmit", "after", KeyboardInterrupt):
            next(stream)
    assert_same(next(stream), dataset.sample(8, batch=0))


def test_a_loop_over_a_stream_may_be_entered_again(dataset: b4mrl.Dataset) -> None:
    stream = dataset.stream(8)
    found = list(itertools.islice(stream, 2))
    with failing(CONNECTION + "await_any", "before", KeyboardInterrupt):
        for batch in stream:
            found.append(batch)
    found += itertools.islice(stream, 2)
    assert_same(found, [dataset.sample(8, batch=batch) for batch in range(4)])


def test_a_stream_that_is_closed_or_collected_leaves_nothing_under_way(
    dataset: b4mrl.Dataset,
) -> None:
    closed, unread, dropped = (dataset.stream(8) for _ in range(3))
    next(closed)
    next(dropped)
    closed.close()
    closed.close()
    unread.close()
    for stream in (closed, unread):
        for _ in range(2):
            with pytest.raises(StopIteration):
                next(stream)
    gc.disable()  # so that no cycle keeps it
    try:
        del dropped
        assert not dataset._connection._pending and not dataset._connection._arrived
    finally:
        gc.enable()


def test_a_stream_of_a_closed_dataset_says_so_each_time(own: b4mrl.Client) -> None:
    dataset = own.dataset("HalfCheetah/medium")
    stream = dataset.stream(8)
    next(stream)
    dataset.close()
    for _ in range(3):
        with pytest.raises(errors.FailedPreconditionError, match="^the connection is closed"):
            next(stream)


@each_failure
@everywhere
def test_episodes_go_on_with_the_one_that_was_kept_back(
    dataset: b4mrl.Dataset,
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    when: str,
    failure: type[BaseException],
) -> None:
    monkeypatch.setattr(
        dataset, "_rows_per_read", 37
    )  # episodes lie across several replies, of which eight are under way
    whole = dataset.load()
    episodes = dataset.episodes()
    for number in range(EXAMPLE_ROWS // EXAMPLE_EPISODE):
        if number < 3:
            with failing(place, when, failure):
                next(episodes)
        rows = slice(number * EXAMPLE_EPISODE, (number + 1) * EXAMPLE_EPISODE)
        assert_same(next(episodes), {name: column[rows] for name, column in whole.items()})
    for _ in range(2):
        with pytest.raises(StopIteration):
            next(episodes)
    assert not dataset._connection._pending and not dataset._connection._arrived


def test_an_open_last_episode_goes_on_too(tmp_path: Path) -> None:
    def change(columns: dict[str, np.ndarray]) -> None:
        columns["timeouts"][:] = False
        columns["timeouts"][3999] = True

    write_example(tmp_path / "HalfCheetah" / "open.h5", change)
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/open") as dataset:
            dataset._rows_per_read = 900
            episodes = dataset.episodes()
            lengths = [len(next(episodes)["rewards"])]
            with failing("b4mrl.wire.arrays.joined", "after", KeyboardInterrupt):
                next(episodes)
            assert not dataset._connection._pending and not dataset._connection._arrived
            lengths += [len(episode["rewards"]) for episode in episodes]
    assert lengths == [4000, EXAMPLE_ROWS - 4000]
