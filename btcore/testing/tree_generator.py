"""How random trees grow: element by element, while a budget of nodes lasts.

What is drawn first is the simplest, so that hypothesis shrinks a tree towards a single leaf.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import quoteattr

from hypothesis import strategies as st
from hypothesis.errors import InvalidArgument
from hypothesis.strategies import DrawFn, SearchStrategy

from btcore.blackboard.ports import Port
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.values import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    INT64,
    NODE_STATUS,
    STRING,
    UINT,
    ValueType,
)

ORDERED: Final = ("Sequence", "Fallback", "AsyncSequence", "AsyncFallback", "SequenceWithMemory")
ORDERED_3: Final = ("Sequence", "Fallback", "SequenceStar")
REACTIVE: Final = ("ReactiveSequence", "ReactiveFallback")
UNARY: Final = ("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure")
COUNTED: Final = {"Repeat": "num_cycles", "RetryUntilSuccessful": "num_attempts"}
TIMED: Final = {"Delay": "delay_msec", "Timeout": "msec"}
PARALLEL: Final = ("Parallel", "ParallelAll")
BRANCHES: Final = ("IfThenElse", "WhileDoElse")
FIXED: Final = ("AlwaysSuccess", "AlwaysFailure")
INSTANT: Final = ("PlanCondition", "Ask")
"""Planned leaves that are done within a tick, and so may decide in a branch."""
GENERATED_TAGS: Final = frozenset(
    {*ORDERED, *ORDERED_3, *REACTIVE, *UNARY, *COUNTED, *TIMED, *PARALLEL, *BRANCHES, *FIXED}
    | {"RunOnce", "Precondition", "TryCatch", "Script", "ScriptCondition", "Sleep"}
)
"""The nodes of btcore that random trees may have."""
SCRIPT_KEYS: Final = ("a", "b", "c")
"""The entries of the root's blackboard that random scripts use; all begin as 0."""

_EITHER: Final = st.booleans()
_QUESTIONS: Final = ("@a == 0", "@a > @b", "@b != @c", "@c < 2 && @a >= 0", "true", "false")
_STATEMENTS: Final = ("@a := 1", "@a := @a + 1", "@b = @c + 1", "@c = @a == 0 ? 2 : 0", "@b := 0; @c := @b")
_TEXTS: Final[Mapping[ValueType, SearchStrategy[str]]] = {
    BOOL: st.sampled_from(["false", "true"]),
    INT: st.integers(-3, 100).map(str),
    INT64: st.integers(-3, 100).map(str),
    UINT: st.integers(0, 100).map(str),
    DOUBLE: st.sampled_from(["0", "1", "-0.5", "2.25", "1e3"]),
    FLOAT: st.sampled_from(["0", "1", "-0.5", "2.25"]),
    STRING: st.text("abc xyz", min_size=1, max_size=5),
    NODE_STATUS: st.sampled_from(["SUCCESS", "FAILURE"]),
}


class Element(NamedTuple):
    """One element of a random tree, before it has a name."""

    tag: str
    ports: dict[str, str]
    children: "list[Element]"


@dataclass
class TreeOptions:
    """What may occur in a random tree.

    *planned* are the tags of leaves with their strategies for the port ``plan`` (None = the leaf has no
    port), *tags* those of the nodes that may occur (None = all of btcore's), *own* the manifests of those
    that aren't btcore's, *texts* the strategies for their ports, by tag and port.
    """

    planned: Mapping[str, SearchStrategy[str] | None]
    format: int = 4
    skipped: bool = True
    timed: bool = False
    conditions: bool = False
    scripts: bool = False
    max_depth: int = 100
    tags: Collection[str] | None = None
    own: Mapping[str, Manifest] = field(default_factory=dict)
    texts: Mapping[str, Mapping[str, SearchStrategy[str]]] = field(default_factory=dict)

    def allowed(self, *tags: str) -> list[str]:
        """Those of *tags* that may occur."""
        return [tag for tag in tags if self.tags is None or tag in self.tags]

    def of_own(self, *types: NodeType) -> list[str]:
        """The tags that aren't btcore's, of nodes of *types*."""
        return [tag for tag, manifest in self.own.items() if manifest.type in types]


