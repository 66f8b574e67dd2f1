"""Values become messages, and each problem names the path of the field."""

import array
import json
import math
import random
from typing import Any

import pytest

pytest.importorskip("rclpy")

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import BatteryState, Image, LaserScan
from std_msgs.msg import Header, String
from test_msgs.msg import Arrays, BasicTypes, BoundedSequences, Strings, UnboundedSequences, WStrings

from btcore import ConversionError
from btcore_ros2.errors import RosError
from btcore_ros2.leaves.message_port import find_part
from btcore_ros2.message_values import (
    MAX_PROBLEMS,
    MAX_TEXT,
    FieldType,
    MessageValueError,
    field_type,
    find_problems,
    from_message,
    message_constants,
    message_fields,
    parse_json,
    read_field,
    to_message,
)


def problems(message_type: Any, value: object) -> list[str]:
    """Return the problems of *value* as texts."""
    return [problem.text for problem in find_problems(message_type, value)]


def test_nested_fields_are_set_and_the_others_keep_their_defaults() -> None:
    pose = to_message(
        PoseStamped, {"header": {"frame_id": "map"}, "pose": {"position": {"x": 1, "y": -2.5}}}, name="goal"
    )
    assert (pose.header.frame_id, pose.pose.position.x, pose.pose.position.y) == ("map", 1.0, -2.5)
    assert pose.pose.orientation.w == 1.0  # the default of the definition


def test_text_in_json_is_a_value() -> None:
    assert to_message(String, 'json:{"data": "hello"}').data == "hello"


@pytest.mark.parametrize(
    "message_type",
    [BasicTypes, Arrays, BoundedSequences, UnboundedSequences, Strings, WStrings, BatteryState],
)
def test_message_of_defaults_returns_from_a_dictionary(message_type: Any) -> None:
    message = message_type()
    again = to_message(message_type, from_message(message))
    # The bytes may differ: those between the fields have no value.
    assert str(deserialize_message(serialize_message(again), message_type)) == str(message)


def test_extreme_numbers_of_each_type_pass_through_dds() -> None:
    value = {
        "bool_value": True, "byte_value": 255, "char_value": 255, "float32_value": 3.4e38,
        "float64_value": 1e308, "int8_value": -128, "uint8_value": 255, "int16_value": -32768,
        "uint16_value": 65535, "int32_value": -(2**31), "uint32_value": 2**32 - 1,
        "int64_value": -(2**63), "uint64_value": 2**64 - 1,
    }  # fmt: skip
    sent = deserialize_message(serialize_message(to_message(BasicTypes, value)), BasicTypes)
    assert from_message(sent) == {**value, "float32_value": float(np.float32(3.4e38))}


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("int8_value", 128, "int8_value: 128 is out of range for int8: -128 to 127"),
        ("uint8_value", -1, "uint8_value: -1 is out of range for uint8: 0 to 255"),
        ("byte_value", 256, "byte_value: 256 is out of range for byte: 0 to 255"),
        ("uint64_value", 2**64, f"uint64_value: {2**64} is out of range for uint64: 0 to {2**64 - 1}"),
        ("int32_value", 1.5, "int32_value: 1.5 is not an integer; the type is int32"),
        ("int32_value", math.inf, "int32_value: inf is not an integer; the type is int32"),
        ("int32_value", True, "int32_value: true is not a number; the type is int32"),
        ("int32_value", "2", "int32_value: '2' is not a number; the type is int32"),
        ("int32_value", None, "int32_value: null is not a number; the type is int32"),
        ("float32_value", 1e39, "float32_value: 1e+39 is out of range for float32"),
        (
            "float64_value",
            10**400,
            "float64_value: a number of more than 128 bits is out of range for float64",
        ),
        ("float64_value", [1.0], "float64_value: [1.0] is not a number; the type is float64"),
        ("bool_value", "true", "bool_value: 'true' is not a bool; write true or false"),
        ("bool_value", 2, "bool_value: 2 is not a bool; write true or false"),
        (
            "int_value",
            2,
            "int_value: test_msgs/BasicTypes has no field 'int_value'; did you mean 'int8_value'?",
        ),
    ],
)
def test_invalid_value_is_reported_with_its_path(field: str, value: object, problem: str) -> None:
    assert problems(BasicTypes, {field: value}) == [problem]


def test_all_problems_are_reported_with_the_name_of_the_value() -> None:
    value = {"header": {"frame": "map"}, "pose": {"position": {"x": "1"}, "orientation": 3}}
    with pytest.raises(MessageValueError) as caught:
        to_message(PoseStamped, value, name="goal.pose")
    assert str(caught.value).splitlines() == [
        "goal.pose.header.frame: std_msgs/Header has no field 'frame'; did you mean 'frame_id'?",
        "goal.pose.pose.position.x: '1' is not a number; the type is float64",
        'goal.pose.pose.orientation: 3 is not a geometry_msgs/Quaternion; write {"x": …}',
    ]


