"""Hypothesis strategies: random trees, the outcomes of their leaves, and blackboards.

    @given(trees(max_nodes=40), outcomes())
    def test_halting_leaves_nothing_running(tree, outcomes):
        outcomes.drive(tree, ticks=6)
        tree.halt()
        assert all(node.status is IDLE for node in tree)

Hypothesis reports a failing example with the shrunk tree as XML. This module and `tree_generator` are the
only modules that import hypothesis (`pip install hypothesis`).
"""

from collections.abc import Collection, Mapping
from functools import cache
from itertools import count
from typing import Any, Final, TypeAlias, TypedDict, Unpack

from hypothesis import note
from hypothesis import strategies as st
from hypothesis.errors import InvalidArgument
from hypothesis.strategies import DrawFn, SearchStrategy

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard
from btcore.clock import SimClock
from btcore.loading.load import loads, registry_or_standard
from btcore.registry.manifest import Manifest
from btcore.registry.mock_leaves import Outcomes
from btcore.registry.registry import Registry
from btcore.suggestions import did_you_mean
from btcore.testing.leaf_replacement import with_mock_leaves
from btcore.testing.tree_generator import (
    BUILTIN_MANIFESTS,
    SCRIPT_KEYS,
    TreeGenerator,
    TreeOptions,
    cached_integers,
    element_to_xml,
)
from btcore.tree.tree import Tree

PortTexts: TypeAlias = Mapping[str, Mapping[str, SearchStrategy[str]]]
"""Strategies for the values of ports, by the tag of the node and the name of the port."""


def outcomes(skipped: bool = False, raising: bool = False, max_starts: int = 12) -> SearchStrategy[Outcomes]:
    """Return a strategy of outcomes that all leaves of a tree share.

    Args:
        skipped: Whether leaves may be skipped.
        raising: Whether leaves may raise an exception.
        max_starts: The maximum number of starts. Each start of a leaf takes the next.
    """
    return outcome_texts(skipped, raising, max_starts).map(Outcomes)


def outcome_texts(
    skipped: bool = True, raising: bool = False, max_starts: int = 3, max_running: int = 5
) -> SearchStrategy[str]:
    """Return a strategy of outcomes as texts. Every start completes.

    Args:
        skipped: Whether a start may end with K.
        raising: Whether a start may end with X.
        max_starts: The maximum number of starts.
        max_running: The maximum number of R in a start.
    """
    ends = st.sampled_from("SF" + "K" * skipped + "XXXX" * raising)
    starts = st.builds(lambda waits, end: "R" * waits + end, st.integers(0, max_running), ends)
    return st.lists(starts, min_size=1, max_size=max_starts).map("|".join)


@cache  # drawing from new strategies takes twice as long
def _texts_of_leaves(skipped: bool, raising: bool) -> dict[str, SearchStrategy[str] | None]:
    return {"Act": outcome_texts(skipped, raising), "Ask": outcome_texts(skipped, max_running=0)}


@st.composite
def xml_documents(
    draw: DrawFn,
    max_nodes: int = 30,
    skipped: bool = True,
    raising: bool = False,
    timed: bool = False,
    *,
    own_outcomes: bool = True,
    format: int = 4,
    max_depth: int = 100,
    subtrees: int = 0,
    conditions: bool = False,
    scripts: bool = False,
    tags: Collection[str] | None = None,
    nodes: Registry | None = None,
    ports: PortTexts | None = None,
) -> str:
    """Return a strategy of documents as XML text. The nodes are named n1, n2 … in pre-order.

    The leaves are Act and Ask, each with its own outcomes, or without *own_outcomes* with those of the tree's
    `Outcomes`; load the documents with `with_mock_leaves`.

    All loops end. But a KeepRunningUntilFailure may keep the tree RUNNING forever, and `tick_once` does not
    return if the branches of a WhileDoElse alternate and wake the tree up each time.

    Args:
        draw: Passed by hypothesis; callers omit it.
        max_nodes: The maximum number of nodes.
        skipped: Whether nodes may be skipped (format 4 only).
        raising: Whether leaves may raise an exception.
        timed: Whether Delay, Timeout and Sleep may occur.
        own_outcomes: Whether each leaf has outcomes of its own.
        format: The XML format, 3 or 4.
        max_depth: The maximum number of levels of a tree.
        subtrees: The maximum number of further trees, which are used as subtrees.
        conditions: Whether attributes such as `_skipIf` may occur (format 4 only). They use the entries a,
            b and c of the root's blackboard, which must exist as numbers.
        scripts: Whether Script and ScriptCondition may occur (format 4 only), which use the same entries.
        tags: The tags that may occur; by default all control nodes and decorators that accept any child. If a
            leaf is among them, no other leaves occur.
        nodes: The registry with those of *tags* that are not built in.
        ports: Strategies for the values of ports, by tag and port name. By default, values are drawn for the
            ports without a default, according to the type of the port.

    Raises:
        InvalidArgument: A tag is unknown, or a port needs a strategy in *ports*. Raised by the first draw.
    """
    skipped = skipped and format == 4
    allowed = TreeOptions(
        mocks=_texts_of_leaves(skipped, raising) if own_outcomes else {"Act": None, "Ask": None},
        own=_find_own_nodes(tags, nodes, format),
        ports=ports or {},
        format=format,
        skipped=skipped,
        timed=timed,
        conditions=conditions and format == 4,
        scripts=scripts and format == 4,
        max_depth=max_depth,
        tags=tags,
    )
    budget = draw(cached_integers(1, max_nodes))
    ids = ["Main", *(f"Sub{number}" for number in range(1, 1 + draw(cached_integers(0, subtrees))))]
    numbers = count(1)
    lines = []
    for index, id in enumerate(ids):
        # A tree may contain only the trees after it, so that no tree contains itself.
        generator = TreeGenerator(draw, allowed, max(1, budget), ids[index + 1 :])
        body = element_to_xml(generator.element(top=True), numbers, "    ")
        lines.append(f'  <BehaviorTree ID="{id}">\n{body}  </BehaviorTree>\n')
        budget = generator.budget
    main = ' main_tree_to_execute="Main"' if len(ids) > 1 else ""
    text = f'<root BTCPP_format="{format}"{main}>\n{"".join(lines)}</root>'
    note(text)
    return text


