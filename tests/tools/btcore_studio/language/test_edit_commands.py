"""The request btcore/edit: the operations of a page, their refusals, and random sequences of them."""

import contextlib
import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

import btcore
from btcore.errors import TreeError
from btcore.xml.edit.editor import Edit, EditError, apply_edits
from btcore_studio.language import studio_protocol as protocol
from btcore_studio.language.drawing import draw_document
from btcore_studio.language.edit_commands import compute_edit, copy_nodes, last_warnings, preview_edit
from btcore_studio.language.node_form import form_of
from btcore_studio.language.palette import palette_of
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
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits
from tests.tools.btcore_studio.edit.test_tree_editor import decorated, repository_texts

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
        """Apply an operation, check its drawing and its inverse, and return the result with all notes."""
        drawing = DrawingParams(DocumentIdentifier(self.uri))
        result = compute_edit(self.project, command, drawing)
        before = self.text
        edits = edits_of(self.source, result)
        after = apply_edits(before, edits)
        assert apply_edits(after, invert_edits(before, edits)) == before
        self.show(after)
        if after == before:
            assert result.drawing is None
        else:
            assert result.drawing is not None
            assert replace(result.drawing, number=0) == replace(self.drawing(), number=0)
        return replace(result, notes=[*result.notes, *last_warnings(self.project).messages])

    def selected(self, result: EditResult) -> list[str]:
        """Return the names of the selected tags."""
        offsets = [offset_in(self.source, place.position) for place in result.select]
        return [self.text[at + 1 :].replace("/", " ").replace(">", " ").split()[0] for at in offsets]


def edits_of(source: SourceDocument, result: EditResult) -> list[Edit]:
    """Return the edits of the one document that an operation changes."""
    assert result.edit.changes.keys() <= {source.uri}
    return edits_in(source, result)


def edits_in(source: SourceDocument, result: EditResult) -> list[Edit]:
    """Return the edits of a document."""
    return [
        Edit(offset_in(source, item.range.start), offset_in(source, item.range.end), item.new_text)
        for item in result.edit.changes.get(source.uri, [])
    ]


def offset_in(source: SourceDocument, position: Position) -> int:
    """Return the offset of a position."""
    return source.positions.offset_at(position.line, position.character)


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


def test_add_in_the_style_of_the_document(page: Callable[..., Page]) -> None:
    shown = page('<Sequence>\n      <Action ID="Go" goal="{g}"/>\n      <Sleep msec="1"/>\n    </Sequence>')
    shown.do(protocol.Add(shown.place("<Sequence"), 1, "Go"))
    shown.do(protocol.Add(shown.place("<Sequence"), 9, "Sleep"))
    shown.do(protocol.Add(shown.place("<Sequence"), -1, "Script"))
    assert [line.strip() for line in shown.text.splitlines()[2:8]] == [
        "<Sequence>",
        '<Script code=""/>',
        '<Action ID="Go" goal="{g}"/>',
        '<Action ID="Go" goal="{goal}"/>',
        '<Sleep msec="1"/>',
        "<Sleep/>",
    ]


def test_add_a_call_with_the_ports_of_the_model(page: Callable[..., Page]) -> None:
    shown = page(
        MAIN.format("<Sequence/>").replace(
            "</root>",
            '<BehaviorTree ID="B"><Sleep msec="1"/></BehaviorTree><TreeNodesModel><SubTree ID="B">'
            '<input_port name="x"/><input_port name="y" default="1"/></SubTree></TreeNodesModel></root>',
        )
    )
    shown.do(protocol.Add(shown.place("<Sequence"), 0, "B"))
    assert '<SubTree ID="B" x="{x}"/>' in shown.text


