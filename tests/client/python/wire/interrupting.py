"""Ctrl-C at a chosen place."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable

import pytest


def interrupt(call: Callable[[], object], place: str, when: str) -> None:
    """Makes `call`, into which Ctrl-C comes."""
    original = pkgutil.resolve_name(place)

    def interrupted(*arguments: object, **options: object) -> None:
        if when == "after" and original(*arguments, **options) is None and place.endswith("_read"):
            return None  # there was no message yet
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, interrupted)
        with pytest.raises(KeyboardInterrupt):
            call()
