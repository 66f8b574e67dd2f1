"""ROS 2 in tests: on the loopback interface only, in a domain for each worker of pytest-xdist."""

import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from btcore_ros2.testing import isolate_ros

if TYPE_CHECKING:
    from btcore_ros2.session import RosSession

HAS_ROS = importlib.util.find_spec("rclpy") is not None
if HAS_ROS:
    isolate_ros()


LIMIT_S = 120
"""The longest wait (s) for anything, on a slow machine."""

LONG_WAIT_S = 50.0
"""The duration (s) of a failed test after which its process runs no further tests.

Fast DDS 3.2 may deadlock when a ROS node ends (its issue 6502). Afterwards, no ROS node of the process
finds another. `make test-ros2` runs failed tests again, in new processes.
"""
_failed_late: list[str] = []


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and call.duration > LONG_WAIT_S:
        _failed_late.append(item.nodeid)
    return report


def pytest_runtest_setup(item: pytest.Item) -> None:
    if _failed_late:
        pytest.fail(f"not run: {_failed_late[0]} timed out in this process", pytrace=False)


def pytest_configure(config: pytest.Config) -> None:
    # rclpy warns if a service does not know its client yet: the response is lost, and leaves ask again.
    config.addinivalue_line("filterwarnings", "ignore:failed to send response:RuntimeWarning")


def wait_until(condition: Callable[[], object]) -> bool:
    """Wait until *condition* returns a true value; return False if it does not within `LIMIT_S`."""
    end = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


@pytest.fixture(autouse=True, scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which servers record by default."""
    home = tmp_path_factory.mktemp("ros")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_HOME", str(home))
        yield home / "btcore" / "recordings"


@pytest.fixture
def session() -> "Iterator[RosSession]":
    """A ROS node in the domain of this worker."""
    from btcore_ros2.session import RosSession

    with RosSession("test") as session:
        yield session


@contextmanager
def _running(script: str) -> Iterator[None]:
    """Run *script* of this folder in another process; it prints "ready" and ends with its standard input."""
    command = [sys.executable, str(Path(__file__).with_name(script))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
        assert process.stdin is not None
        process.stdin.close()


@pytest.fixture(scope="module")
def server() -> Iterator[None]:
    """A process with an ordinary rclpy ROS node, see plain_server.py."""
    with _running("plain_server.py"):
        yield


@pytest.fixture(scope="module")
def mismatched_peer() -> Iterator[None]:
    """A process with an ordinary rclpy ROS node of other types and QoS, see mismatched_peer.py."""
    with _running("mismatched_peer.py"):
        yield
