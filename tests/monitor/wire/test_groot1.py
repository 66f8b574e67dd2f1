"""Groot 1's protocol, byte for byte: against captures of BehaviorTree.CPP 3.8.7, and against noise."""

import re
import struct
from ast import literal_eval
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from btcore_monitor.events import NODE_TYPES
from btcore_monitor.wire import groot1
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1 import Update, WireTransition, decode_update, encode_update
from btcore_monitor.wire.groot1_tree import (
    WireModel,
    WireNode,
    WirePort,
    WireTree,
    decode_tree,
    encode_tree,
    read_groot1,
    status_places,
)

CAPTURES = Path(__file__).parents[1] / "captures"
LISTING = (CAPTURES / "g3cli.out.txt").read_text()
TREE = (CAPTURES / "v3_behaviortree.flatbuffer.bin").read_bytes()
UPDATES = [(CAPTURES / f"v3_pub_{number}.bin").read_bytes() for number in (1, 2, 3)]
UUID = "13d1ef3eabd249e29d185f4ad8d7fd3a"

NODE = re.compile(r"  uid (\d+) children (\[.*?\]) status absent=0 name (\S+) reg (\S+) ports (.*)")
MODEL = re.compile(r"  model (\S+) type (\d) (.*)")


def test_the_captured_tree_equals_the_listing() -> None:
    nodes = decode_tree(TREE).nodes
    listed = [
        WireNode(int(uid), tuple(literal_eval(children)), 0, name, id, tuple(literal_eval(ports)))
        for uid, children, name, id, ports in NODE.findall(LISTING)
    ]
    assert list(nodes) == listed
    assert len(nodes) == 11


def test_the_captured_models_equal_the_listing() -> None:
    models = {model.id: model for model in decode_tree(TREE).models}
    assert len(models) == 32
    listed = MODEL.findall(LISTING)
    assert len(listed) == 10
    for id, kind, ports in listed:
        found = models[id]
        assert found.type == int(kind)
        # the captures' texts of built-in ports are blanked
        assert [port[:3] for port in found.ports] == [port[:3] for port in literal_eval(ports)]
    assert models["Count"].ports[1] == WirePort("ticks", 0, "int", "how many")


def test_the_captured_updates_equal_the_listing() -> None:
    states = re.findall(r"^   st .*", LISTING, re.MULTILINE)
    changes = re.findall(r"   tr (\(.*?\)) \w{24}", LISTING)
    for frame, line in zip(UPDATES, states, strict=True):
        update = decode_update(frame)
        assert list(update.statuses.items()) == [
            literal_eval(text) for text in re.findall(r"\(\d+, \d\)", line)
        ]
        for change in update.transitions:
            seconds, micros, *rest = literal_eval(changes.pop(0))
            assert change == WireTransition((seconds * 1_000_000 + micros) * 1_000, *rest)
    assert not changes


@pytest.mark.parametrize("frame", UPDATES)
def test_a_captured_update_is_encoded_to_the_same_bytes(frame: bytes) -> None:
    update = decode_update(frame)
    assert encode_update(update.statuses.items(), update.transitions) == frame


def test_an_update_starts_with_the_last_statuses_of_the_previous_update() -> None:
    known = dict(decode_update(UPDATES[0]).statuses)
    for frame in UPDATES:
        update = decode_update(frame)
        assert update.statuses == known
        for change in update.transitions:
            assert known[change.uid] == change.previous
            known[change.uid] = change.status


def test_the_captured_tree_is_unchanged_after_encoding_and_decoding() -> None:
    tree = decode_tree(TREE)
    assert decode_tree(encode_tree(tree)) == tree


def test_the_status_of_each_node_can_be_changed_in_place() -> None:
    data = bytearray(encode_tree(decode_tree(TREE)))
    for number, place in enumerate(status_places(bytes(data))):
        data[place] = number % 4
    assert [node.status for node in decode_tree(bytes(data)).nodes] == [number % 4 for number in range(11)]


