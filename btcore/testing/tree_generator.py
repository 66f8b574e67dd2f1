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

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import ControlNode
from btcore.registry.manifest import Manifest, takes_children
from btcore.registry.registry import Registry
from btcore.status import FAILURE, SKIPPED, SUCCESS, NodeType, PossibleResults
from btcore.values import BOOL, DOUBLE, FLOAT, INT, INT64, NODE_STATUS, STRING, UINT, ValueType

INSTANT: Final = ("PlanCondition", "Ask")
"""Planned leaves that are done within a tick, and so may decide in a branch."""
SCRIPT_KEYS: Final = ("a", "b", "c")
"""The entries of the root's blackboard that random scripts use; all begin as 0."""

_EITHER: Final = st.booleans()
_QUESTIONS: Final = ("@a == 0", "@a > @b", "@b != @c", "@c < 2 && @a >= 0", "true", "false")
_STATEMENTS: Final = ("@a := 1", "@a := @a + 1", "@b = @c + 1", "@c = @a == 0 ? 2 : 0", "@b := 0; @c := @b")
_SCRIPTS: Final = {PortRole.SCRIPT: _STATEMENTS, PortRole.CONDITION: _QUESTIONS}
_NUMBERS: Final = {PortRole.DURATION: 40, PortRole.REPETITIONS: 3}  # at most; milliseconds, turns
_THRESHOLDS: Final = (PortRole.SUCCESSES, PortRole.FAILURES)
_DRAWN_ROLES: Final = frozenset({*_SCRIPTS, *_NUMBERS, *_THRESHOLDS})
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


def _drawable_nodes(registry: Registry, format: int) -> dict[str, Manifest]:
    found = [
        manifest
        for manifest in registry.manifests_of(format).values()
        if manifest.type is not NodeType.SUBTREE
        and not manifest.parameters
        and all(port.default is not None or port.role in _DRAWN_ROLES for port in manifest.ports.values())
    ]
    found.sort(key=lambda manifest: (len(manifest.ports), len(manifest.id)))
    return {manifest.id: manifest for manifest in found}


_STANDARD: Final = Registry.standard()
BUILTIN_MANIFESTS: Final[Mapping[int, Mapping[str, Manifest]]] = {
    format: _drawable_nodes(_STANDARD, format) for format in (3, 4)
}
"""The built-in nodes that random trees may have, by format and ID, the plainest first.

They are those that need no resource and no text other than a number, a script or a truth value.
"""


def _roles(manifest: Manifest) -> set[PortRole]:
    return {port.role for port in manifest.ports.values()}


def _may_skip(manifest: Manifest) -> bool:
    """Whether a node may be SKIPPED even if its child never is."""
    child = PossibleResults(frozenset({SUCCESS, FAILURE}), frozenset({SUCCESS, FAILURE}), True)
    defaults = {
        port.name: port.type.from_text(port.default)
        for port in manifest.ports.values()
        if port.default is not None
    }
    return SKIPPED in manifest.cls.possible_results([child], defaults).results


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

    def may_occur(self, manifest: Manifest) -> bool:
        """Whether the built-in node of *manifest* may occur."""
        if self.tags is not None:
            return manifest.id in self.tags
        roles = _roles(manifest)
        if PortRole.DURATION in roles:
            return self.timed
        if not takes_children(manifest):
            return self.scripts and bool(roles & _SCRIPTS.keys())
        return self.skipped or not _may_skip(manifest)


class TreeGenerator:
    """Draws the elements of one tree. *callable_trees* are the IDs of trees that it may call."""

    def __init__(self, draw: DrawFn, wishes: TreeOptions, budget: int, callable_trees: list[str]) -> None:
        self.draw = draw
        self.wishes = wishes
        self.budget = budget
        self.trees = callable_trees
        builtin = BUILTIN_MANIFESTS[wishes.format]
        self.manifests = {id: one for id, one in builtin.items() if wishes.may_occur(one)} | dict(wishes.own)
        leaves = [id for id, one in self.manifests.items() if not takes_children(one)]
        planned = list(wishes.planned) if wishes.tags is None or not leaves else []
        self.leaves = [*planned, *leaves, *(["SubTree"] if callable_trees else [])]
        self.instant = [tag for tag in planned if tag in INSTANT]
        self.decorators = [id for id, one in self.manifests.items() if one.type is NodeType.DECORATOR]
        self.controls: list[str] = []
        self.branches: list[str] = []
        for id, manifest in self.manifests.items():
            cls = manifest.cls
            if issubclass(cls, ControlNode) and cls.branch_results:
                self.branches += [id] if self.instant else []
            elif manifest.type is NodeType.CONTROL:
                self.controls.append(id)

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
            kinds += [self.control] * bool(self.controls_of(1))
        if room >= 3:
            kinds += [self.control] * bool(self.controls_of(1))
            kinds += [self.branch] * bool(self.branches)
        if not (top and kinds):
            kinds.insert(0, self.leaf)
        kind = kinds[self.draw(cached_integers(0, len(kinds) - 1))]
        return self.guarded(kind(depth))

    def controls_of(self, count: int) -> list[str]:
        """The control nodes that can have *count* children."""
        found = []
        for id in self.controls:
            least, most = self.manifests[id].cls.child_count
            if least <= count and (most is None or count <= most):
                found.append(id)
        return found

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
        tag = self.pick(self.controls_of(len(children)))
        if tag == "ReactiveSequence":
            # The format allows one asynchronous child there.
            other = "Sequence" if "Sequence" in self.manifests else tag
            children = [one._replace(tag=other) if one.tag == "AsyncSequence" else one for one in children]
        return Element(tag, self.ports(tag, len(children)), children)

    def branch(self, depth: int) -> Element:
        """A node whose first child decides; one that is skipped there is an error in format 4."""
        self.budget -= 1
        tag = self.pick(self.branches)
        asked = self.pick(self.instant)
        plan = self.wishes.planned[asked]
        ports = {} if plan is None else {"plan": self.draw(_never_skipped(plan))}
        least = self.manifests[tag].cls.child_count[0] - 1
        count = self.draw(cached_integers(least, 2))
        below = [self.element(depth=depth + 1) for done in range(count) if done < least or self.budget > 0]
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
        texts: dict[str, str] = {}
        for port in self.manifests[tag].ports.values():
            given = self.wishes.texts.get(tag, {}).get(port.name)
            if given is not None:
                texts[port.name] = self.draw(given)
            elif port.role in _NUMBERS:
                texts[port.name] = str(self.draw(cached_integers(0, _NUMBERS[port.role])))
            elif port.role in _THRESHOLDS:
                # Format 3 has no 0, and its −1 is tried by the recorded cases.
                least = -1 if port.role is PortRole.SUCCESSES and self.wishes.format == 4 else 1
                texts[port.name] = str(self.draw(cached_integers(least, count)))
            elif port.role in _SCRIPTS:
                scripted = self.wishes.scripts or count == 0
                texts[port.name] = self.pick(_SCRIPTS[port.role] if scripted else ("true", "false"))
            elif port.type is BOOL and tag not in self.wishes.own:
                texts[port.name] = self.pick(["true", "false"])
            elif port.default is None:
                texts[port.name] = self.draw(self.text(tag, port))
        return texts

    def text(self, tag: str, port: Port) -> SearchStrategy[str]:
        """What *port* of a node that isn't btcore's may say."""
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
