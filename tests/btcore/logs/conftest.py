"""The tree that was recorded with BehaviorTree.CPP, with leaves that behave as in the recording."""

from collections.abc import Callable
from pathlib import Path

import pytest

import btcore
from btcore import Observer, Registry, SimClock, Transition, Tree
from btcore.blackboard.ports import Direction, Port
from btcore.testing import MockAction, Outcomes
from btcore.values import DOUBLE, INT

OUTCOMES = Outcomes(leaves={"AlwaysFailure": "F|S|F", "cnt": "RRS|F", "Count": "RS"})


class Count(MockAction):
    @staticmethod
    def provided_ports() -> list[Port]:
        return [
            Port("out", Direction.OUT, DOUBLE),
            Port("ticks", type=INT, default="2", description="dddddddd"),
        ]


class Collector(Observer):
    """Records the transitions."""

    def __init__(self) -> None:
        self.changes: list[Transition] = []

    def transition(self, change: Transition) -> None:
        self.changes.append(change)


@pytest.fixture
def captures() -> Path:
    """Return the folder of the files that BehaviorTree.CPP wrote."""
    return Path(__file__).parent / "captures"


@pytest.fixture
def sample(recorded_tree: Callable[[str], str]) -> Tree:
    """Build the recorded tree. As in the recording, its AlwaysFailure succeeds the second time."""
    nodes = Registry.standard()
    nodes.add(Count)
    nodes.replace(AlwaysFailure=MockAction)
    source = recorded_tree("""<Script code="loc:='a'"/><Count out="{o2}"/>""")
    return btcore.loads(source, nodes=nodes, resources=[OUTCOMES], clock=SimClock())


@pytest.fixture
def collect() -> Callable[[Tree], list[Transition]]:
    """Return a function that subscribes to a tree and returns the list of its transitions."""

    def subscribe(tree: Tree) -> list[Transition]:
        collector = Collector()
        tree.subscribe(collector)
        return collector.changes

    return subscribe


@pytest.fixture
def small() -> Callable[..., Tree]:
    """Return a function that builds a tree of *body* on a simulated clock."""

    def make(body: str, nodes: Registry | None = None, clock: SimClock | None = None) -> Tree:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
        return btcore.loads(text, nodes=nodes or Registry.standard(), clock=clock or SimClock())

    return make
