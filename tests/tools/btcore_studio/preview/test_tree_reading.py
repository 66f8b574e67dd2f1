"""What the preview shows of a file: nodes with their places, unknown nodes, folded nodes, and errors."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from btcore.registry.registry import Registry
from btcore_studio.preview import tree_reading
from btcore_studio.preview.tree_reading import TreeFile, draw


def drawing(file: TreeFile, text: str | None = None, *folded: str) -> dict[str, Any]:
    analysis = file.read(text).plans
    assert analysis is not None
    return draw(analysis, None, folded)


def test_every_node_has_its_place_in_its_file(tree_file: TreeFile) -> None:
    shown = drawing(tree_file)
    visit = [("Inverter", "part.xml", 3), ("Sleep", "part.xml", 3)]
    names = [Path(file["name"]).name for file in shown["files"]]
    assert [(node["id"], names[node["file"]], node["line"]) for node in shown["nodes"]] == [
        ("Sequence", "tree.xml", 4),
        ("Rover", "tree.xml", 5),
        ("Script", "tree.xml", 6),
        ("SubTree", "tree.xml", 7),
        *visit,
        ("SubTree", "tree.xml", 8),
        *visit,
    ]
    assert shown["nodes"][5]["column"] == 15
    assert shown["nodes"][5]["last"] == 3
    assert shown["nodes"][0]["name"].startswith("Küche <img")


def test_drawing_escapes_names_and_has_a_card_for_each_node(tree_file: TreeFile) -> None:
    svg = drawing(tree_file)["svg"]
    assert "<img" not in svg
    assert "</script>" not in svg
    root = ElementTree.fromstring(svg)
    cards = [element for element in root.iter() if element.get("data-uid")]
    assert [card.get("data-uid") for card in cards] == [str(number) for number in range(1, 10)]
    assert not any("style" in element.tag for element in root.iter())


def test_unknown_node_is_drawn_and_reported(tree_file: TreeFile) -> None:
    reading = tree_file.read()
    assert reading.summary()["diagnostics"][0]["code"] == "E101"
    rover = drawing(tree_file)["nodes"][1]
    assert (rover["kind"], rover["ports"]) == ("action", [["speed", "{tempo}"]])


def test_installed_node_is_drawn_even_if_the_file_describes_another(tmp_path: Path) -> None:
    text = """<root BTCPP_format="4"><BehaviorTree ID="A"><IsObstacle/></BehaviorTree>
<TreeNodesModel><Control ID="IsObstacle"/></TreeNodesModel></root>"""
    nodes = Registry.standard()
    nodes.add_plugins()
    file = TreeFile(tmp_path / "tree.xml", lambda document: nodes)
    assert file.read(text).summary()["diagnostics"] == []
    assert drawing(file, text)["nodes"][0]["kind"] == "condition"


@pytest.mark.parametrize(
    ("code", "attributes"),
    [("E201", 'msecs="5"'), ("E202", 'msec="five"'), ("E206", 'msec="5" _skipIf="1 +"')],
)
def test_errors_in_attributes_do_not_prevent_drawing(tree_file: TreeFile, code: str, attributes: str) -> None:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="A"><Sleep {attributes}/></BehaviorTree></root>'
    assert code in [item["code"] for item in tree_file.read(text).summary()["diagnostics"]]
    [node] = drawing(tree_file, text)["nodes"]
    assert node["id"] == "Sleep"


def test_keys_of_nodes_survive_edits_elsewhere(tree_file: TreeFile) -> None:
    before = {node["key"]: node["name"] for node in drawing(tree_file)["nodes"]}
    assert len(before) == 9
    edited = tree_file.path.read_text(encoding="utf-8").replace(
        "<Rover", '<AlwaysSuccess/>\n<Rover color="red"'
    )
    after = {node["key"]: node["name"] for node in drawing(tree_file, edited)["nodes"]}
    assert before.items() <= after.items()


def test_folded_node_hides_its_descendants_only(tree_file: TreeFile) -> None:
    nodes = drawing(tree_file)["nodes"]
    folded = drawing(tree_file, None, nodes[3]["key"])
    assert [node["hidden"] for node in folded["nodes"]] == [0, 0, 0, 2, 0, 0, 0, 0, 0]
    assert folded["svg"].count("data-uid") == 7
    assert ">+2</text>" in folded["svg"]
    assert "9 nodes" in folded["svg"]


def test_every_call_can_be_folded(tree_file: TreeFile) -> None:
    nodes = drawing(tree_file)["nodes"]
    folded = drawing(tree_file, None, *(node["key"] for node in nodes if node["calls"]))
    assert folded["svg"].count("data-uid") == 5
    assert 'class="frame"' not in folded["svg"]


def test_large_tree_is_folded_at_deepest_levels(tree_file: TreeFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tree_reading, "MAX_CARDS", 6)
    shown = drawing(tree_file)
    assert shown["svg"].count("data-uid") == 6
    assert sum(node["hidden"] for node in shown["nodes"]) == 3


@pytest.mark.parametrize(("old", "new"), [("</Sequence>", ""), ("<Rover", "<Inverter/><Rover"), ("<", "")])
def test_broken_text_has_diagnostics_and_no_drawing(tree_file: TreeFile, old: str, new: str) -> None:
    broken = tree_file.path.read_text(encoding="utf-8").replace(old, new)
    reading = tree_file.read(broken)
    assert reading.plans is None
    assert reading.summary()["diagnostics"]
    assert reading.summary()["text"] == broken


def test_text_that_no_file_can_contain_is_read(tree_file: TreeFile) -> None:
    shown = drawing(tree_file, tree_file.path.read_text(encoding="utf-8").replace("Küche", "K\ud800"))
    assert shown["nodes"][0]["name"].startswith("K? <img")


def test_trees_that_call_each_other_have_no_drawing(tree_file: TreeFile) -> None:
    loop = tree_file.path.read_text(encoding="utf-8").replace('ID="Visit"', 'ID="Rounds"')
    assert tree_file.read(loop).plans is None


def test_each_tree_of_a_library_can_be_shown(tree_file: TreeFile) -> None:
    text = tree_file.path.read_text(encoding="utf-8")
    analysis = tree_file.read(text.replace(' main_tree_to_execute="Rounds"', "")).plans
    assert analysis is not None
    assert draw(analysis, "Visit", ())["tree"] == "Visit"
    assert len(draw(analysis, "Visit", ())["nodes"]) == 2
