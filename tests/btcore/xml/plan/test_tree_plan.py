"""Errors in ports, scripts and leaves: the whole message, as a user reads it."""

import enum
from collections.abc import Callable
from textwrap import dedent

import pytest

import btcore
from btcore import In, Registry, condition
from btcore.blackboard.blackboard import Blackboard
from btcore.errors import PortError, TreeError
from btcore.lint.validate import validate_document
from btcore.loading.instantiate import instantiate
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text

Write = Callable[..., str]
Refused = Callable[[object], TreeError]

CASES = {
    "an unknown port": (
        ('<Say txt="hello"/>',),
        PortError,
        """
        t.xml:3:10: E201 <Say> has no port 'txt'
           3 |      <Say txt="hello"/>
             |           ^^^
              did you mean 'text'?
        """,
    ),
    "a parameter that is not marked as a port": (
        ('<Turn angle="1"/>',),
        PortError,
        """
        t.xml:3:11: E201 <Turn> has no port 'angle'
           3 |      <Turn angle="1"/>
             |            ^^^^^
              its parameter 'angle: float' is a resource; did you mean angle: In[float]?
        """,
    ),
    "a parameter that is not marked as a port and has no value": (
        ("<Turn/>",),
        TreeError,
        """
        t.xml:3:5: E118 <Turn> needs a float for its parameter 'angle': pass it in resources=[…]; if it is a port, mark it: angle: In[float]
           3 |      <Turn/>
             |      ^^^^^
        """,  # noqa: E501
    ),
    "a resource of a type that cannot be looked up": (
        ("<Lift/>",),
        TreeError,
        """
        t.xml:3:5: E118 the parameter 'arm' of <Lift> has the type Arm, which isinstance() does not support: use a class, or a Protocol marked @runtime_checkable
           3 |      <Lift/>
             |      ^^^^^
        """,  # noqa: E501
    ),
    "a port of a node that has none": (
        ('<AlwaysSuccess speed="1"/>',),
        PortError,
        """
        t.xml:3:20: E201 <AlwaysSuccess> has no port 'speed'
           3 |      <AlwaysSuccess speed="1"/>
             |                     ^^^^^
              it has no ports
        """,
    ),
    "a wrong type": (
        ('<Repeat num_cycles="many"><AlwaysSuccess/></Repeat>',),
        PortError,
        """
        t.xml:3:25: E202 the port 'num_cycles' of <Repeat> has the type int: 'many' is not an integer
           3 |      <Repeat num_cycles="many"><AlwaysSuccess/></Repeat>
             |                          ^^^^
              to use the blackboard entry, write {many}
        """,
    ),
    "an empty attribute of a typed port": (
        ('<Repeat num_cycles=""><AlwaysSuccess/></Repeat>',),
        PortError,
        """
        t.xml:3:24: E202 the port 'num_cycles' of <Repeat> has the type int: '' is not an integer
           3 |      <Repeat num_cycles=""><AlwaysSuccess/></Repeat>
             |                         ^^
        """,
    ),
    "a blackboard entry with spaces around": (
        ('<Repeat num_cycles=" {n}"><AlwaysSuccess/></Repeat>',),
        PortError,
        """
        t.xml:3:25: E202 the port 'num_cycles' of <Repeat> has the type int: ' {n}' is not an integer
           3 |      <Repeat num_cycles=" {n}"><AlwaysSuccess/></Repeat>
             |                          ^^^^
              write {n} without surrounding spaces
        """,
    ),
    "two types for one entry": (
        ('<RunOnce then_skip="{n}"><Repeat num_cycles="{n}"><Say/></Repeat></RunOnce>',),
        PortError,
        """
        t.xml:3:50: E203 the port 'num_cycles' of <Repeat> has the type int, but its entry has the type bool
           3 |      <RunOnce then_skip="{n}"><Repeat num_cycles="{n}"><Say/></Repeat></RunOnce>
             |                                                   ^^^
              declared by 'then_skip' of <RunOnce> (t.xml:3); the type of an entry never changes
        """,
    ),
    "a script with a mistake": (
        ('<Say _skipIf="a &gt; 1 &amp;&amp; b = = 2"/>',),
        PortError,
        """
        t.xml:3:43: E206 invalid script in '_skipIf' of <Say>: expected a value, but found '='
           3 |      <Say _skipIf="a &gt; 1 &amp;&amp; b = = 2"/>
             |                                            ^
        """,
    ),
    "a Script without its script": (
        ("<Script/>",),
        PortError,
        """
        t.xml:3:5: E205 <Script> needs port [code], which the tree does not give
           3 |      <Script/>
             |      ^^^^^^^
        """,
    ),
    "a leaf without its robot": (
        ('<Drive speed="1"/>',),
        TreeError,
        """
        t.xml:3:5: E118 <Drive> needs a Robot for its parameter 'robot': pass it in resources=[…]
           3 |      <Drive speed="1"/>
             |      ^^^^^^
        """,
    ),
    "a leaf that raises while it is created": (
        ("<Broken/>",),
        TreeError,
        """
        t.xml:3:5: E115 <Broken> raised while it was created: ValueError: no camera
           3 |      <Broken/>
             |      ^^^^^^^
        """,
    ),
    "two SubTrees with the same name": (
        (
            '<Sequence><SubTree ID="A" name="a"/><SubTree ID="A" name="a"/></Sequence>',
            {"A": "<AlwaysSuccess/>"},
        ),
        TreeError,
        """
        t.xml:3:63: E112 two SubTree nodes have the path 'a'
           3 |      <Sequence><SubTree ID="A" name="a"/><SubTree ID="A" name="a"/></Sequence>
             |                                                                ^
              give them different names, or remove the names
        """,
    ),
    "a port that a subtree's model requires": (
        (
            '<SubTree ID="A"/>',
            '<BehaviorTree ID="A"><Say/></BehaviorTree>'
            '<TreeNodesModel><SubTree ID="A"><input_port name="goal"/></SubTree></TreeNodesModel>',
        ),
        PortError,
        """
        t.xml:3:5: E204 <SubTree> lacks the port 'goal', which the model of 'A' requires
           3 |      <SubTree ID="A"/>
             |      ^^^^^^^^
              write goal="…", or declare a default in <TreeNodesModel>
        """,
    ),
    "a port of a subtree whose name has a dot": (
        ("<Say/>", '<TreeNodesModel><SubTree ID="A"><input_port name="a.b"/></SubTree></TreeNodesModel>'),
        TreeError,
        """
        t.xml:5:51: E107 invalid port name 'a.b' in the model of a subtree: it contains '.'
           5 |  <TreeNodesModel><SubTree ID="A"><input_port name="a.b"/></SubTree></TreeNodesModel></root>
             |                                                    ^^^
        """,
    ),
    "_autoremap that is not a bool": (
        ('<SubTree ID="A" _autoremap="yes"/>', {"A": "<AlwaysSuccess/>"}),
        PortError,
        """
        t.xml:3:33: E207 _autoremap must be 'true' or 'false', not 'yes'
           3 |      <SubTree ID="A" _autoremap="yes"/>
             |                                  ^^^
        """,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_error_message(case: str, tree_error: Refused) -> None:
    source, kind, expected_message = CASES[case]
    fault = tree_error(source)
    assert str(fault) == dedent(expected_message).strip("\n")
    assert type(fault) is kind


def test_port_error_in_an_unused_tree_does_not_refuse_the_main_tree(nodes: Registry, document: Write) -> None:
    text = document("<Say/>", {"Unused": '<Say txt="1"/>'})
    assert instantiate(plan_document(parse_text(text), nodes)).id == "Main"


def test_type_of_an_entry_on_a_given_blackboard_is_checked(nodes: Registry, document: Write) -> None:
    blackboard = Blackboard()
    blackboard["n"] = True
    text = document('<Repeat num_cycles="{n}"><Say/></Repeat>')
    with pytest.raises(PortError) as caught:
        instantiate(plan_document(parse_text(text, "t.xml"), nodes), blackboard=blackboard)
    assert caught.value.diagnostics[0].hint.startswith("it was on the blackboard before the tree")


def test_an_entry_that_does_not_fit_the_type_of_a_port_is_an_error_with_a_place() -> None:
    @condition
    def near(x: In[float]) -> bool:
        return x < 1

    nodes = Registry.standard()
    nodes.add(near)
    blackboard = Blackboard()
    blackboard["x"] = 2**60  # a double represents integers of at most 53 bits
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main">\n<Near x="{x}"/></BehaviorTree></root>'
    with pytest.raises(PortError, match=r"2:10: E203 the port 'x' of <Near> has the type double"):
        btcore.loads(text, nodes=nodes, blackboard=blackboard)


class Color(enum.Enum):
    RED = 1
    GREEN = 2


@condition
def shows(c: In[Color] = Color.RED) -> bool:
    return c is Color.RED


def colors(xml: str) -> tuple[str, Registry]:
    nodes = Registry.standard()
    nodes.add(shows)
    return f'<root main_tree_to_execute="M"><BehaviorTree ID="M">{xml}</BehaviorTree></root>', nodes


@pytest.mark.parametrize("text", ["REDD", "3", "red"])
def test_enum_texts_are_checked_when_the_tree_is_loaded(text: str) -> None:
    xml, nodes = colors(f'<Shows c="{text}"/>')
    message = (
        f"E202 the port 'c' of <Shows> has the type .*: '{text}' is not a member of .*; use RED or GREEN"
    )
    with pytest.raises(PortError, match=message):
        btcore.loads(xml, nodes=nodes, format=4)


def test_default_of_an_enum_with_a_converter_is_not_converted() -> None:
    xml, _ = colors('<Sequence><Shows/><Shows c="rot"/></Sequence>')
    nodes = Registry.standard()
    nodes.add_type(Color, from_text=lambda text: {"rot": Color.RED}[text])
    nodes.add(shows)
    assert btcore.loads(xml, nodes=nodes, format=4).tick_once() is btcore.Status.SUCCESS


@pytest.mark.parametrize("format", [3, 4])
def test_enum_texts_are_checked_by_validate(format: int) -> None:
    xml, nodes = colors('<Shows c="REDD"/>')
    (found,) = validate_document(parse_text(xml), nodes=nodes, format=format)
    assert (found.code, found.is_error) == ("E202", True)
    assert "'REDD' is not a member of" in found.message
