"""Definitions and references in a project of several files, with UTF-16 positions."""

from pathlib import Path

import pytest

import btcore
from btcore_studio.language.navigation import find_definition, find_references
from btcore_studio.language.node_models import NodeModel
from btcore_studio.language.project import Settings
from tests.tools.btcore_studio.language.marked_project import MarkedProject

MAIN = """<root BTCPP_format="4" main_tree_to_execute="Zustellen">
    <include path="räume/türen.xml"/>
    <!-- 🤖 <SubTree ID="Zustellen"/> is no call -->
    <BehaviorTree ID="Zustellen">
        <Sequence name="🚚 Zustellung">
            <Script name="📦📦" code=" ziel := 'Küche 🍳'; versuche := 1 "/>
            <SubTree ID="TürÖffnen" name="🚪" raum="{ziel}" zähler="{versuche}" tempo="{=}"/>
            <SubTree ID="Melden" _autoremap="true" _skipIf="versuche &lt; 1 &amp;&amp; ziel == ''"/>
            <Fahren zu="{ziel}" _onSuccess="@fahrten := 1"/>
        </Sequence>
    </BehaviorTree>
    <BehaviorTree ID="Melden">
        <Sequence>
            <Script code="meldung := ziel"/>
            <ScriptCondition code="@fahrten != 0"/>
        </Sequence>
    </BehaviorTree>
    <TreeNodesModel>
        <Action ID="Fahren"><input_port name="zu"/></Action>
    </TreeNodesModel>
</root>
"""
DOORS = """<root BTCPP_format="4">
    <BehaviorTree ID="TürÖffnen">
        <Sequence name="𝄞 Öffnen">
            <SetBlackboard value="{raum}" output_key="letzter_raum"/>
            <Script code="zähler += 1; tempo := 2"/>
        </Sequence>
    </BehaviorTree>
    <TreeNodesModel>
        <SubTree ID="TürÖffnen"><input_port name="raum"/></SubTree>
    </TreeNodesModel>
</root>
"""
# Names in scripts are ASCII.
DOORS = DOORS.replace("zähler +=", "zaehler +=")
MAIN = MAIN.replace("zähler=", "zaehler=")


@pytest.fixture
def workspace(tmp_path: Path) -> MarkedProject:
    workspace = MarkedProject(tmp_path)
    workspace.write({"main.xml": MAIN, "räume/türen.xml": DOORS})
    return workspace


@pytest.mark.parametrize(
    ("name", "place", "expected"),
    [
        ("main.xml", '<SubTree ID="Tür¦Öffnen"', ["räume/türen.xml:2:TürÖffnen"]),
        ("main.xml", '<Sub¦Tree ID="TürÖffnen"', ["räume/türen.xml:2:TürÖffnen"]),
        ("main.xml", 'main_tree_to_execute="¦Zustellen"', ["main.xml:4:Zustellen"]),
        ("räume/türen.xml", '<SubTree ID="¦TürÖffnen"', ["räume/türen.xml:2:TürÖffnen"]),
        ("main.xml", 'path="räume¦/türen.xml"', ["räume/türen.xml:1:"]),
        ("main.xml", "<Fah¦ren", ["main.xml:19:Fahren"]),
        ("main.xml", "<Fahren z¦u", ["main.xml:19:zu"]),
        # A key is defined where the tree writes it first, across remappings.
        ("main.xml", '<Fahren zu="{zi¦el}"', ["main.xml:6:ziel"]),
        ("räume/türen.xml", 'value="{¦raum}"', ["main.xml:6:ziel"]),
        ("räume/türen.xml", '<input_port name="raum¦"', ["main.xml:6:ziel"]),
        ("main.xml", "ra¦um=", ["main.xml:6:ziel"]),
        ("räume/türen.xml", "zae¦hler", ["main.xml:6:versuche"]),
        ("main.xml", 'tempo="{¦=}"', ["räume/türen.xml:5:tempo"]),
        ("main.xml", "meldung := ¦ziel", ["main.xml:6:ziel"]),
        ("main.xml", "&amp;&amp; ¦ziel ==", ["main.xml:6:ziel"]),
        ("main.xml", "@fahr¦ten != 0", ["main.xml:9:@fahrten"]),
        ("räume/türen.xml", "letzter_ra¦um", ["räume/türen.xml:4:letzter_raum"]),
        # Nothing is defined elsewhere.
        ("main.xml", 'name="🚚 ¦', []),
        ("main.xml", "is no ca¦ll", []),
        ("main.xml", "<incl¦ude", []),
    ],
)
def test_definition(workspace: MarkedProject, name: str, place: str, expected: list[str]) -> None:
    assert workspace.shown(find_definition(*workspace.at(name, place))) == expected


def test_definition_of_a_built_in_node_is_its_source(workspace: MarkedProject) -> None:
    (found,) = find_definition(*workspace.at("main.xml", "<Script¦Condition"))
    assert found.uri.endswith("/btcore/nodes/script_nodes.py")
    assert (
        "class ScriptCondition"
        in workspace.document(Path(btcore.__file__).parent / "nodes/script_nodes.py").text
    )
    assert workspace.text_at(found.uri, found.range) == "ScriptCondition"


