"""Parallels: every child is ticked in each tick."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.errors import NodeError
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
)
from btcore.values import INT


def threshold(given: int, count: int) -> int:
    """*given* as a number of *count* children: −1 is all, −2 all but one; never below 0."""
    return max(count + given + 1, 0) if given < 0 else given


@mypyc_attr(allow_interpreted_subclasses=True)
class Parallel(ControlNode):
    """Ticks all its children, and ends when enough of them succeeded or failed.

    A completed child isn't ticked again until the node ends; skipped ones are ticked anew. It
    succeeds with `success_count` successes, and fails with `failure_count` failures or when the
    successes can't be reached any more; then running children are halted. Negative counts are from
    the end: −1 = all. With a negative `success_count` skipped children count as successes. More
    than there are children is an error.
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
        """The ports."""
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
                description="failures that end it",
                role=PortRole.FAILURES,
            ),
        ]

    def prepare(self) -> None:
        """Nothing is completed."""
        self.forget()

    def forget(self) -> None:
        """Nothing is completed."""
        self._completed = set()
        self._successes = 0
        self._failures = 0

    def tick(self) -> Status:
        """Tick the children that haven't completed."""
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
        """Halt the children; nothing is completed."""
        self.forget()
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class ParallelAll(ControlNode):
    """Ticks all its children until each has completed, and never halts one.

    FAILURE with `max_failures` failures or more, else SUCCESS; all skipped: SKIPPED. A negative
    `max_failures` is from the end: −1 = all. More than there are children is an error.
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
        """The ports."""
        about = "failures that make it fail"
        return [Port("max_failures", type=INT, default="1", description=about, role=PortRole.FAILURES)]

    def prepare(self) -> None:
        """Nothing is completed."""
        self._completed = set()
        self._failures = 0

    def tick(self) -> Status:
        """Tick the children that haven't completed."""
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
        """Halt the children; nothing is completed."""
        self._completed = set()
        self._failures = 0
        self.reset_children()
        self.reset_status()
