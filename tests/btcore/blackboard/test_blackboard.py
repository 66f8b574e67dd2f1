"""The blackboard: entries, types, scopes."""

import enum
from collections import ChainMap
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import pytest

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import SimClock
from btcore.errors import BlackboardError
from btcore.script.program import compile_script
from btcore.status import Status
from btcore.values import (
    ANY,
    ANY_VALUE,
    BOOL,
    DOUBLE,
    INT,
    INT64,
    NODE_STATUS,
    STRING,
    UINT,
    UINT8,
    VECTOR_DOUBLE,
    VECTOR_INT,
    TypeRegistry,
)


class Colour(enum.Enum):
    RED = 1
    BLUE = 3


class Shape:
    pass


class Circle(Shape):
    pass


@pytest.fixture
def board() -> Blackboard:
    return Blackboard(clock=SimClock(5))


class TestMapping:
    def test_blackboard_is_a_mapping_of_its_written_entries(self, board: Blackboard) -> None:
        board["x"] = 3
        board.declare("declared", INT)
        board["y"] = "text"
        assert isinstance(board, Mapping)
        assert len(board) == 2
        assert dict(board) == {**board} == {"x": 3, "y": "text"}
        assert list(board.items()) == [("x", 3), ("y", "text")]
        assert (list(board.keys()), list(board.values())) == (["x", "y"], [3, "text"])
        assert board.keys() & {"x", "declared"} == {"x"}
        match board:
            case {"x": int(number), "y": "text"}:
                assert number == 3
            case _:
                pytest.fail("the pattern does not match")

    def test_get_returns_the_default_for_a_missing_entry(self, board: Blackboard) -> None:
        board.declare("declared", INT)
        assert board.get("x") is None
        assert board.get("x", 0.5) == 0.5
        assert board.get("declared", default=[]) == []
        board["x"] = 3
        assert board.get("x", 0.5) == board.get("x") == 3

    def test_missing_entry_is_a_key_error_with_a_readable_message(self, board: Blackboard) -> None:
        with pytest.raises(KeyError) as caught:
            board["x"]
        assert str(caught.value) == "there is no entry 'x' on the blackboard"
        with pytest.raises(KeyError, match=r"^there is no entry 'x' in this scope"):
            del board["x"]
        assert ChainMap(board, {"x": 1})["x"] == 1
        assert "{x}".format_map({"x": 2, **board}) == "2"

    @pytest.mark.parametrize(
        ("value", "kind", "expected"),
        [
            (3, int, 3),
            (3, float, 3.0),
            (3.0, int, 3),
            (2**40, int, 2**40),
            (2**63, int, 2**63),
            (True, int, 1),
            ("2.5", float, 2.5),
            ("text", str, "text"),
            (3, str, "3"),
            ([1, 2], list[float], [1.0, 2.0]),
            ("1;2", list[int], [1, 2]),
            (3, Colour, Colour.BLUE),
            (7, object, 7),
        ],
    )
    def test_get_with_a_type_converts_the_value_as_a_port_does(
        self, board: Blackboard, value: Any, kind: Any, expected: Any
    ) -> None:
        board["x"] = value
        result = board.get("x", kind)
        assert result == expected
        assert type(result) is type(expected)

    def test_get_with_a_type_returns_an_object_of_the_users_class(self, board: Blackboard) -> None:
        board["shape"] = circle = Circle()
        assert board.get("shape", Circle) is circle
        assert board.get("shape", Shape) is circle

    @pytest.mark.parametrize(("value", "kind"), [(2.5, int), ("text", float), ("text", Shape), (3, Shape)])
    def test_get_with_another_type_is_error(self, board: Blackboard, value: float | str, kind: type) -> None:
        board["x"] = value
        with pytest.raises(BlackboardError, match=r"^the entry 'x' holds .*, not (long|double|Shape): "):
            board.get("x", kind)
        with pytest.raises(BlackboardError):
            board.get("x", kind, None)

    def test_get_of_missing_entry_with_type_raises_unless_there_is_default(self, board: Blackboard) -> None:
        board["battery"] = 0.5
        with pytest.raises(KeyError, match=r"^there is no entry 'batery' .*did you mean 'battery'"):
            board.get("batery", float)
        assert board.get("batery", float, 1.0) == 1.0

    def test_get_follows_remappings(self) -> None:
        root, inner = scopes()
        root["out"] = 1
        assert inner.get("in", float) == 1.0
        assert len(inner) == 0

    def test_repr_shows_the_entries_and_stays_short(self, board: Blackboard) -> None:
        board["x"] = 3
        board["name"] = "a" * 1000
        assert repr(board).startswith("<Blackboard {'x': 3, 'name': 'aaa")
        for number in range(100):
            board[f"key{number}"] = list(range(1000))
        assert repr(board).endswith(", ...], … and 82 more}>")
        assert len(repr(board)) < 2000

    def test_value_whose_repr_raises_does_not_break_repr_of_blackboard(self, board: Blackboard) -> None:
        class Broken:
            def __repr__(self):
                raise RuntimeError

        board["x"] = Broken()
        assert "<Broken instance" in repr(board)


