"""The descriptions of nodes, attributes, keys and trees."""

from collections.abc import Callable
from pathlib import Path

import pytest
from lsprotocol import types

from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file
from btcore_drawing.data_flow import trace_dataflow
from btcore_studio.language.entries import entry_facts
from btcore_studio.language.hover import hover
from btcore_studio.language.key_links import TreeKey, links_of
from btcore_studio.language.node_attributes import file_symbols
from btcore_studio.language.project import Project
from btcore_studio.language.symbols import KeyUse
from tests.tools.btcore_studio.language.conftest import ROOT, OpenAtCursor

HEAD = '<root BTCPP_format="4"><BehaviorTree ID="Größe🤖">'
TREES = """<root BTCPP_format="4" main_tree_to_execute="Ä">
<BehaviorTree ID="Ä"><Sequence><GetWaypoint waypoint="{ziel🤖}"/><SubTree ID="B" goal="{ziel🤖}"/></Sequence>
</BehaviorTree>
<BehaviorTree ID="B"><Sequence><Move name="Hin" goal="{goal}"/><Script code="n := RED"/></Sequence>
</BehaviorTree></root>"""
Describer = Callable[[str], str]


@pytest.fixture
def description(project: Project, open_at_cursor: OpenAtCursor) -> Describer:
    """Return the hover at the cursor, with the marked text in brackets before it; "" if there is none."""

    def describe(marked: str) -> str:
        document, offset = open_at_cursor(marked)
        found = hover(project, document, offset)
        if found is None:
            return ""
        assert isinstance(found.contents, types.MarkupContent)
        assert found.range is not None
        start, end = map(document.positions.offset, (found.range.start, found.range.end))
        assert start <= offset <= end
        return f"[{document.text[start:end]}] {found.contents.value}"

    return describe


def at(text: str, before: str) -> str:
    """Return *text* with the cursor after the first *before*."""
    return text.replace(before, before + "¦", 1)


def test_a_tag_shows_the_specification_of_the_node(description: Describer) -> None:
    shown = description(HEAD + "<Para¦llel>")
    assert shown.startswith("[Parallel] **Parallel** — control, 1 or more children, from `btcore`")
    assert "`failure_count` | → `int`, default `1` | failures that make the node fail" in shown
    assert "nodes/Parallel.html" in shown
    assert "**Parallel**" in description(HEAD + "<Parallel></Par¦allel>")
    assert "Navigates to *goal*" in description(HEAD + '<Action ID="Mo¦ve"/>')
    assert description(HEAD + "<Unknown¦/>") == ""


def test_attributes_show_types_and_defaults(description: Describer) -> None:
    assert description(HEAD + '<Move go¦al="1;2"/>').startswith("[goal] **goal** — → `Pose2D`, required")
    assert "Values: `true`, `false`" in description(HEAD + '<RunOnce then_skip="tr¦ue"/>')
    assert "run before the node starts" in description(HEAD + '<Move _skip¦If="1"/>')
    assert "same name" in description(HEAD + '<SubTree ID="B" _auto¦remap="1"/>')


def test_a_key_shows_its_writers_and_readers_in_all_trees(description: Describer) -> None:
    shown = description(at(TREES, 'goal="{g'))
    assert shown.startswith("[goal] **`goal`** — `Pose2D`\n\nThe entry `ziel🤖` of the tree `Ä`.")
    written, read = shown.split("Read by:")
    assert "`<GetWaypoint>` `waypoint`, `untitled:tree.xml` line 2" in written
    assert "`Hin` `<Move>` `goal`, `untitled:tree.xml` line 4" in read
    assert "Written by:" in description(at(TREES, "n :").replace("n :¦", "n¦ :"))
    assert "Read by: no node" in description(at(TREES, '"n'))
    assert "**RED** = 1" in description(at(TREES, "RE"))


def test_places_in_files_are_links(project: Project, tmp_path: Path) -> None:
    document = project.open((tmp_path / "bäume.xml").as_uri(), TREES, 1)
    found = hover(project, document, TREES.index("{ziel") + 1)
    assert found is not None
    assert f"[`bäume.xml` line 2](<{document.uri}#L2>)" in found.contents.value  # type: ignore[union-attr]


def test_the_id_of_a_tree_shows_the_tree(description: Describer) -> None:
    assert description(at(TREES, 'SubTree ID="')).startswith("[B] **`B`** — tree with 3 nodes")
    assert "**SubTree**" in description(at(TREES, "<SubTr"))
    assert "tree with 3 nodes" in description(at(TREES, 'execute="'))


def test_names_from_documents_are_escaped(description: Describer) -> None:
    text = HEAD + '<Sequence><Move goal="{a`![x](http://h)¦}" name="`&lt;img>"/>'
    shown = description(text)
    assert "**`` a`![x](http://h) ``**" in shown
    assert "`` `<img> ``" in shown
    model = '<TreeNodesModel><Action ID="A"><input_port name="p">![x](http://h)</input_port></Action>'
    assert "(http" not in description(f'<root BTCPP_format="4">{model}</TreeNodesModel><BehaviorTree><A¦/>')


@pytest.mark.parametrize("path", sorted((ROOT / "trees").rglob("*.xml")), ids=lambda path: path.name)
def test_writers_and_readers_are_those_of_the_analysis(project: Project, path: Path) -> None:
    """The entries of the scanned text are the entries that the dry run of the tree finds."""
    document = project.open(path.as_uri(), path.read_text(encoding="utf-8"), 1)
    plans = plan_document(parse_file(path), project.registry)
    assert not plans.diagnostics.errors
    assert plans.main_tree is not None
    links = links_of(project)
    main = next(tree for tree in file_symbols(project, document).trees if tree.id == plans.main_tree.id)

    def places(uses: list[KeyUse]) -> set[tuple[str, str]]:
        line = document.positions.line
        return {(use.port, f"{path}:{line(use.element.start) + 1}") for use in uses}

    for row in trace_dataflow(plans):
        assert row.scope == "", "each of these trees has a single blackboard"
        facts = entry_facts(links, [TreeKey(main, row.key)])
        assert places(facts.writers) == {(access.attribute, access.where) for access in row.writers}
        assert places(facts.readers) == {(access.attribute, access.where) for access in row.readers}
        assert row.type in ("", facts.type.name if facts.type is not None else None)
