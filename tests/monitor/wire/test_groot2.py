"""Groot 2's protocol, byte for byte: against captures of BehaviorTree.CPP 4.10.0, and against noise."""

import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Request, RequestHeader, StatusRecord
from btcore_monitor.wire.msgpack_values import decode_boards, encode_boards, to_portable

CAPTURES = Path(__file__).parents[1] / "captures"
UUID = "13d1ef3eabd249e29d185f4ad8d7fd3a"
REPLIES = sorted(path.name.removesuffix(".rep.bin") for path in CAPTURES.glob("*.rep.bin"))
REFUSED = {
    "v4_error_bad_header": "wrong request header",
    "v4_error_missing_part2": "must be 2 parts message",
    "v4_error_unknown_request": "Request not recognized",
    "v4_hook_remove_missing_error": "Node ID not found",
}


def frames_of(name: str) -> list[bytes]:
    """The frames of a capture: each has its length (u32) before it."""
    data = (CAPTURES / f"{name}.bin").read_bytes()
    frames = []
    while data:
        (size,) = struct.unpack_from("<I", data)
        frames.append(data[4 : 4 + size])
        data = data[4 + size :]
    return frames


def body_of(name: str) -> bytes:
    return groot2.decode_reply(frames_of(f"{name}.rep")).body


@pytest.mark.parametrize("name", [name for name in REPLIES if name not in REFUSED])
def test_every_captured_reply_echoes_its_request_and_encodes_to_the_same_bytes(name: str) -> None:
    request = frames_of(f"{name}.req")
    header = RequestHeader.decode(request[0])
    reply = groot2.decode_reply(frames_of(f"{name}.rep"))

    assert (reply.kind, reply.unique_id, reply.tree_id) == (header.kind, header.unique_id, UUID)
    body = reply.body if len(frames_of(f"{name}.rep")) == 2 else None
    assert groot2.encode_reply(header, bytes.fromhex(UUID), body) == frames_of(f"{name}.rep")
    assert groot2.encode_request(Request(header.kind), header.unique_id, *request[1:]) == request


@pytest.mark.parametrize(("name", "sentence"), REFUSED.items())
def test_a_captured_error_reply_raises_its_message(name: str, sentence: str) -> None:
    with pytest.raises(RobotRefusedError) as raised:
        groot2.decode_reply(frames_of(f"{name}.rep"))
    assert str(raised.value) == sentence
    assert groot2.encode_error(sentence) == frames_of(f"{name}.rep")


def test_before_the_first_tick_all_nodes_are_idle_in_the_trees_order() -> None:
    statuses = groot2.decode_statuses(body_of("v4_status_before_first_tick"))
    assert list(statuses) == [1, 2, 3, 4, 5, 6, 10, 7, 8, 9]
    assert set(statuses.values()) == {StatusRecord(0, 0)}


def test_an_idle_node_has_its_previous_status() -> None:
    statuses = groot2.decode_statuses(body_of("v4_status_after_completion"))
    assert statuses[4] == StatusRecord(status=0, previous=3)
    assert statuses[5] == StatusRecord(status=0, previous=2)
    assert statuses[3] == StatusRecord(status=2, previous=0)


@pytest.mark.parametrize(
    ("previous", "status", "code"), [(1, 0, 11), (2, 0, 12), (3, 0, 13), (0, 1, 1), (1, 2, 2), (1, 3, 3)]
)
def test_a_transition_has_its_status_code(previous: int, status: int, code: int) -> None:
    assert groot2.status_code(previous, status) == code


def test_statuses_encode_to_the_captured_bytes() -> None:
    codes = [(1, 1), (2, 2), (3, 2), (4, 13), (5, 12), (6, 1), (10, 0), (7, 1), (8, 2), (9, 1)]
    assert groot2.encode_statuses(codes) == body_of("v4_status_after_completion")


def test_recorded_transitions_decode_and_encode_to_the_captured_bytes() -> None:
    body = body_of("v4_get_transitions")
    transitions = groot2.decode_transitions(body)
    assert transitions[0] == (509, 1, 1)
    assert transitions[6] == (2154, 4, 0)
    assert transitions[-1] == (2257, 9, 1)
    assert b"".join(groot2.encode_transition(*transition) for transition in transitions) == body


def test_a_transition_keeps_48_bits_of_microseconds() -> None:
    late = (1 << 47) + 12345
    assert groot2.decode_transitions(groot2.encode_transition(late, 65535, 4)) == [(late, 65535, 4)]


def test_the_recordings_start_is_microseconds_in_ascii() -> None:
    assert groot2.decode_recording_start(body_of("v4_toggle_recording_start")) == 1795223146853466


def test_a_reached_breakpoint_names_its_node() -> None:
    assert groot2.decode_breakpoint_reached(frames_of("v4_breakpoint_reached.pub")) == 4


