"""Trees from several documents, and registered trees."""

from pathlib import Path

import pytest

from btcore import (
    Registry,
    SimClock,
    Status,
    TreeError,
    XmlSyntaxError,
    load,
    loads,
    make,
)


def document(*trees: str, format: int = 4, include: str = "") -> str:
    """Return a document of *trees*, each `ID=element`."""
    named = "".join(
        f'<BehaviorTree ID="{id}">{element}</BehaviorTree>'
        for id, _, element in (tree.partition("=") for tree in trees)
    )
    return f'<root BTCPP_format="{format}">{include}{named}</root>'


MISSION = document('Mission=<SubTree ID="Dock"/>')
DOCK = document("Dock=<AlwaysFailure/>")


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_first_file_calls_trees_of_further_files(tmp_path: Path) -> None:
    mission, dock = write(tmp_path / "mission.xml", MISSION), write(tmp_path / "dock.xml", DOCK)
    tree = load(mission, dock)
    assert [subtree.id for subtree in tree.subtrees] == ["Mission", "Dock"]
    assert tree.tick_once() is Status.FAILURE
    assert load(mission, dock, tree="Dock").id == "Dock"


def test_file_that_is_also_included_is_read_once(tmp_path: Path) -> None:
    dock = write(tmp_path / "dock.xml", DOCK)
    text = document('Mission=<SubTree ID="Dock"/>', include='<include path="dock.xml"/>')
    mission = write(tmp_path / "mission.xml", text)
    assert load(mission, dock).tick_once() is Status.FAILURE
    assert load(mission, dock, mission).id == "Mission"


@pytest.mark.parametrize("format", [3, 4])
def test_tree_of_the_first_text_replaces_a_tree_of_a_further_text(format: int) -> None:
    first = document("Main=<AlwaysSuccess/>", format=format)
    second = document("Main=<AlwaysFailure/>", format=format)
    assert loads(first, second).tick_once() is Status.SUCCESS


def test_errors_of_all_texts_are_reported_together(tmp_path: Path) -> None:
    with pytest.raises(XmlSyntaxError) as caught:
        loads(MISSION, "<root", "")
    assert len(caught.value.diagnostics) == 2
    first = write(tmp_path / "a.xml", document("A=<Fly/>"))
    second = write(tmp_path / "b.xml", document("B=<Swim/>"))
    with pytest.raises(TreeError) as found:
        load(first, second)
    assert {Path(error.file).name for error in found.value.diagnostics} == {"a.xml", "b.xml"}


@pytest.mark.parametrize("kind", ["text", "name of a file", "path"])
def test_registered_tree_is_made_by_its_id(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / "dock.xml", DOCK)
    nodes = Registry.standard()
    nodes.add_trees({"text": DOCK, "name of a file": str(path), "path": path}[kind], MISSION)
    clock = SimClock()
    tree = make("Mission", nodes=nodes, clock=clock)
    assert tree.id == "Mission"
    assert tree.clock is clock
    assert tree.tick_once() is Status.FAILURE
    assert make("Dock", nodes=nodes).id == "Dock"


def test_loaded_tree_calls_registered_trees(tmp_path: Path) -> None:
    nodes = Registry.standard()
    nodes.add_trees(DOCK)
    assert loads(MISSION, nodes=nodes).tick_once() is Status.FAILURE
    path = write(tmp_path / "mission.xml", MISSION)
    nodes.add_trees(path)
    # The file itself is registered, too: its trees are not duplicates.
    assert load(path, nodes=nodes).tick_once() is Status.FAILURE


@pytest.mark.parametrize("format", [3, 4])
def test_tree_replaces_an_earlier_registered_tree(format: int) -> None:
    nodes = Registry.standard()
    nodes.add_trees(document("A=<AlwaysFailure/>", format=format))
    nodes.add_trees(document("A=<AlwaysSuccess/>", format=format))
    assert make("A", nodes=nodes).tick_once() is Status.SUCCESS
    text = document("A=<Inverter><AlwaysSuccess/></Inverter>", format=format)
    assert loads(text, nodes=nodes).tick_once() is Status.FAILURE


def test_made_tree_has_the_format_of_its_document() -> None:
    nodes = Registry.standard()
    nodes.add_trees(document("Old=<AlwaysSuccess/>", format=3), document("New=<AlwaysSuccess/>"))
    assert [make(id, nodes=nodes).format for id in ("Old", "New")] == [3, 4]


def test_tree_that_a_registered_file_includes_is_made(tmp_path: Path) -> None:
    write(tmp_path / "dock.xml", DOCK)
    nodes = Registry.standard()
    path = write(tmp_path / "all.xml", document(include='<include path="dock.xml"/>'))
    nodes.add_trees(path, document("Other=<AlwaysSuccess/>"))
    assert make("Dock", nodes=nodes).tick_once() is Status.FAILURE


def test_unknown_registered_tree_is_an_error_with_a_hint() -> None:
    nodes = Registry.standard()
    with pytest.raises(TreeError, match=r"unknown tree 'Dokc'\n +register it: nodes\.add_trees\(…\)"):
        make("Dokc", nodes=nodes)
    nodes.add_trees(DOCK)
    with pytest.raises(TreeError, match=r"unknown main tree 'Dokc'(.|\n)*did you mean 'Dock'\?"):
        make("Dokc", nodes=nodes)


def test_invalid_document_is_an_error_when_it_is_registered(tmp_path: Path) -> None:
    nodes = Registry.standard()
    with pytest.raises(XmlSyntaxError):
        nodes.add_trees(DOCK, "<root")
    with pytest.raises(TreeError, match=r"no such file(.|\n)*did you mean .*dock\.xml\?"):
        nodes.add_trees(write(tmp_path / "dock.xml", DOCK).with_name("dok.xml"))
    assert nodes.documents == []


def test_confined_registered_file_cannot_include_files_outside_of_its_folder(tmp_path: Path) -> None:
    write(tmp_path / "dock.xml", DOCK)
    (tmp_path / "inner").mkdir()
    path = write(tmp_path / "inner" / "all.xml", document(include='<include path="../dock.xml"/>'))
    trusted, confined = Registry.standard(), Registry.standard()
    trusted.add_trees(path)
    assert make("Dock", nodes=trusted).tick_once() is Status.FAILURE
    confined.add_trees(path, confined=True)
    with pytest.raises(TreeError, match="E007 the included file is outside of the folder"):
        make("Dock", nodes=confined)


def test_trees_of_a_copied_registry_are_its_own() -> None:
    nodes = Registry.standard()
    nodes.add_trees(DOCK)
    copy = nodes.copy()
    copy.add_trees(MISSION)
    assert make("Mission", nodes=copy).tick_once() is Status.FAILURE
    with pytest.raises(TreeError, match="unknown main tree 'Mission'"):
        make("Mission", nodes=nodes)
