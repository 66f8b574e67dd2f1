"""ROS 2 in tests: on the loopback interface only, in a domain for each worker of pytest-xdist."""

import importlib.util
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from btcore_ros2.testing import isolate_ros

if TYPE_CHECKING:
    from btcore_ros2.session import RosSession

HAS_ROS = importlib.util.find_spec("rclpy") is not None
if HAS_ROS:
    isolate_ros()


@pytest.fixture
def session() -> "Iterator[RosSession]":
    """A ROS node in the domain of this worker."""
    from btcore_ros2.session import RosSession

    with RosSession("test") as made:
        yield made
