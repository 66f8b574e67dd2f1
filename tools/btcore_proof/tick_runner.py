"""Single ticks of a tree with model leaves, and what happens in them."""

from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from typing import NamedTuple

from btcore.engine.node import TreeNode, execution_error, start_tick_counts, tick_counts_of
from btcore.errors import NodeExecutionError
from btcore.status import RUNNING, SKIPPED, Status
from btcore.tree.tree import Tree
from btcore_proof.interrupts import LostInterruptError, SearchInterrupt, UnknownOutcomeError
from btcore_proof.model_leaves import Choices, LeafEvent, model_leaf_model


class Tick(NamedTuple):
    """What happened in one tick, for the questions.

    Attributes:
        tree: The tree after the tick.
        kept: The model leaves that remained RUNNING: they neither completed nor were halted in the tick.
        events: The ticks and halts of model leaves, in order.
        result: The result of the tree; None if a node raised.
        error: The exception of a node.
        results: The results of the watched nodes in this tick, by uid.
        halts: The uids of the watched nodes that were halted while RUNNING.
    """

    tree: Tree
    kept: Sequence[TreeNode]
    events: Sequence[LeafEvent]
    result: Status | None
    error: NodeExecutionError | None
    results: "dict[int, list[Status]]"
    halts: set[int]


class Check(NamedTuple):
    """A check of ticks.

    Attributes:
        find: Returns what is wrong in a tick, or None.
        remember: Returns what *find* must know of the first part of a tick; None = nothing.
    """

    find: Callable[[Tick], str | None]
    remember: Callable[[Sequence[LeafEvent]], Hashable] | None = None


class TickRunner:
    """Runs single ticks of a tree with model leaves.

    Args:
        choices: The choices that its leaves share.
        watched: The nodes whose results and halts are recorded.

    Attributes:
        leaves: The model leaves of the tree.
    """

    def __init__(self, tree: Tree, choices: Choices, watched: Sequence[TreeNode] = ()) -> None:
        self.tree = tree
        self.choices = choices
        self.leaves: list[TreeNode] = [node for node in tree.nodes if model_leaf_model(node) is not None]
        self._watched = list(watched)
        self._results: dict[int, list[Status]] = {}
        self._halts_before: dict[int, int] = {}
        self._running: list[TreeNode] = []
        for node in watched:
            node.set_post_tick_function(self._record)
            start_tick_counts(node)

    def _record(self, node: TreeNode, status: Status) -> Status:
        self._results.setdefault(node.config.uid, []).append(status)
        return SKIPPED  # the result remains

    def run(self, given: Sequence[int]) -> Tick:
        """Run one tick from the present state of the tree, with the choices *given*."""
        self.choices.begin(given)
        self._results.clear()
        self._running = [leaf for leaf in self.leaves if leaf._status is RUNNING]
        self._halts_before = {node.config.uid: _halts_of(node) for node in self._watched}
        result, error = run_tick(self.tree, self.choices)
        return Tick(
            self.tree,
            self._kept(),
            self.choices.events,
            result,
            error,
            self._results,
            self._halts(),
        )

    def so_far(self) -> tuple[Hashable, ...]:
        """Return what the end of the present tick depends on, of what has happened in it."""
        return (
            tuple([leaf.config.uid for leaf in self._kept()]),
            tuple([(uid, frozenset(results)) for uid, results in sorted(self._results.items())]),
            frozenset(self._halts()),
        )

    def _kept(self) -> Sequence[TreeNode]:
        if not self._running:
            return ()
        ended = {event.leaf.config.uid for event in self.choices.events if event.result is not RUNNING}
        return [leaf for leaf in self._running if leaf._status is RUNNING and leaf.config.uid not in ended]

    def _halts(self) -> set[int]:
        before = self._halts_before
        return {node.config.uid for node in self._watched if _halts_of(node) > before[node.config.uid]}


def run_tick(tree: Tree, choices: Choices) -> tuple[Status | None, NodeExecutionError | None]:
    """Run one tick. Return its result, or an error: of a node, or of the root if its outcome is not known.

    Raises:
        KnownMomentError: The rest of the tick has been searched before.
    """
    result: Status | None = None
    interrupt: UnknownOutcomeError | None = None
    error: NodeExecutionError | None = None
    try:
        result = tree.tick_exactly_once()
    except NodeExecutionError as raised:
        error = raised
    except UnknownOutcomeError as raised:
        interrupt = raised
    if choices.raised is not None and choices.raised is not interrupt:
        interrupt = LostInterruptError("a node catches an exception with which the search ends a tick")
    if interrupt is None:
        return result, error
    with suppress(NodeExecutionError, SearchInterrupt):
        tree.halt()
    return None, execution_error(tree.root, interrupt, "ticking")


def _halts_of(node: TreeNode) -> int:
    counts = tick_counts_of(node)
    return 0 if counts is None else counts.halted