def scopes() -> tuple[Blackboard, Blackboard]:
    """Return a root and an inner scope whose key `in` is remapped to `out`."""
    root = Blackboard(clock=SimClock())
    inner = Blackboard(root)
    inner.remap("in", "out")
    return root, inner


class TestReading:
    def test_written_value_can_be_read(self, board: Blackboard) -> None:
        board["x"] = 3
        assert board["x"] == 3
        assert "x" in board
        assert list(board) == ["x"]

    def test_missing_key_raises_an_error_with_the_nearest_key(self, board: Blackboard) -> None:
        board["battery"] = 0.5
        with pytest.raises(BlackboardError, match=r"no entry 'batery' .*did you mean 'battery'"):
            board["batery"]

    def test_entry_that_was_never_written_raises_a_different_error(self, board: Blackboard) -> None:
        board.declare("x", INT)
        assert "x" not in board
        assert list(board) == []
        with pytest.raises(BlackboardError, match="never written"):
            board["x"]

    def test_none_is_refused_as_a_value(self, board: Blackboard) -> None:
        with pytest.raises(BlackboardError, match="None"):
            board["x"] = None
        assert board.find("x") is None

    def test_deleted_entry_loses_its_type(self, board: Blackboard) -> None:
        board["x"] = 3
        del board["x"]
        board["x"] = [1.5]
        assert board["x"] == [1.5]
        with pytest.raises(BlackboardError, match="'y'"):
            del board["y"]
        board.unset("y")

    def test_empty_blackboard_is_true(self, board: Blackboard) -> None:
        assert board


class TestWriting:
    def test_every_write_increments_the_sequence_id_and_sets_the_stamp(self, board: Blackboard) -> None:
        board["x"] = 3
        entry = board.find("x")
        assert (entry.sequence_id, entry.stamp) == (1, 5)
        board.clock.advance(1.0)
        board["x"] = 3
        assert (entry.sequence_id, entry.stamp) == (2, 1_000_000_005)

    def test_declaring_an_entry_is_not_a_write(self, board: Blackboard) -> None:
        assert board.declare("x", INT).sequence_id == 0

    def test_first_value_sets_the_type_of_the_entry(self, board: Blackboard) -> None:
        for key, value, kind in [
            ("i", 3, INT),
            ("x", 2.5, DOUBLE),
            ("b", True, BOOL),
            ("l", [1], VECTOR_INT),
        ]:
            board[key] = value
            assert board.find(key).declared is kind

    def test_text_leaves_a_new_entry_untyped_until_the_second_write(self, board: Blackboard) -> None:
        board["s"] = "a"
        assert board.find("s").declared is ANY
        board["s"] = "b"
        assert board.find("s").declared is STRING
        with pytest.raises(BlackboardError, match=r"std::string"):
            board["s"] = 3

    def test_untyped_entry_accepts_any_type_once(self, board: Blackboard) -> None:
        board["s"] = "a"
        board["s"] = 3
        assert board.find("s").declared is INT
        board.declare("any", ANY_VALUE)
        board["any"] = 2.5
        assert board.find("any").declared is DOUBLE

    def test_empty_list_does_not_set_the_item_type(self, board: Blackboard) -> None:
        board["path"] = []
        board["path"] = [1.5]
        assert board.find("path").declared is VECTOR_DOUBLE
        board["path"] = []
        assert board["path"] == []

    @pytest.mark.parametrize(
        ("kind", "value", "stored"),
        [
            (INT, 2.0, 2),
            (INT, "12", 12),
            (INT, "3.7", 3),
            (DOUBLE, 3, 3.0),
            (UINT8, 255, 255),
            (INT64, 2**40, 2**40),
            (BOOL, "true", True),
            (VECTOR_DOUBLE, "1;2", [1.0, 2.0]),
            (STRING, "text", "text"),
        ],
    )
    def test_fitting_numbers_and_convertible_texts_are_accepted(
        self, board: Blackboard, kind: Any, value: float | str, stored: Any
    ) -> None:
        board.declare("x", kind)
        board["x"] = value
        assert board["x"] == stored
        assert type(board["x"]) is type(stored)

    @pytest.mark.parametrize(
        ("kind", "value"),
        [
            (INT, 2.5),
            (INT, 2**40),
            (INT, "abc"),
            (INT, [1]),
            (UINT, -42),
            (UINT8, 300),
            (DOUBLE, 2**60 + 1),
            (STRING, 3),
            (BOOL, 1),
            (NODE_STATUS, "SUCCESS"),
            (VECTOR_INT, [1.5]),
        ],
    )
    def test_other_values_are_refused_without_change(self, board: Blackboard, kind: Any, value: Any) -> None:
        entry = board.declare("x", kind)
        with pytest.raises(BlackboardError, match="'x' has the type"):
            board["x"] = value
        assert entry.value is None
        assert entry.sequence_id == 0

    def test_float_in_an_entry_of_integers_remains_a_float(self, board: Blackboard) -> None:
        board.declare("x", INT)
        compile_script("x := 2.5").run(board)
        board["x"] = 4
        assert repr(board["x"]) == "4.0"
        compile_script("x := 2.5").run(board)
        board["x"] = "7"
        assert repr(board["x"]) == "7.0"
        with pytest.raises(BlackboardError, match=r"2\.5 is not a valid int"):
            board["x"] = 2.5

    def test_an_integer_of_more_than_64_bits_is_refused(self, board: Blackboard) -> None:
        with pytest.raises(BlackboardError, match="64 bits"):
            board["x"] = 2**64

    def test_object_of_a_subclass_is_accepted(self, board: Blackboard) -> None:
        board.declare("shape", TypeRegistry().of(Shape))
        board["shape"] = Circle()
        board["circle"] = Circle()
        with pytest.raises(BlackboardError):
            board["circle"] = Shape()

    def test_every_enum_class_is_its_own_type(self, board: Blackboard) -> None:
        board["colour"] = Colour.RED
        board["colour"] = Colour.BLUE
        with pytest.raises(BlackboardError):
            board["colour"] = Status.IDLE

    def test_foreign_number_is_converted_to_a_python_number(self, board: Blackboard) -> None:
        board["x"] = Fraction(1, 4)
        assert board["x"] == 0.25
        assert type(board["x"]) is float


