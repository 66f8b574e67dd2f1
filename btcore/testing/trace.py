"""What happened in a tree, tick by tick."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import sub

from btcore.clock import NS_PER_S
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status, Transition
from btcore.tree.tree import Tree


@dataclass(frozen=True, slots=True)
class StatusChange:
    """The stored status of the node at *path* changed."""

    path: str
    previous: Status
    status: Status

    def __str__(self) -> str:
        return f"{self.path}: {self.previous.name} → {self.status.name}"


@dataclass(frozen=True, slots=True)
class TraceStep:
    """One tick of the root, or what lay between two of them (then *tick* is 0 and *status* IDLE).

    *stamp* is the clock's time (ns) at its end. *results* maps the paths of the nodes that were ticked to
    what each tick gave, in pre-order; a tick that raised gave nothing. *halted* are those that were halted
    while they ran. *written* maps the keys written to what they hold at the end (None = removed), those of
    a subtree's blackboard as ``subtree path/key``. *statuses* are all nodes' at the end. Paths are full
    ones, with ``#uid`` appended where they are equal.
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
        said = f"raised {self.error.path}" if self.error is not None else self.status.name
        return f"tick {self.tick}, {at}: {said}"


class ResultTracker:
    """Tells which nodes of *tree* were ticked since it was last asked, and what they gave."""

    def __init__(self, tree: Tree) -> None:
        self._tallies = tree.count_ticks()
        self._before = {key: self._counts(key) for key in self._tallies}

    def _counts(self, key: str) -> tuple[int, int, int, int, int]:
        one = self._tallies[key]
        return one.ticks, one.success, one.failure, one.skipped, one.halted

    def take(
        self, error: NodeExecutionError | None = None
    ) -> tuple[dict[str, tuple[Status, ...]], tuple[str, ...]]:
        """The results by path, and the paths of what was halted. *error* is what ended the last tick."""
        results: dict[str, tuple[Status, ...]] = {}
        halted = []
        for key, before in self._before.items():
            now = self._counts(key)
            if now == before:
                continue
            self._before[key] = now
            ticks, success, failure, skipped, halts = map(sub, now, before)
            if halts:
                halted.append(key)
            if ticks:
                raised = error is not None and key in error.backtrace
                running = ticks - success - failure - skipped - raised
                results[key] = (
                    (FAILURE,) * failure + (SUCCESS,) * success + (SKIPPED,) * skipped + (RUNNING,) * running
                )
        return results, tuple(halted)


class Trace(Observer):
    """The steps of *tree* from now on, in order. Iterate it, or index it: ``trace[-1]`` is the last step."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.steps: list[TraceStep] = []
        self._paths = {node.uid: key for key, node in tree.nodes_by_path().items()}
        self._ticks = ResultTracker(tree)
        self._changes: list[StatusChange] = []
        self._entries = self._sequence_ids()
        self.unsubscribe = tree.subscribe(self)

    def __iter__(self) -> Iterator[TraceStep]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, index: int) -> TraceStep:
        return self.steps[index]

    def path(self, node: str) -> str:
        """The path in this trace of the *node* with that path or name. Raises BtcoreError."""
        return self._paths[self.tree.node(node).uid]

    def results(self, node: str) -> list[Status]:
        """What the ticks of *node* gave, in order; those of one tick of the root by status."""
        path = self.path(node)
        return [status for step in self.steps for status in step.results.get(path, ())]

    def transition(self, change: Transition) -> None:
        """Keep it for the step's end."""
        self._changes.append(StatusChange(self._paths[change.uid], change.previous, change.status))

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """End the step."""
        self._end(tick, stamp, status, None)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """End the step; that the tree is halted comes in the next."""
        self._end(self.tree.ticks, stamp, IDLE, error)

    def catch_up(self) -> None:
        """Make a step of what happened since the last tick, if anything did: the tree was halted, say."""
        if self._changes:
            self._end(0, self.tree.clock.now(), IDLE, None)

    def _end(self, tick: int, stamp: int, status: Status, error: NodeExecutionError | None) -> None:
        results, halted = self._ticks.take(error)
        changes, self._changes = tuple(self._changes), []
        statuses = {path: node.status for path, node in zip(self._paths.values(), self.tree, strict=True)}
        self.steps.append(
            TraceStep(tick, stamp, status, changes, results, halted, self._written(), statuses, error)
        )

    def _sequence_ids(self) -> dict[str, int]:
        return {
            f"{subtree.path}/{key}" if subtree.path else key: entry.sequence_id
            for subtree in self.tree.subtrees
            for key, entry in subtree.blackboard.local_entries().items()
        }

    def _written(self) -> dict[str, object]:
        before, self._entries = self._entries, self._sequence_ids()
        written: dict[str, object] = {key: None for key in before if key not in self._entries}
        for subtree in self.tree.subtrees:
            for key, entry in subtree.blackboard.local_entries().items():
                name = f"{subtree.path}/{key}" if subtree.path else key
                if entry.sequence_id != before.get(name, 0):
                    written[name] = entry.value
        return written


def format_tree(tree: Tree, step: TraceStep | None = None) -> str:
    """*tree* as text, a line a node: its status at the end of *step* (default: now), and what it gave."""
    keys = {node.uid: key for key, node in tree.nodes_by_path().items()}
    lines: list[str] = []
    pending: list[tuple[TreeNode, int]] = [(tree.root, 0)]
    while pending:
        node, depth = pending.pop()
        path = keys[node.uid]
        status = node.status if step is None else step.statuses[path]
        name = node.id if node.name == node.id else f"{node.id} '{node.name}'"
        gave = step.results.get(path, ()) if step is not None else ()
        told = f"  gave {' '.join(one.name for one in gave)}" if gave else ""
        lines.append(f"{'  ' * depth}{name}  {status.name}{told}")
        pending += ((child, depth + 1) for child in reversed(node.children))
    return "\n".join(lines)


def format_trace(trace: Trace, last: int = 5) -> str:
    """The *last* steps of *trace* as text: what changed and was written in each, then the whole tree."""
    trace.catch_up()
    steps = trace.steps[-last:]
    lines = [f"{len(trace) - len(steps)} steps before"] if len(trace) > len(steps) else []
    for step in steps:
        lines.append(str(step))
        lines += [f"    {change}" for change in step.changes]
        lines += [f"    {key} = {value!r}" for key, value in step.written.items()]
    lines.append(format_tree(trace.tree, steps[-1] if steps else None))
    return "\n".join(lines)
