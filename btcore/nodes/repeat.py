"""Decorators that tick their child again after it has completed: Repeat and RetryUntilSuccessful."""

from collections.abc import Mapping
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, input_or, reset_status, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import FAILURE, IDLE, NO_RESULT, RUNNING, SKIPPED, SUCCESS, PossibleResults, Status
from btcore.values import INT


@mypyc_attr(allow_interpreted_subclasses=True)
class RepeatedNode(DecoratorNode):
    """Ticks its child until it has returned *repeat_on* as often as required, and returns *repeat_on*.

    If the child returns the opposite of *repeat_on*, the node returns this result at once. If the child
    returns *repeat_on* in its first tick and repetitions remain, a node that is async wakes the tree and
    returns RUNNING; the next tick starts the child again. A skipped child makes the node SKIPPED and does not
    change the count.

    Attributes:
        repeat_on: SUCCESS or FAILURE.
        limit_port: The name of the port that gives the required number; −1 = forever.
        is_async: Whether the node returns RUNNING between repetitions, so that a parent can halt it there.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="↺", state_fields=("_count",), never_pauses=True)
    repeat_on: ClassVar[Status] = SUCCESS
    limit_port: ClassVar[str] = "num_cycles"
    is_async: ClassVar[bool] = True

    _count: int = 0

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the results that follow from the child's results and from the limit, if it is a literal."""
        child, repeat_on, limit = children[0], cls.repeat_on, literals.get(cls.limit_port)
        if not isinstance(limit, int):
            return PossibleResults(child.in_first_tick | {repeat_on}, child.results | {repeat_on}, True)
        if limit == 0 or limit < -1:
            return PossibleResults(frozenset({repeat_on}))
        if limit == 1:
            return child
        results = child.results - {repeat_on} if limit < 0 else child.results
        pauses = cls.is_async and repeat_on in child.in_first_tick
        first = child.in_first_tick & results
        if pauses and SKIPPED not in child.results:
            first -= {repeat_on}
        may_run = child.may_run or pauses
        return PossibleResults(first, results if may_run else NO_RESULT, may_run or limit < 0)

    def tick(self) -> Status:
        """Tick the child until it is RUNNING, the limit is reached, or the result is known."""
        limit = cast(int, self.get_input(self.limit_port))
        repeat_on = self.repeat_on
        set_status(self, RUNNING)
        while self._count < limit or limit == -1:
            was_idle = self.child._status is IDLE
            status = execute_tick(self.child)
            if status is RUNNING:
                return RUNNING
            if status is repeat_on:
                self._count += 1
                limit = self.limit_after(limit)
                reset_status(self.child)
                has_more = self._count < limit or limit == -1
                if was_idle and has_more and self._must_pause():
                    self.wake_up()
                    return RUNNING
            elif status is SKIPPED:
                # The count is kept, as in BehaviorTree.CPP: the next start continues it.
                self.reset_child()
                return SKIPPED
            elif status is IDLE:
                raise NodeError("the child returned IDLE")
            else:
                self._count = 0
                reset_status(self.child)
                return status
        self._count = 0
        return repeat_on

    def _must_pause(self) -> bool:
        return self.is_async or self._context.must_pause(self.config.uid, self._count)

    def limit_after(self, limit: int) -> int:
        """Return the limit that applies after a repetition, given the *limit* before."""
        return limit

    def halt(self) -> None:
        """Halt the child, and set the count to 0."""
        self._count = 0
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class Repeat(RepeatedNode):
    """Ticks its child until it has succeeded `num_cycles` times, and succeeds; −1 = forever.

    The node fails as soon as the child fails. If the child succeeds in its first tick and cycles remain, the
    node returns RUNNING and wakes the tree; the next tick starts the child again. With 0 cycles it succeeds
    without ticking the child. A skipped child makes the node SKIPPED and does not change the count.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the number of successes after which the node succeeds, −1 = repeat forever"
        return [Port("num_cycles", type=INT, description=about, role=PortRole.REPETITIONS)]


@mypyc_attr(allow_interpreted_subclasses=True)
class RetryUntilSuccessful(RepeatedNode):
    """Ticks its child until it has failed `num_attempts` times, and fails; −1 = forever.

    The node succeeds as soon as the child succeeds. If the child fails in its first tick and attempts remain,
    the node returns RUNNING and wakes the tree; the next tick starts the child again. `num_attempts` is read
    again after each failure. With 0 attempts it fails without ticking the child. A skipped child makes the
    node SKIPPED and does not change the count.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    repeat_on: ClassVar[Status] = FAILURE
    limit_port: ClassVar[str] = "num_attempts"

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the number of failures after which the node fails, −1 = retry forever"
        return [Port("num_attempts", type=INT, description=about, role=PortRole.REPETITIONS)]

    def limit_after(self, limit: int) -> int:
        """Return the current value of the port, which a tick of the child may have changed."""
        return cast(int, input_or(self, "num_attempts", limit))
