"""Values of files as types: what is accepted, and the message for each kind of mistake."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import pytest
from msgspec import Meta

from btcore.typed_data import DataError, FieldError, NotNegative, Positive, Record, convert, json_schema


class Row(NamedTuple):
    x: float
    width: Positive


@dataclass(frozen=True)
class Part:
    name: str
    mass: NotNegative = 0.0


class Ball(Record, tag_field="kind", tag="ball", kw_only=True):
    radius: Positive


class Box(Record, tag_field="kind", tag="box", kw_only=True):
    size: Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]


class Lenient(msgspec.Struct, frozen=True):
    image: str = ""


class Format(Record, kw_only=True):
    count: Annotated[int, Meta(ge=1, le=9)] = 1
    ratio: float = 0.0
    on: bool = False
    mode: Literal["fast", "slow"] = "fast"
    file: Path = msgspec.field(default_factory=Path)
    place: tuple[float, float] = (0.0, 0.0)
    names: tuple[str, ...] = ()
    ports: Annotated[dict[str, int], Meta(min_length=1)] | msgspec.UnsetType = msgspec.UNSET
    rows: tuple[Row, ...] = ()
    part: Part | None = None
    things: tuple[Ball | Box, ...] = ()
    mixed: tuple[str | bool, ...] = ()
    lenient: Lenient = Lenient()

    def __post_init__(self) -> None:
        if self.count > 5 and not self.on:
            raise FieldError("count", "needs 'on'")
        if self.ratio > 100:
            raise ValueError("too much")


def test_values_become_the_types_of_the_format() -> None:
    data = {
        "count": 9,
        "on": True,
        "ratio": 1,
        "file": "a.txt",
        "rows": [[1, 2]],
        "part": {"name": "arm"},
        "things": [{"kind": "ball", "radius": 2}, {"kind": "box", "size": [1, 2]}],
        "lenient": {"other": 3},
    }
    read = convert(data, Format)
    assert (read.count, read.ratio, read.file, read.rows) == (9, 1.0, Path("a.txt"), (Row(1.0, 2.0),))
    assert read.part == Part("arm")
    assert read.things == (Ball(radius=2.0), Box(size=(1.0, 2.0)))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"count": 0}, "'count' is 0, and a whole number of at least 1 and of at most 9 is expected"),
        ({"count": 1.0}, "'count' is 1.0, and a whole number of at least 1 and of at most 9 is expected"),
        ({"ratio": "1"}, "'ratio' is \"1\", and a number is expected"),
        ({"ratio": True}, "'ratio' is true, and a number is expected"),
        ({"ratio": float("nan")}, "'ratio' is NaN, and a number is expected"),
        ({"ratio": None}, "'ratio' is null, and a number is expected"),
        ({"on": 1}, "'on' is 1, and true or false is expected"),
        ({"file": 1}, "'file' is 1, and a text is expected"),
        ({"mode": "slw"}, '\'mode\' is "slw", and "fast" or "slow" is expected; did you mean \'slow\'?'),
        ({"place": [1]}, "'place' is [1], and a list of 2 numbers is expected"),
        ({"place": [1, "2"]}, "'place[1]' is \"2\", and a number is expected"),
        ({"names": "a"}, "'names' is \"a\", and a list of texts is expected"),
        ({"names": "a" * 99}, "'names' is \"" + "a" * 78 + "…, and a list of texts is expected"),
        ({"ports": {}}, "'ports' is {}, and an object of keys and values, which is not empty, is expected"),
        ({"ports": {"b c": "x"}}, "'ports.b c' is \"x\", and a whole number is expected"),
        ({"rows": [[1, 2], [3]]}, "'rows[1]' is [3], and a list of 2 numbers is expected"),
        ({"rows": [[1, 0]]}, "'rows[0][1]' is 0, and a number greater than 0 is expected"),
        ({"rows": 3}, "'rows' is 3, and a list of lists is expected"),
        ({"part": None}, "'part' is null, and an object of keys and values is expected"),
        ({"part": {}}, "'part.name' is missing"),
        ({"part": {"nam": 1}}, "'part.nam' is unknown: known are name, mass; did you mean 'name'?"),
        ({"things": [{"radius": 1}]}, "'things[0].kind' is missing"),
        (
            {"things": [{"kind": "bal"}]},
            '\'things[0].kind\' is "bal", and "ball" or "box" is expected; did you mean \'ball\'?',
        ),
        ({"things": [{"kind": "ball", "size": 1}]}, "'things[0].size' is unknown: known are kind, radius"),
        ({"things": [1]}, "'things[0]' is 1, and an object of keys and values is expected"),
        ({"things": 1}, "'things' is 1, and a list of objects is expected"),
        (
            {"things": [{"kind": "box", "size": [1]}]},
            "'things[0].size' is [1], and a list of 2 or 3 numbers is expected",
        ),
        ({"mixed": [1]}, "'mixed[0]' is 1, and a text or true or false is expected"),
        ({"lenient": {"imge": "a"}}, "'lenient.imge' is unknown: known are image; did you mean 'image'?"),
        ({"count": 6}, "'count' needs 'on'"),
        ({"ratio": 101}, "too much"),
        ([], "is [], and an object of keys and values is expected"),
    ],
)
def test_a_mistake_is_reported_with_its_key_its_value_and_what_is_allowed(data: Any, message: str) -> None:
    with pytest.raises(DataError) as caught:
        convert(data, Format)
    assert str(caught.value) == message


def test_a_schema_has_the_keys_and_the_limits_of_the_format() -> None:
    defined = json_schema(Format)["$defs"]
    properties = defined["Format"]["properties"]
    assert properties["count"] == {"type": "integer", "minimum": 1, "maximum": 9, "default": 1}
    assert properties["file"]["type"] == "string"
    assert (defined["Ball"]["required"], defined["Ball"]["additionalProperties"]) == (
        ["kind", "radius"],
        False,
    )