def test_blackboard_names_are_joined_by_semicolons() -> None:
    assert groot2.decode_names(frames_of("v4_blackboard.req")[1]) == ["Main", "Sub::6", "nope"]
    assert groot2.encode_names(["Main", "Sub::6"]) == frames_of("v4_blackboard_after.req")[1]


@pytest.mark.parametrize("name", ["v4_blackboard", "v4_blackboard_after", "v4_blackboard_before_first_tick"])
def test_blackboards_encode_to_the_captured_bytes(name: str) -> None:
    boards = decode_boards(body_of(name))
    assert list(boards) == ["Main", "ROOT", "Sub::6"]
    assert encode_boards(boards) == body_of(name)


def test_captured_blackboards_have_the_robots_values() -> None:
    boards = decode_boards(body_of("v4_blackboard_after"))
    assert boards["Main"] == {"done": 1.0, "f": 2.5, "s": "hello", "val": 4.5, "x": 42}
    assert boards["Sub::6"] == {"lim": 7, "loc": 4.5, "mode": "fast", "o2": 1.5}
    assert groot2.boards_by_path(boards, "Main").keys() == {"", "Sub::6"}


def test_no_blackboards_and_an_empty_blackboard_are_encoded_as_nil() -> None:
    assert encode_boards({}) == b"\xc0"
    assert encode_boards({"Main": {}}) == b"\x81\xa4Main\xc0"
    assert decode_boards(b"\x81\xa4Main\xc0") == {"Main": {}}


@pytest.mark.parametrize(
    ("value", "packed"),
    [
        (True, b"\x01"),
        (False, b"\x00"),
        (None, b"\xc0"),
        (-1, b"\xff"),
        (2**64 - 1, b"\xcf" + b"\xff" * 8),
        (2**64, b"\xc0"),
        (2.5, b"\xca\x40\x20\x00\x00"),
        (0.1, b"\xcb" + struct.pack(">d", 0.1)),
        (1e300, b"\xcb" + struct.pack(">d", 1e300)),
        (float("inf"), b"\xcb" + struct.pack(">d", float("inf"))),
        ([1, 2.5, "a"], b"\x93\x01\xca\x40\x20\x00\x00\xa1a"),
        (object(), b"\xc0"),
    ],
)
def test_a_value_has_its_shortest_exact_encoding(value: Any, packed: bytes) -> None:
    assert encode_boards({"M": {"k": to_portable(value)}}) == b"\x81\xa1M\x81\xa1k" + packed


def test_a_list_that_contains_itself_is_truncated() -> None:
    endless: list[object] = []
    endless.append(endless)
    assert encode_boards({"M": {"k": to_portable(endless)}})


def test_the_captured_full_tree_is_read_as_an_observed_tree() -> None:
    tree = read_fulltree(body_of("v4_fulltree"), UUID)
    assert [(node.uid, node.path, node.type) for node in tree.nodes] == [
        (1, "root_seq", "control"),
        (2, "Script::2", "action"),
        (3, "Fallback::3", "control"),
        (4, "AlwaysFailure::4", "action"),
        (5, "cnt", "action"),
        (6, "Sub::6", "subtree"),
        (7, "Sub::6/Sequence::7", "control"),
        (8, "Sub::6/Script::8", "action"),
        (9, "Sub::6/Count::9", "action"),
        (10, "AlwaysSuccess::10", "action"),
    ]
    assert tree.by_uid[1].children == (2, 3, 6, 10)
    assert tree.by_uid[6].children == (7,)
    assert tree.by_uid[7].parent == 6
    assert tree.by_uid[6].name == "Sub"
    assert tree.by_uid[9].subtree == "Sub::6"
    assert tree.by_uid[5].ports == {"ticks": "3", "out": "{val}", "_onSuccess": "done:=true"}
    assert tree.subtrees == {"": "Main", "Sub::6": "Sub"}
    assert (tree.name, tree.tree_id) == ("Main", UUID)
    assert [node.uid for node in tree.ancestors(9)] == [7, 6, 1]


def tree_of(inside: bytes) -> bytes:
    return b'<root><BehaviorTree ID="M" _fullpath="">' + inside + b"</BehaviorTree></root>"


MANY = b"".join(b'<A _uid="%d"/>' % uid for uid in range(2, 65_537))
BOMB = b'<!DOCTYPE r [<!ENTITY a "aaaa">]>' + tree_of(b'<X _uid="1" name="&a;"/>')


