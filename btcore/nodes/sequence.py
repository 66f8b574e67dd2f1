"""Sequences: they succeed if all their children succeed."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.nodes.ordered_control import OrderedNode, ReactiveNode
from btcore.status import SUCCESS, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class Sequence(OrderedNode):
    """Ticks its children in order while they succeed.

    If a child is RUNNING, the node is RUNNING, and the next tick continues with this child. If a child
    fails, the children are reset and the node fails. After a child that succeeds or is SKIPPED, the next
    child is ticked. After the last child the node succeeds, or is SKIPPED if all children were skipped.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "→"
    batch_class: ClassVar[str] = "btcore.batch.sequences:Sequence"
    continue_on: ClassVar[Status] = SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncSequence(Sequence):
    """A Sequence that returns RUNNING between its children, so that it can be halted there.

    After a child, except the last, that succeeded in its first tick, the node returns RUNNING and wakes
    the tree; the next tick continues with the next child. Everything else is as in Sequence.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:AsyncSequence"
    yields: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class SequenceWithMemory(Sequence):
    """A Sequence that starts again at the child that failed.

    When a child fails, only this child and the following children are reset, and the next start begins
    with this child, even after a halt. Like AsyncSequence, the node returns RUNNING after a child, except
    the last, that succeeded in its first tick.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:SequenceWithMemory"
    remembers: ClassVar[bool] = True
    yields: ClassVar[bool] = True

    def halt(self) -> None:
        """Halt the children. The next start begins with the current child."""
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveSequence(ReactiveNode):
    """Ticks its children in order, in every tick from the first child, while they succeed.

    If a child is RUNNING, all other children are halted and the node is RUNNING. If a child fails, all
    children are reset and the node fails. After a child that succeeds or is SKIPPED, the next child is
    ticked. After the last child the node succeeds, or is SKIPPED if all children were skipped.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "↻→"
    batch_class: ClassVar[str] = "btcore.batch.sequences:ReactiveSequence"
    continue_on: ClassVar[Status] = SUCCESS
