"""A generator of random trees, which draws element by element until a budget of nodes is used up.

The first of the alternatives is always the simplest, so that hypothesis shrinks a tree towards a single leaf.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from typing import Final, NamedTuple
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

MOCK_CONDITION: Final = "Ask"
"""The mock leaf that can be the condition of a branch."""
SCRIPT_KEYS: Final = ("a", "b", "c")
"""The entries of the root's blackboard that random scripts use; their initial value is 0."""

_BOOLEANS: Final = st.booleans()
_CONDITIONS: Final = ("@a == 0", "@a > @b", "@b != @c", "@c < 2 && @a >= 0", "true", "false")
_STATEMENTS: Final = ("@a := 1", "@a := @a + 1", "@b = @c + 1", "@c = @a == 0 ? 2 : 0", "@b := 0; @c := @b")
_SCRIPTS: Final = {PortRole.SCRIPT: _STATEMENTS, PortRole.CONDITION: _CONDITIONS}
_NUMBERS: Final = {PortRole.DURATION: 40, PortRole.REPETITIONS: 3}  # maximum values: ms, repetitions
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


def _find_drawable_nodes(registry: Registry, format: int) -> dict[str, Manifest]:
    """Return the manifests of the nodes that random trees may contain, by ID, the simplest first."""
    manifests = [
        manifest
        for manifest in registry.manifests_of(format).values()
        if manifest.type is not NodeType.SUBTREE
        and not manifest.parameters
        and all(port.default is not None or port.role in _DRAWN_ROLES for port in manifest.ports.values())
    ]
    manifests.sort(key=lambda manifest: (len(manifest.ports), len(manifest.id)))
    return {manifest.id: manifest for manifest in manifests}


_STANDARD: Final = Registry.standard()
BUILTIN_MANIFESTS: Final[Mapping[int, Mapping[str, Manifest]]] = {
    format: _find_drawable_nodes(_STANDARD, format) for format in (3, 4)
}
"""The manifests of built-in nodes that random trees may contain, by format and ID, the simplest first.

They need no resources, and their ports need only numbers, scripts and booleans.
"""


def _may_skip(manifest: Manifest) -> bool:
    """Return whether a node may be SKIPPED even if its children are not."""
    child = PossibleResults(frozenset({SUCCESS, FAILURE}), frozenset({SUCCESS, FAILURE}), True)
    defaults = {
        port.name: port.type.from_text(port.default)
        for port in manifest.ports.values()
        if port.default is not None
    }
    return SKIPPED in manifest.cls.possible_results([child], defaults).results


class Element(NamedTuple):
    """An XML element of a random tree, without the attribute `name`. *ports* are the other attributes."""

    tag: str
    ports: dict[str, str]
    children: "list[Element]"


class TreeOptions(NamedTuple):
    """The nodes and attributes that may occur in a random tree, as the arguments of `xml_documents`.

    Attributes:
        mocks: The mock leaves by tag, each with a strategy for its port `outcomes`; None = without outcomes
            of its own.
        own: The manifests of the nodes that are not built in, by tag.
    """

    mocks: Mapping[str, SearchStrategy[str] | None]
    own: Mapping[str, Manifest]
    ports: Mapping[str, Mapping[str, SearchStrategy[str]]]
    format: int
    skipped: bool
    timed: bool
    conditions: bool
    scripts: bool
    max_depth: int
    tags: Collection[str] | None

    def may_occur(self, manifest: Manifest) -> bool:
        """Return whether the built-in node of *manifest* may occur."""
        if self.tags is not None:
            return manifest.id in self.tags
        roles = {port.role for port in manifest.ports.values()}
        if PortRole.DURATION in roles:
            return self.timed
        if not takes_children(manifest):
            return self.scripts and bool(roles & _SCRIPTS.keys())
        return self.skipped or not _may_skip(manifest)


