"""The request btcore/edit: the operations of a page, their refusals, and random sequences of them."""

import os
import random
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from btcore.errors import TreeError
from btcore.xml.edit.editor import Edit, EditError, apply_edits
from btcore.xml.plan.plan import plan
from btcore_drawing.diagram import diagram_of_document
from btcore_studio.edit.text_edits import invert_edits
from btcore_studio.language import studio_protocol as protocol
from btcore_studio.language.drawing import draw_document
from btcore_studio.language.edit_commands import compute_edit, copy_nodes
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import (
    AnyCommand,
    DocumentIdentifier,
    Drawing,
    DrawingParams,
    EditResult,
    PalettePort,
    Place,
    Position,
)
from btcore_studio.language.text_positions import TextPositions
from btcore_studio.language.tree_reading import read_trees

ROOT = Path(__file__).parents[4]
URI = "untitled:tree.xml"
MAIN = """<root BTCPP_format="4">
  <BehaviorTree ID="A">
    {}
  </BehaviorTree>
</root>
"""
LENGTH = 10
SEQUENCES = max(1, int(os.environ.get("BTCORE_EDITS", "1000")) // LENGTH)
"""The number of random sequences of operations."""


class Page:
    """A document with its drawing, to which operations are applied."""

    def __init__(self, project: Project, text: str, uri: str = URI) -> None:
        self.project = project
        self.uri = uri
        self.show(text)

    def show(self, text: str) -> None:
        """Open a text in the place of the present one."""
        self.source = self.project.open(self.uri, text, 1)

    @property
    def text(self) -> str:
        """The present text."""
        return self.source.text

    def drawing(self, tree: str | None = None) -> Drawing:
        """Return the drawing of a tree."""
        return draw_document(self.project, self.source, DrawingParams(DocumentIdentifier(self.uri), tree))

    def place(self, written: str, number: int = 0) -> Place:
        """Return the place of the element that begins with *written*, as "<Sleep"."""
        offset = -1
        for _ in range(number + 1):
            offset = self.text.index(written, offset + 1)
        at = TextPositions(self.text).position(offset)
        return Place(self.uri, Position(at.line, at.character))

    def do(self, command: AnyCommand) -> EditResult:
        """Apply an operation, check that its inverse restores the text, and return the result."""
        result = compute_edit(self.project, command)
        before = self.text
        edits = edits_of(self.source, result)
        after = apply_edits(before, edits)
        assert apply_edits(after, invert_edits(before, edits)) == before
        self.show(after)
        return result

    def selected(self, result: EditResult) -> list[str]:
        """Return the names of the selected tags."""
        offsets = [self.source.positions.offset(lsp(place.position)) for place in result.select]
        return [self.text[at + 1 :].replace("/", " ").replace(">", " ").split()[0] for at in offsets]


def lsp(position: Position) -> object:
    return type("P", (), {"line": position.line, "character": position.character})


def edits_of(source: SourceDocument, result: EditResult) -> list[Edit]:
    """Return the edits of the one document that an operation changes."""
    changes = result.edit.changes.get(source.uri, [])
    assert result.edit.changes.keys() <= {source.uri}
    positions = source.positions
    return [
        Edit(positions.offset(lsp(item.range.start)), positions.offset(lsp(item.range.end)), item.new_text)
        for item in changes
    ]


@pytest.fixture
def page(project: Project) -> Callable[..., Page]:
    """Open a document: the nodes of the tree A, or a whole text."""

    def open_page(text: str) -> Page:
        is_whole = not text or text.lstrip().startswith(("<root", "<?xml", "\ufeff", "<!--"))
        return Page(project, text if is_whole else MAIN.format(text))

    return open_page


# --- adding


def test_add_into_an_empty_document(page: Callable[..., Page]) -> None:
    for before in ("", "<!-- first -->", "\ufeff", '<root BTCPP_format="4">\n</root>\n'):
        shown = page(before)
        result = shown.do(protocol.Add(Place(URI, Position(0, 0)), 0, "Sequence"))
        start = before if "root" not in before else ""
        separator = "\n" if start.endswith(">") else ""
        expected = MAIN.format("<Sequence/>").replace('ID="A"', 'ID="MainTree"')
        assert shown.text == start + separator + expected
        assert shown.selected(result) == ["Sequence"]
