"""A pytest plugin with fixtures for tests of trees; the report of a failed test shows the trees' last steps.

pytest loads the plugin automatically if btcore is installed. All names begin with `btcore_`, because the
tests of other projects have fixtures such as `clock` and `trace` of their own. The plugin does not import
hypothesis: the strategies themselves make hypothesis print the tree of a failing example.
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


class _Hooks:
    """The hooks that other plugins may implement."""

    def pytest_btcore_tree(self, request: pytest.FixtureRequest, tree: Tree) -> None:
        """Prepare a tree that a fixture has created, or has got from the test."""


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Declare the hooks of this plugin."""
    pluginmanager.add_hookspecs(_Hooks)


@pytest.fixture
def btcore_registry() -> Registry:
    """Return a new `Registry.standard()`, to which the test adds its nodes."""
    return Registry.standard()


@pytest.fixture
def btcore_clock() -> SimClock:
    """Return a simulated clock that starts at 0."""
    return SimClock()


@pytest.fixture
def btcore_trace(request: pytest.FixtureRequest) -> Callable[[Tree], Trace]:
    """Return a function that records the events of a tree; the report of a failed test shows them."""
    return lambda tree: _add_to_report(request, Trace(tree))


@pytest.fixture
def btcore_harness(
    request: pytest.FixtureRequest, btcore_registry: Registry, btcore_clock: SimClock
) -> Callable[..., Harness]:
    """Return a function `btcore_harness(source, **options)` that creates a Harness.

    *source* is a text that begins with `<` (XML), the path of a file, or a Tree. A text or a file is loaded
    with the fixtures `btcore_registry` and `btcore_clock`, and with *options*, the keyword arguments of
    `btcore.load`, or `providers` and `settings` as in `Harness.load`. The report of a failed test shows the
    last steps.
    """

    def make(source: Tree | str | Path, **options: Any) -> Harness:
        if isinstance(source, Tree):
            harness = Harness(source)
        else:
            options = {"nodes": btcore_registry, "clock": btcore_clock, **options}
            text = isinstance(source, str) and source.lstrip().startswith("<")
            harness = Harness.loads(str(source), **options) if text else Harness.load(source, **options)
        _add_to_report(request, harness.trace)
        request.addfinalizer(harness.close)
        return harness

    return make


def _add_to_report(request: pytest.FixtureRequest, trace: Trace) -> Trace:
    request.node.stash.setdefault(_TRACES, []).append(trace)
    request.config.hook.pytest_btcore_tree(request=request, tree=trace.tree)
    return trace


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: "pytest.CallInfo[None]"
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the last steps of the recorded trees to the report of a failed test."""
    report = yield  # the report of the other plugins, which is extended here
    if report.when == "call" and report.failed:
        for trace in item.stash.get(_TRACES, []):
            report.sections.append((f"btcore: tree '{trace.tree.id}'", format_trace(trace)))
    return report