def test_the_captured_tree_gets_paths_by_the_rule_of_version_4() -> None:
    found = read_groot1(decode_tree(TREE), UUID)
    tree = found.tree
    assert (tree.tree_id, tree.name) == (UUID, "root_seq")
    assert tree.subtrees == {"": "root_seq", "Sub::6": "Sub", "Sub::9": "Sub"}
    assert [(node.path, node.type, node.parent, node.subtree) for node in tree.nodes] == [
        ("root_seq", "control", 0, ""),
        ("SetBlackboard::2", "action", 1, ""),
        ("Fallback::3", "control", 1, ""),
        ("AlwaysFailure::4", "action", 3, ""),
        ("cnt", "action", 3, ""),
        ("Sub::6", "subtree", 1, ""),
        ("Sub::6/Sequence::7", "control", 6, "Sub::6"),
        ("Sub::6/Count::8", "action", 7, "Sub::6"),
        ("Sub::9", "subtree", 1, ""),
        ("Sub::9/Sequence::10", "control", 9, "Sub::9"),
        ("Sub::9/Count::11", "action", 10, "Sub::9"),
    ]
    assert tree.nodes[1].ports == {"output_key": "x", "value": "42"}


def test_the_observed_tree_has_uids_from_1_for_a_second_tree_of_a_process() -> None:
    nodes = (WireNode(12, (13,), 1, "Inverter", "Inverter"), WireNode(13, (), 3, "look", "Look"))
    found = read_groot1(WireTree(nodes, ()), UUID)
    assert [(node.uid, node.type, node.children) for node in found.tree.nodes] == [
        (1, "decorator", (2,)),
        (2, "action", ()),
    ]
    assert found.uids == {12: 1, 13: 2}
    assert found.statuses == {1: 1, 2: 3}


@pytest.mark.parametrize(
    ("children", "message"),
    [
        ([(), ()], "expected a tree, and node 2 has no parent"),
        ([(2,), (1,)], "node 2 has node 1 as a child"),
        ([(2, 2), ()], "node 1 has node 2 as a child"),
        ([(7,), ()], "node 1 has node 7 as a child"),
    ],
)
def test_nodes_that_do_not_form_a_tree_are_reported(children: Any, message: str) -> None:
    nodes = tuple(WireNode(uid, below, 0, "n", "N") for uid, below in enumerate(children, start=1))
    with pytest.raises(ProtocolError, match=message):
        read_groot1(WireTree(nodes, ()), UUID)


