"""The request btcore/drawing: nodes with their places, whatever is wrong with the document."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from msgspec.structs import replace

import btcore
from btcore.errors import TreeError
from btcore.xml.plan.plan import plan
from btcore_drawing.diagram import DiagramNode, diagram_of_document
from btcore_studio.language import drawing
from btcore_studio.language.drawing import diagram_of_tree, draw_document
from btcore_studio.language.node_keys import KeyedNode, node_keys
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import (
    DocumentIdentifier,
    Drawing,
    DrawingParams,
    DrawnNode,
    Position,
)
from btcore_studio.language.tree_reading import read_trees

ROOT = Path(__file__).parents[4]
URI = "untitled:tree.xml"
TREE = """<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <include path="part.xml"/>
  <BehaviorTree ID="Rounds">
    <Sequence name="Küche &lt;img src=x onerror=alert(1)&gt;">
      <Rover speed="{tempo}"/>
      <Script code="tempo := 3"/>
      <!-- 🤖 --><SubTree ID="Visit"/>
      <SubTree ID="Visit" _skipIf="true || (a > 1)"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
PART = """<root BTCPP_format="4">
  <BehaviorTree ID="Visit">
    <Inverter><Sleep name="&lt;/script&gt;" msec="5"/></Inverter>
  </BehaviorTree>
</root>
"""
MAIN = '<root BTCPP_format="4"><BehaviorTree ID="A">{}</BehaviorTree></root>'

Draw = Callable[..., Drawing]


@pytest.fixture
def draw(project: Project) -> Draw:
    """Draw a text, of the tree *tree* and with the *folded* nodes."""

    def draw(text: str, tree: str | None = None, *folded: str, uri: str = URI, since: int = 0) -> Drawing:
        params = DrawingParams(DocumentIdentifier(uri), tree, frozenset(folded), since=since)
        return draw_document(project, project.open(uri, text, 1), params)

    return draw


@pytest.fixture
def rounds(draw: Draw, tmp_path: Path) -> Callable[..., Drawing]:
    """Draw TREE, which includes PART, or another text in its place."""
    (tmp_path / "part.xml").write_text(PART, encoding="utf-8")
    uri = (tmp_path / "tree.xml").as_uri()
    return lambda text=TREE, tree=None, *folded, since=0: draw(text, tree, *folded, uri=uri, since=since)


def ids(shown: Drawing) -> list[str]:
    return [node.id for node in shown.nodes]


def test_every_node_has_its_place_in_its_document(rounds: Draw) -> None:
    shown = rounds()
    visit = [("Inverter", "part.xml", Position(2, 4)), ("Sleep", "part.xml", Position(2, 14))]
    assert [(node.id, node.place.uri.rpartition("/")[2], node.place.position) for node in shown.nodes] == [
        ("Sequence", "tree.xml", Position(3, 4)),
        ("Rover", "tree.xml", Position(4, 6)),
        ("Script", "tree.xml", Position(5, 6)),
        ("SubTree", "tree.xml", Position(6, 17)),
        *visit,
        ("SubTree", "tree.xml", Position(7, 6)),
        *visit,
    ]
    assert [shown.nodes[0].end, shown.nodes[5].end] == [Position(8, 15), Position(2, 54)]
    assert [node.parent for node in shown.nodes] == [0, 1, 1, 1, 4, 5, 1, 7, 8]
    assert [node.disabled for node in shown.nodes] == [False] * 6 + [True, False, False]
    assert [tree.id for tree in shown.trees] == ["Rounds", "Visit"]
    assert [(tree.callers, tree.is_main) for tree in shown.trees] == [([], True), (["Rounds"], False)]


def test_names_are_escaped_and_each_node_has_a_card(rounds: Draw) -> None:
    shown = rounds()
    svg = "".join([shown.svg, *(node.card for node in shown.nodes)])
    assert "<img" not in svg
    assert "</script>" not in svg
    assert all(ElementTree.fromstring(f"<g>{node.card}</g>").find("rect") is not None for node in shown.nodes)
    assert [node.edge == "" for node in shown.nodes] == [True] + [False] * 8
    ElementTree.fromstring(shown.svg)


def test_nodes_that_only_moved_are_not_sent_again(rounds: Draw) -> None:
    before = rounds()
    edited = TREE.replace("<Rover", '<AlwaysSuccess/>\n<Rover color="red"')
    whole, changes = rounds(edited), rounds(edited, since=before.number)
    # The number of the last node has two digits now.
    assert ids(changes) == ["AlwaysSuccess", "Rover", "Sleep"]
    nodes: dict[int, DrawnNode] = {}
    for index, known, parent, line, character, end_line, end_character, x, y, edge in changes.moved:
        node, end = before.nodes[known], Position(end_line, end_character)
        place = replace(node.place, position=Position(line, character))
        edge = node.edge if edge is None else edge
        nodes[index] = replace(node, parent=parent, place=place, end=end, x=x, y=y, edge=edge)
    others = iter(changes.nodes)
    assert [nodes.get(index) or next(others) for index in range(10)] == whole.nodes
    assert rounds(edited, since=whole.number + 99).moved == []


