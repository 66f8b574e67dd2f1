"""Parallels: in every tick they tick all children that have not completed."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.errors import NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.values import INT


def threshold(given: int, count: int) -> int:
    """Return *given* as a number of *count* children: −1 = all, −2 = all except one; never below 0."""
    return max(count + given + 1, 0) if given < 0 else given


@mypyc_attr(allow_interpreted_subclasses=True)
class Parallel(ControlNode):
    """Ticks all its children in every tick, and ends when enough of them have succeeded or failed.

    A completed child is not ticked again until the node ends; a SKIPPED child is ticked again. The node
    succeeds after `success_count` successes. It fails after `failure_count` failures, or when `success_count`
    can no longer be reached. RUNNING children are then halted. If all children are skipped in a tick, the
    node is SKIPPED; otherwise it is RUNNING. A negative count −n means the number of children + 1 − n:
    −1 = all, −2 = all except one. With a negative `success_count`, skipped children count as
    successes. A count above the number of children is an error.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "⇉"
    skips_alone: ClassVar[bool] = False
    batch_class: ClassVar[str] = "btcore.batch.parallel:Parallel"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_completed", "_successes", "_failures")

    _completed: set[int]
    _successes: int = 0
    _failures: int = 0

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            Port(
                "success_count",
                type=INT,
                default="-1",
                description="successes needed, −1 = all",
                role=PortRole.SUCCESSES,
            ),
            Port(
                "failure_count",
                type=INT,
                default="1",
                description="failures that make the node fail, −1 = all",
                role=PortRole.FAILURES,
            ),
        ]

    def prepare(self) -> None:
        """Forget the children that have completed."""
        self.forget()

    def forget(self) -> None:
        """Forget the children that have completed."""
        self._completed = set()
        self._successes = 0
        self._failures = 0

    def tick(self) -> Status:
        """Tick the children that have not completed."""
        count = len(self._children)
        given = cast(int, self.get_input("success_count"))
        needed = threshold(given, count)
        allowed = threshold(cast(int, self.get_input("failure_count")), count)
        if count < needed:
            raise NodeError(f"{count} children can never give {needed} successes")
        if count < allowed:
            raise NodeError(f"{count} children can never give {allowed} failures")
        self.set_status(RUNNING)
        skipped = 0
        for index, child in enumerate(self._children):
            if index not in self._completed:
                status = execute_tick(child)
                if status is SUCCESS:
                    self._completed.add(index)
                    self._successes += 1
                elif status is FAILURE:
                    self._completed.add(index)
                    self._failures += 1
                elif status is SKIPPED:
                    skipped += 1
                elif status is IDLE:
                    raise self.idle_child(index)
            if self._successes >= needed or (given < 0 and self._successes + skipped >= needed):
                self.forget()
                self.reset_children()
                return SUCCESS
            if count - self._failures < needed or self._failures == allowed:
                self.forget()
                self.reset_children()
                return FAILURE
        return SKIPPED if skipped == count else RUNNING

    def halt(self) -> None:
        """Halt the children, and forget which of them have completed."""
        self.forget()
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class ParallelAll(ControlNode):
    """Ticks all its children until every child has completed or is SKIPPED.

    A completed child is not ticked again, and no RUNNING child is halted early. The node fails if at least
    `max_failures` children failed, else it succeeds. If all children are skipped in a tick, the node is
    SKIPPED. A negative `max_failures` −n means the number of children + 1 − n: −1 = all. A value
    above the number of children is an error.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "⇉"
    skips_alone: ClassVar[bool] = False
    batch_class: ClassVar[str] = "btcore.batch.parallel:ParallelAll"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_completed", "_failures")

    _completed: set[int]
    _failures: int = 0

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "failures that make the node fail, −1 = all"
        return [Port("max_failures", type=INT, default="1", description=about, role=PortRole.FAILURES)]

    def prepare(self) -> None:
        """Forget the children that have completed."""
        self._completed = set()
        self._failures = 0

    def tick(self) -> Status:
        """Tick the children that have not completed."""
        count = len(self._children)
        allowed = threshold(cast(int, self.get_input("max_failures")), count)
        if count < allowed:
            raise NodeError(f"{count} children can never give {allowed} failures")
        self.set_status(RUNNING)
        skipped = 0
        for index in range(count):
            if index in self._completed:
                continue
            status = execute_tick(self._children[index])
            if status is SUCCESS:
                self._completed.add(index)
            elif status is FAILURE:
                self._completed.add(index)
                self._failures += 1
            elif status is SKIPPED:
                skipped += 1
            elif status is IDLE:
                raise self.idle_child(index)
        if skipped == count:
            return SKIPPED
        if skipped + len(self._completed) < count:
            return RUNNING
        failed = self._failures >= allowed
        self._completed = set()
        self._failures = 0
        self.reset_children()
        return FAILURE if failed else SUCCESS

    def halt(self) -> None:
        """Halt the children, and forget which of them have completed."""
        self._completed = set()
        self._failures = 0
        self.reset_children()
        self.reset_status()
