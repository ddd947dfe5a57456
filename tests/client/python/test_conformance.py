"""The conformance table, played in Python: through sockets, local doors and the relay."""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Iterator
from typing import Any

import b4mrl
import numpy as np
import pytest
from conformance import CASES, Player

from equality import assert_same

TABLE = json.loads(CASES.read_text())


@pytest.fixture(scope="module", params=["sockets", "doors", "relay"])
def player(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Player]:
    arguments = ["--single-port"] if request.param == "relay" else []
    data = tmp_path_factory.mktemp("served") / "data"
    shutil.copytree(CASES.parent / "data", data)
    with b4mrl.serve(data=data, tcp=True, workers=2, arguments=arguments) as endpoint:
        player = Player(endpoint, through_doors=request.param == "doors")
        yield player
        player.close()


@pytest.mark.parametrize("case", TABLE, ids=[case["name"] for case in TABLE])
def test_a_server_answers_as_the_table_says(player: Player, case: dict[str, Any]) -> None:
    player.play(case)


def test_a_client_goes_through_the_relay_and_says_so_once() -> None:
    actions = np.zeros((2, 6), np.float32)
    with b4mrl.serve(tcp=True, workers=1, arguments=["--single-port"]) as endpoint:
        with b4mrl.connect(endpoint) as client, warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            relayed = client.make_vec("HalfCheetah", num_envs=2)
            second = client.make("HalfCheetah")
            assert (relayed.transport, second.transport) == ("relay", "relay")
            client.datasets()
            relayed.reset(seed=3)
            got = relayed.step(actions)[0]
            relayed.close()
            second.close()
        assert [str(warning.message).count("slower") for warning in told] == [1]
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            direct = client.make_vec("HalfCheetah", num_envs=2)
        direct.reset(seed=3)
        np.testing.assert_array_equal(got, direct.step(actions)[0])
        direct.close()


@pytest.mark.parametrize(("tcp", "kind"), [(True, "tcp"), (False, "ipc")])
def test_a_client_takes_the_door_where_there_is_one_and_says_nothing(tcp: bool, kind: str) -> None:
    results = {}
    for arguments, transport in (([], "door"), (["--no-door"], kind)):
        with b4mrl.serve(tcp=tcp, workers=1, arguments=arguments) as endpoint:
            with b4mrl.connect(endpoint) as client, warnings.catch_warnings():
                warnings.simplefilter("error")
                with client.make("HalfCheetah") as env, client.make_vec("Hopper", 3) as vec:
                    assert (env.transport, vec.transport) == (transport, transport)
                    env.reset(seed=1)
                    vec.reset(seed=1)
                    steps = [env.step(np.full(6, 0.1 * i)) for i in range(10)]
                    batches = [vec.step(np.full((3, 3), 0.1 * i)) for i in range(10)]
                    results[transport] = steps, batches, vec.get_state()
                answer = client.query("HalfCheetah", np.zeros((3000, 17)), np.zeros((3000, 6)))
                assert answer[3].all()
    assert_same(results["door"], results[kind])
