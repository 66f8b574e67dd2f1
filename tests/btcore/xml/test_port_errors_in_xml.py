"""What is said of ports, scripts and leaves that don't fit: the whole message, as a user reads it."""

from textwrap import dedent

import pytest

from btcore import In, Registry, SyncAction, action
from btcore.blackboard import Blackboard
from btcore.errors import PortFault, TreeError
from btcore.xml.build import build
from btcore.xml.source import read_text


class Robot:
    pass


@action
def drive(speed: In[float], robot: Robot) -> bool:
    return speed > 0


@action
def say(text: In[str] = "hi") -> bool:
    return bool(text)


class Broken(SyncAction):
    def __init__(self) -> None:
        raise ValueError("no camera")


@pytest.fixture
def nodes() -> Registry:
    made = Registry.standard()
    for ID, thing in {"Drive": drive, "Say": say, "Broken": Broken}.items():
        made.add(thing, ID=ID)
    return made


def document(body: str, more: str = "", root: str = 'BTCPP_format="4" main_tree_to_execute="Main"') -> str:
    return f'<root {root}>\n  <BehaviorTree ID="Main">\n    {body}\n  </BehaviorTree>\n{more}</root>\n'


def tree(ID: str, body: str = "<AlwaysSuccess/>") -> str:
    return f'  <BehaviorTree ID="{ID}">{body}</BehaviorTree>\n'


CASES = {
    "an unknown port": (
        document('<Say txt="hello"/>'),
        PortFault,
        """
        t.xml:3:10: E201 <Say> has no port 'txt'
           3 |      <Say txt="hello"/>
             |           ^^^
              did you mean 'text'?
        """,
    ),
    "a port of a node that has none": (
        document('<AlwaysSuccess speed="1"/>'),
        PortFault,
        """
        t.xml:3:20: E201 <AlwaysSuccess> has no port 'speed'
           3 |      <AlwaysSuccess speed="1"/>
             |                     ^^^^^
              it has no ports
        """,
    ),
    "a wrong type": (
        document('<Repeat num_cycles="many"><AlwaysSuccess/></Repeat>'),
        PortFault,
        """
        t.xml:3:25: E202 the port 'num_cycles' of <Repeat> takes int: 'many' is no integer
           3 |      <Repeat num_cycles="many"><AlwaysSuccess/></Repeat>
             |                          ^^^^
              for the blackboard's entry write {many}
        """,
    ),
    "an empty attribute of a typed port": (
        document('<Repeat num_cycles=""><AlwaysSuccess/></Repeat>'),
        PortFault,
        """
        t.xml:3:24: E202 the port 'num_cycles' of <Repeat> takes int: '' is no integer
           3 |      <Repeat num_cycles=""><AlwaysSuccess/></Repeat>
             |                         ^^
        """,
    ),
    "a blackboard entry with spaces around": (
        document('<Repeat num_cycles=" {n}"><AlwaysSuccess/></Repeat>'),
        PortFault,
        """
        t.xml:3:25: E202 the port 'num_cycles' of <Repeat> takes int: ' {n}' is no integer
           3 |      <Repeat num_cycles=" {n}"><AlwaysSuccess/></Repeat>
             |                          ^^^^
              write {n}, without spaces around
        """,
    ),
    "two types for one entry": (
        document('<RunOnce then_skip="{n}"><Repeat num_cycles="{n}"><Say/></Repeat></RunOnce>'),
        PortFault,
        """
        t.xml:3:50: E203 the port 'num_cycles' of <Repeat> is int, but its entry is bool
           3 |      <RunOnce then_skip="{n}"><Repeat num_cycles="{n}"><Say/></Repeat></RunOnce>
             |                                                   ^^^
              it was declared by 'then_skip' of <RunOnce> (t.xml:3); the type of an entry never changes
        """,
    ),
    "a script with a mistake": (
        document('<Say _skipIf="a &gt; 1 &amp;&amp; b = = 2"/>'),
        PortFault,
        """
        t.xml:3:43: E206 the script in '_skipIf' of <Say>: a value is wanted, but '=' stands here
           3 |      <Say _skipIf="a &gt; 1 &amp;&amp; b = = 2"/>
             |                                            ^
        """,
    ),
    "a Script without its script": (
        document("<Script/>"),
        PortFault,
        """
        t.xml:3:5: E205 <Script> needs port [code], which the tree does not give
           3 |      <Script/>
             |      ^^^^^^^
        """,
    ),
    "a leaf that nobody gives its robot": (
        document('<Drive speed="1"/>'),
        TreeError,
        """
        t.xml:3:5: E118 <Drive> wants a Robot (its parameter 'robot'), and none was handed in: pass one in resources=[…]
           3 |      <Drive speed="1"/>
             |      ^^^^^^
        """,  # noqa: E501
    ),
    "a leaf that raises while it is made": (
        document("<Broken/>"),
        TreeError,
        """
        t.xml:3:5: E115 <Broken> raised while it was made: ValueError: no camera
           3 |      <Broken/>
             |      ^^^^^^^
        """,
    ),
    "two SubTrees of one name": (
        document('<Sequence><SubTree ID="A" name="a"/><SubTree ID="A" name="a"/></Sequence>', tree("A")),
        TreeError,
        """
        t.xml:3:63: E112 two SubTree nodes have the path 'a'
           3 |      <Sequence><SubTree ID="A" name="a"/><SubTree ID="A" name="a"/></Sequence>
             |                                                                ^
              give them different names, or none
        """,
    ),
    "a port that a subtree's model demands": (
        document(
            '<SubTree ID="A"/>',
            tree("A")
            + '<TreeNodesModel><SubTree ID="A"><input_port name="goal"/></SubTree></TreeNodesModel>',
        ),
        PortFault,
        """
        t.xml:3:5: E204 <SubTree> is not given the port 'goal', which the model of 'A' demands
           3 |      <SubTree ID="A"/>
             |      ^^^^^^^^
              write goal="…", or give it a default in <TreeNodesModel>
        """,
    ),
    "_autoremap that is no truth": (
        document('<SubTree ID="A" _autoremap="yes"/>', tree("A")),
        PortFault,
        """
        t.xml:3:33: E207 _autoremap is 'true' or 'false', not 'yes'
           3 |      <SubTree ID="A" _autoremap="yes"/>
             |                                  ^^^
        """,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_message(case: str, nodes: Registry) -> None:
    text, kind, said = CASES[case]
    with pytest.raises(TreeError) as caught:
        build(read_text(text, "t.xml"), nodes)
    assert str(caught.value) == dedent(said).strip("\n")
    assert type(caught.value) is kind


def test_what_is_wrong_in_an_unused_tree_beyond_its_shape_does_not_refuse_the_main_one(
    nodes: Registry,
) -> None:
    text = document("<Say/>", tree("Unused", '<Say txt="1"/>'))
    assert build(read_text(text), nodes).id == "Main"


def test_an_entry_of_a_given_blackboard_counts(nodes: Registry) -> None:
    blackboard = Blackboard()
    blackboard["n"] = True
    text = document('<Repeat num_cycles="{n}"><Say/></Repeat>')
    with pytest.raises(PortFault) as caught:
        build(read_text(text, "t.xml"), nodes, blackboard=blackboard)
    assert caught.value.diagnostics[0].hint.startswith("it was on the blackboard before the tree")
