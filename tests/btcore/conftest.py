"""Fixtures of the engine's tests: simulated time, the calls of mock leaves, trees, documents."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

import btcore
from btcore import Blackboard, Registry, SimClock, Tree
from tests.conformance.recorded_cases import CallLog, conformance_registry


class TreeFactory:
    """Builds trees of mock leaves and other nodes, on one clock and with one log of calls."""

    def __init__(self, clock: SimClock, calls: CallLog) -> None:
        self.clock = clock
        self.calls = calls

    def __call__(
        self,
        body: str,
        *leaves: Any,
        nodes: Registry | None = None,
        resources: Sequence[object] = (),
        blackboard: Blackboard | None = None,
        format: int = 4,
        others: str = "",
    ) -> Tree:
        """Return a tree with *body* as the content of its main tree and *others* as further definitions."""
        registry = nodes if nodes is not None else conformance_registry()
        registry.add(*leaves)
        return btcore.loads(
            f'<root main_tree_to_execute="Main"><BehaviorTree ID="Main">{body}</BehaviorTree>{others}</root>',
            nodes=registry,
            resources=[self.calls, *resources],
            blackboard=blackboard,
            format=format,
            clock=self.clock,
        )


@pytest.fixture
def clock() -> SimClock:
    return SimClock()


@pytest.fixture
def calls() -> CallLog:
    return CallLog()


@pytest.fixture
def make_tree(clock: SimClock, calls: CallLog) -> TreeFactory:
    return TreeFactory(clock, calls)


@pytest.fixture
def document() -> Callable[..., str]:
    """Return a function that returns a document; *root* contains the attributes of its root element."""

    def write(
        body: str,
        others: Mapping[str, str] | str = "",
        root: str = 'BTCPP_format="4" main_tree_to_execute="Main"',
    ) -> str:
        if not isinstance(others, str):
            lines = [
                f'  <BehaviorTree ID="{id}">{content}</BehaviorTree>\n' for id, content in others.items()
            ]
            others = "".join(lines)
        return f'<root {root}>\n  <BehaviorTree ID="Main">\n    {body}\n  </BehaviorTree>\n{others}</root>\n'

    return write
