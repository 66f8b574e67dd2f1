"""Trees that do not match their palette, as in an issue of Nav2: all unknown ports are reported at once."""

from pathlib import Path

import pytest

import btcore
from btcore import In, PortError, Put, Registry, action
from btcore.lint.validate import validate_document
from btcore.xml.models.model_file import add_models
from btcore.xml.read.read import parse_file

# A tree that Groot saved with a palette of another version than the robot's nodes.
TREE = """<root BTCPP_format="{format}" main_tree_to_execute="Navigate">
  <BehaviorTree ID="Navigate">
    <Sequence>
      <ComputePath goal="{{goal}}" path="{{path}}" service_name="plan"/>
      <FollowPath path="{{path}}" service_nam="follow" serverr="control"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
MODEL = """<root BTCPP_format="4"><TreeNodesModel>
  <Action ID="ComputePath"><input_port name="goal"/><output_port name="path"/></Action>
  <Action ID="FollowPath"><input_port name="path"/><input_port name="server"/></Action>
</TreeNodesModel></root>"""
UNKNOWN = [
    (4, 48, "<ComputePath> has no port 'service_name'"),
    (5, 33, "<FollowPath> has no port 'service_nam'"),
    (5, 54, "<FollowPath> has no port 'serverr'"),
]


@action
def compute_path(goal: In[str], path: Put[str]) -> bool:
    path(f"to {goal}")
    return True


@action
def follow_path(path: In[str], server: In[str] = "controller") -> bool:
    return bool(path and server)


@pytest.mark.parametrize("format", [3, 4])
def test_nav2_3413_all_unknown_ports_are_reported_at_load_with_their_places(format: int) -> None:
    nodes = Registry.standard()
    nodes.add(compute_path, follow_path)
    with pytest.raises(PortError) as refused:
        btcore.loads(TREE.format(format=format), nodes=nodes)
    found = refused.value.diagnostics
    assert [(diagnostic.line, diagnostic.column, diagnostic.message) for diagnostic in found] == UNKNOWN
    assert found[2].hint == "did you mean 'server'?"


def test_nav2_3413_validation_with_a_palette_reports_unknown_ports(tmp_path: Path) -> None:
    (tmp_path / "palette.xml").write_text(MODEL, encoding="utf-8")
    (tmp_path / "tree.xml").write_text(TREE.format(format=4), encoding="utf-8")
    nodes = Registry.standard()
    add_models(nodes, tmp_path / "palette.xml")
    found = validate_document(parse_file(tmp_path / "tree.xml"), nodes=nodes)
    errors = [diagnostic for diagnostic in found if diagnostic.is_error]
    assert [(diagnostic.line, diagnostic.column, diagnostic.message) for diagnostic in errors] == UNKNOWN


def test_nav2_3413_the_tree_without_unknown_ports_loads(tmp_path: Path) -> None:
    text = TREE.format(format=4)
    for surplus in (' service_name="plan"', ' service_nam="follow"', ' serverr="control"'):
        text = text.replace(surplus, "")
    nodes = Registry.standard()
    nodes.add(compute_path, follow_path)
    tree = btcore.loads(text, nodes=nodes)
    tree.blackboard["goal"] = "home"
    assert tree.tick_once() is btcore.Status.SUCCESS
    assert tree.blackboard["path"] == "to home"
