"""The daemon's catalogue and its list of datasets, put together from their pages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from b4mrl import descriptions
from b4mrl.descriptions import BenchmarkInfo
from b4mrl.errors import InternalError, unknown_name
from b4mrl.wire import checks
from b4mrl.wire.messages import Request

_MOST_BYTES = 16 << 20  # of all pages of one list


def read(ask: Callable[[Any], Any], *, with_benchmarks: bool = False) -> Any:
    """All pages as one CatalogueReply; `ask` sends a request to the gateway, returns its reply.

    InternalError: the pages have more than 16 MiB.
    """
    catalogue = _page(ask, 0, with_benchmarks)
    while (known := _entries(catalogue)) < catalogue.total:
        page = _page(ask, known, with_benchmarks)
        if _entries(page) == 0:
            break
        catalogue.MergeFrom(page)
        _check_size(catalogue.ByteSize())
    return catalogue


def find_benchmark(known: Iterable[BenchmarkInfo], name: str) -> BenchmarkInfo:
    """The entry of that name. UnknownNameError: there is none; the message has the nearest name."""
    name = checks.text("name", name)
    found = {info.name: info for info in known}
    if name not in found:
        raise unknown_name("benchmark", name, found, "`b4mrl list benchmarks` has all")
    return found[name]


def read_datasets(ask: Callable[[Any], Any]) -> Iterator[descriptions.DatasetInfo]:
    """All datasets; `ask` sends a request to the dataset worker and returns its reply.

    InternalError: the pages have more than 16 MiB.
    """
    known = size = 0
    while True:
        request = Request()
        request.list_datasets.first = known
        request.list_datasets.SetInParent()
        page = ask(request).list_datasets
        size += page.ByteSize()
        _check_size(size)
        yield from map(descriptions.read, page.datasets)
        known += len(page.datasets)
        if not page.datasets or known >= page.total:
            return


def _check_size(size: int) -> None:
    """Bounds the bytes of a list's pages, whatever number of entries the server claims."""
    if size > _MOST_BYTES:
        raise InternalError(f"the server's list has more than {_MOST_BYTES} bytes")


def _page(ask: Callable[[Any], Any], first: int, with_benchmarks: bool) -> Any:
    request = Request()
    request.catalogue.first = first
    request.catalogue.with_benchmarks = with_benchmarks
    return ask(request).catalogue


def _entries(reply: Any) -> int:
    return len(reply.environments) + len(reply.perturbations) + len(reply.benchmarks)
