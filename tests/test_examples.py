"""Every example runs and prints the expected lines."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
EXPECTED_OUTPUT = {
    "01_first_tree.py": ["battery 90%: SUCCESS, alarm off", "battery 10%: SUCCESS, alarm on"],
    "02_stateful_action.py": ["  gripper at rest", "  gripper at rest", "SUCCESS after 8.0 s, 2.5 m"],
    "03_custom_control_node.py": ["working", "resting"],
    "04_bump_and_go.py": [" m, 0 collisions"],
    "05_watch_a_tree.py": ["the tree: Repeat, Sleep", "changes of status"],
    "06_batch_swarm.py": [" trips, 0 empty batteries"],
}


def test_every_example_is_run() -> None:
    # tests/ros2/test_example.py runs the example for ROS 2, in its own environment.
    found = [path.name for path in EXAMPLES.glob("*.py") if "_ros2_" not in path.name]
    assert sorted(EXPECTED_OUTPUT) == sorted(found)


@pytest.mark.parametrize("name", sorted(EXPECTED_OUTPUT))
def test_example_prints_the_expected_lines(name: str) -> None:
    if name == "04_bump_and_go.py":
        pytest.importorskip("pybullet")
    path = EXAMPLES / name
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 60
    done = subprocess.run(
        [sys.executable, path], capture_output=True, text=True, timeout=100, check=True, cwd=EXAMPLES.parent
    )
    lines = done.stdout.splitlines()
    assert len(lines) == len(EXPECTED_OUTPUT[name])
    for line, message in zip(lines, EXPECTED_OUTPUT[name], strict=True):
        assert line.endswith(message)