@pytest.mark.parametrize(
    ("nodes", "parent", "reason"),
    [
        ("<Inverter><Sleep/></Inverter>", "<Inverter", "<Inverter> has exactly one child: wrap that in"),
        ("<Sleep/>", "<BehaviorTree", "the tree 'A' has exactly one root: wrap it in"),
        ("<Sleep/>", "<Sleep", "<Sleep> is an action, which has no children: add the node beside it, or"),
        ('<SubTree ID="B"/>', "<SubTree", "has no children: open the tree 'B'"),
        ("<IfThenElse><A/><B/><C/></IfThenElse>", "<If", "at most 3 children (a condition"),
    ],
)
def test_too_many_children_are_refused(
    page: Callable[..., Page], nodes: str, parent: str, reason: str
) -> None:
    shown = page(nodes)
    with pytest.raises(EditError) as refused:
        shown.do(protocol.Add(shown.place(parent), 0, "Sleep"))
    assert reason in str(refused.value)


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (
            protocol.Add(Place(URI, Position(2, 4)), 0, "Slep"),
            "no node and no tree 'Slep'; did you mean 'Sleep'",
        ),
        (
            protocol.Add(Place(URI, Position(2, 4)), 0, "A"),
            "call each other recursively: A → A: a tree can't",
        ),
        (protocol.Add(Place(URI, Position(2, 5)), 0, "Sleep"), "no node begins at this place in line 3"),
        (protocol.Remove([]), "no node is selected"),
        (protocol.Remove([Place(URI, Position(1, 2))]), "the tree 'A' is not a node"),
        (protocol.Remove([Place(URI, Position(0, 0))]), "no node begins at this place"),
        (protocol.Remove([Place("file:///none.xml", Position(0, 0))]), "cannot be read"),
        (protocol.AddTree(URI, "A"), "there is a tree 'A' already"),
        (protocol.AddTree(URI, "Sleep"), "a node has this name"),
        (protocol.AddTree(URI, "a b"), "invalid tree ID 'a b'"),
        (protocol.RemoveTree(URI, "B"), "there is no tree 'B'"),
        (protocol.SetMainTree(URI, "B"), "there is no tree 'B'"),
        (protocol.Extract(Place(URI, Position(2, 4)), "A"), "there is a tree 'A' already"),
        (protocol.Inline(Place(URI, Position(2, 4))), "does not call a tree"),
        (protocol.Wrap([Place(URI, Position(2, 4))], "Sleep"), "<Sleep> is a leaf"),
        (protocol.Wrap([Place(URI, Position(2, 4))], "A"), "the call of the tree 'A' has no children"),
        (protocol.Unwrap(Place(URI, Position(3, 6))), "<Sleep> has no children"),
        (protocol.Enable([Place(URI, Position(2, 4))]), "is not disabled"),
        (protocol.SetAttribute(Place(URI, Position(2, 4)), "a b", ""), "cannot be the name of an attribute"),
        (protocol.SetAttribute(Place(URI, Position(2, 4)), "name", "\0"), "the character U+0000"),
        (
            protocol.ChangeType(Place(URI, Position(2, 4)), "Inverter"),
            "has exactly one child: move the 2 children of <Sequence> first",
        ),
        (protocol.Paste(Place(URI, Position(2, 4)), 0, "hello"), "the text contains no node"),
        (protocol.Paste(Place(URI, Position(2, 4)), 0, "<Sleep>"), "not a sequence of complete elements"),
        (protocol.SetModel(URI, "a b", "Action", []), "cannot be the ID of a node"),
        (protocol.SetModel(URI, "a", "Action", [PalettePort("1", "in", "", "", "")]), "cannot be the name"),
        (protocol.SetModel(URI, "root", "Action", []), "cannot be the ID of a node"),
        (protocol.SetModel(URI, "Grip}", "Action", []), "cannot be the ID of a node"),
        (
            protocol.SetModel(URI, "a", "Action", [PalettePort("b", "in", "double", "abc", "")]),
            "'abc' cannot be the default of the type double",
        ),
        (protocol.SetModel(URI, "Sleep", "Action", []), "the node 'Sleep' has code"),
        (
            protocol.SetModel(URI, "a", "Action", [PalettePort("b", "in", "", "", "")] * 2),
            "two ports have the name 'b'",
        ),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else None,
)
def test_refusals(page: Callable[..., Page], command: AnyCommand, reason: str) -> None:
    shown = page('<Sequence>\n      <Sleep msec="1"/>\n      <Sleep msec="2"/>\n    </Sequence>')
    before = shown.text
    with pytest.raises(EditError) as refused:
        shown.do(command)
    assert reason in str(refused.value)
    assert shown.text == before


# --- moving, wrapping and so on


SEQUENCE = """<Sequence>
      <Sleep name="1"
             msec="1"/>
      <!-- second -->
      <Fallback name="2"><AlwaysSuccess/>
        <Inverter>
          <Sleep name="4" msec="4"/>
        </Inverter>
      </Fallback> <!-- of two -->
      <Sleep name="3" msec="3"/>
    </Sequence>"""


def names(text: str) -> list[str]:
    return [part.split()[0].strip("/>") for part in text.split("<") if part[:1].isalpha()][2:]


def test_move_several_nodes(page: Callable[..., Page]) -> None:
    shown = page(SEQUENCE)
    one, three = shown.place("<Sleep"), shown.place("<Sleep", 2)
    result = shown.do(protocol.Move([three, one], shown.place("<Fallback"), 1))
    assert shown.text == MAIN.format(
        """<Sequence>
      <!-- second -->
      <Fallback name="2"><AlwaysSuccess/>
        <Sleep name="1"
               msec="1"/>
        <Sleep name="3" msec="3"/>
        <Inverter>
          <Sleep name="4" msec="4"/>
        </Inverter>
      </Fallback> <!-- of two -->
    </Sequence>"""
    )
    assert shown.selected(result) == ["Sleep", "Sleep"]
    shown.do(protocol.Move([shown.place("<Inverter")], shown.place("<Sequence"), 0))
    assert names(shown.text)[:4] == ["Sequence", "Inverter", "Sleep", "Fallback"]
    with pytest.raises(EditError, match="cannot be moved into itself"):
        shown.do(protocol.Move([shown.place("<Inverter")], shown.place("<Inverter"), 0))


