"""Leaves with a fixed result: AlwaysSuccess and AlwaysFailure."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.leaf import SyncAction
from btcore.engine.node_spec import NodeSpec
from btcore.status import FAILURE, SUCCESS, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysSuccess(SyncAction):
    """Returns SUCCESS in every tick."""

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="⊤", results=frozenset({SUCCESS}), formats=(3, 4))

    def tick(self) -> Status:
        """Return SUCCESS."""
        return SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysFailure(SyncAction):
    """Returns FAILURE in every tick."""

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="⊥", results=frozenset({FAILURE}), formats=(3, 4))

    def tick(self) -> Status:
        """Return FAILURE."""
        return FAILURE
