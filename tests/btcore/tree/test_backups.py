"""Backups of all blackboards of a tree."""

import threading
from dataclasses import dataclass, field

import pytest

from btcore import Blackboard, BtcoreError, Tree, loads
from btcore.values import INT

XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence> <SubTree ID="Inner" goal="{target}"/> <Script code="count := 1.5"/> </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Inner"> <Script code="goal := 'door'; steps := 3"/> </BehaviorTree>
</root>"""


@dataclass
class Plan:
    steps: list[str] = field(default_factory=list)


@pytest.fixture
def tree() -> Tree:
    tree = loads(XML)
    tree.tick_once()
    return tree


def contents(tree: Tree) -> list[dict[str, object]]:
    return [dict(subtree.blackboard) for subtree in tree.subtrees]


def test_restored_blackboards_have_the_values_and_types_of_the_backup(tree: Tree) -> None:
    board, inner = (subtree.blackboard for subtree in tree.subtrees)
    board["laps"] = 2
    before = contents(tree)
    assert before == [{"target": "door", "count": 1.5, "laps": 2}, {"steps": 3}]
    backup = tree.backup_blackboards()
    board["count"] = 7
    board["later"] = 1
    del board["laps"], inner["steps"]
    tree.restore_blackboards(backup)
    assert contents(tree) == before
    entry = board.find("laps")
    assert entry is not None
    assert (entry.declared, entry.inferred) == (INT, True)
    # The remappings are not part of a backup: they still hold.
    inner["goal"] = "window"
    assert board["target"] == "window"


def test_backup_contains_copies_that_keep_shared_objects_shared(tree: Tree) -> None:
    board, inner = (subtree.blackboard for subtree in tree.subtrees)
    board["plan"] = inner["plan"] = plan = Plan(["first"])
    backup = tree.backup_blackboards()
    plan.steps.append("second")
    for _ in range(2):
        tree.restore_blackboards(backup)
        restored = board.get("plan", Plan)
        assert restored.steps == ["first"]
        assert inner["plan"] is restored
        restored.steps.clear()


def test_value_that_cannot_be_copied_is_shared_with_the_backup(tree: Tree) -> None:
    lock = threading.Lock()
    tree.blackboard["lock"] = lock
    backup = tree.backup_blackboards()
    assert backup[0]["lock"] is lock
    assert backup[0]["count"] == 1.5
    tree.restore_blackboards(backup)
    assert tree.blackboard["lock"] is lock


def test_restoring_counts_as_a_write(tree: Tree) -> None:
    entry = tree.blackboard.find("count")
    assert entry is not None
    before = entry.sequence_id
    tree.restore_blackboards(tree.backup_blackboards())
    assert tree.blackboard.find("count") is entry
    assert entry.sequence_id == before + 1


def test_backup_leaves_out_the_parent_of_the_main_blackboard() -> None:
    shared = Blackboard()
    shared["battery"] = 1.0
    tree = loads(XML, blackboard=Blackboard(shared))
    backup = tree.backup_blackboards()
    assert len(backup) == 2
    shared["battery"] = 0.5
    tree.restore_blackboards(backup)
    assert shared["battery"] == 0.5


def test_backup_of_another_tree_is_refused(tree: Tree) -> None:
    other = loads('<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>')
    with pytest.raises(BtcoreError, match="the backup has 1 blackboards, but the tree 'Main' has 2"):
        tree.restore_blackboards(other.backup_blackboards())


def test_scopes_of_format_3_still_share_their_entries_after_a_restore() -> None:
    tree = loads(
        """<root BTCPP_format="3" main_tree_to_execute="Main">
          <BehaviorTree ID="Main"> <SubTree ID="Inner" goal="target"/> </BehaviorTree>
          <BehaviorTree ID="Inner"> <SetBlackboard output_key="goal" value="door"/> </BehaviorTree>
        </root>"""
    )
    tree.tick_once()
    backup = tree.backup_blackboards()
    board, inner = (subtree.blackboard for subtree in tree.subtrees)
    inner["goal"] = "window"
    tree.restore_blackboards(backup)
    assert board["target"] == inner["goal"] == "door"
    assert board.find("target") is inner.find("goal")
