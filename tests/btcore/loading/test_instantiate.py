"""From XML to nodes: their numbers, paths, ports and blackboards."""

import gc
from pathlib import Path

import pytest

from btcore import In, Registry, Status, action, load, loads
from btcore.blackboard.blackboard import Blackboard
from btcore.errors import TreeError
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file


class Robot:
    pass


@action
def drive(speed: In[float], robot: Robot) -> bool:
    return speed > 0


def load_tree(body: str, more: str = "", root: str = 'BTCPP_format="4"', **options: object) -> Tree:
    text = (
        f'<root {root} main_tree_to_execute="Main"><BehaviorTree ID="Main">{body}</BehaviorTree>{more}</root>'
    )
    return loads(text, **options)  # type: ignore[arg-type]


def root_of(*parts: str, main: str = "M") -> str:
    return f'<root BTCPP_format="4" main_tree_to_execute="{main}">{"".join(parts)}</root>'


def sub(body: str, id: str = "Sub") -> str:
    return f'<BehaviorTree ID="{id}">{body}</BehaviorTree>'


# --- numbers, names and paths

NESTED = (
    '<Sequence><AlwaysSuccess name="a/b c.d"/><SubTree ID="Sub" name="inst"/><SubTree ID="Sub"/>'
    "<AlwaysSuccess/></Sequence>",
    sub('<Sequence name="nm"><AlwaysSuccess/></Sequence>'),
)


def test_uids_descend_into_a_subtree_before_its_next_sibling() -> None:
    tree = load_tree(*NESTED)
    assert [(node.uid, node.name, node.path) for node in tree] == [
        (1, "Sequence", "Sequence::1"),
        (2, "a/b c.d", "a/b c.d"),
        (3, "inst", "inst"),
        (4, "nm", "inst/nm"),
        (5, "AlwaysSuccess", "inst/AlwaysSuccess::5"),
        (6, "Sub", "Sub::6"),
        (7, "nm", "Sub::6/nm"),
        (8, "AlwaysSuccess", "Sub::6/AlwaysSuccess::8"),
        (9, "AlwaysSuccess", "AlwaysSuccess::9"),
    ]


def test_subtrees_are_listed_in_order_of_creation() -> None:
    tree = load_tree(*NESTED)
    found = [(one.id, one.path, [node.uid for node in one.nodes]) for one in tree.subtrees]
    assert found == [("Main", "", [1, 2, 3, 6, 9]), ("Sub", "inst", [4, 5]), ("Sub", "Sub::6", [7, 8])]


def test_in_format_3_a_subtree_node_and_its_path_are_named_like_its_tree() -> None:
    tree = load_tree('<Sequence><SubTree ID="Sub" name="inst"/></Sequence>', sub("<AlwaysSuccess/>"), root="")
    assert [(node.name, node.path) for node in tree] == [
        ("Sequence", "Sequence::1"),
        ("Sub", "Sub::2"),
        ("AlwaysSuccess", "Sub::2/AlwaysSuccess::3"),
    ]
    assert tree.format == 3


def test_node_has_its_position_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "t.xml"
    tags = [
        '<root BTCPP_format="4">',
        '<BehaviorTree ID="M">',
        "<Sequence",
        '  name="s">',
        "<AlwaysSuccess/>",
    ]
    path.write_text("\n".join([*tags, "</Sequence></BehaviorTree></root>"]))
    assert [node.config.where for node in load(path)] == [f"{path}:3", f"{path}:5"]


# --- choice of tree and format


def test_only_tree_needs_no_id() -> None:
    tree = loads('<root BTCPP_format="4"><BehaviorTree><AlwaysSuccess/></BehaviorTree></root>')
    assert tree.tick_once() is Status.SUCCESS


@pytest.mark.parametrize("format", ["5", "4.0", "four", ""])
def test_unknown_format_is_rejected_unlike_in_cpp(format: str) -> None:
    with pytest.raises(TreeError, match=f"E009 unknown BTCPP_format '{format}'"):
        loads(f'<root BTCPP_format="{format}"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>')


def test_empty_id_of_the_only_tree_may_be_named_as_the_main_tree() -> None:
    body = '<BehaviorTree ID=""><AlwaysSuccess/></BehaviorTree>'
    xml = f'<root BTCPP_format="4" main_tree_to_execute="">{body}</root>'
    assert loads(xml).tick_once() is Status.SUCCESS
    with pytest.raises(TreeError, match="unknown main tree ''"):
        loads(xml.replace(' ID=""', ""))


def test_document_without_a_format_has_format_3_by_default() -> None:
    assert load_tree("<AlwaysSuccess/>", root="").format == 3
    assert load_tree("<Script code='a := 1'/>", root="", format=4).format == 4
    assert load_tree("<SequenceStar><AlwaysSuccess/></SequenceStar>", format=3).root.id == "SequenceStar"


# --- tags and attributes


@pytest.mark.parametrize("tag", ["Action", "Condition", "Control", "Decorator"])
def test_in_format_4_an_explicit_tag_may_name_any_category(tag: str) -> None:
    inverted = f'<{tag} ID="Inverter"><AlwaysFailure/></{tag}>'
    tree = load_tree(f'<ReactiveSequence><{tag} ID="AlwaysSuccess"/>{inverted}</ReactiveSequence>')
    assert tree.tick_once() is Status.SUCCESS


