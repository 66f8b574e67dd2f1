"""Hypothesis strategies: random trees, plans for their leaves, and blackboards.

    @given(trees(max_nodes=40), outcomes())
    def test_halting_leaves_nothing_running(tree, plan):
        plan.drive(tree, ticks=6)
        tree.halt()
        assert all(node.status is Status.IDLE for node in tree)

A failing example is reported with the tree that it shrank to, as XML. This module and ``growth`` are
the only ones that import hypothesis (``pip install hypothesis``).
"""

from collections.abc import Collection, Mapping
from functools import cache
from itertools import count
from typing import Any, Final, TypeAlias

from hypothesis import note
from hypothesis import strategies as st
from hypothesis.errors import InvalidArgument
from hypothesis.strategies import DrawFn, SearchStrategy

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import LegacyBlackboard
from btcore.clock import SimClock
from btcore.loading.load import loads
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.suggestions import nearest_name
from btcore.testing.mock_leaves import Outcomes, with_mock_leaves
from btcore.testing.tree_generator import (
    BUILTIN_MANIFESTS,
    SCRIPT_KEYS,
    Element,
    TreeGenerator,
    TreeOptions,
    cached_integers,
    element_to_xml,
)
from btcore.tree.tree import Tree

PortTexts: TypeAlias = Mapping[str, Mapping[str, SearchStrategy[str]]]
"""Strategies for the texts of ports, by tag and port."""


def action_plans(skipped: bool = True, raising: bool = False) -> SearchStrategy[str]:
    """Plans for :class:`~btcore.testing.plan_leaves.PlanAction`: one to three starts of one to six ticks.

    Every start ends, since its last letter isn't R. *skipped* allows K and *raising* X.
    """
    return st.lists(_starts(skipped, raising), min_size=1, max_size=3).map("|".join)


def sync_plans(skipped: bool = True) -> SearchStrategy[str]:
    """Plans for leaves that are done within a tick: one to five of S, F and, if *skipped*, K."""
    return st.text("SF" + "K" * skipped, min_size=1, max_size=5)


def outcomes(skipped: bool = False, raising: bool = False, max_starts: int = 12) -> SearchStrategy[Outcomes]:
    """Plans for all leaves of a tree: one to *max_starts* entries, each taken by the next leaf that starts.

    They end in success or failure, where asked for also *skipped*, or *raising* an exception.
    """
    starts = st.lists(_starts(skipped, raising), min_size=1, max_size=max_starts)
    return starts.map(lambda entries: Outcomes(*entries))


def _starts(skipped: bool, raising: bool) -> SearchStrategy[str]:
    ends = "SF" + "K" * skipped + "XXXX" * raising
    return st.builds(lambda waits, end: "R" * waits + end, st.integers(0, 5), st.sampled_from(ends))


@cache  # drawing from strategies made anew takes twice as long
def _with_plans(skipped: bool, raising: bool) -> dict[str, SearchStrategy[str] | None]:
    quick = sync_plans(skipped)
    return {"PlanAction": action_plans(skipped, raising), "PlanCondition": quick, "PlanSync": quick}


@st.composite
def xml_documents(
    draw: DrawFn,
    max_nodes: int = 30,
    skipped: bool = True,
    raising: bool = False,
    timed: bool = False,
    *,
    own_plans: bool = True,
    format: int = 4,
    max_depth: int = 100,
    subtrees: int = 0,
    conditions: bool = False,
    scripts: bool = False,
    tags: Collection[str] | None = None,
    nodes: Registry | None = None,
    ports: PortTexts | None = None,
) -> str:
    """Documents with *max_nodes* nodes and *max_depth* levels at most, as XML text.

    Nodes are called n1, n2 … in pre-order. Leaves are PlanAction, PlanCondition and PlanSync, each with a
    plan of its own (load them with :func:`~btcore.testing.conformance_trees.conformance_registry` and a
    Journal)
    or, without *own_plans*, Act and Ask, which follow an :class:`Outcomes` (load them with
    :func:`with_mock_leaves`).

    *tags* are those that may occur, by default all control nodes and decorators that take any child.
    Those of the registry *nodes* get a text for each port without a default, drawn from *ports* (by tag and
    port) or by the port's type; if any is a leaf, only such leaves occur. *timed* adds Delay, Timeout and
    Sleep. *scripts* adds Script and ScriptCondition and *conditions* the likes of ``_skipIf`` (both
    format 4), on the entries a, b and c of the root's blackboard, which must be there as numbers.
    *subtrees* is how many other trees there may be. *skipped* and *raising* are as in
    :func:`action_plans`. No loop is endless, but a KeepRunningUntilFailure may keep the tree RUNNING for
    ever, and a WhileDoElse whose branches take turns in waking the tree keeps ``tick_once`` busy for
    ever.
    """
    skipped = skipped and format == 4
    wishes = TreeOptions(
        _with_plans(skipped, raising) if own_plans else {"Act": None, "Ask": None},
        format=format,
        skipped=skipped,
        timed=timed,
        conditions=conditions and format == 4,
        scripts=scripts and format == 4,
        max_depth=max_depth,
        tags=tags,
        own=_own_nodes(tags, nodes, format),
        texts=ports or {},
    )
    left = draw(cached_integers(1, max_nodes))
    ids = ["Main", *(f"Sub{number}" for number in range(1, 1 + draw(cached_integers(0, subtrees))))]
    tops = []
    for place, id in enumerate(ids):
        grower = TreeGenerator(draw, wishes, max(1, left), ids[place + 1 :])
        tops.append((id, grower.element(top=True)))
        left = grower.budget
    note(_document(tops, format, compact=False))
    return _document(tops, format, compact=True)


