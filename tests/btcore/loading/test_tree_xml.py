"""A tree written as XML matches BehaviorTree.CPP byte for byte, except for the texts of descriptions."""

from pathlib import Path

import pytest
from lxml import etree

from btcore import Registry, StatefulAction, Status, loads
from btcore.blackboard.ports import Direction, Port
from btcore.loading.tree_xml import tree_to_xml
from btcore.values import DOUBLE, INT
from btcore.xml.models.tree_nodes_model import write_models


class Count(StatefulAction):
    @staticmethod
    def provided_ports() -> list[Port]:
        return [
            Port("out", Direction.OUT, DOUBLE),
            Port("ticks", type=INT, default="2", description="dddddddd"),
        ]

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        return Status.SUCCESS


SOURCE = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="root_seq">
      <Script code="x:=42; s:='hello'; f:=2.5"/>
      <Fallback>
        <AlwaysFailure/>
        <Action ID="Count" name="cnt" _onSuccess="done:=true" out="{val}" ticks="3" _mine="stays out"/>
      </Fallback>
      <SubTree ID="Sub" lim="7" mode="fast" target="{val}" _autoremap="false"/>
      <AlwaysSuccess _skipIf="x==42"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Sub">
    <Sequence>
      <Script code="loc:=target"/>
      <Count out="{o2}"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
# The answer of BehaviorTree.CPP 4.10 for that tree, byte for byte.
TREES = """<root BTCPP_format="4">
    <BehaviorTree ID="Main" _fullpath="">
        <Sequence name="root_seq" _uid="1">
            <Script name="Script" _uid="2" code="x:=42; s:=&apos;hello&apos;; f:=2.5"/>
            <Fallback name="Fallback" _uid="3">
                <AlwaysFailure name="AlwaysFailure" _uid="4"/>
                <Count name="cnt" _uid="5" ticks="3" out="{val}" _onSuccess="done:=true"/>
            </Fallback>
            <SubTree ID="Sub" _fullpath="Sub::6" _uid="6" lim="7" mode="fast" target="{val}"/>
            <AlwaysSuccess name="AlwaysSuccess" _uid="10" _skipIf="x==42"/>
        </Sequence>
    </BehaviorTree>
    <BehaviorTree ID="Sub" _fullpath="Sub::6">
        <Sequence name="Sequence" _uid="7">
            <Script name="Script" _uid="8" code="loc:=target"/>
            <Count name="Count" _uid="9" ticks="2" out="{o2}"/>
        </Sequence>
    </BehaviorTree>
    <TreeNodesModel>
"""


@pytest.fixture
def nodes() -> Registry:
    made = Registry.standard()
    made.add(Count)
    return made


def test_trees_match_those_of_behaviortree_cpp(nodes: Registry) -> None:
    assert tree_to_xml(loads(SOURCE, nodes=nodes)).startswith(TREES)


def test_models_are_sorted_and_have_the_types_of_cpp(nodes: Registry) -> None:
    text = tree_to_xml(loads(SOURCE, nodes=nodes))
    assert (
        '        <Action ID="Count">\n'
        '            <output_port name="out" type="double"/>\n'
        '            <input_port name="ticks" type="int" default="2">dddddddd</input_port>\n'
        "        </Action>\n"
    ) in text
    models = etree.fromstring(text).find("TreeNodesModel")
    assert models is not None
    ids = [str(model.get("ID")) for model in models]
    assert ids == sorted(nodes.manifests)
    assert text.endswith("    </TreeNodesModel>\n</root>\n")


def test_metadata_and_built_in_models_can_be_omitted(nodes: Registry) -> None:
    text = tree_to_xml(loads(SOURCE, nodes=nodes), metadata=False, builtin_models=False)
    assert "_uid" not in text
    assert '<SubTree ID="Sub" lim="7" mode="fast" target="{val}"/>' in text
    assert '<BehaviorTree ID="Sub" _fullpath="Sub::6">' in text
    models = etree.fromstring(text).find("TreeNodesModel")
    assert models is not None
    assert [model.get("ID") for model in models] == ["Count"]


def test_written_tree_can_be_loaded_again(nodes: Registry) -> None:
    first = loads(SOURCE, nodes=nodes)
    text = tree_to_xml(first)
    again = loads(text, nodes=nodes, tree="Main")
    assert [(node.id, node.name) for node in again] == [(node.id, node.name) for node in first]


def test_texts_with_quotes_brackets_and_line_breaks_are_kept(nodes: Registry) -> None:
    script = "a := 'x';\n\tb := a == 'y' &amp;&amp; 1 &lt; 2"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Script code="{script}"/></BehaviorTree></root>'
    tree = loads(text, nodes=nodes)
    again = loads(tree_to_xml(tree), nodes=nodes)
    assert again.root.config.inputs["code"].text == "a := 'x';\n\tb := a == 'y' && 1 < 2"


def test_a_subtree_of_format_3_is_written_with_braces(nodes: Registry) -> None:
    text = """
    <root main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><SubTree ID="Sub" inner="outer"/></BehaviorTree>
      <BehaviorTree ID="Sub"><AlwaysSuccess/></BehaviorTree>
    </root>"""
    written = tree_to_xml(loads(text, nodes=nodes))
    assert '<SubTree ID="Sub" _fullpath="Sub::1" _uid="1" inner="{outer}"/>' in written


def test_models_are_written_for_groot(nodes: Registry, tmp_path: Path) -> None:
    written = write_models([nodes.manifests["Count"], nodes.manifests["Sleep"]])
    assert written.startswith('<root BTCPP_format="4">\n    <TreeNodesModel>\n        <Action ID="Count">\n')
    assert write_models([nodes.manifests["Count"]], format=3) == (
        "<root>\n"
        "    <TreeNodesModel>\n"
        '        <Action ID="Count">\n'
        '            <input_port name="ticks" type="int" default="2">dddddddd</input_port>\n'
        '            <output_port name="out" type="double"/>\n'
        "        </Action>\n"
        "    </TreeNodesModel>\n"
        "</root>\n"
    )
