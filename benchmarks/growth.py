"""How costs grow: with the nodes of a tree, with its depth, and with the entries of a blackboard.

    python benchmarks/growth.py [--pairs 9] [--nodes 100 1000 …] [--depths 10 100 …] [--entries 10 100 …]

Every ratio is the cost of one (one node ticked or loaded, one level ticked, one entry read and written) in
the size that the row names over the cost of one in the first, smallest size of its kind: 1 means that size
doesn't matter. Sizes take turns, as contenders do in the other benchmarks. Where memory is larger than the
processor's caches everything takes longer; how much, a plain dict beside the blackboard tells.

Trees of many nodes are Sequences of up to 10 children, with leaves of a class written in Python. Deep ones
are chains: of subtrees, each inside the one before, and of Inverters made in code by a Builder. A document's
own elements nest to 256 at most, as the original's do, so that depth comes in these two ways. A tree has
65,535 nodes at most: more are in several trees, ticked one after the other.
"""

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle
from random import Random

import btcore
from btcore import Blackboard, Builder, Registry, Tree
from btcore.tree.tree import MAX_NODES
from measure.benchmark_trees import Succeed
from measure.memory import bytes_kept
from measure.paired_timing import SLICE, Measured, Spread, Work, measure
from measure.report import Report, arguments, in_short

NODES = (10, 100, 1_000, 10_000, 100_000)
DEPTHS = (10, 100, 1_000, 2_000)
ENTRIES = (10, 100, 1_000, 10_000, 100_000)
BRANCHES = 10
LOADED_AT_LEAST = 1_000
"""Nodes: below, a load's fixed part hides what a node costs."""


def bushy(size: int) -> str:
    """A document whose tree has *size* nodes."""

    def grow(room: int) -> str:
        if room == 1:
            return "<Succeed/>"
        shares = min(BRANCHES, room - 1)
        share, more = divmod(room - 1, shares)
        inside = (grow(share + (index < more)) for index in range(shares))
        return f"<Sequence>{''.join(inside)}</Sequence>"

    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{grow(size)}</BehaviorTree></root>'


def nested(depth: int) -> Tree:
    """A chain of *depth* subtrees."""
    trees = [
        f'<BehaviorTree ID="T{level}"><SubTree ID="T{level + 1}"/></BehaviorTree>' for level in range(depth)
    ]
    trees.append(f'<BehaviorTree ID="T{depth}"><AlwaysSuccess/></BehaviorTree>')
    return btcore.loads(
        f'<root BTCPP_format="4" main_tree_to_execute="T0">{"".join(trees)}</root>', nodes=registry()
    )


def built(depth: int) -> Tree:
    """A chain of *depth* Inverters, made in code."""
    builder = Builder(registry())
    twig = builder.AlwaysSuccess()
    for _ in range(depth - 1):
        twig = builder.Inverter(twig)
    return builder.build(twig)


def registry() -> Registry:
    """Nodes with the leaf that is used."""
    nodes = Registry.standard()
    nodes.add(Succeed)
    return nodes


def board(entries: int) -> Work:
    """One entry of so many is read and written, another one each time."""
    blackboard = Blackboard()
    for key in (keys := keys_of(entries)):
        blackboard[key] = 0
    steps = cycle(keys)

    def work() -> None:
        key = next(steps)
        blackboard[key] = blackboard[key]

    return work


def plain_dict(entries: int) -> Work:
    """The same with a dict whose values lie in objects of their own, as entries do."""
    boxes: dict[str, list[object]] = {}
    for key in (keys := keys_of(entries)):
        boxes[key] = [0]
    steps = cycle(keys)

    def work() -> None:
        key = next(steps)
        boxes[key][0] = boxes[key][0]

    return work


def keys_of(entries: int) -> list[str]:
    """So many keys, not in the order in which they lie in memory."""
    keys = [f"key_{number}" for number in range(entries)]
    Random(0).shuffle(keys)
    return keys


def loading_time(load: Callable[[], object]) -> int:
    """What loading takes (ns of processor time), with the look of Python's collector that it puts off."""
    gc.collect()
    start = time.process_time_ns()
    trees = load()
    gc.collect(0)
    taken = time.process_time_ns() - start
    del trees
    return taken


