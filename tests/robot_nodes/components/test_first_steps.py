"""The book's first programs (chapter 2): logger, publisher, subscriber, executor, parameters, launch."""

from pathlib import Path

import pytest

from btcore_robot.components.component import (
    Component,
    ComponentContext,
    ComponentOptions,
    Executor,
    LogMessage,
    MessageLoopError,
)
from btcore_robot.components.first_steps import Int32, Localization, Logger, NumberPublisher, NumberSubscriber
from btcore_robot.components.launch import LaunchError, launch_components, read_launch
from btcore_robot.components.parameters import ParameterError, load_component_parameters
from btcore_robot.components.programs import UnknownProgramError, create_components
from btcore_robot.components.topics import TopicError
from btcore_robot.robot import Phase
from tests.robot_nodes.conftest import RecordingRobot, SteppedClock

SECOND = 10**9


class Desk:
    """A clock, an executor, and the log messages."""

    def __init__(self, clock: SteppedClock) -> None:
        self.clock = clock
        self.lines: list[LogMessage] = []
        self.context = ComponentContext(clock, clock, self.lines.append)
        self.executor = Executor(clock, clock)

    def add(self, *components: Component) -> None:
        for component in components:
            self.executor.add(component)

    @property
    def output(self) -> list[tuple[float, str, str]]:
        return [(line.stamp / SECOND, line.name, line.text) for line in self.lines]


@pytest.fixture
def desk(robot: RecordingRobot) -> Desk:
    return Desk(robot.clock)


def test_the_logger_counts_from_zero_twice_a_second(desk: Desk) -> None:
    desk.add(Logger(desk.context))
    desk.clock.sleep(1.6)
    assert desk.output == [
        (0.5, "logger_node", "Hello 0"),
        (1.0, "logger_node", "Hello 1"),
        (1.5, "logger_node", "Hello 2"),
    ]
    assert str(desk.lines[0]) == "[INFO] [0.500] [logger_node]: Hello 0"


def test_the_publisher_counts_before_it_publishes(desk: Desk) -> None:
    received: list[tuple[float, int]] = []
    listener = Component("listener", desk.context)
    listener.create_subscription(
        "int_topic", Int32, lambda message: received.append((desk.clock.now() / SECOND, message.data))
    )
    desk.add(NumberPublisher(desk.context), listener)
    desk.clock.sleep(1.6)
    assert received == [(0.5, 1), (1.0, 2), (1.5, 3)]


def test_publisher_and_subscriber_in_one_executor(desk: Desk) -> None:
    desk.add(*create_components("executor", desk.context))
    desk.clock.sleep(1.6)
    assert [text for _, _, text in desk.output] == ["Hello 1", "Hello 2", "Hello 3"]
    assert {name for _, name, _ in desk.output} == {"subscriber_node"}


def test_publisher_and_subscriber_in_two_executors(desk: Desk) -> None:
    other = Executor(desk.clock, desk.clock)
    other.add(NumberSubscriber(desk.context))
    desk.add(NumberPublisher(desk.context))
    desk.clock.sleep(1.1)
    assert [(time, text) for time, _, text in desk.output] == [(0.5, "Hello 1"), (1.0, "Hello 2")]


def test_localization_has_default_parameters(desk: Desk) -> None:
    component = Localization(desk.context)
    assert (component.number_particles, component.topics, component.topic_types) == (200, [], [])
    assert desk.lines[0].level == "INFO"


PARAMS = """
localization_node:
  ros__parameters:
    number_particles: 300
    topics: [scan, image]
    topic_types: [sensor_msgs/msg/LaserScan, sensor_msgs/msg/Image]
"""


