"""Completion: tags, ports, values, keys, calls of trees, and paths."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from lsprotocol import types

import btcore
from btcore.registry.manifest import takes_children
from btcore.xml.read.read import parse_text
from btcore_studio.language.completion import MAX_ITEMS, complete
from btcore_studio.language.descriptions import is_mandatory
from btcore_studio.language.diagnostics import check
from btcore_studio.language.node_models import models_of
from btcore_studio.language.project import Project
from tests.tools.btcore_studio.language.conftest import CURSOR, ROOT, OpenAtCursor

HEAD = '<root BTCPP_format="4"><BehaviorTree ID="Größe🤖">'
Completer = Callable[..., dict[str, types.CompletionItem]]


@pytest.fixture
def items(project: Project, open_at_cursor: OpenAtCursor) -> Completer:
    """Return the completion items at the cursor by label, after a check of the replaced range."""

    def complete_at(marked: str, trigger: str = "", snippets: bool = True) -> dict[str, types.CompletionItem]:
        document, offset = open_at_cursor(marked)
        found = complete(project, document, offset, trigger, snippets).items
        cursor = document.positions.position(offset)
        for item in found:
            assert isinstance(item.text_edit, types.TextEdit)
            replaced = item.text_edit.range
            assert replaced.start.line == replaced.end.line == cursor.line
            assert replaced.start.character <= cursor.character <= replaced.end.character
        return {item.label: item for item in found}

    return complete_at


def inserted(item: types.CompletionItem) -> str:
    assert isinstance(item.text_edit, types.TextEdit)
    return item.text_edit.new_text


def accepted(marked: str, item: types.CompletionItem) -> str:
    """Return the text after *item* was accepted."""
    assert isinstance(item.text_edit, types.TextEdit)
    text = marked.replace(CURSOR, "")
    first, last = item.text_edit.range.start, item.text_edit.range.end
    lines = text.split("\n")
    units = lines[first.line].encode("utf-16-le")
    before, after = units[: 2 * first.character], units[2 * last.character :]
    lines[first.line] = (before + inserted(item).encode("utf-16-le") + after).decode("utf-16-le")
    return "\n".join(lines)


# --- tags


def test_tags_of_nodes_come_with_their_mandatory_ports(items: Completer) -> None:
    found = items(HEAD + "<Sequence>\n<¦")
    assert inserted(found["Delay"]) == 'Delay delay_msec="$1">\n\t$0\n</Delay>'
    assert inserted(found["Move"]) == 'Move goal="{${1:goal}}"/>$0'
    assert inserted(found["RunOnce"]) == "RunOnce>\n\t$0\n</RunOnce>"
    assert inserted(found["Precondition"]) == 'Precondition if="$1">\n\t$0\n</Precondition>'
    assert inserted(found["/Sequence>"]) == "/Sequence>"
    assert "Navigates to *goal*" in found["Move"].documentation.value  # type: ignore[union-attr]
    assert found["Move"].insert_text_format is types.InsertTextFormat.Snippet


def test_tags_without_snippets_and_without_bracket(items: Completer) -> None:
    marked = HEAD + "<Sequence>\n  Mo¦\n</Sequence>"
    item = items(marked, snippets=False)["Move"]
    assert accepted(marked, item) == HEAD + "<Sequence>\n  <Move\n</Sequence>"
    assert item.insert_text_format is types.InsertTextFormat.PlainText
    assert items(HEAD + "<Sequence> ¦", trigger=" ") == {}


def test_only_the_name_of_a_written_tag_is_replaced(items: Completer) -> None:
    marked = HEAD + '<Mo¦ve goal="0;0"/>'
    assert accepted(marked, items(marked)["Patrol"]) == HEAD + '<Patrol goal="0;0"/>'


@pytest.mark.parametrize("start", ["<Inverter><AlwaysSuccess/><¦", "<AlwaysSuccess><¦", "<Sequence/><¦"])
def test_no_node_where_no_child_is_allowed(items: Completer, start: str) -> None:
    assert "Sequence" not in items(HEAD + start)


def test_tags_outside_of_trees(items: Completer) -> None:
    assert list(items("<¦")) == ["root"]
    assert set(items("<root>\n<¦\n</root>")) == {"BehaviorTree", "include", "TreeNodesModel"}
    assert "Condition" in items("<root><TreeNodesModel><¦")
    assert set(items('<root><TreeNodesModel><Action ID="A"><¦</Action>')) == {
        "input_port",
        "output_port",
        "inout_port",
    }


def test_end_tags(items: Completer) -> None:
    for marked, expected in (
        ("<Delay></¦", "<Delay></Delay>"),
        ("<Delay></De¦", "<Delay></Delay>"),
        ("<Delay></De¦>", "<Delay></Delay>"),
    ):
        found = items(HEAD + marked)
        assert list(found) == ["Delay"]
        assert accepted(HEAD + marked, found["Delay"]) == HEAD + expected


def test_only_text_in_the_line_of_the_cursor_is_replaced(items: Completer) -> None:
    marked = HEAD + "<¦\n  Mo/>"
    assert accepted(marked, items(marked)["Move"]) == HEAD + "<Move\n  Mo/>"
    assert "{=}" in items(HEAD + "<Move goal='¦1;\n2'/>")  # the check is in the fixture


# --- attributes


def test_ports_come_first_then_the_conditions(items: Completer) -> None:
    found = items(HEAD + "<Move ¦/>")
    assert list(found)[:4] == ["goal", "error", "error_code", "name"]
    assert inserted(found["error_code"]) == 'error_code="{${1:error_code}}"$0'
    assert found["goal"].detail == "→ Pose2D"
    assert {"_skipIf", "_while", "_onHalted"} <= found.keys()
    assert "goal" not in items(HEAD + "<Move goal='1;2' ¦/>")
    assert "_skipIf" not in items("<root><BehaviorTree><Move ¦")  # format 3
    assert items(HEAD + "<Move goal='1;2'¦/>") == {}


def test_a_written_attribute_is_renamed_only(items: Completer) -> None:
    marked = HEAD + "<Move ga¦ol='ä'/>"
    assert accepted(marked, items(marked)["goal"]) == HEAD + "<Move goal='ä'/>"
    before = HEAD + '<Move ¦name="ä"/>'
    assert accepted(before, items(before, snippets=False)["goal"]) == HEAD + '<Move goal="" name="ä"/>'


SUBTREES = """<root BTCPP_format="4"><TreeNodesModel><SubTree ID="Küche">
<input_port name="ziel"/><input_port name="speed" default="0.5"/></SubTree></TreeNodesModel>
<BehaviorTree ID="Küche"><Sequence><Move goal="{ziel}"/><Move goal="{other}"/></Sequence></BehaviorTree>
<BehaviorTree ID="Main"><Sequence>"""


def test_calls_of_trees(items: Completer) -> None:
    found = items(SUBTREES + "<¦")
    assert inserted(found['SubTree ID="Küche"']) == 'SubTree ID="Küche" ziel="{${1:ziel}}"/>$0'
    assert 'SubTree ID="Main"' not in found
    ids = items(SUBTREES + '<SubTree ID="¦"/>')
    assert list(ids) == ["Küche"]
    ports = items(SUBTREES + '<SubTree ID="Küche" ¦/>')
    assert list(ports)[:3] == ["ziel", "other", "speed"]
    assert ports["other"].detail == "Pose2D"
    assert "_autoremap" in ports
    assert list(items(SUBTREES + '<SubTree ID="Küche" _autoremap="¦"/>')) == ["false", "true"]
    assert {"Küche", "Main"} <= items(
        '<root BTCPP_format="4" main_tree_to_execute="¦"' + SUBTREES[23:]
    ).keys()


def test_a_call_connects_what_the_tree_reads_but_does_not_write(items: Completer) -> None:
    path = ROOT / "trees/navigation/navigate_to_pose_w_replanning_and_recovery.xml"
    tree = path.read_text(encoding="utf-8")
    main = '<BehaviorTree ID="🤖"><Sequence>\n<¦</Sequence></BehaviorTree></root>'
    found = items(tree.replace("</root>", main))
    call = 'SubTree ID="NavigateToPoseWithRecovery"'
    assert inserted(found[call]) == f'{call} goal="{{${{1:goal}}}}"/>$0'


def test_calls_of_trees_in_format_3(items: Completer) -> None:
    trees = SUBTREES.replace(' BTCPP_format="4"', "")
    assert inserted(items(trees + "<¦")['SubTree ID="Küche"']) == 'SubTree ID="Küche" ziel="${1:ziel}"/>$0'
    assert inserted(items(trees + '<SubTreePlus ID="Küche" ¦')["ziel"]) == 'ziel="{${1:ziel}}"$0'
    calls = trees + '<Move goal="{kitchen}"/><SubTree{} ID="Küche" ziel="¦"/>'
    assert list(items(calls.replace("{}", ""))) == ["kitchen"]
    assert list(items(calls.replace("{}", "Plus"))) == ["{kitchen}", "{ziel}", "="]
    assert "__shared_blackboard" in items(trees + '<SubTree ID="Küche" ¦')


# --- values


def test_values_of_enums_and_booleans(items: Completer) -> None:
    assert list(items(HEAD + '<RunOnce then_skip="¦">'))[:2] == ["false", "true"]
    statuses = items(HEAD + '<Precondition if="1" else="¦">')
    assert {"SUCCESS", "FAILURE", "SKIPPED"} <= statuses.keys()
    assert list(items('<root BTCPP_format="¦">')) == ["4", "3"]


KEYS = (
    HEAD + '<Sequence><GetWaypoint waypoint="{zielß🤖}"/><SetBlackboard value="1" output_key="n"/>'
    '<Script code="count := 1"/>\n'
)


def test_keys_in_scope_with_their_types(items: Completer) -> None:
    marked = KEYS + '<Move goal="{¦'
    found = items(marked)
    assert list(found) == ["zielß🤖", "count", "n", "goal"]
    assert found["goal"].detail == "new key"
    assert found["zielß🤖"].detail == "Pose2D"
    assert accepted(marked, found["zielß🤖"]) == marked.replace(CURSOR, "zielß🤖}")
    closed = KEYS + '<Move goal="{zi¦}"/>'
    assert accepted(closed, items(closed)["n"]) == KEYS + '<Move goal="{n}"/>'
    assert "{zielß🤖}" in items(KEYS + '<Move goal="¦"/>')
    assert {"n", "count"} <= items(KEYS + '<SetBlackboard value="2" output_key="¦"/>').keys()
    # A key whose type fits comes before a key of another type.
    assert list(items(KEYS + '<Say text="{w}"/><Wait wait_duration="{¦'))[-1] == "zielß🤖"


def test_a_long_list_is_filtered_by_the_typed_text(project: Project) -> None:
    keys = "".join(f'<Move goal="{{key{number}}}"/>' for number in range(MAX_ITEMS + 99))
    text = f'{HEAD}<Sequence>{keys}<Move goal="{{key109'
    document = project.open("untitled:many", text, 1)
    found = complete(project, document, len(text))
    assert found.is_incomplete
    assert [item.label for item in found.items] == ["key109", *(f"key109{digit}" for digit in range(9))]


def test_keys_of_another_tree_are_not_in_scope(items: Completer) -> None:
    found = items(KEYS + '</Sequence></BehaviorTree><BehaviorTree ID="B"><Move goal="{¦')
    assert [(item.label, item.detail) for item in found.values()] == [("goal", "new key")]


def test_names_in_scripts(items: Completer) -> None:
    marked = KEYS + '<Script code="a &amp;&amp; co¦unt &lt; 3"/>'
    found = items(marked)
    assert {"n", "count", "RED", "true"} <= found.keys()
    assert "zielß🤖" not in found  # no script can name it
    assert found["RED"].detail == "= 1"
    assert accepted(marked, found["n"]) == KEYS + '<Script code="a &amp;&amp; n &lt; 3"/>'
    assert "count" in items(KEYS + '<Move goal="1;2" _skipIf="¦')
    assert items(KEYS + "<Script code=\"a := 'co¦unt'\"/>") == {}
    assert items(KEYS + '<Script code="a := 12¦"/>') == {}


def test_paths_of_includes_and_ids_of_explicit_tags(
    items: Completer, project: Project, tmp_path: Path
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "küche.xml").write_text('<root BTCPP_format="4"><BehaviorTree ID="K"/></root>')
    project.folders = [tmp_path]
    text = '<root BTCPP_format="4"><include path=""/></root>'
    document = project.open((tmp_path / "main.xml").as_uri(), text, 1)
    found = complete(project, document, text.index('""') + 1).items
    assert [item.label for item in found] == ["parts/küche.xml"]
    actions = items(HEAD + '<Action ID="¦"/>')
    assert "Move" in actions
    assert "Sequence" not in actions


def test_snippets_contain_the_ports_that_validate_misses() -> None:
    @btcore.action
    def paint(colour: btcore.In[str], level: btcore.Put[float], fast: btcore.In[list[str]] = []) -> bool:  # noqa: B006
        return True

    nodes = btcore.Registry.standard()
    nodes.add_installed_libraries()
    nodes.add(paint)
    project = Project()
    project.set_models(models_of(nodes), {})
    compared = 0
    for id, manifest in nodes.manifests_of(4).items():
        content = "<AlwaysSuccess/>" if takes_children(manifest) else ""
        text = f'<root BTCPP_format="4"><BehaviorTree ID="🤖"><{id}>{content}</{id}></BehaviorTree></root>'
        found = check(partial(parse_text, text), lambda _: nodes)
        if any(report.is_error for report in found):
            continue
        missed = [
            name for item in found if item.code == "W202" for name in re.findall(r"'(\w+)'", item.message)
        ]
        known = project.registry.manifests[id]
        assert [port.name for port in known.ports.values() if is_mandatory(known, port)] == missed, id
        compared += 1
    assert compared > 80
