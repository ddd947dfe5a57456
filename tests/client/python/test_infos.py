"""Info dictionaries, against Gymnasium's own way of batching them."""

from __future__ import annotations

import numpy as np
import pytest
from b4mrl import errors, infos
from gymnasium.vector import VectorEnv

from equality import assert_same

NAMES = ["x", "tendon[0]", "tendon[1]", "rewards.speed", "rewards.parts[0]", "rewards.parts[1]"]
NAMES += ["crashed"]
RESET_NAMES = ["x", "rewards.speed", "crashed"]


def gymnasium_batch(singles: list[dict]) -> dict:
    batcher = VectorEnv()
    batcher.num_envs = len(singles)
    batch: dict = {}
    for i, single in enumerate(singles):
        batch = batcher._add_info(batch, single, i)
    return batch


def test_a_name_says_where_its_number_belongs() -> None:
    single = infos.InfoLayout(NAMES, RESET_NAMES).single(
        [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 1.0], is_reset=False
    )
    assert_same(
        single,
        {
            "x": 0.0,
            "tendon": np.array([1.0, 2.0]),
            "rewards": {"speed": 3.0, "parts": np.array([4.0, 5.0])},
            "crashed": True,
        },
    )


def test_a_batch_is_what_gymnasium_makes_of_single_dictionaries() -> None:
    layout = infos.InfoLayout(NAMES, RESET_NAMES)
    rows = np.random.default_rng(0).normal(size=(4, len(NAMES)))
    for resets in ([0, 0, 0, 0], [0, 1, 0, 1], [1, 1, 1, 1]):
        is_reset = np.array(resets, bool)
        rows_of_resets = np.where(is_reset[:, None] & ~np.isin(NAMES, RESET_NAMES), 0, rows)
        singles = [layout.single(row.tolist(), flag) for row, flag in zip(rows, is_reset)]
        assert_same(layout.batch(rows_of_resets, is_reset), gymnasium_batch(singles))


def test_causes_are_words_of_those_environments_that_ended() -> None:
    batch: dict = {}
    infos.add_causes(batch, np.array([0, 2, 0, 1], np.uint8))
    assert_same(batch, gymnasium_batch([{}, {"cause": "limit"}, {}, {"cause": "unhealthy"}]))
    infos.add_causes(none := {}, np.zeros(4, np.uint8))
    assert none == {}


def test_scattering_leaves_the_others_out() -> None:
    layout = infos.InfoLayout(NAMES, RESET_NAMES)
    rows = np.random.default_rng(0).normal(size=(2, len(NAMES)))
    batch = layout.batch(rows, np.zeros(2, bool))
    infos.add_causes(batch, np.array([2, 1], np.uint8))
    singles = [layout.single(row.tolist(), is_reset=False) for row in rows]
    singles[0]["cause"], singles[1]["cause"] = "limit", "unhealthy"
    wanted = gymnasium_batch([{}, singles[1], {}, singles[0]])
    assert_same(infos.scatter(batch, np.array([3, 1], np.uint32), 4), wanted)


def test_a_row_of_a_batch_is_the_single_dictionary() -> None:
    layout = infos.InfoLayout(NAMES, RESET_NAMES)
    rows = np.random.default_rng(0).normal(size=(3, len(NAMES)))
    is_reset = np.array([False, True, False])
    batch = layout.batch(rows, is_reset)
    infos.add_causes(batch, np.array([0, 0, 2], np.uint8))
    for i in range(2):
        assert_same(infos.row_of(batch, i), layout.single(rows[i].tolist(), is_reset[i]))
    assert_same(infos.row_of(batch, 2), layout.single(rows[2].tolist(), False) | {"cause": "limit"})


@pytest.mark.parametrize(
    "names",
    [
        ["x", "_x"],
        ["a.x", "a._x.b"],
        ["a", "a.b"],
        ["a.b", "a"],
        ["a", "a[0]"],
        ["a[0]", "a.b"],
        ["." * 9],
    ],
)
def test_names_that_make_no_dictionary_are_refused(names: list[str]) -> None:
    with pytest.raises(errors.InternalError, match="the server names an info"):
        infos.check_info_names(names)


def test_names_that_make_one_are_not() -> None:
    infos.check_info_names(NAMES)
    infos.check_info_names(["", "a.b.c", "a.b.d[0]", "a.e"])
