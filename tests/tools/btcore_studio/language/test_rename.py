"""A renamed project is valid and behaves as before."""

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore.lint.validate import validate_document
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import apply_edits
from btcore.xml.models.model_file import add_models
from btcore.xml.read.read import parse_file
from btcore_studio.language.navigation import find_definition
from btcore_studio.language.node_models import NodeModel, PortModel
from btcore_studio.language.project import Project, Settings
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.rename import RenameError, prepare_rename, rename_symbol
from tests.conformance.recorded_cases import conformance_registry, read_cases, run_case
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits
from tests.tools.btcore_studio.language.marked_project import MarkedProject

DATA = Path(__file__).parents[3] / "conformance" / "data"
MAIN = """<root BTCPP_format="4" main_tree_to_execute="Zustellen">
    <include path="räume/türen.xml"/>
    <BehaviorTree ID="Zustellen">
        <Sequence name="🚚 Zustellung">
            <Script name="📦📦" code=" ziel := 'Küche 🍳'; n := 1; tempo := 3; fahrten := 0 "/>
            <SubTree ID="TürÖffnen" name="🚪" raum="{ziel}" zahl="{n}" tempo="{=}" art='a'/>
            <SubTree ID="Melden" _autoremap="true" art="&quot;🔔&quot;"
                     _skipIf="n &lt; 1 &amp;&amp; ziel == ''"/>
            <Action ID="Fahren" zu="{ziel}" _onSuccess="@fahrten := 1"/>
            <Fahren zu=" {ziel} "/>
        </Sequence>
    </BehaviorTree>
    <BehaviorTree ID="Melden">
        <Warten zeit="1">
            <Sequence>
                <Script code="meldung := ziel + art; _eigen := n"/>
                <ScriptCondition code="@fahrten != 2 || art == 'x'"/>
                <SetBlackboard value="{meldung}" output_key="@fahrten_text"/>
            </Sequence>
        </Warten>
    </BehaviorTree>
    <TreeNodesModel>
        <Action ID="Fahren"><input_port name="zu"/></Action>
        <Decorator ID="Warten"><input_port name="zeit"/></Decorator>
    </TreeNodesModel>
</root>
"""
DOORS = """<root BTCPP_format="4">
    <BehaviorTree ID="TürÖffnen">
        <Sequence name="𝄞 Öffnen">
            <SetBlackboard value="{raum}" output_key="türen 🚪"/>
            <Script code="zahl += 1; tempo := 2"/><Sleep msec="{=}"/>
        </Sequence>
    </BehaviorTree>
    <TreeNodesModel>
        <SubTree ID="TürÖffnen">
            <input_port name="raum"/><input_port name="msec" default="{tempo}"/>
        </SubTree>
    </TreeNodesModel>
</root>
"""
FILES = {"main.xml": MAIN, "räume/türen.xml": DOORS}


@pytest.fixture
def project(tmp_path: Path) -> MarkedProject:
    project = MarkedProject(tmp_path)
    project.write(FILES)
    return project


def behaviour(folder: Path, old: str, new: str) -> object:
    """Run the project. Return its diagnostics, result, nodes and entries, in which *new* is called *old*."""
    nodes = Registry.standard()
    add_models(nodes, folder / "main.xml")
    found = validate_document(parse_file(folder / "main.xml"), nodes=nodes)
    tree = btcore.load(folder / "main.xml", nodes=nodes)
    status = tree.tick_while_running()

    def back(name: str) -> str:
        return old if name == new else name

    return (
        sorted(item.code for item in found),
        status,
        [(back(node.id), back(node.name), node.status) for node in tree],
        [
            {back(key): (entry.value, entry.sequence_id) for key, entry in board.local_entries().items()}
            for board in (subtree.blackboard for subtree in tree.subtrees)
        ],
    )


