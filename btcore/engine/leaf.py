"""The leaf classes that users subclass: actions that end at once, actions that last, conditions."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.node import SYNCHRONOUS, TreeNode
from btcore.errors import NodeError
from btcore.status import IDLE, NO_RESULT, RUNNING, NodeType, PossibleResults


@mypyc_attr(allow_interpreted_subclasses=True)
class LeafNode(TreeNode):
    """A node without children. In a leaf, True stands for SUCCESS and False for FAILURE."""

    node_type: ClassVar[NodeType] = NodeType.ACTION


@mypyc_attr(allow_interpreted_subclasses=True)
class Condition(LeafNode):
    """A question about the world: override :meth:`tick`, return True or False, change nothing."""

    node_type: ClassVar[NodeType] = NodeType.CONDITION

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """What the class declares, within one tick."""
        return PossibleResults(cls.may_return)


@mypyc_attr(allow_interpreted_subclasses=True)
class SyncAction(LeafNode):
    """An action that is done within one tick: override :meth:`tick`; it never returns RUNNING."""

    _family: ClassVar[int] = SYNCHRONOUS

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """What the class declares, within one tick."""
        return PossibleResults(cls.may_return)


@mypyc_attr(allow_interpreted_subclasses=True)
class StatefulAction(LeafNode):
    """An action that lasts several ticks.

    Override :meth:`on_start`, :meth:`on_running` (which return a Status, True or False) and, to clean
    up, :meth:`on_halted`. A tick must not block: start the work, return RUNNING, and look at it again
    in the next tick. Set *may_complete_on_start* for one whose start may end it within the tick, so that
    `btcore validate` doesn't count it as asynchronous.
    """

    may_complete_on_start: ClassVar[bool] = False

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """What the class declares, after at least one RUNNING tick unless it may complete on start."""
        at_once = cls.may_return if cls.may_complete_on_start else NO_RESULT
        return PossibleResults(at_once, cls.may_return, True)

    def on_start(self) -> object:
        """Begin. Called by the tick that finds the node IDLE."""
        raise NodeError(f"<{self.config.id}> has no on_start()")

    def on_running(self) -> object:
        """Go on. Called by every tick while the node is RUNNING."""
        raise NodeError(f"<{self.config.id}> has no on_running()")

    def on_halted(self) -> None:
        """Clean up. Called when the node is halted while it is RUNNING."""

    def tick(self) -> object:
        """Start or go on; a completed node that nobody has reset keeps its result."""
        before = self._status
        if before is IDLE:
            return self.on_start()
        if before is RUNNING:
            return self.on_running()
        return before

    def halt(self) -> None:
        """Call :meth:`on_halted` if the node is RUNNING, and be IDLE afterwards."""
        try:
            if self._status is RUNNING:
                self.on_halted()
        finally:
            self.reset_status()