class TestDeclaring:
    def test_declaring_the_same_type_again_or_no_type_is_allowed(self, board: Blackboard) -> None:
        entry = board.declare("x", INT)
        assert board.declare("x", INT) is entry
        assert board.declare("x") is entry
        assert entry.declared is INT

    def test_declaring_another_type_raises(self, board: Blackboard) -> None:
        board.declare("x", INT)
        with pytest.raises(BlackboardError, match="'x' cannot change from int to std::string"):
            board.declare("x", STRING)

    def test_redeclaring_a_string_or_untyped_entry_keeps_its_type(self, board: Blackboard) -> None:
        board.declare("s", STRING)
        board.declare("a", ANY)
        assert board.declare("s", INT).declared is STRING
        assert board.declare("a", INT).declared is ANY

    def test_written_integer_takes_the_type_of_a_wider_port(self, board: Blackboard) -> None:
        board["x"] = 3
        board["n"] = 3
        board["l"] = [1, 2]
        assert board.declare("x", DOUBLE).value == 3.0
        assert type(board["x"]) is float
        assert board.declare("n", INT64).declared is INT64
        assert board.declare("l", VECTOR_DOUBLE).value == [1.0, 2.0]

    def test_declared_integer_is_refused_for_a_wider_port(self, board: Blackboard) -> None:
        board.set("x", 3, INT)
        with pytest.raises(BlackboardError, match="double"):
            board.declare("x", DOUBLE)
        board["y"] = 3
        board.declare("y", INT)
        with pytest.raises(BlackboardError, match="double"):
            board.declare("y", DOUBLE)

    def test_written_integer_is_refused_for_an_unrelated_type(self, board: Blackboard) -> None:
        board["x"] = 1
        for kind in (UINT, BOOL, STRING):
            with pytest.raises(BlackboardError):
                board.declare("x", kind)

    def test_registered_type_replaces_the_inferred_type_of_its_class(self, board: Blackboard) -> None:
        kind = TypeRegistry().add(complex, complex)
        board["z"] = 1j
        board.declare("z", kind)
        board["z"] = "2j"
        assert board["z"] == 2j


