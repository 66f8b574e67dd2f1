"""Leaves that need no code, with a plain rclpy program in another process."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Pose, PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from test_msgs.action import Fibonacci

import btcore
from btcore import Blackboard, NodeExecutionError, Registry, Status, Tree, TreeError
from btcore_ros2.leaves import register
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known


@pytest.fixture(scope="module")
def session() -> Iterator[RosSession]:
    """A session that has discovered the server in another process."""
    program = [sys.executable, str(Path(__file__).with_name("by_name_server.py"))]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"
        with RosSession("by_name") as session:
            tree = tree_of(COUNT, session)  # its client is used by all trees
            wait_until_known(session, "count")
            for topic in ("battery", "other_battery", "silence"):
                assert session.wait_for(lambda topic=topic: session.node.count_publishers(topic), LIMIT_S)
            yield session
            del tree
        assert server.stdin is not None
        server.stdin.close()
        assert server.wait(LIMIT_S) == 0


def tree_of(body: str, session: RosSession, **entries: object) -> Tree:
    """Return a tree with *body*, and with *entries* on its blackboard."""
    nodes = Registry.standard()
    register(nodes)
    board = Blackboard()
    for key, value in entries.items():
        board[key] = value
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[session], blackboard=board, clock=session.clock)


COUNT = """<RosActionCall name="/count" type="test_msgs/action/Fibonacci" goal='json:{"order": 3}'
    result="{result}" feedback="{feedback}" error="{error}" server_timeout="60000"/>"""


def test_goal_in_json_is_sent_to_the_action_that_the_instance_name_names(session: RosSession) -> None:
    tree = tree_of(COUNT, session)
    assert tree.tick_while_running() is Status.SUCCESS
    assert list(tree.blackboard["result"].sequence) == [0, 1, 2]
    assert list(tree.blackboard["feedback"].sequence) == [3]
    assert tree.blackboard["error"] == ""


def test_item_that_a_list_does_not_have_is_a_failure_with_a_reason(session: RosSession) -> None:
    fields = 'result_field="sequence[3]" feedback_field="sequence[1]"/>'
    tree = tree_of(COUNT.replace("/>", fields), session, feedback="before")
    assert tree.tick_while_running() is Status.FAILURE
    assert tree.blackboard["error"] == "result_field='sequence[3]': the list 'sequence' has 3 items"
    assert tree.blackboard["feedback"] == "before"
    with pytest.raises(KeyError):
        tree.blackboard["result"]
    call = """<RosServiceCall name="/driver/get_parameters" type="rcl_interfaces/srv/GetParameters"
        request='json:{"names": ["undeclared"]}' response="{name}" response_field="values[0].double_value"
        error="{error}" server_timeout="60000" wait_for_server_timeout="60000"/>"""
    tree = tree_of(call, session)
    assert tree.tick_while_running() is Status.FAILURE
    reason = "response_field='values[0].double_value': the list 'values' has 0 items"
    assert tree.blackboard["error"] == reason
    read = """<RosTopicRead name="battery" type="sensor_msgs/msg/BatteryState" qos="sensor_data"
        field="cell_voltage[0]" message="{volt}" error="{error}" timeout="60000"/>"""
    tree = tree_of(read, session)
    assert tree.tick_while_running() is Status.FAILURE
    assert tree.blackboard["error"] == "field='cell_voltage[0]': the list 'cell_voltage' has 0 items"


def test_action_name_has_precedence_over_the_instance_name(session: RosSession) -> None:
    tree = tree_of(
        COUNT.replace('name="/count"', 'name="Count to 3" action_name="{action}"'), session, action="count"
    )
    assert tree.tick_while_running() is Status.SUCCESS


def test_fields_of_result_and_feedback_are_written(session: RosSession) -> None:
    fields = 'result_field="sequence[2]" feedback_field="sequence"/>'
    tree = tree_of(COUNT.replace("/>", fields), session)
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.blackboard["result"] == 2
    assert tree.blackboard["feedback"].tolist() == [3]


def test_aborted_goal_fails_with_its_result_and_a_reason(session: RosSession) -> None:
    tree = tree_of(COUNT.replace("3}", "-2}"), session)
    assert tree.tick_while_running() is Status.FAILURE
    assert list(tree.blackboard["result"].sequence) == [-1]
    assert "'/count' aborted the goal" in tree.blackboard["error"]


@pytest.mark.parametrize(
    ("goal", "entries"),
    [
        ("""'json:{"order": "{n}"}'""", {"n": 2}),
        ("""'json:{"order": "{n}"}'""", {"n": 2.0}),  # the result of a script is a real number
        ('"{goal}"', {"goal": {"order": 2}}),
        ('"{goal}"', {"goal": {"order": "{n}"}, "n": 2}),
        ('"{goal}"', {"goal": 'json:{"order": 2}'}),
        ('"{goal}"', {"goal": Fibonacci.Goal(order=2)}),
    ],
)
def test_goal_may_be_or_contain_entries(session: RosSession, goal: str, entries: dict[str, object]) -> None:
    tree = tree_of(COUNT.replace("""'json:{"order": 3}'""", goal), session, **entries)
    assert tree.tick_while_running() is Status.SUCCESS
    assert list(tree.blackboard["result"].sequence) == [0, 1]


def test_entry_of_a_goal_is_read_in_the_scope_of_the_leaf(session: RosSession) -> None:
    body = '<SubTree ID="Inner" n="{target}" result="{result}"/></BehaviorTree><BehaviorTree ID="Inner">'
    body += COUNT.replace("3}", '"{n}"}')
    nodes = Registry.standard()
    register(nodes)
    board = Blackboard()
    board["target"] = 4
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = btcore.loads(
        text, tree="Main", nodes=nodes, resources=[session], blackboard=board, clock=session.clock
    )
    assert tree.tick_while_running() is Status.SUCCESS
    assert list(board["result"].sequence) == [0, 1, 2, 3]


def test_entry_that_does_not_fit_is_an_error_with_its_path(session: RosSession) -> None:
    tree = tree_of(COUNT.replace("3}", '"{n}"}'), session, n="many")
    with pytest.raises(NodeExecutionError, match=r"/count.*goal\.order: 'many' is not a number"):
        tree.tick_once()
    tree = tree_of(COUNT.replace("3}", '"{n}"}'), session)
    with pytest.raises(
        NodeExecutionError, match=r"port \[goal\] reads \{n\}, which is not on the blackboard"
    ):
        tree.tick_once()


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "order",
            "ordre",
            "goal.ordre: test_msgs/Fibonacci_Goal has no field 'ordre'; did you mean 'order'?",
        ),
        ('"test_msgs/action/Fibonacci"', '"{kind}"', "port [type] must be the name of an action"),
        (
            "test_msgs",
            "rover_msgs",
            "the package 'rover_msgs' of 'rover_msgs/action/Fibonacci' is not installed",
        ),
        ('name="/count"', "", "port [action_name] is empty"),
        ('name="/count"', 'name="Count to 3"', "'Count to 3' is not a valid ROS name"),
    ],
)
def test_bad_literal_is_error_when_tree_loads(session: RosSession, old: str, new: str, problem: str) -> None:
    with pytest.raises(TreeError) as caught:
        tree_of(COUNT.replace(old, new), session)
    assert problem in str(caught.value)


SWITCH = """<RosServiceCall name="switch" type="std_srvs/SetBool" request='json:{"data": true}'
    response="{response}" response_field="message" error="{error}" server_timeout="60000"/>"""


def test_service_is_called_and_its_field_success_is_the_result(session: RosSession) -> None:
    tree = tree_of(SWITCH, session)
    assert tree.tick_while_running() is Status.SUCCESS
    assert (tree.blackboard["response"], tree.blackboard["error"]) == ("on", "")
    tree = tree_of(SWITCH.replace("true", "false"), session)
    assert tree.tick_while_running() is Status.FAILURE
    assert tree.blackboard["response"] == "cannot be switched off"
    assert tree.blackboard["error"] == "the service 'switch' did not succeed: cannot be switched off"


def test_example_of_parameters_and_lifecycle_of_the_reference_page(session: RosSession) -> None:
    page = Path(__file__).parents[3] / "docs/reference/ros2_leaves.md"
    _, example = page.read_text().split("```xml lifecycle.xml\n")
    text, _, _ = example.partition("```")
    nodes = Registry.standard()
    register(nodes)
    text = text.replace("<RosServiceCall", '<RosServiceCall server_timeout="60000"')
    text = text.replace("server_timeout", 'wait_for_server_timeout="60000" server_timeout')
    tree = btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.blackboard["state"] == "inactive"
    assert tree.blackboard["speed"] == 0.25
    assert tree.tick_while_running() is Status.FAILURE  # it is configured already


@pytest.mark.parametrize("kind", ["SetParameters", "SetParametersAtomically"])
def test_parameter_that_is_refused_fails_with_the_reason(session: RosSession, kind: str) -> None:
    name = f"driver/{'set_parameters' if kind == 'SetParameters' else 'set_parameters_atomically'}"
    body = f"""<RosServiceCall name="{name}" type="rcl_interfaces/{kind}" error="{{error}}"
        server_timeout="60000" wait_for_server_timeout="60000" request='json:{{"parameters": [
            {{"name": "max_speed", "value": {{"type": 3, "double_value": "{{speed}}"}}}}]}}'/>"""
    tree = tree_of(body, session, speed=9.0)
    assert tree.tick_while_running() is Status.FAILURE
    assert tree.blackboard["error"] == f"the service '{name}' did not succeed: max_speed is below 1.0"
    tree.blackboard["speed"] = 0.5
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.blackboard["error"] == ""


