"""A running tree is watched on topics of ROS 2, by a plain rclpy program in another process."""

import json
import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

pytest.importorskip("rclpy")

import btcore
from btcore import Builder, NodeExecutionError, Registry, Status, Tree, action, entry_points
from btcore.cli.main import main
from btcore.entry_points import EntryPoint
from btcore_ros2.errors import RosError
from btcore_ros2.telemetry import MAX_WAITING, RosTelemetry
from tests.ros2.conftest import LIMIT_S, wait_until


class Watcher:
    """The messages that a plain rclpy program in another process has received."""

    def __init__(self) -> None:
        program = [sys.executable, str(Path(__file__).with_name("telemetry_watcher.py"))]
        self.process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.received: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.wait(lambda: self.received)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.received.append(json.loads(line))

    def of(self, key: str) -> list[dict[str, Any]]:
        """Return the messages with *key*."""
        return [message for message in self.received if key in message]

    def wait(self, condition: Callable[[], Any]) -> None:
        """Wait until *condition* is met."""
        assert wait_until(condition), self.received

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(LIMIT_S) == 0
        self._thread.join(LIMIT_S)
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture(scope="module")
def process() -> Iterator[Watcher]:
    watcher = Watcher()
    yield watcher
    watcher.close()


@pytest.fixture
def watcher(process: Watcher) -> Watcher:
    """A watcher that has received nothing."""
    process.received.clear()
    return process


@action
def fail_loudly() -> bool:
    logging.getLogger("btcore_test.leaf").warning("Main/leaf: the gripper is stuck")
    raise ValueError("out of range")


def tree_of(body: str) -> Tree:
    nodes = Registry.standard()
    nodes.add(fail_loudly)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes)


def connected(telemetry: RosTelemetry) -> RosTelemetry:
    """Return *telemetry*, when the watcher receives all its topics."""
    assert wait_until(lambda: all(publisher.get_subscription_count() for publisher in telemetry._publishers))
    return telemetry


def test_each_tick_with_transitions_is_a_message_as_from_nav2(watcher: Watcher) -> None:
    pytest.importorskip("nav2_msgs")
    tree = tree_of('<Inverter name="not"><Sleep name="nap" msec="50"/></Inverter>')
    before = time.time()
    with connected(RosTelemetry(tree, ["log"])):
        assert tree.tick_while_running() is Status.FAILURE
    watcher.wait(lambda: len(watcher.of("events")) == 2)
    first, second = (message["events"] for message in watcher.of("events"))
    assert [event[:4] for event in first] == [["not", 1, "IDLE", "RUNNING"], ["nap", 2, "IDLE", "RUNNING"]]
    assert [event[:4] for event in second] == [
        ["nap", 2, "RUNNING", "SUCCESS"],
        ["nap", 2, "SUCCESS", "IDLE"],
        ["not", 1, "RUNNING", "FAILURE"],
        ["not", 1, "FAILURE", "IDLE"],
    ]
    assert before - 1 < first[0][4] < second[0][4] - 0.04
    assert second[-1][4] < time.time() + 1
    watcher.received.clear()
    tree.tick_while_running()  # the telemetry is closed
    assert watcher.of("events") == []


def test_state_is_published_each_second(watcher: Watcher) -> None:
    tree = tree_of('<Sleep msec="2200"/>')
    with connected(RosTelemetry(tree, ["diagnostics"])):
        watcher.wait(lambda: watcher.of("diagnostics"))
        start = time.monotonic()
        # If the machine stops for long enough, no report falls into the first run.
        while not any(report["message"] == "RUNNING" for report in watcher.of("diagnostics")):
            assert tree.tick_while_running(period=0.05) is Status.SUCCESS
        lasted = time.monotonic() - start
    watcher.wait(lambda: watcher.of("diagnostics")[-1]["values"]["state"] == "SUCCESS")
    reports = watcher.of("diagnostics")
    assert (reports[0]["level"], reports[0]["message"]) == (1, "not ticked")
    running = [report for report in reports if report["message"] == "RUNNING"]
    assert 1 <= len(running) <= lasted + 1
    assert running[-1]["diagnostics"] == "btcore: Main"
    assert running[-1]["level"] == 0
    assert 0 < float(running[-1]["values"]["rate (Hz)"]) < 30
    assert {"ticks", "greatest lateness of a tick (ms)", "longest tick (ms)"} <= running[-1]["values"].keys()


