"""How things show themselves at a prompt and in a notebook."""

from __future__ import annotations

import time
from html.parser import HTMLParser
from pathlib import Path

import b4mrl
import numpy as np
from b4mrl.descriptions import DatasetInfo, NamedArgument
from b4mrl.display import Listing, Table, table

from conftest import daemon

ROOT = Path(__file__).parents[3]


class Cells(HTMLParser):
    """The texts of a table's cells; a tag that is never closed is an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.texts: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list) -> None:
        self.open.append(tag)
        self.tags.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_things_say_in_a_line_what_they_are(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", {"gravity": 2}) as env:
        assert repr(env) == (
            "<Environment environment='HalfCheetah', simulator='gravity=2', "
            "observation='(17,) float32', action='(6,) float32', max_episode_steps=1000>"
        )
        assert str(env) == "<Environment<b4mrl/HalfCheetah-v0>>"  # as Gymnasium's wrappers say it
        assert "gravity=2" in env._repr_html_()
        assert (env.environment, env.simulator) == ("HalfCheetah", "gravity=2")
    with client.make_vec("Hopper", 3, autoreset_mode="disabled") as vec:
        assert "num_envs=3, autoreset_mode='disabled'" in repr(vec)
        assert "Hopper" in repr(vec)
        assert (vec.environment, vec.simulator) == ("Hopper", "")
    versions = f"server='{client.server}', engine='{client.engine}'"
    assert repr(client) == f"<Client endpoint='{client.endpoint}', {versions}>"


def test_so_do_agents_and_daemons() -> None:
    agent = repr(b4mrl.load_agent(next((ROOT / "data" / "agents").glob("half*.h5"))))
    assert agent.startswith("<Policy environment='HalfCheetah', algorithm='")
    assert "observation_size=17, action_size=6" in agent
    assert repr(daemon()) == (
        f"<PrivateDaemon endpoint='{daemon().endpoint}', process_id={daemon().process_id}>"
    )


def test_the_catalogue_is_short_and_its_table_complete(client: b4mrl.Client) -> None:
    specs = client.environments()
    assert len(repr(specs["Humanoid"])) < 1000
    assert {"Humanoid", "(376,)"} <= set(Cells(specs._repr_html_()).texts) | {"(376,)"}
    dimensions = Cells(specs["Humanoid"].observation._repr_html_()).texts
    assert set(specs["Humanoid"].observation.names) <= set(dimensions)
    perturbations = client.perturbations()
    assert {"gravity", "obs-noise"} <= {each.name for each in perturbations}
    assert "gravity" in Cells(perturbations._repr_html_()).texts


def test_what_the_daemon_says_is_typed(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", "gravity", seed=5) as env:
        status = client.server_status()
        assert status.session_count >= 1
        assert {type(worker.process_id) for worker in status.workers} == {int}
        assert "gateway" in {worker.role for worker in status.workers}
        Cells(status._repr_html_())
        in_force = env.session.in_force
        assert (in_force.environment, in_force.seed) == ("HalfCheetah", 5)
        assert in_force.perturbations == (NamedArgument("gravity", "2"),)
        assert in_force.autoreset_mode == "disabled"
        assert in_force.config["max_episode_steps"] == 1000
    (gravity,) = [each for each in client.perturbations() if each.name == "gravity"]
    assert gravity.low < 1 < gravity.high
    assert ("gravity", "HalfCheetah", "2") in [
        (preset.name, preset.environment, preset.argument) for preset in gravity.presets
    ]


def test_the_status_counts_milliseconds(client: b4mrl.Client) -> None:
    clocks_ms = 20  # the daemon reads a clock that ticks every 4 or 10 ms

    def look() -> tuple[b4mrl.descriptions.ServerStatus, float, float]:
        """The status, and between which moments it was taken."""
        before = 1000 * time.monotonic()
        return client.server_status(), before, 1000 * time.monotonic()

    def idle(status: b4mrl.descriptions.ServerStatus) -> int:
        (session,) = [each for each in status.sessions if each.perturbations == "gravity=1.23"]
        return session.idle_ms

    with client.make("HalfCheetah", "gravity=1.23") as env:
        before = 1000 * time.monotonic()
        env.reset()
        after = 1000 * time.monotonic()
        first, first_before, first_after = look()
        later, later_before, later_after = look()
        while later_before < first_after + 300:
            later, later_before, later_after = look()
        grown = later.uptime_ms - first.uptime_ms
        assert later_before - first_after - clocks_ms <= grown
        assert grown <= later_after - first_before + clocks_ms
        assert later_before - after - clocks_ms <= idle(later) <= later_after - before + clocks_ms
        before = 1000 * time.monotonic()
        env.step(np.zeros(6))
        used, _, after = look()
        assert idle(used) <= after - before + clocks_ms


def test_whatever_stands_in_a_cell_is_text() -> None:
    evil = "<script>alert('&')</script>"
    cells = Cells(table((evil,), [(evil,), ((evil, 1),)]))
    assert cells.tags == {"table", "thead", "tbody", "tr", "th", "td"}
    assert cells.texts.count(evil) == 2
    info = DatasetInfo(
        name=evil, rows=1, file_bytes=2, sha256="", columns_sha256="", behaviour_policy=evil
    )
    for shown in (info, Listing([info]), Table({evil: info})):
        assert evil in Cells(shown._repr_html_()).texts
        assert "script" not in Cells(shown._repr_html_()).tags
    assert Cells(Listing()._repr_html_()).texts == ["nothing"]
