"""The same trees in py_trees: the same leaves' work, the same nodes ticked.

BehaviorTree.CPP's Sequence and Fallback remember where they were, which is ``memory=True`` there, and
its reactive ones don't.
"""

from itertools import cycle
from typing import Any

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector, Sequence
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


class IsObstacle(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.looks = cycle(THEIRS[look] for look in OBSTACLE_RESULTS)

    def update(self) -> Status:
        return next(self.looks)


class Back(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.moves = cycle(THEIRS[move] for move in MOVES)

    def update(self) -> Status:
        return next(self.moves)


class Turn(Back):
    pass


class Forward(Behaviour):
    def update(self) -> Status:
        return RUNNING


def succeed(self: Behaviour) -> Status:
    return SUCCESS


def fail(self: Behaviour) -> Status:
    return FAILURE


LEAVES: dict[str, dict[str, Any]] = {
    "class": {
        "succeed": Succeed,
        "fail": Fail,
        "is_obstacle": IsObstacle,
        "back": Back,
        "turn": Turn,
        "forward": Forward,
    },
    "function": {
        "succeed": create_behaviour_from_function(succeed),
        "fail": create_behaviour_from_function(fail),
    },
    "built-in": {
        "succeed": py_trees.behaviours.Success,
        "fail": py_trees.behaviours.Failure,
    },
}
CONTROLS: dict[str, Any] = {
    "Sequence": lambda children: Sequence("Sequence", memory=True, children=children),
    "Fallback": lambda children: Selector("Fallback", memory=True, children=children),
    "ReactiveSequence": lambda children: Sequence("ReactiveSequence", memory=False, children=children),
    "ReactiveFallback": lambda children: Selector("ReactiveFallback", memory=False, children=children),
    "Inverter": lambda children: Inverter("Inverter", *children),
}


def grow(shape: Shape, kind: str) -> Behaviour:
    """*shape* as a tree of py_trees."""
    if isinstance(shape, str):
        leaf: Behaviour = LEAVES[kind][shape](name=shape)
        return leaf
    made: Behaviour = CONTROLS[shape.tag]([grow(child, kind) for child in shape.children])
    return made
