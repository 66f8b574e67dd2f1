"""Values that do not fit the types of entries."""

import pytest

from btcore import NodeExecutionError, Registry
from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented, load_main, sequence, tree

REPEAT = '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'

CASES = {
    "an entry that is a text": (
        sequence('<Say text="{n}"/>', '<Count start="1" result="{n}"/>'),
        "",
        """
        t.xml:5:32: W206 the port 'result' of <Count> writes int, but the entry 'n' has the type std::string: every write raises
           5 |        <Count start="1" result="{n}"/>
             |                                 ^^^
              declared by 'text' of <Say> (t.xml:4); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
    "an entry that is a text, in the calling tree": (
        sequence('<Say text="{word}" _skipIf="true"/>', '<SubTree ID="Inner" n="{word}"/>'),
        tree("Inner", '<Count start="1" result="{n}"/>'),
        """
        t.xml:9:30: W206 the port 'result' of <Count> writes int, but the entry 'n' has the type std::string: every write raises
           9 |      <Count start="1" result="{n}"/>
             |                               ^^^
              declared by 'text' of <Say> (t.xml:4); the type of an entry never changes
        """,  # noqa: E501 - a message is one line
    ),
    "a script's text for a number": (
        sequence('<Count start="1" result="{n}"/>', "<Script code=\"n := 'many'\"/>"),
        "",
        """
        t.xml:5:21: W206 the script in 'code' of <Script> always raises: cannot assign to 'n': 'many' is not an integer
           5 |        <Script code="n := 'many'"/>
             |                      ^
              'n' has the type int, declared by 'result' of <Count> (t.xml:4)
        """,  # noqa: E501 - a message is one line
    ),
    "a SetBlackboard's text for a number": (
        sequence('<Count start="1" result="{n}"/>', '<SetBlackboard value="many" output_key="n"/>'),
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
        sequence(
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
        sequence("<Script code=\"s := 'shut'\"/>", '<SetBlackboard value="it\'s open" output_key="s"/>'),
        "",
        """
        t.xml:5:52: W213 <SetBlackboard> writes a text to the entry 's', which has no type: BehaviorTree.CPP 4.10 empties the entry instead, and raises at the next text
           5 |        <SetBlackboard value="it's open" output_key="s"/>
             |                                                     ^
              'code' of <Script> in line 4 creates the entry; a Script works in both: s := '…'
        """,  # noqa: E501 - a message is one line
    ),
    "a script's integer copied to an entry of doubles": (
        sequence(
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
        sequence(
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
def test_warning_about_a_type(check: Checker, name: str) -> None:
    body, more, expected = CASES[name]
    assert check(body, more) == dedented(expected)


RAISING = [
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
    expected_message, skipped = '<Say text="{n}"/>', '<Say text="{n}" _skipIf="true"/>'
    made = load_main(
        palette, body.replace(expected_message, skipped), more.replace(expected_message, skipped)
    )
    with pytest.raises(NodeExecutionError):
        made.tick_once()


FINE = {
    "a number that fits": sequence('<Count start="1" result="{n}"/>', '<Script code="n := 2"/>'),
    "a text for a new entry": sequence(
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
    "a text for an entry that a leaf with the blackboard may write": sequence(
        "<Tidy/>",
        '<SetBlackboard value="1;2" output_key="q"/>',
        '<LoopInt queue="{q}"><AlwaysSuccess/></LoopInt>',
    ),
    "a text that converts": sequence('<Count start="1" result="{n}"/>', "<Script code=\"n := '2'\"/>"),
}


@pytest.mark.parametrize("name", FINE)
def test_valid_values_are_not_reported(check: Checker, name: str) -> None:
    assert check(FINE[name]) == ""


def test_type_of_a_given_key_is_unknown(check: Checker) -> None:
    body, _, _ = CASES["a text for an entry of a port without a type"]
    assert check(body, given=["q"]) == ""


def test_text_for_an_entry_without_a_type_is_normal_in_format_3(check: Checker) -> None:
    body = sequence(
        '<SetBlackboard value="1" output_key="n"/>', '<SetBlackboard value="{n}" output_key="m"/>'
    )
    assert check(body, format=3) == ""
    assert "W213" in check(body)


def test_copy_of_an_integer_that_the_program_may_have_written_is_not_reported(check: Checker) -> None:
    body, _, _ = CASES["a script's integer copied to an entry of doubles"]
    assert check(body, given=["e"]) == ""
    assert check(body.replace("e := 1", "e := 1.5")) == ""
