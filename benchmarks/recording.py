"""The cost of a recording of what ticks depend on, the size of its file, and the speed of its replay.

    python benchmarks/recording.py [--pairs 9] [--quick] [--json]

The tree of the first rows has 1,000 nodes, 900 of which are leaves of 2 µs that succeed. It is ticked 100
times a second, as a robot is: alone, and while it is recorded to an MCAP file. Wall-clock times count here,
because the thread that writes the file may delay a tick. Back to back, the ticks of two trees alternate.

The tree of the last rows has 100 nodes, of which 20 are leaves that stay RUNNING and succeed in every tenth
tick, at 100 ticks a second of simulated time.
"""

import random
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path

import btcore
from btcore import Put, Registry, SimClock, Status, Tree
from btcore.clock import NS_PER_S, NS_PER_US
from btcore_recorder import Replay, record
from measure.paired_timing import SLICE, Measured, Spread, Work, measure, percentile
from measure.report import Report, at_least, at_most, create_parser

LEAF_US = 2.0
RATE = 100
SECONDS = 5.0
"""The duration (s) for which a tree is ticked in each round."""
HOUR_TICKS = 3600 * RATE


def calibrated_leaf() -> Callable[[], Status]:
    """Return a leaf function that takes `LEAF_US`."""

    def leaf_of(repetitions: int) -> Callable[[], Status]:
        def work() -> Status:
            for _ in range(repetitions):
                pass
            return Status.SUCCESS

        return work

    reference = measure({"leaf": leaf_of(100)}, 3).time("leaf").median
    return leaf_of(round(100 * LEAF_US * NS_PER_US / reference))


def large_tree(leaf: Callable[[], Status]) -> Tree:
    """Return a tree of 1,000 nodes with 900 leaves."""
    nodes = Registry.standard()
    nodes.add(leaf, ID="Work")
    b = btcore.Builder(nodes)
    groups = [b.Sequence(*[b.Work() for _ in range(9 if group < 90 else 10)]) for group in range(99)]
    return b.build(b.Sequence(*groups))


def tick_at_rate(tree: Tree, seconds: float) -> list[float]:
    """Tick *tree* at `RATE` for *seconds*, and return the duration of each tick (ns, wall clock)."""
    taken = []
    due = time.perf_counter_ns()
    for _ in range(round(seconds * RATE)):
        start = time.perf_counter_ns()
        tree.tick_exactly_once()
        taken.append(float(time.perf_counter_ns() - start))
        due += NS_PER_S // RATE
        time.sleep(max(0, due - time.perf_counter_ns()) / NS_PER_S)
    return taken


def add_cost(report: Report, folder: Path, seconds: float, slice_ns: int) -> None:
    """Add the cost of recording a tick."""
    leaf = calibrated_leaf()
    alone, recorded = large_tree(leaf), large_tree(leaf)
    times: dict[str, list[float]] = {"alone": [], "recorded": []}
    means: dict[str, list[float]] = {"alone": [], "recorded": []}
    for _ in range(report.pairs):
        for name, tree in (("alone", alone), ("recorded", recorded)):
            if name == "recorded":
                with record(tree, folder / "paced.mcap"):
                    taken = tick_at_rate(tree, seconds)
            else:
                taken = tick_at_rate(tree, seconds)
            times[name] += taken
            means[name].append(sum(taken) / len(taken))
    figures = {name: f"{Spread.of(values).median / NS_PER_US:.0f} µs" for name, values in means.items()}
    mean = Measured(means).ratio("recorded", "alone")
    report.add("a tick of 1,000 nodes, mean: recorded / alone", mean, at_most(compiled=1.15), figures)
    worst = {name: percentile(values, 0.999) for name, values in times.items()}
    tail = Spread.of([worst["recorded"] / worst["alone"]])
    figures = {name: f"{value / NS_PER_US:.0f} µs" for name, value in worst.items()}
    report.add("the same, 99.9th percentile", tail, at_most(compiled=1.3), figures)
    with record(recorded, folder / "fast.mcap"):
        works: dict[str, Work] = {"alone": alone.tick_exactly_once, "recorded": recorded.tick_exactly_once}
        ratio = measure(works, report.pairs, slice_ns=slice_ns).ratio("recorded", "alone")
    report.add("the same, back to back", ratio, at_most(compiled=1.6))


