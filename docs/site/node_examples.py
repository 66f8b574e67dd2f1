"""Run the examples of docs/site/node_examples.toml, and record their ticks."""

import itertools
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from lxml import etree

import btcore
from btcore import Registry
from btcore.clock import NS_PER_S
from btcore.diagnostic_codes import DiagnosticCode
from btcore.nodes.manual_selector import Prompt
from btcore.registry.mock_leaves import MockAction, MockCondition, Outcomes
from btcore.status import NodeType
from btcore.testing import Harness
from btcore.testing.trace import TraceStep
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from btcore_drawing.diagram import DiagramNode, diagram_of_document
from btcore_drawing.svg import diagram_to_svg
from btcore_studio.convert.convert import convert

ROOT: Final = Path(__file__).parents[2]
EXAMPLES: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("node_examples.toml").read_text(encoding="utf-8")
)


def all_nodes() -> Registry:
    """Return a registry of the built-in nodes and of the installed node libraries."""
    nodes = Registry.standard()
    for unavailable in nodes.add_installed_libraries():
        raise unavailable.error
    return nodes


class Answers(Prompt):
    """A prompt that gives the answers of an example in turn."""

    def __init__(self, answers: list[int]) -> None:
        self.answers = itertools.cycle(answers)

    def choose(self, question: str, options: list[str]) -> int:
        """Return the index of the next answer."""
        return next(self.answers)


class NodeExample:
    """A tree with a node, and how it is ticked.

    Args:
        id: The ID of the node.
        format: The XML format, 3 or 4.
        nodes: The nodes that the tree may use, besides the leaves of the example.
        fields: The fields of the example, as docs/site/node_examples.toml describes them; None = a tree of
            the node only, which is not ticked.
    """

    def __init__(self, id: str, format: int, nodes: Registry, fields: dict[str, Any] | None = None) -> None:
        self.id = id
        self.format = format
        self.fields: dict[str, Any] = fields or {"xml": _usage(id, format, nodes)}
        self.nodes = nodes.copy()
        for field, leaf in (("actions", MockAction), ("conditions", MockCondition)):
            for name in self.fields.get(field, ()):
                self.nodes.add(leaf, ID=name)

    @property
    def is_ticked(self) -> bool:
        """Whether the example can run."""
        return "ticks" in self.fields

    @property
    def xml(self) -> str:
        """The tree as an XML document."""
        written = self.fields["xml3"] if self.format == 3 and "xml3" in self.fields else self.fields["xml"]
        trees = etree.fromstring(f"<root>{written}</root>", etree.XMLParser(remove_blank_text=True))
        if trees[0].tag != "BehaviorTree":
            tree = etree.Element("BehaviorTree", ID="Main")
            tree.extend(trees)
            trees.append(tree)
        trees.set(*(("BTCPP_format", "4") if self.format == 4 else ("main_tree_to_execute", "Main")))
        if self.format == 4 and len(trees) > 1:
            trees.set("main_tree_to_execute", "Main")
        etree.indent(trees)
        return "\n".join(_wrapped(line) for line in etree.tostring(trees, encoding="unicode").splitlines())

    def diagram(self) -> DiagramNode:
        """Return the tree as a drawing. Raise TreeError if it has errors."""
        plans = plan_document(parse_text(self.xml), self.nodes)
        plans.diagnostics.raise_errors()
        return diagram_of_document(plans)

    def svg(self) -> str:
        """Return a picture of the tree."""
        return diagram_to_svg(self.diagram(), self.id, self.format)

    def harness(self, **outcomes: str) -> Harness:
        """Return a harness for the tree; *outcomes* replaces the outcomes of leaves."""
        leaves = {**self.fields.get("actions", {}), **self.fields.get("conditions", {}), **outcomes}
        resources = [Outcomes(leaves=leaves), Answers(self.fields.get("answers", []))]
        return Harness.loads(self.xml, nodes=self.nodes, resources=resources)

    def tick(self, harness: Harness, times: int) -> None:
        """Tick the tree *times* times, and write the entries of the example."""
        for tick in range(times):
            for key, values in self.fields.get("entries", {}).items():
                if values[tick:] and values[tick] != "":
                    harness.blackboard[key] = values[tick]
            harness.tick()
            harness.wait(self.fields.get("ms", 0) / 1000)

    def table(self) -> list[str]:
        """Return the recorded ticks as a table in Markdown: a row for each node, a column for each tick."""
        harness = self.harness()
        self.tick(harness, self.fields["ticks"])
        steps, tree = list(harness.trace), harness.tree
        written = [key for step in steps for key in step.written]
        entries = dict.fromkeys([*self.fields.get("entries", {}), *written])
        names = {node.uid: path for path, node in tree.nodes_by_path().items()}
        lines = [
            f"| tick | {' | '.join(str(step.tick) for step in steps)} |",
            f"|---|{':-:|' * len(steps)}",
        ]
        if "ms" in self.fields:
            times = [f"{step.stamp * 1000 // NS_PER_S} ms" for step in steps]
            lines.append(f"| time | {' | '.join(times)} |")
        for node, depth in _with_depth(tree.root):
            cells = [_cell(step, names[node.uid]) for step in steps]
            label = f"`{node.id}`" if node.type is not NodeType.SUBTREE else f"`{node.id}`&nbsp;{node.name}"
            lines.append(f"| {'&nbsp;' * 3 * depth}{label} | {' | '.join(cells)} |")
        for key in entries:
            # An entry of a subtree often repeats the entry to which it is remapped.
            if "/" in key:
                continue
            values = [self._entry(key, number, step) for number, step in enumerate(steps)]
            lines.append(f"| `{{{key}}}` | {' | '.join(values)} |")
        return lines

    def _entry(self, key: str, tick: int, step: TraceStep) -> str:
        """Return the value that the entry *key* has after *step*, or "" if it was not written."""
        value = step.written.get(key)
        if value is None:
            return "*removed*" if key in step.written else ""
        if isinstance(value, bool):
            return f"`{str(value).lower()}`"
        # A pose is shown as its text in the example.
        return f"`{value if isinstance(value, str | int | float) else self.fields['entries'][key][tick]}`"


