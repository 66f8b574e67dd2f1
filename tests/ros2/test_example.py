"""The example for ROS 2 runs and prints the expected line."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("test_msgs")

EXAMPLE = Path(__file__).parents[2] / "examples" / "07_ros2_leaves.py"


def test_example_prints_the_expected_line() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 60
    done = subprocess.run([sys.executable, EXAMPLE], capture_output=True, text=True, timeout=100, check=True)
    assert done.stdout == "SUCCESS 5\n"