@btcore.action
def put(number: Put[int], text: Put[str]) -> bool:
    """Write two outputs."""
    number(1)
    text("a short text")
    return True


def add_outputs(report: Report, folder: Path, slice_ns: int) -> None:
    """Add the cost of recording an output."""
    nodes = Registry.standard()
    nodes.add(put)
    b = btcore.Builder(nodes)
    alone, recorded = [
        b.build(b.Sequence(*[b.Put(number="{n}", text="{t}") for _ in range(50)])) for _ in range(2)
    ]
    with record(recorded, folder / "outputs.mcap"):
        works: dict[str, Work] = {"alone": alone.tick_exactly_once, "recorded": recorded.tick_exactly_once}
        measured = measure(works, report.pairs, slice_ns=slice_ns)
    added = [
        (longer - shorter) / 100
        for longer, shorter in zip(measured.rounds["recorded"], measured.rounds["alone"], strict=True)
    ]
    spread = Spread.of(added)
    figures = {"recorded": f"{spread.median / NS_PER_US:.2f} µs"}
    limit = 3 * NS_PER_US
    report.add(
        "an output, with its share of the leaf / 3 µs", spread.times(1 / limit), at_most(compiled=1), figures
    )


def record_hour(folder: Path, ticks: int) -> tuple[Path, float]:
    """Record *ticks* of the tree of 100 nodes; return the file, and the seconds of the clock."""

    @btcore.action
    def drive() -> Generator[None, None, bool]:
        for _ in range(9):
            yield
        return True

    nodes = Registry.standard()
    nodes.add(drive)
    b = btcore.Builder(nodes)
    active = [b.KeepRunningUntilFailure(b.Inverter(b.Inverter(b.Drive()))) for _ in range(20)]
    clock = SimClock()
    tree = b.build(
        b.Parallel(*active, *[b.AlwaysSuccess() for _ in range(19)], failure_count="1"), clock=clock
    )
    path = folder / "hour.mcap"
    with record(tree, path):
        for _ in range(ticks):
            tree.tick_exactly_once()
            clock.advance(1 / RATE)
    return path, ticks / RATE


def add_replay(report: Report, folder: Path, ticks: int) -> None:
    """Add the size of a recording, and the speed of its replay."""
    path, seconds = record_hour(folder, ticks)
    size = path.stat().st_size * HOUR_TICKS / ticks / 1e6
    within = at_most(compiled=1, pure=1)
    report.add(
        "an hour of 100 nodes at 100 Hz / 40 MB",
        Spread.of([size / 40]),
        within,
        {"recorded": f"{size:.0f} MB"},
    )
    start = time.perf_counter()
    replay = Replay(path)
    difference = replay.verify()
    taken = time.perf_counter() - start
    assert difference is None, difference
    assert replay.tree.ticks == ticks
    figures = {"recorded": f"{taken * HOUR_TICKS / ticks:.0f} s an hour"}
    speed = Spread.of([seconds / taken])
    report.add(
        "opening and running it again: recorded time / time", speed, at_least(compiled=60, pure=60), figures
    )
    source, seeks = random.Random(1), []
    for _ in range(50):
        start = time.perf_counter()
        assert replay.seek(tick=source.randrange(1, ticks))
        seeks.append((time.perf_counter() - start) * 1000)
    slowest = max(seeks)
    report.add(
        "the slowest of 50 seeks / 50 ms",
        Spread.of([slowest / 50]),
        within,
        {"recorded": f"{slowest:.0f} ms"},
    )


def main() -> None:
    """Run the benchmark."""
    options = create_parser(__doc__ or "").parse_args()
    report = Report("recording", "The cost of a recording, and the speed of its replay", options.pairs)
    with tempfile.TemporaryDirectory() as name:
        folder, slice_ns = Path(name), 1 if options.quick else SLICE
        add_cost(report, folder, 0.05 if options.quick else SECONDS, slice_ns)
        add_outputs(report, folder, slice_ns)
        add_replay(report, folder, 600 if options.quick else 30_000)
    report.output(options.json)


if __name__ == "__main__":
    main()
