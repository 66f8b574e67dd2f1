"""The request btcore/palette: registered nodes, models and trees with their groups and ports."""

from pathlib import Path

from btcore_studio.language.palette import palette_of
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import PalettePort

TREE = """<root BTCPP_format="4">
  <include path="küche.xml"/>
  <BehaviorTree ID="A" _description="All of it">
    <Sequence><Unknown x="1"/><Open door="{d}"/></Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="Open"><inout_port name="door" type="Door" default="{front}">the door</inout_port></Action>
    <SubTree ID="Kochen"><input_port name="rezept"/></SubTree>
  </TreeNodesModel>
</root>
"""


def test_nodes_models_and_trees(project: Project, tmp_path: Path) -> None:
    (tmp_path / "küche.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Kochen"><Sleep/></BehaviorTree></root>', encoding="utf-8"
    )
    source = project.open((tmp_path / "haus.xml").as_uri(), TREE, 1)
    items = {item.id: item for item in palette_of(project, source).items}
    assert len(items) == len(palette_of(project, source).items)
    ids = ("Sleep", "IsObstacle", "Open", "Unknown", "A", "Kochen")
    assert {id: (items[id].kind, items[id].group) for id in ids} == {
        "Sleep": ("action", "BehaviorTree.CPP"),
        "IsObstacle": ("condition", "btcore_robot"),
        "Open": ("action", "haus"),
        "Unknown": ("action", "haus"),
        "A": ("subtree", "haus.xml"),
        "Kochen": ("subtree", "küche.xml"),
    }
    assert [id for id in items if items[id].is_editable] == ["Open", "Unknown"]
    assert items["Unknown"].ports == [PalettePort("x", "in", "", "", "")]
    assert "SubTree" not in items
    assert items["Open"].ports == [PalettePort("door", "inout", "Door", "{front}", "the door")]
    assert items["Kochen"].ports == [PalettePort("rezept", "inout", "", "", "")]
    assert items["A"].about == "All of it"
    assert all(item.symbol.startswith("M") for item in items.values())
    assert items["Sequence"].symbol != items["Fallback"].symbol


def test_format_3_has_its_own_nodes(project: Project) -> None:
    items = {item.id for item in palette_of(project, project.open("untitled:a", "<root/>", 1)).items}
    assert "SequenceStar" in items
    assert "SubTreePlus" not in items
