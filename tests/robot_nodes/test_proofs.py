"""The standard questions are proved for the trees of this repository; the large ones are in no sample."""

from pathlib import Path

import pytest

from btcore import Registry
from btcore.proof import assert_proved

TREES = Path(__file__).parent.parent.parent / "trees"
NAMES = (
    "bumpgo",
    "bumpgo_wide",
    "mapping",
    "navigation/navigate_w_replanning_time",
    "patrolling",
    "patrolling_book",
    "patrolling_skipping",
    "tutorials/free_space",
    "tutorials/goal_or_home",
    "tutorials/patrolling_boxes",
)


@pytest.mark.parametrize("name", NAMES)
def test_the_standard_questions_are_proved(name: str):
    nodes = Registry.standard()
    assert nodes.add_plugins() == []
    assert_proved(TREES / f"{name}.xml", nodes=nodes)
