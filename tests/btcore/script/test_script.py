"""The scripting language: rules that the recorded scripts do not cover."""

import enum
import math
from collections.abc import Mapping
from typing import Any

import pytest

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import SimClock
from btcore.errors import ScriptError
from btcore.script.program import compile_script, condition_result
from btcore.values import BOOL, INT, STRING, UINT8, UINT64, VECTOR_INT

ENUMS = {"RED": 1, "BLUE": 3}


class Colour(enum.Enum):
    RED = 1
    BLUE = 3


class Opaque:
    pass


@pytest.fixture
def board() -> Blackboard:
    return Blackboard(clock=SimClock(5))


def run(text: str, board: Blackboard | None = None, enums: Mapping[str, int] | None = None):
    return compile_script(text, ENUMS if enums is None else enums).run(board or Blackboard())


def error_of(text: str, board: Blackboard | None = None) -> ScriptError:
    with pytest.raises(ScriptError) as caught:
        run(text, board)
    return caught.value


class TestTokens:
    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("0x1F", 31),
            ("0X1f", 31),
            ("007", 7),
            ("9223372036854775807", 2**63 - 1),
            ("9223372036854775808", 0),
            ("0x7FFFFFFFFFFFFFFF", 2**63 - 1),
            ("0xFFFFFFFFFFFFFFFF", 0),
            ("9" * 5000, 0),
            ("1e3", 1000.0),
            ("1.5E-1", 0.15),
            ("'a \"b\" \\n'", 'a "b" \\n'),
            ("''", ""),
        ],
    )
    def test_literals(self, text: str, value: float | str) -> None:
        found = run(text)
        assert found == value
        assert type(found) is type(value)

    @pytest.mark.parametrize(
        "text",
        [
            "3foo",
            "0x",
            "0x1G",
            "0x1.5",
            "1.",
            ".5",
            "1.x",
            "1e",
            "1e+",
            "1.5foo",
            "'open",
            ".",
            "$",
            "#",
            '"a"',
            "ä",
        ],
    )
    def test_malformed_tokens_are_refused(self, text: str) -> None:
        assert error_of(text).column == 1

    def test_dot_dot_may_follow_an_integer_directly(self) -> None:
        assert run("65..'a'") == "65a"

    def test_only_space_tab_and_line_ends_are_white_space(self) -> None:
        assert run("\t1\r\n + 1 ") == 2.0
        error_of("1\v+ 1")

    def test_true_and_false_are_lower_case(self) -> None:
        assert run("true") == 1.0
        assert error_of("True").message.startswith("there is no variable 'True'")

    def test_name_may_begin_with_an_at_sign(self, board: Blackboard) -> None:
        inner = Blackboard(board)
        run("@x := 1", inner)
        assert board["x"] == 1
        board.local_entries()[""] = board.find("x")
        assert run("@@x", inner) == 1
        assert error_of("@@y", inner).message.startswith("there is no variable '@y'")


class TestStatements:
    def test_semicolons_are_optional_and_repeatable(self, board: Blackboard) -> None:
        assert run("a:=1 b:=2;; ; a + b;", board) == 3.0

    def test_value_of_a_script_is_that_of_its_last_statement(self, board: Blackboard) -> None:
        assert run("1; 'two'", board) == "two"

    @pytest.mark.parametrize("text", ["", " \n\t"])
    def test_an_empty_script_is_refused(self, text: str) -> None:
        assert "empty" in error_of(text).message

    @pytest.mark.parametrize("text", ["; a := 1", "(1", "1 +", ")", "1 ? 2", "a :=", ":= 1", "()", "1 ? : 2"])
    def test_broken_script_is_refused_before_it_runs(self, text: str) -> None:
        with pytest.raises(ScriptError):
            compile_script(text)

    def test_error_contains_its_position(self) -> None:
        broken = error_of("a := 1;\n b := (2")
        assert (broken.column, broken.width) == (17, 1)
        assert "to close the '(' in column 15" in broken.message
        assert str(broken).endswith("\n   2 |   b := (2\n     |          ^")
        missing = error_of("a := 1; a + wrong")
        assert (missing.column, missing.width) == (13, 5)

    def test_nesting_depth_is_limited(self) -> None:
        assert run("(" * 150 + "1" + ")" * 150) == 1
        for text in ("(" * 5000 + "1" + ")" * 5000, "1?1:" * 5000 + "1", "a:=" * 5000 + "1"):
            assert "nested" in error_of(text).message

    def test_long_chain_of_operators_is_not_nesting(self) -> None:
        assert run("1" + "+1" * 5000) == 5001.0
        assert run("-" * 5000 + "1") == 1.0
        assert run("1" + "<=1" * 5000) == 1.0


