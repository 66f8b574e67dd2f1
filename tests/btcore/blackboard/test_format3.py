"""The blackboard of format 3, where it differs from format 4."""

import pytest

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard
from btcore.errors import BlackboardError
from btcore.values import ANY, INT, STRING


def scopes():
    root = Format3Blackboard()
    inner = Format3Blackboard(root)
    inner.remap("in", "out")
    return root, inner


def test_signs_before_a_key_have_no_meaning() -> None:
    root, inner = scopes()
    inner.autoremap = True
    inner["_x"] = 1
    inner["@x"] = 2
    assert root["_x"] == 1
    assert root.local_entries()["@x"].value == 2
    assert inner.declare("@@y").declared is ANY


def test_remapped_entry_is_known_in_every_scope_of_the_chain() -> None:
    root, inner = scopes()
    entry = inner.declare("in", INT)
    assert inner.local_entries()["in"] is entry
    assert root.local_entries()["out"] is entry


def test_entry_of_the_parent_is_found_without_a_declaration() -> None:
    root, inner = scopes()
    root["out"] = 1
    assert inner["in"] == 1
    assert inner.local_entries() == {}


def test_an_untyped_entry_stays_untyped() -> None:
    board = Format3Blackboard()
    board["s"] = "a"
    board["s"] = "b"
    board["s"] = 3
    assert board.find("s").declared is ANY


def test_typed_entry_accepts_only_its_own_type() -> None:
    board = Format3Blackboard()
    board["i"] = 1
    for value in (2.0, True, "2"):
        with pytest.raises(BlackboardError, match="'i' cannot change from int to"):
            board["i"] = value
    assert board["i"] == 1


def test_int_of_the_program_refuses_texts_even_if_a_port_claims_it() -> None:
    board = Format3Blackboard()
    board["i"] = 1
    board.declare("i", INT)
    with pytest.raises(BlackboardError, match="'i' cannot change from int to"):
        board["i"] = "2"


def test_text_is_converted_after_a_port_declared_the_type() -> None:
    board = Format3Blackboard()
    board.declare("i", INT)
    board["i"] = " +7"
    assert board["i"] == 7
    with pytest.raises(BlackboardError, match="is not an integer"):
        board["i"] = "x"


def test_conflicting_declaration_raises_except_for_a_text_entry() -> None:
    root, inner = scopes()
    root.declare("s", STRING)
    assert root.declare("s", INT).declared is STRING
    inner.declare("in", INT)
    with pytest.raises(BlackboardError, match="std::string"):
        inner.declare("in", STRING)
    with pytest.raises(BlackboardError, match="std::string"):
        root.declare("out", STRING)


def test_none_is_refused_as_a_value() -> None:
    with pytest.raises(BlackboardError, match="None"):
        Format3Blackboard()["x"] = None


def test_remapping_without_a_parent_has_no_entry() -> None:
    board = Format3Blackboard()
    board.remap("in", "out")
    assert board.find("in") is None
    with pytest.raises(BlackboardError, match="no parent"):
        board["in"] = 1


def test_parent_may_be_a_format_4_blackboard() -> None:
    root = Blackboard()
    inner = Format3Blackboard(root)
    inner.remap("in", "out")
    inner["in"] = 1
    assert root["out"] == 1
