"""The counterparts in py_trees of the measured trees and leaves, which do the same work.

BehaviorTree.CPP's Sequence and Fallback continue with the child that was RUNNING, which is ``memory=True`` in
py_trees; the reactive control nodes start from the first child.
"""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import py_trees
from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Access, Status
from py_trees.decorators import Inverter
from py_trees.meta import create_behaviour_from_function

from btcore import Status as Ours
from measure.benchmark_trees import MOVES, OBSTACLE_RESULTS, Shape

SUCCESS, FAILURE, RUNNING = Status.SUCCESS, Status.FAILURE, Status.RUNNING
THEIRS = {Ours.SUCCESS: SUCCESS, Ours.FAILURE: FAILURE, Ours.RUNNING: RUNNING}


class Succeed(Behaviour):
    def update(self) -> Status:
        return SUCCESS


class Fail(Behaviour):
    def update(self) -> Status:
        return FAILURE


class Forward(Behaviour):
    def update(self) -> Status:
        return RUNNING


class Repeat(Behaviour):
    """Returns `results` one after the other, and starts again after the last result."""

    results: Sequence[Ours]

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.statuses = cycle(THEIRS[result] for result in self.results)

    def update(self) -> Status:
        return next(self.statuses)


class IsObstacle(Repeat):
    results = OBSTACLE_RESULTS


class Back(Repeat):
    results = MOVES


class Turn(Repeat):
    results = MOVES


def succeed(self: Behaviour) -> Status:
    return SUCCESS


def fail(self: Behaviour) -> Status:
    return FAILURE


LEAVES: dict[str, dict[str, Any]] = {
    "class": {cls.__name__: cls for cls in (Succeed, Fail, IsObstacle, Back, Turn, Forward)},
    "function": {
        "Succeed": create_behaviour_from_function(succeed),
        "Fail": create_behaviour_from_function(fail),
    },
    "built-in": {"Succeed": py_trees.behaviours.Success, "Fail": py_trees.behaviours.Failure},
}
CONTROLS: dict[str, tuple[type[composites.Composite], bool]] = {
    "Sequence": (composites.Sequence, True),
    "Fallback": (composites.Selector, True),
    "ReactiveSequence": (composites.Sequence, False),
    "ReactiveFallback": (composites.Selector, False),
}
"""The class in py_trees and its argument ``memory``, by the tag of the control node."""


def create_tree(shape: Shape, kind: str) -> Behaviour:
    """Return *shape* as a tree of py_trees, with leaves of *kind*."""
    if isinstance(shape, str):
        leaf: Behaviour = LEAVES[kind][shape](name=shape)
        return leaf
    children = [create_tree(child, kind) for child in shape.children]
    if shape.tag == "Inverter":
        return Inverter("Inverter", *children)
    cls, memory = CONTROLS[shape.tag]
    return cls(shape.tag, memory=memory, children=children)


# --- leaves that read and write the blackboard


class Reads(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.board = self.attach_blackboard_client()
        self.board.register_key("pace", access=Access.READ)

    def update(self) -> Status:
        self.board.pace  # noqa: B018 - the access is the work
        return SUCCESS


class Writes(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.board = self.attach_blackboard_client()
        self.board.register_key("far", access=Access.WRITE)

    def update(self) -> Status:
        self.board.far = 0.5
        return SUCCESS


def row_of(leaf: type[Behaviour], width: int) -> Behaviour:
    """Return a Sequence of *width* leaves *leaf*, after writing the entry that `Reads` reads."""
    board = py_trees.blackboard.Client(name="setup")
    board.register_key("pace", access=Access.WRITE)
    board.pace = 0.5
    return composites.Sequence("wide", memory=True, children=[leaf(f"{number}") for number in range(width)])
