"""Tree coverage: the nodes that ran, and the results that they returned.

Trees add their nodes to a Coverage:

    coverage = Coverage()
    coverage.watch(tree)            # any number of trees; several loads of the same tree are added up
    ...
    print(coverage.report())
    coverage.require(nodes=1.0, results=0.8)
"""

from dataclasses import dataclass, field

from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.lint.possible_results import behaviour_of
from btcore.registry.outcome_grammar import LETTERS
from btcore.status import FAILURE, SKIPPED, SUCCESS, Status
from btcore.testing.trace import ResultTracker
from btcore.tree.drawing import node_depths
from btcore.tree.tree import Tree


@dataclass(slots=True)
class NodeCoverage:
    """The coverage of a node.

    Attributes:
        path: The full path.
        id: The registration ID.
        depth: The number of levels below the root; 0 for the root.
        results: The results that its ticks have returned, including RUNNING and SKIPPED.
        possible_results: The results that tests should cover: SUCCESS and FAILURE, unless the node's class
            declares that it returns only one of them.
    """

    path: str
    id: str
    depth: int
    results: set[Status] = field(default_factory=set)
    possible_results: frozenset[Status] = frozenset({SUCCESS, FAILURE})

    @property
    def ran(self) -> bool:
        """Whether the node was ticked and not only skipped."""
        return bool(self.results - {SKIPPED})

    @property
    def missing_results(self) -> list[Status]:
        """The possible results that no tick returned."""
        return sorted(self.possible_results - self.results)


class Coverage:
    """The coverage of trees.

    Attributes:
        trees: For each ID of a tree, the coverage of the nodes by path.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Coverage
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Fallback(b.AlwaysSuccess(name="door"), b.AlwaysSuccess(name="window")))
        >>> coverage = Coverage()
        >>> coverage.watch(tree)
        >>> _ = tree.tick_once()
        >>> coverage.nodes
        0.6666666666666666
    """

    def __init__(self) -> None:
        self.trees: dict[str, dict[str, NodeCoverage]] = {}

    def watch(self, tree: Tree) -> None:
        """Record the results of the nodes of *tree* from now on."""
        known = self.trees.setdefault(tree.id, {})
        depths = node_depths(tree)
        for key, node in tree.nodes_by_path().items():
            ends = behaviour_of(type(node)).spec.results & {SUCCESS, FAILURE}
            # Another load of the same tree adds its results to the existing nodes.
            known.setdefault(key, NodeCoverage(key, node.config.id, depths[node.config.uid], set(), ends))
        tree.subscribe(_Watch(tree, known))

    @property
    def all_nodes(self) -> list[NodeCoverage]:
        """The coverage of all nodes of all trees."""
        return [node for nodes in self.trees.values() for node in nodes.values()]

    @property
    def nodes(self) -> float:
        """The fraction (0–1) of nodes that ran; 1 without nodes."""
        return _share(sum(node.ran for node in self.all_nodes), len(self.all_nodes))

    @property
    def results(self) -> float:
        """The fraction (0–1) of the possible results that were returned; 1 without nodes."""
        possible = sum(len(node.possible_results) for node in self.all_nodes)
        return _share(possible - sum(len(node.missing_results) for node in self.all_nodes), possible)

    def report(self) -> str:
        """Return a line for each node, with letters for its results and · for missing results.

        The letters are R (RUNNING), S (SUCCESS), F (FAILURE) and K (SKIPPED).
        """
        lines = []
        for id, nodes in self.trees.items():
            ran = sum(node.ran for node in nodes.values())
            lines.append(f"{id}: {ran} of {len(nodes)} nodes ran")
            lines += [
                f"  {_format_results(node)}  {'  ' * node.depth}{_format_label(node)}"
                for node in nodes.values()
            ]
        lines.append(f"nodes {self.nodes:.0%}, results {self.results:.0%}")
        return "\n".join(lines)

    def require(self, nodes: float = 1.0, results: float = 0.0) -> None:
        """Check that the coverage is sufficient.

        Args:
            nodes: The required fraction (0–1) of nodes that ran.
            results: The required fraction (0–1) of results that were returned.

        Raises:
            AssertionError: The coverage is lower; the message contains the report.
        """
        problems = []
        if self.nodes < nodes:
            problems.append(f"{self.nodes:.0%} of the nodes ran, {nodes:.0%} are required")
        if self.results < results:
            problems.append(f"{self.results:.0%} of the results were returned, {results:.0%} are required")
        if problems:
            raise AssertionError(f"tree coverage: {'; '.join(problems)}\n{self.report()}")


class _Watch(Observer):
    def __init__(self, tree: Tree, known: dict[str, NodeCoverage]) -> None:
        self.ticks = ResultTracker(tree)
        self.known = known

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        self.record(None)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        self.record(error)

    def record(self, error: NodeExecutionError | None) -> None:
        for key, results in self.ticks.take(error)[0].items():
            self.known[key].results.update(results)


def _share(part: int, total: int) -> float:
    return part / total if total else 1.0


def _format_results(node: NodeCoverage) -> str:
    return "".join(
        letter if status in node.results else "·" if status in node.possible_results else " "
        for letter, status in LETTERS.items()
    )


def _format_label(node: NodeCoverage) -> str:
    name = node.path.rpartition("/")[2]
    label = node.id if name.startswith(f"{node.id}::") else f"{node.id} '{name}'"
    return label if node.ran else f"{label}  (never ran)"
