"""A sample of tests/acceptance/ros2_goals.py: `btcore ros2 serve` keeps nothing of goals that have ended."""

import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from tests.ros2.conftest import LIMIT_S

pytest.importorskip("rclpy")
pytest.importorskip("btcpp_ros2_interfaces")
pytest.importorskip("tf2_msgs")

LATER = ("objects ServerGoalHandle", "objects", "memory (kB)")
"""What grows until goals expire, 10 s after their end."""


def test_ended_goals_leave_nothing(acceptance_script: Callable[[str], ModuleType], tmp_path: Path) -> None:
    script = acceptance_script("ros2_goals")
    run = script.GoalRun(tmp_path)

    def counts() -> dict[str, int]:
        return {name: count for name, count in run.resting_counts(2.5).items() if name not in LATER}

    try:
        run.send(14)
        before, end = counts(), time.monotonic() + LIMIT_S
        run.send(42)
        while script.grown(before, after := counts()):
            assert time.monotonic() < end, script.grown(before, after)
        run.write_trees("Bool")
        run.execute("Talk", {"topic": "/topic0", "other": "/topic0"})
    finally:
        run.close()
    assert run.failed == []
