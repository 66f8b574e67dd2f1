"""Values of entries without a warning; `messages.txt` has those that do not fit the type of their entry."""

import pytest

from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import sequence

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
    body = sequence(
        '<SetBlackboard value="1;2" output_key="q"/>', '<LoopInt queue="{q}"><AlwaysSuccess/></LoopInt>'
    )
    assert "W213" in check(body)
    assert check(body, given=["q"]) == ""


def test_text_for_an_entry_without_a_type_is_normal_in_format_3(check: Checker) -> None:
    body = sequence(
        '<SetBlackboard value="1" output_key="n"/>', '<SetBlackboard value="{n}" output_key="m"/>'
    )
    assert check(body, format=3) == ""
    assert "W213" in check(body)


def test_copy_of_an_integer_that_the_program_may_have_written_is_not_reported(check: Checker) -> None:
    loop = '<LoopDouble queue="1" value="{n}"><AlwaysSuccess/></LoopDouble>'
    body = sequence('<Script code="e := 1"/>', '<SetBlackboard value="{e}" output_key="n"/>', loop)
    assert "W206" in check(body)
    assert check(body, given=["e"]) == ""
    assert check(body.replace("e := 1", "e := 1.5")) == ""
