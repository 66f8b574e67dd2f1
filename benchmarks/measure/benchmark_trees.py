"""The trees that are ticked, described once, and grown for btcore, for py_trees and as a bare loop.

A description is a tag with children, or a leaf's word: ``succeed`` and ``fail`` are leaves that do
nothing but return, and bump-and-go has four of its own.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import cycle

from btcore import Condition, Registry, StatefulAction, Status, SyncAction, action

SUCCESS, FAILURE, RUNNING = Status.SUCCESS, Status.FAILURE, Status.RUNNING
OBSTACLE_RESULTS = (FAILURE,) * 9 + (SUCCESS,)
"""What looking for an obstacle comes to, again and again."""
MOVES = (RUNNING, RUNNING, SUCCESS)
"""What going back, and turning, come to."""


@dataclass(frozen=True, slots=True)
class Branch:
    """A control node or decorator with its children."""

    tag: str
    children: "tuple[Shape, ...]"


Shape = Branch | str


def bump_and_go() -> Shape:
    """The first tree of the book: 8 nodes."""
    bump = Branch("Sequence", ("back", "turn"))
    clear = Branch("Fallback", (Branch("Inverter", ("is_obstacle",)), bump))
    return Branch("ReactiveSequence", (clear, "forward"))


def layered(sequence: str, fallback: str, levels: int, failing: int) -> Shape:
    """*levels* levels of controls in turns: sequences of 3, fallbacks of *failing* leaves and one more."""

    def grow(level: int) -> Shape:
        if level == levels:
            return "succeed"
        below = grow(level + 1)
        if level % 2:
            return Branch(fallback, ("fail",) * failing + (below,))
        return Branch(sequence, (below,) * 3)

    return grow(0)


def wide() -> Shape:
    """A Sequence of 100 leaves."""
    return Branch("Sequence", ("succeed",) * 100)


TREES: dict[str, Callable[[], Shape]] = {
    "bump-and-go": bump_and_go,
    "deep": lambda: layered("Sequence", "Fallback", levels=8, failing=3),
    "reactive": lambda: layered("ReactiveSequence", "ReactiveFallback", levels=9, failing=5),
    "wide": wide,
}


def leaves(shape: Shape) -> Iterator[str]:
    """The leaves of *shape*, in order."""
    if isinstance(shape, str):
        yield shape
    else:
        for child in shape.children:
            yield from leaves(child)


# --- leaves that a user writes, as classes


class Succeed(SyncAction):
    def tick(self) -> Status:
        return SUCCESS


class Fail(SyncAction):
    def tick(self) -> Status:
        return FAILURE


class IsObstacle(Condition):
    def __init__(self) -> None:
        self.looks = cycle(OBSTACLE_RESULTS)

    def tick(self) -> Status:
        return next(self.looks)


class Back(StatefulAction):
    def __init__(self) -> None:
        self.moves = cycle(MOVES)

    def on_start(self) -> Status:
        return next(self.moves)

    def on_running(self) -> Status:
        return next(self.moves)


class Turn(Back):
    pass


class Forward(StatefulAction):
    def on_start(self) -> Status:
        return RUNNING

    def on_running(self) -> Status:
        return RUNNING


# --- and as functions


@action(ID="Succeed")
def succeed() -> bool:
    return True


@action(ID="Fail")
def fail() -> bool:
    return False


CLASSES = {
    "succeed": Succeed,
    "fail": Fail,
    "is_obstacle": IsObstacle,
    "back": Back,
    "turn": Turn,
    "forward": Forward,
}
FUNCTIONS = {"succeed": succeed, "fail": fail}
BUILT_IN = {"succeed": "AlwaysSuccess", "fail": "AlwaysFailure"}
LEAVES: dict[str, Mapping[str, object]] = {"class": CLASSES, "function": FUNCTIONS, "built-in": BUILT_IN}
KINDS = tuple(LEAVES)
"""Who wrote the leaves, and how: users in Python, as classes or as functions, or the engine."""


def kinds_of(shape: Shape) -> list[str]:
    """The kinds of leaves that *shape* can be grown with."""
    return [kind for kind in KINDS if set(leaves(shape)) <= LEAVES[kind].keys()]


def registry(kind: str) -> Registry:
    """Nodes with the leaves of *kind*."""
    nodes = Registry.standard()
    if kind == "class":
        nodes.add(*CLASSES.values())
    elif kind == "function":
        nodes.add(*FUNCTIONS.values())
    return nodes


def document(shape: Shape, kind: str) -> str:
    """*shape* as the XML of a tree."""

    def element(one: Shape) -> str:
        if isinstance(one, str):
            return f"<{BUILT_IN[one] if kind == 'built-in' else CLASSES[one].__name__}/>"
        return f"<{one.tag}>{''.join(map(element, one.children))}</{one.tag}>"

    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{element(shape)}</BehaviorTree></root>'