class TestPrecedence:
    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("-3-2", -5.0),
            ("2*-3", -6.0),
            ("2+3*4", 14.0),
            ("10-4-3", 3.0),
            ("8/4/2", 1.0),
            ("1|2==3", 1.0),
            ("1|2^3", 0.0),
            ("1|6&3", 3.0),
            ("1&1+1", 0.0),
            ("1<2<3", 1.0),
            ("3>2>2", 0.0),
            ("2==2==2", 1.0),
            ("1==1&&2==2||false", 1.0),
            ("false ? 1 : false ? 2 : 3", 3),
            ("true ? 1 : 2 + 5", 1),
            ("!1==0", 1.0),
            ("~5.5", -6.0),
            ("!!3", 1.0),
            ("-~1", 2.0),
            ("(2+3)*4", 20.0),
        ],
    )
    def test_operator_precedence(self, text: str, value: float) -> None:
        assert run(text) == value

    def test_joining_and_adding_have_the_same_precedence(self) -> None:
        assert run("1 + 2 .. 'a'") == "3.000000a"
        assert "'+' does not support the text 'a1'" in error_of("'a' .. 1 + 2").message

    def test_assignment_extends_to_the_end_of_the_statement(self, board: Blackboard) -> None:
        assert run("a:=b:=1+2", board) == 3.0
        assert board["a"] == board["b"] == 3.0

    def test_assignment_after_the_colon_requires_parentheses(self, board: Blackboard) -> None:
        error_of("true ? a := 1 : b := 2", board)
        assert run("true ? a := 1 : (b := 2)", board) == 1
        assert "b" not in board


