"""The cost of a tick: btcore compared with py_trees, and with a bare loop that calls the same leaves.

    python benchmarks/ticking.py [--tree wide] [--leaves class] [--pairs 9] [--quick] [--json]

*bump-and-go* is the first tree of the book "A Concise Introduction to Robot Programming with ROS2". It has 8
nodes, of which a tick executes about 5; the way is free in nine ticks, then there is an obstacle. *deep* has
8 levels of Sequences and Fallbacks (601 nodes), *reactive* has 9 levels of reactive control nodes (1,084
nodes), and *wide* is a Sequence of 100 leaves; a tick of these three executes every node. All leaves do
almost nothing, so that the benchmark measures the engine.

There are three kinds of leaves. ``class`` and ``function`` are written in Python, as users do, and have
targets; ``built-in`` are the engine's AlwaysSuccess and AlwaysFailure (Success and Failure in py_trees). The
leaves of both engines do the same work, and the benchmark checks that both engines tick the same number of
nodes in every tick. py_trees is ticked by ``root.tick_once()``, its fastest function, and btcore by
``tree.tick_once()``. The bare loop calls the leaves one after the other, and checks each status.
"""

from importlib import import_module
from importlib.util import find_spec

import btcore
from btcore import Tree
from measure import benchmark_trees
from measure.benchmark_trees import RUNNING, SUCCESS, Shape
from measure.paired_timing import SLICE, Spread, Work, measure
from measure.report import NO_PY_TREES, Report, Target, at_least, at_most, create_parser, in_short

py_trees_trees = import_module("measure.py_trees_trees") if find_spec("py_trees") else None

CYCLES = {"bump-and-go": 14}
"""The number of ticks after which the behavior of a tree repeats; in other trees all ticks are the same."""
AS_FAST_AS_CPP = {
    "bump-and-go": at_least(aim=1.5, compiled=24, pure=4),
    "deep": at_least(aim=1.5, compiled=34, pure=4),
    "wide": at_least(aim=1.5, compiled=34, pure=4),
    "reactive": at_least(pure=4),
}
"""The targets by tree. For the compiled build, this is the speed of BehaviorTree.CPP relative to py_trees.

BehaviorTree.CPP was not measured with *reactive*, so that the compiled build has no target there.
"""
OVER_THE_LOOP = at_most(compiled=5)


def create_tree(shape: Shape, kind: str) -> Tree:
    """Return *shape* as a tree of btcore, with leaves of *kind*."""
    return btcore.loads(benchmark_trees.document(shape, kind), nodes=benchmark_trees.registry(kind))


def count_executed_nodes(shape: Shape, kind: str, ticks: int) -> float:
    """Return the mean number of nodes that a tick executes, and check that both engines tick as many.

    Args:
        shape: The tree.
        kind: The kind of leaves.
        ticks: The number of ticks.
    """
    tree = create_tree(shape, kind)
    counts = tree.start_tick_counts().values()  # in a tree that is not measured
    root = py_trees_trees.create_tree(shape, kind) if py_trees_trees else None
    before = 0
    for _ in range(ticks):
        tree.tick_once()
        after = sum(count.ticks for count in counts)
        if root is not None:
            expected = len(list(root.tick()))
            assert expected == after - before, f"py_trees ticks {expected} nodes, btcore {after - before}"
        before = after
    return before / ticks


def bare_loop(tree: Tree, kind: str) -> Work:
    """Return a function that calls the leaves of *tree* in a loop, and checks that no result is RUNNING.

    Leaves that are classes are called by their method ``tick``, leaves that are functions directly.
    """
    functions = benchmark_trees.FUNCTIONS
    leaves = [node for node in tree if not node.children]
    calls = [functions[leaf.id] if kind == "function" else leaf.tick for leaf in leaves]

    def loop() -> object:
        for call in calls:
            if call() is RUNNING:
                return RUNNING
        return SUCCESS

    return loop


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "")
    parser.add_argument(
        "--tree", choices=list(benchmark_trees.TREES), action="append", help="default: all trees"
    )
    parser.add_argument("--leaves", choices=benchmark_trees.KINDS, action="append", help="default: all kinds")
    options = parser.parse_args()
    report = Report("ticking", "The cost of a tick, in ns for each node that it executes", options.pairs)
    if py_trees_trees is None:
        report.remarks.append(NO_PY_TREES)
    for name in options.tree or benchmark_trees.TREES:
        shape = benchmark_trees.TREES[name]()
        for kind in benchmark_trees.kinds_of(shape):
            if kind in (options.leaves or benchmark_trees.KINDS):
                compare(report, name, shape, kind, quick=options.quick)
    report.output(options.json)


def compare(report: Report, name: str, shape: Shape, kind: str, quick: bool) -> None:
    """Measure the tree *name* with leaves of *kind*, and add rows to *report*."""
    nodes = count_executed_nodes(shape, kind, 2 * CYCLES.get(name, 1))
    tree = create_tree(shape, kind)
    works: dict[str, Work] = {"btcore": tree.tick_once}
    if py_trees_trees is not None:
        works["py_trees"] = py_trees_trees.create_tree(shape, kind).tick_once
    if name == "wide":
        works["a loop"] = bare_loop(tree, kind)
    taken = measure(works, report.pairs, slice_ns=1 if quick else SLICE)

    def add(label: str, ratio: Spread, target: Target | None) -> None:
        figures = {engine: in_short(taken.time(engine).median / nodes) for engine in works}
        target = target if kind != "built-in" else None
        report.add(f"{name}, {kind} leaves: {label}", ratio, target, figures)

    if "py_trees" in works:
        add("py_trees / btcore", taken.ratio("py_trees", "btcore"), AS_FAST_AS_CPP[name])
    if "a loop" in works:
        add("btcore / the loop", taken.ratio("btcore", "a loop"), OVER_THE_LOOP)


if __name__ == "__main__":
    main()
