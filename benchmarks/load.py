"""How long loading a tree takes beside lxml parsing the same file, and what its nodes weigh.

    python benchmarks/load.py [--pairs 9] [--nodes 100 1000 10000 60000] [--json]

Every node has three attributes: leaves a name and two ports (literals, and entries of their own), and
Sequences and Fallbacks a name and two of Groot's notes. Each pair is one parse and one load of one
file, right after another; ratios are taken pair by pair. Times are of the processor, so that other
programs on the machine disturb them little.
"""

import gc
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from lxml import etree

import btcore
from btcore import In, Out, Registry, condition
from measure.memory import bytes_kept
from measure.paired_timing import Spread
from measure.report import Report, arguments, at_most, in_short

LEAVES_A_CONTROL = 4
CONTROLS_A_GROUP = 10
SIZES = (100, 1_000, 10_000, 60_000)
TARGETS = {10_000: at_most(compiled=6)}
"""By the number of nodes: how many times as long as lxml's parse a load may take."""
MILLISECOND = 1e6
MICROSECOND = 1e3


class Drive(btcore.StatefulAction):
    """Two input ports: an entry and a number."""

    goal: In[str]
    speed: In[float]

    def on_start(self) -> bool:
        """Arrive at once."""
        return True

    def on_running(self) -> bool:
        """Never asked for."""
        return True


class Measure(btcore.SyncAction):
    """An input port and an output port."""

    sensor: In[int]
    distance: Out[float]

    def tick(self) -> bool:
        """Measure nothing."""
        return True


@condition
def near(distance: In[float], limit: In[float]) -> bool:
    """A function with two input ports."""
    return distance < limit


def leaf(number: int) -> str:
    """The element of leaf *number*; the names, the entries and every fourth literal are its own."""
    kind = number % 4
    if kind == 0:
        return f'<Drive name="drive {number}" goal="{{goal_{number}}}" speed="0.5"/>'
    if kind == 1:
        return f'<Measure name="measure {number}" sensor="{number}" distance="{{distance_{number}}}"/>'
    if kind == 2:
        return f'<Near name="near {number}" distance="{{distance_{number - 1}}}" limit="0.{number % 50}"/>'
    return f'<SetBlackboard name="set {number}" value="{number}" output_key="goal"/>'


def document(nodes: int) -> str:
    """A tree of *nodes* nodes: Sequences of Fallbacks and Sequences of leaves, three levels of them."""
    lines: list[str] = ['<root BTCPP_format="4">', '<BehaviorTree ID="Main">']
    made = 0

    def control(tag: str, indent: str) -> str:
        nonlocal made
        made += 1
        return f'{indent}<{tag} name="{tag} {made}" _uid="{made}" _note="group {made}">'

    lines.append(control("Sequence", "  "))
    while made < nodes:
        lines.append(control("Fallback", "    "))
        for _ in range(CONTROLS_A_GROUP):
            lines.append(control("Sequence", "      "))
            for _ in range(LEAVES_A_CONTROL):
                lines.append("        " + leaf(made))
                made += 1
            lines.append("      </Sequence>")
            if made >= nodes:
                break
        lines.append("    </Fallback>")
    return "\n".join([*lines, "  </Sequence>", "</BehaviorTree>", "</root>"])


def registry() -> Registry:
    """The nodes that the documents name."""
    nodes = Registry.standard()
    nodes.add(Drive, Measure, near)
    return nodes


def processor_time(work: Callable[[], object]) -> int:
    """How long *work* takes (ns of processor time), with a first look of Python's collector at its result.

    What it makes is thrown away after that.
    """
    gc.collect()
    start = time.process_time_ns()
    made = work()
    gc.collect(0)  # which loading puts off
    taken = time.process_time_ns() - start
    del made
    return taken


def pairs(path: Path, nodes: Registry, count: int) -> Iterator[tuple[int, int]]:
    """*count* times the time (ns) of parsing the file *path* with lxml, and that of loading it."""
    for index in range(count + 1):
        parsing = processor_time(lambda: etree.parse(path))
        loading = processor_time(lambda: btcore.load(path, nodes=nodes))
        if index:  # the first pair warms up
            yield parsing, loading


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--nodes", type=int, nargs="+", default=SIZES)
    given = parser.parse_args()
    nodes = registry()
    report = Report("load", "What loading a tree takes beside lxml's parse, and its memory", given.pairs)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.xml"
        for wanted in SIZES[:1] if given.quick else given.nodes:
            path.write_text(document(wanted), encoding="utf-8")
            count = len(btcore.load(path, nodes=nodes).nodes)
            measured = list(pairs(path, nodes, given.pairs))
            parse, load = (statistics.median(column) for column in zip(*measured, strict=True))
            figures = {
                "parse": f"{parse / MILLISECOND:.2f} ms",
                "load": f"{load / MILLISECOND:.1f} ms",
                "a node": f"{in_short(load / count / MICROSECOND)} µs",
                "its memory": f"{bytes_kept(partial(btcore.load, path, nodes=nodes)) / count:,.0f} B",
            }
            ratio = Spread.of([loading / parsing for parsing, loading in measured])
            report.add(f"{wanted:,} nodes: load / parse", ratio, TARGETS.get(wanted), figures)
    report.output(given.json)


if __name__ == "__main__":
    main()
