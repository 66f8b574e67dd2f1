"""Fixtures of the engine's tests: simulated time, a journal of the calls of mock leaves, trees, documents."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

import btcore
from btcore import Blackboard, Registry, SimClock, Tree
from tests.conformance.recorded_cases import Journal, conformance_registry

MakeTree = Callable[..., Tree]


class TreeFactory:
    """Builds trees of mock leaves and other nodes, on one clock and with one journal."""

    def __init__(self, clock: SimClock, journal: Journal) -> None:
        self.clock = clock
        self.journal = journal

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
            resources=[self.journal, *resources],
            blackboard=blackboard,
            format=format,
            clock=self.clock,
        )


@pytest.fixture
def clock() -> SimClock:
    return SimClock()


@pytest.fixture
def journal() -> Journal:
    return Journal()


@pytest.fixture
def make_tree(clock: SimClock, journal: Journal) -> TreeFactory:
    return TreeFactory(clock, journal)


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
