"""Write the node reference: a page for each node of btcore and btcore_robot, and an index."""

import re
from pathlib import Path
from typing import Final

from mentions import PAGES, links_to_mentions
from node_examples import NodeExample, all_nodes, changed_meanings, example, status

from btcore import Registry
from btcore.blackboard.ports import Direction, Port
from btcore.diagnostic_codes import DiagnosticCode
from btcore.registry.manifest import Manifest
from btcore.status import (
    ANY_RESULT,
    RUNNING,
    SKIPPED,
    UNKNOWN_RESULTS,
    NodeType,
    Status,
)
from btcore.values import DOUBLE
from btcore.xml.read.tags import NODE_REPLACEMENTS
from btcore_batch.node_classes import BATCH_CLASSES

UP: Final = "../.."
LEAVES: Final = (NodeType.CONDITION, NodeType.ACTION)
NAV2: Final = "btcore_navigation.nodes"
NODE_TYPE_TITLES: Final = {
    NodeType.CONTROL: "Control nodes",
    NodeType.DECORATOR: "Decorators",
    NodeType.CONDITION: "Conditions",
    NodeType.ACTION: "Actions",
    NodeType.SUBTREE: "Subtrees",
}
GROUPS: Final = ("Built-in nodes", "Nodes of the robot", "Nodes of Nav2")
GUIDES: Final = {
    GROUPS[0]: ("reference/differences", "Differences from BehaviorTree.CPP"),
    GROUPS[1]: ("guides/your_robot", "Your own robot"),
    GROUPS[2]: ("guides/navigation", "Navigation"),
}
DIRECTIONS: Final = {Direction.IN: "input", Direction.OUT: "output", Direction.INOUT: "input and output"}


INTRODUCTION: Final = f"""# Nodes

The built-in nodes are those of BehaviorTree.CPP 4.10, and in format 3 those of BehaviorTree.CPP 3.8. The
nodes of the robot and of Nav2 need resources, such as a robot: see [Navigation]({UP}/guides/navigation.md).
In the terminal, `btcore nodes` prints the same list, together with the nodes of your own libraries.

## How to read the pages

A page shows a small tree and, for most nodes, a table of recorded ticks. The leaves of these trees have no
code: they return planned results, as with [`btcore run --outcomes`](../commands/run.md). A cell of the table
shows what a node did in a tick of the tree:

- {status("SUCCESS")}, {status("FAILURE")}, {status("RUNNING")} or {status("SKIPPED")}: the node was ticked
  and returned this result
- {status("halted")}: the node was RUNNING and was halted
- –: the node was not ticked

A row such as `{{goal}}` shows the values that were written to an entry of the blackboard, by the program
before the tick or by a node during the tick. The time is the time of the tree's clock.

"""


def write_node_pages(folder: Path) -> None:
    """Write the pages, their pictures, their index and their navigation into *folder*."""
    nodes = all_nodes()
    manifests = {format: nodes.manifests_of(format) for format in (4, 3)}
    ids = sorted({*manifests[4], *manifests[3]}, key=str.lower)
    mentions = _mentions(ids)
    folder.mkdir(parents=True)
    pages = []
    for id in ids:
        page = NodePage(id, [format for format in (4, 3) if id in manifests[format]], nodes, mentions[id])
        (folder / f"{id}.md").write_text(page.text(), encoding="utf-8")
        (folder / f"{id}.svg").write_text(page.examples[page.formats[0]].svg(), encoding="utf-8")
        pages.append(page)
    index = [INTRODUCTION]
    navigation = ["- [Nodes](index.md)"]
    for group in GROUPS:
        index += [f"## {group}", ""]
        navigation.append(f"- {group}")
        for node_type, title in NODE_TYPE_TITLES.items():
            section = [page for page in pages if (page.group, page.newest.type) == (group, node_type)]
            if section:
                index += [f"**{title}**", "", "| node | |", "|---|---|"]
                navigation.append(f"    - {title}")
            for page in section:
                summary = _cell(_paragraphs(page.newest)[0])
                only = f" (only format {page.formats[0]})" if len(page.formats) == 1 else ""
                index.append(f"| [`{page.id}`]({page.id}.md) | {summary}{only} |")
                navigation.append(f"        - [{page.id}]({page.id}.md)")
            index.append("")
    (folder / "index.md").write_text("\n".join(index), encoding="utf-8")
    (folder / "navigation").write_text("\n".join([*navigation, ""]), encoding="utf-8")