class TestEvaluation:
    def test_arithmetic_uses_doubles(self) -> None:
        assert repr(run("1+2")) == "3.0"
        assert run("10/4") == 2.5
        assert run("1/0") == math.inf
        assert run("-1/0") == -math.inf
        assert math.isnan(run("0/0"))

    def test_integer_of_more_than_53_bits_is_refused_in_arithmetic(self, board: Blackboard) -> None:
        board["n"] = 2**53
        assert "too large" in error_of("n + 1", board).message
        assert run("m := n", board) == 2**53

    def test_texts_can_be_added_and_joined_with_numbers(self) -> None:
        assert run("'a' + 'b'") == "ab"
        assert run("'a' .. 1 .. 1.5") == "a11.500000"
        assert run("1 .. 2") is None
        error_of("'a' + 1")

    @pytest.mark.parametrize("script", ["s += s", "s := s .. s", "s := s + s"])
    def test_text_that_a_loop_doubles_has_a_maximum_length(self, script: str, board: Blackboard) -> None:
        run("s := '0123456789'", board)
        for _ in range(16):
            run(script, board)
        message = error_of(script, board).message
        assert "would have 1,310,720 characters; a script can join at most 1,000,000" in message
        assert len(board.get("s")) == 655_360

    def test_bit_operators_require_integers_or_integral_reals(self, board: Blackboard) -> None:
        assert run("6 & 3.0") == 2.0
        assert "needs integers" in error_of("6 | 2.5").message
        assert run("~(0/0)") == 2.0**63
        assert "range" in error_of("~1e300").message

    def test_logic_evaluates_both_sides(self, board: Blackboard) -> None:
        run("false && (a := 1) || (b := 1)", board)
        assert board["a"] == board["b"] == 1

    def test_logic_accepts_integers_0_and_1_and_no_negative_real(self) -> None:
        assert run("1.5 && 1") == 1.0
        assert "needs bools" in error_of("2 && 1").message
        assert "negative" in error_of("1 || -1").message
        error_of("'true' && true")

    def test_comparison_chain_stops_after_a_false_comparison(self, board: Blackboard) -> None:
        assert run("2 < 1 < (a := 1)", board) == 0.0
        assert "a" not in board

    def test_numbers_are_equal_within_float_precision(self) -> None:
        assert run("1 == 1.0000001") == 1.0
        assert run("1 == 1.0000002") == 0.0
        assert run("1/0 == 1/0") == 0.0

    def test_text_is_converted_when_compared_with_a_number(self) -> None:
        assert run("'true' == 1") == 1.0
        assert run("'BLUE' > 2") == 1.0
        assert run("'2.5x' == 2.5") == 1.0
        error_of("'abc' == 1")

    def test_texts_are_compared_alphabetically(self) -> None:
        assert run("'abc' < 'abd'") == 1.0
        assert run("'ab' >= 'abc'") == 0.0

    def test_conditional_requires_a_number_or_a_numeric_text(self) -> None:
        assert run("'2' ? 1 : 0") == 1
        assert run("-1 ? 1 : 0") == 1
        error_of("'true' ? 1 : 0")
        error_of("'' ? 1 : 0")

    def test_only_the_chosen_branch_is_evaluated(self, board: Blackboard) -> None:
        run("true ? 1 : (a := 1)", board)
        assert "a" not in board

    def test_enum_name_hides_a_variable_when_read(self, board: Blackboard) -> None:
        assert run("RED := 7; RED", board) == 1.0
        assert board["RED"] == 7

    def test_enums_are_looked_up_when_the_script_runs(self, board: Blackboard) -> None:
        enums = {}
        program = compile_script("LATE", enums)
        enums["LATE"] = 4
        assert program.run(board) == 4.0

    def test_entry_without_a_value_cannot_be_an_operand(self, board: Blackboard) -> None:
        board.declare("e", INT)
        assert run("e", board) is None
        assert "before '+'" in error_of("e + 1", board).message
        assert "after '<'" in error_of("1 < e", board).message
        error_of("-e", board)
        error_of("e ? 1 : 2", board)
        error_of("x := e", board)

    def test_other_objects_can_only_be_copied(self, board: Blackboard) -> None:
        board["o"] = Opaque()
        assert run("p := o; p", board) is board["o"]
        for text in ("o + 1", "o == o", "!o", "o ? 1 : 2", "'a' .. o", "o += 1", "o := 1", "o := 'a'"):
            assert "Opaque" in error_of(text, board).message

    def test_missing_variable_raises_an_error_with_a_suggestion(self, board: Blackboard) -> None:
        board["battery"] = 1
        assert error_of("batery > 0", board).message.endswith("did you mean 'battery'?")
        assert error_of("1 + BLU", board).message.endswith("did you mean 'BLUE'?")


