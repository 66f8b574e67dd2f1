"""The warning about hooks that other clients left in a C++ robot."""

import json
import signal
from collections.abc import Callable

import pytest

from btcore_monitor.events import HooksEvent, TransitionEvent, TreeEvent
from btcore_monitor.wire.hooks import WireHook, encode_dump
from tests.monitor.conftest import Command
from tests.monitor.watch.conftest import CppRobot, Watcher

RUNNING = 1


@pytest.fixture
def left_over(capture: Callable[[str], list[bytes]]) -> bytes:
    """The captured list of hooks of a C++ robot: a breakpoint before node 4."""
    return capture("hooks_dump_one.rep")[1]


def test_left_over_hooks_are_reported_once_with_the_command_that_removes_them(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    left_over: bytes,
) -> None:
    robot = cpp_robot()
    robot.hooks = left_over
    viewer = watch(robot.address)
    until(lambda: viewer.of(HooksEvent), "the warning")
    (tree,) = viewer.of(TreeEvent)
    (found,) = viewer.of(HooksEvent)
    assert f"breakpoint before {tree.tree.by_uid[4].path}. A breakpoint stops the tree" in found.warning
    assert found.warning.endswith(f"btcore hook {robot.address} clear")
    requests = robot.requests["S"]
    until(lambda: robot.requests["S"] > requests + 5, "more requests")
    assert robot.requests["D"] == len(viewer.of(HooksEvent)) == 1


def test_disabled_hooks_are_reported_because_the_next_request_after_a_silence_enables_them(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.hooks = encode_dump(
        [WireHook(uid, position=1, mode=1, desired_status="FAILURE", enabled=False) for uid in (4, 99)]
    )
    viewer = watch(robot.address, record=False)
    until(lambda: viewer.of(HooksEvent), "the warning")
    path = viewer.of(TreeEvent)[0].tree.by_uid[4].path
    expected = f"injects after {path} FAILURE (disabled), injects after node 99 FAILURE (disabled)"
    assert expected in viewer.of(HooksEvent)[0].warning


@pytest.mark.parametrize("refusal", ["", "Request not recognized"])
def test_a_robot_without_hooks_or_without_control_gets_no_warning(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    refusal: str,
) -> None:
    robot = cpp_robot()
    if refusal:
        robot.refused["D"] = refusal
    viewer = watch(robot.address)
    until(lambda: robot.requests["D"], "the request for hooks")
    robot.change((4, RUNNING))
    until(lambda: viewer.of(TransitionEvent), "the next transition")
    assert not viewer.of(HooksEvent)


def test_an_invalid_list_of_hooks_is_reported_and_the_robot_is_followed(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.hooks = json.dumps([{"uid": 4}]).encode()
    viewer = watch(robot.address)
    until(lambda: viewer.of(HooksEvent), "the warning")
    assert "list of hooks is invalid" in viewer.of(HooksEvent)[0].warning
    robot.change((4, RUNNING))
    until(lambda: viewer.of(TransitionEvent), "the next transition")


def test_record_and_monitor_print_one_warning_about_left_over_hooks(
    cpp_robot: Callable[..., CppRobot],
    command: Callable[..., Command],
    until: Callable[..., None],
    left_over: bytes,
) -> None:
    pytest.importorskip("rerun")
    robot = cpp_robot()
    robot.hooks = left_over
    started = {
        "record": command("record", robot.address, "-o", "run.btlog"),
        "monitor": command("monitor", robot.address, "--no-view", "--save", "x.rrd"),
    }
    for name, watching in started.items():
        watching.wait_for(f"{name}: warning: other clients left hooks in the robot: breakpoint before ")
    requests = robot.requests["S"]
    until(lambda: robot.requests["S"] > requests + 10, "more requests")
    for watching in started.values():
        assert watching.end(signal.SIGINT) == 0, watching.stderr_text
        assert watching.stderr_text.count("warning:") == 1