@pytest.mark.parametrize(
    ("name", "place", "old", "new", "changed"),
    [
        # The outer key of a remapping keeps its name, and so does the inner key.
        ("räume/türen.xml", 'value="{ra¦um}"', "raum", "zimmer", ['zimmer="{ziel}"', 'value="{zimmer}"']),
        ("main.xml", "; ¦n :=", "n", "anzahl", ['zahl="{anzahl}"', "_eigen := anzahl", "anzahl &lt; 1"]),
        # An inner key that is written as {=} outside.
        ("räume/türen.xml", "tem¦po :=", "tempo", "takt", ['takt="{tempo}"', "takt := 2", '"{tempo}"']),
        ("main.xml", "tem¦po :=", "tempo", "takt", ['tempo="{takt}"', "takt := 3", 'default="{takt}"']),
        ("räume/türen.xml", 'name="ms¦ec"', "msec", "dauer", ['msec="{dauer}"', 'name="dauer"']),
        # _autoremap gives a key the same name in both trees.
        ("main.xml", "meldung := zi¦el", "ziel", "ort", ['raum="{ort}"', 'zu="{ort}"', 'zu=" {ort} "']),
        ("main.xml", "meldung := ziel + ar¦t", "art", "sorte", ['sorte="&quot;', "sorte == 'x'", " art='a'"]),
        ("main.xml", "mel¦dung :=", "meldung", "text", ["text := ziel", 'value="{text}"']),
        # "@" is the blackboard of the main tree.
        ("main.xml", "@¦fahrten !=", "fahrten", "touren", ["@touren :=", "@touren !="]),
        ("main.xml", 'key="@fahrten¦_text', "fahrten_text", "& 'mehr'", ['key="@&amp; &apos;mehr&apos;"']),
        ("räume/türen.xml", "türen ¦🚪", "türen 🚪", "🔑 & <Schloss>", ["🔑 &amp; &lt;Schloss&gt;"]),
        # Trees, nodes and names.
        ("main.xml", 'SubTree ID="TürÖf¦fnen', "TürÖffnen", "Öffnen🚪", ['<BehaviorTree ID="Öffnen🚪"']),
        ("main.xml", 'execute="Zu¦stellen', "Zustellen", "Bringen", ['execute="Bringen"', ' ID="Bringen"']),
        ("main.xml", '<Action ID="Fah¦ren" zu', "Fahren", "Rollen", ["<Rollen zu", '<Action ID="Rollen"><']),
        ("main.xml", "</War¦ten>", "Warten", "Später", ["<Später zeit", "</Später>", 'ID="Später"']),
        ("main.xml", 'name="📦¦📦"', "📦📦", 'Pa"k&t', ['name="Pa&quot;k&amp;t"']),
    ],
)  # fmt: skip
def test_renamed_project_behaves_as_before(
    project: MarkedProject, name: str, place: str, old: str, new: str, changed: list[str]
) -> None:
    before = behaviour(project.folder, old, old)
    target = prepare_rename(*project.at(name, place))
    assert target.placeholder == old
    project.write(project.apply(rename_symbol(*project.at(name, place), new)))
    texts = "".join((project.folder / file).read_text(encoding="utf-8") for file in FILES)
    assert [text for text in changed if text not in texts] == []
    assert behaviour(project.folder, old, new) == before


@pytest.mark.parametrize(
    ("name", "place", "new", "reason"),
    [
        ("main.xml", "; ¦n :=", "tempo", "the tree 'Zustellen' uses the key 'tempo' already"),
        ("main.xml", "; ¦n :=", "_n", "begin with '_' are not remapped automatically"),
        ("main.xml", "; ¦n :=", "größe", r"not a name in scripts, and main\.xml:5 uses the key"),
        ("main.xml", "; ¦n :=", "true", "not a name in scripts"),
        ("main.xml", "; ¦n :=", "@n", "rename it without '@'"),
        ("räume/türen.xml", "value=\"{ra¦um}", "2raum", "must begin with a letter"),
        ("räume/türen.xml", "value=\"{ra¦um}", "name", "this attribute identifies the node"),
        ("räume/türen.xml", "türen ¦🚪", "{türen}", "braces have another meaning"),
        ("räume/türen.xml", "türen ¦🚪", "a\nb", "control character"),
        ("räume/türen.xml", "türen ¦🚪", "", "1 to 1,000 characters"),
        ("räume/türen.xml", "türen ¦🚪", "x" * 1001, "1 to 1,000 characters"),
        ("main.xml", 'SubTree ID="TürÖf¦fnen', "Melden", r"main\.xml names a tree 'Melden' already"),
        ("main.xml", 'SubTree ID="TürÖf¦fnen', "Tür öffnen", "' ' is not allowed"),
        ("main.xml", 'SubTree ID="TürÖf¦fnen', "Fahren", "a node has this name"),
        ("main.xml", 'SubTree ID="TürÖf¦fnen', "root", "the name is reserved"),
        ("main.xml", "<Fah¦ren zu", "Warten", "the project has a node 'Warten' already"),
        ("main.xml", "<Fah¦ren zu", "Melden", "the project has a tree 'Melden' already"),
        ("main.xml", "<Fah¦ren zu", "1und1", "not a name in XML"),
        ("main.xml", "<Fah¦ren zu", "Action", "the name is reserved"),
    ],
)  # fmt: skip
def test_invalid_new_name_is_refused(
    project: MarkedProject, name: str, place: str, new: str, reason: str
) -> None:
    arguments = project.at(name, place)
    prepare_rename(*arguments)
    with pytest.raises(RenameError, match=reason):
        rename_symbol(*arguments, new)


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ("<Se¦quence name", "<Sequence> is a node of btcore"),
        ("<incl¦ude", "can be renamed here"),
        ('path="räume¦/', "can be renamed here"),
        ("<Fahren z¦u=", "the code of <Fahren> declares its port 'zu'"),
        ('zeit="1¦"', "can be renamed here"),
        ("BTCPP¦_format", "can be renamed here"),
    ],
)
def test_what_cannot_be_renamed_is_refused(project: MarkedProject, place: str, reason: str) -> None:
    with pytest.raises(RenameError, match=reason):
        prepare_rename(*project.at("main.xml", place))


