"""The daemon's catalogue, put together from its pages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from b4mrl.wire.messages import Request


def read(ask: Callable[[Any], Any], *, with_benchmarks: bool = False) -> Any:
    """All pages as one CatalogueReply; `ask` sends a request to the gateway, returns its reply."""
    catalogue = _page(ask, 0, with_benchmarks)
    while (known := _entries(catalogue)) < catalogue.total:
        page = _page(ask, known, with_benchmarks)
        if _entries(page) == 0:
            break
        catalogue.MergeFrom(page)
    return catalogue


def _page(ask: Callable[[Any], Any], first: int, with_benchmarks: bool) -> Any:
    request = Request()
    request.catalogue.first = first
    request.catalogue.with_benchmarks = with_benchmarks
    return ask(request).catalogue


def _entries(reply: Any) -> int:
    return len(reply.environments) + len(reply.perturbations) + len(reply.benchmarks)
