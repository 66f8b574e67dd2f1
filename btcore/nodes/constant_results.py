"""Leaves with a fixed result: AlwaysSuccess and AlwaysFailure."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.leaf import SyncAction
from btcore.status import FAILURE, SUCCESS, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysSuccess(SyncAction):
    """Returns SUCCESS in every tick."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "⊤"
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS})

    def tick(self) -> Status:
        """Return SUCCESS."""
        return SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysFailure(SyncAction):
    """Returns FAILURE in every tick."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "⊥"
    may_return: ClassVar[frozenset[Status]] = frozenset({FAILURE})

    def tick(self) -> Status:
        """Return FAILURE."""
        return FAILURE
