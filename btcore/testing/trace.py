"""A record of the events in a tree, tick by tick."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import sub

from btcore.blackboard.blackboard import Entry
from btcore.clock import NS_PER_S
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status, Transition
from btcore.tree.drawing import Fragment, draw_branches, node_label, status_label, to_text
from btcore.tree.tree import Tree


@dataclass(frozen=True, slots=True)
class StatusChange:
    """A change of the stored status of a node.

    Attributes:
        path: The path of the node.
        previous: The status before the change.
        status: The status after the change.
    """

    path: str
    previous: Status
    status: Status

    def __str__(self) -> str:
        return f"{self.path}: {self.previous.name} → {self.status.name}"


@dataclass(frozen=True, slots=True)
class TraceStep:
    """The events in a tick of the root, or between two ticks.

    Nodes are identified by their full paths; equal paths are distinguished by `#1`, `#2` ….

    Attributes:
        tick: The number of the tick; 0 between two ticks.
        stamp: The time of the tree's clock at the end of the step (ns).
        status: The result of the root; IDLE between two ticks.
        changes: The status changes.
        results: For each node that was ticked, the results of its ticks; the nodes are in pre-order. A tick
            that raised an exception has no result.
        halted: The nodes that were halted while they were RUNNING.
        written: The new values of the blackboard entries that were written (None: removed), by key. The keys
            of a subtree's blackboard are `subtree path/key`.
        statuses: The statuses of all nodes at the end of the step.
        error: The exception that ended the tick, or None.
    """

    tick: int
    stamp: int
    status: Status
    changes: tuple[StatusChange, ...]
    results: dict[str, tuple[Status, ...]]
    halted: tuple[str, ...]
    written: dict[str, object]
    statuses: dict[str, Status]
    error: NodeExecutionError | None = None

    def __str__(self) -> str:
        at = f"at {self.stamp / NS_PER_S:g} s"
        if not self.tick:
            return f"after a tick, {at}"
        result = f"raised {self.error.path}" if self.error is not None else self.status.name
        return f"tick {self.tick}, {at}: {result}"


class ResultTracker:
    """Determines the results of the nodes of *tree* from the tick counts of the nodes."""

    def __init__(self, tree: Tree) -> None:
        self._tick_counts = tree.start_tick_counts()
        self._before = {key: self._read_counts(key) for key in self._tick_counts}

    def _read_counts(self, key: str) -> tuple[int, int, int, int, int]:
        counts = self._tick_counts[key]
        return counts.ticks, counts.success, counts.failure, counts.skipped, counts.halted

    def take(
        self, error: NodeExecutionError | None = None
    ) -> tuple[dict[str, tuple[Status, ...]], tuple[str, ...]]:
        """Return the events since the last call.

        Args:
            error: The exception that ended the last tick, or None.

        Returns:
            The results of each node that was ticked, by path, and the paths of the nodes that were halted
            while they were RUNNING.
        """
        results: dict[str, tuple[Status, ...]] = {}
        halted = []
        for key, before in self._before.items():
            now = self._read_counts(key)
            if now == before:
                continue
            self._before[key] = now
            ticks, success, failure, skipped, halts = map(sub, now, before)
            if halts:
                halted.append(key)
            if ticks:
                # The nodes from the root to the node that raised have a tick without a result.
                raised = error is not None and key in error.backtrace
                running = ticks - success - failure - skipped - raised
                # Counts do not have an order: results within a tick of the root are sorted by status.
                results[key] = (
                    (FAILURE,) * failure + (SUCCESS,) * success + (SKIPPED,) * skipped + (RUNNING,) * running
                )
        return results, tuple(halted)


class Trace(Observer):
    """Records the steps of *tree* from now on, in order: `trace[-1]` is the last step.

    Attributes:
        tree: The tree.
        steps: The steps so far.
        unsubscribe: Ends the recording.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Trace
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysSuccess(name="door")))
        >>> trace = Trace(tree)
        >>> _ = tree.tick_once()
        >>> trace[-1].results
        {'Inverter::1': (<Status.FAILURE: 3>,), 'door': (<Status.SUCCESS: 2>,)}
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.steps: list[TraceStep] = []
        self._paths = {node.config.uid: key for key, node in tree.nodes_by_path().items()}
        self._ticks = ResultTracker(tree)
        self._changes: list[StatusChange] = []
        self._entries = self._read_sequence_ids()
        self.unsubscribe = tree.subscribe(self)

    def __iter__(self) -> Iterator[TraceStep]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, index: int) -> TraceStep:
        return self.steps[index]

    def path(self, node: str) -> str:
        """Return the path by which this trace identifies a node.

        Args:
            node: The path or, if it is unique, the name.

        Raises:
            BtcoreError: There is no such node, or there are several.
        """
        __tracebackhide__ = True  # pytest shows the test instead of this method
        return self._paths[self.tree.node(node).config.uid]

    def results(self, node: str) -> list[Status]:
        """Return the results of all ticks of *node* in order; within a tick of the root, sorted by status."""
        path = self.path(node)
        return [status for step in self.steps for status in step.results.get(path, ())]

    def transition(self, change: Transition) -> None:
        """Store the status change until the step ends."""
        self._changes.append(StatusChange(self._paths[change.uid], change.previous, change.status))

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """End the step."""
        self._end(tick, stamp, status, None)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """End the step. The halt of the tree, which follows, belongs to the next step."""
        self._end(self.tree.ticks, stamp, IDLE, error)

    def catch_up(self) -> None:
        """Add a step with the events since the last tick, for example a halt, if there are any."""
        if self._changes:
            self._end(0, self.tree.clock.now(), IDLE, None)

    def _end(self, tick: int, stamp: int, status: Status, error: NodeExecutionError | None) -> None:
        results, halted = self._ticks.take(error)
        changes, self._changes = tuple(self._changes), []
        # The paths are in pre-order, like the nodes.
        statuses = {path: node._status for path, node in zip(self._paths.values(), self.tree, strict=True)}
        self.steps.append(
            TraceStep(tick, stamp, status, changes, results, halted, self._take_written(), statuses, error)
        )

    def _read_sequence_ids(self) -> dict[str, int]:
        return {key: entry.sequence_id for key, entry in self._all_entries()}

    def _all_entries(self) -> Iterator[tuple[str, Entry]]:
        for subtree in self.tree.subtrees:
            for key, entry in subtree.blackboard.local_entries().items():
                yield f"{subtree.path}/{key}" if subtree.path else key, entry

    def _take_written(self) -> dict[str, object]:
        before, self._entries = self._entries, self._read_sequence_ids()
        written: dict[str, object] = dict.fromkeys(key for key in before if key not in self._entries)
        for key, entry in self._all_entries():
            if entry.sequence_id != before.get(key, 0):
                written[key] = entry.value
        return written