class TreeGroup:
    """So many nodes, in the fewest trees: a tree has 65,535 at most, since their numbers have 16 bits."""

    def __init__(self, size: int) -> None:
        trees = -(-size // MAX_NODES)
        share, more = divmod(size, trees)
        self.size = size
        self.texts = [bushy(share + (number < more)) for number in range(trees)]

    @property
    def name(self) -> str:
        """The size, in words."""
        words = f"{self.size:,} nodes"
        return words if len(self.texts) == 1 else f"{words} in {len(self.texts)} trees"

    def load(self, nodes: Registry) -> list[Tree]:
        """Its trees."""
        return [btcore.loads(text, nodes=nodes) for text in self.texts]

    def ticked(self, nodes: Registry) -> Work:
        """What ticks all its trees, one after the other."""
        ticks = [tree.tick_once for tree in self.load(nodes)]
        if len(ticks) == 1:
            return ticks[0]

        def tick() -> None:
            for one in ticks:
                one()

        return tick


def with_nodes(report: Report, sizes: Sequence[int], slice_ns: int) -> None:
    """Ticking, loading and memory of a node, by how many there are."""
    nodes = registry()
    groves = [TreeGroup(size) for size in sizes]
    ticking = measure({str(grove.size): grove.ticked(nodes) for grove in groves}, report.pairs, 4, slice_ns)
    large = [grove for grove in groves if grove.size >= LOADED_AT_LEAST] or groves[-1:]
    rounds: dict[str, list[float]] = {str(grove.size): [] for grove in large}
    for _ in range(report.pairs):
        for grove in large:
            rounds[str(grove.size)].append(loading_time(partial(grove.load, nodes)))
    add(report, "node ticked, {}", {grove.name: grove.size for grove in groves}, ticking, "ns")
    add(report, "node loaded, {}", {grove.name: grove.size for grove in large}, Measured(rounds), "µs")
    kept = [bytes_kept(partial(grove.load, nodes)) / grove.size for grove in large]
    for grove, weight in zip(large, kept, strict=True):
        figures = {"one": f"{weight:,.0f} B"}
        report.add(f"memory of a node, {grove.name}", Spread.of([weight / kept[0]]), None, figures)


def with_depth(
    report: Report, what: str, depths: Sequence[int], grow: Callable[[int], Tree], slice_ns: int
) -> None:
    """Ticking a level, by how many there are."""
    works: dict[str, Work] = {str(depth): grow(depth).tick_once for depth in depths}
    taken = measure(works, report.pairs, 4, slice_ns)
    add(report, "level ticked, {}", {f"{depth:,} {what}": depth for depth in depths}, taken, "ns")


def add(report: Report, what: str, sizes: Mapping[str, int], taken: Measured, unit: str) -> None:
    """A row for each of *sizes*, whose rounds tell of as many nodes or levels: what one of them costs."""
    per = {"ns": 1, "µs": 1000}[unit]
    first = next(iter(sizes.values()))
    for name, size in sizes.items():
        ratio = taken.ratio(str(size), str(first)).times(first / size)
        one = taken.time(str(size)).median / size / per
        report.add(what.format(name), ratio, None, {"one": f"{in_short(one)} {unit}"})


def with_entries(report: Report, sizes: Sequence[int], slice_ns: int) -> None:
    """Reading and writing an entry, by how many there are; and the same with a dict."""
    works = {f"{kind.__name__} {size}": kind(size) for size in sizes for kind in (board, plain_dict)}
    taken = measure(works, report.pairs, slice_ns=slice_ns)
    for size in sizes:
        figures = {
            column: f"{in_short(taken.time(f'{kind} {size}').median)} ns"
            for column, kind in (("one", "board"), ("a dict's", "plain_dict"))
        }
        ratio = taken.ratio(f"board {size}", f"board {sizes[0]}")
        report.add(f"entry read and written, {size:,} entries", ratio, None, figures)


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--nodes", type=int, nargs="+", default=NODES)
    parser.add_argument("--depths", type=int, nargs="+", default=DEPTHS)
    parser.add_argument("--entries", type=int, nargs="+", default=ENTRIES)
    given = parser.parse_args()
    report = Report("growth", "How costs grow with the size of trees and of blackboards", given.pairs)
    slice_ns = SLICE
    if given.quick:
        given.nodes, given.depths, given.entries, slice_ns = (10, 100), (10, 100), (10, 100), 1
    with_nodes(report, given.nodes, slice_ns)
    with_depth(report, "nested subtrees", given.depths, nested, slice_ns)
    with_depth(report, "Inverters built in code", given.depths, built, slice_ns)
    with_entries(report, given.entries, slice_ns)
    report.output(given.json)


if __name__ == "__main__":
    main()
