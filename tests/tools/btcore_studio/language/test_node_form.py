"""The request btcore/node: the form of a node, with what can be written into each attribute."""

from collections.abc import Callable

import pytest

from btcore.xml.edit.editor import EditError
from btcore_studio.language.node_form import form_of
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import Field, NodeForm, Place, Position

URI = "untitled:tree.xml"
TREE = """<root BTCPP_format="4" main_tree_to_execute="A">
  <BehaviorTree ID="A">
    <Sequence name="all" x="12">
      <Script code="speed := 1"/>
      <Paint colour="{ c }" number="{speed}" count="{count}" note="n"/>
      <SubTree ID="B" in="{speed}"/>
      <Inverter _skipIf="speed > 1"><AlwaysSuccess/></Inverter>
      <Unknown y="{z}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="B">
    <Sequence><Sleep msec="{in}"/><Script code="out := in; @all := 1"/><Script code="both += 1"/></Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="Paint">
      <input_port name="colour" type="bool"/>
      <output_port name="count" type="int">how many</output_port>
      <input_port name="number" type="int" default="3"/>
    </Action>
    <SubTree ID="B"><input_port name="in"/><input_port name="extra" default="{speed}"/></SubTree>
  </TreeNodesModel>
</root>
"""

Form = Callable[..., NodeForm]


@pytest.fixture
def form(project: Project) -> Form:
    """Return the form of the element that begins with a text, as "<Sleep"."""

    def form(written: str, text: str = TREE) -> NodeForm:
        source = project.open(URI, text, 1)
        at = source.positions.position(text.index(written))
        return form_of(project, source, Place(URI, Position(at.line, at.character)))

    return form


def fields(form: NodeForm, group: str) -> dict[str, Field]:
    return {field.name: field for field in form.fields if field.group == group}


def test_ports_of_a_node(form: Form) -> None:
    paint = form("<Paint")
    assert (paint.id, paint.name, paint.kind) == ("Paint", "Paint", "action")
    ports = fields(paint, "port")
    assert list(ports) == ["colour", "count", "number"]
    colour, count, number = ports.values()
    assert (colour.text, colour.direction, colour.type, colour.is_required) == ("{ c }", "in", "bool", True)
    assert colour.choices[:2] == ["true", "false"]
    assert {"{count}", "{speed}", "{z}"} <= set(colour.choices)
    assert (count.direction, count.about, count.default) == ("out", "how many", None)
    assert (number.default, number.is_required, number.is_script) == ("3", False, False)
    assert list(fields(paint, "other")) == ["_description", "note"]
    assert fields(paint, "other")["note"].text == "n"


def test_an_output_of_a_model_is_not_required(form: Form) -> None:
    text = """<root BTCPP_format="4"><BehaviorTree ID="A"><Go/></BehaviorTree><TreeNodesModel><Action ID="Go">
      <input_port name="goal"/><output_port name="error"/></Action></TreeNodesModel></root>"""
    ports = fields(form("<Go", text), "port")
    assert {name: port.is_required for name, port in ports.items()} == {"goal": True, "error": False}


def test_scripts_and_conditions(form: Form) -> None:
    code = fields(form("<Script"), "port")["code"]
    assert (code.text, code.is_script, code.choices, code.is_required) == ("speed := 1", True, [], True)
    conditions = fields(form("<Inverter"), "condition")
    assert list(conditions)[:4] == ["_failureIf", "_successIf", "_skipIf", "_while"]
    assert len(conditions) == 8
    assert conditions["_skipIf"].text == "speed > 1"
    assert all(field.is_script and field.about for field in conditions.values())
    from_entry = TREE.replace('code="speed := 1"', 'code="{speed}"')
    assert "{speed}" in fields(form("<Script", from_entry), "port")["code"].choices


def test_a_call_has_both_sides_of_the_remapping(form: Form) -> None:
    call = form("<SubTree")
    assert (call.id, call.name, call.kind) == ("SubTree", "B", "subtree")
    table = fields(call, "subtree")
    assert list(table) == ["ID", "_autoremap", "in", "extra", "both", "out"]
    assert table["ID"].choices == ["B"]
    assert (table["in"].text, table["in"].direction, table["in"].type) == ("{speed}", "in", "unsigned int")
    assert (table["in"].is_required, table["extra"].is_required, table["extra"].default) == (
        True,
        False,
        "{speed}",
    )
    assert (table["out"].direction, table["both"].direction, table["out"].text) == ("out", "inout", None)
    assert "{speed}" in table["out"].choices


def test_types_that_may_replace_a_node(form: Form) -> None:
    sequence, inverter, leaf = form("<Sequence").types, form("<Inverter").types, form("<AlwaysS").types
    assert "Fallback" in sequence
    assert not {"Inverter", "Sleep", "B", "IfThenElse"} & set(sequence)
    assert {"Repeat", "Sequence"} <= set(inverter)
    assert inverter.index("Repeat") < inverter.index("Sequence")
    assert "Sleep" not in inverter
    assert {"Sleep", "Sequence", "B"} <= set(leaf)
    assert "A" not in leaf


def test_an_unknown_node_and_an_attribute_without_meaning(form: Form) -> None:
    unknown = form("<Unknown")
    assert (unknown.kind, unknown.about, fields(unknown, "port")["y"].text) == ("action", "", "{z}")
    assert fields(form("<Sequence"), "other")["x"].text == "12"
    assert fields(form("<Sequence"), "name")["name"].text == "all"


def test_a_place_without_a_node(form: Form) -> None:
    for written in ("<root", "<BehaviorTree", "<TreeNodesModel", "<Action", "ID="):
        with pytest.raises(EditError, match="no node begins at this place"):
            form(written)


def test_format_3_has_no_conditions_and_bare_keys(form: Form) -> None:
    text = (
        '<root main_tree_to_execute="A"><BehaviorTree ID="A"><Sequence><SubTree ID="B" in="k"/>'
        '<SetBlackboard output_key="{k}" value="1"/></Sequence></BehaviorTree>'
        '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree></root>'
    )
    call = form("<SubTree", text)
    assert fields(call, "condition") == {}
    assert fields(call, "subtree")["in"].choices == ["k"]
    assert "__shared_blackboard" in fields(call, "subtree")
