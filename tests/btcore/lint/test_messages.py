"""All warnings about ports, scripts, keys and types: the whole message, as a user reads it."""

from collections.abc import Callable
from pathlib import Path

import pytest

import btcore
from btcore import NodeExecutionError, Registry, SimClock
from tests.btcore.lint.conftest import Checker
from tests.btcore.message_cases import read_cases

CASES = read_cases(Path(__file__).with_name("messages.txt"))


def document_of(text: str, document: Callable[..., str]) -> str:
    return text if text.startswith("<root") else document(text.rstrip("\n"))


@pytest.mark.parametrize("case", CASES)
def test_message(check: Checker, document: Callable[..., str], case: str) -> None:
    text, message = CASES[case]
    found = check.found_in(document_of(text, document), given=["x", "a"])
    assert "\n".join(map(str, found)) == message


@pytest.mark.parametrize("case", [title for title in CASES if title.endswith("(raises)")])
def test_tree_with_warning_raises_in_tick(palette: Registry, document: Callable[..., str], case: str) -> None:
    tree = btcore.loads(document_of(CASES[case][0], document), nodes=palette, clock=SimClock())
    tree.blackboard["a"] = 1
    with pytest.raises(NodeExecutionError):
        tree.tick_once()


@pytest.mark.parametrize(
    ("node", "attributes", "characters"),
    [
        ('<Sleep msec="fast"/>', ("msec",), (0, 0)),
        ('<Script code="a := 1 &amp;&amp; &amp;&amp; 2"/>', ("code",), (10, 11)),
        ('<AlwaysSuccess _skipIf="1 &amp;&amp; &apos;true&apos;"/>', ("_skipIf",), (2, 4)),
        ('<SetBlackboard value="1"/>', ("output_key",), (0, 0)),
        ("<SubTree/>", ("ID",), (0, 0)),
        ("<Action/>", ("ID",), (0, 0)),
        ("<Unknown/>", (), (0, 0)),
    ],
)
def test_a_diagnostic_names_the_attributes_that_it_is_about(
    check: Checker, node: str, attributes: tuple[str, ...], characters: tuple[int, int]
) -> None:
    try:
        (found,) = check.found(node)
    except btcore.TreeError as error:
        (found,) = error.diagnostics
    assert (found.attributes, found.characters) == (attributes, characters)
