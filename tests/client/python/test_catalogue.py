"""The catalogue, which comes in pages."""

from __future__ import annotations

from typing import Any

import b4mrl
import pytest
from b4mrl import catalogue, errors
from b4mrl.wire.messages import Reply


def test_the_pages_of_the_catalogue_are_put_together(client: b4mrl.Client) -> None:
    whole = catalogue.read(client._ask_gateway, with_benchmarks=True)
    kinds = [whole.environments, whole.perturbations, whole.benchmarks]
    entries = [(i, entry) for i, kind in enumerate(kinds) for entry in kind]
    asked: list[int] = []

    def ask(request: Any) -> Any:
        """At most seven entries, from number `first` on."""
        asked.append(request.catalogue.first)
        reply = Reply()
        page = reply.catalogue
        page.total = whole.total
        lists = [page.environments, page.perturbations, page.benchmarks]
        for kind, entry in entries[request.catalogue.first :][:7]:
            lists[kind].append(entry)
        return reply

    assert catalogue.read(ask, with_benchmarks=True) == whole
    assert asked == list(range(0, whole.total, 7))


def test_a_catalogue_that_promises_more_than_it_has_comes_to_an_end(client: b4mrl.Client) -> None:
    whole = catalogue.read(client._ask_gateway)

    def ask(request: Any) -> Any:
        reply = Reply()
        reply.catalogue.total = whole.total + 1
        if request.catalogue.first == 0:
            reply.catalogue.environments.extend(whole.environments)
        return reply

    assert list(catalogue.read(ask).environments) == list(whole.environments)


def test_benchmarks_say_what_they_are_made_of(client: b4mrl.Client) -> None:
    found = {each.name: each for each in client.benchmarks()}
    one = found["HalfCheetah/confounding/hidden-high+medium-expert"]
    assert (one.environment, one.simulator) == ("HalfCheetah", "gravity")
    assert (one.dataset, one.corruption) == ("HalfCheetah/medium-expert", "hidden-high")
    assert one.paper["td3-bc"][0] > 0 and len(one.paper) == 7
    control = found["HalfCheetah/controls/no-penalty+medium"]
    assert control.hyperparameters == {"penalty": 0}
    assert control.algorithms == ("mopo",)


def test_a_list_without_end_is_given_up() -> None:
    pages = 0

    def ask(request: Any) -> Any:
        nonlocal pages
        pages += 1
        reply = Reply()
        if request.HasField("catalogue"):
            reply.catalogue.environments.add(name="x" * 60_000)
            reply.catalogue.total = 2**32 - 1
        else:
            reply.list_datasets.datasets.add(name="x" * 60_000)
            reply.list_datasets.total = 2**32 - 1
        return reply

    with pytest.raises(errors.InternalError, match="more than"):
        catalogue.read(ask)
    with pytest.raises(errors.InternalError, match="more than"):
        list(catalogue.read_datasets(ask))
    assert pages < 600  # of 60,000 bytes each, until 16 MiB
