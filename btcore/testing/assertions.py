"""Assertions about the events in a tree.

A failed assertion raises AssertionError, whose message shows the last ticks and the tree. Nodes are
identified by path or, if it is unique, by name.
"""

from collections.abc import Iterable, Sequence
from typing import NoReturn

from btcore.status import IDLE, RUNNING, SKIPPED, Status
from btcore.suggestions import counted
from btcore.testing.harness import Harness
from btcore.testing.trace import Trace, TraceStep, format_trace, format_tree

__tracebackhide__ = True  # pytest shows the test instead of the functions of this module


def assert_ran(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that each of *nodes* ran: at least one of its ticks was not SKIPPED.

    Args:
        trace: The trace, or the harness that records it.
        nodes: The nodes, by path or unique name.

    Raises:
        AssertionError: One of the nodes never ran.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_ran
        >>> b = btcore.Builder()
        >>> harness = Harness.loads(b.xml(b.AlwaysSuccess(name="door")))
        >>> _ = harness.run()
        >>> assert_ran(harness, "door")
    """
    trace = _catch_up(trace)
    for node in nodes:
        if not _find_runs(trace, node):
            _fail(trace, f"'{node}' never ran in {_format_tick_count(trace)}")


def assert_never_ran(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that none of *nodes* ran: they were not ticked, or all ticks were SKIPPED.

    Args:
        trace: The trace, or the harness that records it.
        nodes: The nodes, by path or unique name.

    Raises:
        AssertionError: One of the nodes ran.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_never_ran
        >>> b = btcore.Builder()
        >>> main = b.Fallback(b.AlwaysSuccess(name="door"), b.AlwaysSuccess(name="window"))
        >>> harness = Harness.loads(b.xml(main))
        >>> _ = harness.run()
        >>> assert_never_ran(harness, "window")
    """
    trace = _catch_up(trace)
    for node in nodes:
        if steps := _find_runs(trace, node):
            _fail(trace, f"'{node}' ran, first in tick {steps[0].tick}", steps[0])


def assert_order(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that *nodes* ran, and that their first starts were in this order.

    Args:
        trace: The trace, or the harness that records it.
        nodes: The nodes, by path or unique name, in the expected order.

    Raises:
        AssertionError: A node never ran, or the first starts were in another order.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_order
        >>> b = btcore.Builder()
        >>> main = b.Sequence(b.AlwaysSuccess(name="door"), b.AlwaysSuccess(name="window"))
        >>> harness = Harness.loads(b.xml(main))
        >>> _ = harness.run()
        >>> assert_order(harness, "door", "window")
    """
    trace = _catch_up(trace)
    paths = [trace.path(node) for node in nodes]
    starts = (change.path for step in trace for change in step.changes if change.previous is IDLE)
    started = [path for path in dict.fromkeys(starts) if path in paths]
    for path in paths:
        if path not in started:
            _fail(trace, f"'{path}' never ran in {_format_tick_count(trace)}")
    if started != paths:
        _fail(trace, f"the nodes started in the order {_join(started)}, not {_join(paths)}")


def assert_results(trace: Trace | Harness, node: str, results: Iterable[Status]) -> None:
    """Assert that the ticks of a node returned exactly the expected results.

    Args:
        trace: The trace, or the harness that records it.
        node: The node, by path or unique name.
        results: The expected results of all ticks of the node, in order. If the node is ticked several times
            within a tick of the root, these results are in the order FAILURE, SUCCESS, SKIPPED, RUNNING.

    Raises:
        AssertionError: The node returned other results.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore import SUCCESS
        >>> from btcore.testing import Harness, assert_results
        >>> b = btcore.Builder()
        >>> harness = Harness.loads(b.xml(b.AlwaysSuccess(name="wait")))
        >>> _ = harness.run()
        >>> assert_results(harness, "wait", [SUCCESS])
    """
    trace = _catch_up(trace)
    expected, actual = list(results), trace.results(node)
    if expected != actual:
        _fail(trace, f"'{node}' returned {_join(actual)}, not {_join(expected)}")


def assert_halted(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that each of *nodes* was halted at least once while it was RUNNING.

    Args:
        trace: The trace, or the harness that records it.
        nodes: The nodes, by path or unique name.

    Raises:
        AssertionError: One of the nodes was never halted while it was RUNNING.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_halted
        >>> b = btcore.Builder()
        >>> harness = Harness.loads(b.xml(b.Timeout(b.Sleep(msec=900, name="drive"), msec=100)))
        >>> _ = harness.run()
        >>> assert_halted(harness, "drive")
    """
    trace = _catch_up(trace)
    for node in nodes:
        path = trace.path(node)
        if not any(path in step.halted for step in trace):
            _fail(trace, f"'{node}' was never halted in {_format_tick_count(trace)}")


def assert_never_running_together(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that at the end of each tick at most one of *nodes* was RUNNING.

    Args:
        trace: The trace, or the harness that records it.
        nodes: The nodes, by path or unique name.

    Raises:
        AssertionError: Several of the nodes were RUNNING at the end of a tick.
        BtcoreError: The tree has no such node, or several nodes have this name.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_never_running_together
        >>> b = btcore.Builder()
        >>> harness = Harness.loads(b.xml(b.Sequence(b.Sleep(msec=9, name="a"), b.Sleep(msec=9, name="b"))))
        >>> _ = harness.run()
        >>> assert_never_running_together(harness, "a", "b")
    """
    trace = _catch_up(trace)
    paths = {trace.path(node): node for node in nodes}
    for step in trace:
        running = [node for path, node in paths.items() if step.statuses[path] is RUNNING]
        if len(running) > 1:
            _fail(trace, f"{_join(running)} were RUNNING together after tick {step.tick}", step)


def assert_ended(trace: Trace | Harness, status: Status) -> None:
    """Assert that the last tick of the root returned the expected status.

    Args:
        trace: The trace, or the harness that records it.
        status: The expected status; IDLE = the last tick raised an exception.

    Raises:
        AssertionError: The root returned another status, or was never ticked.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness, assert_ended
        >>> b = btcore.Builder()
        >>> harness = Harness.loads(b.xml(b.AlwaysFailure()))
        >>> _ = harness.run()
        >>> assert_ended(harness, btcore.FAILURE)
    """
    trace = _catch_up(trace)
    ticks = [step for step in trace if step.tick]
    if not ticks or ticks[-1].status is not status:
        actual = f"ended with {ticks[-1].status.name}, not {status.name}" if ticks else "was never ticked"
        _fail(trace, f"the tree {actual}")


def _catch_up(source: Trace | Harness) -> Trace:
    trace = source.trace if isinstance(source, Harness) else source
    trace.catch_up()
    return trace


def _find_runs(trace: Trace, node: str) -> list[TraceStep]:
    path = trace.path(node)
    return [step for step in trace if path in step.results and set(step.results[path]) != {SKIPPED}]


def _format_tick_count(trace: Trace) -> str:
    count = sum(1 for step in trace if step.tick)
    return counted(count, "tick")


def _join(items: Sequence[str | Status]) -> str:
    return ", ".join(item.name if isinstance(item, Status) else f"'{item}'" for item in items) or "nothing"


def _fail(trace: Trace, message: str, step: TraceStep | None = None) -> NoReturn:
    events = format_trace(trace) if step is None else f"{step}\n{format_tree(trace.tree, step)}"
    raise AssertionError(f"{message}\n{events}")
