# ruff: noqa: E501 - the layout is the result
"""Formatting changes white space alone, and code lenses are above each tree."""

import random
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("pygls")

from lsprotocol import types

from btcore.xml.edit.editor import apply_edits
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_text
from btcore.xml.read.scan import scan
from btcore_studio.language.formatting import format_document, format_range, formatting_edits
from btcore_studio.language.lenses import code_lenses
from btcore_studio.language.project import Project, SourceDocument
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits
from tests.tools.btcore_studio.edit.test_tree_editor import decorated

TREES = Path(__file__).parents[4] / "trees"
OPTIONS = types.FormattingOptions(tab_size=4, insert_spaces=True)


def opened(text: str) -> tuple[Project, SourceDocument]:
    project = Project()
    return project, project.open("untitled:größe.xml", text, 1)


def formatted(text: str, options: types.FormattingOptions = OPTIONS) -> str:
    project, document = opened(text)
    params = types.DocumentFormattingParams(types.TextDocumentIdentifier(document.uri), options)
    edits = format_document(project, document, params)
    for edit in sorted(edits, key=lambda item: item.range.start, reverse=True):
        start, end = (document.positions.offset(place) for place in (edit.range.start, edit.range.end))
        assert not text[start:end].strip()
        assert not edit.new_text.strip()
        text = text[:start] + edit.new_text + text[end:]
    return text


def content(element: Element) -> Iterator[object]:
    for item in element.iter():
        yield item.tag, item.attributes


@pytest.mark.parametrize("file", sorted(TREES.rglob("*.xml")), ids=lambda file: file.stem)
def test_the_same_tree_is_formatted_again_after_white_space_changed(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    once = formatted(text)
    assert formatted(once) == once
    assert list(content(parse_text(once).root)) == list(content(parse_text(text).root))
    # Between tags, any white space has the same result.
    squeezed = re.sub(r">\n *<", ">\n<", once)
    assert squeezed != once
    assert formatted(squeezed) == once


@pytest.mark.parametrize("file", sorted(TREES.rglob("*.xml")), ids=lambda file: file.stem)
def test_formatting_changes_only_white_space_and_can_be_undone(file: Path) -> None:
    rng = random.Random(f"format:{file.stem}")
    for _ in range(5):
        text = decorated(file.read_text(encoding="utf-8"), rng)
        edits = formatting_edits(scan(text), rng.choice(["\t", "    "]))
        for start, end, new in edits:
            old = text[start:end]
            assert not (old + new).strip(), (old, new)
            assert old != new
            # Nothing is replaced by itself, and no line break is divided.
            assert old[:1] != new[:1], (old, new)
            assert old[-1:] != new[-1:], (old, new)
            assert not text.startswith("\r\n", start - 1)
            assert not text.startswith("\r\n", end - 1)
        formatted = apply_edits(text, edits)
        assert "".join(formatted.split()) == "".join(text.split())
        assert apply_edits(formatted, invert_edits(text, edits)) == text


def test_layout_of_elements_comments_attributes_and_text() -> None:
    text = (
        '<?xml version="1.0"?>\n<!-- 🤖 --><root   BTCPP_format="4" >\n\n\n<BehaviorTree ID="Äpfel"><!-- why -->\n'
        '<Sequence  name="a  b"\n   _skipIf="x :=\n 1" ><AlwaysSuccess /></Sequence><Empty>  </Empty>\n\n\n'
        "  <!-- two\n lines --><Sleep/></BehaviorTree><TreeNodesModel>"
        "<Action ID='A'><input_port name='p'>  some\n  text <b/> </input_port></Action></TreeNodesModel></root>"
    )
    assert formatted(text) == (
        '<?xml version="1.0"?>\n<!-- 🤖 -->\n<root BTCPP_format="4">\n    <BehaviorTree ID="Äpfel"> <!-- why -->\n'
        '        <Sequence name="a  b"\n                _skipIf="x :=\n 1">\n            <AlwaysSuccess/>\n'
        "        </Sequence>\n        <Empty></Empty>\n\n        <!-- two\n lines -->\n        <Sleep/>\n"
        "    </BehaviorTree>\n    <TreeNodesModel>\n        <Action ID='A'>\n"
        "            <input_port name='p'>  some\n  text <b/> </input_port>\n        </Action>\n"
        "    </TreeNodesModel>\n</root>\n"
    )


def test_tabs_and_line_ends_of_the_document() -> None:
    tabs = types.FormattingOptions(tab_size=8, insert_spaces=False)
    assert formatted("<root><A/>\r\n</root>", tabs) == "<root>\r\n\t<A/>\r\n</root>\r\n"


@pytest.mark.parametrize(
    "broken",
    ["<root><A></root>", '<root a="1><A/></root>', "<root><A/>", "<root><A/></root", "<root/><A/>", "text"],
)
def test_broken_xml_is_not_changed(broken: str) -> None:
    assert formatted(broken) == broken


def test_a_range_is_formatted() -> None:
    text = "<root>\n<A/>\n<B/>\n</root>\n"
    project, document = opened(text)
    identifier = types.TextDocumentIdentifier(document.uri)
    line = types.Range(types.Position(2, 0), types.Position(2, 4))
    edits = format_range(project, document, types.DocumentRangeFormattingParams(identifier, line, OPTIONS))
    assert [(edit.range.end.line, edit.new_text) for edit in edits] == [(2, "    ")]


def test_code_lenses_of_each_tree() -> None:
    project, document = opened('<root>\n<BehaviorTree ID="Küche"/><BehaviorTree/>\n<BehaviorTree ID="B"><A')
    found = [(lens.range.start.line, lens.command) for lens in code_lenses(project, document)]
    assert [(line, command.command, command.arguments) for line, command in found if command] == [
        (line, command, [document.uri, id])
        for line, id in ((1, "Küche"), (2, "B"))
        for command in ("btcore.run", "btcore.prove", "btcore.show")
    ]
