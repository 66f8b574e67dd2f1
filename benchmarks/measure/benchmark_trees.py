"""The trees of the benchmark `ticking`, independent of the engine that ticks them.

A tree is a `Branch`, or the ID of a leaf. The leaves Succeed and Fail only return SUCCESS or FAILURE.
bump-and-go has its own four leaves.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import cycle

from btcore import Condition, Registry, StatefulAction, Status, SyncAction, action

SUCCESS, FAILURE, RUNNING = Status.SUCCESS, Status.FAILURE, Status.RUNNING
OBSTACLE_RESULTS = (FAILURE,) * 9 + (SUCCESS,)
"""The results of the leaf IsObstacle, which are repeated."""
MOVES = (RUNNING, RUNNING, SUCCESS)
"""The results of the leaves Back and Turn, which are repeated."""


@dataclass(frozen=True, slots=True)
class Branch:
    """A control node or decorator with its children."""

    tag: str
    children: "tuple[Shape, ...]"


Shape = Branch | str


def bump_and_go() -> Shape:
    """Return the bump-and-go tree of the book (see the benchmark `ticking`), with 8 nodes."""
    bump = Branch("Sequence", ("Back", "Turn"))
    clear = Branch("Fallback", (Branch("Inverter", ("IsObstacle",)), bump))
    return Branch("ReactiveSequence", (clear, "Forward"))


def layered(sequence: str, fallback: str, levels: int, failing: int) -> Shape:
    """Return a tree of alternating control nodes.

    Args:
        sequence: The tag of the control nodes on even levels, which have 3 children.
        fallback: The tag of the control nodes on odd levels, whose children are *failing* leaves that fail,
            and then a child that succeeds.
        levels: The number of levels of control nodes.
        failing: The number of failing leaves of each control node on an odd level.
    """

    def grow(level: int) -> Shape:
        if level == levels:
            return "Succeed"
        below = grow(level + 1)
        if level % 2:
            return Branch(fallback, ("Fail",) * failing + (below,))
        return Branch(sequence, (below,) * 3)

    return grow(0)


TREES: dict[str, Callable[[], Shape]] = {
    "bump-and-go": bump_and_go,
    "deep": lambda: layered("Sequence", "Fallback", levels=8, failing=3),
    "reactive": lambda: layered("ReactiveSequence", "ReactiveFallback", levels=9, failing=5),
    "wide": lambda: Branch("Sequence", ("Succeed",) * 100),
}


def leaves(shape: Shape) -> Iterator[str]:
    """Yield the IDs of the leaves of *shape*, in order."""
    if isinstance(shape, str):
        yield shape
    else:
        for child in shape.children:
            yield from leaves(child)


# --- leaves as users write them, as classes


class Succeed(SyncAction):
    def tick(self) -> Status:
        return SUCCESS


class Fail(SyncAction):
    def tick(self) -> Status:
        return FAILURE


class IsObstacle(Condition):
    def __init__(self) -> None:
        self.results = cycle(OBSTACLE_RESULTS)

    def tick(self) -> Status:
        return next(self.results)


class Back(StatefulAction):
    def __init__(self) -> None:
        self.results = cycle(MOVES)

    def on_start(self) -> Status:
        return next(self.results)

    def on_running(self) -> Status:
        return next(self.results)


class Turn(Back):
    pass


class Forward(StatefulAction):
    def on_start(self) -> Status:
        return RUNNING

    def on_running(self) -> Status:
        return RUNNING


# --- leaves as users write them, as functions


@action(ID="Succeed")
def succeed() -> bool:
    return True


@action(ID="Fail")
def fail() -> bool:
    return False


CLASSES = {cls.__name__: cls for cls in (Succeed, Fail, IsObstacle, Back, Turn, Forward)}
FUNCTIONS = {"Succeed": succeed, "Fail": fail}
BUILT_IN = {"Succeed": "AlwaysSuccess", "Fail": "AlwaysFailure"}
LEAVES: dict[str, Mapping[str, object]] = {"class": CLASSES, "function": FUNCTIONS, "built-in": BUILT_IN}
KINDS = tuple(LEAVES)
"""The kinds of leaves: written in Python as classes or as functions, or built into the engine."""


def kinds_of(shape: Shape) -> list[str]:
    """Return the kinds for which all leaves of *shape* are implemented."""
    return [kind for kind in KINDS if set(leaves(shape)) <= LEAVES[kind].keys()]


def registry(kind: str) -> Registry:
    """Return a registry with the leaves of *kind*."""
    nodes = Registry.standard()
    if kind == "class":
        nodes.add(*CLASSES.values())
    elif kind == "function":
        nodes.add(*FUNCTIONS.values())
    return nodes


def document(shape: Shape, kind: str) -> str:
    """Return *shape* as XML, with leaves of *kind*."""

    def element(part: Shape) -> str:
        if isinstance(part, str):
            return f"<{BUILT_IN[part] if kind == 'built-in' else part}/>"
        return f"<{part.tag}>{''.join(map(element, part.children))}</{part.tag}>"

    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{element(shape)}</BehaviorTree></root>'