def test_names_in_code_are_not_renamed(project: MarkedProject) -> None:
    project.project.set_models([NodeModel("Fahren", "ACTION", file="leaves.py", line=2)], {})
    with pytest.raises(
        RenameError, match=r"the Python code of <Fahren> declares its ID: rename it in leaves\.py"
    ):
        prepare_rename(*project.at("main.xml", "<Fah¦ren zu"))
    missing = '<root BTCPP_format="4"><BehaviorTree ID="A"><SubTree ID="B"/><Stop/></BehaviorTree></root>'
    project.open("missing.xml", missing)
    with pytest.raises(RenameError, match="no file of the project defines the tree 'B'"):
        prepare_rename(*project.at("missing.xml", 'ID="¦B'))
    with pytest.raises(RenameError, match="no <TreeNodesModel> of the project declares the node 'Stop'"):
        prepare_rename(*project.at("missing.xml", "<¦Stop"))
    project.project.configure([project.folder], Settings(given=("ziel", "unbenutzt")))
    with pytest.raises(RenameError, match="according to the setting 'given' the program sets 'ziel'"):
        prepare_rename(*project.at("main.xml", "meldung := zi¦el"))
    with pytest.raises(RenameError, match="uses the key 'unbenutzt' already"):
        rename_symbol(*project.at("main.xml", "; ¦n :="), "unbenutzt")


def test_key_that_is_a_default_of_a_port_is_refused(project: MarkedProject) -> None:
    port = PortModel("zu", default="{ziel}")
    project.project.set_models([NodeModel("Fahren", "ACTION", (port,))], {})
    prepare_rename(*project.at("main.xml", 'code=" zi¦el :='))
    project.open("main.xml", MAIN.replace('<Fahren zu=" {ziel} "/>', "<Fahren/>"))
    with pytest.raises(
        RenameError, match=r"'ziel' is the default of the port 'zu' of <Fahren> in line 10: write zu="
    ):
        prepare_rename(*project.at("main.xml", "meldung := zi¦el"))


def test_unsaved_text_and_broken_xml_are_renamed(project: MarkedProject) -> None:
    broken = DOORS.replace("<Sequence", "<Sequence <Fallback").replace('name="raum"/>', 'name="raum" 🚪')
    project.open("räume/türen.xml", broken)
    changed = project.apply(rename_symbol(*project.at("main.xml", "ra¦um="), "zimmer"))
    assert changed["räume/türen.xml"] == broken.replace("raum", "zimmer")
    assert changed["main.xml"] == MAIN.replace("raum=", "zimmer=")
    changed = project.apply(rename_symbol(*project.at("main.xml", 'SubTree ID="¦TürÖffnen"'), "Tür"))
    assert changed["räume/türen.xml"] == broken.replace("TürÖffnen", "Tür")


def test_trees_of_other_programs_keep_their_names(project: MarkedProject) -> None:
    other = DOORS.replace("raum", "zimmer")
    project.write(
        {"anderes/main.xml": other, "anderes/aufruf.xml": MAIN.replace("räume/türen.xml", "main.xml")}
    )
    changed = project.apply(rename_symbol(*project.at("main.xml", 'SubTree ID="¦TürÖffnen"'), "Tür"))
    assert sorted(changed) == ["main.xml", "räume/türen.xml"]
    changed = project.apply(
        rename_symbol(*project.at("anderes/main.xml", '<BehaviorTree ID="¦TürÖffnen"'), "Tür")
    )
    assert sorted(changed) == ["anderes/aufruf.xml", "anderes/main.xml"]


