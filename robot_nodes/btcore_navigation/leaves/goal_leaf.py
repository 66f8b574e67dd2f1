"""The base class of leaves that send goals."""

from typing import Any

from btcore import NodeSpec, StatefulAction
from btcore_navigation.action import GoalHandle


class GoalLeaf(StatefulAction):
    """Has at most one goal at a time. A halt cancels the goal.

    Attributes:
        handle: The handle of the goal; None without a goal.
    """

    spec = NodeSpec(state_fields=None)  # the goal and its handle belong to the server

    handle: GoalHandle[Any, Any, Any] | None = None

    def on_halted(self) -> None:
        """Cancel the goal."""
        if self.handle is not None:
            self.handle.cancel()
            self.handle = None