@pytest.mark.parametrize("index", range(5))
def test_move_within_a_parent(page: Callable[..., Page], index: int) -> None:
    shown = page("<Sequence><A/><B/><C/><D/></Sequence>")
    before = shown.text
    result = shown.do(
        protocol.Move([shown.place("<B/"), shown.place("<C/")], shown.place("<Sequence"), index)
    )
    expected = {0: "BCAD", 1: "ABCD", 2: "ABCD", 3: "ABCD", 4: "ADBC"}[index]
    assert "".join(names(shown.text)[1:]) == expected
    assert (shown.text == before) == (expected == "ABCD")
    assert shown.selected(result) == ["B", "C"]


def test_move_all_children_and_nodes_of_several_parents(page: Callable[..., Page]) -> None:
    shown = page("<Sequence>\n      <A/>\n      <B/>\n    </Sequence>")
    shown.do(protocol.Move([shown.place("<B/"), shown.place("<A/")], shown.place("<Sequence"), 1))
    assert names(shown.text) == ["Sequence", "A", "B"]
    shown = page("<Sequence><Fallback><A/></Fallback><Fallback><B/></Fallback></Sequence>")
    shown.do(protocol.Move([shown.place("<B/"), shown.place("<A/")], shown.place("<Fallback", 1), 1))
    assert names(shown.text) == ["Sequence", "Fallback", "Fallback", "A", "B"]


def test_move_between_documents(page: Callable[..., Page], project: Project) -> None:
    shown = page(SEQUENCE)
    other = Page(project, MAIN.format("<Sequence/>"), "untitled:other.xml")
    result = compute_edit(project, protocol.Move([shown.place("<Inverter")], other.place("<Seq"), 0))
    assert result.edit.changes.keys() == {shown.uri, other.uri}
    assert [place.uri for place in result.select] == [other.uri]


def test_remove_selects_a_neighbour(page: Callable[..., Page]) -> None:
    shown = page(SEQUENCE)
    assert shown.selected(shown.do(protocol.Remove([shown.place("<Sleep")]))) == ["Fallback"]
    assert shown.selected(shown.do(protocol.Remove([shown.place("<Sleep", 1)]))) == ["Fallback"]
    nodes = [shown.place("<Inverter"), shown.place("<Sleep"), shown.place("<AlwaysSuccess")]
    assert shown.selected(shown.do(protocol.Remove(nodes))) == ["Fallback"]
    assert shown.selected(shown.do(protocol.Remove([shown.place("<Sequence")]))) == []
    assert "<!-- second -->" not in shown.text


def test_duplicate_adjacent_nodes_as_a_block(page: Callable[..., Page]) -> None:
    shown = page("<Sequence><A/><B/><C/><D/></Sequence>")
    result = shown.do(protocol.Duplicate([shown.place("<A/"), shown.place("<B/"), shown.place("<D")]))
    assert "".join(names(shown.text)[1:]) == "ABABCDD"
    assert shown.selected(result) == ["A", "B", "D"]
    assert result.select[0] == shown.place("<A", 1)


def test_wrap_and_unwrap(page: Callable[..., Page]) -> None:
    shown = page(SEQUENCE)
    before = shown.text
    nodes = [shown.place("<Fallback"), shown.place("<Sleep", 2)]
    with pytest.raises(
        EditError, match="<Repeat> has exactly one child: wrap the nodes in a <Sequence> first"
    ):
        shown.do(protocol.Wrap(nodes, "Repeat"))
    with pytest.raises(EditError, match="follow each other in the same parent"):
        shown.do(protocol.Wrap([shown.place("<Sleep"), shown.place("<Sleep", 2)], "Fallback"))
    assert shown.selected(shown.do(protocol.Wrap(nodes, "Parallel"))) == ["Parallel"]
    assert names(shown.text)[:4] == ["Sequence", "Sleep", "Parallel", "Fallback"]
    result = shown.do(protocol.Unwrap(shown.place("<Parallel")))
    assert shown.selected(result) == ["Fallback", "Sleep"]
    assert shown.text == before
    shown.do(protocol.Wrap([shown.place("<Sleep")], "Repeat"))
    assert "<Repeat>" in shown.text
    with pytest.raises(EditError, match="the tree 'A' has exactly one root"):
        shown.do(protocol.Unwrap(shown.place("<Sequence")))


def test_unwrap_a_node_without_an_end_tag(page: Callable[..., Page]) -> None:
    shown = page('<Sequence><Fallback><Sleep msec="1"/></Sequence>')
    shown.do(protocol.Unwrap(shown.place("<Fallback")))
    assert shown.text == MAIN.format('<Sequence><Sleep msec="1"/></Sequence>')