def test_format_3_accepts_the_empty_attributes_that_groot_1_writes() -> None:
    tree = load_tree(
        '<Sequence><AlwaysSuccess/><Repeat num_cycles=""><AlwaysSuccess/></Repeat></Sequence>', root=""
    )
    assert tree.root.id == "Sequence"
    with pytest.raises(TreeError, match="E202"):
        load_tree('<Repeat num_cycles=""><AlwaysSuccess/></Repeat>')


def test_attributes_with_an_underscore_are_kept_without_effect_in_format_4() -> None:
    node = load_tree('<AlwaysSuccess _uid="7" _note="mine" _skipIf="false"/>').root
    assert node.config.attributes == {"_uid": "7", "_note": "mine"}
    assert node.config.conditions == {"_skipIf": "false"}
    with pytest.raises(TreeError, match="E201"):
        load_tree('<AlwaysSuccess _note="mine"/>', root="")


def test_defaults_are_filled_in() -> None:
    node = load_tree("<Parallel><AlwaysSuccess/></Parallel>").root
    assert {key: port.text for key, port in node.config.inputs.items()} == {
        "success_count": "-1",
        "failure_count": "1",
    }


# --- SubTree


def inner(tree: Tree) -> Blackboard:
    return tree.subtrees[1].blackboard


def test_in_format_4_braces_remap_and_other_values_are_constants() -> None:
    tree = load_tree(
        '<SubTree ID="Sub" key="{outer}" same="{=}" n="42" big="5000000000" x="1e3" text="1;2" flag="true"/>',
        sub('<Script code="key := 1; same := 2; own := 3"/>'),
    )
    tree.tick_once()
    board = inner(tree)
    assert (tree.blackboard["outer"], tree.blackboard["same"]) == (1, 2)
    assert "own" not in tree.blackboard
    assert [board[key] for key in ("n", "big", "x", "text", "flag")] == [
        42,
        5_000_000_000,
        1000.0,
        "1;2",
        "true",
    ]


@pytest.mark.parametrize("written", ["", ' ID=""'])
def test_tree_without_an_id_among_several_is_refused(written: str) -> None:
    with pytest.raises(TreeError, match="missing ID of the <BehaviorTree>"):
        load_tree("<AlwaysSuccess/>", f"<BehaviorTree{written}><AlwaysSuccess/></BehaviorTree>")


def test_subtree_at_the_root_without_a_name_text_is_refused() -> None:
    with pytest.raises(TreeError, match="two SubTree nodes have the path ''"):
        load_tree('<SubTree ID="Sub" name=""/>', sub("<AlwaysSuccess/>"))


def test_in_format_3_a_blackboard_may_be_shared() -> None:
    body = '<SetBlackboard value="1" output_key="key"/>'
    tree = load_tree('<SubTree ID="Sub" __shared_blackboard="true"/>', sub(body), root="")
    tree.tick_once()
    assert inner(tree) is tree.blackboard
    assert sorted(tree.blackboard) == ["key"]


def test_subtrees_may_be_nested_thousands_of_levels_deep() -> None:
    levels = 3000
    calls = [sub(f'<SubTree ID="T{n + 1}" name="s"/>', f"T{n}") for n in range(levels)]
    tree = loads(root_of(*calls, sub("<AlwaysSuccess/>", f"T{levels}"), main="T0"))
    assert len(tree.nodes) == levels + 1
    assert tree.tick_once() is Status.SUCCESS


# --- files


def test_a_package_is_found_by_the_resolver(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(root_of(sub("<AlwaysSuccess/>", "A")))
    text = root_of('<include ros_pkg="nav" path="a.xml"/>', sub('<SubTree ID="A"/>', "M"))
    tree = loads(text, packages={"nav": tmp_path}.get)
    assert tree.tick_once() is Status.SUCCESS


# --- arguments of the loader


@pytest.fixture
def nodes() -> Registry:
    registry = Registry.standard()
    registry.add(drive, ID="Drive")
    return registry


def test_required_resources_are_known_before_the_tree_is_built(nodes: Registry, tmp_path: Path) -> None:
    path = tmp_path / "t.xml"
    path.write_text(root_of(sub("<AlwaysSuccess/>", "M"), sub('<Drive speed="1"/>', "D")))
    assert plan_document(parse_file(path), nodes).required_resources() == []
    assert plan_document(parse_file(path), nodes, "D").required_resources() == [Robot]


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("frozen", [True, False])
def test_loading_leaves_the_garbage_collector_as_it_was(enabled: bool, frozen: bool) -> None:
    was_enabled = gc.isenabled()
    (gc.enable if enabled else gc.disable)()
    try:
        if frozen:
            gc.freeze()
        count = gc.get_freeze_count()
        load_tree("<AlwaysSuccess/>")
        assert gc.isenabled() is enabled
        left = gc.get_freeze_count()
        assert (left > 0) is frozen
        assert left <= count  # another thread may have freed frozen objects
    finally:
        gc.unfreeze()
        (gc.enable if was_enabled else gc.disable)()