class TreeGenerator:
    """A generator of the elements of a tree.

    Args:
        draw: The function of hypothesis that draws from a strategy.
        options: The nodes and attributes that may occur in the tree.
        budget: The maximum number of nodes. The attribute of this name is the number of nodes that are left.
        subtrees: The IDs of the trees that may be used as subtrees.
    """

    def __init__(self, draw: DrawFn, options: TreeOptions, budget: int, subtrees: list[str]) -> None:
        self.draw = draw
        self.options = options
        self.budget = budget
        self.subtrees = subtrees
        built_in = BUILTIN_MANIFESTS[options.format]
        self.manifests = {id: item for id, item in built_in.items() if options.may_occur(item)}
        self.manifests |= options.own
        leaves = [id for id, item in self.manifests.items() if not takes_children(item)]
        mocks = list(options.mocks) if options.tags is None or not leaves else []
        self.leaves = [*mocks, *leaves, *(["SubTree"] if subtrees else [])]
        self.decorators = [id for id, item in self.manifests.items() if item.type is NodeType.DECORATOR]
        self.controls: list[str] = []
        self.branches: list[str] = []
        for id, manifest in self.manifests.items():
            cls = manifest.cls
            if issubclass(cls, ControlNode) and cls.spec.branch_results:
                self.branches += [id] if mocks else []
            elif manifest.type is NodeType.CONTROL:
                self.controls.append(id)

    def pick(self, tags: Collection[str]) -> str:
        """Draw one of *tags*."""
        tag: str = self.draw(cached_sampled_from(tuple(tags)))
        return tag

    def element(self, top: bool = False, depth: int = 1) -> Element:
        """Draw an element with its children.

        Args:
            top: Whether the element is the root. A root is a leaf only if no other node is possible.
            depth: The level of the element, from 1.
        """
        self.budget -= 1
        nodes_left = self.budget if depth < self.options.max_depth else 0
        drawers: list[Callable[[int], Element]] = []
        if nodes_left >= 1:
            drawers += [self.decorator] * bool(self.decorators)
            drawers += [self.control] * bool(self.controls_of(1))
        if nodes_left >= 3:
            # Control nodes are drawn more often if there is room for several children.
            drawers += [self.control] * bool(self.controls_of(1))
            drawers += [self.branch] * bool(self.branches)
        if not (top and drawers):
            drawers.insert(0, self.leaf)
        drawer = drawers[self.draw(cached_integers(0, len(drawers) - 1))]
        return self.with_conditions(drawer(depth))

    def controls_of(self, count: int) -> list[str]:
        """Return the control nodes that accept *count* children."""
        limits = {id: self.manifests[id].cls.spec.child_count for id in self.controls}
        return [id for id, (low, high) in limits.items() if low <= count and (high is None or count <= high)]

    def leaf(self, depth: int) -> Element:
        """Draw a node without children."""
        tag = self.pick(self.leaves)
        if tag in self.options.mocks:
            texts = self.options.mocks[tag]
            return Element(tag, {} if texts is None else {"outcomes": self.draw(texts)}, [])
        if tag == "SubTree":
            return Element(tag, {"ID": self.pick(self.subtrees)}, [])
        return Element(tag, self.ports(tag, 0), [])

    def decorator(self, depth: int) -> Element:
        """Draw a node with one child."""
        tag = self.pick(self.decorators)
        return Element(tag, self.ports(tag, 1), [self.element(depth=depth + 1)])

    def control(self, depth: int) -> Element:
        """Draw a control node with one to four children."""
        children = [self.element(depth=depth + 1)]
        while self.budget > 0 and len(children) < 4 and self.draw(_BOOLEANS):
            children.append(self.element(depth=depth + 1))
        tag = self.pick(self.controls_of(len(children)))
        if tag == "ReactiveSequence":
            # A ReactiveSequence allows only one asynchronous child.
            synchronous = "Sequence" if "Sequence" in self.manifests else tag
            children = [
                child._replace(tag=synchronous) if child.tag == "AsyncSequence" else child
                for child in children
            ]
        return Element(tag, self.ports(tag, len(children)), children)

    def branch(self, depth: int) -> Element:
        """Draw a node whose first child is a condition, which must not be skipped in format 4."""
        self.budget -= 1
        tag = self.pick(self.branches)
        texts = self.options.mocks[MOCK_CONDITION]
        ports = {} if texts is None else {"outcomes": self.draw(_never_skipped(texts))}
        least = self.manifests[tag].cls.spec.child_count[0] - 1
        count = self.draw(cached_integers(least, 2))
        below = [self.element(depth=depth + 1) for done in range(count) if done < least or self.budget > 0]
        return Element(tag, {}, [Element(MOCK_CONDITION, ports, []), *below])

    def with_conditions(self, element: Element) -> Element:
        """Return *element* with random pre- and post-conditions, if the options allow them."""
        if not self.options.conditions:
            return element
        before = ["_successIf", "_failureIf", *["_skipIf", "_while"] * self.options.skipped]
        after = ["_onSuccess", "_onFailure", "_post", "_onHalted"]
        scripts: dict[str, str] = {}
        for keys, texts in ((before, _CONDITIONS), (after, _STATEMENTS)):
            key = self.draw(cached_sampled_from((None, None, *keys)))
            if key is not None:
                scripts[key] = self.draw(cached_sampled_from(texts))
        return element._replace(ports={**element.ports, **scripts})

    def ports(self, tag: str, count: int) -> dict[str, str]:
        """Draw the values of the ports of a node with *count* children, by port name."""
        texts: dict[str, str] = {}
        for port in self.manifests[tag].ports.values():
            strategy = self.options.ports.get(tag, {}).get(port.name)
            if strategy is not None:
                texts[port.name] = self.draw(strategy)
            elif port.role in _NUMBERS:
                texts[port.name] = str(self.draw(cached_integers(0, _NUMBERS[port.role])))
            elif port.role in _THRESHOLDS:
                # Format 3 does not allow 0. The recorded conformance cases test −1 in format 3.
                least = -1 if port.role is PortRole.SUCCESSES and self.options.format == 4 else 1
                texts[port.name] = str(self.draw(cached_integers(least, count)))
            elif port.role in _SCRIPTS:
                scripted = self.options.scripts or count == 0
                texts[port.name] = self.pick(_SCRIPTS[port.role] if scripted else ("true", "false"))
            elif port.type is BOOL and tag not in self.options.own:
                texts[port.name] = self.pick(["true", "false"])
            elif port.default is None:
                texts[port.name] = self.draw(self.text(tag, port))
        return texts

    def text(self, tag: str, port: Port) -> SearchStrategy[str]:
        """Return a strategy for the values of *port* of a node that is not built in."""
        if not port.reads:
            return st.just("{" + port.name + "}")
        if port.type not in _TEXTS:
            raise InvalidArgument(
                f"there is no strategy for the port '{port.name}' of <{tag}>, which has the type "
                f"{port.type.name}: pass ports={{'{tag}': {{'{port.name}': a strategy of strings}}}}"
            )
        return _TEXTS[port.type]


# Strategies are reused, because hypothesis validates a strategy at its first draw, which takes long.
cached_sampled_from = cache(st.sampled_from)
cached_integers = cache(st.integers)


@cache
def _never_skipped(texts: SearchStrategy[str]) -> SearchStrategy[str]:
    return texts.map(lambda text: text.replace("K", "S"))


def element_to_xml(element: Element, numbers: Iterator[int], indent: str) -> str:
    """Return an element as XML, with a line for each node.

    Args:
        numbers: The numbers for the names of the nodes.
        indent: The indentation of the first line.
    """
    ports = "".join(f" {key}={quoteattr(text)}" for key, text in element.ports.items())
    head = f'{indent}<{element.tag} name="n{next(numbers)}"{ports}'
    if not element.children:
        return f"{head}/>\n"
    inside = "".join(element_to_xml(child, numbers, indent + "  ") for child in element.children)
    return f"{head}>\n{inside}{indent}</{element.tag}>\n"
