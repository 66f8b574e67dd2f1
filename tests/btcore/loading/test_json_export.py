"""A tree's blackboards as JSON, and back."""

import json
from dataclasses import dataclass
from enum import Enum

import pytest

import btcore
from btcore import BlackboardError, In, Registry, action
from btcore.loading.json_export import export_blackboard, export_tree, import_blackboard, import_tree


@dataclass
class Pose:
    x: float
    y: float


class Color(Enum):
    RED = 1


def new_tree() -> btcore.Tree:
    nodes = Registry.standard()
    nodes.add_type(Pose, name="Pose")

    @action
    def go(goal: In[Pose]) -> bool:
        return goal.x > 0

    nodes.add(go)
    return btcore.loads(
        """<root BTCPP_format="4" main_tree_to_execute="Main">
        <BehaviorTree ID="Main"><SubTree ID="Inner" name="inner" n="{count}" k="3"/></BehaviorTree>
        <BehaviorTree ID="Inner"><Sequence><Script code="n := 1; own := 'x'"/><Go goal="{@goal}"/></Sequence>
        </BehaviorTree></root>""",
        nodes=nodes,
    )


def filled_tree() -> btcore.Tree:
    tree = new_tree()
    tree.blackboard["goal"] = Pose(1.5, 2.0)
    tree.blackboard["list"] = [1, 2]
    tree.blackboard["on"] = True
    tree.blackboard["color"] = Color.RED
    tree.tick_once()
    return tree


def test_subtrees_are_exported_by_path_and_the_main_tree_by_id() -> None:
    assert export_tree(filled_tree()) == {
        "Main": {
            "count": 1,
            "goal": {"__type": "Pose", "x": 1.5, "y": 2.0},
            "list": [1, 2],
            "on": 1,
            "color": 1,
        },
        "inner": {"k": 3, "own": "x"},
    }


def test_exported_data_can_be_imported_from_a_file() -> None:
    text = json.dumps(export_tree(filled_tree()))
    fresh = new_tree()
    import_tree(fresh, json.loads(text))
    assert fresh.blackboard["goal"] == Pose(1.5, 2.0)
    assert json.dumps(export_tree(fresh), sort_keys=True) == json.dumps(json.loads(text), sort_keys=True)


def test_bools_enums_and_lists_of_dataclasses_are_restored_for_ports_of_these_types() -> None:
    class Mood(Enum):
        CALM = "c"

    nodes = Registry.standard()
    nodes.add_type(Pose, name="Pose")
    read: list[object] = []

    @action
    def use(on: In[bool], color: In[Color], mood: In[Mood], route: In[list[Pose]]) -> bool:
        read[:] = [on, color, mood, route]
        return True

    nodes.add(use)
    xml = """<root BTCPP_format="4"><BehaviorTree ID="Main">
        <Use on="{on}" color="{color}" mood="{mood}" route="{route}"/></BehaviorTree></root>"""
    values = {"on": True, "color": Color.RED, "mood": Mood.CALM, "route": [Pose(1.0, 2.0)]}
    tree = btcore.loads(xml, nodes=nodes)
    for key, value in values.items():
        tree.blackboard[key] = value
    text = json.dumps(export_tree(tree))
    fresh = btcore.loads(xml, nodes=nodes)
    import_tree(fresh, json.loads(text))
    fresh.tick_once()
    assert read == list(values.values())


def test_entry_never_written_is_exported_as_null_and_stays_null() -> None:
    tree = new_tree()
    assert export_blackboard(tree.blackboard) == {"goal": None}
    import_blackboard(tree.blackboard, {"goal": None}, tree.registry.types)
    assert export_blackboard(tree.blackboard) == {"goal": None}


def test_an_unknown_subtree_is_refused_before_anything_is_written() -> None:
    tree = new_tree()
    with pytest.raises(BlackboardError, match="no subtree 'iner'; did you mean 'inner'"):
        import_tree(tree, {"Main": {"count": 5}, "iner": {}})
    assert "count" not in tree.blackboard


def test_a_subtree_without_data_is_refused() -> None:
    with pytest.raises(BlackboardError, match="nothing is given for the subtrees inner"):
        import_tree(new_tree(), {"Main": {}})


def test_blackboard_without_entries_is_null_in_a_tree() -> None:
    tree = btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
    )
    assert json.dumps(export_tree(tree)) == '{"Main": null}'
    import_tree(tree, {"Main": None})
    assert export_blackboard(tree.blackboard) == {}


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ({"x": 1}, "the object has no '__type'"),
        ({"__type": "Twist"}, "unknown type 'Twist'"),
        ("many", "'many' is not an integer"),
    ],
)
def test_data_that_cpp_skips_or_writes_with_another_type_is_an_error(value: object, problem: str) -> None:
    tree = new_tree()
    tree.blackboard["number"] = 3
    with pytest.raises(BlackboardError, match=f"can't be imported: .*{problem}"):
        import_tree(tree, {"Main": {"number": value}, "inner": None})
    assert tree.blackboard["number"] == 3
