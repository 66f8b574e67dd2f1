"""A sample of the random schedules of tests/acceptance/ros2_schedules.py."""

import statistics
from collections.abc import Callable
from types import ModuleType

import pytest

pytest.importorskip("rclpy")


def test_random_schedules(acceptance_script: Callable[[str], ModuleType]) -> None:
    run = acceptance_script("ros2_schedules").Run(seed=3)
    try:
        for _ in range(15):
            run.schedule()
        run.check_clients()
    finally:
        run.close()
    assert run.wrong == []
    assert run.hangs == []
    assert statistics.median(run.halts_us) < 1000
    assert sum(run.outcomes.values()) >= 15
