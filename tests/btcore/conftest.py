"""What the engine's tests share: simulated time, a journal of planned leaves, a way to grow a tree."""

from collections.abc import Sequence
from typing import Any

import pytest

import btcore
from btcore import Blackboard, Registry, SimClock, Tree
from btcore.testing.planned import Journal
from btcore.testing.recorded_trees import planned_registry


class Grower:
    """Makes trees of the planned leaves and others, on one clock and with one journal."""

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
        """The tree with *body* as its main tree's element, and *others* beside it."""
        registry = nodes if nodes is not None else planned_registry()
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
def grow(clock: SimClock, journal: Journal) -> Grower:
    return Grower(clock, journal)
