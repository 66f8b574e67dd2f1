"""Text ⇄ values: rules that the recorded conversions do not cover."""

import enum
import math
from dataclasses import dataclass
from typing import Annotated, Any

import pytest

from btcore.errors import BlackboardError, ConversionError, RegistrationError
from btcore.status import NodeType, Status
from btcore.values import (
    ANY,
    ANY_VALUE,
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    INT8,
    INT64,
    NODE_STATUS,
    NODE_TYPE,
    PORT_DIRECTION,
    STRING,
    UINT,
    UINT8,
    UINT64,
    VECTOR_BOOL,
    VECTOR_DOUBLE,
    VECTOR_INT,
    VECTOR_STRING,
    Int64,
    PortDirection,
    TypeRegistry,
    parse_constant,
    to_text,
    type_of,
)
from btcore.values.types import ValueType, VectorType


class Colour(enum.Enum):
    RED = 1
    BLUE = 3


@dataclass
class Point:
    x: float
    y: float


class Opaque:
    pass


def conversion_error(kind: ValueType, text: str, format: int = 4) -> str:
    with pytest.raises(ConversionError) as caught:
        kind.from_text(text, format)
    return str(caught.value)


class TestTextToValue:
    def test_an_integer_of_five_thousand_digits_is_out_of_range(self) -> None:
        assert "out of range" in conversion_error(INT64, "9" * 5000)
        assert INT.from_text("0" * 5000 + "7") == 7

    def test_digits_of_other_scripts_are_refused(self) -> None:
        conversion_error(INT, "٣")
        conversion_error(DOUBLE, "٣")

    def test_minus_sign_before_zero_is_refused_only_for_uint64(self) -> None:
        assert UINT.from_text("-0.5") == 0
        conversion_error(UINT64, "-0")

    def test_real_too_close_to_zero_or_too_large_is_out_of_range(self) -> None:
        for kind, text in [(DOUBLE, "1e-400"), (DOUBLE, "-1e400"), (FLOAT, "1e-50"), (FLOAT, "3.5e38")]:
            assert "out of range" in conversion_error(kind, text)
        assert DOUBLE.from_text("0e-400") == 0.0
        assert DOUBLE.from_text("4.9e-324") == 5e-324

    def test_float_is_rounded_only_once_from_the_digits(self) -> None:
        # Just above the midpoint of two floats, by less than the precision of a double.
        above = "1.00000005960464477539062500000000000000000001"
        assert float(above) == 1.000000059604644775390625
        assert FLOAT.from_text(above) == 1.00000011920928955078125
        assert FLOAT.from_text("1.000000059604644775390625") == 1.0

    @pytest.mark.parametrize("text", ["infinity", "INF", "inf;1"])
    def test_infinity_is_read_in_any_case(self, text: str) -> None:
        assert DOUBLE.from_text(text) == math.inf

    def test_error_names_the_text_and_the_expected_values(self) -> None:
        assert conversion_error(INT, "abc") == "'abc' is not an integer"
        assert conversion_error(INT8, "128") == "'128' is out of range: -128 to 127"
        assert conversion_error(BOOL, "yes") == "'yes' is not a valid bool; use true, false, 1 or 0"
        assert "SKIPPED" in conversion_error(NODE_STATUS, "Success")

    def test_vector_may_end_with_an_item_or_a_semicolon(self) -> None:
        assert VECTOR_INT.from_text("") == []
        assert VECTOR_INT.from_text("1;2;") == [1, 2]
        assert VECTOR_STRING.from_text("a; b") == ["a", " b"]
        conversion_error(VECTOR_INT, "1;;2")

    @pytest.mark.parametrize(
        ("kind", "text", "value"),
        [
            (VECTOR_INT, "json:[1, 2.9, -2.9, true]", [1, 2, -2, 1]),
            (VECTOR_INT, "json:[4294967297]", [1]),
            (VECTOR_DOUBLE, "json:[1, 2.5]", [1.0, 2.5]),
            (VECTOR_BOOL, "json:[true,false]", [True, False]),
            (VECTOR_STRING, 'json:["a;b"]', ["a;b"]),
            (VECTOR_INT, "json:[]", []),
        ],
    )
    def test_a_vector_may_be_a_json_array(self, kind: VectorType, text: str, value: Any) -> None:
        found = kind.from_text(text)
        assert found == value
        assert [type(item) for item in found] == [type(item) for item in value]

    @pytest.mark.parametrize(
        ("kind", "text"),
        [
            (VECTOR_INT, 'json:["1"]'),
            (VECTOR_INT, "json:null"),
            (VECTOR_DOUBLE, "json:[true]"),
            (VECTOR_DOUBLE, "json:[NaN]"),
            (VECTOR_DOUBLE, "json:[1e400]"),
            (VECTOR_BOOL, "json:[1]"),
            (VECTOR_STRING, "json:[1]"),
            (VECTOR_STRING, "json:" + "[" * 100_000),
        ],
    )
    def test_json_array_of_a_wrong_type_is_refused(self, kind: VectorType, text: str) -> None:
        conversion_error(kind, text)

    def test_a_node_type_is_read_and_written_as_in_the_xml(self) -> None:
        names = {"Action": NodeType.ACTION, "SubTree": NodeType.SUBTREE, "Undefined": NodeType.UNDEFINED}
        for name, node_type in names.items():
            assert NODE_TYPE.from_text(name) is node_type
            assert to_text(node_type) == name
        assert NODE_TYPE.from_text("ACTION") is NodeType.UNDEFINED
        assert NODE_TYPE.from_text("SubTreePlus") is NodeType.UNDEFINED
        assert NODE_TYPE.from_text("SubTreePlus", 3) is NodeType.SUBTREE

    def test_a_direction_is_capitalised_or_in_upper_case(self) -> None:
        assert PORT_DIRECTION.from_text("InOut") is PortDirection.INOUT
        assert PORT_DIRECTION.from_text("OUTPUT") is PortDirection.OUTPUT
        conversion_error(PORT_DIRECTION, "input")


