"""Recording ticks and halts at a boundary between built-in and external nodes, while the tree has a journal.

Built-in code runs inside the journal: what it does follows from what is recorded. External code, that of
nodes that are not built in and of callbacks, runs outside: its results and writes are recorded.
"""

from btcore.engine.journal import Journal
from btcore.engine.node import TickWrapper, TreeNode, halt_node
from btcore.engine.recorded_events import ChildHalted, ChildTicked, Raised, recorded_error
from btcore.status import IDLE, Status


class RecordedTick(TickWrapper):
    """The wrapper of an external node, or of a built-in node whose parent is external.

    Args:
        former: The previous wrapper of the node, or None.
        journal: Records the results of an external node, or that its external parent ticks and halts a node.
        is_external: Whether the node is external; if not, its parent is.
    """

    def __init__(self, former: TickWrapper | None, journal: Journal, is_external: bool) -> None:
        super().__init__(former)
        self.journal = journal
        self.is_external = is_external

    @property
    def is_empty(self) -> bool:
        """Whether the node needs no wrapper."""
        return False

    def tick(self, node: TreeNode) -> Status:
        """Tick *node*. Record the call if it comes from outside: from an external parent."""
        journal = self.journal
        if journal.is_inside:
            return super().tick(node)
        journal.enter()
        journal.add(ChildTicked(node.config.uid))
        try:
            return super().tick(node)
        finally:
            journal.leave()

    def call_tick(self, node: TreeNode) -> Status:
        """Call `tick` of *node*. If the node is external, record its result."""
        if not self.is_external:
            return super().call_tick(node)
        journal = self.journal
        journal.leave()
        try:
            status = super().call_tick(node)
        except BaseException as error:
            journal.enter()
            journal.add(Raised(node.config.uid, recorded_error(error)))
            raise
        journal.enter_with_result(node.config, status)
        return status

    def halt(self, node: TreeNode) -> None:
        """Halt *node*. Record the call if it comes from outside: from an external parent."""
        journal = self.journal
        if journal.is_inside:
            super().halt(node)
            return
        journal.enter()
        journal.add(ChildHalted(node.config.uid))
        try:
            halt_node(node)  # from inside now, so that what follows an exception is inside, too
        finally:
            journal.leave()

    def call_halt(self, node: TreeNode) -> None:
        """Call `halt` of *node*. Record what an external node does, unless it only resets itself."""
        if not self.is_external:
            super().call_halt(node)
            return
        journal = self.journal
        start = journal.record_count
        journal.leave()
        raised: BaseException | None = None
        try:
            super().call_halt(node)
        except BaseException as error:
            raised = error
            raise
        finally:
            journal.enter()
            journal.add_halt(node.config.uid, start, raised, node._status is IDLE)


def start_recording(node: TreeNode, journal: Journal, is_external: bool) -> None:
    """Let *journal* record the ticks and halts of *node*; see `RecordedTick`."""
    with node._context.lock:
        node._wrapper = RecordedTick(node._wrapper, journal, is_external)


def stop_recording(node: TreeNode) -> None:
    """End the effect of `start_recording`."""
    with node._context.lock:
        if isinstance(node._wrapper, RecordedTick):
            wrapper = TickWrapper(node._wrapper)
            node._wrapper = None if wrapper.is_empty else wrapper
