"""The outline of documents, the search for symbols, and folding."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from lsprotocol import converters
from lsprotocol.types import DocumentSymbol, FoldingRangeKind, SymbolKind

from btcore_studio.language.outline import (
    MAX_FOUND_SYMBOLS,
    MAX_OUTLINE_DEPTH,
    find_document_symbols,
    find_folding_ranges,
    find_workspace_symbols,
)
from tests.tools.btcore_studio.language.marked_project import MarkedProject

TREE = """<root BTCPP_format="4">
    <include path="türen.xml"/>
    <include path="räume.xml"/>
    <!-- 🤖
         Zustellung -->
    <BehaviorTree ID="Zustellen">
        <Sequence name="🚚 Zustellung">
            <Script code="ziel := 'Küche 🍳'"/>
            <Inverter><ScriptCondition name="leer?" code="ziel == ''"/></Inverter>
            <SubTree ID="TürÖffnen" name="🚪"/>
            <Action ID="Fahren" zu="{ziel}"/>
        </Sequence>
    </BehaviorTree>
    <TreeNodesModel>
        <Action ID="Fahren">
            <input_port name="zu"/>
        </Action>
    </TreeNodesModel>
</root>
"""


@pytest.fixture
def project(tmp_path: Path) -> MarkedProject:
    project = MarkedProject(tmp_path)
    project.write({"main.xml": TREE})
    return project


def flat(project: MarkedProject, uri: str, symbols: list[DocumentSymbol], level: int = 0) -> Iterator[str]:
    for symbol in symbols:
        place = project.text_at(uri, symbol.selection_range)
        yield f"{'  ' * level}{symbol.name} | {symbol.detail} | {symbol.kind.name} | {place}"
        assert symbol.range.start <= symbol.selection_range.start
        assert symbol.selection_range.end <= symbol.range.end
        yield from flat(project, uri, list(symbol.children or ()), level + 1)


def outline(project: MarkedProject, name: str) -> list[str]:
    document = project.document(name)
    return list(flat(project, document.uri, find_document_symbols(project.project, document)))


def test_outline_is_the_tree(project: MarkedProject) -> None:
    assert outline(project, "main.xml") == [
        "türen.xml | include | File | include",
        "räume.xml | include | File | include",
        "Zustellen |  | Class | Zustellen",
        "  🚚 Zustellung | Sequence | Struct | 🚚 Zustellung",
        "    Script | code=\"ziel := 'Küche 🍳'\" | Method | Script",
        "    Inverter |  | Operator | Inverter",
        "      leer? | ScriptCondition code=\"ziel == ''\" | Boolean | leer?",
        "    🚪 | SubTree TürÖffnen | Module | 🚪",
        '    Fahren | zu="{ziel}" | Method | Fahren',
        "TreeNodesModel |  | Namespace | TreeNodesModel",
        "  Fahren |  | Method | Fahren",
        "    zu | input_port | Property | zu",
    ]


def test_outline_of_broken_and_unsaved_text(project: MarkedProject) -> None:
    project.open(
        "main.xml", TREE.replace("</Inverter>", "").replace("<Sequence name", "<Sequence\nname=' '><A")
    )
    found = outline(project, "main.xml")
    assert [line.split("|")[0].strip() for line in found][2:6] == ["Zustellen", "Sequence", "A", "Script"]
    project.open("main.xml", "<root><BehaviorTree ID='A'><Fall")
    assert outline(project, "main.xml") == ["A |  | Class | A", "  Fall |  | Property | Fall"]


def test_deep_outline_can_be_sent(project: MarkedProject) -> None:
    project.open("main.xml", "<root>" + "<Inverter>" * 3000)
    found = find_document_symbols(project.project, project.document("main.xml"))
    assert converters.get_converter().unstructure(found)
    levels = [
        (len(line) - len(line.lstrip())) // 2
        for line in flat(project, project.document("main.xml").uri, found)
    ]
    assert len(levels) == 3000
    assert max(levels) == MAX_OUTLINE_DEPTH - 1


def test_folding(project: MarkedProject) -> None:
    ranges = find_folding_ranges(project.project, project.document("main.xml"))
    found = {(item.start_line + 1, item.end_line + 1, item.kind) for item in ranges}
    assert found == {
        (1, 18, None), (6, 12, None), (7, 11, None), (14, 17, None), (15, 16, None),
        (2, 3, FoldingRangeKind.Imports), (4, 5, FoldingRangeKind.Comment),
    }  # fmt: skip
    project.open("main.xml", TREE.replace("</Sequence>", "").replace("</root>", ""))
    assert find_folding_ranges(project.project, project.document("main.xml"))


def test_workspace_symbols(project: MarkedProject) -> None:
    project.open("neu.xml", "<root BTCPP_format='4'><BehaviorTree ID='Fahrt'><Sequence name='Ziel 🎯'/>")

    def names(query: str) -> list[str]:
        found = find_workspace_symbols(project.project, query)
        return [f"{item.name} in {item.container_name}" for item in found]

    assert names("fahr") == ["Fahrt in neu.xml", "Fahren in main.xml"]
    assert names("zust") == ["Zustellen in main.xml", "🚚 Zustellung in Zustellen"]
    assert names("zln") == ["Zustellen in main.xml", "🚚 Zustellung in Zustellen"]
    assert names("🎯") == ["Ziel 🎯 in Fahrt"]
    assert names("nirgends") == []
    assert len(names("")) == 7
    (found,) = find_workspace_symbols(project.project, "leer")
    assert found.kind is SymbolKind.Boolean
    assert project.text_at(found.location.uri, found.location.range) == "leer?"  # type: ignore[union-attr]
    many = "".join(f"<BehaviorTree ID='T{number}'/>" for number in range(MAX_FOUND_SYMBOLS + 1))
    project.open("neu.xml", f"<root>{many}</root>")
    assert len(names("t")) == MAX_FOUND_SYMBOLS
