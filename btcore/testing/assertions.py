"""Assertions on what happened in a tree. A failing one shows the tick, what led to it, and the tree.

Nodes are named by path or, where it is the only one, by name.
"""

from collections.abc import Iterable, Sequence
from typing import NoReturn

from btcore.status import IDLE, RUNNING, SKIPPED, Status
from btcore.testing.harness import Harness
from btcore.testing.trace import Trace, TraceStep, format_trace, format_tree


def assert_ran(trace: Trace | Harness, *nodes: str) -> None:
    """Each of *nodes* was ticked, and not only skipped."""
    trace = _trace(trace)
    for node in nodes:
        if not _ran(trace, node):
            _fail(trace, f"'{node}' never ran in {_ticks(trace)}")


def assert_never_ran(trace: Trace | Harness, *nodes: str) -> None:
    """None of *nodes* was ticked, other than being skipped."""
    trace = _trace(trace)
    for node in nodes:
        steps = _ran(trace, node)
        if steps:
            _fail(trace, f"'{node}' ran, first in tick {steps[0].tick}", steps[0])


def assert_order(trace: Trace | Harness, *nodes: str) -> None:
    """Each of *nodes* ran, and began for the first time after the one before it."""
    trace = _trace(trace)
    paths = [trace.path(node) for node in nodes]
    begun: list[str] = []
    for step in trace:
        begun += (
            change.path
            for change in step.changes
            if change.previous is IDLE and change.path in paths and change.path not in begun
        )
    for path in paths:
        if path not in begun:
            _fail(trace, f"'{path}' never ran in {_ticks(trace)}")
    if begun != paths:
        _fail(trace, f"expected to begin in the order {_list(paths)}, but it was {_list(begun)}")


def assert_results(trace: Trace | Harness, node: str, results: Iterable[Status]) -> None:
    """The ticks of *node* gave *results*, no more and no less."""
    trace = _trace(trace)
    wanted, found = list(results), trace.results(node)
    if wanted != found:
        _fail(trace, f"'{node}' gave {_list(found)}, not {_list(wanted)}")


def assert_halted(trace: Trace | Harness, *nodes: str) -> None:
    """Each of *nodes* was halted while it ran."""
    trace = _trace(trace)
    for node in nodes:
        path = trace.path(node)
        if not any(path in step.halted for step in trace):
            _fail(trace, f"'{node}' was never halted in {_ticks(trace)}")


def assert_never_running_together(trace: Trace | Harness, *nodes: str) -> None:
    """At the end of no tick were two of *nodes* RUNNING."""
    trace = _trace(trace)
    paths = {trace.path(node): node for node in nodes}
    for step in trace:
        running = [node for path, node in paths.items() if step.statuses[path] is RUNNING]
        if len(running) > 1:
            _fail(trace, f"{_list(running)} were RUNNING together after tick {step.tick}", step)


def assert_ended(trace: Trace | Harness, status: Status) -> None:
    """The last tick of the root gave *status*."""
    trace = _trace(trace)
    ticks = [step for step in trace if step.tick]
    if not ticks or ticks[-1].status is not status:
        was = ticks[-1].status.name if ticks else "it was never ticked"
        _fail(trace, f"the tree was to end {status.name}, but: {was}")


def _trace(given: Trace | Harness) -> Trace:
    trace = given.trace if isinstance(given, Harness) else given
    trace.catch_up()
    return trace


def _ran(trace: Trace, node: str) -> list[TraceStep]:
    path = trace.path(node)
    return [step for step in trace if path in step.results and set(step.results[path]) != {SKIPPED}]


def _ticks(trace: Trace) -> str:
    count = sum(1 for step in trace if step.tick)
    return f"{count} tick{'' if count == 1 else 's'}"


def _list(words: Sequence[str | Status]) -> str:
    return ", ".join(one.name if isinstance(one, Status) else f"'{one}'" for one in words) or "nothing"


def _fail(trace: Trace, said: str, step: TraceStep | None = None) -> NoReturn:
    __tracebackhide__ = True
    shown = format_trace(trace) if step is None else f"{step}\n{format_tree(trace.tree, step)}"
    raise AssertionError(f"{said}\n{shown}")