def test_change_type(page: Callable[..., Page]) -> None:
    shown = page('<Sequence><Sleep name="a" msec="1" _skipIf="b"/><Condition ID="C" x="1"/></Sequence>')
    shown.do(protocol.ChangeType(shown.place("<Sleep"), "Script"))
    assert '<Script name="a" _skipIf="b" code=""/>' in shown.text
    shown.do(protocol.ChangeType(shown.place("<Sequence"), "IfThenElse"))
    shown.do(protocol.ChangeType(shown.place("<Condition"), "Sleep"))
    assert '<Action ID="Sleep"/></IfThenElse>' in shown.text
    shown.do(protocol.AddTree(URI, "B"))
    shown.do(protocol.Add(shown.place("<BehaviorTree", 1), 0, "AlwaysSuccess"))
    shown.do(protocol.ChangeType(shown.place("<Script"), "B"))
    shown.do(protocol.ChangeType(shown.place("<Action"), "B"))
    assert '<SubTree name="a" _skipIf="b" ID="B"/><SubTree ID="B"/>' in shown.text
    result = shown.do(protocol.ChangeType(shown.place("<SubTree"), "Inverter"))
    assert '<Inverter name="a" _skipIf="b"/>' in shown.text
    assert shown.selected(result) == ["Inverter"]
    same = compute_edit(shown.project, protocol.ChangeType(shown.place("<SubTree"), "B"))
    assert same.edit.changes == {}


def test_a_corrected_error_makes_no_warning_new(page: Callable[..., Page]) -> None:
    shown = page('<Sequence><Sleep msec="x"/><Script code="a := never"/></Sequence>')
    corrected = protocol.SetAttribute(shown.place("<Sleep"), "msec", "1")
    assert shown.do(corrected).notes == []
    added = protocol.SetAttribute(shown.place("<Sleep"), "_skipIf", "unknown > 1")
    assert "unknown" in shown.do(added).notes[0]


def test_set_an_attribute(page: Callable[..., Page]) -> None:
    shown = page('<Sleep msec="1"/>')
    result = shown.do(protocol.SetAttribute(shown.place("<Sleep"), "msec", 'one & "two"\n'))
    assert '<Sleep msec="one &amp; &quot;two&quot;&#10;"/>' in shown.text
    [note] = result.notes
    assert note.startswith("the port 'msec' of <Sleep> has the type unsigned int")
    shown.do(protocol.SetAttribute(shown.place("<Sleep"), "_skipIf", "a > 1"))
    shown.do(protocol.SetAttribute(shown.place("<Sleep"), "msec", None))
    assert '<Sleep _skipIf="a > 1"/>' in shown.text
    same = compute_edit(shown.project, protocol.SetAttribute(shown.place("<Sleep"), "msec", None))
    assert same.edit.changes == {}


def test_disable_and_enable(page: Callable[..., Page]) -> None:
    shown = page('<Sequence><Sleep _skipIf="a &gt; 1" msec="1"/><Sleep msec="2"/></Sequence>')
    places = [shown.place("<Sleep"), shown.place("<Sleep", 1)]
    shown.do(protocol.Disable(places[1:]))
    shown.do(protocol.Disable(places))
    assert '<Sleep _skipIf="true || (a > 1)" msec="1"/><Sleep msec="2" _skipIf="true"/>' in shown.text
    with pytest.raises(EditError, match="disabled already"):
        shown.do(protocol.Disable([shown.place("<Sleep")]))
    shown.do(protocol.Enable([shown.place("<Sleep"), shown.place("<Sleep", 1)]))
    assert '<Sleep _skipIf="a > 1" msec="1"/><Sleep msec="2"/>' in shown.text


def test_an_included_file_without_a_format_has_that_of_the_including_file(
    project: Project, tmp_path: Path
) -> None:
    text = MAIN.format("<Sleep/>").replace(' BTCPP_format="4"', "")
    shown = Page(project, text, (tmp_path / "a.xml").as_uri())
    with pytest.raises(EditError, match="format 3"):
        shown.do(protocol.Disable([shown.place("<Sleep")]))
    main = '<root BTCPP_format="4"><include path="a.xml"/></root>'
    project.open((tmp_path / "main.xml").as_uri(), main, 1)
    assert shown.drawing().format == 4
    shown.do(protocol.Disable([shown.place("<Sleep")]))
    assert shown.drawing().nodes[0].disabled
    project.open((tmp_path / "main.xml").as_uri(), main.replace("4", "3"), 2)
    assert shown.drawing().format == 3


# --- trees and models


