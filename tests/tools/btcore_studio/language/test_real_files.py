"""Every request on the trees of this repository. Their unsaved text has characters of two UTF-16 units."""

import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import pytest
from lsprotocol import types

from btcore.registry.registry import Registry
from btcore.xml.edit.editor import Edit, apply_edits
from btcore.xml.read.read import parse_text
from btcore.xml.read.scan import ScannedElement
from btcore_studio.language.completion import complete
from btcore_studio.language.diagnostics import Report, check
from btcore_studio.language.hover import hover
from btcore_studio.language.inlay_hints import inlay_hints
from btcore_studio.language.lenses import code_lenses
from btcore_studio.language.navigation import find_definition, find_references
from btcore_studio.language.node_attributes import file_symbols, tree_of
from btcore_studio.language.outline import find_document_symbols, find_folding_ranges, find_workspace_symbols
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.rename import prepare_rename, rename_symbol
from btcore_studio.language.symbols import KeyForm, KeyUse, is_call
from tests.tools.btcore_studio.language.conftest import ROOT

FOLDERS = ("trees", "tests/robot_nodes", "tests/monitor/captures")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.xml"))]
Item = TypeVar("Item")
WIDE = "<!-- 🤖ä -->"


@pytest.fixture(scope="module")
def nodes() -> Registry:
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    return nodes