def test_a_tree_without_nodes_or_with_a_duplicate_uid_is_reported() -> None:
    with pytest.raises(ProtocolError, match="got none"):
        read_groot1(WireTree((), ()), UUID)
    twin = WireNode(1, (), 0, "n", "N")
    with pytest.raises(ProtocolError, match="2 nodes have 1 different uids"):
        read_groot1(WireTree((twin, twin), ()), UUID)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (b"", "got nothing"),
        (b"\0\0\0", "3 bytes"),
        (struct.pack("<I", 4) + bytes(8), "statuses of 3 bytes each"),
        (struct.pack("<I", 30) + bytes(8), "30 bytes in all"),
        (struct.pack("<IHbI", 3, 1, 0, 2) + bytes(12), "2 transitions of 12 bytes each"),
        (UPDATES[0] + b"\0", "5 transitions"),
        (UPDATES[0][:-1], "5 transitions"),
        (struct.pack("<IHbI", 3, 1, 4, 0), "a status 0–3 of node 1, and got 4"),
        (struct.pack("<IHbI", 3, 1, -1, 0), "a status 0–3 of node 1, and got -1"),
        (struct.pack("<IIIIHbb", 0, 1, 0, 0, 7, 0, 9), "a status 0–3 of node 7, and got 9"),
    ],
)
def test_a_malformed_update_is_reported(frame: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        decode_update(frame)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "byte 0, but has 0 bytes: nothing"),
        (b"\xff\xff\xff\xff", "points to byte 4294967295"),
        (TREE[:1000], "1000 bytes"),
        (bytes(64), "lacks its field 1"),
    ],
)
def test_data_that_is_not_a_tree_is_reported(data: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        decode_tree(data)


def shared_tables(nodes: int, ports: int) -> bytes:
    """Return a tree of *nodes* references to the same node, which has *ports* references to the same port."""
    vtables = struct.pack("<5H8H4H2x", 10, 12, 0, 4, 8, 16, 20, 0, 4, 0, 8, 12, 16, 8, 12, 4, 8)
    root, node = 40, 60 + 4 * nodes
    port = node + 32 + 4 * ports
    empty, text = node + 20, port + 12
    data = struct.pack("<I", root) + vtables
    data += struct.pack("<iII", root - 4, 52 - 44, node - 4 - 48)
    data += struct.pack("<I", nodes) + b"".join(
        struct.pack("<I", node - place) for place in range(56, node - 4, 4)
    )
    data += struct.pack("<I", 0)
    data += struct.pack("<iIIII", node - 14, *(empty - node - at for at in (4, 8, 12)), 28 - 16)
    data += bytes(8) + struct.pack("<I", ports)
    data += b"".join(struct.pack("<I", port - place) for place in range(node + 32, port, 4))
    return data + struct.pack("<iIII", port - 30, text - port - 4, text - port - 8, 20) + b"x" * 20 + b"\0"


def test_shared_tables_are_accepted_up_to_a_limit() -> None:
    tree = decode_tree(shared_tables(2, 3))
    assert tree.nodes == (WireNode(0, (), 0, "", "", (("x" * 20, "x" * 20),) * 3),) * 2
    with pytest.raises(ProtocolError, match="refers to the same bytes too often"):
        decode_tree(shared_tables(1000, 1000))


texts = st.text(max_size=12)
uids = st.integers(1, 0xFFFF)
ports = st.lists(st.tuples(texts, texts), max_size=3).map(tuple)
nodes = st.builds(
    WireNode, uids, st.lists(uids, max_size=4).map(tuple), st.integers(0, 3), texts, texts, ports
)
models = st.builds(
    WireModel,
    texts,
    st.integers(0, len(NODE_TYPES)),
    st.lists(st.builds(WirePort, texts, st.integers(0, 2), texts, texts), max_size=3).map(tuple),
)
trees = st.builds(WireTree, st.lists(nodes, max_size=8).map(tuple), st.lists(models, max_size=5).map(tuple))
changes = st.builds(
    WireTransition,
    st.integers(0, 0xFFFFFFFF * 1_000_000).map(lambda micros: micros * 1_000),
    uids,
    st.integers(0, 3),
    st.integers(0, 3),
)


@given(trees)
def test_a_tree_is_unchanged_after_encoding_and_decoding(tree: WireTree) -> None:
    assert decode_tree(encode_tree(tree)) == tree


@given(st.dictionaries(uids, st.integers(0, 3)), st.lists(changes, max_size=5))
def test_update_is_unchanged_after_coding(statuses: Any, changed: list[WireTransition]) -> None:
    assert decode_update(encode_update(statuses.items(), changed)) == Update(statuses, tuple(changed))


@settings(max_examples=3 * settings().max_examples)
@given(st.binary(max_size=200))
def test_noise_is_decoded_or_refused(data: bytes) -> None:
    for decode in (decode_tree, decode_update):
        with suppress(ProtocolError):
            decode(data)


@settings(max_examples=5 * settings().max_examples)
@given(st.lists(st.tuples(st.integers(0, len(TREE) - 1), st.integers(0, 255)), min_size=1, max_size=6))
def test_a_damaged_tree_is_read_or_refused(damage: list[tuple[int, int]]) -> None:
    data = bytearray(TREE)
    for place, byte in damage:
        data[place] = byte
    with suppress(ProtocolError):
        read_groot1(decode_tree(bytes(data)), UUID)


@given(st.integers(0, len(TREE) - 1))
def test_a_truncated_tree_is_read_or_refused(size: int) -> None:
    with suppress(ProtocolError):
        decode_tree(TREE[:size])


def test_statuses_unknown_to_groot1_are_sent_as_idle() -> None:
    assert [groot1.status_code(status) for status in range(5)] == [0, 1, 2, 3, 0]
