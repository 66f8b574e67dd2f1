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
def test_tree_with_a_warning_raises_when_ticked(
    palette: Registry, document: Callable[..., str], case: str
) -> None:
    tree = btcore.loads(document_of(CASES[case][0], document), nodes=palette, clock=SimClock())
    tree.blackboard["a"] = 1
    with pytest.raises(NodeExecutionError):
        tree.tick_once()
