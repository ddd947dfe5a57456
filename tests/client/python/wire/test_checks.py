"""Checks of arguments: what may be given, and that errors name it."""

from __future__ import annotations

import re
from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks import result_file
from b4mrl.wire import checks


@pytest.mark.parametrize("given", ["a/b", b"a/b", Path("a/b"), np.str_("a/b")])
def test_a_path_may_be_a_text_bytes_or_a_path(given: object) -> None:
    assert checks.path("folder", given) == Path("a/b")


@pytest.mark.parametrize("wrong", [None, 3, 1.5, [], ["a"], "a\0b", b"a\0", object()])
def test_what_is_no_path_is_refused_by_name(wrong: object) -> None:
    allowed = re.escape("allowed: a path, as a text or a pathlib.Path")
    with pytest.raises(errors.InvalidArgumentError, match=f"^path is .*, {allowed}$"):
        b4mrl.load_agent(wrong)
    with pytest.raises(errors.InvalidArgumentError, match=f"^path is .*, {allowed}$"):
        b4mrl.save_agent(wrong, [(np.zeros((6, 17)), np.zeros(6))])
    with pytest.raises(errors.InvalidArgumentError, match=f"^folder is .*, {allowed}$"):
        result_file.find(wrong, "HalfCheetah/clean/medium")


@pytest.mark.parametrize(
    ("rows", "wanted"),
    [
        (slice(None), range(0, 9)),
        (slice(-3, None), range(6, 9)),
        (slice(np.int64(2), np.uint8(4), np.int64(1)), range(2, 4)),
        (slice(20, 30), range(9, 9)),
        (slice(7, 3), range(0)),
    ],
)
def test_a_slice_names_its_rows(rows: slice, wanted: range) -> None:
    assert checks.row_slice(rows, 9) == wanted


@pytest.mark.parametrize(
    "wrong",
    [3, "rewards", ..., (1, 2), np.arange(3)]
    + [slice(0, 9, step) for step in (2, 0, -1, 1.0, "x")]
    + [slice("a"), slice(0.0, 3)],
)
def test_what_is_no_slice_of_rows_is_refused(wrong: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="^the index is .*allowed: a slice of ro"):
        checks.row_slice(wrong, 9)