def test_a_parameter_file_sets_the_parameters(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(PARAMS)
    given = load_component_parameters(tmp_path / "params.yaml", "localization_node")
    component = Localization(desk.context, ComponentOptions(parameters=given))
    assert component.number_particles == 300
    assert component.topics == ["scan", "image"]
    assert [line.level for line in desk.lines] == ["INFO"] * 3


def test_lists_of_different_lengths_are_reported_as_an_error(desk: Desk) -> None:
    Localization(desk.context, ComponentOptions(parameters={"topics": ["scan"]}))
    assert [(line.level, line.text) for line in desk.lines] == [
        ("ERROR", "Number of topics (1) != number of types (0)")
    ]


def test_a_misnamed_parameter_is_ignored_with_a_warning(desk: Desk) -> None:
    """The first launch file of the book passes "particles"."""
    component = Localization(desk.context, ComponentOptions(parameters={"particles": 300}))
    assert component.number_particles == 200
    assert list(component.unused_warnings()) == [
        "localization_node has no parameter 'particles', so its value is ignored; "
        "did you mean 'number_particles'?"
    ]


def test_every_component_accepts_use_sim_time(desk: Desk) -> None:
    assert (
        list(Logger(desk.context, ComponentOptions(parameters={"use_sim_time": True})).unused_warnings())
        == []
    )


@pytest.mark.parametrize(
    "given",
    [{"number_particles": "many"}, {"number_particles": 1.5}, {"topics": "scan"}, {"topics": [1, "a"]}],
)
def test_a_parameter_of_another_type_raises(desk: Desk, given: dict) -> None:
    with pytest.raises(ParameterError, match="localization_node: the parameter '"):
        Localization(desk.context, ComponentOptions(parameters=given))


# --- topics


class Talk:
    """A component that publishes numbers, and a component that subscribes to them."""

    def __init__(self, desk: Desk, *, latched: bool = False) -> None:
        self.speaker = Component("speaker", desk.context)
        self.listener = Component("listener", desk.context)
        self.numbers = self.speaker.create_publisher("numbers", Int32, latched=latched)
        self.received: list[int] = []

    def send(self, *numbers: int) -> None:
        for number in numbers:
            self.numbers.publish(Int32(number))

    def receive(self, message: Int32) -> None:
        self.received.append(message.data)


def test_a_full_queue_loses_its_oldest_messages(desk: Desk) -> None:
    talk = Talk(desk)
    subscription = talk.listener.create_subscription("numbers", Int32, talk.receive, depth=2)
    desk.add(talk.listener)
    talk.send(1, 2, 3, 4)
    assert talk.received == []
    desk.clock.sleep(0.0)
    assert talk.received == [3, 4]
    assert subscription.lost == 2


def test_a_later_subscriber_receives_the_last_message_of_a_latched_topic(desk: Desk) -> None:
    talk = Talk(desk, latched=True)
    talk.send(1, 2)
    talk.listener.create_subscription("numbers", Int32, talk.receive)
    desk.add(talk.listener)
    desk.clock.sleep(0.0)
    assert talk.received == [2]


def test_a_later_subscriber_receives_no_earlier_message_without_latching(desk: Desk) -> None:
    talk = Talk(desk)
    talk.send(1, 2)
    talk.listener.create_subscription("numbers", Int32, talk.receive)
    desk.add(talk.listener)
    desk.clock.sleep(0.0)
    assert talk.received == []


def test_a_message_or_a_subscription_of_another_type_raises(desk: Desk) -> None:
    talk = Talk(desk)
    with pytest.raises(TopicError, match="/numbers has messages of type Int32, not of type str"):
        talk.numbers.publish("seven")  # type: ignore[arg-type]
    with pytest.raises(TopicError, match="which speaker declared, not of type str"):
        talk.listener.create_subscription("/numbers", str, print)


def test_a_component_is_remapped_at_its_start(desk: Desk) -> None:
    listener = NumberSubscriber(desk.context, ComponentOptions("other", {"int_topic": "/numbers"}))
    talk = Talk(desk)
    desk.add(listener)
    talk.send(7)
    desk.clock.sleep(0.0)
    assert desk.output == [(0.0, "other", "Hello 7")]


def test_a_message_is_received_at_the_time_of_its_publication(desk: Desk) -> None:
    talk = Talk(desk)
    moments: list[float] = []
    talk.listener.create_subscription(
        "numbers", Int32, lambda message: moments.append(desk.clock.now() / SECOND)
    )
    desk.add(talk.listener)
    desk.clock.add_task(4.0, Phase.SENSORS, lambda now: talk.send(1))
    desk.clock.sleep(1.0)
    assert moments == [0.25, 0.5, 0.75, 1.0]


def test_a_destroyed_component_receives_nothing_and_its_timers_stop(desk: Desk) -> None:
    talk = Talk(desk)
    talk.listener.create_subscription("numbers", Int32, talk.receive)
    logger = Logger(desk.context)
    desk.add(talk.listener, logger)
    talk.listener.destroy()
    logger.destroy()
    talk.send(1)
    desk.clock.sleep(2.0)
    assert (talk.received, desk.lines) == ([], [])


def test_a_timer_can_be_cancelled_by_its_own_callback(desk: Desk) -> None:
    component = Component("once", desk.context)
    calls: list[int] = []
    timer = component.create_timer(0.1, lambda: (calls.append(1), timer.cancel()))
    desk.add(component)
    desk.clock.sleep(1.0)
    assert calls == [1]


def test_callbacks_that_publish_to_each_other_without_end_raise(desk: Desk) -> None:
    talk = Talk(desk)
    talk.listener.create_subscription("numbers", Int32, talk.numbers.publish)
    desk.add(talk.listener)
    talk.send(1)
    with pytest.raises(MessageLoopError, match="the callbacks of listener publish to each other without end"):
        desk.clock.sleep(0.0)


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


def test_a_launch_file_starts_publisher_and_subscriber(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "pub_sub.launch.yaml").write_text(PUB_SUB)
    desk.add(*launch_components(read_launch(tmp_path / "pub_sub.launch.yaml"), desk.context))
    assert [component.name for component in desk.executor.components] == ["speaker", "subscriber_node"]
    desk.clock.sleep(1.1)
    assert [text for _, _, text in desk.output] == ["Hello 1", "Hello 2"]


def test_a_launch_file_includes_others_and_sets_parameters(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "pub_sub.launch.yaml").write_text(PUB_SUB)
    (tmp_path / "params.yaml").write_text(PARAMS)
    (tmp_path / "all.launch.yaml").write_text(WITH_PARAMS)
    components = launch_components(read_launch(tmp_path / "all.launch.yaml"), desk.context)
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
def test_error_in_launch_file_has_its_line(desk: Desk, tmp_path: Path, text: str, output: str) -> None:
    (tmp_path / "f.yaml").write_text(text)
    with pytest.raises(LaunchError, match=output):
        launch_components(read_launch(tmp_path / "f.yaml"), desk.context)


def test_an_unknown_program_raises(desk: Desk) -> None:
    with pytest.raises(UnknownProgramError, match="there are logger, publisher"):
        create_components("xyz", desk.context)
