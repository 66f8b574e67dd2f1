"""TryCatch: a sequence whose last child handles a failure of the other children."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import ControlNode, results_of_any
from btcore.engine.node import execute_tick, input_or, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, PossibleResults, Status
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class TryCatch(ControlNode):
    """Ticks all children except the last as a Sequence; if a child fails, ticks the last child, the handler.

    The children are reset before the handler is ticked. The node is RUNNING while the handler is RUNNING. It
    fails when the handler has completed or is SKIPPED, with any result of the handler. Without a failure the
    node succeeds, or is SKIPPED if all children except the handler were skipped. With `catch_on_halt` the
    handler is also ticked once when the node is halted before a child failed; a RUNNING handler is then
    halted.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="↩",
        state_fields=("_current_child_index", "_skipped_count", "_catching"),
        skips_alone=False,
        child_count=(2, None),
        child_count_at_load=(2, None),
        child_roles="the last child is the handler",
        continue_on=SUCCESS,
        formats=(4,),
    )

    _current_child_index: int = 0
    _skipped_count: int = 0
    _catching: bool = False  # whether a child failed, so that the handler is ticked

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            Port("catch_on_halt", type=BOOL, default="false", description="also tick the handler on a halt")
        ]

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the results of a node with any children: the handler determines none of them."""
        return results_of_any(cls, children)

    def _forget(self) -> None:
        self._current_child_index = 0
        self._skipped_count = 0
        self._catching = False

    def tick(self) -> Status:
        """Tick the children, starting with the current child, or the handler."""
        if len(self._children) < 2:
            raise NodeError("<TryCatch> needs at least one child and a handler")
        if self._status is IDLE or self._status is SKIPPED:
            self._skipped_count = 0
            self._catching = False
        set_status(self, RUNNING)
        last = len(self._children) - 1
        while not self._catching and self._current_child_index < last:
            status = execute_tick(self._children[self._current_child_index])
            if status is RUNNING:
                return RUNNING
            if status is SUCCESS:
                self._current_child_index += 1
            elif status is SKIPPED:
                self._current_child_index += 1
                self._skipped_count += 1
            elif status is FAILURE:
                self._current_child_index = 0
                self._catching = True
                self.reset_children()
            else:
                raise self.idle_child_error(self._current_child_index)
        # In the tick in which a child failed, the handler is ticked too.
        if self._catching:
            if execute_tick(self._children[last]) is RUNNING:
                return RUNNING
            self._current_child_index = 0
            self._catching = False
            self.reset_children()
            return FAILURE
        all_skipped = self._skipped_count == last
        self._forget()
        self.reset_children()
        return SKIPPED if all_skipped else SUCCESS

    def halt(self) -> None:
        """Halt the children, after one tick of the handler if `catch_on_halt` is true."""
        try:
            last = len(self._children) - 1
            catches = last > 0 and self._status is not IDLE and not self._catching
            if catches and input_or(self, "catch_on_halt", False) is True:
                # Halted first, because the handler cleans up after them.
                for index in range(last):
                    self.halt_child(index)
                if execute_tick(self._children[last]) is RUNNING:
                    self.halt_child(last)
        finally:
            self._forget()
            super().halt()
