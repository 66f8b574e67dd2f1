"""`btcore validate` checks literal goals, requests and messages, with the place of each mistake."""

import json
from importlib.util import find_spec
from pathlib import Path
from textwrap import dedent

import pytest
from click.testing import CliRunner

from btcore.cli.main import main

HAS_MESSAGES = find_spec("test_msgs") is not None
needs_messages = pytest.mark.skipif(not HAS_MESSAGES, reason="needs test_msgs")


def validate(tmp_path: Path, body: str) -> tuple[int, list[str]]:
    """Return the exit code and the errors and warnings of `btcore validate`.

    Each is a text: line, the marked word in the line, code, message and hint.
    """
    file = tmp_path / "tree.xml"
    text = f'<root BTCPP_format="4">\n<BehaviorTree ID="Main">\n{dedent(body)}\n</BehaviorTree>\n</root>'
    file.write_text(text)
    result = CliRunner().invoke(main, ["validate", "--json", str(file)])
    found = []
    for item in json.loads(result.stdout)["diagnostics"]:
        word = text.splitlines()[item["line"] - 1][item["column"] - 1 :].split()[0]
        found.append(f"{item['line']} {word} {item['code']} {item['message']} | {item['hint']}")
    return result.exit_code, found


def test_package_that_is_not_installed_is_a_warning(tmp_path: Path) -> None:
    code, found = validate(tmp_path, """<RosActionCall type="rover_msgs/Go" goal='json:{"any": 1}'/>""")
    assert code == 0
    assert len(found) == 1
    expected = "W215 the port 'type' of <RosActionCall>: the package 'rover_msgs' of 'rover_msgs/Go' is not"
    assert found[0].startswith(f'3 rover_msgs/Go" {expected}')


def test_text_that_is_not_json_is_an_error_without_the_package(tmp_path: Path) -> None:
    body = """<RosActionCall type="{kind}" goal="json:{'any': 1}"/>"""
    code, found = validate(tmp_path, body)
    assert code == 2
    assert found == [
        "3 'any': E202 the port 'goal' of <RosActionCall>: not JSON: Expecting property name enclosed in "
        "double quotes | write goal='json:{\"…\": …}'"
    ]


def test_invalid_name_of_a_type_is_an_error_without_the_package(tmp_path: Path) -> None:
    code, found = validate(tmp_path, '<RosTopicRead topic_name="/x" type="String"/>')
    assert code == 2
    assert "E202 the port 'type' of <RosTopicRead>: 'String' is not the name of a ROS message" in found[0]


@needs_messages
def test_misspelt_field_is_marked_in_its_line(tmp_path: Path) -> None:
    body = """\
        <RosActionCall type="test_msgs/action/NestedMessage" goal='json:{
          "nested_field_no_pkg": {"duration_valu": 3},
          "nested_different_pkg": {"sec": "many", "nanosec": -1}
        }'/>"""
    code, found = validate(tmp_path, body)
    assert code == 2
    port = "E202 the port 'goal' of <RosActionCall>: goal"
    assert found == [
        f'4 "duration_valu": {port}.nested_field_no_pkg.duration_valu: test_msgs/Builtins has no field '
        "'duration_valu' | did you mean 'duration_value'?",
        f"5 \"many\", {port}.nested_different_pkg.sec: 'many' is not a number | the type is int32",
        f"5 -1}} {port}.nested_different_pkg.nanosec: -1 is out of range for uint32: 0 to 4294967295 | ",
    ]


@needs_messages
@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (
            """<RosActionCall type="test_msgs/Fibonaci"/>""",
            "3 test_msgs/Fibonaci\"/> E202 the port 'type' of <RosActionCall>: 'test_msgs/Fibonaci': the "
            "package test_msgs has no action 'Fibonaci'; did you mean 'Fibonacci'?",
        ),
        (
            """<RosActionCall type="test_msgs/Fibonacci" result="{r}" result_field="sequenc"/>""",
            "3 sequenc\"/> E202 the port 'result_field' of <RosActionCall>: test_msgs/Fibonacci_Result has "
            "no field 'sequenc'; did you mean 'sequence'?",
        ),
        (
            """<RosServiceCall type="std_srvs/SetBool" request='json:{"data": 3}'/>""",
            "3 3}'/> E202 the port 'request' of <RosServiceCall>: request.data: 3 is not a bool | write",
        ),
        (
            """<RosTopicPublish type="std_msgs/String" message="json:{&quot;data&quot;: [1]}"/>""",
            "3 [1]}\"/> E202 the port 'message' of <RosTopicPublish>: message.data: [1] is not a string",
        ),
        (
            """<RosTopicRead type="std_msgs/String" field="text" message="{m}"/>""",
            "3 text\" E202 the port 'field' of <RosTopicRead>: std_msgs/String has no field 'text'; fields",
        ),
        (
            """<RosTransformRead child="base" field="pose.x" result="{x}"/>""",
            "3 pose.x\" E202 the port 'field' of <RosTransformRead>: geometry_msgs/Pose has no field 'x'",
        ),
        (
            """<RosPoseTransform pose='json:{"pose": {"position": {"x": "far"}}}'/>""",
            "3 \"far\"}}}'/> E202 the port 'pose' of <RosPoseTransform>: pose.pose.position.x: 'far' is not",
        ),
        (
            """<RosTopicRead type="std_msgs/String" qos="sensor"/>""",
            "3 sensor\"/> E202 the port 'qos' of <RosTopicRead>",
        ),
    ],
)
def test_each_leaf_checks_its_literals(tmp_path: Path, body: str, problem: str) -> None:
    code, found = validate(tmp_path, body)
    assert code == 2
    assert len(found) == 1
    assert found[0].startswith(problem)


@needs_messages
def test_valid_literals_are_not_reported(tmp_path: Path) -> None:
    body = """\
        <Sequence>
          <RosActionCall name="/x" type="test_msgs/Fibonacci" goal='json:{"order": "{n}"}' result="{r}"/>
          <RosActionCall name="/y" type="test_msgs/Fibonacci" goal="{r}"/>
          <RosServiceCall name="/z" type="std_srvs/Trigger"/>
          <RosTopicPublish name="/w" type="geometry_msgs/Twist" message='json:{"linear": {"x": 0.5}}'/>
          <RosTopicRead name="/b" type="sensor_msgs/BatteryState" message="{level}" field="percentage"
                        qos="sensor_data"/>
        </Sequence>"""
    assert validate(tmp_path, body) == (0, [])