class TreeGenerator:
    """Draws the elements of one tree. *callable_trees* are the IDs of trees that it may call."""

    def __init__(self, draw: DrawFn, wishes: TreeOptions, budget: int, callable_trees: list[str]) -> None:
        self.draw = draw
        self.wishes = wishes
        self.budget = budget
        self.trees = callable_trees
        four = wishes.format == 4
        chosen, allowed, own = wishes.tags is not None, wishes.allowed, wishes.of_own
        timed = allowed(*TIMED) if wishes.timed or chosen else []
        once = ["RunOnce"] if wishes.skipped or chosen else []
        gates = ["Precondition", *once] if four else []
        extra = allowed(*FIXED) if chosen else []
        if four and (wishes.scripts or chosen):
            extra += allowed("Script", "ScriptCondition")
        if four and (wishes.timed or chosen):
            extra += allowed("Sleep")
        leaves = [*extra, *own(NodeType.ACTION, NodeType.CONDITION)]
        planned = list(wishes.planned) if not chosen or not leaves else []
        self.leaves = [*planned, *leaves, *(["SubTree"] if callable_trees else [])]
        self.decorators = [*allowed(*UNARY, *COUNTED, *gates), *timed, *own(NodeType.DECORATOR)]
        ordered = ORDERED if four else ORDERED_3
        parallel = PARALLEL if four else PARALLEL[:1]
        self.controls = [*allowed(*ordered, *REACTIVE, *parallel), *own(NodeType.CONTROL)]
        self.try_catch = allowed("TryCatch") if four else []
        self.instant = [tag for tag in planned if tag in INSTANT]
        self.branches = allowed(*BRANCHES) if self.instant else []

    def pick(self, tags: Collection[str]) -> str:
        """One of *tags*."""
        tag: str = self.draw(cached_sampled_from(tuple(tags)))
        return tag

    def element(self, top: bool = False, depth: int = 1) -> Element:
        """An element with its children; a tree whose *top* is a leaf has no other node."""
        self.budget -= 1
        room = self.budget if depth < self.wishes.max_depth else 0
        kinds: list[Callable[[int], Element]] = []
        if room >= 1:
            kinds += [self.decorator] * bool(self.decorators)
            kinds += [self.control] * bool(self.controls)
        if room >= 3:
            kinds += [self.control] * bool(self.controls)
            kinds += [self.branch] * bool(self.branches)
        if not (top and kinds):
            kinds.insert(0, self.leaf)
        kind = kinds[self.draw(cached_integers(0, len(kinds) - 1))]
        return self.guarded(kind(depth))

    def leaf(self, depth: int) -> Element:
        """A node without children."""
        tag = self.pick(self.leaves)
        if tag in self.wishes.planned:
            plan = self.wishes.planned[tag]
            return Element(tag, {} if plan is None else {"plan": self.draw(plan)}, [])
        if tag == "SubTree":
            return Element(tag, {"ID": self.pick(self.trees)}, [])
        return Element(tag, self.ports(tag, 0), [])

    def decorator(self, depth: int) -> Element:
        """A node with one child."""
        tag = self.pick(self.decorators)
        return Element(tag, self.ports(tag, 1), [self.element(depth=depth + 1)])

    def control(self, depth: int) -> Element:
        """A node with any number of children."""
        children = [self.element(depth=depth + 1)]
        while self.budget > 0 and len(children) < 4 and self.draw(_EITHER):
            children.append(self.element(depth=depth + 1))
        tag = self.pick([*self.controls, *(self.try_catch if len(children) > 1 else ())])
        if tag == "ReactiveSequence":
            # The format allows one asynchronous child there.
            other = (self.wishes.allowed("Sequence") or ["ReactiveSequence"])[0]
            children = [one._replace(tag=other) if one.tag == "AsyncSequence" else one for one in children]
        return Element(tag, self.ports(tag, len(children)), children)

    def branch(self, depth: int) -> Element:
        """A node whose first child decides; one that is skipped there is an error in format 4."""
        self.budget -= 1
        tag = self.pick(self.branches)
        asked = self.pick(self.instant)
        plan = self.wishes.planned[asked]
        ports = {} if plan is None else {"plan": self.draw(_never_skipped(plan))}
        exactly = tag == "WhileDoElse" and self.wishes.format == 3
        count = 2 if exactly else self.draw(cached_integers(1, 2))
        below = [self.element(depth=depth + 1) for _ in range(count) if exactly or self.budget > 0]
        return Element(tag, {}, [Element(asked, ports, []), *below])

    def guarded(self, element: Element) -> Element:
        """*element*, sometimes with scripts around its ticks."""
        if not self.wishes.conditions:
            return element
        before = ["_successIf", "_failureIf", *["_skipIf", "_while"] * self.wishes.skipped]
        after = ["_onSuccess", "_onFailure", "_post", "_onHalted"]
        scripts: dict[str, str] = {}
        for keys, texts in ((before, _QUESTIONS), (after, _STATEMENTS)):
            key = self.draw(cached_sampled_from((None, None, *keys)))
            if key is not None:
                scripts[key] = self.draw(cached_sampled_from(texts))
        return element._replace(ports={**element.ports, **scripts})

    def ports(self, tag: str, count: int) -> dict[str, str]:
        """The ports of a node that has *count* children."""
        numbers = {
            **dict.fromkeys(COUNTED, (0, 3)),
            **dict.fromkeys([*TIMED, "Sleep"], (0, 40)),
        }
        if tag in numbers:
            key = {**COUNTED, **TIMED, "Sleep": "msec"}[tag]
            return {key: str(self.draw(cached_integers(*numbers[tag])))}
        truth = {"RunOnce": "then_skip", "TryCatch": "catch_on_halt", "Precondition": "if"}
        if tag in truth:
            return {truth[tag]: self.pick(["true", "false"])}
        if tag == "Parallel":
            word, least = ("count", -1) if self.wishes.format == 4 else ("threshold", 1)
            return {
                f"success_{word}": str(self.draw(cached_integers(least, count))),
                f"failure_{word}": str(self.draw(cached_integers(1, count))),
            }
        if tag == "ParallelAll":
            return {"max_failures": str(self.draw(cached_integers(0, count)))}
        if tag in ("Script", "ScriptCondition"):
            return {"code": self.pick(_STATEMENTS if tag == "Script" else _QUESTIONS)}
        if tag not in self.wishes.own:
            return {}
        return {
            port.name: self.draw(self.text(tag, port))
            for port in self.wishes.own[tag].ports.values()
            if port.default is None or port.name in self.wishes.texts.get(tag, {})
        }

    def text(self, tag: str, port: Port) -> SearchStrategy[str]:
        """What *port* of a node that isn't btcore's may say."""
        given = self.wishes.texts.get(tag, {}).get(port.name)
        if given is not None:
            return given
        if not port.reads:
            return st.just("{" + port.name + "}")
        if port.type not in _TEXTS:
            raise InvalidArgument(
                f"nobody knows what to write for the port '{port.name}' of <{tag}>, which takes "
                f"{port.type.name}: say so with ports={{'{tag}': {{'{port.name}': a strategy of texts}}}}"
            )
        return _TEXTS[port.type]


# A strategy is checked when it is first drawn from, which takes longer than a draw: each is made once.


@cache
def cached_sampled_from(things: Sequence[Any]) -> SearchStrategy[Any]:
    """One of *things*, which are hashable, in a tuple."""
    return st.sampled_from(things)


@cache
def cached_integers(least: int, most: int) -> SearchStrategy[int]:
    """The integers from *least* to *most*."""
    return st.integers(least, most)


@cache
def _never_skipped(plan: SearchStrategy[str]) -> SearchStrategy[str]:
    return plan.map(lambda text: text.replace("K", "S"))


def element_to_xml(element: Element, number: Iterator[int], indent: str, compact: bool) -> str:
    """*element* as XML, named ``n`` and the next *number*; a line an element unless *compact*."""
    ports = "".join(f" {key}={quoteattr(text)}" for key, text in element.ports.items())
    start, end = ("", "") if compact else (indent, "\n")
    head = f'{start}<{element.tag} name="n{next(number)}"{ports}'
    if not element.children:
        return f"{head}/>{end}"
    inside = "".join(element_to_xml(child, number, indent + "  ", compact) for child in element.children)
    return f"{head}>{end}{inside}{start}</{element.tag}>{end}"