class TestFormat3:
    def test_integers_may_have_leading_spaces_and_a_plus_sign(self) -> None:
        assert INT.from_text(" \t+42abc", 3) == 42
        conversion_error(INT, "2147483648", 3)
        conversion_error(INT, "", 3)

    def test_unsigned_integers_wrap(self) -> None:
        assert UINT.from_text("-1", 3) == 2**32 - 1
        assert UINT64.from_text("-1", 3) == 2**64 - 1
        assert UINT.from_text("4294967296", 3) == 0

    def test_reals_may_be_hexadecimal(self) -> None:
        assert DOUBLE.from_text(" +0x1.8p1", 3) == 3.0
        assert DOUBLE.from_text("0x10", 3) == 16.0
        conversion_error(DOUBLE, "1e400", 3)

    def test_invalid_vector_items_become_zero(self) -> None:
        assert VECTOR_INT.from_text("1;x;;4294967297", 3) == [1, 0, 0, 1]
        assert VECTOR_DOUBLE.from_text("1.5;x", 3) == [1.5, 0.0]

    def test_skipped_and_json_are_not_supported(self) -> None:
        conversion_error(NODE_STATUS, "SKIPPED", 3)
        assert VECTOR_INT.from_text("json:[1]", 3) == [0]


class TestCast:
    """A stored value is read as another type if nothing is lost."""

    @pytest.mark.parametrize(
        ("kind", "value", "expected"),
        [
            (INT, 2.0, 2),
            (INT, True, 1),
            (INT, "42abc", 42),
            (INT, Status.SUCCESS, 2),
            (INT, Colour.BLUE, 3),
            (DOUBLE, 3, 3.0),
            (DOUBLE, "2.5", 2.5),
            (FLOAT, 0.1, 0.10000000149011612),
            (BOOL, 1, True),
            (BOOL, 2.5, True),
            (BOOL, math.nan, True),
            (STRING, 2.5, "2.500000"),
            (STRING, 7, "7"),
            (STRING, True, "1"),
            (NODE_STATUS, 2.0, Status.SUCCESS),
            (VECTOR_DOUBLE, [1, 2.5], [1.0, 2.5]),
            (VECTOR_INT, (1, 2), [1, 2]),
        ],
    )
    def test_fitting_values_are_cast(self, kind: ValueType, value: Any, expected: Any) -> None:
        found = kind.cast(value)
        assert found == expected
        assert type(found) is type(expected)

    @pytest.mark.parametrize(
        ("kind", "value"),
        [
            (INT, 2.5),
            (INT, 2**31),
            (INT, math.inf),
            (INT, math.nan),
            (INT, [1]),
            (INT, None),
            (UINT, -1),
            (UINT8, 256.0),
            (INT64, 2.0**63),
            (DOUBLE, 2**53),
            (DOUBLE, "x"),
            (BOOL, 2),
            (BOOL, -1.0),
            (BOOL, "true"),
            (STRING, [1]),
            (NODE_STATUS, 7),
            (VECTOR_INT, [1.5]),
            (VECTOR_INT, "1;2"),
            (ANY, None),
        ],
    )
    def test_other_values_are_refused(self, kind: ValueType, value: Any) -> None:
        with pytest.raises(ConversionError):
            kind.cast(value)

    def test_list_of_the_right_type_is_not_copied(self) -> None:
        items = [1.0, 2.0]
        assert VECTOR_DOUBLE.cast(items) is items