def example(id: str, format: int, nodes: Registry) -> NodeExample:
    """Return the example of a node in an XML format, which need not be ticked."""
    return NodeExample(id, format, nodes, EXAMPLES.get(id))


def changed_meanings(example: NodeExample) -> dict[DiagnosticCode, str]:
    """Return the changes of the node's meaning if the example is converted to format 4: code and message."""
    text = example.xml
    tags = re.finditer(rf"<{example.id}\b[^>]*>", text)
    spans = [(text.count("\n", 0, tag.start()) + 1, text.count("\n", 0, tag.end()) + 1) for tag in tags]
    changes = convert(parse_text(text), example.nodes).changes
    own_changes = [change for change in changes if any(first <= change.line <= last for first, last in spans)]
    return {
        change.code: change.message for change in reversed(own_changes) if not change.code.startswith("C1")
    }


def _with_depth(node: btcore.TreeNode, depth: int = 0) -> Iterator[tuple[btcore.TreeNode, int]]:
    yield node, depth
    for child in node.children:
        yield from _with_depth(child, depth + 1)


def _cell(step: TraceStep, path: str) -> str:
    """Return the results of the node at *path* in *step*."""
    results = step.results.get(path, ())
    words = [status(result.name, results.count(result)) for result in dict.fromkeys(results)]
    if path in step.halted:
        words.append(status("halted"))
    return " ".join(words) or "–"


def status(name: str, times: int = 1) -> str:
    """Return the name of a status as a coloured label, and how often it was returned if more than once."""
    return f'<span class="status {name.lower()}">{name}{f" ×{times}" if times > 1 else ""}</span>'


def _wrapped(line: str) -> str:
    """Return a line of XML, with an attribute per line if it is too long."""
    if len(line) <= 96:
        return line
    indent = " " * (len(line) - len(line.lstrip()))
    tag, _, attributes = line.strip().partition(" ")
    first, *further = attributes.replace('" ', '"\n').split("\n")
    return "\n".join(
        [f"{indent}{tag} {first}", *(f"{indent}{' ' * len(tag)} {attribute}" for attribute in further)]
    )


def _usage(id: str, format: int, nodes: Registry) -> str:
    """Return a node with the ports that are required, have a default or are outputs, and with children."""
    manifest = nodes.get(id, format)
    assert manifest is not None
    element = etree.Element(id)
    for port in manifest.ports.values():
        if port.default or port.writes or (not port.optional and port.default is None):
            element.set(port.name, port.default or f"{{{port.name}}}")
    for _ in range(manifest.spec.child_count[0]):
        element.append(etree.Element("AlwaysSuccess"))
    return etree.tostring(element, encoding="unicode")