def test_item_of_a_list_is_named_by_its_index() -> None:
    found = problems(UnboundedSequences, {"basic_types_values": [{}, {"int8_value": 300}]})
    assert found == ["basic_types_values[1].int8_value: 300 is out of range for int8: -128 to 127"]


@pytest.mark.parametrize(
    ("message_type", "value", "problem"),
    [
        (BoundedSequences, {"int8_values": [1] * 4}, "int8_values: the list has 4 items; the maximum is 3"),
        (Arrays, {"int8_values": [1]}, "int8_values: the list has 1 items; the type is int8[3]"),
        (Strings, {"bounded_string_value": "a" * 23}, "bounded_string_value: the text has 23 characters; the "
         "maximum is 22"),
        (UnboundedSequences, {"string_values": "a"}, "string_values: 'a' is not a list; the type is "
         "string[]"),
        (String, {"data": 3}, 'data: 3 is not a string; write "3"'),
        (String, {"data": "a\0b"}, "data: the text contains a null character"),
        (String, {"data": "\ud800"}, "data: the text contains half of a surrogate pair"),
        (LaserScan, {"ranges": np.zeros((2, 2))}, "ranges: the array has more than one dimension; pass "
         "array.ravel()"),
    ],
)  # fmt: skip
def test_bounds_of_lists_and_texts_are_checked(message_type: Any, value: object, problem: str) -> None:
    assert problems(message_type, value) == [problem]


def test_number_of_reported_problems_is_limited() -> None:
    assert len(problems(UnboundedSequences, {"int8_values": ["x"] * 1000})) == MAX_PROBLEMS


def test_integer_accepts_the_name_of_a_constant() -> None:
    battery = to_message(BatteryState, {"power_supply_status": "POWER_SUPPLY_STATUS_CHARGING"})
    assert battery.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING == 1
    assert problems(BatteryState, {"power_supply_status": "POWER_SUPPLY_STATUS_CHARGIN"}) == [
        "power_supply_status: 'POWER_SUPPLY_STATUS_CHARGIN' is neither a number nor a constant of "
        "sensor_msgs/BatteryState; did you mean 'POWER_SUPPLY_STATUS_CHARGING'?"
    ]
    assert "POWER_SUPPLY_HEALTH_GOOD" in message_constants(BatteryState)


def test_real_accepts_the_numbers_that_json_does_not_have() -> None:
    point = to_message(Point, {"x": "nan", "y": "inf", "z": "-inf"})
    assert math.isnan(point.x)
    assert (point.y, point.z) == (math.inf, -math.inf)


def test_number_of_seconds_is_a_duration_or_time() -> None:
    assert to_message(Duration, 1.5) == Duration(sec=1, nanosec=500_000_000)
    assert to_message(Duration, -0.25) == Duration(sec=-1, nanosec=750_000_000)
    assert to_message(Duration, {"sec": 3}) == Duration(sec=3)
    assert to_message(Header, {"stamp": 12}).stamp == Time(sec=12)
    assert to_message(Header, {"stamp": "now"}, now=lambda: Time(sec=7)).stamp == Time(sec=7)
    assert problems(Header, {"stamp": 1e10})[0].startswith("stamp: 10000000000.0 s is out of range")
    assert problems(Header, {"stamp": "today"}) == [
        "stamp: 'today' is not a builtin_interfaces/Time; write a number of seconds, or \"now\""
    ]


def test_bytes_and_numpy_arrays_are_stored_in_one_piece() -> None:
    image = to_message(Image, {"data": b"\0\xff", "height": np.uint32(1)})
    assert image.data == array.array("B", [0, 255])
    assert to_message(Image, {"data": np.array([1, 2], np.int64)}).data == array.array("B", [1, 2])
    assert problems(Image, {"data": np.array([1, 256])}) == [
        "data[1]: 256 is out of range for uint8: 0 to 255"
    ]
    assert problems(Image, {"data": np.array([0.5])}) == ["data[0]: 0.5 is not an integer; the type is uint8"]
    scan = to_message(LaserScan, {"ranges": np.array([1.5, np.inf])})
    assert list(scan.ranges) == [1.5, math.inf]
    assert problems(LaserScan, {"ranges": np.array([1e39])}) == [
        "ranges[0]: 1e+39 is out of range for float32"
    ]
    assert to_message(Arrays, {"byte_values": b"abc"}).byte_values == [b"a", b"b", b"c"]
    pose = to_message(PoseWithCovarianceStamped, {"pose": {"covariance": np.arange(36)}})
    assert pose.pose.covariance[35] == 35.0


