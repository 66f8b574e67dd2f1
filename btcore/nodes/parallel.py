"""Parallels: in every tick they tick all children that have not completed."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.values import INT


def threshold(given: int, count: int) -> int:
    """Return the number of children that *given*, the value of a port, means.

    Args:
        given: A number of children; −1 = all, −2 = all except one, and so on, but at least 0.
        count: The number of all children.
    """
    return max(count + given + 1, 0) if given < 0 else given


def required_results(given: int, count: int, results: str) -> int:
    """Return `threshold`, after a check that it can be reached.

    Args:
        given: The value of a port.
        count: The number of children.
        results: "successes" or "failures", for the error message.

    Raises:
        NodeError: The threshold is greater than *count*.
    """
    number = threshold(given, count)
    if count < number:
        raise NodeError(f"{count} children can never give {number} {results}")
    return number


def success_port(name: str, default: str | None = None) -> Port:
    """Return a port for a number of successes."""
    about = "successes needed, −1 = all"
    return Port(name, type=INT, default=default, description=about, role=PortRole.SUCCESSES)


def failure_port(name: str) -> Port:
    """Return a port for a number of failures."""
    about = "failures that make the node fail, −1 = all"
    return Port(name, type=INT, default="1", description=about, role=PortRole.FAILURES)


@mypyc_attr(allow_interpreted_subclasses=True)
class ParallelNode(ControlNode):
    """The base class of parallels, which remember the children that have completed."""

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="⇉", state_fields=("_completed", "_successes", "_failures"), skips_alone=False
    )

    _completed: set[int]
    _successes: int = 0
    _failures: int = 0

    def prepare(self) -> None:
        """Forget the children that have completed."""
        self.forget()

    def forget(self) -> None:
        """Forget the children that have completed."""
        self._completed = set()
        self._successes = 0
        self._failures = 0

    def finish(self, status: Status) -> Status:
        """Reset the children, and return *status*."""
        self.forget()
        self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children, and forget which of them have completed."""
        self.forget()
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class Parallel(ParallelNode):
    """Ticks all its children in every tick, and ends when enough of them have succeeded or failed.

    A completed child is not ticked again until the node ends; a SKIPPED child is ticked again. After each
    child the results are counted: the node succeeds after `success_count` successes. It fails after exactly
    `failure_count` failures, or when `success_count` can no longer be reached. The following children are
    then not ticked, and RUNNING children are halted. If all children are skipped in a tick, the node is
    SKIPPED; otherwise it is RUNNING. With a negative `success_count`, children that are skipped in this tick
    count as successes, so that the node succeeds if all children are skipped. A negative count −n means the
    number of children + 1 − n, at least 0: −1 = all, −2 = all except one. A count above the number of
    children is an error.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [success_port("success_count", "-1"), failure_port("failure_count")]

    def tick(self) -> Status:
        """Tick the children that have not completed."""
        count = len(self._children)
        success_count = cast(int, self.get_input("success_count"))
        failure_count = cast(int, self.get_input("failure_count"))
        success_limit = required_results(success_count, count, "successes")
        failure_limit = required_results(failure_count, count, "failures")
        set_status(self, RUNNING)
        # Only the skips of this tick count: a skipped child is ticked again, and may complete.
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
                    raise self.idle_child_error(index)
            if self._successes >= success_limit or (
                success_count < 0 and self._successes + skipped >= success_limit
            ):
                return self.finish(SUCCESS)
            # Not ">=", as in BehaviorTree.CPP: if a later tick reads a lower limit, it is missed.
            if count - self._failures < success_limit or self._failures == failure_limit:
                return self.finish(FAILURE)
        return SKIPPED if skipped == count else RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class ParallelAll(ParallelNode):
    """Ticks all its children until every child has completed or is SKIPPED.

    A completed child is not ticked again, and no RUNNING child is halted early. The node fails if at least
    `max_failures` children failed, else it succeeds. If all children are skipped in a tick, the node is
    SKIPPED. A negative `max_failures` −n means the number of children + 1 − n: −1 = all. A value
    above the number of children is an error.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [failure_port("max_failures")]

    def tick(self) -> Status:
        """Tick the children that have not completed."""
        count = len(self._children)
        failure_limit = required_results(cast(int, self.get_input("max_failures")), count, "failures")
        set_status(self, RUNNING)
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
                raise self.idle_child_error(index)
        if skipped == count:
            return SKIPPED
        # A child that is skipped in the tick in which the last child completes is not waited for.
        if skipped + len(self._completed) < count:
            return RUNNING
        return self.finish(FAILURE if self._failures >= failure_limit else SUCCESS)
