"""Trees of Groot 1's protocol are written as XML, also if XML does not allow characters of their names."""

import pytest

from btcore_monitor.events import ObservedNode, ObservedTree
from btcore_monitor.wire.fulltree import read_fulltree, write_fulltree

TITLE = "\x1b]0;title\x07\ufffe"
ESCAPED = r"\x1b]0;title\x07\ufffe"


def written_and_read(*nodes: ObservedNode) -> ObservedTree:
    tree = ObservedTree("0" * 32, TITLE, nodes, {"": TITLE})
    return read_fulltree(write_fulltree(tree), "0" * 32)


def test_control_characters_in_names_and_ports_are_escaped() -> None:
    leaf = ObservedNode(2, TITLE, "Go", "action", TITLE, 1, (), {"text": TITLE, "ключ": "\u202eé"})
    tree = written_and_read(ObservedNode(1, "root", "Sequence", "control", "root", 0, (2,)), leaf)
    assert tree.name == ESCAPED
    assert tree.nodes[1].name == tree.nodes[1].path == ESCAPED
    assert tree.nodes[1].ports == {"text": ESCAPED, "ключ": "\u202eé"}


@pytest.mark.parametrize("node_id", ["two words", "1st", "", "a:b", "{a}b", "x²", TITLE])
def test_an_id_that_is_no_name_of_an_element_is_kept(node_id: str) -> None:
    tree = written_and_read(ObservedNode(1, "leaf", node_id, "condition", "leaf"))
    assert (tree.root.id, tree.root.type) == (ESCAPED if node_id == TITLE else node_id, "condition")


def test_ports_cannot_replace_the_attributes_of_the_tree() -> None:
    ports = {"_uid": "7", "name": "other", "a b": "1", "ok": "2"}
    tree = written_and_read(ObservedNode(1, "leaf", "Go", "action", "leaf", 0, (), ports))
    assert (tree.root.uid, tree.root.name, tree.root.ports) == (1, "leaf", {"ok": "2"})