def test_keys_of_nodes_survive_edits_elsewhere(rounds: Draw) -> None:
    before = {node.key: node.name for node in rounds().nodes}
    edited = TREE.replace("<Rover", '<AlwaysSuccess/>\n<Rover color="red"')
    after = {node.key: node.name for node in rounds(edited).nodes}
    assert len(before) == 9
    assert before.items() <= after.items()


def test_a_node_with_an_empty_name_has_the_key_of_the_running_node(draw: Draw) -> None:
    text = MAIN.format('<Sequence name=""><AlwaysSuccess name=""/><AlwaysSuccess/></Sequence>')
    parents = 0, 1, 1
    running = zip(btcore.loads(text).nodes, parents, strict=True)
    keys = node_keys(KeyedNode(node.uid, parent, node.id, node.name) for node, parent in running)
    assert [node.key for node in draw(text).nodes] == list(keys.values())


def test_folded_nodes_hide_their_descendants_only(rounds: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    folded = rounds(TREE, None, rounds().nodes[3].key)
    assert [node.hidden for node in folded.nodes] == [0, 0, 0, 2, 0, 0, 0, 0, 0]
    assert [bool(node.card) for node in folded.nodes] == [True] * 4 + [False] * 2 + [True] * 3
    assert ">+2</text>" in folded.nodes[3].card
    monkeypatch.setattr(drawing, "MAX_CARDS", 6)
    assert [bool(node.card) for node in rounds().nodes].count(True) == 6


def test_child_limits(draw: Draw) -> None:
    shown = draw(
        MAIN.format("<Sequence><Inverter/><IfThenElse/><Sleep/><Unknown/><SubTree ID='B'/></Sequence>")
    )
    assert [node.children for node in shown.nodes] == [(1, None), (1, 1), (2, 3), (0, 0), (0, None), (0, 0)]
    assert [node.kind for node in shown.nodes[4:]] == ["action", "subtree"]


def test_unsaved_texts_of_includes_are_drawn(rounds: Draw, project: Project, tmp_path: Path) -> None:
    assert "AlwaysFailure" not in ids(rounds())
    changed = PART.replace("Sleep", "AlwaysFailure")
    project.open((tmp_path / "part.xml").as_uri(), changed, 1)
    assert ids(rounds()).count("AlwaysFailure") == 2


@pytest.mark.parametrize(
    ("children", "expected"),
    [
        ("", []),
        ("<Sequence/>", ["Sequence"]),
        ("<Inverter><Sleep/><Sleep/></Inverter>", ["Inverter", "Sleep", "Sleep"]),
        ('<Sequence><Sleep msecs="5" _skipIf="1 +"/></Sequence>', ["Sequence", "Sleep"]),
        ('<Sequence><SubTree ID="Missing"/><SubTree/></Sequence>', ["Sequence", "SubTree", "SubTree"]),
        ('<Sequence><SubTree ID="A"/></Sequence>', ["Sequence", "SubTree"]),
        ('<Action ID="a/b" name=""/>', ["a/b"]),
        ("<Action/>", ["Action"]),
        ("<BehaviorTree><Sleep/></BehaviorTree>", ["BehaviorTree", "Sleep"]),
    ],
)
def test_trees_with_errors_are_drawn(draw: Draw, children: str, expected: list[str]) -> None:
    shown = draw(MAIN.format(children))
    assert ids(shown) == expected
    assert shown.tree == "A"
    assert shown.broken == ""
    assert bool(shown.svg) == bool(expected)


@pytest.mark.parametrize("text", ["", " \n", "\ufeff", "<!-- a -->", "<a/>", '<root BTCPP_format="7"/>'])
def test_a_document_without_trees_has_an_empty_drawing(draw: Draw, text: str) -> None:
    shown = draw(text)
    assert (shown.tree, shown.svg, shown.nodes, shown.trees) == ("", "", [], [])


def test_positions_after_a_byte_order_mark(draw: Draw) -> None:
    shown = draw("\ufeff" + MAIN.format("<Sleep/>"))
    assert shown.nodes[0].place.position == Position(0, 1 + MAIN.index("{"))


@pytest.mark.parametrize("cut", range(0, len(TREE), 7))
def test_a_text_that_is_cut_off_is_drawn_up_to_its_end(rounds: Draw, cut: int) -> None:
    whole = [] if cut < TREE.index("<Sequence") else rounds().nodes
    shown = rounds(TREE[:cut])
    assert bool(shown.broken) == (TREE[:cut].strip() != "" and cut < len(TREE.rstrip()))
    complete = [
        node
        for node in whole
        if node.place.uri.endswith("tree.xml") and _offset(TREE, node) + len(node.id) + 1 < cut
    ]
    names = [(node.id, node.place) for node in shown.nodes if node.place.uri.endswith("tree.xml")]
    assert names[: len(complete)] == [(node.id, node.place) for node in complete]


def _offset(text: str, node: DrawnNode) -> int:
    """Return the offset of an element of *text*, which has no wide character before it in its line."""
    lines = text.splitlines(keepends=True)
    return sum(map(len, lines[: node.place.position.line])) + node.place.position.character


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("</Sequence>", "", 9),
        ("</root>", "", 1),
        ('ID="Visit"/>', 'ID="Visit/>', 7),
        ("<Rover", "<Rover <", 5),
        ('code="', "code=", 6),
        ("<root", "<x\n<root", 1),
    ],
)
def test_a_broken_text_keeps_its_picture(rounds: Draw, old: str, new: str, line: int) -> None:
    shown = rounds(TREE.replace(old, new, 1))
    assert "Sequence" in ids(shown)
    assert "Rover" in ids(shown)
    assert shown.broken.startswith("line "), shown.broken


