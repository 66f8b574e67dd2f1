"""How costs grow: with the nodes of a tree, with its depth, and with the entries of a blackboard.

    python benchmarks/growth.py [--pairs 9] [--nodes 100 1000 …] [--depths 10 100 …] [--entries 10 100 …]
        [--quick] [--json]

Each ratio is the cost per item (a node that is ticked or loaded, a level that is ticked, an entry that is
read and written) at the size of the row, divided by the cost per item at the smallest size: 1 means that the
cost per item does not depend on the size. The sizes are measured in turns, as other benchmarks measure the
programs that they compare. Data that exceed the processor's caches slow down every program; a plain dict of
the same size shows by how much.

Trees with many nodes are Sequences of up to 10 children, whose leaves are a class written in Python. Deep
trees are chains of nested subtrees, and chains of Inverters that a Builder creates, since XML elements can be
nested up to 256 levels only, as in BehaviorTree.CPP. A tree has at most 65,535 nodes: larger sizes are
divided into several trees, which are ticked one after the other.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle
from random import Random

import btcore
from btcore import Blackboard, Builder, Registry, Tree
from btcore.engine.node_config import MAX_NODES
from measure.benchmark_trees import Succeed
from measure.loading_cost import allocated_bytes, loading_time
from measure.paired_timing import SLICE, Measured, Spread, Work, measure, measure_rounds
from measure.report import Report, create_parser, in_short

NODES = (10, 100, 1_000, 10_000, 100_000)
DEPTHS = (10, 100, 1_000, 2_000)
ENTRIES = (10, 100, 1_000, 10_000, 100_000)
BRANCHES = 10
LOADED_AT_LEAST = 1_000
"""The smallest number of nodes whose loading is measured: for fewer nodes, fixed costs dominate."""


def bushy_document(size: int) -> str:
    """Return an XML document whose tree has *size* nodes: Sequences of up to 10 children, and leaves."""

    def grow(nodes: int) -> str:
        if nodes == 1:
            return "<Succeed/>"
        shares = min(BRANCHES, nodes - 1)
        share, more = divmod(nodes - 1, shares)
        inside = (grow(share + (index < more)) for index in range(shares))
        return f"<Sequence>{''.join(inside)}</Sequence>"

    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{grow(size)}</BehaviorTree></root>'


def nested_subtrees(depth: int) -> Tree:
    """Return a chain of *depth* nested subtrees."""
    trees = [
        f'<BehaviorTree ID="T{level}"><SubTree ID="T{level + 1}"/></BehaviorTree>' for level in range(depth)
    ]
    trees.append(f'<BehaviorTree ID="T{depth}"><AlwaysSuccess/></BehaviorTree>')
    return btcore.loads(
        f'<root BTCPP_format="4" main_tree_to_execute="T0">{"".join(trees)}</root>', nodes=registry()
    )


def nested_inverters(depth: int) -> Tree:
    """Return a chain of *depth* Inverters that is built in code."""
    builder = Builder(registry())
    node = builder.AlwaysSuccess()
    for _ in range(depth - 1):
        node = builder.Inverter(node)
    return builder.build(node)


def registry() -> Registry:
    """Return a registry with Succeed, the leaf of the trees."""
    nodes = Registry.standard()
    nodes.add(Succeed)
    return nodes


def board(entries: int) -> Work:
    """Return a function that reads and writes an entry of a blackboard; each call uses the next entry."""
    blackboard = Blackboard()
    for key in (keys := shuffled_keys(entries)):
        blackboard[key] = 0
    steps = cycle(keys)

    # Each call uses another entry, because a single entry would stay in the processor's cache.
    def work() -> None:
        key = next(steps)
        blackboard[key] = blackboard[key]

    return work


def plain_dict(entries: int) -> Work:
    """Return the counterpart of `board` for a dict of lists; a blackboard also wraps values in objects."""
    keys = shuffled_keys(entries)
    boxes: dict[str, list[object]] = {key: [0] for key in keys}
    steps = cycle(keys)

    def work() -> None:
        key = next(steps)
        boxes[key][0] = boxes[key][0]

    return work


def shuffled_keys(entries: int) -> list[str]:
    """Return *entries* keys in random order, which differs from their order in memory."""
    keys = [f"key_{number}" for number in range(entries)]
    Random(0).shuffle(keys)
    return keys


class TreeGroup:
    """As few trees as possible that have *size* nodes together, since a tree has at most 65,535 nodes."""

    def __init__(self, size: int) -> None:
        trees = -(-size // MAX_NODES)
        share, more = divmod(size, trees)
        self.size = size
        self.texts = [bushy_document(share + (number < more)) for number in range(trees)]

    @property
    def name(self) -> str:
        """The size as text."""
        words = f"{self.size:,} nodes"
        return words if len(self.texts) == 1 else f"{words} in {len(self.texts)} trees"

    def load(self, nodes: Registry) -> list[Tree]:
        """Load the trees."""
        return [btcore.loads(text, nodes=nodes) for text in self.texts]

    def ticked(self, nodes: Registry) -> Work:
        """Return a function that ticks all trees, one after the other."""
        ticks = [tree.tick_once for tree in self.load(nodes)]
        if len(ticks) == 1:
            return ticks[0]

        def tick() -> None:
            for tick_tree in ticks:
                tick_tree()

        return tick


def add_node_rows(report: Report, sizes: Sequence[int], slice_ns: int) -> None:
    """Add rows about the time for ticking and for loading a node, and about its memory."""
    nodes = registry()
    groups = [TreeGroup(size) for size in sizes]
    ticking = measure({str(group.size): group.ticked(nodes) for group in groups}, report.pairs, 4, slice_ns)
    large = [group for group in groups if group.size >= LOADED_AT_LEAST] or groups[-1:]
    loads = {str(group.size): partial(group.load, nodes) for group in large}
    loading = measure_rounds([loads] * report.pairs, loading_time, warm_up=0)
    add_rows(report, "node ticked, {}", {group.name: group.size for group in groups}, ticking, "ns")
    add_rows(report, "node loaded, {}", {group.name: group.size for group in large}, loading, "µs")
    memory = [allocated_bytes(loads[str(group.size)]) / group.size for group in large]
    for group, size in zip(large, memory, strict=True):
        figures = {"one": f"{size:,.0f} B"}
        report.add(f"memory of a node, {group.name}", Spread.of([size / memory[0]]), None, figures)


def add_depth_rows(
    report: Report, label: str, depths: Sequence[int], grow: Callable[[int], Tree], slice_ns: int
) -> None:
    """Add rows about the time for ticking a level of a deep tree."""
    works: dict[str, Work] = {str(depth): grow(depth).tick_once for depth in depths}
    measured = measure(works, report.pairs, 4, slice_ns)
    add_rows(report, "level ticked, {}", {f"{depth:,} {label}": depth for depth in depths}, measured, "ns")


def add_rows(report: Report, label: str, sizes: Mapping[str, int], measured: Measured, unit: str) -> None:
    """Add a row for each of *sizes*: the time per node or level.

    Args:
        report: The report.
        label: The name of the rows, with ``{}`` for the text in *sizes*.
        sizes: The number of nodes or levels, by the text for the row.
        measured: The measured times, by the number of nodes or levels (as text).
        unit: The unit of the time per node or level.
    """
    ns = {"ns": 1, "µs": 1000}[unit]
    first = next(iter(sizes.values()))
    for name, size in sizes.items():
        ratio = measured.ratio(str(size), str(first)).times(first / size)
        each = measured.time(str(size)).median / size / ns
        report.add(label.format(name), ratio, None, {"one": f"{in_short(each)} {unit}"})


def add_entry_rows(report: Report, sizes: Sequence[int], slice_ns: int) -> None:
    """Add rows about the time for reading and writing an entry of a blackboard, and of a dict."""
    works = {
        f"{board_class.__name__} {size}": board_class(size)
        for size in sizes
        for board_class in (board, plain_dict)
    }
    measured = measure(works, report.pairs, slice_ns=slice_ns)
    for size in sizes:
        figures = {
            column: f"{in_short(measured.time(f'{board_name} {size}').median)} ns"
            for column, board_name in (("one", "board"), ("a dict's", "plain_dict"))
        }
        ratio = measured.ratio(f"board {size}", f"board {sizes[0]}")
        report.add(f"entry read and written, {size:,} entries", ratio, None, figures)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "")
    parser.add_argument("--nodes", type=int, nargs="+", default=NODES)
    parser.add_argument("--depths", type=int, nargs="+", default=DEPTHS)
    parser.add_argument("--entries", type=int, nargs="+", default=ENTRIES)
    options = parser.parse_args()
    report = Report("growth", "How costs grow with the size of trees and of blackboards", options.pairs)
    slice_ns = SLICE
    if options.quick:
        options.nodes, options.depths, options.entries, slice_ns = (10, 100), (10, 100), (10, 100), 1
    add_node_rows(report, options.nodes, slice_ns)
    add_depth_rows(report, "nested subtrees", options.depths, nested_subtrees, slice_ns)
    add_depth_rows(report, "Inverters built in code", options.depths, nested_inverters, slice_ns)
    add_entry_rows(report, options.entries, slice_ns)
    report.output(options.json)


if __name__ == "__main__":
    main()