class NodePage:
    """The page of a node.

    Args:
        id: The ID of the node.
        formats: The XML formats that have the node.
        nodes: The nodes that the example may use.
        mentions: How often the pages of docs/ mention the node.
    """

    def __init__(self, id: str, formats: list[int], nodes: Registry, mentions: dict[str, int]) -> None:
        self.id = id
        self.formats = formats
        self.mentions = mentions
        self.manifests = {format: _manifest(nodes, id, format) for format in formats}
        self.examples = {format: example(id, format, nodes) for format in formats}
        self.newest = self.manifests[formats[0]]

    @property
    def group(self) -> str:
        """The group of the node in the index."""
        if self.newest.library == "btcore":
            return GROUPS[0]
        module = (self.newest.function or self.newest.cls).__module__
        return GROUPS[2] if module.startswith(NAV2) else GROUPS[1]

    def text(self) -> str:
        """Return the page in Markdown."""
        first, *others = _paragraphs(self.newest)
        lines = [f"---\ntitle: {self.id}\n---\n", f"# {self.id}\n", f"{first}\n"]
        lines += [f"{paragraph}\n" for paragraph in others]
        lines += [*_facts(self.newest, self.formats), ""]
        lines += _ports("## Ports", self.newest)
        lines += self._example()
        lines += self._format_3()
        lines += self._links()
        return "\n".join(lines)

    def _example(self) -> list[str]:
        newest = self.examples[self.formats[0]]
        lines = ["## Example\n", f"![{_described(newest)}]({self.id}.svg#light)\n"]
        for format in self.formats:
            lines.append(f'=== "XML, format {format}"\n')
            lines += _indented(["```xml", *self.examples[format].xml.splitlines(), "```"])
            lines.append("")
        if newest.is_ticked:
            guide = "[how to read the table](index.md#how-to-read-the-pages)"
            lines += ["## Ticks\n", f"The results of the nodes in each tick ({guide}):\n"]
            lines += [*newest.table(), ""]
        return lines

    def _format_3(self) -> list[str]:
        """Return the differences between the formats."""
        counterpart = NODE_REPLACEMENTS.get(self.id)
        older = [old for old, new in NODE_REPLACEMENTS.items() if new == self.id]
        if self.formats == [4]:
            lines = ["## Format 3\n", f"Format 3 does not have `{self.id}`."]
            names = [f"[`{old}`]({old}.md)" for old in older if old != "RetryUntilSuccesful"]
            if names:
                lines[-1] += f" Its counterparts there: {', '.join(names)}."
            return [*lines, ""]
        lines = ["## Format 3\n" if 4 in self.formats else "## Format 4\n"]
        changed = changed_meanings(self.examples[3])
        if 4 not in self.formats:
            lines.append(f"Format 4 does not have `{self.id}`.")
            if counterpart is not None:
                lines[-1] += f" `btcore convert` replaces it by [`{counterpart}`]({counterpart}.md)."
            lines.append("")
        else:
            old = self.manifests[3]
            if old.description != self.newest.description:
                lines += [f"{paragraph}\n" for paragraph in _paragraphs(old)]
            if _ports("", old) != _ports("", self.newest):
                lines += _ports("", old)[2:]
            before, now = self.examples[3], self.examples[4]
            if before.is_ticked and before.table() != now.table():
                lines += ["The same example, ticked in format 3:\n", *before.table(), ""]
        if changed:
            command = f"[`btcore convert`]({UP}/guides/converting.md)"
            lines += [f"Differences that {command} reports for the example:", ""]
            lines += [f"- {_code_link(code)}: {_code(message)}" for code, message in changed.items()]
            lines.append("")
        if len(lines) == 1:
            lines.append(
                "The node is the same. Format 3 has no conditions such as `_skipIf`, and no SKIPPED.\n"
            )
        return lines

    def _links(self) -> list[str]:
        lines = ["## See also", "", *links_to_mentions(self.mentions)]
        path, title = GUIDES[self.group]
        if not any(path in line for line in lines):
            lines.append(f"- [{title}]({UP}/{path}.md)")
        return [*lines, ""]


def _manifest(nodes: Registry, id: str, format: int) -> Manifest:
    manifest = nodes.get(id, format)
    assert manifest is not None
    return manifest


