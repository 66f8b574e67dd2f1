"""What an observer costs that records every transition: where nothing changes, and where every node does.

    python benchmarks/observers.py [--pairs 9] [--json]

Where nothing changes a Parallel has 100 leaves that go on running. Where everything changes, a Sequence has
100 leaves that succeed and are reset: each changes twice in a tick. The observer keeps what it is told at the
end of each tick, and lets go of it some ticks later, as one that hands over to a thread of its own does. The
same tree is ticked with and without it.

Leaves written in Python have targets. With the engine's own, which take next to no time, the ratio shows
mostly what making and telling a transition takes.
"""

import btcore
from btcore import Observer, Registry, Transition, Transitions, Tree
from measure.benchmark_trees import Forward, Succeed, succeed
from measure.paired_timing import SLICE, Work, measure
from measure.report import Report, Target, arguments, at_most, in_short

WIDTH = 100
KEPT = 10
"""Ticks after which the transitions are handed over."""
STILL = at_most(compiled=1.1, pure=1.1)
CHANGING = at_most(compiled=3, pure=2)


class Recorder(Observer):
    """Keeps the transitions of some ticks, and then lets go of them."""

    def __init__(self) -> None:
        self.ticks: list[Transitions] = []

    def transitions(self, changes: Transitions) -> None:
        self.ticks.append(changes)
        if len(self.ticks) == KEPT:
            self.ticks.clear()


class Counter(Observer):
    """Counts transitions."""

    def __init__(self) -> None:
        self.seen = 0

    def transition(self, change: Transition) -> None:
        self.seen += 1


def changes_of(tree: Tree) -> int:
    """How many transitions a tick of *tree* has."""
    counter = Counter()
    end = tree.subscribe(counter)
    tree.tick_once()
    end()
    return counter.seen


def grow(control: str, child: str, function: bool = False) -> Tree:
    """A *control* with WIDTH times *child*."""
    nodes = Registry.standard()
    nodes.add(Forward, succeed if function else Succeed)
    inside = f"<{control}>{child * WIDTH}</{control.split()[0]}>"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{inside}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes)


PARALLEL = 'Parallel success_count="-1" failure_count="1"'
CASES: list[tuple[str, str, str, bool, int, Target | None]] = [
    ("no status changes, class leaves", PARALLEL, "<Forward/>", False, 0, STILL),
    ("every node changes twice, class leaves", "Sequence", "<Succeed/>", False, 2 * WIDTH, CHANGING),
    ("every node changes twice, function leaves", "Sequence", "<Succeed/>", True, 2 * WIDTH, CHANGING),
    ("every node changes twice, built-in leaves", "Sequence", "<AlwaysSuccess/>", False, 2 * WIDTH, None),
]


def main() -> None:
    """Measure and print."""
    given = arguments(__doc__ or "").parse_args()
    report = Report("observers", "What an observer costs that records every transition", given.pairs)
    for what, control, child, function, changes, target in CASES:
        plain, observed = (grow(control, child, function) for _ in range(2))
        observed.tick_once()
        seen = changes_of(observed)
        assert changes <= seen <= changes + 3, f"{seen} transitions in a tick"
        observed.subscribe(Recorder())
        works: dict[str, Work] = {"alone": plain.tick_once, "observed": observed.tick_once}
        taken = measure(works, given.pairs, slice_ns=1 if given.quick else SLICE)
        figures = {f"{name}, ns a node": in_short(taken.time(name).median / (WIDTH + 1)) for name in works}
        report.add(f"{what}: observed / alone", taken.ratio("observed", "alone"), target, figures)
    report.output(given.json)


if __name__ == "__main__":
    main()
