"""Warnings about keys: read but never written, passed without effect, of a type that refuses a value."""

from collections.abc import Callable
from textwrap import dedent
from typing import Any

import pytest

import btcore
from btcore import NodeExecutionError, Registry
from btcore.clock import SimClock

Check = Callable[..., str]
ALREADY = "write it before, or fill the blackboard before the first tick"


def tree(ID: str, body: str) -> str:
    return f'  <BehaviorTree ID="{ID}">\n    {body}\n  </BehaviorTree>\n'


def children(*of: str) -> str:
    """Return a Sequence with one child per line; the children stand in lines 4, 5, 6 …"""
    return "\n      ".join(("<Sequence>", *of)) + "\n    </Sequence>"


def dedented(text: str) -> str:
    return dedent(text).lstrip("\n")


REPEAT = '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'

CASES = {
    "read by a port": (
        '<Say text="{goal}"/>',
        "",
        """
        t.xml:3:16: W201 the port 'text' of <Say> reads {goal}, which is never written
           3 |      <Say text="{goal}"/>
             |                 ^^^^^^
              write it first, or fill the blackboard before the first tick: tree.blackboard["goal"] = …, or btcore run --set goal=VALUE
        """,  # noqa: E501 - a hint is one line
    ),
    "a typing mistake": (
        children('<Script code="goal := 1"/>', '<Say text="{gaol}"/>', '<Say text="{gaol}"/>'),
        "",
        """
        t.xml:5:18: W201 the port 'text' of <Say> reads {gaol}, which is never written (1 more place reads it)
           5 |        <Say text="{gaol}"/>
             |                   ^^^^^^
              did you mean 'goal'?
        """,
    ),
    "spaces in a key": (
        children('<Look found="{door}"/>', '<Say text="{ door }"/>'),
        "",
        """
        t.xml:5:18: W201 the port 'text' of <Say> reads { door }, which is never written
           5 |        <Say text="{ door }"/>
             |                   ^^^^^^^^
              spaces inside the braces are part of the key: write {door}
        """,
    ),
    "read by a script": (
        '<AlwaysSuccess _skipIf="1 &lt; done"/>',
        "",
        """
        t.xml:3:36: W201 the script in '_skipIf' of <AlwaysSuccess> reads 'done', which is never written
           3 |      <AlwaysSuccess _skipIf="1 &lt; done"/>
             |                                     ^^^^
              write it first, or fill the blackboard before the first tick: tree.blackboard["done"] = …, or btcore run --set done=VALUE
        """,  # noqa: E501 - a hint is one line
    ),
    "a possible enum member": (
        children('<Script code="state := READY"/>'),
        "",
        """
        t.xml:4:30: W201 the script in 'code' of <Script> reads 'READY', which is never written
           4 |        <Script code="state := READY"/>
             |                               ^^^^^
              if it is the name of an enum member, register the enum with nodes.add_enum(…); else write it first, or fill the blackboard before the first tick: tree.blackboard["READY"] = …, or btcore run --set READY=VALUE
        """,  # noqa: E501 - a hint is one line
    ),
    "known only to the calling tree": (
        children('<Look found="{door}"/>', '<SubTree ID="Inner"/>'),
        tree("Inner", '<Say text="{door}"/>'),
        """
        t.xml:9:16: W201 the port 'text' of <Say> reads {door}, which is never written
           9 |      <Say text="{door}"/>
             |                 ^^^^^^
              a subtree has a blackboard of its own: in the SubTree of 'Inner' in line 5 write door="{door}"
        """,
    ),
    "braces around the key of a SetBlackboard": (
        '<SetBlackboard value="1" output_key="{x}"/>',
        "",
        """
        t.xml:3:42: W201 the port 'output_key' of <SetBlackboard> reads {x}, which is never written
           3 |      <SetBlackboard value="1" output_key="{x}"/>
             |                                           ^^^
              {x} must hold the name of the entry to write; to write the entry x itself, use output_key="x"
        """,
    ),
    "assigned to but never created": (
        '<Script code="x += 1"/>',
        "",
        """
        t.xml:3:19: W209 the script in 'code' of <Script> assigns to the entry 'x', which is never created
           3 |      <Script code="x += 1"/>
             |                    ^
              to create it, write x := …; or fill the blackboard before the first tick: tree.blackboard["x"] = …, or btcore run --set x=VALUE
        """,  # noqa: E501 - a message is one line
    ),
    "passed without effect": (
        children('<Look found="{door}"/>', '<SubTree ID="Inner" dor="{door}" door="x"/>'),
        tree("Inner", '<Say text="{door}"/>'),
        """
        t.xml:5:27: W204 no port or script in the tree of <SubTree ID="Inner"> uses 'dor'
           5 |        <SubTree ID="Inner" dor="{door}" door="x"/>
             |                            ^^^
              its keys are 'door'
        """,
    ),
    "passed in vain: a SetBlackboard has the same text, which is not a key": (
        '<SubTree ID="Inner" door="open"/>',
        tree("Inner", '<Sequence><SetBlackboard value="door" output_key="x"/><Say text="{x}"/></Sequence>'),
        """
        t.xml:3:25: W204 no port or script in the tree of <SubTree ID="Inner"> uses 'door'
           3 |      <SubTree ID="Inner" door="open"/>
             |                          ^^^^
              its keys are 'x'
        """,
    ),
    "passed under a mistyped name": (
        '<SubTree ID="Inner" gate="open" dor="shut"/>',
        tree("Inner", '<Script code="gate := door"/>'),
        """
        t.xml:3:37: W204 no port or script in the tree of <SubTree ID="Inner"> uses 'dor'
           3 |      <SubTree ID="Inner" gate="open" dor="shut"/>
             |                                      ^^^
              did you mean 'door'?
        t.xml:6:27: W201 the script in 'code' of <Script> reads 'door', which is never written
           6 |      <Script code="gate := door"/>
             |                            ^^^^
              did you mean 'dor'?
        """,
    ),
    "an entry that is a text": (
        children('<Say text="{n}"/>', '<Count start="1" result="{n}"/>'),
        "",
        """
        t.xml:5:32: W206 the port 'result' of <Count> writes int, but the entry 'n' has the type std::string: every write raises
           5 |        <Count start="1" result="{n}"/>
             |                                 ^^^
              declared by 'text' of <Say> (t.xml:4); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
    "an entry that is a text, in the calling tree": (
        children('<Say text="{word}" _skipIf="true"/>', '<SubTree ID="Inner" n="{word}"/>'),
        tree("Inner", '<Count start="1" result="{n}"/>'),
        """
        t.xml:9:30: W206 the port 'result' of <Count> writes int, but the entry 'n' has the type std::string: every write raises
           9 |      <Count start="1" result="{n}"/>
             |                               ^^^
              declared by 'text' of <Say> (t.xml:4); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
    "a script's text for a number": (
        children('<Count start="1" result="{n}"/>', "<Script code=\"n := 'many'\"/>"),
        "",
        """
        t.xml:5:21: W206 the script in 'code' of <Script> always raises: cannot assign to 'n': 'many' is not an integer
           5 |        <Script code="n := 'many'"/>
             |                      ^
              'n' has the type int, declared by 'result' of <Count> (t.xml:4)
        """,  # noqa: E501 - a message is one line
    ),
    "a SetBlackboard's text for a number": (
        children('<Count start="1" result="{n}"/>', '<SetBlackboard value="many" output_key="n"/>'),
        "",
        """
        t.xml:5:47: W206 <SetBlackboard> writes 'many', but the entry 'n' has the type int: every write raises
           5 |        <SetBlackboard value="many" output_key="n"/>
             |                                                ^
              declared by 'result' of <Count> (t.xml:4); the type of an entry never changes
        """,
    ),
    "a constant that its reader can't read": (
        '<SubTree ID="Inner" n="soon"/>',
        tree("Inner", REPEAT),
        """
        t.xml:3:28: E202 'n' of <SubTree ID="Inner"> is the text 'soon': 'soon' is not an integer
           3 |      <SubTree ID="Inner" n="soon"/>
             |                             ^^^^
              the port 'num_cycles' of <Repeat> reads it as int; to pass the entry, write {soon}
        """,
    ),
    "a text for an entry of a port without a type": (
        children(
            '<SetBlackboard value="1;2" output_key="q"/>', '<LoopInt queue="{q}"><AlwaysSuccess/></LoopInt>'
        ),
        "",
        """
        t.xml:4:46: W213 <SetBlackboard> writes a text to the entry 'q', which has no type: BehaviorTree.CPP 4.10 empties the entry instead, and raises at the next text
           4 |        <SetBlackboard value="1;2" output_key="q"/>
             |                                               ^
              'queue' of <LoopInt> in line 5 creates the entry; a Script works in both: q := '1;2'
        """,  # noqa: E501 - a message is one line
    ),
    "a text for a constant of a SubTree": (
        '<SubTree ID="Inner" word="shut"/>',
        tree("Inner", '<SetBlackboard value="open" output_key="word"/>'),
        """
        t.xml:6:45: W213 <SetBlackboard> writes a text to the entry 'word', which has no type: BehaviorTree.CPP 4.10 empties the entry instead, and raises at the next text
           6 |      <SetBlackboard value="open" output_key="word"/>
             |                                              ^^^^
              'word' of <SubTree ID="Inner"> in line 3 creates the entry; a Script works in both: word := 'open'
        """,  # noqa: E501 - a message is one line
    ),
    "a text for an entry that a script creates": (
        children("<Script code=\"s := 'shut'\"/>", '<SetBlackboard value="it\'s open" output_key="s"/>'),
        "",
        """
        t.xml:5:52: W213 <SetBlackboard> writes a text to the entry 's', which has no type: BehaviorTree.CPP 4.10 empties the entry instead, and raises at the next text
           5 |        <SetBlackboard value="it's open" output_key="s"/>
             |                                                     ^
              'code' of <Script> in line 4 creates the entry; a Script works in both: s := '…'
        """,  # noqa: E501 - a message is one line
    ),
    "a script's integer copied to an entry of doubles": (
        children(
            '<Script code="e := 1"/>',
            '<SetBlackboard value="{e}" output_key="n"/>',
            '<LoopDouble queue="1" value="{n}"><AlwaysSuccess/></LoopDouble>',
        ),
        "",
        """
        t.xml:5:46: W206 <SetBlackboard> copies an integer of 64 bits, which a script has written, but the entry 'n' has the type double: every write raises
           5 |        <SetBlackboard value="{e}" output_key="n"/>
             |                                               ^
              declared by 'value' of <LoopDouble> (t.xml:6); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
    "a SetBlackboard's text for a status": (
        children(
            '<SetBlackboard value="SUCCESS" output_key="n"/>',
            '<LoopInt queue="1" if_empty="{n}"><AlwaysSuccess/></LoopInt>',
        ),
        "",
        """
        t.xml:4:50: W206 <SetBlackboard> writes 'SUCCESS', but the entry 'n' has the type BT::NodeStatus: every write raises
           4 |        <SetBlackboard value="SUCCESS" output_key="n"/>
             |                                                   ^
              declared by 'if_empty' of <LoopInt> (t.xml:5); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_warning_about_a_key(check: Check, name: str) -> None:
    body, more, expected = CASES[name]
    assert check(body, more) == dedented(expected)


RAISING = [
    "read by a port",
    "read by a script",
    "a possible enum member",
    "known only to the calling tree",
    "braces around the key of a SetBlackboard",
    "assigned to but never created",
    "an entry that is a text",
    "an entry that is a text, in the calling tree",
    "a script's text for a number",
    "a SetBlackboard's text for a number",
    "a script's integer copied to an entry of doubles",
    "a SetBlackboard's text for a status",
    "a constant that its reader can't read",
]


@pytest.mark.parametrize("name", RAISING)
def test_tree_with_a_warning_raises_when_ticked(palette: Registry, name: str) -> None:
    body, more, _ = CASES[name]
    text = (
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">'
        f"{body}</BehaviorTree>{more}</root>"
    )
    made = btcore.loads(text.replace('<Say text="{n}"/>', '<Say text="{n}" _skipIf="true"/>'), nodes=palette,
                        clock=SimClock())  # fmt: skip
    with pytest.raises(NodeExecutionError):
        made.tick_once()


FINE = {
    "written by a port": children('<Look found="{door}"/>', '<Say text="{door}"/>'),
    "written later": children('<Say text="{door}" _skipIf="true"/>', '<Look found="{door}"/>'),
    "created by a script": children('<Script code="n := 3; n += 1"/>', REPEAT),
    "created by the script of a condition": children('<AlwaysSuccess _onSuccess="n := 3"/>', REPEAT),
    "created by a port, assigned to": children('<Count start="1" result="{n}"/>', '<Script code="n = 2"/>'),
    "set by name": children('<SetBlackboard value="3" output_key="n"/>', REPEAT),
    "written under the port's own name": children('<Look found="{=}"/>', '<Say text="{found}"/>'),
    "written by a loop": '<LoopInt queue="1;2" value="{n}"><Script code="m := n"/></LoopInt>',
    "written somewhere by a leaf that has the blackboard": children("<Tidy/>", '<Say text="{door}"/>'),
    "a number that fits": children('<Count start="1" result="{n}"/>', '<Script code="n := 2"/>'),
    "a text for a new entry": children(
        '<SetBlackboard value="open" output_key="s"/>', "<Script code=\"s := 'shut'\"/>"
    ),
    "a text for the other branch's entry": (
        '<WhileDoElse><Look found="{door}"/>'
        "<Script code=\"s := 'shut'\"/>"
        '<SetBlackboard value="open" output_key="s"/></WhileDoElse>'
    ),
    "a text for an entry before the post-condition that creates it": (
        "<Sequence _onSuccess=\"s := 'shut'\">"
        '<SetBlackboard value="open" output_key="s"/><AlwaysSuccess/></Sequence>'
    ),
    "a text for an entry that a leaf with the blackboard may write": children(
        "<Tidy/>",
        '<SetBlackboard value="1;2" output_key="q"/>',
        '<LoopInt queue="{q}"><AlwaysSuccess/></LoopInt>',
    ),
    "a text that converts": children('<Count start="1" result="{n}"/>', "<Script code=\"n := '2'\"/>"),
}


@pytest.mark.parametrize("name", FINE)
def test_valid_keys_are_not_reported(check: Check, name: str) -> None:
    assert check(FINE[name]) == ""


@pytest.mark.parametrize(
    ("call", "inner"),
    [
        ('<SubTree ID="Inner" n="3"/>', REPEAT),
        ('<SubTree ID="Inner" n="{door}"/>', '<Say text="{n}"/>'),
        ('<SubTree ID="Inner" _autoremap="true"/>', '<Say text="{door}"/>'),
        ('<SubTree ID="Inner"/>', '<Say text="{@door}"/>'),
        ('<SubTree ID="Inner" door="{=}" name="here" _skipIf="false"/>', '<Say text="{door}"/>'),
        ('<SubTree ID="Inner" door="{door}"/>', '<SubTree ID="Deep" word="{door}"/>'),
        ('<SubTree ID="Inner" word="{door}"/>', '<SubTree ID="Deep" _autoremap="true"/>'),
    ],
)
def test_keys_passed_to_subtrees_are_not_reported(check: Check, call: str, inner: str) -> None:
    deep = tree("Deep", '<Say text="{word}"/>') if "Deep" in inner else ""
    assert check(children('<Look found="{door}"/>', call), tree("Inner", inner) + deep) == ""


def test_key_written_by_a_subtree_is_known_to_its_caller(check: Check) -> None:
    body = children('<SubTree ID="Inner" place="{door}"/>', '<Say text="{door}"/>')
    assert check(body, tree("Inner", '<Look found="{place}"/>')) == ""


def test_given_keys_are_not_reported(check: Check) -> None:
    body = children('<Say text="{goal}"/>', '<Script code="x += 1"/>')
    assert check(body, given=["goal", "x"]) == ""
    assert "W201" in check(body, given=["x"])


def test_type_of_a_given_key_is_unknown(check: Check) -> None:
    body, _, _ = CASES["a text for an entry of a port without a type"]
    assert check(body, given=["q"]) == ""


def test_text_for_an_entry_without_a_type_is_normal_in_format_3(check: Check) -> None:
    body = children(
        '<SetBlackboard value="1" output_key="n"/>', '<SetBlackboard value="{n}" output_key="m"/>'
    )
    assert check(body, format=3) == ""
    assert "W213" in check(body)


def test_script_on_the_blackboard_must_exist_when_the_tree_is_built(check: Check) -> None:
    # The writes of the script are unknown, so {door} is not reported.
    body = children('<Script code="{code}"/>', '<Say text="{door}"/>')
    assert check(body, given=["code"]) == ""
    assert check(body) == dedented(
        """
        t.xml:4:21: W201 <Script> reads its script from {code}, which is empty when the tree is built
           4 |        <Script code="{code}"/>
             |                      ^^^^^^
              load the tree with a blackboard that holds the script: load(…, blackboard=…)
        """
    )


def test_given_keys_are_unknown_in_a_subtree(check: Check) -> None:
    assert check('<SubTree ID="Inner"/>', tree("Inner", '<Say text="{goal}"/>'), given=["goal"]) == dedented(
        """
        t.xml:6:16: W201 the port 'text' of <Say> reads {goal}, which is never written
           6 |      <Say text="{goal}"/>
             |                 ^^^^^^
              a subtree has a blackboard of its own: in the SubTree of 'Inner' in line 3 write goal="{goal}"
        """
    )


def test_subtree_model_provides_its_ports(check: Any) -> None:
    text = (
        '<root BTCPP_format="4">'
        '<TreeNodesModel><SubTree ID="Greet"><input_port name="who"/></SubTree></TreeNodesModel>'
        '<BehaviorTree ID="Greet"><Sequence><Say text="{who}"/><Say text="{what}"/></Sequence></BehaviorTree>'
        "</root>"
    )
    assert [one.message for one in check.found_in(text)] == [
        "the port 'text' of <Say> reads {what}, which is never written"
    ]


def test_tree_that_is_called_twice_is_reported_once(check: Any) -> None:
    found = check.found(
        children('<SubTree ID="Inner"/>', '<SubTree ID="Inner"/>'), tree("Inner", '<Say text="{door}"/>')
    )
    assert [one.code for one in found] == ["W201"]


def test_tree_with_unknown_nodes_may_use_any_key(check: Any) -> None:
    found = check.found('<SubTree ID="Inner" door="shut"/>', tree("Inner", '<Knock on="{door}"/>'))
    assert [one.code for one in found] == ["E101"]


def test_warning_names_the_call_that_lacks_a_key(check: Check) -> None:
    body = children('<SubTree ID="Inner" door="shut"/>', '<SubTree ID="Inner"/>')
    assert "in the SubTree of 'Inner' in line 5 write door=" in check(
        body, tree("Inner", '<Say text="{door}"/>')
    )


# --- format 3


def test_braces_in_a_subtree_of_format_3_are_reported(check: Check) -> None:
    body = children('<Look found="{door}"/>', '<SubTree ID="Inner" door="{door}"/>')
    assert check(body, tree("Inner", '<Say text="{door}"/>'), format=3) == dedented(
        """
        t.xml:5:33: W205 in format 3 <SubTree ID="Inner"> takes keys without braces: 'door' has no effect
           5 |        <SubTree ID="Inner" door="{door}"/>
             |                                  ^^^^^^
              write door="door", or <SubTreePlus ID="Inner" door="{door}"/>
        """
    )


@pytest.mark.parametrize(
    "call",
    [
        '<SubTree ID="Inner" door="door"/>',
        '<SubTreePlus ID="Inner" door="{door}"/>',
        '<SubTreePlus ID="Inner" __autoremap="true"/>',
        '<SubTree ID="Inner" __shared_blackboard="true"/>',
    ],
)
def test_keys_passed_in_format_3_are_not_reported(check: Check, call: str) -> None:
    body = children('<Look found="{door}"/>', call)
    assert check(body, tree("Inner", '<Say text="{door}"/>'), format=3) == ""


def test_key_not_passed_in_format_3_is_reported(check: Check) -> None:
    found = check(
        children('<Look found="{door}"/>', '<SubTree ID="Inner"/>'),
        tree("Inner", '<Say text="{door}"/>'),
        format=3,
    )
    assert found.endswith("in the SubTree of 'Inner' in line 5 write door=\"door\"\n")


def test_copy_of_an_integer_that_the_program_may_have_written_is_not_reported(check: Check) -> None:
    body, _, _ = CASES["a script's integer copied to an entry of doubles"]
    assert check(body, given=["e"]) == ""
    assert check(body.replace("e := 1", "e := 1.5")) == ""


def test_equals_sign_as_the_default_of_a_model_is_reported(check: Check) -> None:
    models = (
        '<TreeNodesModel><SubTree ID="Inner"><input_port name="n" default="{=}"/></SubTree></TreeNodesModel>'
    )
    found = check('<SubTree ID="Inner"/>', tree("Inner", REPEAT) + models, given=["="])
    assert "W210 the model of 'Inner' has the default '{=}' for 'n'" in found
    assert found.count("W") == 1
