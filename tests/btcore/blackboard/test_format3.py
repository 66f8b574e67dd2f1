"""The blackboard of format 3, where it differs."""

import pytest

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import LegacyBlackboard
from btcore.errors import BlackboardError
from btcore.values import ANY, INT, STRING


def scopes():
    root = LegacyBlackboard()
    inner = LegacyBlackboard(root)
    inner.remap("in", "out")
    return root, inner


def test_signs_before_a_key_mean_nothing():
    root, inner = scopes()
    inner.autoremap = True
    inner["_x"] = 1
    inner["@x"] = 2
    assert root["_x"] == 1
    assert root.local_entries()["@x"].value == 2
    assert inner.create("@@y").declared is ANY


def test_every_scope_on_the_way_knows_a_remapped_entry():
    root, inner = scopes()
    entry = inner.create("in", INT)
    assert inner.local_entries()["in"] is entry
    assert root.local_entries()["out"] is entry


def test_an_entry_of_the_parent_s_is_found_without_being_declared():
    root, inner = scopes()
    root["out"] = 1
    assert inner["in"] == 1
    assert inner.local_entries() == {}


def test_an_untyped_entry_stays_untyped():
    board = LegacyBlackboard()
    board["s"] = "a"
    board["s"] = "b"
    board["s"] = 3
    assert board.find("s").declared is ANY


def test_a_typed_entry_takes_its_type_alone():
    board = LegacyBlackboard()
    board["i"] = 1
    for value in (2.0, True, "2"):
        with pytest.raises(BlackboardError, match="'i' cannot change from int to"):
            board["i"] = value
    assert board["i"] == 1


def test_a_text_is_converted_where_a_port_declared_the_type():
    board = LegacyBlackboard()
    board.create("i", INT)
    board["i"] = " +7"
    assert board["i"] == 7
    with pytest.raises(BlackboardError, match="is not an integer"):
        board["i"] = "x"


def test_a_declaration_clashes_but_not_after_a_text():
    root, inner = scopes()
    root.create("s", STRING)
    assert root.create("s", INT).declared is STRING
    inner.create("in", INT)
    with pytest.raises(BlackboardError, match="std::string"):
        inner.create("in", STRING)
    with pytest.raises(BlackboardError, match="std::string"):
        root.create("out", STRING)


def test_none_is_no_value():
    with pytest.raises(BlackboardError, match="None"):
        LegacyBlackboard()["x"] = None


def test_a_remapping_without_a_parent_leads_nowhere():
    board = LegacyBlackboard()
    board.remap("in", "out")
    assert board.find("in") is None
    with pytest.raises(BlackboardError, match="no parent"):
        board["in"] = 1


def test_its_parent_may_be_a_blackboard_that_was_handed_in():
    root = Blackboard()
    inner = LegacyBlackboard(root)
    inner.remap("in", "out")
    inner["in"] = 1
    assert root["out"] == 1
