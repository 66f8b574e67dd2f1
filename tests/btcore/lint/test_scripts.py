"""Scripts that always raise, and assignments in conditions."""

import pytest

from btcore import NodeExecutionError, Registry
from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented, load_main

CASES = {
    "an empty condition": (
        '<ScriptCondition code=""/>',
        """
        t.xml:3:27: W207 the script in 'code' of <ScriptCondition> always raises: it is empty
           3 |      <ScriptCondition code=""/>
             |                            ^^
        """,
    ),
    "a condition that is a number": (
        '<AlwaysSuccess _skipIf="2"/>',
        """
        t.xml:3:29: W207 '_skipIf' of <AlwaysSuccess> always raises: its result is 2, neither true nor false
           3 |      <AlwaysSuccess _skipIf="2"/>
             |                              ^
              valid results are 0, 1 and reals from 0 up; or write a comparison
        """,
    ),
    "a condition that is a text": (
        "<ScriptCondition code=\"'true'\"/>",
        """
        t.xml:3:28: W207 'code' of <ScriptCondition> always raises: its result is the text 'true'
           3 |      <ScriptCondition code="'true'"/>
             |                             ^^^^^^
              write true without quotes
        """,
    ),
    "a script that cannot be evaluated": (
        "<Script code=\"a := 'x' * 2\"/>",
        """
        t.xml:3:28: W207 the script in 'code' of <Script> always raises: '*' does not support the text 'x' and the number 2
           3 |      <Script code="a := 'x' * 2"/>
             |                             ^
        """,  # noqa: E501 - a message is one line
    ),
    "a script that assigns to a comparison": (
        '<AlwaysSuccess _failureIf="1 == 1 &amp;&amp; a = 2"/>',
        """
        t.xml:3:52: W207 the script in '_failureIf' of <AlwaysSuccess> always raises: the left side of '=' is not the name of an entry
           3 |      <AlwaysSuccess _failureIf="1 == 1 &amp;&amp; a = 2"/>
             |                                                     ^
        """,  # noqa: E501 - a message is one line
    ),
    "a condition that assigns": (
        '<AlwaysSuccess _skipIf="x = 3"/>',
        """
        t.xml:3:31: W208 '_skipIf' of <AlwaysSuccess> assigns to 'x' instead of comparing
           3 |      <AlwaysSuccess _skipIf="x = 3"/>
             |                                ^
              to compare, write x == …
        """,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_warning_about_a_script(check: Checker, name: str) -> None:
    body, expected = CASES[name]
    assert check(body, given=["x", "a"]) == dedented(expected)


RAISING = [
    "a condition that is a number",
    "a condition that is a text",
    "a script that cannot be evaluated",
    "a script that assigns to a comparison",
]


@pytest.mark.parametrize("name", RAISING)
def test_tree_with_a_warning_raises_when_ticked(palette: Registry, name: str) -> None:
    made = load_main(palette, CASES[name][0])
    made.blackboard["a"] = 1
    with pytest.raises(NodeExecutionError):
        made.tick_once()


@pytest.mark.parametrize(
    "body",
    [
        '<AlwaysSuccess _skipIf="1"/>',
        '<AlwaysSuccess _skipIf="2.5"/>',
        '<AlwaysSuccess _skipIf="true"/>',
        '<AlwaysSuccess _skipIf="x"/>',
        '<AlwaysSuccess _skipIf="x == 3"/>',
        '<AlwaysSuccess _skipIf="x = 2; x &gt; 1"/>',
        '<AlwaysSuccess _onSuccess="x = 3"/>',
        '<Script code="x = 3"/>',
        "<Script code=\"n := 'a' + 'b'\"/>",
    ],
)
def test_valid_scripts_are_not_reported(check: Checker, body: str) -> None:
    assert check(body, given=["x"]) == ""
