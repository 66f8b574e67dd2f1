"""Assertions about the events in a tree.

A failed assertion raises AssertionError, whose message shows the last ticks and the tree. Nodes are
identified by path or, if it is unique, by name.
"""

from collections.abc import Iterable, Sequence
from typing import NoReturn

from btcore.status import IDLE, RUNNING, SKIPPED, Status
from btcore.testing.harness import Harness
from btcore.testing.trace import Trace, TraceStep, format_trace, format_tree


def assert_ran(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that each of *nodes* ran: at least one of its ticks was not SKIPPED."""
    trace = _trace(trace)
    for node in nodes:
        if not _ran(trace, node):
            _fail(trace, f"'{node}' never ran in {_ticks(trace)}")


def assert_never_ran(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that none of *nodes* ran: they were not ticked, or all ticks were SKIPPED."""
    trace = _trace(trace)
    for node in nodes:
        if steps := _ran(trace, node):
            _fail(trace, f"'{node}' ran, first in tick {steps[0].tick}", steps[0])


def assert_order(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that *nodes* ran, and that they started for the first time in this order."""
    trace = _trace(trace)
    paths = [trace.path(node) for node in nodes]
    starts = (change.path for step in trace for change in step.changes if change.previous is IDLE)
    started = [path for path in dict.fromkeys(starts) if path in paths]
    for path in paths:
        if path not in started:
            _fail(trace, f"'{path}' never ran in {_ticks(trace)}")
    if started != paths:
        _fail(trace, f"the nodes started in the order {_list(started)}, not {_list(paths)}")


def assert_results(trace: Trace | Harness, node: str, results: Iterable[Status]) -> None:
    """Assert that the ticks of *node* returned exactly *results*, in this order."""
    trace = _trace(trace)
    expected, actual = list(results), trace.results(node)
    if expected != actual:
        _fail(trace, f"'{node}' returned {_list(actual)}, not {_list(expected)}")


def assert_halted(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that each of *nodes* was halted at least once while it was RUNNING."""
    trace = _trace(trace)
    for node in nodes:
        path = trace.path(node)
        if not any(path in step.halted for step in trace):
            _fail(trace, f"'{node}' was never halted in {_ticks(trace)}")


def assert_never_running_together(trace: Trace | Harness, *nodes: str) -> None:
    """Assert that at the end of each tick at most one of *nodes* was RUNNING."""
    trace = _trace(trace)
    paths = {trace.path(node): node for node in nodes}
    for step in trace:
        running = [node for path, node in paths.items() if step.statuses[path] is RUNNING]
        if len(running) > 1:
            _fail(trace, f"{_list(running)} were RUNNING together after tick {step.tick}", step)


def assert_ended(trace: Trace | Harness, status: Status) -> None:
    """Assert that the last tick of the root returned *status*."""
    trace = _trace(trace)
    ticks = [step for step in trace if step.tick]
    if not ticks or ticks[-1].status is not status:
        actual = f"ended with {ticks[-1].status.name}, not {status.name}" if ticks else "was never ticked"
        _fail(trace, f"the tree {actual}")


def _trace(source: Trace | Harness) -> Trace:
    trace = source.trace if isinstance(source, Harness) else source
    trace.catch_up()
    return trace


def _ran(trace: Trace, node: str) -> list[TraceStep]:
    path = trace.path(node)
    return [step for step in trace if path in step.results and set(step.results[path]) != {SKIPPED}]


def _ticks(trace: Trace) -> str:
    count = sum(1 for step in trace if step.tick)
    return f"{count} tick{'' if count == 1 else 's'}"


def _list(items: Sequence[str | Status]) -> str:
    return ", ".join(item.name if isinstance(item, Status) else f"'{item}'" for item in items) or "nothing"


def _fail(trace: Trace, message: str, step: TraceStep | None = None) -> NoReturn:
    __tracebackhide__ = True  # pytest shows the test instead of this function
    events = format_trace(trace) if step is None else f"{step}\n{format_tree(trace.tree, step)}"
    raise AssertionError(f"{message}\n{events}")
