"""Nodes that wait: on the tree's clock, and looked at when the tree is ticked."""

from collections.abc import Mapping
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.clock import NS_PER_MS
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import execute_tick
from btcore.status import (
    FAILURE,
    NO_RESULT,
    RUNNING,
    SUCCESS,
    PossibleResults,
    Status,
)
from btcore.values import UINT


@mypyc_attr(allow_interpreted_subclasses=True)
class Timeout(DecoratorNode):
    """Halts its child and fails when it still runs `msec` milliseconds after the start; 0 = no limit.

    The tree is woken at that moment. A child that completes in time gives its own result.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "◷"
    batch_class: ClassVar[str] = "btcore.batch.timing:Timeout"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_deadline",)

    _deadline: int = -1

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The child's, and FAILURE if the child may run."""
        child = children[0]
        late = child.after_running | {FAILURE} if child.may_run else child.after_running
        return PossibleResults(child.in_first_tick, late, child.may_run)

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        about = "time that the child has (ms), 0 = no limit"
        return [Port("msec", type=UINT, description=about, role=PortRole.DURATION)]

    def tick(self) -> Status:
        """Tick the child while there is time."""
        allowed = cast(int, self.get_input("msec"))
        if self._deadline < 0:
            self.set_status(RUNNING)
            self._deadline = self.now() + allowed * NS_PER_MS if allowed > 0 else 0
            if allowed > 0:
                self.wake_at(self._deadline)
        elif self._deadline > 0 and self.now() >= self._deadline:
            if self.child._status is RUNNING:
                self._stop()
                self.halt_child()
                return FAILURE
            # The original's timer fires once, and finds nothing to halt.
            self._deadline = 0
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self._stop()
            self.reset_child()
        return status

    def _stop(self) -> None:
        self._deadline = -1
        self.cancel_wake_up()

    def halt(self) -> None:
        """Halt the child and stop the clock, which goes on in format 3, as it did there."""
        if self.config.format != 3:
            self._stop()
        self.halt_child()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class Delay(DecoratorNode):
    """Ticks its child only when `delay_msec` milliseconds have passed since the start; RUNNING until then.

    The tree is woken at that moment. While the child runs it isn't delayed again.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "◷"
    batch_class: ClassVar[str] = "btcore.batch.timing:Delay"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_deadline",)

    _deadline: int = -1

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The child's, after RUNNING."""
        return PossibleResults(NO_RESULT, children[0].results, True)

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        about = "time before the child's first tick (ms)"
        return [Port("delay_msec", type=UINT, description=about, role=PortRole.DURATION)]

    def tick(self) -> Status:
        """Wait, then tick the child."""
        delay = cast(int, self.get_input("delay_msec"))
        if self._deadline < 0:
            self.set_status(RUNNING)
            self._deadline = self.now() + delay * NS_PER_MS
            self.wake_at(self._deadline)
            return RUNNING
        if self.now() < self._deadline:
            return RUNNING
        status = execute_tick(self.child)
        if self.ends_with(status):
            self._deadline = -1
            self.reset_child()
        return status

    def ends_with(self, status: Status) -> bool:
        """Whether the next tick starts a new delay, after the child's *status*."""
        return status is SUCCESS or status is FAILURE

    def halt(self) -> None:
        """Halt the child and stop the clock."""
        self._deadline = -1
        self.cancel_wake_up()
        self.halt_child()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class Sleep(StatefulAction):
    """Runs for `msec` milliseconds, then succeeds; the tree is woken at that moment. 0 = at once."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "◷"
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS})
    batch_class: ClassVar[str] = "btcore.batch.timing:Sleep"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_deadline",)

    _deadline: int = 0

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """SUCCESS, at once if the time is 0."""
        if literals.get("msec") == 0:
            return PossibleResults(cls.may_return)
        return PossibleResults(NO_RESULT, cls.may_return, True)

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("msec", type=UINT, description="how long to sleep (ms)", role=PortRole.DURATION)]

    def on_start(self) -> Status:
        """Start the clock."""
        duration = cast(int, self.get_input("msec"))
        if duration <= 0:
            return SUCCESS
        self._deadline = self.now() + duration * NS_PER_MS
        self.wake_at(self._deadline)
        return RUNNING

    def on_running(self) -> Status:
        """Look at the clock."""
        return SUCCESS if self.now() >= self._deadline else RUNNING

    def on_halted(self) -> None:
        """Stop the clock."""
        self.cancel_wake_up()