def trees(
    max_nodes: int = 30,
    skipped: bool = True,
    timed: bool = False,
    *,
    format: int = 4,
    max_depth: int = 100,
    subtrees: int = 0,
    conditions: bool = False,
    scripts: bool = False,
    tags: Collection[str] | None = None,
    nodes: Registry | None = None,
    ports: PortTexts | None = None,
) -> SearchStrategy[Tree]:
    """Trees on a simulated clock whose leaves follow an :class:`Outcomes`; see :func:`xml_documents`."""
    known = with_mock_leaves(nodes if nodes is not None else Registry.standard())

    def load(text: str) -> Tree:
        clock = SimClock()
        board = Blackboard(clock=clock) if format == 4 else LegacyBlackboard(clock=clock)
        for key in SCRIPT_KEYS if scripts or conditions else ():
            board[key] = 0
        return loads(text, nodes=known, blackboard=board, clock=clock)

    return xml_documents(
        max_nodes,
        skipped,
        timed=timed,
        own_plans=False,
        format=format,
        max_depth=max_depth,
        subtrees=subtrees,
        conditions=conditions,
        scripts=scripts,
        tags=tags,
        nodes=known,
        ports=ports,
    ).map(load)


@st.composite
def blackboards(draw: DrawFn, entries: Mapping[str, Any]) -> Blackboard:
    """Blackboards with *entries*: keys and what they hold, strategies or types (int, float, str, bool …).

    Numbers drawn by type are finite, and ints have 32 bits, as the ports of those types.
    """
    board = Blackboard(clock=SimClock())
    shown = {}
    for key, wanted in entries.items():
        kind = wanted if isinstance(wanted, SearchStrategy) else _BY_TYPE.get(wanted)
        board[key] = shown[key] = draw(kind if kind is not None else st.from_type(wanted))
    note(f"blackboard {shown}")
    return board


_BY_TYPE: Final[Mapping[Any, SearchStrategy[Any]]] = {
    int: st.integers(-(2**31), 2**31 - 1),
    float: st.floats(allow_nan=False, allow_infinity=False),
    str: st.text(st.characters(codec="utf-8", exclude_characters="\0")),
}


def _own_nodes(tags: Collection[str] | None, nodes: Registry | None, format: int) -> dict[str, Manifest]:
    """Return the manifests of those of *tags* that are not built in."""
    own = {}
    drawn = {**BUILTIN_MANIFESTS[4], **BUILTIN_MANIFESTS[3]}
    for tag in tags if tags is not None else ():
        if tag in drawn:
            continue
        manifest = nodes.get(tag, format) if nodes is not None else None
        if manifest is None or manifest.distribution == "btcore":
            known = [*drawn, *(one.id for one in nodes or () if one.distribution != "btcore")]
            guess = nearest_name(tag, known)
            hint = f"did you mean '{guess}'?" if guess else "give the registry that has it: nodes=registry"
            raise InvalidArgument(f"random trees can't have <{tag}>; {hint}")
        own[tag] = manifest
    return own


def _document(tops: list[tuple[str, Element]], format: int, compact: bool) -> str:
    numbers = count(1)
    bodies = []
    for id, top in tops:
        body = element_to_xml(top, numbers, "    ", compact)
        bodies.append(
            f'<BehaviorTree ID="{id}">{body}</BehaviorTree>'
            if compact
            else f'  <BehaviorTree ID="{id}">\n{body}  </BehaviorTree>\n'
        )
    main = ' main_tree_to_execute="Main"' if len(tops) > 1 else ""
    start = f'<root BTCPP_format="{format}"{main}>'
    return f"{start}{'' if compact else chr(10)}{''.join(bodies)}</root>"