def test_references_of_a_key_cross_files_and_remappings(workspace: MarkedProject) -> None:
    expected = [
        "main.xml:6:ziel",
        "main.xml:7:raum",
        "main.xml:7:ziel",
        "main.xml:8:ziel",
        "main.xml:9:ziel",
        "main.xml:14:ziel",
        "räume/türen.xml:4:raum",
        "räume/türen.xml:9:raum",
    ]
    for name, place in [("main.xml", '{zi¦el}" zaehler'), ("räume/türen.xml", "{ra¦um}")]:
        assert workspace.shown(find_references(*workspace.at(name, place))) == expected
    without = find_references(*workspace.at("main.xml", "meldung := zi¦el"), include_declaration=False)
    assert workspace.shown(without) == expected[1:]


def test_two_calls_of_a_tree_do_not_mix_their_keys(workspace: MarkedProject) -> None:
    call = '<SubTree ID="TürÖffnen" raum="{anderer_raum}"/>'
    workspace.open("main.xml", MAIN.replace("<Fahren", call + "<Fahren"))
    found = workspace.shown(find_references(*workspace.at("main.xml", "ander¦er_raum")))
    expected = ["main.xml:9:raum", "main.xml:9:anderer_raum"]
    assert found == [*expected, "räume/türen.xml:4:raum", "räume/türen.xml:9:raum"]


def test_references_of_trees_and_nodes(workspace: MarkedProject) -> None:
    found = find_references(*workspace.at("main.xml", '<SubTree ID="TürÖffnen¦"'))
    expected = ["main.xml:7:TürÖffnen", "räume/türen.xml:2:TürÖffnen", "räume/türen.xml:9:TürÖffnen"]
    assert workspace.shown(found) == expected
    found = find_references(*workspace.at("räume/türen.xml", '<BehaviorTree ID="¦TürÖffnen'), False)
    assert workspace.shown(found) == [expected[0], expected[2]]
    found = find_references(*workspace.at("main.xml", "<Fahre¦n"))
    assert workspace.shown(found) == ["main.xml:9:Fahren", "main.xml:19:Fahren"]


def test_unsaved_text_and_broken_xml_are_searched(workspace: MarkedProject) -> None:
    unsaved = MAIN.replace("<Sequence>\n", "<Sequence\n", 1).replace("</Sequence>", "", 1)
    unsaved = unsaved.replace("ziel := 'Küche 🍳'", "🍳; ziel := ").replace(
        "</BehaviorTree>", '<SubTree ID="TürÖffnen" raum="{neu', 1
    )
    workspace.open("main.xml", unsaved)
    found = workspace.shown(find_references(*workspace.at("räume/türen.xml", '<SubTree ID="¦TürÖffnen"')))
    assert found == [
        "main.xml:7:TürÖffnen", "main.xml:11:TürÖffnen", "räume/türen.xml:2:TürÖffnen",
        "räume/türen.xml:9:TürÖffnen",
    ]  # fmt: skip
    found = workspace.shown(find_definition(*workspace.at("main.xml", "meldung := zi¦el")))
    assert found == ["main.xml:6:ziel"]


def test_trees_of_a_groot_project_see_each_other(workspace: MarkedProject) -> None:
    project = '<root BTCPP_format="4"><include path="a.xml"/><include path="b.xml"/></root>'
    tree = '<root BTCPP_format="4"><BehaviorTree ID="{0}"><SubTree ID="{1}" k="{{x}}"/></BehaviorTree></root>'
    other = tree.format("B", "None").replace('<SubTree ID="None" k="{x}"/>', '<Script code="k := 1"/>')
    files = {
        "g/a.xml": tree.format("A", "B"),
        "g/b.xml": other,
        "g/robot.btproj": project,
        "other/b.xml": other,
    }
    workspace.write(files)
    assert workspace.shown(find_definition(*workspace.at("g/a.xml", 'ID="B¦"'))) == ["g/b.xml:1:B"]
    assert workspace.shown(find_definition(*workspace.at("g/a.xml", "{x¦}"))) == ["g/b.xml:1:k"]
    assert workspace.shown(find_references(*workspace.at("other/b.xml", 'ID="B¦"'))) == ["other/b.xml:1:B"]


def test_python_leaf_is_defined_in_its_source(workspace: MarkedProject) -> None:
    source = workspace.folder / "leaves.py"
    source.write_text("# 🤖\ndef fahren():\n    pass\n")
    workspace.project.set_models([NodeModel("Fahren", "ACTION", file=str(source), line=2)], {})
    (found,) = find_definition(*workspace.at("main.xml", "<Fahre¦n"))
    assert found.uri.endswith("leaves.py")
    assert found.range.start.line == 1


def test_setting_for_given_keys_has_no_effect_on_definitions(workspace: MarkedProject) -> None:
    workspace.project.configure([workspace.folder], Settings(given=("ziel",)))
    assert workspace.shown(find_definition(*workspace.at("main.xml", '{zi¦el}" zaehler'))) == [
        "main.xml:6:ziel"
    ]


def test_included_file_without_trees_is_not_read(workspace: MarkedProject) -> None:
    (workspace.folder / "secret.txt").write_text("<BehaviorTree ID='Geheim'/>")
    text = '<root BTCPP_format="4"><include path="secret.txt"/><include path="\0"/><include path="."/>'
    workspace.open("neu.xml", f'{text}<BehaviorTree ID="A"><SubTree ID="Geheim"/></BehaviorTree></root>')
    assert find_definition(*workspace.at("neu.xml", 'SubTree ID="¦Geheim"')) == []
    (found,) = find_definition(*workspace.at("neu.xml", 'path="¦secret.txt"'))
    assert found.uri == (workspace.folder / "secret.txt").as_uri()
