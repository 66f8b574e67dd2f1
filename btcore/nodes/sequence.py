"""Sequences: every child has to succeed."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.nodes.ordered_control import OrderedNode, ReactiveNode
from btcore.status import SUCCESS, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class Sequence(OrderedNode):
    """Ticks its children in order while they succeed.

    RUNNING child: RUNNING, and the same child is ticked next time. FAILURE: the children are
    reset, FAILURE. SKIPPED children are passed over. All succeeded: SUCCESS; all skipped: SKIPPED.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "→"
    batch_class: ClassVar[str] = "btcore.batch.sequences:Sequence"
    continue_on: ClassVar[Status] = SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncSequence(Sequence):
    """A Sequence that can be interrupted between children.

    After a child that succeeded within one tick it returns RUNNING and asks to be ticked again.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:AsyncSequence"
    yields: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class SequenceWithMemory(Sequence):
    """A Sequence that goes on at the child that failed.

    On FAILURE only the children from that one on are reset, and the next start begins there; a
    halt doesn't forget it. As AsyncSequence it yields after a child that succeeded within one tick.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:SequenceWithMemory"
    remembers: ClassVar[bool] = True
    yields: ClassVar[bool] = True

    def finish_early(self) -> None:
        """Reset from the child that failed on, and remember it."""
        for index in range(self._next, len(self._children)):
            self.halt_child(index)

    def halt(self) -> None:
        """Halt the children; where it was is remembered."""
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveSequence(ReactiveNode):
    """Ticks its children from the first one on every tick, while they succeed.

    RUNNING child: all others are halted, RUNNING. FAILURE: all are reset, FAILURE. All succeeded:
    SUCCESS; all skipped: SKIPPED.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "↻→"
    batch_class: ClassVar[str] = "btcore.batch.sequences:ReactiveSequence"
    continue_on: ClassVar[Status] = SUCCESS
