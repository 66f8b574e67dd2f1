"""How long loading a tree takes, compared with lxml parsing the same file, and the memory of its nodes.

    python benchmarks/load.py [--pairs 9] [--nodes 100 1000 10000 60000] [--quick] [--json]

Every node has three attributes: leaves have a name and two ports (literals, and blackboard entries of their
own), Sequences and Fallbacks have a name and two attributes that Groot writes. A pair consists of a parse and
a load of the same file, directly after each other, and ratios are computed within a pair. Times are processor
times.
"""

import tempfile
from functools import partial
from pathlib import Path

from lxml import etree

import btcore
from btcore import In, Out, Registry, condition
from btcore.clock import NS_PER_MS, NS_PER_US
from measure.loading_cost import allocated_bytes, loading_time
from measure.paired_timing import measure_rounds
from measure.report import Report, at_most, create_parser, in_short

LEAVES_A_CONTROL = 4
CONTROLS_A_GROUP = 10
SIZES = (100, 1_000, 10_000, 60_000)
TARGETS = {10_000: at_most(compiled=6)}
"""The targets by number of nodes: the largest ratio of btcore's loading time to lxml's parsing time."""


class Drive(btcore.StatefulAction):
    """A leaf with two input ports: a blackboard entry and a literal number."""

    goal: In[str]
    speed: In[float]

    def on_start(self) -> bool:
        """Succeed immediately."""
        return True

    def on_running(self) -> bool:
        """Never called, since `on_start` succeeds."""
        return True


class Measure(btcore.SyncAction):
    """A leaf with an input port and an output port."""

    sensor: In[int]
    distance: Out[float]

    def tick(self) -> bool:
        """Succeed."""
        return True


@condition
def near(distance: In[float], limit: In[float]) -> bool:
    """A leaf that is a function with two input ports."""
    return distance < limit


def leaf(number: int) -> str:
    """Return the XML element of leaf *number*. Its name is unique, and so are most of its port values."""
    remainder = number % 4
    if remainder == 0:
        return f'<Drive name="drive {number}" goal="{{goal_{number}}}" speed="0.5"/>'
    if remainder == 1:
        return f'<Measure name="measure {number}" sensor="{number}" distance="{{distance_{number}}}"/>'
    if remainder == 2:
        return f'<Near name="near {number}" distance="{{distance_{number - 1}}}" limit="0.{number % 50}"/>'
    return f'<SetBlackboard name="set {number}" value="{number}" output_key="goal"/>'


def document(nodes: int) -> str:
    """Return an XML document of about *nodes* nodes: a Sequence of Fallbacks of Sequences of leaves."""
    lines: list[str] = ['<root BTCPP_format="4">', '<BehaviorTree ID="Main">']
    node_count = 0

    def control(tag: str, indent: str) -> str:
        nonlocal node_count
        node_count += 1
        return f'{indent}<{tag} name="{tag} {node_count}" _uid="{node_count}" _note="group {node_count}">'

    lines.append(control("Sequence", "  "))
    while node_count < nodes:
        lines.append(control("Fallback", "    "))
        for _ in range(CONTROLS_A_GROUP):
            lines.append(control("Sequence", "      "))
            for _ in range(LEAVES_A_CONTROL):
                lines.append("        " + leaf(node_count))
                node_count += 1
            lines.append("      </Sequence>")
            if node_count >= nodes:
                break
        lines.append("    </Fallback>")
    return "\n".join([*lines, "  </Sequence>", "</BehaviorTree>", "</root>"])


def registry() -> Registry:
    """Return a registry with the nodes of the documents."""
    nodes = Registry.standard()
    nodes.add(Drive, Measure, near)
    return nodes


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "")
    parser.add_argument("--nodes", type=int, nargs="+", default=SIZES)
    options = parser.parse_args()
    nodes = registry()
    report = Report(
        "load", "The time for loading a tree, compared with lxml's parser, and its memory", options.pairs
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.xml"
        for size in SIZES[:1] if options.quick else options.nodes:
            path.write_text(document(size), encoding="utf-8")
            count = len(btcore.load(path, nodes=nodes).nodes)
            works = {
                "parse": partial(etree.parse, path),
                "load": partial(btcore.load, path, nodes=nodes),
            }
            measured = measure_rounds([works] * (options.pairs + 1), loading_time)
            parse, load = measured.time("parse").median, measured.time("load").median
            figures = {
                "parse": f"{parse / NS_PER_MS:.2f} ms",
                "load": f"{load / NS_PER_MS:.1f} ms",
                "a node": f"{in_short(load / count / NS_PER_US)} µs",
                "its memory": f"{allocated_bytes(works['load']) / count:,.0f} B",
            }
            ratio = measured.ratio("load", "parse")
            report.add(f"{size:,} nodes: load / parse", ratio, TARGETS.get(size), figures)
    report.output(options.json)


if __name__ == "__main__":
    main()
