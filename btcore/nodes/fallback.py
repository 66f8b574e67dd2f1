"""Fallbacks: one child has to succeed."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.nodes.ordered_control import OrderedNode, ReactiveNode
from btcore.status import FAILURE, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class Fallback(OrderedNode):
    """Ticks its children in order until one succeeds.

    RUNNING child: RUNNING, and the same child is ticked next time. SUCCESS: the children are
    reset, SUCCESS. SKIPPED children are passed over. All failed: FAILURE; all skipped: SKIPPED.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "?"
    batch_class: ClassVar[str] = "btcore.batch.sequences:Fallback"
    continue_on: ClassVar[Status] = FAILURE


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncFallback(Fallback):
    """A Fallback that can be interrupted between children.

    After a child that failed within one tick it returns RUNNING and asks to be ticked again.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.sequences:AsyncFallback"
    yields: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveFallback(ReactiveNode):
    """Ticks its children from the first one on every tick, until one doesn't fail.

    RUNNING child: all others are halted, RUNNING. SUCCESS: all are reset, SUCCESS. All failed:
    FAILURE; all skipped: SKIPPED.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "↻?"
    batch_class: ClassVar[str] = "btcore.batch.sequences:ReactiveFallback"
    continue_on: ClassVar[Status] = FAILURE