@pytest.fixture(params=FILES, ids=lambda path: path.stem)
def document(request: pytest.FixtureRequest, project: Project) -> SourceDocument:
    """A file of the repository. Its unsaved text has a comment before each tag that begins a line."""
    path: Path = request.param
    text = re.sub(r"^( +)(?=<[A-Za-z])", rf"\1{WIDE}", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return project.open(path.as_uri(), text, 1)


def chosen(items: list[Item], document: SourceDocument, most: int) -> list[Item]:
    """Return some of *items*, which are the same in each run."""
    return random.Random(document.uri.rpartition("/")[2]).sample(items, min(most, len(items)))


def text_at(document: SourceDocument, place: types.Range) -> str:
    """Return the text at UTF-16 positions, computed without btcore."""
    assert place.start.line == place.end.line
    units = document.text.splitlines()[place.start.line].encode("utf-16-le")
    return units[2 * place.start.character : 2 * place.end.character].decode("utf-16-le")


def nodes_of(document: SourceDocument) -> list[ScannedElement]:
    return [element for element in document.scan.elements if tree_of(element) is not None]


# --- completion and hover


def offered(project: Project, document: SourceDocument, cut: int) -> set[str]:
    """Return the labels at the end of the text that is cut off at *cut*."""
    broken = project.open(document.uri, document.text[:cut], 2)
    return {item.label for item in complete(project, broken, cut).items}


def test_what_file_contains_is_offered_where_it_is_typed(project: Project, document: SourceDocument) -> None:
    for element in chosen(nodes_of(document), document, 4):
        assert element.tag in offered(project, document, element.tag_start + 1)
        # What a call can connect may be written below it.
        known = [item for item in element.attributes if item.name not in ("_uid", "_fullpath")]
        attributes = [] if is_call(element) else known
        for attribute in chosen(attributes, document, 2):
            assert attribute.name in offered(project, document, attribute.start + 1), attribute.name
    calls = [element for element in nodes_of(document) if is_call(element)]
    for call in chosen(calls, document, 2):
        place = call.attribute("ID")
        assert place is not None
        text = document.text[: place.value_start] + document.text[place.value_end :]
        edited = project.open(document.uri, text, 2)
        labels = [item.label for item in complete(project, edited, place.value_start).items]
        assert place.value in labels


def test_keys_are_offered_after_they_were_named(project: Project, document: SourceDocument) -> None:
    for tree in file_symbols(project, document).trees:
        uses = [use for use in tree.uses if use.form is KeyForm.BRACED]
        later = [use for use in uses if any(other.key == use.key and other.end < use.start for other in uses)]
        for use in chosen(later, document, 3):
            assert use.key in offered(project, document, use.start), use.key


def test_every_place_is_described(project: Project, document: SourceDocument) -> None:
    for element in chosen(nodes_of(document), document, 8):
        manifest = project.registry.get(element.tag, file_symbols(project, document).format)
        if is_call(element) or manifest:
            found = hover(project, document, element.tag_start)
            assert found is not None
            assert found.range is not None
            assert text_at(document, found.range) == element.tag
        for attribute in element.attributes:
            if manifest is not None and attribute.name in manifest.ports:
                assert hover(project, document, attribute.start) is not None, attribute.name
                assert hover(project, document, attribute.value_start + 1) is not None, attribute.value


# --- navigation


def key_uses(project: Project, document: SourceDocument) -> list[KeyUse]:
    uses = [use for tree in file_symbols(project, document).trees for use in tree.uses]
    return [use for use in uses if use.form is not KeyForm.DEFAULT]


def test_a_definition_of_a_key_is_one_of_its_references(project: Project, document: SourceDocument) -> None:
    for use in chosen(key_uses(project, document), document, 8):
        references = find_references(project, document, use.start)
        here = document.positions.range(use.start, use.end)
        assert here in [item.range for item in references]
        assert find_definition(project, document, use.start)[0] in references
        assert all(text_at(document, item.range) for item in references)


def test_trees_and_python_leaves_are_found(project: Project, document: SourceDocument) -> None:
    ids = {tree.id for tree in file_symbols(project, document).trees}
    for element in chosen(nodes_of(document), document, 8):
        found = find_definition(project, document, element.tag_start)
        if is_call(element) and element.get("ID") in ids:
            assert [text_at(document, item.range) for item in found] == [element.get("ID")]
        elif not is_call(element) and project.registry.get(element.tag, 4) is not None:
            (place,) = found
            if place.uri == document.uri:
                assert text_at(document, place.range) == element.tag  # its model
                continue
            path = Path(place.uri.removeprefix("file://"))
            line = path.read_text(encoding="utf-8").splitlines()[place.range.start.line]
            assert re.match(r"(class|(async )?def|@)", line), line


def test_outline_folding_and_lenses(project: Project, document: SourceDocument) -> None:
    def flat(symbols: list[types.DocumentSymbol]) -> Iterator[types.DocumentSymbol]:
        for symbol in symbols:
            yield symbol
            yield from flat(list(symbol.children or ()))

    elements = [element for element in document.scan.elements if element.parent is not None]
    symbols = list(flat(find_document_symbols(project, document)))
    assert len(symbols) == len(elements)
    for symbol, element in zip(symbols, elements, strict=True):
        shown = text_at(document, symbol.selection_range)
        assert shown == element.tag or shown == (element.get("name") or element.get("ID"))
    lines = document.text.splitlines()
    folds = find_folding_ranges(project, document)
    assert len(folds) >= len([e for e in elements if e.children]) - 1
    assert all(fold.start_line < fold.end_line < len(lines) for fold in folds)
    trees = file_symbols(project, document).trees
    assert len(code_lenses(project, document)) == 3 * len(trees)
    for tree in trees:
        names = [symbol.name for symbol in find_workspace_symbols(project, str(tree.id))]
        assert names[0] == tree.id


def test_hints_follow_a_key_or_a_name(project: Project, document: SourceDocument) -> None:
    whole = document.positions.range(0, len(document.text))
    for hint in inlay_hints(project, document, whole):
        line = document.text.splitlines()[hint.position.line].encode("utf-16-le")
        before = line[: 2 * hint.position.character].decode("utf-16-le")
        assert re.search(r'(["\']|\w)$', before)
        assert re.match(r"(: [\w<>:]+| = \w+|\{.+\})", str(hint.label))


# --- changes


def codes(nodes: Registry, text: str) -> list[Report]:
    return check(lambda: parse_text(text), lambda _: nodes, text_of=lambda _: text)


def test_a_renamed_file_has_the_same_diagnostics(
    project: Project, document: SourceDocument, nodes: Registry
) -> None:
    before = sorted(report.code for report in codes(nodes, document.text))
    trees = file_symbols(project, document).trees
    defaults = {use.key for tree in trees for use in tree.uses if use.form is KeyForm.DEFAULT}
    places = [use.start for use in key_uses(project, document) if use.key not in defaults]
    places += [tree.element.attributes[0].value_start for tree in trees]
    places += [place.value_start for element in nodes_of(document) if (place := element.attribute("name"))]
    for offset in chosen(places, document, 4):
        old = prepare_rename(project, document, offset).placeholder
        edits = rename_symbol(project, document, offset, "renamed_2")[document.uri]
        assert {document.text[start:end] for start, end, _ in edits} <= {old, "{=}"}
        text = apply_edits(document.text, edits)
        assert sorted(report.code for report in codes(nodes, text)) == before


def test_a_quick_fix_restores_a_misspelt_name(document: SourceDocument, nodes: Registry) -> None:
    """Exchange two letters of a tag, a port and the ID of a call; the preferred fix restores the file."""
    spans: list[tuple[str, list[int]]] = []
    for element in nodes_of(document):
        ends = [element.tag_start]
        if element.end_tag_start >= 0:
            ends.append(document.text.index(element.tag, element.end_tag_start))
        spans.append((element.tag, ends))
        for attribute in element.attributes:
            if attribute.name not in ("name", "ID") and not is_call(element):
                spans.append((attribute.name, [attribute.start]))
            elif attribute.name == "ID" and is_call(element):
                spans.append((attribute.value or "", [attribute.value_start]))
    long = [(name, starts) for name, starts in spans if len(name) > 6 and name[3] != name[4]]
    for name, starts in chosen(long, document, 3):
        wrong = name[:3] + name[4] + name[3] + name[5:]
        text = apply_edits(document.text, [Edit(start, start + len(name), wrong) for start in starts])
        found = [item for item in codes(nodes, text) if item.fixes and wrong in item.message]
        assert found, f"{wrong}: {codes(nodes, text)}"
        assert apply_edits(text, found[0].fixes[0].edits) == document.text
