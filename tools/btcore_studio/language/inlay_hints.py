"""Show beside the keys of a document what the text does not say: the types of entries and remapped names."""

from lsprotocol import types

from btcore.suggestions import shortened
from btcore_studio.language.descriptions import type_name
from btcore_studio.language.entries import entry_facts
from btcore_studio.language.key_links import KeyLinks, TreeKey, links_of
from btcore_studio.language.node_attributes import file_symbols
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.symbols import KeyForm, KeyUse, TreeSymbol

_MAX_NAME = 60


def inlay_hints(project: Project, document: SourceDocument, range: types.Range) -> list[types.InlayHint]:
    """Return the hints in a range of a document.

    The first place of each key in a tree has the type of the entry and, if the entry is on the blackboard of
    a calling tree under another name, that name. `=` and `{=}` have the key that they stand for.
    """
    first, last = document.positions.offset(range.start), document.positions.offset(range.end)
    hints: list[tuple[int, str]] = []
    for tree in file_symbols(project, document).trees:
        if tree.element.start < last and tree.element.end > first:
            links = links_of(project)
            hints += _hints_of(links, tree, first, last)
    return [
        types.InlayHint(document.positions.position(offset), label, padding_left=True)
        for offset, label in sorted(hints)
    ]


def _hints_of(links: KeyLinks, tree: TreeSymbol, first: int, last: int) -> list[tuple[int, str]]:
    """Return the hints of a tree between two offsets, as (offset, label)."""
    outer = [port.outer for call in tree.calls for port in call.ports.values() if port.outer is not None]
    uses = [use for use in (*tree.uses, *outer) if use.form is not KeyForm.DEFAULT]
    seen: set[str] = set()
    hints: list[tuple[int, str]] = []
    for use in sorted(uses, key=lambda use: use.start):
        is_first = use.key not in seen
        seen.add(use.key)
        if not first <= use.start < last:
            continue
        label = f"{{{use.key}}}" if use.form is KeyForm.OF_PORT else ""
        if is_first:
            label += _first_label(links, tree, use.key)
        if label:
            hints.append((_after(use), label))
    return hints


def _first_label(links: KeyLinks, tree: TreeSymbol, key: str) -> str:
    facts = entry_facts(links, [TreeKey(tree, key)])
    label = f": {shortened(type_name(facts.type), _MAX_NAME)}" if facts.type is not None else ""
    names = dict.fromkeys(outer.key for outer in facts.keys if outer.tree is not tree and outer.key != key)
    if names:
        label += f" = {shortened(' or '.join(names), _MAX_NAME)}"
    return label


def _after(use: KeyUse) -> int:
    """Return the offset of a hint about *use*: after a name in a script, else after the attribute."""
    attribute = use.element.attribute(use.port)
    return use.end if use.form is KeyForm.SCRIPT or attribute is None else attribute.end