class TestAssignment:
    def test_only_the_declaring_assignment_creates_an_entry(self, board: Blackboard) -> None:
        for operator in ("=", "+=", "-=", "*=", "/="):
            assert "':=' creates an entry" in error_of(f"x {operator} 1", board).message
        run("x := 1", board)
        assert board["x"] == 1

    def test_entry_is_created_before_its_value_is_evaluated(self, board: Blackboard) -> None:
        error_of("x := missing", board)
        assert board.find("x").value is None

    def test_left_side_must_be_a_name(self, board: Blackboard) -> None:
        for text in ("1 := 2", "a + b := 2", "-a := 2", "'a' = 2"):
            assert "name of an entry" in error_of(text, board).message
        run("(a) := 2", board)
        assert board["a"] == 2

    def test_every_assignment_increments_the_sequence_id_and_sets_the_stamp(self, board: Blackboard) -> None:
        run("x := 1; x = 2; x += 3", board)
        assert (board.find("x").sequence_id, board.find("x").stamp) == (3, 5)

    @pytest.mark.parametrize(
        ("text", "value"),
        [("x := 1", 1), ("x := 1.0", 1.0), ("x := true", 1.0), ("x := 1 + 1", 2.0), ("x := RED", 1.0)],
    )
    def test_first_value_sets_the_kind_of_number(self, board: Blackboard, text: str, value: float) -> None:
        run(text, board)
        assert type(board["x"]) is type(value)
        assert board["x"] == value
        assert not board.find("x").declared.strong

    def test_integer_entry_stays_an_integer(self, board: Blackboard) -> None:
        assert repr(run("a := 1; a = 3.0; a", board)) == "3"
        assert "cannot assign to 'a'" in error_of("a = 2.5", board).message
        assert repr(run("a = 8; a /= 4; a", board)) == "2"
        error_of("a /= 3", board)
        assert board["a"] == 2

    def test_small_integers_and_bools_are_not_checked(self, board: Blackboard) -> None:
        board.declare("b", BOOL)
        board["b"] = True
        assert run("b = 0; b", board) is False
        assert run("b = 2; b", board) == 2
        board.set("u", 3, UINT8)
        assert run("u = 300", board) == 300

    def test_unsigned_64_bit_entry_refuses_negative_numbers(self, board: Blackboard) -> None:
        board.set("u", 3, UINT64)
        error_of("u = -1", board)

    def test_text_is_converted_to_the_type_of_the_entry(self, board: Blackboard) -> None:
        board["i"] = 3
        board.set("v", [1], VECTOR_INT)
        assert run("i = '12'", board) == 12
        assert run("v = '1;2'", board) == [1, 2]
        error_of("i = 'abc'", board)

    def test_text_assigned_to_an_untyped_number_becomes_a_real(self, board: Blackboard) -> None:
        assert repr(run("a := 1; a = '7'", board)) == "7.0"
        assert run("a = 'true'", board) == 1.0

    def test_number_cannot_be_assigned_to_a_text(self, board: Blackboard) -> None:
        board["s"] = "text"
        for text in ("s = 1", "s += 1", "s -= 'a'"):
            error_of(text, board)
        assert run("s += 's'", board) == "texts"

    def test_declared_entry_without_a_value_accepts_any_first_number(self, board: Blackboard) -> None:
        board.declare("i", INT)
        board.declare("j", INT)
        board.declare("s", STRING)
        assert run("i := 2.5", board) == 2.5
        assert run("j := '2'", board) == 2
        assert run("s := 'a'", board) == "a"
        board.declare("k", INT)
        assert "has no value" in error_of("k += 1", board).message

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("k < 3", "the operand before '<' has no value: the entry 'k' was never written"),
            ("1 < 2 < k", "the operand after '<' has no value: the entry 'k' was never written"),
            ("1 + k * 2", "the operand before '*' has no value: the entry 'k' was never written"),
            ("x := k", "the operand after ':=' has no value: the entry 'k' was never written"),
            ("!-k", "the operand after '-' has no value: the entry 'k' was never written"),
            ("k ? 1 : 2", "the operand before '?' has no value: the entry 'k' was never written"),
            ("(1 ? k : 2) + 1", "the operand before '+' has no value: the entry was never written"),
        ],
    )
    def test_operand_without_value_names_entry(self, board: Blackboard, text: str, message: str) -> None:
        board.declare("k", INT)
        error = error_of(text, board)
        assert (error.message, error.unwritten_key) == (message, "k" if "'k'" in message else "")

    def test_an_enum_entry_keeps_its_enum(self, board: Blackboard) -> None:
        board["c"] = Colour.RED
        assert run("c == RED", board) == 1.0
        assert run("c := BLUE", board) is Colour.BLUE
        assert run("c := 7", board) == 7

    def test_remapping_and_the_root_prefix_apply(self, board: Blackboard) -> None:
        inner = Blackboard(board)
        inner.remap("in", "out")
        run("in := 1; @g := 2; own := 3", inner)
        assert {key: entry.value for key, entry in board.local_entries().items()} == {"out": 1, "g": 2}
        assert inner["own"] == 3

    def test_entries_written_before_an_error_are_kept(self, board: Blackboard) -> None:
        error_of("a := 1; b := missing", board)
        assert board["a"] == 1


class TestTruth:
    @pytest.mark.parametrize(
        ("value", "meant"),
        [(1.0, True), (0.0, False), (2.5, True), (math.nan, True), (1, True), (0, False), (True, True)],
    )
    def test_truth_of_numbers(self, value: bool | float, meant: bool) -> None:
        assert condition_result(value) is meant

    @pytest.mark.parametrize("value", [2, -1, -1.0, "true", "", None, [1]])
    def test_other_types_have_no_truth_value(self, value: Any) -> None:
        with pytest.raises(ScriptError):
            condition_result(value)


def test_a_program_runs_on_any_blackboard() -> None:
    program = compile_script("n += 1")
    first, second = Blackboard(), Blackboard()
    first["n"], second["n"] = 1, 10
    assert program.run(first) == 2
    assert program.run(second) == 11
    assert program.run(first) == 3
    assert program.text == "n += 1"
