"""The book's first programs (chapter 2): logger, publisher, subscriber, executor, parameters, launch."""

from pathlib import Path

import pytest

from btcore_robot.components.component import (
    Component,
    ComponentOptions,
    Executor,
    MessageLoopError,
)
from btcore_robot.components.first_steps import Int32, Localization, Logger, NumberPublisher, NumberSubscriber
from btcore_robot.components.launch import LaunchError, launch_components, read_launch
from btcore_robot.components.parameters import ParameterError, load_component_parameters
from btcore_robot.components.programs import UnknownProgramError, create_components
from btcore_robot.components.topics import TopicError
from btcore_robot.robot import Phase
from tests.robot_nodes.conftest import ComponentRig, RecordingRobot

SECOND = 10**9


@pytest.fixture
def rig(robot: RecordingRobot) -> ComponentRig:
    return ComponentRig(robot)


def test_the_logger_counts_from_zero_twice_a_second(rig: ComponentRig) -> None:
    rig.add(Logger(rig.context))
    rig.clock.sleep(1.6)
    assert rig.output == [
        (0.5, "logger_node", "Hello 0"),
        (1.0, "logger_node", "Hello 1"),
        (1.5, "logger_node", "Hello 2"),
    ]
    assert str(rig.lines[0]) == "[INFO] [0.500] [logger_node]: Hello 0"


def test_the_publisher_counts_before_it_publishes(rig: ComponentRig) -> None:
    received: list[tuple[float, int]] = []
    listener = Component("listener", rig.context)
    listener.create_subscription(
        "int_topic", Int32, lambda message: received.append((rig.clock.now() / SECOND, message.data))
    )
    rig.add(NumberPublisher(rig.context), listener)
    rig.clock.sleep(1.6)
    assert received == [(0.5, 1), (1.0, 2), (1.5, 3)]


def test_publisher_and_subscriber_in_one_executor(rig: ComponentRig) -> None:
    rig.add(*create_components("executor", rig.context))
    rig.clock.sleep(1.6)
    assert [text for _, _, text in rig.output] == ["Hello 1", "Hello 2", "Hello 3"]
    assert {name for _, name, _ in rig.output} == {"subscriber_node"}


def test_publisher_and_subscriber_in_two_executors(rig: ComponentRig) -> None:
    other = Executor(rig.clock, rig.clock)
    other.add(NumberSubscriber(rig.context))
    rig.add(NumberPublisher(rig.context))
    rig.clock.sleep(1.1)
    assert [(time, text) for time, _, text in rig.output] == [(0.5, "Hello 1"), (1.0, "Hello 2")]


def test_localization_has_default_parameters(rig: ComponentRig) -> None:
    component = Localization(rig.context)
    assert (component.number_particles, component.topics, component.topic_types) == (200, [], [])
    assert rig.lines[0].level == "INFO"


PARAMS = """
localization_node:
  ros__parameters:
    number_particles: 300
    topics: [scan, image]
    topic_types: [sensor_msgs/msg/LaserScan, sensor_msgs/msg/Image]
"""