def test_message_of_the_first_tick_reaches_a_subscriber_and_is_read(session: RosSession) -> None:
    publish = """<RosTopicPublish topic_name="words" type="std_msgs/String" message='json:{"data": "{word}"}'
        wait_for_subscriber_timeout="60000" error="{error}"/>"""
    read = """<RosTopicRead name="heard" type="std_msgs/String" qos="latched" message="{answer}" field="data"
        timeout="60000"/>"""
    reading = tree_of(read, session)

    def answer() -> object:
        assert reading.tick_while_running() is Status.SUCCESS
        return reading.blackboard["answer"]

    for word in ("hello", "again"):
        with RosSession("speaker") as speaker:  # it has not discovered the subscriber yet
            tree = tree_of(publish, speaker, word=word)
            assert tree.tick_while_running() is Status.SUCCESS
            assert tree.blackboard["error"] == ""
            assert session.wait_for(lambda word=word: answer() == word, LIMIT_S)


@pytest.mark.parametrize(
    "qos", ['qos="sensor_data"', 'reliability="best_effort"', 'qos="latched" reliability="best_effort" {}']
)
def test_best_effort_topic_is_read_with_the_profile_of_sensors(session: RosSession, qos: str) -> None:
    qos = qos.format('durability="volatile"')
    body = f"""<RosTopicRead name="battery" type="sensor_msgs/msg/BatteryState" {qos}
        message="{{battery}}" timeout="60000"/>"""
    tree = tree_of(body, session)
    assert tree.tick_while_running() is Status.SUCCESS
    assert isinstance(tree.blackboard["battery"], BatteryState)
    # The newest message is read at once.
    assert tree.tick_once() is Status.SUCCESS