def test_extract_and_inline(page: Callable[..., Page]) -> None:
    shown = page('<Sequence>\n      <Script code="a := 1"/>\n      <Sleep msec="{a}"/>\n    </Sequence>')
    before = shown.text
    result = shown.do(protocol.Extract(shown.place("<Sleep"), "Nap"))
    assert shown.selected(result) == ["SubTree"]
    assert '<SubTree ID="Nap" a="{a}"/>' in shown.text
    assert 'main_tree_to_execute="A"' in shown.text
    result = shown.do(protocol.Inline(shown.place("<SubTree")))
    assert result.notes == ["the tree 'Nap' is unused: 'A' doesn't call it, directly or indirectly"]
    assert shown.selected(result) == ["Sleep"]
    with pytest.raises(EditError, match="'A' is the main tree: choose another main tree first"):
        shown.do(protocol.RemoveTree(URI, "A"))
    shown.do(protocol.RemoveTree(URI, "Nap"))
    assert shown.text == before.replace('"4">', '"4" main_tree_to_execute="A">')
    shown.do(protocol.RemoveTree(URI, "A"))
    assert shown.text == '<root BTCPP_format="4">\n</root>\n'


def test_trees(page: Callable[..., Page]) -> None:
    shown = page("")
    shown.do(protocol.AddTree(URI, "A"))
    shown.do(protocol.AddTree(URI, "B"))
    assert shown.text == (
        '<root BTCPP_format="4" main_tree_to_execute="A">\n  <BehaviorTree ID="A"/>\n'
        '  <BehaviorTree ID="B"/>\n</root>\n'
    )
    shown.do(protocol.Add(shown.place("<BehaviorTree", 1), 0, "AlwaysSuccess"))
    shown.do(protocol.Add(shown.place("<BehaviorTree"), 0, "B"))
    with pytest.raises(EditError, match="the tree 'A' calls 'B': remove the call first, or inline it"):
        shown.do(protocol.RemoveTree(URI, "B"))
    shown.do(protocol.SetMainTree(URI, "B"))
    assert 'main_tree_to_execute="B"' in shown.text


def test_models_are_written_and_changed(page: Callable[..., Page]) -> None:
    shown = page('<Go goal="{a}"/>')
    goal = PalettePort("goal", "in", "Pose", "", "where & when")
    speed = PalettePort("speed", "in", "double", "1.5", "")
    shown.do(protocol.SetModel(URI, "Go", "Action", [goal]))
    assert shown.text.endswith(
        """  <TreeNodesModel>
    <Action ID="Go">
      <input_port name="goal" type="Pose">where &amp; when</input_port>
    </Action>
  </TreeNodesModel>
</root>
"""
    )
    written = shown.text
    shown.do(protocol.SetModel(URI, "Go", "Action", [goal]))
    assert shown.text == written
    shown.do(protocol.SetModel(URI, "Go", "Action", [goal, speed]))
    assert '<input_port name="speed" type="double" default="1.5"/>\n    </Action>' in shown.text
    shown.do(protocol.SetModel(URI, "Go", "Action", [speed, goal]))
    assert shown.text.index("speed") < shown.text.index("Pose")
    shown.do(protocol.SetModel(URI, "Go", "Condition", [goal]))
    assert shown.text == written.replace("Action", "Condition")
    shown.do(protocol.SetModel(URI, "Other", "Decorator", []))
    assert '<Decorator ID="Other"/>\n  </TreeNodesModel>' in shown.text
    shown.do(protocol.RemoveModel(URI, "Other"))
    assert shown.text == written.replace("Action", "Condition")


def test_a_node_type_and_its_ports_are_renamed_in_all_files(
    page: Callable[..., Page], tmp_path: Path
) -> None:
    model = '<TreeNodesModel><Action ID="Go"><input_port name="goal"/></Action></TreeNodesModel>'
    shown = page('<Go goal="{=}"/>')
    shown.show(shown.text.replace("</root>", f"{model}</root>"))
    other = shown.project.open("untitled:other.xml", "\ufeff" + MAIN.format('<Go goal="1"></Go>'), 1)
    target = PalettePort("target", "in", "", "", "")
    renaming = protocol.SetModel(URI, "Drive", "Action", [target], "Go", {"goal": "target"})
    result = compute_edit(shown.project, renaming)
    after = [apply_edits(source.text, edits_in(source, result)) for source in (shown.source, other)]
    named = shown.text.replace('goal="{=}"', 'target="{goal}"').replace("Go", "Drive")
    assert after[0] == named.replace('name="goal"', 'name="target"')
    assert after[1] == other.text.replace("Go", "Drive").replace("goal", "target")
    for command, reason in (
        (
            protocol.SetModel(URI, "A", "Action", [target], "Go", {"goal": "target"}),
            "the project has a tree 'A'",
        ),
        (protocol.SetModel(URI, "Go", "Action", [target]), "tree.xml:3 uses the port 'goal'"),
        (protocol.RemoveModel(URI, "Go"), "<Go> is used in .*tree.xml:3"),
    ):
        with pytest.raises(EditError, match=reason):
            compute_edit(shown.project, command)