def test_two_programs_that_share_a_tree_are_renamed_together(project: MarkedProject) -> None:
    second = '<root BTCPP_format="4"><include path="räume/türen.xml"/><BehaviorTree ID="Zweiter">'
    second += '<SubTree ID="TürÖffnen" raum="{x}" zahl="3" tempo="1"/></BehaviorTree></root>'
    project.write({"zweiter.xml": second})
    changed = project.apply(rename_symbol(*project.at("main.xml", "ra¦um="), "zimmer"))
    assert changed["zweiter.xml"] == second.replace("raum", "zimmer")
    changed = project.apply(rename_symbol(*project.at("zweiter.xml", 'SubTree ID="¦TürÖffnen"'), "Tür"))
    assert sorted(changed) == ["main.xml", "räume/türen.xml", "zweiter.xml"]


def test_huge_number_of_connections_is_bounded(project: MarkedProject) -> None:
    ports = "".join(f'<input_port name="p{number}" default="{{q{number}}}"/>' for number in range(1000))
    calls = '<SubTree ID="A"/>' * 400
    text = f'<BehaviorTree ID="A"><Script code="p1 := 1"/></BehaviorTree><BehaviorTree ID="B">{calls}'
    models = f'</BehaviorTree><TreeNodesModel><SubTree ID="A">{ports}</SubTree></TreeNodesModel>'
    project.open("main.xml", f'<root BTCPP_format="4">{text}{models}</root>')
    assert project.shown(find_definition(*project.at("main.xml", 'name="¦p1"'))) == ["main.xml:1:p1"]
    with pytest.raises(RenameError, match="more than 300,000 connections"):
        prepare_rename(*project.at("main.xml", 'name="¦p1"'))


# --- recorded trees


def renamings(project: Project, rng: random.Random, count: int) -> Iterator[tuple[str, str, bool]]:
    """Yield (old name, renamed text, whether a tree was renamed) for several names of the only document."""
    document = project.open_documents[0]
    symbols = symbols_of(project)
    uses = list(symbols.files[document.uri].key_uses())
    trees = [
        place.value_start for id in symbols.trees for _, place, _ in symbols.places_of_tree(id, document.uri)
    ]
    for _ in range(count):
        is_tree = not uses or rng.random() < 0.25
        offset = rng.choice(trees) if is_tree else rng.choice(uses).start
        try:
            old = prepare_rename(project, document, offset).placeholder
            changes = rename_symbol(project, document, offset, "renamed")
        except RenameError:
            continue
        edits = changes[document.uri]
        text = apply_edits(document.text, edits)
        assert apply_edits(text, invert_edits(document.text, edits)) == document.text
        yield old, text, is_tree


@pytest.mark.parametrize(("file", "least"), [("v4_scopes", 25), ("v4_full", 25), ("v3_full", 25)])
def test_recorded_trees_behave_as_before(file: str, least: int) -> None:
    nodes = conformance_registry()
    rng = random.Random(file)
    compared = 0
    for case in rng.sample(list(read_cases(DATA / f"{file}.jsonl.gz")), 25):
        project = Project()
        project.registry = nodes
        # The recorded values of the blackboard are set by the program.
        project.configure([], Settings(given=tuple(case.get("bb", {}))))
        project.open("untitled:tree", case["xml"], 1)
        before = without_messages(run_case(case, nodes))
        for old, text, _ in renamings(project, rng, 4):
            selected = "renamed" if case.get("tree") == old else case.get("tree")
            after = without_messages(run_case({**case, "xml": text, "tree": selected}, nodes))
            # The name of a SubTree node without a name is the ID of its tree.
            assert after.replace('"renamed"', f'"{old}"') == before, (case["id"], old)
            compared += 1
    assert compared >= least


def without_messages(result: dict[str, Any]) -> str:
    """Return a result as text, in which errors have no message."""
    if "load_error" in result:
        return "load_error"
    for tick in result["ticks"]:
        tick.pop("exception", None)
        tick["bb"] = sorted(map(str, tick.get("bb", {}).values()))
    return json.dumps(result)
