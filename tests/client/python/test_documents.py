"""The programs of the documentation run."""

from __future__ import annotations

import re
from pathlib import Path

import b4mrl
import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


def programs(document: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)


@pytest.mark.parametrize("document", ["README.md", "client/python/README.md"])
def test_the_first_program_runs_as_it_stands(document: str) -> None:
    program = programs(document)[0]
    names: dict[str, object] = {}
    exec(program, names)
    assert names["observation"].shape == names["env"].observation_space.shape


def test_the_query_of_the_readme_runs(client: b4mrl.Client) -> None:
    (program,) = [text for text in programs("client/python/README.md") if "client.query(" in text]
    names = {"client": client, "observations": np.zeros((3, 17)), "actions": np.zeros((3, 6))}
    exec(program, names)
    assert names["next_observations"].shape == (3, 17)