@pytest.mark.parametrize(
    ("name", "kind", "qos", "problem"),
    [
        (
            "battery",
            "sensor_msgs/BatteryState",
            "reliable",
            'publishers are best effort: write reliability="best_effort"',
        ),
        ("other_battery", "std_msgs/String", "reliable", "its type is sensor_msgs/msg/BatteryState"),
        ("silence", "std_msgs/String", "latched", 'its publishers are volatile: write durability="volatile"'),
        ("silence", "std_msgs/String", "reliable", "its publishers have sent nothing"),
        ("batery", "std_msgs/String", "reliable", "nothing publishes it; did you mean '/battery'?"),
    ],
)
def test_topic_without_a_message_fails_with_the_reason(
    session: RosSession, name: str, kind: str, qos: str, problem: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert session.wait_for(lambda: session.node.count_publishers("battery"), LIMIT_S)
    discovery = 0 if name == "batery" else 60_000
    body = f"""<RosTopicRead topic_name="{name}" type="{kind}" qos="{qos}" error="{{error}}" timeout="100"
        wait_for_publisher_timeout="{discovery}"/>"""
    tree = tree_of(body, session)
    assert tree.tick_while_running() is Status.FAILURE
    error = tree.blackboard["error"]
    assert error.startswith(f"no message on the topic '{name}' within 100 ms: ")
    assert problem in error
    assert error in caplog.text


def test_late_subscriber_gets_as_many_messages_as_the_depth_of_the_publisher(session: RosSession) -> None:
    body = """<RosTopicPublish name="kept" type="std_msgs/String" message='json:{"data": "{word}"}'
        durability="transient_local" depth="2" wait_for_subscriber_timeout="0"/>"""
    tree = tree_of(body, session)
    for word in "abc":
        tree.blackboard["word"] = word
        assert tree.tick_once() is Status.SUCCESS
    received: list[str] = []
    with RosSession("late") as late:
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        late.node.create_subscription(String, "kept", lambda message: received.append(message.data), qos)
        assert late.wait_for(lambda: "c" in received, LIMIT_S)
    assert received == ["b", "c"]
    with pytest.raises(TreeError, match=r"port \[depth\] = -1: write a number from 1 to 1000000"):
        tree_of(body.replace('depth="2"', 'depth="-1"'), session)


def test_old_message_does_not_count(session: RosSession) -> None:
    body = """<RosTopicRead name="place" type="std_msgs/String" qos="latched" timeout="60000"/>"""
    assert tree_of(body, session).tick_while_running() is Status.SUCCESS
    old = body.replace("60000", "50").replace("/>", ' max_age="0.001" error="{error}"/>')
    tree = tree_of(old, session)
    start = session.clock.now()
    assert session.wait_for(lambda: session.clock.now() > start + 2_000_000, LIMIT_S)
    assert tree.tick_while_running() is Status.FAILURE


def test_example_of_nav2_is_loaded(session: RosSession) -> None:
    pytest.importorskip("nav2_msgs")
    body = """<RosActionCall name="/navigate_to_pose" type="nav2_msgs/action/NavigateToPose"
        goal='json:{"pose": {"header": {"frame_id": "map", "stamp": "now"}, "pose": "{target}"}}'
        result="{result}"/>"""
    tree = tree_of(body, session, target=Pose())
    (leaf,) = tree
    goal = leaf.make_goal()
    assert isinstance(goal.pose, PoseStamped)
    assert goal.pose.header.stamp.sec > 0


def test_missing_service_fails_with_a_reason(session: RosSession) -> None:
    body = SWITCH.replace('"switch"', '"swich" wait_for_server_timeout="300"')
    tree = tree_of(body, session)
    assert tree.tick_while_running() is Status.FAILURE
    assert "no service 'swich' (std_srvs/srv/SetBool)" in tree.blackboard["error"]
