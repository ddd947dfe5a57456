"""Recognised tables of arrays: a reply that is read by one is the reply that is read in full."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import b4mrl
import numpy as np
import pytest
from b4mrl.errors import InternalError
from b4mrl.wire import arrays, connection, outcomes
from b4mrl.wire.deliveries import Delivery, read_reply
from b4mrl.wire.link import Message
from b4mrl.wire.messages import Reply
from b4mrl.wire.tables import Tables
from google.protobuf.message import DecodeError

from equality import assert_same

SIZE, INFOS = 3, 2


def step_reply(
    request_id: int = 1, count: int = 1, ended: int = 0, swap: bool = False
) -> tuple[Reply, bytearray]:
    """A reply to Step with random numbers; with `swap`, its arrays come in the reverse order."""
    rng = np.random.default_rng(request_id)
    found = {
        "observations": rng.normal(size=(count, SIZE)).astype(np.float32),
        "rewards": rng.normal(size=count),
        "terminated": rng.integers(0, 2, count, np.uint8),
        "truncated": rng.integers(0, 2, count, np.uint8),
        "cause": rng.integers(0, 5, count, np.uint8),
        "digests": rng.integers(0, 2**64, count, np.uint64),
        "infos": rng.normal(size=(count, INFOS)),
    }
    if ended:
        found["final_lanes"] = np.arange(ended, dtype=np.uint32)
    reply = Reply(protocol_version=1, request_id=request_id)
    reply.timing.simulating_us = int(rng.integers(1, 1000))
    items = list(found.items())
    payload = arrays.pack(dict(items[::-1] if swap else items), reply.arrays)
    reply.step.SetInParent()
    return reply, payload


def message(reply: Reply, payload: bytearray) -> Message:
    return reply.SerializeToString(), payload


def read(tables: Tables, it: Message) -> Delivery:
    return read_reply(tables, (it[0], bytearray(it[1])))


def assert_read_in_full(tables: Tables, it: Message) -> None:
    """Reads a message by what `tables` has learnt and without: both have the same contents."""
    learnt, full = read(tables, it), read(Tables(), it)
    assert (learnt.request_id, learnt.executed) == (full.request_id, full.executed)
    assert type(learnt.error) is type(full.error) and str(learnt.error) == str(full.error)
    assert_same(learnt.arrays, full.arrays)
    if full.reply is not None:
        assert learnt.reply.timing == full.reply.timing


def field(number: int, content: bytes) -> bytes:
    """A length-delimited field of fewer than 128 bytes."""
    return bytes([*_varint(number << 3 | 2), len(content)]) + content


def _varint(value: int) -> list[int]:
    return [value] if value < 128 else [value & 127 | 128, value >> 7]


@pytest.fixture
def tables() -> Tables:
    """Tables that have learnt a step of one lane."""
    tables = Tables()
    assert read(tables, message(*step_reply())).error is None
    return tables


def test_the_table_of_a_second_reply_is_recognised(tables) -> None:
    envelope, payload = message(*step_reply(2))
    reply, table = tables.read(envelope, payload)
    assert table is not None
    assert (reply.request_id, len(reply.arrays)) == (2, 0)
    assert read(tables, (envelope, payload)).table is table
    assert_read_in_full(tables, (envelope, payload))


def test_replies_of_changing_shapes_are_those_that_are_read_in_full(tables) -> None:
    rng = np.random.default_rng(0)
    for request_id in range(1, 300):
        count = int(rng.integers(1, 5))
        ended, swap = int(rng.integers(0, 3)), bool(rng.integers(0, 2))
        assert_read_in_full(tables, message(*step_reply(request_id * 977, count, ended, swap)))


def test_steps_that_end_any_of_thirty_numbers_of_episodes_are_all_recognised(tables) -> None:
    counts = np.random.default_rng(0).permutation(30)
    for ended in counts:
        assert read(tables, message(*step_reply(count=64, ended=int(ended)))).error is None
    for ended in counts:
        assert tables.read(*message(*step_reply(2, count=64, ended=int(ended))))[1] is not None


def test_unknown_fields_before_and_behind_the_table_change_nothing(tables) -> None:
    envelope, payload = message(*step_reply(2))
    unknown = field(500, b"from a newer server")
    for it in (unknown + envelope, envelope + unknown, envelope + unknown + unknown):
        assert_read_in_full(tables, (it, payload))
        assert len(read(tables, (it, payload)).arrays) == 7


def test_a_table_in_front_of_the_recognised_one_is_read_too(tables) -> None:
    reply, payload = step_reply(2)
    more = Reply()
    more.arrays.add(name="more", dtype=5, shape=[3], offset=0)
    envelope = more.SerializeToString() + reply.SerializeToString()
    assert len(read(tables, (envelope, payload)).arrays) == 8
    assert_read_in_full(tables, (envelope, payload))


def test_the_learnt_bytes_inside_another_field_are_no_table(tables) -> None:
    reply = step_reply()[0]
    table = Reply(arrays=reply.arrays, step=reply.step).SerializeToString()
    head = Reply(protocol_version=1, request_id=2).SerializeToString()
    size = len(table)
    unknown = bytes([*_varint(500 << 3 | 2), size & 127 | 128, size >> 7]) + table
    assert_read_in_full(tables, (head + unknown, bytearray(1000)))
    assert read(tables, (head + unknown, bytearray(1000))).arrays == {}


def test_an_error_is_an_error_although_its_table_is_known(tables) -> None:
    reply, payload = step_reply(2)
    reply.status.code, reply.status.message = 4, "busy"
    assert_read_in_full(tables, message(reply, payload))
    assert read(tables, message(reply, payload)).executed is False


def test_a_payload_that_is_too_short_for_a_known_table_is_refused(tables) -> None:
    reply, payload = step_reply(2)
    short = message(reply, payload[:-1])
    assert isinstance(read(tables, short).error, InternalError)
    assert_read_in_full(tables, short)


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_a_cut_or_changed_envelope_is_read_as_without_the_table(tables, cut) -> None:
    envelope, payload = message(*step_reply(2))
    changed = bytearray(envelope)
    changed[cut] ^= 0x15
    for it in (envelope[cut:], envelope[:-cut], bytes(changed)):
        try:
            read(Tables(), (it, payload))
        except DecodeError:
            with pytest.raises(DecodeError):
                read(tables, (it, payload))
        else:
            assert_read_in_full(tables, (it, payload))


def test_one_lane_read_as_numbers_is_the_batch_of_one_lane(tables) -> None:
    numbers = outcomes.OutcomeReader(np.dtype(np.float32), SIZE, INFOS)
    for request_id in range(1, 40):
        delivery = read(tables, message(*step_reply(request_id, swap=request_id % 3 == 0)))
        lane = numbers.lane_step(delivery)
        step = outcomes.OutcomeReader(np.dtype(np.float32), SIZE, INFOS).step(delivery, None, 1)
        assert_same(lane.observation, step.observations[0])
        assert lane.infos == tuple(step.infos[0])
        whole = (step.rewards, step.terminated, step.truncated, step.causes, step.digests)
        assert lane[2:] == tuple(column[0].item() for column in whole)
        assert [type(each) for each in lane[2:]] == [float, bool, bool, int, int]


def test_a_reply_of_another_shape_than_the_request_is_refused(tables) -> None:
    reader = outcomes.OutcomeReader(np.dtype(np.float32), SIZE, INFOS)
    reader.lane_step(read(tables, message(*step_reply(1))))
    with pytest.raises(InternalError, match="unreadable reply"):
        reader.lane_step(read(tables, message(*step_reply(2, count=2))))
    with pytest.raises(InternalError, match="unreadable reply"):
        reader.step(read(tables, message(*step_reply(3))), None, 2)
    assert reader.lane_step(read(tables, message(*step_reply(4)))).infos is not None


@pytest.fixture
def record(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Message]]:
    """The messages of a daemon that arrive during a test."""
    recorded: list[Message] = []

    def keep(tables: Tables, message: Message) -> Delivery:
        recorded.append((message[0], bytearray(message[1])))
        return read_reply(tables, message)

    monkeypatch.setattr(connection, "read_reply", keep)
    yield recorded


@pytest.mark.parametrize("autoreset", ["next_step", "same_step"])
def test_recorded_replies_of_a_daemon_are_recognised_and_equal(
    client: b4mrl.Client, record: list[Message], autoreset: str
) -> None:
    options = {"autoreset_mode": autoreset, "config": {"max_episode_steps": 5}}
    with client.make_vec("Hopper", 3, **options) as envs:
        envs.reset(seed=1)
        for _ in range(30):
            envs.step(envs.action_space.sample())
    tables = Tables()
    recognised = 0
    for it in record:
        recognised += tables.read(*it)[1] is not None
        assert_read_in_full(tables, it)
    assert recognised > len(record) / 2


def test_a_single_environment_is_as_in_a_batch(client: b4mrl.Client) -> None:
    make: Callable[..., b4mrl.Environment] = client.make
    options = {"config": {"max_episode_steps": 7}}
    with (
        make("Hopper", **options) as env,
        client.make_vec("Hopper", 1, autoreset_mode="disabled", **options) as envs,
    ):
        env.reset(seed=1)
        envs.reset(seed=1)
        for i in range(15):
            action = np.full(3, 0.1 * i)
            observation, reward, terminated, truncated, info = env.step(action)
            batch = envs.step(action[None])
            assert_same(observation, batch[0][0])
            assert (reward, terminated, truncated) == tuple(it[0].item() for it in batch[1:4])
            assert_same(info, b4mrl.infos.row_of(batch[4], 0))
            assert env.digest == envs.digests[0].item()
            if terminated or truncated:
                env.reset()
                envs.reset(options={"reset_mask": np.array([True])})
