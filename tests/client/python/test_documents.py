"""The programs of the documentation run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import b4mrl
import numpy as np
import pytest

from made_dataset import write_example

ROOT = Path(__file__).parents[3]


def programs(document: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)


@pytest.mark.parametrize("document", ["README.md", "client/python/README.md"])
def test_the_first_program_runs_as_it_stands(document: str) -> None:
    program = programs(document)[0]
    names: dict[str, object] = {}
    exec(program, names)
    assert names["observation"].shape == names["env"].observation_space.shape


def program_with(text: str, document: str = "client/python/README.md") -> str:
    (program,) = [each for each in programs(document) if text in each]
    return program


def test_the_datasets_of_the_readme_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the program keeps pairs there
    columns = write_example(tmp_path / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        names: dict[str, object] = {"client": client}
        exec(program_with("dataset.load()"), names)
        np.testing.assert_array_equal(names["data"]["rewards"], columns["rewards"])
        np.testing.assert_array_equal(names["part"]["actions"], columns["actions"][1000:2000])
        assert names["batch"]["simulator_next_observations"].shape == (256, 17)
        assert len(names["returns"]) == 50
        names["dataset"].close()
        exec(program_with("client.ledger()"), names)
        assert names["ledger"].counts().dataset_rows == 256
        names["env"].close()


def test_the_agent_of_the_readme_acts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (agent, *_) = sorted((ROOT / "data" / "agents").glob("*.h5"))
    (tmp_path / "agent.h5").symlink_to(agent)
    monkeypatch.chdir(tmp_path)
    names = {"b4mrl": b4mrl, "observation": np.zeros(17)}
    exec(program_with("load_agent"), names)
    assert names["action"].shape == (6,)


def test_the_network_of_the_readme_is_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Linear:
        weight, bias = np.ones((6, 17)), np.zeros(6)

    class Benchmark:
        mask = np.arange(17) != 9

    monkeypatch.chdir(tmp_path)
    exec(program_with("save_agent"), {"b4mrl": b4mrl, "actor": [Linear(), 3], "bench": Benchmark})
    observation = np.eye(17)[9]
    assert not b4mrl.load_agent("mine.h5")(observation).any()
    assert b4mrl.load_agent("mine.h5").unmasked()(observation).all()


def test_the_hash_of_an_agent_is_that_of_its_policy(tmp_path: Path) -> None:
    document = (ROOT / "REPRODUCIBILITY.md").read_text()
    (code,) = re.findall(
        r"^python -c '\n(.*?)^' one/agent.h5 two/agent.h5$", document, re.DOTALL | re.MULTILINE
    )
    (trained, *_) = sorted((ROOT / "data" / "agents").glob("*.h5"))
    for name, bias, seed in (("one", 0, 0), ("two", 0, 7), ("other", 1, 0)):
        layers = [(np.ones((6, 17)), np.full(6, bias))]
        b4mrl.save_agent(tmp_path / f"{name}.h5", layers, algorithm=name, seed=seed)
    files = [trained, *(tmp_path / f"{name}.h5" for name in ("one", "two", "other"))]
    command = [sys.executable, "-c", code, *files]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    hashes = [line.split()[0] for line in done.stdout.splitlines()]
    assert hashes[1] == hashes[2] and len(set(hashes)) == 3


def test_the_query_of_the_readme_runs(client: b4mrl.Client) -> None:
    names = {"client": client, "observations": np.zeros((3, 17)), "actions": np.zeros((3, 6))}
    exec(program_with("client.query("), names)
    assert names["next_observations"].shape == (3, 17)
