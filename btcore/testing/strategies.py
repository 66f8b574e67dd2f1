"""Hypothesis strategies: random trees of planned leaves, as XML, for tests that hold for any tree.

The only module that imports hypothesis (``pip install hypothesis``).

    @given(trees(max_nodes=30))
    def test_halting_leaves_nothing_running(xml):
        tree = btcore.loads(xml, nodes=planned_registry(), resources=[Journal()])
        ...
"""

from collections.abc import Callable
from typing import Final, NamedTuple
from xml.sax.saxutils import quoteattr

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

ORDERED: Final = ("Sequence", "Fallback", "AsyncSequence", "AsyncFallback", "SequenceWithMemory")
REACTIVE: Final = ("ReactiveSequence", "ReactiveFallback")
UNARY: Final = ("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure")
COUNTED: Final = {"Repeat": "num_cycles", "RetryUntilSuccessful": "num_attempts"}


class Element(NamedTuple):
    """One element of a random tree, before it has a name."""

    tag: str
    ports: dict[str, str]
    children: "list[Element]"


def plans(skipped: bool = True, raising: bool = False) -> SearchStrategy[str]:
    """Plans for :class:`~btcore.testing.planned.PlanAction`: one to three starts of one to six ticks.

    Every start ends, since its last letter isn't R. *skipped* allows K and *raising* X.
    """
    ends = "SF" + "K" * skipped + "XXXX" * raising
    start = st.builds(lambda waits, end: "R" * waits + end, st.integers(0, 5), st.sampled_from(ends))
    return st.lists(start, min_size=1, max_size=3).map("|".join)


def letters(skipped: bool = True) -> SearchStrategy[str]:
    """Plans for leaves that are done within a tick: one to five of S, F and, if *skipped*, K."""
    return st.text("SF" + "K" * skipped, min_size=1, max_size=5)


@st.composite
def trees(
    draw: DrawFn, max_nodes: int = 30, skipped: bool = True, raising: bool = False, timed: bool = False
) -> str:
    """Documents of format 4 with one tree, *max_nodes* nodes at most, as XML text.

    Its nodes are called n1, n2 … in pre-order; its leaves are PlanAction, PlanCondition and PlanSync,
    so load it with :func:`~btcore.testing.recorded_trees.planned_registry` and a Journal. Every
    control node and decorator that takes any child occurs; *timed* adds Delay, Timeout and Sleep.
    No loop is endless, but a KeepRunningUntilFailure may keep the tree RUNNING for ever, and a
    WhileDoElse whose branches take turns in waking the tree keeps ``tick_once`` busy for ever.
    *skipped* and *raising* are as in :func:`plans`.
    """
    budget = [draw(st.integers(1, max_nodes))]
    top = _Grower(draw, budget, skipped, raising, timed).element(top=True)
    body = _written(top, iter(range(1, max_nodes + 1)).__next__)
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'


class _Grower:
    """Draws elements while the budget of nodes lasts."""

    def __init__(self, draw: DrawFn, budget: list[int], skipped: bool, raising: bool, timed: bool) -> None:
        self.draw = draw
        self.budget = budget
        self.skipped = skipped
        self.raising = raising
        self.timed = timed

    def element(self, top: bool = False) -> Element:
        """An element with its children; a tree whose *top* is a leaf has no other node."""
        self.budget[0] -= 1
        left = self.budget[0]
        kinds = [] if top and left >= 1 else [self.leaf]
        if left >= 1:
            kinds += [self.decorator, self.control]
        if left >= 3:
            kinds += [self.control, self.branch]
        return self.draw(st.sampled_from(kinds))()

    def leaf(self) -> Element:
        """A planned leaf, or a Sleep."""
        kinds = ["PlanCondition", "PlanSync", *["PlanAction"] * 4, *["Sleep"] * self.timed]
        tag = self.draw(st.sampled_from(kinds))
        if tag == "Sleep":
            return Element(tag, {"msec": str(self.draw(st.integers(0, 40)))}, [])
        plan = plans(self.skipped, self.raising) if tag == "PlanAction" else letters(self.skipped)
        return Element(tag, {"plan": self.draw(plan)}, [])

    def decorator(self) -> Element:
        """A node with one child."""
        timed = ("Delay", "Timeout") if self.timed else ()
        more = ("RunOnce", "Precondition") if self.skipped else ("Precondition",)
        tag = self.draw(st.sampled_from((*UNARY, *COUNTED, *more, *timed)))
        ports: dict[str, str] = {}
        if tag in COUNTED:
            ports[COUNTED[tag]] = str(self.draw(st.integers(0, 3)))
        elif tag == "RunOnce":
            ports["then_skip"] = self.draw(st.sampled_from(["true", "false"]))
        elif tag == "Precondition":
            ports["if"] = self.draw(st.sampled_from(["true", "false"]))
        elif tag == "Delay":
            ports["delay_msec"] = str(self.draw(st.integers(0, 40)))
        elif tag == "Timeout":
            ports["msec"] = str(self.draw(st.integers(0, 40)))
        return Element(tag, ports, [self.element()])

    def control(self) -> Element:
        """A node with any number of children."""
        children = [self.element()]
        while self.budget[0] > 0 and len(children) < 4 and self.draw(st.booleans()):
            children.append(self.element())
        count = len(children)
        many = ["TryCatch"] if count > 1 else []
        tag = self.draw(st.sampled_from([*ORDERED, *REACTIVE, "Parallel", "ParallelAll", *many]))
        ports: dict[str, str] = {}
        if tag == "Parallel":
            ports["success_count"] = str(self.draw(st.integers(-1, count)))
            ports["failure_count"] = str(self.draw(st.integers(1, count)))
        elif tag == "ParallelAll":
            ports["max_failures"] = str(self.draw(st.integers(0, count)))
        elif tag == "TryCatch":
            ports["catch_on_halt"] = self.draw(st.sampled_from(["true", "false"]))
        elif tag == "ReactiveSequence":
            # The format allows one asynchronous child there.
            children = [
                one._replace(tag="Sequence") if one.tag == "AsyncSequence" else one for one in children
            ]
        return Element(tag, ports, children)

    def branch(self) -> Element:
        """A node whose first child decides; one that is skipped there is an error in this format."""
        self.budget[0] -= 1
        tag = self.draw(st.sampled_from(["IfThenElse", "WhileDoElse"]))
        question = Element("PlanCondition", {"plan": self.draw(letters(skipped=False))}, [])
        count = self.draw(st.integers(1, 2))
        branches = [self.element() for _ in range(count) if self.budget[0] > 0]
        return Element(tag, {}, [question, *branches])


def _written(element: Element, number: Callable[[], int]) -> str:
    ports = "".join(f" {key}={quoteattr(text)}" for key, text in element.ports.items())
    head = f'<{element.tag} name="n{number()}"{ports}'
    if not element.children:
        return head + "/>"
    inside = "".join(_written(child, number) for child in element.children)
    return f"{head}>{inside}</{element.tag}>"