def test_trees_of_a_project_of_groot_call_each_other(draw: Draw, project: Project, tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(PART)
    (tmp_path / "all.btproj").write_text(
        '<root BTCPP_format="4" project_name="a"><include path="tree.xml"/><include path="part.xml"/></root>'
    )
    text = TREE.replace('<include path="part.xml"/>', "")
    (tmp_path / "tree.xml").write_text(text, encoding="utf-8")
    project.configure([tmp_path], project.settings)
    shown = draw(text, uri=(tmp_path / "tree.xml").as_uri())
    assert ids(shown).count("Inverter") == 2
    assert [tree.id for tree in shown.trees] == ["Rounds", "Visit"]
    whole = draw((tmp_path / "all.btproj").read_text(), uri=(tmp_path / "all.btproj").as_uri())
    assert (whole.tree, [tree.id for tree in whole.trees if tree.is_main]) == ("Rounds", ["Rounds"])
    other = draw(PART, uri=(tmp_path / "part.xml").as_uri())
    assert (other.tree, other.trees[0].callers) == ("Visit", ["Rounds"])
    assert ids(draw(text, uri=(tmp_path / "tree.xml").as_uri())).count("Inverter") == 2


def test_trees_of_the_document_come_first(rounds: Draw) -> None:
    library = TREE.replace(' main_tree_to_execute="Rounds"', "").replace(
        "</root>", '<BehaviorTree ID="Other"><Sleep/></BehaviorTree></root>'
    )
    assert rounds(library).tree == "Rounds"
    assert rounds(library, "Visit").tree == "Visit"
    assert rounds(library, "Nothing").tree == "Rounds"
    assert len(rounds(library, "Visit").nodes) == 2


def test_a_deep_and_a_doubling_tree_are_bounded(draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = draw("<root><BehaviorTree>" + "<Inverter>" * 30_000)
    assert 5_000 < len(deep.nodes) <= drawing.MAX_ROWS
    monkeypatch.setattr(drawing, "MAX_ROWS", 500)
    tree = '<BehaviorTree ID="T{}"><Sequence>{}</Sequence></BehaviorTree>'
    trees = "".join(tree.format(number, 2 * f'<SubTree ID="T{number + 1}"/>') for number in range(30))
    assert len(draw(f'<root BTCPP_format="4">{trees}</root>', "T0").nodes) == 500


FILES = sorted([*(ROOT / "trees").rglob("*.xml"), *(ROOT / "tests/robot_nodes").rglob("*.xml")])


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_the_drawing_of_a_valid_tree_has_the_nodes_of_its_plan(project: Project, file: Path) -> None:
    source = project.open(file.as_uri(), file.read_text(encoding="utf-8"), 1)
    reading = read_trees(project, source)
    for tree in reading.definitions.by_id.values():
        plans = plan(reading.definitions._replace(main_tree=tree), reading.nodes)
        try:
            plans.diagnostics.raise_errors()
        except TreeError:
            continue
        drawn = diagram_of_tree(reading, tree)
        assert drawn is not None
        assert _facts(drawn) == _facts(diagram_of_document(plans))


def _facts(node: DiagramNode) -> tuple[object, ...]:
    facts = (node.uid, node.id, node.name, node.type, node.ports, dict(node.conditions), node.tree)
    return (*facts, node.about, [_facts(child) for child in node.children])