class TreeStrategyOptions(TypedDict, total=False):
    """The options of `trees`, which are described at `xml_documents`."""

    max_nodes: int
    skipped: bool
    timed: bool
    format: int
    max_depth: int
    subtrees: int
    conditions: bool
    scripts: bool
    tags: Collection[str] | None
    nodes: Registry | None
    ports: PortTexts | None


def trees(**options: Unpack[TreeStrategyOptions]) -> SearchStrategy[Tree]:
    """Return a strategy of trees on a simulated clock, with mock leaves that an `Outcomes` controls.

    Args:
        options: As of `xml_documents`. Mock leaves replace the leaves of *nodes*, except the built-in leaves.

    Raises:
        InvalidArgument: A tag is unknown, or a port needs a strategy in *ports*. Raised by the first draw.

    Examples:
        >>> from hypothesis import given
        >>> from btcore import RUNNING
        >>> from btcore.testing import outcomes, trees
        >>> @given(trees(max_nodes=5), outcomes())
        ... def test_halt(tree, outcomes):
        ...     outcomes.drive(tree, ticks=2)
        ...     tree.halt()
        ...     assert not any(node.status is RUNNING for node in tree)
    """
    nodes = options["nodes"] = with_mock_leaves(registry_or_standard(options.get("nodes")))

    def load(text: str) -> Tree:
        clock = SimClock()
        board = Format3Blackboard(clock=clock) if options.get("format") == 3 else Blackboard(clock=clock)
        for key in SCRIPT_KEYS if options.get("scripts") or options.get("conditions") else ():
            board[key] = 0
        return loads(text, nodes=nodes, blackboard=board, clock=clock)

    return xml_documents(own_outcomes=False, **options).map(load)


@st.composite
def blackboards(draw: DrawFn, entries: Mapping[str, Any]) -> Blackboard:
    """Return a strategy of blackboards.

    Args:
        draw: Passed by hypothesis; callers omit it.
        entries: A strategy or a type (int, float, str, bool …) for the value of each key. Numbers drawn by
            type are finite, and integers have 32 bits, like the values of ports.
    """
    board = Blackboard(clock=SimClock())
    values = {}
    for key, entry in entries.items():
        strategy = entry if isinstance(entry, SearchStrategy) else _BY_TYPE.get(entry)
        board[key] = values[key] = draw(strategy if strategy is not None else st.from_type(entry))
    note(f"blackboard {values}")
    return board


_BY_TYPE: Final[Mapping[Any, SearchStrategy[Any]]] = {
    int: st.integers(-(2**31), 2**31 - 1),
    float: st.floats(allow_nan=False, allow_infinity=False),
    str: st.text(st.characters(codec="utf-8", exclude_characters="\0")),
}


def _find_own_nodes(tags: Collection[str] | None, nodes: Registry | None, format: int) -> dict[str, Manifest]:
    """Return the manifests of those of *tags* that are not built in."""
    own = {}
    built_in = {**BUILTIN_MANIFESTS[4], **BUILTIN_MANIFESTS[3]}
    for tag in tags if tags is not None else ():
        if tag in built_in:
            continue
        manifest = nodes.get(tag, format) if nodes is not None else None
        if manifest is None or manifest.library == "btcore":
            known = [*built_in, *(item.id for item in nodes or () if item.library != "btcore")]
            hint = did_you_mean(tag, known) or "; pass the registry that has it: nodes=registry"
            raise InvalidArgument(f"random trees cannot contain <{tag}>{hint}")
        own[tag] = manifest
    return own
