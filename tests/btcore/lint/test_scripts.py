"""Scripts without a warning; `messages.txt` has those that always raise, and assignments in conditions."""

import pytest

from tests.btcore.lint.conftest import Checker


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