# --- the clipboard


def test_copied_nodes_bring_their_trees_and_models(page: Callable[..., Page]) -> None:
    source = page(
        """<root BTCPP_format="4" main_tree_to_execute="A">
  <BehaviorTree ID="A">
    <Sequence>
      <Go goal="{g}"/>
      <SubTree ID="B"/>
      <Unknown/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="B">
    <SubTree ID="C"/>
  </BehaviorTree>
  <BehaviorTree ID="C"><Look/></BehaviorTree>
  <BehaviorTree ID="D"><Look/></BehaviorTree>
  <TreeNodesModel>
    <Action ID="Go"><input_port name="goal"/></Action>
    <Action ID="Look"/>
    <Action ID="Other"/>
  </TreeNodesModel>
</root>
"""
    )
    nodes = [source.place("<Go"), source.place("<SubTree"), source.place("<Unknown")]
    xml = copy_nodes(source.project, nodes)
    assert xml == (
        '<Go goal="{g}"/>\n<SubTree ID="B"/>\n<Unknown/>\n'
        '<BehaviorTree ID="B">\n  <SubTree ID="C"/>\n</BehaviorTree>\n'
        '<BehaviorTree ID="C"><Look/></BehaviorTree>\n'
        '<TreeNodesModel>\n  <Action ID="Go"><input_port name="goal"/></Action>\n  <Action ID="Look"/>\n'
        "</TreeNodesModel>\n"
    )
    shown = page("<Sequence/>")
    result = shown.do(protocol.Paste(shown.place("<Sequence"), 0, xml))
    assert shown.selected(result) == ["Go", "SubTree", "Unknown"]
    assert result.notes == [
        "the node 'Unknown' is unknown: write its model, or load its library",
        "the port 'goal' of <Go> reads {g}, which is never written",
    ]
    drawing = shown.drawing()
    assert [node.id for node in drawing.nodes] == ["Sequence", "Go", "SubTree", "SubTree", "Look", "Unknown"]
    assert [tree.id for tree in drawing.trees] == ["A", "B", "C"]
    # The parts that are there already are not pasted again.
    again = shown.do(protocol.Paste(shown.place("<Sequence"), 0, xml))
    assert len(again.edit.changes[URI]) == 1


@pytest.mark.parametrize(
    ("body", "command", "problems"),
    [
        (
            "<Inverter>\n<Sleep msec='1'/></Inverter>",
            lambda shown: protocol.Remove([shown.place("<Sleep")]),
            [(1, "<Inverter> has no child", (), (0, 0))],
        ),
        # The warning of before names another line.
        (
            "<Sequence>\n<Fallback><AlwaysSuccess/><Sleep msec='1'/></Fallback></Sequence>",
            lambda shown: protocol.Add(shown.place("<Sequence"), 0, "Sequence"),
            [],
        ),
        (
            "<Sequence/>",
            lambda shown: protocol.Add(shown.place("<Sequence"), 0, "Sleep"),
            [],
        ),
        (
            "<ReactiveSequence><Sleep msec='1'/></ReactiveSequence>",
            lambda shown: protocol.Add(shown.place("<Reactive"), 1, "Sleep"),
            [(2, "<Sleep> is a second asynchronous child of <ReactiveSequence>", (), (0, 0))],
        ),
        (
            "<Sequence><Script code='a:=&lt;1'/><Script code='a:=&lt;1'/></Sequence>",
            lambda shown: protocol.SetAttribute(shown.place("<Script"), "code", "a&&: =<1"),
            [(1, "invalid script in 'code' of <Script>: expected a value", ("code",), (3, 4))],
        ),
        # A field shows problems that remain.
        (
            "<Sequence><Script code='a:=&lt;1'/><Script code='a:=&lt;1'/></Sequence>",
            lambda shown: protocol.SetAttribute(shown.place("<Script"), "code", "a :=<1"),
            [(1, "invalid script in 'code' of <Script>: expected a value", ("code",), (4, 5))],
        ),
    ],
)
def test_a_preview_has_the_problems_that_an_operation_would_add(
    page: Callable[..., Page],
    body: str,
    command: Callable[[Page], AnyCommand],
    problems: list[tuple[object, ...]],
) -> None:
    shown = page(body)
    before = shown.text
    found = preview_edit(shown.project, command(shown)).problems
    assert shown.text == before
    assert [
        (item.severity, item.message[: len(str(text))], item.data.attributes, item.data.characters)
        for item, (_, text, *_) in zip(found, problems, strict=True)
    ] == problems


