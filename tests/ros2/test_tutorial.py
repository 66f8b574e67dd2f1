"""The tutorial for ROS 2: its commands run in the order of the page, and print what the page shows."""

import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")
pytest.importorskip("nav2_msgs")

from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros
from tests.docs.test_docs import PROGRESS, commands, environment, files, output_matches

PAGE = Path(__file__).parents[2] / "docs/tutorials/ros2_robot.md"
COMMAND_LIMIT_S = 250.0
"""The longest time (s) of a command, on a slow machine."""

SHORTER = {
    "$ btcore ros2 doctor": "$ btcore ros2 doctor --seconds 1",
    "--duration 30": "--duration 3",
    "30.0 s": "3.0 s",
    "time_to_wait=60": "time_to_wait=250",
    "RosServiceCall       …": "RosServiceCall…",  # the number of ticks has one or two digits
}
"""Texts of the page, and those that replace them in this test."""

SLOW = re.compile(r"^(warning: \d+ ticks? \w+ missed|.*RTPS_TRANSPORT_SHM).*\n", re.MULTILINE)
"""What a slow machine prints in addition: of the tree, and of Fast DDS, whose files others lock."""


class Terminal:
    """Runs commands in the folder with the files of the page."""

    def __init__(self, folder: Path, page: str) -> None:
        self._folder = folder / "page"
        self._folder.mkdir()
        for name, texts in files(page).items():
            (self._folder / name).write_text(texts[0], encoding="utf-8")
        isolate_ros()  # tests before may have left ROS nodes in their domain
        self._environment = environment(folder)
        del self._environment["PYTHONWARNINGS"]  # rclpy's messages have deprecated imports

    @contextmanager
    def start(self, command: str) -> Iterator["subprocess.Popen[str]"]:
        """Start *command*, which is ended like by Ctrl-C."""
        with subprocess.Popen(
            ["bash", "-c", f"exec {command}"],
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as process:
            try:
                yield process
            finally:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)

    def check(self, command: str, expected: str) -> None:
        """Check that *command* prints *expected*."""
        end = time.monotonic() + COMMAND_LIMIT_S
        while True:
            with self.start(command) as process:
                output = SLOW.sub("", PROGRESS.sub("", process.communicate(timeout=COMMAND_LIMIT_S)[0]))
            if output_matches(expected, output):
                return
            # A slow machine finds the ROS nodes later.
            found_nothing = "no other ROS node is visible" in output and time.monotonic() < end
            assert found_nothing, f"{command}\n{output}"


def test_the_commands_of_the_tutorial_print_what_it_shows(tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    for text, shorter in SHORTER.items():
        assert text in page
        page = page.replace(text, shorter)
    ((_, reader, _),) = commands(page.replace("console unrun: needs ROS 2, in parallel", "console"))
    (_, simulation, ready), *others = commands(page.replace("console unrun: needs ROS 2\n", "console\n"))
    terminal = Terminal(tmp_path, page)
    runs = [(command, expected) for _, command, expected in others if command.startswith("btcore run")]
    assert (len(runs), len(others)) == (3, 6)
    with terminal.start(simulation) as robot:
        assert robot.stdout is not None
        assert next(line for line in robot.stdout if not SLOW.match(line)) == ready
        for _, command, expected in others:
            if not command.startswith("btcore run"):
                terminal.check(command, expected)
    # On a slow machine, the robot must wait for the runs.
    with terminal.start(f"{simulation} --lockstep") as robot:
        assert robot.stdout is not None
        assert next(line for line in robot.stdout if not SLOW.match(line))
        for command, expected in runs[:-1]:
            terminal.check(f"{command} --lockstep", expected)
        with RosSession() as session, terminal.start(reader) as process:
            assert session.wait_for(
                lambda: session.node.count_subscribers("/behavior_tree_log"), COMMAND_LIMIT_S
            )
            while process.poll() is None:
                # A run may end before it has discovered the reader; then nothing is read.
                terminal.check(f"{runs[-1][0]} --lockstep", runs[-1][1])
                with suppress(subprocess.TimeoutExpired):
                    process.wait(5)
            # Which transitions it prints depends on the moment.
            assert " → " in process.communicate(timeout=COMMAND_LIMIT_S)[0]
