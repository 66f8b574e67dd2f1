"""Describe what the cursor is on: a node, a port, a tree, or an entry with its writers and readers."""

from collections.abc import Iterable, Iterator
from itertools import islice
from posixpath import basename
from typing import Final
from urllib.parse import unquote

from lsprotocol import types

from btcore.suggestions import counted
from btcore.xml.read.scan import Place, ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.language.descriptions import (
    CONDITION_ATTRIBUTES,
    ELEMENTS,
    SHARING_ATTRIBUTES,
    code,
    node_markdown,
    port_markdown,
    type_name,
)
from btcore_studio.language.entries import entry_facts
from btcore_studio.language.key_links import TreeKey, links_of
from btcore_studio.language.node_attributes import file_symbols, node_element, script_tokens, tree_of
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import ProjectSymbols, symbols_of
from btcore_studio.language.symbols import KeyUse, is_call, node_id

_MAX_PLACES: Final = 12
_MAX_PORTS: Final = 60


def hover(
    project: Project, document: SourceDocument, offset: int, markdown: bool = True
) -> types.Hover | None:
    """Return the description of what the cursor is on, or None.

    Args:
        project: The project of the document.
        offset: The offset of the character after the cursor.
        markdown: Whether the client shows the description as Markdown, and not as plain text.
    """
    place = document.scan.element_at(offset)
    element = place.element
    if element is None:
        return None
    start, end = place.start, place.end
    use = file_symbols(project, document).key_at(offset) if place.kind in ("attribute", "value") else None
    links = links_of(project)
    if use is not None and use in links.named:
        start, end = use.start, use.end
        text = _entry(project, use.key, links.named[use])
    else:
        text = _described(project, document, place, element, offset)
    if not text:
        return None
    kind = types.MarkupKind.Markdown if markdown else types.MarkupKind.PlainText
    return types.Hover(types.MarkupContent(kind, text), document.positions.range(start, end))


def _described(
    project: Project, document: SourceDocument, place: Place, element: ScannedElement, offset: int
) -> str:
    """Return the description of a tag, an attribute or a value that names no entry, or ""."""
    attribute = place.attribute
    if tree_of(element) is None:
        names_tree = attribute is not None and attribute.name in ("main_tree_to_execute", "ID")
        if attribute is not None and names_tree and place.kind == "value":
            if element.tag in EXPLICIT_TAGS:
                return _node(project, document, attribute.value or "")
            return _tree(project, document, attribute.value or "")
        return ELEMENTS.get(element.tag, "") if attribute is None else ""
    node = node_element(element, file_symbols(project, document).format, project.registry)
    if attribute is None:
        if place.kind not in ("tag", "end_tag"):
            return ""
        parts = [_node(project, document, node.id)]
        if node.is_call:
            parts.append(_tree(project, document, element.get("ID") or ""))
        return "\n\n---\n\n".join(filter(None, reversed(parts)))
    if attribute.name == "ID" and place.kind == "value":
        value = attribute.value or ""
        return _tree(project, document, value) if node.is_call else _node(project, document, value)
    if node.is_script(attribute.name) and place.kind == "value":
        enums = project.registry.types.enums
        for token, start, end in script_tokens(document.text, attribute):
            if start <= offset <= end and token.text in enums:
                return f"**{token.text}** = {enums[token.text]}"
    port = node.port(attribute.name)
    if port is not None and node.manifest is not None:
        return port_markdown(node.manifest, port)
    about = SHARING_ATTRIBUTES.get(attribute.name) if node.is_call else None
    about = about or CONDITION_ATTRIBUTES.get(attribute.name)
    return f"**{attribute.name}** — {about}" if about else ""


def _node(project: Project, document: SourceDocument, id: str) -> str:
    manifest = project.registry.get(id, file_symbols(project, document).format)
    return node_markdown(manifest) if manifest is not None else ""


def _tree(project: Project, document: SourceDocument, id: str) -> str:
    """Return the description of a tree: where it is, and the keys that its callers can connect."""
    symbols = symbols_of(project)
    lines = []
    for tree in symbols.trees_called(id, document.uri)[:_MAX_PLACES]:
        place = _link(symbols, tree.file, tree.element.start)
        lines += [f"**{code(id)}** — tree with {counted(len(tree.nodes), 'node')}, {place}", ""]
        for model in symbols.models(id, document.uri, of_subtree=True):
            for name, port in islice(model.ports.items(), _MAX_PORTS):
                lines.append(
                    f"- {code(name)}" + (f", default {code(port.text)}" if port.text else ", required")
                )
    return "\n".join(lines).rstrip()


def _entry(project: Project, key: str, keys: Iterable[TreeKey]) -> str:
    """Return the description of the entry that a key names."""
    facts = entry_facts(links_of(project), keys)
    type_note = f" — {code(type_name(facts.type))}" if facts.type is not None else ""
    lines = [f"**{code(key)}**{type_note}"]
    others = [outer for outer in facts.keys if outer not in keys]
    if others:
        names = ", ".join(
            f"{code(outer.key)} of the tree {code(outer.tree.id)}" for outer in others[:_MAX_PLACES]
        )
        lines += ["", f"The entry {names}."]
    symbols = symbols_of(project)
    for title, uses in (("Written by", facts.writers), ("Read by", facts.readers)):
        lines += ["", f"{title}:", "", *_places(symbols, uses)] if uses else ["", f"{title}: no node"]
    return "\n".join(lines)


def _places(symbols: ProjectSymbols, uses: list[KeyUse]) -> Iterator[str]:
    for use in uses[:_MAX_PLACES]:
        name = use.element.get("name") or (use.element.get("ID") if is_call(use.element) else None)
        node = node_id(use.element)
        shown = f"{code(name)} {code(f'<{node}>')}" if name else code(f"<{node}>")
        yield f"- {shown} {code(use.port)}, {_link(symbols, use.file, use.start)}"
    if len(uses) > _MAX_PLACES:
        yield f"- and {len(uses) - _MAX_PLACES} more"


def _link(symbols: ProjectSymbols, uri: str, offset: int) -> str:
    """Return a link to the line of *offset* in a file."""
    line = symbols.documents[uri].positions.line(offset) + 1
    name = basename(unquote(uri)) or "the document"
    if not uri.startswith("file:") or any(char in uri for char in "<> \n"):
        return f"{code(name)} line {line}"
    return f"[{code(name)} line {line}](<{uri}#L{line}>)"