def test_paste_into_an_empty_document(page: Callable[..., Page]) -> None:
    shown = page("")
    shown.do(protocol.Paste(Place(URI, Position(0, 0)), 0, MAIN.format("<Sleep msec='1'/>")))
    assert shown.text == MAIN.format("<Sleep msec='1'/>").replace('"A"', '"MainTree"')


def test_pasting_too_much_is_refused(page: Callable[..., Page]) -> None:
    shown = page("<Inverter/>")
    with pytest.raises(EditError, match="exactly one child"):
        shown.do(protocol.Paste(shown.place("<Inverter"), 0, "<Sleep/><Sleep/>"))
    with pytest.raises(EditError, match="call each other recursively"):
        shown.do(protocol.Paste(shown.place("<Inverter"), 0, "<SubTree ID='A'/>"))
    result = shown.do(protocol.Paste(shown.place("<Inverter"), 0, "<SubTree ID='X'/>"))
    assert result.notes == ["there is no tree 'X'"]


# --- documents with errors


def test_a_document_with_errors_stays_editable(page: Callable[..., Page]) -> None:
    shown = page('<Inverter><Sleep/><Foo/><SubTree ID="None"/><Sleep msec="x"/></Inverter>')
    shown.do(protocol.Remove([shown.place("<Foo")]))
    shown.do(protocol.Wrap([shown.place("<SubTree")], "Inverter"))
    with pytest.raises(EditError, match="exactly one child"):
        shown.do(protocol.Duplicate([shown.place("<Sleep")]))


def test_a_broken_text_is_editable_before_the_fault(page: Callable[..., Page]) -> None:
    shown = page(
        MAIN.format("<Sequence>\n  <Sleep/>\n  <A/>\n  <Fallback>\n  <Sleep msec=></Fallback></Sequence>")
    )
    assert "line 7" in shown.drawing().broken
    shown.do(protocol.Remove([shown.place("<Sleep")]))
    assert "<Sleep/>" not in shown.text
    with pytest.raises(EditError, match=r"the text is not XML \(line 6: .*: correct it first"):
        shown.do(protocol.Remove([shown.place("<Fallback")]))
    with pytest.raises(EditError, match="the text is not XML"):
        page("<root <").do(protocol.AddTree(URI, "A"))
    assert page("hello").text == MAIN.format("hello")


# --- random sequences


IDS = (
    "Sequence", "Fallback", "Inverter", "Repeat", "IfThenElse", "Sleep", "Script", "SetBlackboard",
    "AlwaysFailure", "Nothing", "New", "Extracted",
)  # fmt: skip
PASTED = (
    "<Sleep msec='1'/>",
    "<Fallback>\n    <A b='{c}'/>\n    <Script code='d := 1;\n  e := 2'/>\n</Fallback>\n",
    '<SubTree ID="New"/><BehaviorTree ID="New"><Look at="{x}"/></BehaviorTree>'
    '<TreeNodesModel><Action ID="Look"><input_port name="at"/></Action></TreeNodesModel>',
    "<A><B/>",
    "text",
    MAIN.format("<Sequence>\n      <Sleep/>\n    </Sequence>"),
)
VALUES = ("a", "{b}", "<&\"'>", "1\n2", "🤖", "", "a := 1", None, "\x01")


def random_command(rng: random.Random, drawing: Drawing, uri: str) -> AnyCommand:
    """Return an operation, which need not be possible."""
    trees = [tree.place for tree in drawing.trees if tree.place.uri == uri]
    own = [node.place for node in drawing.nodes if node.place.uri == uri]
    nodes = own or trees or [Place(uri, Position(0, 0))]
    names = [tree.id for tree in drawing.trees]
    node, some = rng.choice(nodes), rng.sample(nodes, min(len(nodes), rng.choice((1, 1, 1, 2, 3))))
    run = nodes.index(node)
    adjacent = nodes[run : run + rng.randint(1, 3)]
    parent, index = rng.choice([*nodes, *trees]), rng.randint(-1, 5)
    id, name = rng.choice([*IDS, *names]), rng.choice([*names, "New", "Extracted", "Sleep", "a b", ""])
    ports = [PalettePort(port, rng.choice(("in", "out", "inout")), "int", rng.choice("1 "), "x < 1")
             for port in rng.sample(("a", "b", "c", "name"), rng.randint(0, 3))]  # fmt: skip
    node_type = rng.choice(("Action", "Condition", "Control", "Decorator", "SubTree"))
    attribute = rng.choice(("name", "_skipIf", "msec", "code", "ID", "a b", "_description"))
    commands: list[AnyCommand] = [
        protocol.Add(parent, index, id),
        protocol.Add(parent, index, id),
        protocol.Paste(parent, index, rng.choice(PASTED)),
        protocol.Move(rng.choice((some, adjacent)), parent, index),
        protocol.Move(rng.choice((some, adjacent)), parent, index),
        protocol.Remove(some),
        protocol.Duplicate(rng.choice((some, adjacent))),
        protocol.Wrap(rng.choice(([node], adjacent)), id),
        protocol.Unwrap(node),
        protocol.ChangeType(node, id),
        protocol.SetAttribute(rng.choice([*nodes, *trees]), attribute, rng.choice(VALUES)),
        protocol.Disable(some),
        protocol.Enable(some),
        protocol.Extract(node, name),
        protocol.Inline(
            next((item.place for item in drawing.nodes if item.calls and item.place in own), node)
        ),
        protocol.AddTree(uri, name),
        protocol.RemoveTree(uri, name),
        protocol.SetMainTree(uri, name),
        protocol.SetModel(uri, name, node_type, ports),
        protocol.SetModel(uri, "Renamed", node_type, ports, name, {"a": "d"}),
        protocol.RemoveModel(uri, name),
    ]
    return rng.choice(commands)


