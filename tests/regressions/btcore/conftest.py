"""Fixtures of the engine's regression tests: trees of mock leaves on simulated time."""

from typing import Any

import pytest

import btcore
from btcore import Blackboard, Registry, SimClock, Tree
from tests.conformance.recorded_cases import CallLog, conformance_registry


class TreeFactory:
    """Builds trees of mock leaves and other nodes; ``journal`` records the calls of the leaves."""

    def __init__(self) -> None:
        self.journal = CallLog()

    def __call__(
        self,
        body: str,
        *leaves: Any,
        others: str = "",
        format: int = 4,
        nodes: Registry | None = None,
        blackboard: Blackboard | None = None,
    ) -> Tree:
        """Return a tree with *body* in its main tree, and with the further trees *others*."""
        registry = nodes if nodes is not None else conformance_registry()
        registry.add(*leaves)
        return btcore.loads(
            f'<root BTCPP_format="{format}" main_tree_to_execute="Main">\n'
            f'<BehaviorTree ID="Main">{body}</BehaviorTree>{others}</root>',
            nodes=registry,
            resources=[self.journal],
            blackboard=blackboard,
            clock=SimClock(),
        )


@pytest.fixture
def make_tree() -> TreeFactory:
    return TreeFactory()