@pytest.mark.parametrize(
    ("xml", "expected_message"),
    [
        (BOMB, "document type"),
        (b"<root>", "expected the full tree as XML"),
        (b"\xff\xfe<\x00", "UTF-8"),
        (b"<trees/>", "expected <root>"),
        (b"<root/>", "expected a <BehaviorTree>"),
        (b'<root><BehaviorTree ID="M"/></root>', "_fullpath"),
        (tree_of(b""), "expected one node"),
        (tree_of(b"<A/>"), "_uid of <A>"),
        (tree_of(b'<SubTree ID="S" _fullpath="s" _uid="1"/>'), "_fullpath 's'"),
        (tree_of(b'<SubTree ID="M" _fullpath="" _uid="1"/>'), "got two"),
        (tree_of(b'<Inverter _uid="1"><A _uid="1"/></Inverter>'), "unique values of _uid .* <A> has 1"),
        (tree_of(b'<A _uid="0"/>'), "unique values of _uid .* <A> has 0"),
        (tree_of(b'<A _uid="%s"/>' % (b"9" * 1_000_000)), "_uid of <A>"),
        (tree_of(b'<A name="%s" _uid="1"/>' % (b"n" * 1001)), "names of at most 1000 characters"),
        (tree_of(b'<%s _uid="1"/>' % (b"n" * 1001)), "names of at most 1000 characters"),
        (tree_of(b'<SubTree _fullpath="%s" _uid="1"/>' % (b"n" * 4001)), "paths of at most 4000 characters"),
        (tree_of(b'<S _uid="1">%s</S>' % MANY), "a full tree of at most 65535 nodes, and got more"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_invalid_full_tree_is_refused_with_its_reason(xml: bytes, expected_message: str) -> None:
    with pytest.raises(ProtocolError, match=expected_message):
        read_fulltree(xml, UUID)


def test_a_tree_of_a_thousand_levels_is_read() -> None:
    depth = 1000
    opened = "".join(f'<Inverter _uid="{uid}">' for uid in range(1, depth))
    xml = f'<root><BehaviorTree ID="M" _fullpath="">{opened}<A _uid="{depth}"/>{"</Inverter>" * (depth - 1)}'
    tree = read_fulltree(f"{xml}</BehaviorTree></root>".encode(), UUID)
    assert tree.depth(depth) == depth - 1
    assert tree.root.type == "decorator"


@pytest.mark.parametrize(
    ("decode", "data", "expected_message"),
    [
        (RequestHeader.decode, b"\x02T\x00", "6 bytes, and got 3 bytes"),
        (groot2.decode_statuses, b"\x01\x00", "3 bytes each"),
        (groot2.decode_statuses, b"\x01\x00\x07", "node 1, and got 7"),
        (groot2.decode_statuses, b"\x01\x00\x0f", "node 1, and got 15"),
        (groot2.decode_statuses, b"\1\0\1" * 100_000, "3 bytes each"),
        (groot2.decode_transitions, b"\x00" * 8, "9 bytes each"),
        (groot2.decode_transitions, b"\x00" * 8 + b"\x0b", "and got 11"),
        (groot2.decode_transitions, bytes(9 * 200_000), "9 bytes each"),
        (groot2.decode_recording_start, b"soon", "decimal digits"),
        (groot2.decode_recording_start, b"9" * 19, "decimal digits"),
        (decode_boards, b"\xc1", "MessagePack"),
        (decode_boards, b"\x93\x01\x02", "MessagePack"),
        (decode_boards, b"\x01", "as a map"),
        (decode_boards, b"\x81\x01\x02", "text as keys"),
        (decode_boards, b"\x81\xa1M\x91\x01", "'M' as a map"),
        (decode_boards, b"\x81\xa1M\x81\xa1x" + b"\x91" * 1000 + b"\xc0", "at most 64 levels"),
        (decode_boards, b"\x81\xa1M\xdd\x00\x98\x96\x80" + b"\x90" * 10_000_000, "at most 8388608 bytes"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_invalid_bytes_are_reported(decode: Callable[..., Any], data: bytes, expected_message: str) -> None:
    with pytest.raises(ProtocolError, match=expected_message):
        decode(data)


DECODERS = [
    RequestHeader.decode,
    groot2.decode_statuses,
    groot2.decode_transitions,
    groot2.decode_recording_start,
    groot2.decode_names,
    decode_boards,
    lambda data: read_fulltree(data, UUID),
]


@given(data=st.binary(max_size=200))
@settings(max_examples=3 * settings().max_examples)
def test_noise_raises_nothing_but_a_protocol_error(data: bytes) -> None:
    for decode in DECODERS:
        with suppress(ProtocolError):
            decode(data)


@given(frames=st.lists(st.binary(max_size=40), max_size=4))
@settings(max_examples=3 * settings().max_examples)
def test_noisy_frames_raise_nothing_but_a_protocol_error(frames: list[bytes]) -> None:
    for decode in (groot2.decode_reply, groot2.decode_breakpoint_reached):
        with suppress(ProtocolError):
            decode(frames)


@given(
    value=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
        max_leaves=20,
    )
)
def test_portable_values_are_unchanged_after_encoding_and_decoding(value: Any) -> None:
    sent = to_portable(value)
    assert decode_boards(encode_boards({"M": {"k": sent}})) == {"M": {"k": sent}}
