"""What the regressions of the engine share: trees of planned leaves on simulated time."""

from typing import Any

import pytest

import btcore
from btcore import Blackboard, Registry, SimClock, Tree
from btcore.testing.conformance import conformance_registry
from btcore.testing.plan_leaves import CallLog


class Grower:
    """Makes trees out of the planned leaves and others; their calls stand in ``journal``."""

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
        """The tree with *body* as its main tree's element, and *others* beside it."""
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
def grow() -> Grower:
    return Grower()