def test_errors_and_log_records_are_published_with_the_path_of_the_node(watcher: Watcher) -> None:
    tree = tree_of('<Sequence name="round"><FailLoudly name="leaf"/></Sequence>')
    with connected(RosTelemetry(tree, ["diagnostics", "rosout"])), pytest.raises(NodeExecutionError):
        tree.tick_while_running()
    watcher.wait(
        lambda: len(watcher.of("rosout")) >= 2 and any(m["level"] == 2 for m in watcher.of("diagnostics"))
    )
    records = [message for message in watcher.of("rosout") if message["name"].startswith("btcore")]
    assert [record["level"] for record in records[:2]] == [30, 40]
    assert records[0]["rosout"] == "Main/leaf: the gripper is stuck"
    assert records[0]["name"] == "btcore_test.leaf"
    assert "node 'leaf' <FailLoudly> raised while ticking: ValueError: out of range" in records[1]["rosout"]
    (report,) = [message for message in watcher.of("diagnostics") if message["level"] == 2]
    assert "node 'leaf' <FailLoudly> raised" in report["message"]
    assert "ValueError: out of range" in report["values"]["last error"]


def test_blocked_publisher_does_not_slow_ticks(watcher: Watcher, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nav2_msgs")
    tree = tree_of("<Sequence><AlwaysSuccess/><AlwaysSuccess/></Sequence>")
    blocked = threading.Event()
    released = threading.Event()

    def block(message: object) -> None:
        blocked.set()
        released.wait(LIMIT_S)

    telemetry = RosTelemetry(tree, ["log", "diagnostics"])
    for publisher in telemetry._publishers:
        monkeypatch.setattr(publisher, "publish", block)
    tree.tick_once()
    assert blocked.wait(LIMIT_S)
    for _ in range(MAX_WAITING + 50):
        assert tree.tick_once() is Status.SUCCESS
    assert telemetry._changes is not None
    assert len(telemetry._changes) == MAX_WAITING
    assert telemetry._counter is not None
    assert telemetry._counter.dropped >= 50
    released.set()
    telemetry.close()


def test_publisher_that_fails_ends_with_a_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    tree = tree_of("<AlwaysSuccess/>")
    telemetry = RosTelemetry(tree, ["diagnostics"])
    monkeypatch.setattr(telemetry._publishers[0], "publish", None)
    assert wait_until(lambda: "publishing to ROS 2 has failed, and ends" in caplog.text)
    assert tree.tick_once() is Status.SUCCESS
    telemetry.close()


def test_unknown_topic_is_an_error() -> None:
    b = Builder()
    with pytest.raises(RosError, match="'diagnostic' cannot be published; did you mean 'diagnostics'"):
        RosTelemetry(b.build(b.AlwaysSuccess()), ["diagnostic"])  # type: ignore[list-item]


# --- btcore run


@pytest.fixture
def only_telemetry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the telemetry the only provider of `btcore run`, whatever is installed."""
    point = EntryPoint("telemetry", "btcore_ros2.providers:telemetry", "btcore")
    installed = entry_points.find

    def find(group: str, own: bool = True) -> list[EntryPoint]:
        return [point] if group == entry_points.PROVIDERS_GROUP else installed(group, own)

    monkeypatch.setattr(entry_points, "find", find)


LEAF = """
from pathlib import Path
from btcore import In, action, running

@action
async def wait_for_file(path: In[str]) -> bool:
    while not Path(path).exists():
        await running()
    return True
"""


def test_run_publishes_on_request(watcher: Watcher, only_telemetry: None, tmp_path: Path) -> None:
    (tmp_path / "leaf.py").write_text(LEAF)
    end = tmp_path / "received"
    body = f'<BehaviorTree ID="Waiting"><WaitForFile path="{end}"/></BehaviorTree>'
    (tmp_path / "tree.xml").write_text(f'<root BTCPP_format="4">{body}</root>')
    arguments = ["run", str(tmp_path / "tree.xml"), "--plugin", str(tmp_path / "leaf.py"), "--duration=100"]

    def touch() -> None:
        # Reports of earlier tests may still arrive.
        watcher.wait(lambda: any("Waiting" in report["diagnostics"] for report in watcher.of("diagnostics")))
        end.touch()

    waiting = threading.Thread(target=touch)
    waiting.start()
    result = CliRunner().invoke(main, [*arguments, "--ros2-publish", "diagnostics"])
    waiting.join()
    assert result.exit_code == 0, result.output


def test_missing_messages_are_a_usage_error(
    only_telemetry: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(
        sys.modules["btcore_ros2.telemetry"]._MESSAGES, "log", "absent_msgs/msg/BehaviorTreeLog"
    )
    file = tmp_path / "tree.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>')
    result = CliRunner().invoke(main, ["run", str(file), "--ros2-publish", "log"])
    assert result.exit_code == 2
    assert "'log' cannot be published: the package 'absent_msgs'" in result.output
    assert "btcore ros2 messages" in result.output
