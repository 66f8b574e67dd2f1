"""The run channel's messages: encoding and decoding, and errors in invalid messages."""

import functools
import re
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from btcore_monitor.serve.run_channel_server import MAX_BUFFER_BYTES, History
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.run_channel import (
    _MESSAGE_CLASSES,
    BlackboardMessage,
    EndMessage,
    ExceptionMessage,
    HeartbeatMessage,
    MovingSceneMessage,
    PieceMessage,
    StaticSceneMessage,
    TransitionRow,
    TransitionsMessage,
    TreeMessage,
    UnknownMessage,
    decode,
    encode,
)
from btcore_scene import Box, MovingScene, Scan, StaticScene

TREE_ID = "13d1ef3eabd249e29d185f4ad8d7fd3a"
TICKS = TransitionsMessage(
    *(TREE_ID, 3, 1_000, 2_000, 7, 300, 1, True, 41),
    [TransitionRow(900, 1900, 7, 1, 0, 1), TransitionRow(950, 1950, 7, 2, 1, 2)],
)
MESSAGES = [
    TreeMessage(TREE_ID, 5, 6, b"<root/>", 1, 9, {1: 0, 2: 4}),
    StaticSceneMessage(
        TREE_ID,
        StaticScene(parts=(Box(name="wall", size=(1.0, 2.0, 3.0), position=(0.0, 1.0, 1.5)),), frame="map"),
    ),
    TICKS,
    MovingSceneMessage(
        TREE_ID, 4, 1_000, 2_000, MovingScene(stamp=1_000, scan=Scan(stamp=1, ranges=b"\x00\x00\x80\x3f"))
    ),
    BlackboardMessage(TREE_ID, 5, 1, 2, {"": {"x": 42, "goal": None}}),
    ExceptionMessage(TREE_ID, 6, 1, 2, "Patrol/Move", "node 'Patrol/Move' raised"),
    EndMessage(TREE_ID, 7, 1, 2, 3, 0),
    HeartbeatMessage(TREE_ID, 7),
    PieceMessage(TREE_ID, 3, 3, 7, [encode(TICKS)]),
]


NESTED: list[object] = functools.reduce(lambda inner, _: [inner], range(900), [])


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.kind)
def test_a_message_is_unchanged_after_encoding_and_decoding(message: Any) -> None:
    assert decode(encode(message)) == message


def test_every_message_has_its_version_and_kind() -> None:
    for message in MESSAGES:
        whole = msgpack.unpackb(encode(message))
        assert (whole["v"], whole["kind"]) == (1, message.kind)


def test_the_page_of_the_protocols_has_a_row_for_every_kind() -> None:
    page = Path(__file__).parents[3] / "docs/reference/protocols.md"
    _, _, section = page.read_text(encoding="utf-8").partition("\n## The run channel\n")
    table = section.partition("| kind |")[2].partition("\n\n")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == _MESSAGE_CLASSES.keys()


def test_a_newer_version_is_refused_with_a_suggestion() -> None:
    newer = msgpack.packb({"v": 2, "kind": "transitions", "colour": "red"})
    with pytest.raises(ProtocolError, match=r"version 2 .* up to version 1: update btcore on this machine"):
        decode(newer)


def test_unknown_fields_and_kinds_of_messages_are_ignored() -> None:
    whole = msgpack.unpackb(encode(HeartbeatMessage(TREE_ID, 7)))
    assert decode(msgpack.packb(whole | {"mood": "fine"})) == HeartbeatMessage(TREE_ID, 7)
    assert decode(msgpack.packb({"v": 1, "kind": "smell", "tree_id": TREE_ID, "seq": 8})) == UnknownMessage(
        TREE_ID, 8
    )


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.kind)
def test_a_missing_or_invalid_field_is_reported(message: Any) -> None:
    whole = msgpack.unpackb(encode(message), strict_map_key=False)
    for field in fields(message):
        without = {key: value for key, value in whole.items() if key != field.name}
        with pytest.raises(
            ProtocolError, match=f"'{field.name}' of a '{message.kind}' message .* got nothing"
        ):
            decode(msgpack.packb(without))
        with pytest.raises(ProtocolError, match=f"'{field.name}'"):
            decode(msgpack.packb(whole | {field.name: 1.5}))