def test_large_map_is_not_converted_item_by_item(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("btcore_ros2.message_values._basic_value", None)  # calling it raises
    cells = np.full(1_000_000, -1, np.int8)
    grid = to_message(OccupancyGrid, {"data": cells})
    assert len(grid.data) == 1_000_000
    read = from_message(grid)["data"]
    assert isinstance(read, np.ndarray)
    assert (read == cells).all()


def test_message_is_used_as_it_is_and_another_class_is_refused() -> None:
    pose = Pose()
    assert to_message(PoseStamped, {"pose": pose}).pose is pose
    assert problems(PoseStamped, {"pose": Point()}) == [
        'pose: a geometry_msgs/Point is not a geometry_msgs/Pose; write {"position": …}'
    ]


def test_text_in_braces_is_an_entry_only_if_entries_can_be_read() -> None:
    entries = {"target": {"position": {"x": 3}}, "frame": "odom"}
    value = {"header": {"frame_id": "{frame}"}, "pose": "{target}"}
    pose = to_message(PoseStamped, value, resolve=entries.__getitem__)
    assert (pose.header.frame_id, pose.pose.position.x) == ("odom", 3.0)
    assert find_problems(PoseStamped, value) == []
    assert to_message(String, {"data": "{frame}"}).data == "{frame}"


def test_fields_are_read_by_their_path() -> None:
    pose = to_message(PoseWithCovarianceStamped, {"pose": {"pose": {"position": {"x": 2.5}}}})
    assert read_field(pose, "pose.pose.position.x") == 2.5
    assert read_field(pose, "pose.pose") is pose.pose.pose
    assert read_field(pose, "") is pose
    assert read_field(pose, "pose.covariance[7]") == 0.0
    assert type(read_field(pose, "pose.covariance[7]")) is float
    assert field_type(type(pose), "pose.covariance").name == "float64[36]"


@pytest.mark.parametrize(
    ("path", "problem"),
    [
        ("pose.pos", "geometry_msgs/PoseWithCovariance has no field 'pos'; did you mean 'pose'?"),
        ("pose.covariance.x", "'pose.covariance' has no fields: its type is float64[36]"),
        ("header[0]", "'header' is not a list, but has the type std_msgs/Header"),
        ("pose.covariance[36]", "the list 'pose.covariance' has 36 items"),
        ("pose..x", "not the path of a field"),
        ("pose.covariance[x]", "not the path of a field"),
        ("pose.covariance[-1]", "not the path of a field"),
    ],
)
def test_unknown_field_is_an_error(path: str, problem: str) -> None:
    with pytest.raises(RosError) as caught:
        read_field(PoseWithCovarianceStamped(), path)
    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('{"x": 1}', "write json:"),
        ('json:{"x": 1', "not JSON: Expecting ',' delimiter"),
        ("json:NaN", 'NaN is not a number in JSON; write "nan"'),
        ("json:[-Infinity]", 'write "-inf"'),
        ("json:1e999", "1e999 is too large"),
        ("json:" + "[" * 101 + "]" * 101, "more than 100 levels"),
        ("json:" + " " * MAX_TEXT, "the maximum is 4,000,000"),
        ("json:" + "9" * 5000, "not JSON: "),
    ],
)
def test_text_that_is_not_json_is_refused(text: str, problem: str) -> None:
    with pytest.raises(ConversionError, match=problem):
        parse_json(text)


LEAVES: list[Any] = [
    0, 1, -1, 255, 256, 0.5, 1e39, 1e308, 2**63, 2**64, -(2**63), 10**50, True, False, None, "", "now", "x",
    "nan", "{key}", "{}", "a\0", "\ud800", "json:{", "json:{}", [], {}, math.inf, "é" * 30,
]  # fmt: skip
TYPES = [
    BasicTypes,
    Arrays,
    BoundedSequences,
    UnboundedSequences,
    Strings,
    WStrings,
    PoseStamped,
    BatteryState,
]


def random_value(rng: random.Random, field: FieldType, depth: int = 0) -> Any:
    """Return a value that often fits *field*."""
    if depth > 6 or rng.random() < 0.15:
        return rng.choice(LEAVES)
    if field.message is not None:
        return random_fields(rng, field.message, depth)
    if field.item is None:
        return rng.choice(LEAVES)
    count = field.size if field.size and rng.random() < 0.8 else rng.randrange(5)
    return [random_value(rng, field.item, depth + 1) for _ in range(count)]


def random_fields(rng: random.Random, message_type: Any, depth: int = 0) -> dict[str, Any]:
    """Return values for some fields of *message_type*."""
    fields = message_fields(message_type).items()
    return {name: random_value(rng, field, depth + 1) for name, field in fields if rng.random() < 0.3}


def test_any_value_is_a_message_or_a_list_of_problems_with_their_places() -> None:
    rng = random.Random(1)
    messages = refused = 0
    for _ in range(1000):
        message_type = rng.choice(TYPES)
        value = random_fields(rng, message_type)
        try:
            message = to_message(message_type, value)
        except MessageValueError:
            refused += 1
        else:
            messages += 1
            sent = deserialize_message(serialize_message(message), message_type)
            assert str(to_message(message_type, from_message(sent))) == str(sent)
        text = "json:" + json.dumps(value)
        if "Infinity" not in text:
            for problem in find_problems(message_type, parse_json(text)):
                start, width = find_part(text, len("json:"), problem.path, problem.is_name)
                assert len("json:") <= start < start + width <= len(text)
    assert messages > 50
    assert refused > 50
