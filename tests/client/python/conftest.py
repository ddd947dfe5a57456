"""One daemon for all tests, one with datasets, all simulators, forks, the long proofs' option."""

from __future__ import annotations

import functools
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import b4mrl
import pytest

from made_dataset import run_dataset, write_example

# Compared with other people's programs in the long form alone, whatever is installed.
LONG_FILES = (
    "test_sb3.py",
    "test_highway_original.py",
    "test_hybrid_pytorch.py",
    "test_minari.py",
    "test_torch.py",
)
BENCHMARK_ROWS = 2_000
MODES = ("next_step", "same_step", "disabled")


@functools.lru_cache(maxsize=1)
def daemon() -> b4mrl.PrivateDaemon:
    return b4mrl.serve(tcp=True, workers=2)


@functools.lru_cache(maxsize=1)
def shared_client() -> b4mrl.Client:
    return b4mrl.connect(daemon().endpoint)


def simulators() -> list[tuple[str, str]]:
    """Every environment, true ("") and with each of its presets."""
    pairs = [(name, "") for name in shared_client().environments()]
    for perturbation in shared_client().perturbations():
        pairs += [(preset.environment, preset.name) for preset in perturbation.presets]
    return pairs


def environment_workers(client: b4mrl.Client) -> list[int]:
    """Their process ids, but for those that are dead and have no successor yet.

    Of these the status says 0, and a signal to 0 would hit the tests themselves.
    """
    workers = [each for each in client.server_status().workers if each.role.startswith("worker-")]
    return [worker.process_id for worker in workers if worker.process_id != 0]


def in_a_child(call: Callable[[], Any]) -> Any:
    """What `call` returns in a forked child; raises what it raises there."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            outcome = call()
        except BaseException as error:
            outcome = error
        try:
            with os.fdopen(write, "wb") as file:
                pickle.dump(outcome, file)
        finally:
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as file:
        outcome = pickle.load(file)
    os.waitpid(child, 0)
    if isinstance(outcome, BaseException):
        raise outcome
    return outcome


def pytest_sessionfinish() -> None:
    if shared_client.cache_info().currsize:
        shared_client().close()
    if daemon.cache_info().currsize:
        daemon().stop()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run the long proofs in full length")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return True if collection_path.name in LONG_FILES and not config.getoption("--long") else None


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    wanted = {"environment", "simulator", "mode"} & set(metafunc.fixturenames)
    if "mode" in wanted:
        # The short form tests each simulator in one mode, and the true environments in all.
        long = metafunc.config.getoption("--long")
        cases = [
            (environment, simulator, mode)
            for i, (environment, simulator) in enumerate(simulators())
            for mode in (MODES if long or not simulator else MODES[i % 3 : i % 3 + 1])
        ]
        ids = [f"{name}-{simulator or 'true'}-{mode}" for name, simulator, mode in cases]
        metafunc.parametrize(("environment", "simulator", "mode"), cases, ids=ids)
    elif "simulator" in wanted:
        pairs = simulators()
        ids = [f"{name}-{simulator or 'true'}" for name, simulator in pairs]
        metafunc.parametrize(("environment", "simulator"), pairs, ids=ids)
    elif wanted:
        metafunc.parametrize("environment", list(shared_client().environments()))


@pytest.fixture
def long(request: pytest.FixtureRequest) -> bool:
    return request.config.getoption("--long")


@pytest.fixture(scope="session")
def medium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[b4mrl.Client]:
    """A client of a daemon that has datasets of BENCHMARK_ROWS rows."""
    data = tmp_path_factory.mktemp("data")
    for name in ("HalfCheetah/medium", "HalfCheetah/partial-high"):
        run_dataset(data, "make", name, "--rows", str(BENCHMARK_ROWS))
    with b4mrl.serve(data=data) as endpoint, b4mrl.connect(endpoint) as client:
        yield client


@pytest.fixture(scope="session")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[b4mrl.Client, dict]]:
    """A client of a daemon that has one dataset, HalfCheetah/medium, and the columns of that."""
    folder = tmp_path_factory.mktemp("example")
    columns = write_example(folder / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=folder) as endpoint, b4mrl.connect(endpoint) as client:
        yield client, columns


@pytest.fixture
def endpoint() -> str:
    return daemon().endpoint


@pytest.fixture
def client(endpoint: str) -> Iterator[b4mrl.Client]:
    with b4mrl.connect(endpoint) as client:
        yield client
