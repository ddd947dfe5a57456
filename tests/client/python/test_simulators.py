"""Perturbations and corruptions as users write them."""

from __future__ import annotations

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.simulators import parse, text_of


@pytest.mark.parametrize(
    ("written", "text"),
    [
        (None, ""),
        ("", ""),
        ("gravity", "gravity"),
        ("gravity=1.5, obs-noise-low", "gravity=1.5,obs-noise-low"),
        ("gravity = 2", "gravity=2"),
        ({"gravity": 2}, "gravity=2"),
        ({"gravity": 1.5, "hidden": [9, 10]}, "gravity=1.5,hidden=9+10"),
        ({"hidden": np.array([1, 2])}, "hidden=1+2"),
        ({"hidden": list(np.flatnonzero([0, 1, 1]))}, "hidden=1+2"),
        ({"hidden": ["rootz", "v-rooty"]}, "hidden=rootz+v-rooty"),
        ({"hidden": ("rootz", 9)}, "hidden=rootz+9"),
        ({"hidden": np.array(["rootz"])}, "hidden=rootz"),
        ({"gravity": np.float64(0.5), "action-delay": np.int64(2)}, "gravity=0.5,action-delay=2"),
        ({"gravity": None, "obs-noise-low": True}, "gravity,obs-noise-low"),
        ({"model": "own.xml"}, "model=own.xml"),
        ({"obs-noise": 1e-05}, "obs-noise=1e-05"),
        (["gravity", "obs-noise=0.1"], "gravity,obs-noise=0.1"),
        ([("gravity", 2), {"friction": 3}], "gravity=2,friction=3"),
        ((), ""),
        (parse("gravity=2,friction=3"), "gravity=2,friction=3"),
    ],
)
def test_every_form_means_its_text(written: object, text: str) -> None:
    assert text_of(parse(written)) == text


@pytest.mark.parametrize(
    ("written", "complaint"),
    [
        (3, "simulator is 3, allowed"),
        ([3], "perturbation is 3, allowed"),
        ({3: 1}, "perturbation is 3, allowed"),
        ({"gravity": object()}, "gravity is <object"),
        ({"gravity": False}, "gravity is False"),
        ({"gravity": ""}, "gravity is ''"),
        ({"hidden": []}, r"hidden is \[\]"),
        ({"hidden": [True]}, r"hidden is \[True\]"),
        ({"hidden": [1.5]}, r"hidden is \[1.5\]"),
        ({"hidden": ["rootz", ""]}, r"hidden is \['rootz', ''\]"),
        ({"gravity": (0.5, 2.0)}, r"gravity is \(0.5, 2.0\), allowed: .*, or a range '0.5..2'"),
        ("gravity,,friction", "perturbation is ''"),
        ("\ud800", r"perturbation is '\\ud800', allowed: a text"),
        ({"model": "\ud800"}, r"perturbation is 'model=\\ud800', allowed: a text"),
        ([["\ud800", 1]], r"perturbation is '\\ud800=1', allowed: a text"),
        ("hidden=1,2", r"'2' in 'hidden=1,2'.*joined by '\+'"),
    ],
)
def test_what_is_none_of_them_is_refused(written: object, complaint: str) -> None:
    with pytest.raises(errors.InvalidArgumentError, match=complaint):
        parse(written)


def test_every_call_takes_every_form(client: b4mrl.Client) -> None:
    observations, actions = np.full((4, 17), 0.1), np.full((4, 6), 0.5)
    answers, perturbations = [], []
    for simulator in ("gravity=2", {"gravity": 2}, ["gravity=2"], [("gravity", 2.0)]):
        answers.append(client.query("HalfCheetah", observations, actions, simulator)[0])
        with client.make("HalfCheetah", simulator) as env:
            perturbations.append(env.session.in_force.perturbations)
        with client.make_vec("HalfCheetah", 2, simulator) as vec:
            perturbations.append(vec.session.in_force.perturbations)
    assert {str(item) for items in perturbations for item in items} == {"gravity=2"}
    for answer in answers[1:]:
        np.testing.assert_array_equal(answer, answers[0])
    assert not np.array_equal(client.query("HalfCheetah", observations, actions)[0], answers[0])


def test_dimensions_are_hidden_by_their_names(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", {"hidden": ["rootz", "v-root-z"]}) as env:
        assert [str(item) for item in env.session.in_force.perturbations] == ["hidden=0+9"]
