"""The cost of an observer that records every transition, if no status changes and if every node changes.

    python benchmarks/observers.py [--pairs 9] [--quick] [--json]

The tree in which nothing changes is a Parallel of 100 leaves that stay RUNNING. The tree in which everything
changes is a Sequence of 100 leaves that succeed and are reset, so that each changes twice in a tick. The
observer stores the transitions at the end of each tick, and drops them some ticks later, like an observer
that passes them to another thread. The same tree is ticked with and without the observer.

Leaves written in Python have targets. The engine's own leaves take almost no time: with them the ratio shows
mainly the cost of creating and delivering transitions.
"""

import btcore
from btcore import Observer, Registry, Transitions, Tree
from measure.benchmark_trees import Forward, Succeed, succeed
from measure.paired_timing import SLICE, Work, measure
from measure.report import Report, Target, at_most, create_parser, in_short

WIDTH = 100
KEPT = 10
"""The number of ticks after which the observer drops the stored transitions."""
STILL = at_most(compiled=1.1, pure=1.1)
CHANGING = at_most(compiled=3, pure=2)


class Recorder(Observer):
    """Stores the transitions of some ticks, and then drops them."""

    def __init__(self) -> None:
        self.ticks: list[Transitions] = []

    def transitions(self, changes: Transitions) -> None:
        self.ticks.append(changes)
        if len(self.ticks) == KEPT:
            self.ticks.clear()


def create_tree(control: str, child: str, function: bool = False) -> Tree:
    """Return a tree: the control node *control* with WIDTH copies of the XML element *child*."""
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
    """Run the benchmark."""
    options = create_parser(__doc__ or "").parse_args()
    report = Report("observers", "The cost of an observer that records every transition", options.pairs)
    for label, control, child, function, changes, target in CASES:
        plain, observed = (create_tree(control, child, function) for _ in range(2))
        observed.tick_once()
        recorder = Recorder()
        observed.subscribe(recorder)
        observed.tick_once()
        count = sum(map(len, recorder.ticks))
        assert changes <= count <= changes + 3, f"{count} transitions in a tick"
        works: dict[str, Work] = {"alone": plain.tick_once, "observed": observed.tick_once}
        measured = measure(works, options.pairs, slice_ns=1 if options.quick else SLICE)
        figures = {f"{name}, ns a node": in_short(measured.time(name).median / (WIDTH + 1)) for name in works}
        report.add(f"{label}: observed / alone", measured.ratio("observed", "alone"), target, figures)
    report.output(options.json)


if __name__ == "__main__":
    main()
