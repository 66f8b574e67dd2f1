"""ROS 2 in tests: on the loopback interface only, in a domain for each worker of pytest-xdist."""

import importlib.util
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from btcore_ros2.session import RosSession

WORKER = int("0" + "".join(filter(str.isdigit, os.environ.get("PYTEST_XDIST_WORKER", ""))))
DOMAIN = 20 + WORKER
# Before rclpy is imported, and inherited by the processes that a test starts.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)

HAS_ROS = importlib.util.find_spec("rclpy") is not None


@pytest.fixture
def session() -> "Iterator[RosSession]":
    """A ROS node in the domain of this worker."""
    from btcore_ros2.session import RosSession

    with RosSession("test") as made:
        yield made