def format_tree(tree: Tree, step: TraceStep | None = None) -> str:
    """Return a drawing of *tree*, with the status of each node at the end of *step* (default: now)."""
    keys = {node.config.uid: key for key, node in tree.nodes_by_path().items()}

    def label(node: TreeNode) -> list[Fragment]:
        path = keys[node.config.uid]
        status = node._status if step is None else step.statuses[path]
        results = step.results.get(path, ()) if step is not None else ()
        returned = f"  returned {' '.join(result.name for result in results)}" if results else ""
        name = node_label(node.name, node.config.id, node.spec.symbol, node.spec.node_type)
        return [*name, ("  ", ""), status_label(status), (returned, "")]

    return to_text(draw_branches(tree.root, lambda node: node.children, label))


def format_trace(trace: Trace, last: int = 5) -> str:
    """Return the *last* steps of *trace* as text, with their changes and writes, and then the tree."""
    trace.catch_up()
    steps = trace.steps[-last:]
    lines = [f"{len(trace) - len(steps)} steps before"] if len(trace) > len(steps) else []
    for step in steps:
        lines.append(str(step))
        lines += [f"    {change}" for change in step.changes]
        lines += [f"    {key} = {value!r}" for key, value in step.written.items()]
    lines.append(format_tree(trace.tree, steps[-1] if steps else None))
    return "\n".join(lines)
