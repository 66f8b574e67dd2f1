"""Decorators that tick their child again after it completed."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
)
from btcore.values import INT


@mypyc_attr(allow_interpreted_subclasses=True)
class RepeatedNode(DecoratorNode):
    """Ticks its child until it completed with *again* as often as the port *limit* says, −1 = for ever.

    The other result ends the node at once, as its own. A child that completed within one tick is
    ticked anew in the next one, for which a wake-up is asked; a skipped child makes the node SKIPPED
    and the count stays.
    """

    repeat_on: ClassVar[Status] = SUCCESS
    limit: ClassVar[str] = "num_cycles"
    yields: ClassVar[bool] = True

    _count: int = 0

    def tick(self) -> Status:
        """Tick the child, again and again."""
        limit = cast(int, self.get_input(self.limit))
        again = self.repeat_on
        self.set_status(RUNNING)
        while self._count < limit or limit == -1:
            was_idle = self.child._status is IDLE
            status = execute_tick(self.child)
            if status is RUNNING:
                return RUNNING
            if status is again:
                self._count += 1
                limit = self.limit_after(limit)
                self.reset_child()
                if self.yields and was_idle and (self._count < limit or limit == -1):
                    self.wake_up()
                    return RUNNING
            elif status is SKIPPED:
                self.reset_child()
                return SKIPPED
            elif status is IDLE:
                raise NodeError("the child returned IDLE")
            else:
                self._count = 0
                self.reset_child()
                return status
        self._count = 0
        return again

    def limit_after(self, limit: int) -> int:
        """The limit after one more count."""
        return limit

    def halt(self) -> None:
        """Halt the child; nothing is counted."""
        self._count = 0
        self.halt_child()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class Repeat(RepeatedNode):
    """Ticks its child until it succeeded `num_cycles` times (−1 = for ever); FAILURE as soon as it fails.

    A child that succeeds within one tick is ticked anew in the next one. With 0 cycles it succeeds
    without a tick of the child. A skipped child makes it SKIPPED, and the count stays.
    """

    repeat_on: ClassVar[Status] = SUCCESS
    limit: ClassVar[str] = "num_cycles"

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("num_cycles", type=INT, description="how often to repeat a success, −1 = for ever")]


@mypyc_attr(allow_interpreted_subclasses=True)
class RetryUntilSuccessful(RepeatedNode):
    """Ticks its child until it failed `num_attempts` times (−1 = for ever); SUCCESS as soon as it succeeds.

    A child that fails within one tick is ticked anew in the next one. `num_attempts` is read again
    after each failure. With 0 attempts it fails without a tick of the child. A skipped child makes
    it SKIPPED, and the count stays.
    """

    repeat_on: ClassVar[Status] = FAILURE
    limit: ClassVar[str] = "num_attempts"

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("num_attempts", type=INT, description="how often to retry a failure, −1 = for ever")]

    def limit_after(self, limit: int) -> int:
        """The limit as it is now: a tick of the child may have changed it."""
        try:
            return cast(int, self.get_input("num_attempts"))
        except (NodeError, BlackboardError, ConversionError):
            return limit
