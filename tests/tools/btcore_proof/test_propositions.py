"""Propositions of questions."""

import pytest

from btcore_proof.propositions import parse_proposition
from btcore_proof.tick_runner import Tick
from tests.btcore.conftest import TreeFactory

SETS = (
    '<Sequence><SetBlackboard value="15" output_key="battery"/><SetBlackboard value="low" output_key="mode"/>'
    '<SetBlackboard value="true" output_key="open"/></Sequence>'
)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("{battery} < 20", True),
        ("{battery} == 15", True),
        ("{battery} > 15.5", False),
        ("{battery} == '15'", True),
        ("{open} == true", True),
        ("{mode} == 'low'", True),
        ("{mode} < 20", False),
        ("{mode} == 20", False),
        ("{mode} != 20", True),
        ("{absent} != 20", False),
    ],
)
def test_text_is_compared_with_a_number_as_in_scripts(make_tree: TreeFactory, text: str, holds: bool) -> None:
    tree = make_tree(SETS)
    tree.tick_once()
    tick = Tick(tree, [], [], tree.status, None, {}, set())
    assert parse_proposition(text, tree).holds(tick) is holds
