"""A pytest plugin: fixtures for tests of trees, whose last steps are shown in the report of a failed test.

pytest loads the plugin automatically if btcore is installed. The plugin does not import hypothesis, which
prints the tree of a failing property itself.
"""

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from btcore.clock import SimClock
from btcore.registry.registry import Registry
from btcore.testing.harness import Harness
from btcore.testing.trace import Trace, format_trace
from btcore.tree.tree import Tree

_TRACES = pytest.StashKey[list[Trace]]()


@pytest.fixture
def registry() -> Registry:
    """Return a new ``Registry.standard()``, to which the test adds its nodes."""
    return Registry.standard()


@pytest.fixture
def clock() -> SimClock:
    """Return a simulated clock that starts at 0."""
    return SimClock()


@pytest.fixture
def trace(request: pytest.FixtureRequest) -> Callable[[Tree], Trace]:
    """Return a function that records the events of a tree, for the report of a failed test."""
    return lambda tree: _add_to_report(request, Trace(tree))


@pytest.fixture
def harness(request: pytest.FixtureRequest, registry: Registry, clock: SimClock) -> Callable[..., Harness]:
    """Return a function that creates a harness for XML text, which begins with ``<``, a file or a Tree.

    The tree is loaded with the fixtures ``registry`` and ``clock``, and the options of ``btcore.load``. The
    report of a failed test shows the last steps.
    """

    def make(source: Tree | str | Path, **options: Any) -> Harness:
        if isinstance(source, Tree):
            harness = Harness(source)
        else:
            options = {"nodes": registry, "clock": clock, **options}
            text = isinstance(source, str) and source.lstrip().startswith("<")
            harness = Harness.loads(str(source), **options) if text else Harness.load(source, **options)
        _add_to_report(request, harness.trace)
        return harness

    return make


def _add_to_report(request: pytest.FixtureRequest, trace: Trace) -> Trace:
    request.node.stash.setdefault(_TRACES, []).append(trace)
    return trace


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: "pytest.CallInfo[None]"
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the last steps of the trees of a failed test to its report."""
    report = yield  # the report of the other plugins, which is extended here
    if report.when == "call" and report.failed:
        for trace in item.stash.get(_TRACES, []):
            report.sections.append((f"btcore: tree '{trace.tree.id}'", format_trace(trace)))
    return report
