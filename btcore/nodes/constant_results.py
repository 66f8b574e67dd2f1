"""Leaves whose result is fixed."""

from mypy_extensions import mypyc_attr

from btcore.engine.leaf import SyncAction
from btcore.status import FAILURE, SUCCESS, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysSuccess(SyncAction):
    """Succeeds."""

    def tick(self) -> Status:
        """SUCCESS."""
        return SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class AlwaysFailure(SyncAction):
    """Fails."""

    def tick(self) -> Status:
        """FAILURE."""
        return FAILURE