class TestTypes:
    @pytest.mark.parametrize(
        ("annotation", "kind"),
        [
            (int, INT),
            (float, DOUBLE),
            (str, STRING),
            (bool, BOOL),
            (Status, NODE_STATUS),
            (object, ANY),
            (Any, ANY),
            (list[int], VECTOR_INT),
            (list[float], VECTOR_DOUBLE),
            (int | None, INT),
            (int | str, ANY),
            (Int64, INT64),
            (Annotated[int, "metres"], INT),
            (UINT, UINT),
        ],
    )
    def test_type_of_an_annotation(self, annotation: Any, kind: ValueType) -> None:
        assert TypeRegistry().of(annotation) is kind

    def test_type_names_are_those_of_c_plus_plus(self) -> None:
        types = TypeRegistry()
        for name in ["int", "unsigned int", "long", "double", "std::string", "std::vector<bool>"]:
            assert types.named(name).name == name
        assert types.named("BT::AnyTypeAllowed") is ANY
        assert not ANY.strong
        assert not ANY_VALUE.strong
        assert types.named("nothing") is None

    def test_same_annotation_gives_the_same_type(self) -> None:
        types = TypeRegistry()
        assert types.of(Opaque) is types.of(Opaque)
        assert types.of(Colour) is types.of(Colour)
        assert types.of(list[Opaque]) is types.of(list[Opaque])

    def test_an_enum_is_read_by_name_or_by_number(self) -> None:
        kind = TypeRegistry().of(Colour)
        assert kind.from_text("BLUE") is Colour.BLUE
        assert kind.from_text("1") is Colour.RED
        assert kind.cast(3.0) is Colour.BLUE
        assert kind.to_text(Colour.RED) == "RED"
        assert conversion_error(kind, "GREEN") == "'GREEN' is not a member of Colour; use RED or BLUE"
        conversion_error(kind, "2")
        conversion_error(kind, "1x")

    def test_enum_names_are_known_to_scripts_once_registered(self) -> None:
        types = TypeRegistry()
        types.add_enum(Colour)
        types.add_enum({"UP": 1})
        assert types.enums == {"RED": 1, "BLUE": 3, "UP": 1}

    def test_enum_name_cannot_have_two_numbers(self) -> None:
        types = TypeRegistry()
        types.add_enum(Colour)
        types.add_enum({"RED": 1})
        with pytest.raises(RegistrationError, match="RED is 1 already, not 2"):
            types.add_enum({"RED": 2})
        with pytest.raises(RegistrationError, match="integers"):
            types.add_enum({"NAME": "text"})

    def test_a_class_may_be_given_a_text_form(self) -> None:
        types = TypeRegistry()
        kind = types.add(complex, complex, str, name="std::complex")
        assert types.of(complex) is kind
        assert kind.from_text("1+2j") == 1 + 2j
        assert kind.to_text(1j) == "1j"
        assert conversion_error(kind, "x").startswith("'x' is not a valid std::complex: ")
        with pytest.raises(RegistrationError, match="text form already"):
            types.add(complex, complex)
        with pytest.raises(RegistrationError, match="text form already"):
            types.add(int, int)

    def test_registries_are_independent(self) -> None:
        first, second = TypeRegistry(), TypeRegistry()
        first.add(complex, complex)
        first.add_enum(Colour)
        assert conversion_error(second.of(complex), "1j")
        assert second.enums == {}

    def test_a_class_without_a_text_form_has_no_literal(self) -> None:
        assert "no text form" in conversion_error(TypeRegistry().of(Opaque), "x")

    def test_a_dataclass_is_read_from_json(self) -> None:
        kind = TypeRegistry().of(Point)
        assert kind.from_text('json:{"__type": "Point", "x": 1, "y": 2.5}') == Point(1, 2.5)
        assert kind.from_text(to_text(Point(1.0, 2.0))) == Point(1.0, 2.0)
        conversion_error(kind, 'json:{"z": 1}')
        conversion_error(kind, "json:[1]")
        conversion_error(kind, "1;2")