@pytest.fixture(scope="module")
def texts() -> dict[str, list[str]]:
    return repository_texts()


@pytest.mark.parametrize("seed", range(max(1, SEQUENCES // 25)))
def test_random_sequences(project: Project, texts: dict[str, list[str]], tmp_path: Path, seed: int) -> None:
    rng = random.Random(f"operations:{seed}")
    included = '<root BTCPP_format="4"><BehaviorTree ID="Included"><Sleep msec="1"/></BehaviorTree></root>'
    (tmp_path / "included.xml").write_text(included)
    outcomes: dict[str, int] = {}
    for number in range(min(SEQUENCES, 25)):
        file = rng.choice(list(texts))
        start = rng.choice((decorated(rng.choice(texts[file]), rng), texts[file][0], ""))
        page = Page(project, start, (tmp_path / "tree.xml").as_uri())
        undo: list[list[Edit]] = []
        for _ in range(LENGTH):
            drawing = page.drawing(rng.choice([None, "New", "Extracted"]))
            command = random_command(rng, drawing, page.uri)
            name = type(command).__name__
            before, source = page.text, page.source
            try:
                result = page.do(command)
            except EditError:
                continue
            outcomes[name] = outcomes.get(name, 0) + 1
            edits = edits_of(source, result)
            undo.append(invert_edits(before, edits))
            check_result(page, before, edits, result, f"{number} of {seed}: {command}\n{before}\n{page.text}")
        text = page.text
        for edits in reversed(undo):
            text = apply_edits(text, edits)
        assert text == start
    assert len(outcomes) > 10, outcomes


DOCUMENT_TYPE = "<!DOCTYPE a [<!ENTITY b 'c'>]>"
MISTAKES = ("", "<", ">", '"', "&", "</", "/>", "<!--", "]]>", "<a b='", "\0", "\ud800", DOCUMENT_TYPE)


@pytest.mark.parametrize("seed", range(4))
def test_random_mistakes(project: Project, texts: dict[str, list[str]], tmp_path: Path, seed: int) -> None:
    rng = random.Random(f"mistakes:{seed}")
    done = 0
    for _ in range(min(SEQUENCES, 100) // 4):
        text = decorated(rng.choice(texts[rng.choice(list(texts))]), rng)
        for _ in range(rng.randint(1, 3)):
            start = rng.randrange(len(text) + 1)
            text = text[:start] + rng.choice(MISTAKES) + text[start + rng.choice((0, 1, 3, 30, 300)) :]
        page = Page(project, text, (tmp_path / "tree.xml").as_uri())
        for _ in range(5):
            drawing = page.drawing()
            assert len(palette_of(project, page.source).items) > 50
            for node in drawing.nodes[:3]:
                with contextlib.suppress(EditError):
                    form_of(project, page.source, node.place)
            with contextlib.suppress(EditError):
                page.do(random_command(rng, drawing, page.uri))
                done += 1
    assert done > 0


def check_result(page: Page, before: str, edits: list[Edit], result: EditResult, place: str) -> None:
    """The edits are apart, and the drawing has the nodes of the tree that btcore loads."""
    at = 0
    for edit in sorted(edits):
        assert at <= edit.start <= edit.end <= len(before), place
        at = edit.end
    if before.count("\n") == before.count("\r\n") > 0:
        assert page.text.count("\n") == page.text.count("\r\n"), place
    elements = {element.start for element in page.source.scan.elements}
    for selected in result.select:
        assert offset_in(page.source, selected.position) in elements, place
    drawing = page.drawing()
    if drawing.broken:
        return
    reading = read_trees(page.project, page.source)
    try:
        tree = btcore.loads(page.text, nodes=reading.nodes)
    except TreeError:
        return
    loaded = [(node.id, node.name) for node in tree.nodes]
    # A node whose name is empty is drawn with its ID.
    drawn = [
        (node.id, node.name if number >= len(loaded) or loaded[number][1] else "")
        for number, node in enumerate(drawing.nodes)
    ]
    assert drawn == loaded, place