def test_a_parameter_file_sets_the_parameters(rig: ComponentRig, tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(PARAMS)
    given = load_component_parameters(tmp_path / "params.yaml", "localization_node")
    component = Localization(rig.context, ComponentOptions(parameters=given))
    assert component.number_particles == 300
    assert component.topics == ["scan", "image"]
    assert [line.level for line in rig.lines] == ["INFO"] * 3


def test_lists_of_different_lengths_are_reported_as_an_error(rig: ComponentRig) -> None:
    Localization(rig.context, ComponentOptions(parameters={"topics": ["scan"]}))
    assert [(line.level, line.text) for line in rig.lines] == [
        ("ERROR", "Number of topics (1) != number of types (0)")
    ]


def test_a_misnamed_parameter_is_ignored_with_a_warning(rig: ComponentRig) -> None:
    """The first launch file of the book passes "particles"."""
    component = Localization(rig.context, ComponentOptions(parameters={"particles": 300}))
    assert component.number_particles == 200
    assert list(component.unused_warnings()) == [
        "localization_node has no parameter 'particles', so its value is ignored; "
        "did you mean 'number_particles'?"
    ]


def test_every_component_accepts_use_sim_time(rig: ComponentRig) -> None:
    assert (
        list(Logger(rig.context, ComponentOptions(parameters={"use_sim_time": True})).unused_warnings()) == []
    )


@pytest.mark.parametrize(
    "given",
    [{"number_particles": "many"}, {"number_particles": 1.5}, {"topics": "scan"}, {"topics": [1, "a"]}],
)
def test_a_parameter_of_another_type_raises(rig: ComponentRig, given: dict) -> None:
    with pytest.raises(ParameterError, match="localization_node: the parameter '"):
        Localization(rig.context, ComponentOptions(parameters=given))


# --- topics


class NumberTopic:
    """A component that publishes numbers, and a component that subscribes to them."""

    def __init__(self, rig: ComponentRig, *, latched: bool = False) -> None:
        self.speaker = Component("speaker", rig.context)
        self.listener = Component("listener", rig.context)
        self.numbers = self.speaker.create_publisher("numbers", Int32, latched=latched)
        self.received: list[int] = []

    def send(self, *numbers: int) -> None:
        for number in numbers:
            self.numbers.publish(Int32(number))

    def receive(self, message: Int32) -> None:
        self.received.append(message.data)


def test_a_full_queue_loses_its_oldest_messages(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    subscription = topic.listener.create_subscription("numbers", Int32, topic.receive, depth=2)
    rig.add(topic.listener)
    topic.send(1, 2, 3, 4)
    assert topic.received == []
    rig.clock.sleep(0.0)
    assert topic.received == [3, 4]
    assert subscription.lost == 2


def test_a_later_subscriber_receives_the_last_message_of_a_latched_topic(rig: ComponentRig) -> None:
    topic = NumberTopic(rig, latched=True)
    topic.send(1, 2)
    topic.listener.create_subscription("numbers", Int32, topic.receive)
    rig.add(topic.listener)
    rig.clock.sleep(0.0)
    assert topic.received == [2]


def test_a_later_subscriber_receives_no_earlier_message_without_latching(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    topic.send(1, 2)
    topic.listener.create_subscription("numbers", Int32, topic.receive)
    rig.add(topic.listener)
    rig.clock.sleep(0.0)
    assert topic.received == []


def test_a_message_or_a_subscription_of_another_type_raises(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    with pytest.raises(TopicError, match="/numbers has messages of type Int32, not of type str"):
        topic.numbers.publish("seven")  # type: ignore[arg-type]
    with pytest.raises(TopicError, match="which speaker declared, not of type str"):
        topic.listener.create_subscription("/numbers", str, print)


def test_a_component_is_remapped_at_its_start(rig: ComponentRig) -> None:
    listener = NumberSubscriber(rig.context, ComponentOptions("other", {"int_topic": "/numbers"}))
    topic = NumberTopic(rig)
    rig.add(listener)
    topic.send(7)
    rig.clock.sleep(0.0)
    assert rig.output == [(0.0, "other", "Hello 7")]


def test_a_message_is_received_at_the_time_of_its_publication(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    moments: list[float] = []
    topic.listener.create_subscription(
        "numbers", Int32, lambda message: moments.append(rig.clock.now() / SECOND)
    )
    rig.add(topic.listener)
    rig.clock.add_task(4.0, Phase.SENSORS, lambda now: topic.send(1))
    rig.clock.sleep(1.0)
    assert moments == [0.25, 0.5, 0.75, 1.0]


def test_a_destroyed_component_receives_nothing_and_its_timers_stop(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    topic.listener.create_subscription("numbers", Int32, topic.receive)
    logger = Logger(rig.context)
    rig.add(topic.listener, logger)
    topic.listener.destroy()
    logger.destroy()
    topic.send(1)
    rig.clock.sleep(2.0)
    assert (topic.received, rig.lines) == ([], [])


def test_a_timer_can_be_cancelled_by_its_own_callback(rig: ComponentRig) -> None:
    component = Component("once", rig.context)
    calls: list[int] = []
    timer = component.create_timer(0.1, lambda: (calls.append(1), timer.cancel()))
    rig.add(component)
    rig.clock.sleep(1.0)
    assert calls == [1]


def test_callbacks_that_publish_to_each_other_without_end_raise(rig: ComponentRig) -> None:
    topic = NumberTopic(rig)
    topic.listener.create_subscription("numbers", Int32, topic.numbers.publish)
    rig.add(topic.listener)
    topic.send(1)
    with pytest.raises(MessageLoopError, match="the callbacks of listener publish to each other without end"):
        rig.clock.sleep(0.0)


# --- launch files

PUB_SUB = """
launch:
- node: {pkg: basics, exec: publisher, name: speaker}
- node:
    exec: subscriber
    remap: [{from: int_topic, to: /int_topic}]
"""
WITH_PARAMS = """
launch:
- include: {file: pub_sub.launch.yaml}
- node:
    exec: localization
    param:
    - from: params.yaml
    - {name: number_particles, value: 400}
"""


def test_a_launch_file_starts_publisher_and_subscriber(rig: ComponentRig, tmp_path: Path) -> None:
    (tmp_path / "pub_sub.launch.yaml").write_text(PUB_SUB)
    rig.add(*launch_components(read_launch(tmp_path / "pub_sub.launch.yaml"), rig.context))
    assert [component.name for component in rig.executor.components] == ["speaker", "subscriber_node"]
    rig.clock.sleep(1.1)
    assert [text for _, _, text in rig.output] == ["Hello 1", "Hello 2"]


def test_a_launch_file_includes_others_and_sets_parameters(rig: ComponentRig, tmp_path: Path) -> None:
    (tmp_path / "pub_sub.launch.yaml").write_text(PUB_SUB)
    (tmp_path / "params.yaml").write_text(PARAMS)
    (tmp_path / "all.launch.yaml").write_text(WITH_PARAMS)
    components = launch_components(read_launch(tmp_path / "all.launch.yaml"), rig.context)
    assert [component.name for component in components] == ["speaker", "subscriber_node", "localization_node"]
    assert components[2].parameters["number_particles"] == 400
    assert components[2].parameters["topics"] == ["scan", "image"]


@pytest.mark.parametrize(
    ("text", "output"),
    [
        (
            "launch:\n- node: {exec: publsher}\n",
            r":2: 'launch\[0\].node.exec' is 'publsher', which is no program; did you mean 'publisher'",
        ),
        ("launch:\n- node: {name: a}\n", r":2: 'launch\[0\].node.exec' is missing"),
        ("launch:\n- node: {exec: logger, param: [{name: a}]}\n", r":2: .*\.param\[0\]' needs"),
        ("launch:\n- {}\n", r":2: 'launch\[0\]' needs either"),
        ("launch:\n- arg: {name: a}\n", r":2: 'launch\[0\].arg' is unknown"),
        ("nodes: []\n", ":1: 'launch' is missing"),
        ("launch: [\n", ":2:1: not valid YAML"),
        ("launch:\n- include: {file: f.yaml}\n", "includes itself, directly or through other files"),
        (
            "launch:\n- include: {file: bringup.launch.py}\n",
            r"bringup\.launch\.py is a launch file in Python, but only .* YAML .* 'launch:'.* `ros2 launch`",
        ),
        ("launch:\n- include: {file: none.yaml}\n", "none.yaml: no such file"),
    ],
)
def test_error_in_launch_file_has_its_line(rig: ComponentRig, tmp_path: Path, text: str, output: str) -> None:
    (tmp_path / "f.yaml").write_text(text)
    with pytest.raises(LaunchError, match=output):
        launch_components(read_launch(tmp_path / "f.yaml"), rig.context)


def test_an_unknown_program_raises(rig: ComponentRig) -> None:
    with pytest.raises(UnknownProgramError, match="there are logger, publisher"):
        create_components("xyz", rig.context)