class TestTypeOfAValue:
    @pytest.mark.parametrize(
        ("value", "kind"),
        [
            (3, INT),
            (2**31, INT64),
            (2**63, UINT64),
            (True, BOOL),
            (2.5, DOUBLE),
            ("text", STRING),
            (Status.IDLE, NODE_STATUS),
            ([1, 2], VECTOR_INT),
            ([1.5], VECTOR_DOUBLE),
            ([True], VECTOR_BOOL),
            (["a"], VECTOR_STRING),
            ([], ANY),
        ],
    )
    def test_the_type_follows_the_value(self, value: Any, kind: ValueType) -> None:
        assert type_of(value) is kind

    def test_type_of_an_object_is_its_class(self) -> None:
        assert type_of(Opaque()).same(TypeRegistry().of(Opaque))
        assert not type_of(Opaque()).same(type_of(Point(1, 2)))
        assert type_of(Colour.RED).same(TypeRegistry().of(Colour))

    def test_integer_of_more_than_64_bits_is_refused(self) -> None:
        with pytest.raises(BlackboardError, match="at most 64 bits"):
            type_of(2**64)


class TestValueToText:
    @pytest.mark.parametrize(
        ("value", "text"),
        [
            (3, "3"),
            (2.5, "2.500000"),
            (-math.nan, "-nan"),
            (-math.inf, "-inf"),
            (True, "true"),
            (False, "false"),
            ("text", "text"),
            (Status.SKIPPED, "SKIPPED"),
            (PortDirection.INOUT, "InOut"),
            ([1, 2], "json:[1,2]"),
            ([1.5], "json:[1.5]"),
            (["é"], 'json:["é"]'),
        ],
    )
    def test_text_matches_behaviortree_cpp(self, value: Any, text: str) -> None:
        assert to_text(value) == text

    @pytest.mark.parametrize("value", [None, Opaque()])
    def test_a_value_without_a_text_form_raises(self, value: Opaque | None) -> None:
        with pytest.raises(ConversionError):
            to_text(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("-7", -7),
        ("99999999999", 99999999999),
        ("1e3", 1000.0),
        ("2.5", 2.5),
        ("1;2", "1;2"),
        ("0x10", "0x10"),
        ("true", "true"),
        (" 1", " 1"),
        ("", ""),
        ("99999999999999999999", 1e20),
    ],
)
def test_a_constant_of_a_subtree_is_a_whole_number_or_a_text(text: str, value: float | str) -> None:
    found = parse_constant(text)
    assert found == value
    assert type(found) is type(value)


def test_enum_text_is_tried_as_registered_name_number_and_converter() -> None:
    types = TypeRegistry()
    types.add_enum({"STOP": 1})
    light = types.add(
        Colour, lambda text: Colour[text.removeprefix("#")], to_text=lambda member: f"#{member.name}"
    )
    first, second = list(Colour)[:2]
    by_number = {member.value: member for member in Colour}
    assert light.from_text("STOP") is by_number[1]
    assert light.from_text("3") is by_number[3]
    assert light.from_text(f"#{second.name}") is second
    assert light.to_text(first) == f"#{first.name}"
    with pytest.raises(ConversionError, match=r"'#NONE' is not a valid Colour"):
        light.from_text("#NONE")


def test_converter_may_be_added_after_the_type_was_requested() -> None:
    class Pose:
        def __init__(self, x: float) -> None:
            self.x = x

    types = TypeRegistry()
    pose_type = types.of(Pose)
    types.add(Pose, lambda text: Pose(float(text)))
    pose = pose_type.from_text("1.5")
    assert isinstance(pose, Pose)
    assert pose.x == 1.5
    with pytest.raises(RegistrationError, match="Pose has a text form already"):
        types.add(Pose, lambda text: Pose(float(text)))
