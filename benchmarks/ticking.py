"""What a tick costs: btcore beside py_trees, and beside a bare loop that calls the same leaves.

    python benchmarks/ticking.py [--tree wide] [--leaves class] [--pairs 9] [--json]

bump-and-go is the book's first tree, 8 nodes, of which a tick executes 5; the way is free nine times,
then there is an obstacle. Leaves do next to nothing in all of them, so that what is measured is the
engine. *deep* has 8 levels of Sequences and Fallbacks (601 nodes), *reactive* 9 levels of reactive ones
(1,084), *wide* a Sequence with 100 leaves; in each of the three a tick executes every node.

Leaves come in three kinds. ``class`` and ``function`` are what users write, in Python, and have targets;
``built-in`` are the engine's own AlwaysSuccess and AlwaysFailure (py_trees' Success and Failure). Both
engines' leaves do the same work, and before anything is timed it is seen that both tick as many nodes
in every tick. py_trees is ticked by ``root.tick_once()``, the quickest way that it offers; btcore by
``tree.tick_once()``. The bare loop calls the leaves' ticks one after the other, and looks at each status.
"""

import btcore
from btcore import Tree
from measure import benchmark_trees
from measure.benchmark_trees import RUNNING, SUCCESS, Shape
from measure.paired_timing import SLICE, Spread, Work, measure
from measure.report import Report, Target, arguments, at_least, at_most, in_short

try:
    from measure import py_trees_trees
except ModuleNotFoundError as missing:
    if missing.name != "py_trees":
        raise
    py_trees_trees = None

CYCLES = {"bump-and-go": 14}
"""By tree: after how many ticks all begins anew; in the others each tick is like the one before."""
AS_FAST_AS_CPP = {
    "bump-and-go": at_least(1.5, compiled=24, pure=4),
    "deep": at_least(1.5, compiled=34, pure=4),
    "wide": at_least(1.5, compiled=34, pure=4),
    "reactive": at_least(pure=4),
}
"""By tree: how many times as fast as py_trees the C++ original is, and what the pure build is to reach."""
OVER_THE_LOOP = at_most(compiled=5)


def grow(shape: Shape, kind: str) -> Tree:
    """*shape* as a tree of btcore."""
    return btcore.loads(benchmark_trees.document(shape, kind), nodes=benchmark_trees.registry(kind))


def executed(shape: Shape, kind: str, ticks: int) -> float:
    """How many nodes a tick executes, on average over *ticks*; the same in both engines, tick by tick."""
    tree = grow(shape, kind)
    tallies = tree.count_ticks().values()
    root = py_trees_trees.grow(shape, kind) if py_trees_trees else None
    before = 0
    for _ in range(ticks):
        tree.tick_once()
        after = sum(tally.ticks for tally in tallies)
        if root is not None:
            theirs = len(list(root.tick()))
            assert theirs == after - before, f"py_trees ticks {theirs} nodes, btcore {after - before}"
        before = after
    return before / ticks


def bare_loop(tree: Tree, kind: str) -> Work:
    """A loop that calls the leaves of *tree*, all of which complete, and looks at what they return.

    For leaves of a class it calls their methods, for functions these themselves.
    """
    by_id = {"Succeed": benchmark_trees.succeed, "Fail": benchmark_trees.fail}
    leaves = [node for node in tree if not node.children]
    calls = [by_id[leaf.id] if kind == "function" else leaf.tick for leaf in leaves]

    def loop() -> object:
        for call in calls:
            if call() is RUNNING:
                return RUNNING
        return SUCCESS

    return loop


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--tree", choices=list(benchmark_trees.TREES), action="append", help="default: all of them"
    )
    parser.add_argument("--leaves", choices=benchmark_trees.KINDS, action="append", help="default: all kinds")
    given = parser.parse_args()
    report = Report("ticking", "What a tick costs, in ns for each node that it executes", given.pairs)
    if py_trees_trees is None:
        report.remarks.append("py_trees isn't installed; you can have it: pip install 'btcore[bench]'")
    for name in given.tree or benchmark_trees.TREES:
        shape = benchmark_trees.TREES[name]()
        for kind in benchmark_trees.kinds_of(shape):
            if kind in (given.leaves or benchmark_trees.KINDS):
                beside(report, name, shape, kind, quick=given.quick)
    report.output(given.json)


def beside(report: Report, name: str, shape: Shape, kind: str, quick: bool) -> None:
    """Tick *shape* with leaves of *kind*, and add what was measured to *report*."""
    nodes = executed(shape, kind, 2 * CYCLES.get(name, 1))
    tree = grow(shape, kind)
    works: dict[str, Work] = {"btcore": tree.tick_once}
    if py_trees_trees is not None:
        works["py_trees"] = py_trees_trees.grow(shape, kind).tick_once
    if name == "wide":
        works["a loop"] = bare_loop(tree, kind)
    taken = measure(works, report.pairs, slice_ns=1 if quick else SLICE)
    counted = kind != "built-in"

    def add(what: str, ratio: Spread, target: Target | None) -> None:
        figures = {who: in_short(taken.time(who).median / nodes) for who in works}
        report.add(f"{name}, {kind} leaves: {what}", ratio, target if counted else None, figures)

    if "py_trees" in works:
        add("py_trees / btcore", taken.ratio("py_trees", "btcore"), AS_FAST_AS_CPP[name])
    if "a loop" in works:
        add("btcore / the loop", taken.ratio("btcore", "a loop"), OVER_THE_LOOP)


if __name__ == "__main__":
    main()