def _formats(formats: list[int]) -> str:
    return " and ".join(map(str, sorted(formats)))


def _facts(manifest: Manifest, formats: list[int]) -> list[str]:
    """Return a table of what the class of a node declares."""
    rows = {
        "kind": manifest.type.name.lower(),
        "package": manifest.library,
        "formats": _formats(formats),
    }
    if manifest.type not in (NodeType.ACTION, NodeType.CONDITION, NodeType.SUBTREE):
        rows["children"] = _child_count(manifest)
    rows["results"] = " ".join(status(result.name) for result in possible_statuses(manifest, formats[0]))
    if manifest.required_resources:
        rows["resources"] = ", ".join(f"`{type.__name__}`" for type in manifest.required_resources)
    if manifest.library == "btcore":
        rows["state between ticks"] = "yes" if manifest.spec.state_fields else "none"
        has_batch = manifest.cls in BATCH_CLASSES
        rows["batches"] = f"[{'supported' if has_batch else 'not supported'}]({UP}/guides/batch.md)"
    return ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows.items())]


def possible_statuses(manifest: Manifest, format: int) -> list[Status]:
    """Return the statuses that a tick of a node may return, as its class declares them."""
    low, high = manifest.spec.child_count
    results = manifest.cls.possible_results([UNKNOWN_RESULTS] * (high or max(low, 2)), {})
    node_results = results.results - ({SKIPPED} if format == 3 else set())  # format 3 has no SKIPPED
    if manifest.spec.node_type in LEAVES and manifest.spec.results == ANY_RESULT:
        node_results -= {SKIPPED}  # declared by default, but no leaf of btcore or btcore_robot returns it
    return sorted(node_results) + [RUNNING] * results.may_run


def _child_count(manifest: Manifest) -> str:
    low, high = manifest.spec.child_count
    count = f"{low}" if low == high else f"{low} or more" if high is None else f"{low} to {high}"
    roles = manifest.spec.child_roles
    return f"{count}: {roles}" if roles else count


def _ports(heading: str, manifest: Manifest) -> list[str]:
    """Return a table of the ports."""
    if not manifest.ports:
        return []
    lines = [heading, "", "| port | type | |", "|---|---|---|"]
    for port in manifest.ports.values():
        declaration = f"{DIRECTIONS[port.direction]} `{_type(port)}`{_default(port)}"
        lines.append(f"| `{port.name}` | {declaration} | {_cell(port.description)} |")
    return [*lines, ""]


def _type(port: Port) -> str:
    return port.type.name.replace("BT::", "").replace("std::", "")


def _default(port: Port) -> str:
    """Return what applies if the XML does not set a port."""
    if port.default is None:
        return ", optional" if port.optional else ", required" if port.reads else ""
    if port.default == "":
        return ", empty by default" if port.reads else ""
    value = f"{float(port.default):g}" if port.type is DOUBLE else port.default
    return f", default `{value}`"


def _paragraphs(manifest: Manifest) -> list[str]:
    """Return the paragraphs of the specification; a block of code is a paragraph."""
    return manifest.description.strip().split("\n\n")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").removesuffix(".")


def _code_link(code: DiagnosticCode) -> str:
    """Return a link to the heading of *code*."""
    _, mark, anchor = code.url.partition("#")
    return f"[{code}]({UP}/reference/errors.md{mark}{anchor})"


def _code(text: str) -> str:
    """Return a message with tags as code, which would otherwise be HTML."""
    return re.sub(r"(</?\w+>)", r"`\1`", text)


def _indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _described(example: NodeExample) -> str:
    """Return an alternative text for the picture of *example*."""
    root = example.diagram()
    parts = []
    queue = [root]
    while queue:
        node = queue.pop(0)
        queue += node.children
        if node.children:
            parts.append(f"{node.id} with {_listed([child.id for child in node.children])}")
    return f"Tree: {'; '.join(parts) or root.id}"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _mentions(ids: list[str]) -> dict[str, dict[str, int]]:
    """Return how often each page of docs/ mentions each node, in code or as a tag."""
    values: dict[str, dict[str, int]] = {id: {} for id in ids}
    for page, text in PAGES.items():
        for pair in re.findall(r"<(\w+)[\s/>]|`(\w+)`", text):
            for id in values.keys() & set(pair):
                values[id][page] = values[id].get(page, 0) + 1
    return values
