"""Taking what has arrived for a ROS node with rclpy's executor."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor, TimeoutException

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

MAX_CALLBACKS = 100
"""The number of callbacks after which `take` returns. A flood of messages cannot keep it longer."""


class HiddenGroup(MutuallyExclusiveCallbackGroup):  # type: ignore[misc]
    """A callback group that the executor of the ROS node ignores.

    Args:
        is_taking: Returns whether this thread takes for the group.
    """

    def __init__(self, is_taking: Callable[[], bool]) -> None:
        super().__init__()
        self._is_taking = is_taking

    def can_execute(self, entity: Any) -> bool:
        """Return whether an executor may take for *entity* on this thread."""
        return self._is_taking() and bool(super().can_execute(entity))


class GroupExecutor(SingleThreadedExecutor):  # type: ignore[misc]
    """An executor of a callback group. The ROS node stays with its own executor."""

    def __init__(self, node: "Node", group: HiddenGroup) -> None:
        super().__init__(context=node.context)
        self._node = node
        self._group = group

    def get_nodes(self) -> "list[Node]":
        """Return the ROS node."""
        return [self._node]

    def can_execute(self, entity: Any) -> bool:
        """Return whether *entity* belongs to the group and may be taken for."""
        return entity.callback_group is self._group and bool(super().can_execute(entity))


class ExecutorTake:
    """Takes with an executor. A call costs 0.3 ms for ten subscriptions without a message.

    Args:
        executor: The executor, to which the ROS node was added.
    """

    def __init__(self, executor: "Executor") -> None:
        self._executor = executor

    def take(self) -> None:
        """Take everything that has arrived, and call the callbacks, at most `MAX_CALLBACKS`.

        An exception in a callback is raised here. What has not been taken then is taken by the next call.
        """
        called = 0
        while called < MAX_CALLBACKS and (count := self.take_once()):
            called += count

    def take_once(self) -> int:
        """Take at most one item for each entity that has some, and continue coroutines that were suspended.

        Returns:
            The number of callbacks that were completed.
        """
        completed = 0
        while True:
            try:
                task, _, _ = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
            except TimeoutException:
                return completed
            task()
            if task.done():
                completed += 1
                task.result()  # raises the exception of the callback

    def rest(self, entity: Any, pause: float) -> None:
        """Sleep for *pause* (s); see `DirectTake.rest`."""
        time.sleep(pause)
