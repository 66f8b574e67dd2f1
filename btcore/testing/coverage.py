"""Tree coverage: which nodes ran, and which of their results were seen.

coverage = Coverage()
coverage.watch(tree)            # any number of trees; the same tree loaded again adds up
...
print(coverage.report())
coverage.require(nodes=1.0, results=0.8)
"""

from dataclasses import dataclass, field

from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeType, Status
from btcore.testing.trace import ResultTracker
from btcore.tree.tree import Tree
from btcore.xml.lint.possible_results import behaviour_of


@dataclass(slots=True)
class NodeCoverage:
    """What was seen of one node: *results* are all that its ticks gave, also RUNNING and SKIPPED.

    *depth* is its level below the root. The results that a test is to show are *wanted*: SUCCESS and
    FAILURE, except for nodes whose class declares that they end in one way only.
    """

    path: str
    id: str
    type: NodeType
    depth: int
    results: set[Status] = field(default_factory=set)
    possible_results: frozenset[Status] = frozenset({SUCCESS, FAILURE})

    @property
    def ran(self) -> bool:
        """Whether it was ticked, and not only skipped."""
        return bool(self.results - {SKIPPED})

    @property
    def missing_results(self) -> list[Status]:
        """The wanted results that weren't seen."""
        return sorted(self.possible_results - self.results)


class Coverage:
    """What the ticks of trees have shown; *trees* maps their IDs to what was seen of each node, by path."""

    def __init__(self) -> None:
        self.trees: dict[str, dict[str, NodeCoverage]] = {}

    def watch(self, tree: Tree) -> None:
        """Count what *tree* does from now on."""
        known = self.trees.setdefault(tree.id, {})
        depths = _depths(tree)
        for key, node in tree.nodes_by_path().items():
            ends = behaviour_of(type(node)).may_return & {SUCCESS, FAILURE}
            known.setdefault(key, NodeCoverage(key, node.id, node.type, depths[node.uid], set(), ends))
        tree.subscribe(_Watch(tree, known))

    @property
    def all_nodes(self) -> list[NodeCoverage]:
        """What was seen of every node of every tree."""
        return [one for nodes in self.trees.values() for one in nodes.values()]

    @property
    def nodes(self) -> float:
        """The share (0–1) of nodes that ran; 1 if there is none."""
        return _share(sum(one.ran for one in self.all_nodes), len(self.all_nodes))

    @property
    def results(self) -> float:
        """The share (0–1) of results that were seen, of those that the nodes can end with."""
        wanted = sum(len(one.possible_results) for one in self.all_nodes)
        return _share(wanted - sum(len(one.missing_results) for one in self.all_nodes), wanted)

    def report(self) -> str:
        """A line a node: R, S, F, K for the results seen (running … skipped), · for what is missing."""
        lines = []
        for id, nodes in self.trees.items():
            ran = sum(one.ran for one in nodes.values())
            lines.append(f"{id}: {ran} of {len(nodes)} nodes ran")
            lines += [f"  {_marks(one)}  {'  ' * one.depth}{_named(one)}" for one in nodes.values()]
        lines.append(f"nodes {self.nodes:.0%}, results {self.results:.0%}")
        return "\n".join(lines)

    def require(self, nodes: float = 1.0, results: float = 0.0) -> None:
        """Raise AssertionError, with the report, where less than these shares (0–1) was seen."""
        short = [
            f"{share:.0%} of the {what}, and {least:.0%} are required"
            for what, share, least in (
                ("nodes ran", self.nodes, nodes),
                ("results were seen", self.results, results),
            )
            if share < least
        ]
        if short:
            raise AssertionError(f"tree coverage: {'; '.join(short)}\n{self.report()}")


class _Watch(Observer):
    """Notes the results of one tree's ticks in *known*."""

    def __init__(self, tree: Tree, known: dict[str, NodeCoverage]) -> None:
        self.ticks = ResultTracker(tree)
        self.known = known

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Note them."""
        self.note(None)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Note those of the nodes that did not raise."""
        self.note(error)

    def note(self, error: NodeExecutionError | None) -> None:
        """Note what the last tick gave."""
        for key, results in self.ticks.take(error)[0].items():
            self.known[key].results.update(results)


def _depths(tree: Tree) -> dict[int, int]:
    depths = {tree.root.uid: 0}
    for node in tree:
        for child in node.children:
            depths[child.uid] = depths[node.uid] + 1
    return depths


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0


def _marks(one: NodeCoverage) -> str:
    letters = {RUNNING: "R", SUCCESS: "S", FAILURE: "F", SKIPPED: "K"}
    return "".join(
        letter if status in one.results else "·" if status in one.possible_results else " "
        for status, letter in letters.items()
    )


def _named(one: NodeCoverage) -> str:
    name = one.path.rpartition("/")[2]
    named = one.id if name.startswith(f"{one.id}::") else f"{one.id} '{name}'"
    return named if one.ran else f"{named}  (never ran)"
