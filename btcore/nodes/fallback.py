"""Fallbacks: one child has to succeed."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.nodes.ordered_control import OrderedNode, ReactiveNode
from btcore.status import FAILURE, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class Fallback(OrderedNode):
    """Ticks its children in order until a child succeeds.

    If a child is RUNNING, the node is RUNNING, and the next tick continues with this child. If a child
    succeeds, the children are reset and the node succeeds. After a child that fails or is SKIPPED, the
    next child is ticked. After the last child the node fails, or is SKIPPED if all children were skipped.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "?"
    batch_class: ClassVar[str] = "btcore.batch.sequences:Fallback"
    continue_on: ClassVar[Status] = FAILURE


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncFallback(Fallback):
    """A Fallback that returns RUNNING between its children, so that it can be halted there.

    After a child, except the last, that failed in its first tick, the node returns RUNNING and wakes the
    tree; the next tick continues with the next child. Everything else is as in Fallback.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:AsyncFallback"
    yields: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveFallback(ReactiveNode):
    """Ticks its children in order, in every tick from the first child, until a child succeeds or is RUNNING.

    If a child is RUNNING, all other children are halted and the node is RUNNING. If a child succeeds, all
    children are reset and the node succeeds. After a child that fails or is SKIPPED, the next child is
    ticked. After the last child the node fails, or is SKIPPED if all children were skipped.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "↻?"
    batch_class: ClassVar[str] = "btcore.batch.sequences:ReactiveFallback"
    continue_on: ClassVar[Status] = FAILURE