@pytest.mark.parametrize(
    ("message", "changed", "expected_message"),
    [
        (TICKS, {"transitions": [[1, 2, 3, 4, 0]]}, "six integers"),
        (TICKS, {"transitions": ["row"]}, "six integers"),
        (TICKS, {"transitions": [[1, 2, 3, 4, 5, "6"]]}, "six integers"),
        (TICKS, {"transitions": [[1, 2, 3, 4, 5, True]]}, "six integers"),
        (TICKS, {"transitions": [[1, 2, 3, 4, 0, 5]]}, "statuses 0–4 in a transition, and got 0 and 5"),
        (TICKS, {"status": -1}, "'status' of a 'transitions' message from 0 to 4, and got -1"),
        (TICKS, {"first": 2**64 - 1}, "'first' of a 'transitions' message to be int"),
        (TICKS, {"v": [[1]]}, "expected a version of the run channel, and got list"),
        (MESSAGES[0], {"statuses": [[1, 5]]}, r"expected \[uid, status\] in 'statuses'"),
        (MESSAGES[0], {"statuses": NESTED}, r"expected \[uid, status\] in 'statuses'"),
        (MESSAGES[3], {"data": {"more": NESTED}}, "at most 64 levels"),
        (MESSAGES[4], {"boards": {"": 5}}, "the blackboard '' as a map, and got int"),
        (MESSAGES[4], {"boards": [1]}, "'boards' of a 'blackboard' message to be dict"),
        (MESSAGES[4], {"boards": {"": {"x": NESTED}}}, "at most 64 levels"),
        (MESSAGES[8], {"messages": ["text"]}, "messages as bytes in a 'piece' message"),
    ],
)
def test_an_invalid_value_is_reported(message: Any, changed: Any, expected_message: str) -> None:
    whole = msgpack.unpackb(encode(message), strict_map_key=False)
    with pytest.raises(ProtocolError, match=expected_message):
        decode(msgpack.packb(whole | changed))


@given(st.binary(max_size=200))
@settings(max_examples=5 * settings().max_examples)
def test_noise_raises_nothing_but_a_protocol_error(data: bytes) -> None:
    with suppress(ProtocolError):
        decode(data)


VALUES = st.recursive(
    st.none() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(message=st.sampled_from(MESSAGES), data=st.data())
@settings(max_examples=3 * settings().max_examples)
def test_any_value_in_any_field_raises_nothing_but_a_protocol_error(message: Any, data: Any) -> None:
    whole = msgpack.unpackb(encode(message), strict_map_key=False)
    field = data.draw(st.sampled_from(sorted(whole)))
    with suppress(ProtocolError):
        decode(msgpack.packb(whole | {field: data.draw(VALUES)}))


def ticks(seq: int, size: int) -> TransitionsMessage:
    rows = [TransitionRow(10**15 + seq, 10**18 + seq, seq, 1, 1 - row % 2, row % 2) for row in range(size)]
    return TransitionsMessage(TREE_ID, seq, 10**15 + seq, 10**18 + seq, seq, 0, 1, True, 1, rows)


def test_a_history_keeps_a_million_transitions_and_the_statuses_before_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    history = History({1: 3, 2: 4}, 5, 6)
    size = 5_001
    room = MAX_BUFFER_BYTES["transitions"] // len(encode(ticks(1, size)))
    assert room * size > 1_000_000
    room //= 10  # fewer messages behave the same
    monkeypatch.setitem(MAX_BUFFER_BYTES, "transitions", MAX_BUFFER_BYTES["transitions"] // 10)
    for seq in range(1, room + 11):
        history.add("transitions", encode(ticks(seq, size)))
    assert history.oldest_seq > 1
    assert history.latest_seq == room + 10
    assert history.statuses == {1: 0, 2: 4}
    assert history.stamp == 10**15 + history.oldest_seq - 1


def test_big_scenes_do_not_displace_transitions() -> None:
    history = History({}, 0, 0)
    scene_bytes = MAX_BUFFER_BYTES["moving"] // 40 * 4
    for seq in range(1, 41):
        moving = MovingSceneMessage(TREE_ID, seq, 0, 0, MovingScene(scan=Scan(ranges=b"\x00" * scene_bytes)))
        history.add("transitions" if seq % 2 else "moving", encode(ticks(seq, 1) if seq % 2 else moving))
    kept = history_numbers(history)
    assert [seq for seq in kept if seq % 2] == list(range(1, 41, 2))
    assert 5 <= len([seq for seq in kept if seq % 2 == 0]) < 20
    assert 40 in kept


def history_numbers(history: History) -> list[int]:
    numbers: list[int] = []
    first = 1
    while first <= history.latest_seq:
        piece = history.create_piece(TREE_ID, first)
        assert piece.first == first
        numbers += [decode(data).seq for data in piece.messages]
        first = piece.last + 1
    return numbers
