"""The catalogue, which comes in pages."""

from __future__ import annotations

from typing import Any

import b4mrl
import pytest


def test_the_pages_of_the_catalogue_are_put_together(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = client._catalogue()
    asked: list[int] = []

    def page(first: int) -> Any:
        """At most two entries, from number `first` on."""
        asked.append(first)
        reply = type(whole)(total=whole.total)
        reply.environments.extend(whole.environments[first : first + 2])
        start = max(first - len(whole.environments), 0)
        left = 2 - len(reply.environments)
        reply.perturbations.extend(whole.perturbations[start : start + left])
        return reply

    monkeypatch.setattr(client, "_catalogue_page", page)
    assert client._catalogue() == whole
    assert asked == list(range(0, whole.total, 2))


def test_a_catalogue_that_promises_more_than_it_has_comes_to_an_end(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = client._catalogue()
    pages = {0: type(whole)(total=whole.total + 1, environments=whole.environments)}
    monkeypatch.setattr(
        client, "_catalogue_page", lambda first: pages.get(first, type(whole)(total=99))
    )
    assert list(client._catalogue().environments) == list(whole.environments)
