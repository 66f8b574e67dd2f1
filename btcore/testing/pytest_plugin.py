"""A pytest plugin: fixtures for tests of trees, and the story of the tree in the report of a failing one.

pytest loads it by itself where btcore is installed. It never imports hypothesis: a property that draws
from btcore.testing.trees prints the tree that it shrank to by itself.
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
    """A new ``Registry.standard()``: add your nodes."""
    return Registry.standard()


@pytest.fixture
def clock() -> SimClock:
    """A simulated clock, at 0."""
    return SimClock()


@pytest.fixture
def trace(request: pytest.FixtureRequest) -> Callable[[Tree], Trace]:
    """Follows the tree that it is given; if the test fails, the report shows the last steps."""

    def follow(tree: Tree) -> Trace:
        return _shown(request, Trace(tree))

    return follow


@pytest.fixture
def harness(request: pytest.FixtureRequest, registry: Registry, clock: SimClock) -> Callable[..., Harness]:
    """Makes a harness for a tree: XML text (which begins with ``<``), the path of a file, or a Tree.

    It is loaded with the fixtures ``registry`` and ``clock``, and further options as for ``btcore.load``.
    If the test fails, the report shows the last steps.
    """

    def make(source: Tree | str | Path, **options: Any) -> Harness:
        if isinstance(source, Tree):
            made = Harness(source)
        else:
            options = {"nodes": registry, "clock": clock, **options}
            text = isinstance(source, str) and source.lstrip().startswith("<")
            made = Harness.loads(str(source), **options) if text else Harness.load(source, **options)
        _shown(request, made.trace)
        return made

    return make


def _shown(request: pytest.FixtureRequest, trace: Trace) -> Trace:
    request.node.stash.setdefault(_TRACES, []).append(trace)
    return trace


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: "pytest.CallInfo[None]"
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add what happened in the trees of a failing test to its report."""
    report = yield
    if report.when == "call" and report.failed:
        for one in item.stash.get(_TRACES, []):
            report.sections.append((f"btcore: tree '{one.tree.id}'", format_trace(one)))
    return report
