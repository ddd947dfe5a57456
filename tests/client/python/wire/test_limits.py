"""The constants and files that the client repeats."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import zmq
from b4mrl import errors
from b4mrl.wire import connection, deliveries, door, limits, listening, sockets, spinning
from b4mrl.wire.link import LONGEST_BLOCK_MS

ROOT = Path(__file__).parents[4]
BASE = ROOT / "proto" / "base"
PACKAGE = ROOT / "client" / "python"


def test_limits_are_those_of_the_server() -> None:
    text = (BASE / "limits.h").read_text()
    found = re.findall(r"constexpr \w+ k(\w+)\s*=\s*([\d'*/ ]+);", text)
    header = {name.lower(): eval(value.replace("'", "_")) for name, value in found}
    ours = {name: value for name, value in vars(limits).items() if name.isupper()}
    assert len(ours) > 10
    for name, value in ours.items():
        assert header[name.replace("_", "").lower()] == value, name


CONSTANTS = [
    ("client/connection.cc", "kPatienceFraction", deliveries._PATIENCE_FRACTION),
    ("client/connection.cc", "kQuiet", connection._QUIET_SECONDS),
    ("client/connection.cc", "kRestart", connection.REACH_MS / 1000),
    ("proto/wire/door.h", "kMagic", door._MAGIC),
    ("proto/wire/door.h", "kVersion", door._VERSION),
    ("proto/wire/door.h", "kDoorWordsBytes", door._MEMORY_START),
    ("proto/wire/door.h", "kSleepsForBytes", door._FOR_BYTES),
    ("proto/wire/door.h", "kSleepsForSpace", door._FOR_SPACE),
    ("proto/wire/listening.cc", "kBetweenLooks", listening._LOOK_SECONDS),
    ("proto/wire/listening.cc", "kTcpWaitMs", listening._TCP_WAIT_MS),
    ("proto/wire/socket.cc", "kLongestBlockMs", LONGEST_BLOCK_MS),
    ("proto/base/spin.h", "kWakeUp", spinning._WAKE_UP * 1e6),
    ("proto/base/spin.h", "kLostSlice", spinning._LOST_SLICE * 1e6),
    ("proto/base/spin.h", "kRestsAfterLoss", spinning._RESTS_AFTER_LOSS),
    ("proto/base/spin.h", "kRestsInVain", spinning._RESTS_IN_VAIN),
    ("proto/base/spin.h", "kLongestLearnt", spinning._LONGEST_LEARNT * 1e6),
    ("proto/base/spin.h", "kMemory", spinning._MEMORY),
]


@pytest.mark.parametrize(
    ("path", "name", "ours"), CONSTANTS, ids=[name for _, name, _ in CONSTANTS]
)
def test_a_constant_is_that_of_the_cpp_source(path: str, name: str, ours: float) -> None:
    """In the unit of C++: 2, seconds{2} or microseconds(2)."""
    text = (ROOT / path).read_text()
    (theirs,) = re.findall(rf"constexpr [\w:]+ {name}(?: = (?:[\w:]+\()?|\{{)(\w+)[;)}}]", text)
    assert int(theirs, 0) == pytest.approx(ours, rel=1e-12)  # fractions of seconds are rounded


def test_a_socket_holds_as_few_unread_replies_as_in_cpp() -> None:
    source = (ROOT / "proto" / "wire" / "socket.cc").read_text()
    assert "kUnreadReplies = 2 * limits::kMaxRequestsInFlight;" in source
    link = sockets.open_link("tcp://127.0.0.1:1")
    assert link._socket.get(zmq.RCVHWM) == 2 * limits.MAX_REQUESTS_IN_FLIGHT
    link.close()


def test_every_status_code_has_its_exception() -> None:
    text = (BASE / "status.h").read_text()
    codes = {int(code): name for name, code in re.findall(r"k(\w+) = (\d+),", text)}
    assert len(codes) == 16
    for code, name in codes.items():
        if code:
            kind = type(errors.error_of(code, "", recoverable=False))
            assert kind.code == code
            assert kind.__name__.removesuffix("Error") in (
                name,
                "Server" + name.removesuffix("Error"),
            )


def test_what_the_client_finds_itself_may_be_repeated_where_the_protocol_says_so() -> None:
    text = (ROOT / "proto" / "PROTOCOL.md").read_text()
    codes = {int(code) for code in re.findall(r"^\| (\d+) \| \w+ \| yes ", text, re.MULTILINE)}
    kinds = {code: type(errors.error_of(code, "", recoverable=False)) for code in range(1, 16)}
    assert {code for code, kind in kinds.items() if kind("").recoverable} == codes


def test_an_unknown_code_counts_as_internal() -> None:
    assert type(errors.error_of(99, "", recoverable=False)) is errors.InternalError


@pytest.mark.parametrize(
    ("copy", "original"),
    [("LICENSE", "LICENSE"), ("b4mrl/wire/b4mrl.proto", "proto/b4mrl.proto")],
)
def test_a_copy_equals_its_original(copy: str, original: str) -> None:
    """After a change of the original: `cp proto/b4mrl.proto client/python/b4mrl/wire`."""
    assert (PACKAGE / copy).read_bytes() == (ROOT / original).read_bytes()


def test_no_link_leads_out_of_the_package() -> None:
    """Archives of sources, and copies of the folder alone, would hold links to nowhere."""
    links = [each for each in PACKAGE.rglob("*") if each.is_symlink()]
    assert [each for each in links if not each.resolve().is_relative_to(PACKAGE)] == []
