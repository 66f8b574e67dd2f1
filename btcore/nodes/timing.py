"""Nodes that wait on the tree's clock. They check it in each tick, and wake the tree in time."""

from collections.abc import Mapping
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.clock import NS_PER_MS
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import execute_tick, read_clock, reset_status, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.status import FAILURE, NO_RESULT, RUNNING, SKIPPED, SUCCESS, PossibleResults, Status
from btcore.values import UINT


@mypyc_attr(allow_interpreted_subclasses=True)
class Timeout(DecoratorNode):
    """Halts its child and fails if the child is still RUNNING `msec` milliseconds after the start.

    An `msec` of 0 means no limit. The tree is woken when the time has passed. If the child completes earlier,
    the node returns the child's result. SKIPPED is returned unchanged, and the time continues.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="◷", state_fields=("_deadline",), time_fields=("_deadline",), formats=(3, 4)
    )

    _deadline: int = -1  # ns; -1 = not started, 0 = no limit, or it has passed

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results, and FAILURE if the child may be RUNNING."""
        child = children[0]
        late = child.after_running | {FAILURE} if child.may_run else child.after_running
        return PossibleResults(child.in_first_tick, late, child.may_run)

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the time limit of the child (ms), 0 = no limit"
        return [Port("msec", type=UINT, description=about, role=PortRole.DURATION)]

    def tick(self) -> Status:
        """Tick the child; fail if it is still RUNNING after the time limit."""
        allowed = cast(int, self.get_input("msec"))
        if self._deadline < 0:
            set_status(self, RUNNING)
            self._deadline = read_clock(self) + allowed * NS_PER_MS if allowed > 0 else 0
            if allowed > 0:
                self.wake_at(self._deadline)
        elif self._deadline > 0 and self.has_passed(self._deadline):
            if self.child._status is RUNNING:
                self._stop()
                self.halt_child()
                return FAILURE
            # BehaviorTree.CPP's timer fires once, and has no effect if the child is not RUNNING then.
            self._deadline = 0
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self._stop()
            reset_status(self.child)
        return status

    def _stop(self) -> None:
        self._deadline = -1
        self.cancel_wake_up()

    def halt(self) -> None:
        """Halt the child and cancel the timeout; in format 3 it continues, as in BehaviorTree.CPP 3."""
        if self.config.format != 3:
            self._stop()
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class Delay(DecoratorNode):
    """Is RUNNING for `delay_msec` milliseconds, then ticks its child and returns the child's result.

    The tree is woken when the time has passed. A RUNNING child, or in format 4 a skipped child, is ticked
    again without a delay. After the child has completed, the next start waits again.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="◷", state_fields=("_deadline",), time_fields=("_deadline",), formats=(3, 4)
    )

    _deadline: int = -1  # ns; -1 = not started

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results; the node never completes in its first tick."""
        return PossibleResults(NO_RESULT, children[0].results, True)

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the time before the first tick of the child (ms)"
        return [Port("delay_msec", type=UINT, description=about, role=PortRole.DURATION)]

    def tick(self) -> Status:
        """Return RUNNING until the time has passed, then tick the child."""
        delay = cast(int, self.get_input("delay_msec"))
        if self._deadline < 0:
            set_status(self, RUNNING)
            self._deadline = read_clock(self) + delay * NS_PER_MS
            self.wake_at(self._deadline)
            # Even for 0 ms: BehaviorTree.CPP's timer fires in its own thread, usually after this tick.
            return RUNNING
        if not self.has_passed(self._deadline):
            return RUNNING
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE or (status is SKIPPED and self.config.format == 3):
            self._deadline = -1
            self.reset_child()  # not `reset_status`: a child that returns SKIPPED may still be RUNNING
        return status

    def halt(self) -> None:
        """Halt the child and cancel the delay."""
        self._deadline = -1
        self.cancel_wake_up()
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class Sleep(StatefulAction):
    """Is RUNNING for `msec` milliseconds, then succeeds; 0 = succeed at once.

    The tree is woken when the time has passed.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="◷",
        results=frozenset({SUCCESS}),
        state_fields=("_deadline",),
        time_fields=("_deadline",),
        formats=(4,),
    )

    _deadline: int = 0

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return SUCCESS, in the first tick only if the time is 0."""
        if literals.get("msec") == 0:
            return PossibleResults(cls.spec.results)
        return PossibleResults(NO_RESULT, cls.spec.results, True)

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [Port("msec", type=UINT, description="the time to sleep (ms)", role=PortRole.DURATION)]

    def on_start(self) -> Status:
        """Start the sleep."""
        duration = cast(int, self.get_input("msec"))
        if duration <= 0:
            return SUCCESS
        self._deadline = read_clock(self) + duration * NS_PER_MS
        self.wake_at(self._deadline)
        return RUNNING

    def on_running(self) -> Status:
        """Return SUCCESS when the time has passed."""
        return SUCCESS if self.has_passed(self._deadline) else RUNNING

    def on_halted(self) -> None:
        """Cancel the wake-up."""
        self.cancel_wake_up()