class TestScopes:
    def test_remapped_key_uses_the_entry_of_the_parent(self) -> None:
        root, inner = scopes()
        root["out"] = 3
        assert inner["in"] == 3
        inner["in"] = 4
        assert root["out"] == 4
        assert inner.local_entries() == {}
        assert "out" not in inner

    def test_remapped_key_is_created_at_the_end_of_the_chain(self) -> None:
        root, inner = scopes()
        innermost = Blackboard(inner)
        innermost.remap("deep", "in")
        innermost["deep"] = 1
        assert root["out"] == 1
        assert innermost.declare("deep", INT) is root.find("out")

    def test_first_remapping_of_a_key_is_kept(self) -> None:
        root, inner = scopes()
        inner.remap("in", "other")
        root["out"] = 1
        assert inner["in"] == 1

    def test_local_entry_hides_the_entry_of_the_parent(self) -> None:
        root = Blackboard()
        inner = Blackboard(root)
        inner["x"] = 1
        inner.autoremap = True
        root["x"] = 2
        assert inner["x"] == 1

    def test_autoremap_redirects_every_key_except_private_keys(self) -> None:
        root = Blackboard()
        inner = Blackboard(root)
        inner.autoremap = True
        inner["x"] = 1
        inner["_x"] = 2
        assert root["x"] == 1
        assert "_x" not in root
        root["_y"] = 3
        assert inner.find("_y") is None

    def test_key_stays_local_without_autoremap(self) -> None:
        root = Blackboard()
        inner = Blackboard(root)
        inner["x"] = 1
        assert root.find("x") is None

    def test_at_sign_addresses_the_entry_of_the_root(self) -> None:
        root, inner = scopes()
        innermost = Blackboard(inner)
        innermost["@x"] = 1
        assert root["x"] == 1
        assert innermost["@x"] == 1
        assert root["@x"] == 1
        assert innermost.declare("@new") is root.find("new")

    def test_second_at_sign_is_refused(self) -> None:
        with pytest.raises(BlackboardError, match="more than one '@'"):
            Blackboard().declare("@@x")

    def test_remapping_to_the_root_reads_the_root_and_writes_elsewhere(self) -> None:
        # As in BehaviorTree.CPP: reading resolves the '@', creating an entry does not.
        root, inner = scopes()
        innermost = Blackboard(inner)
        innermost.remap("a", "@x")
        root["x"] = 1
        assert innermost["a"] == 1
        innermost["a"] = 2
        assert root["x"] == 1
        assert inner.local_entries()["@x"].value == 2

    def test_entry_of_an_outer_scope_accepts_only_its_own_type(self) -> None:
        root, inner = scopes()
        root.declare("out", DOUBLE)
        with pytest.raises(BlackboardError, match="double"):
            inner["in"] = 3
        inner["in"] = 3.0
        assert root["out"] == 3.0

    def test_text_is_accepted_by_any_entry_of_an_outer_scope(self) -> None:
        root, inner = scopes()
        root["out"] = 3
        inner["in"] = "text"
        assert root["out"] == "text"
        assert root.find("out").declared is INT

    def test_remapping_without_a_parent_has_no_entry(self) -> None:
        board = Blackboard()
        board.remap("in", "out")
        assert board.find("in") is None
        with pytest.raises(BlackboardError, match="no parent"):
            board["in"] = 1

    def test_unset_ignores_entries_of_the_parent(self) -> None:
        root, inner = scopes()
        root["out"] = 1
        inner.unset("in")
        assert root["out"] == 1

    def test_spaces_are_part_of_a_key(self, board: Blackboard) -> None:
        board[" a "] = 1
        assert "a" not in board
        assert board[" a "] == 1

    def test_child_uses_the_clock_of_its_parent(self) -> None:
        root, inner = scopes()
        assert inner.clock is root.clock

    def test_visible_keys_are_the_readable_keys(self) -> None:
        root, inner = scopes()
        root["out"] = 1
        root["_private"] = 1
        inner["own"] = 1
        assert inner.visible_keys() == ["in", "own"]
        inner.autoremap = True
        assert inner.visible_keys() == ["in", "out", "own"]


class TestCloning:
    def test_clone_into_copies_all_entries_and_removes_others(self, board: Blackboard) -> None:
        copy = Blackboard(clock=SimClock(9))
        copy["x"] = 1
        copy["gone"] = 1
        copy.remap("in", "out")
        board["x"] = 2
        board["new"] = "text"
        board.clone_into(copy)
        assert {key: entry.value for key, entry in copy.local_entries().items()} == {"x": 2, "new": "text"}

    def test_clone_into_continues_sequence_ids_only_of_existing_entries(self, board: Blackboard) -> None:
        copy = Blackboard(clock=SimClock(9))
        copy["x"] = 1
        board["x"] = 2
        board["new"] = 3
        board.clone_into(copy)
        assert (copy.find("x").sequence_id, copy.find("x").stamp) == (2, 9)
        assert copy.find("new").sequence_id == 0
        copy["new"] = 4
        assert board["new"] == 3
