"""A saved file replaces the tree between two ticks; a broken one does not."""

import os
from pathlib import Path

import pytest

import btcore
from btcore import Status, TreeError
from btcore.reload import Watch, reloaded

FIRST = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Script code="x := 1"/><Sleep msec="3600000"/></Sequence></BehaviorTree></root>"""
SECOND = """<root BTCPP_format="4"><BehaviorTree ID="Main">
    <ScriptCondition code="x == 1"/></BehaviorTree></root>"""


def save(path: Path, text: str) -> None:
    """Save as an editor does, at a time that no earlier save had."""
    before = path.stat().st_mtime_ns if path.exists() else 0
    path.write_text(text)
    os.utime(path, ns=(before + 1_000_000_000, before + 1_000_000_000))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "tree.xml"
    save(path, FIRST)
    return path


def test_a_saved_file_is_noticed_once(file: Path) -> None:
    watch = Watch(file)
    assert not watch.saved()
    save(file, SECOND)
    assert watch.saved()
    assert not watch.saved()


def test_a_file_that_is_gone_for_a_moment_is_no_new_file(file: Path) -> None:
    """Editors save by renaming."""
    watch = Watch(file)
    text = file.read_text()
    file.unlink()
    assert not watch.saved()
    save(file, text + "\n")
    assert watch.saved()


def test_a_saved_include_is_noticed_too(file: Path) -> None:
    part = file.parent / "part.xml"
    save(part, SECOND.replace("Main", "Part"))
    save(file, FIRST.replace('<BehaviorTree ID="Main"', '<include path="part.xml"/><BehaviorTree ID="Main"'))
    watch = Watch(file)
    save(part, SECOND.replace("Main", "Part").replace("1", "2"))
    assert watch.saved()


def test_the_blackboard_stays_and_the_old_tree_is_halted(file: Path) -> None:
    old = btcore.load(file, clock=btcore.SimClock())
    assert old.tick_once() is Status.RUNNING
    save(file, SECOND)
    new = reloaded(old, file)
    assert all(node.status is Status.IDLE for node in old)
    assert new.tick_once() is Status.SUCCESS
    assert new.blackboard is old.blackboard


def test_a_broken_file_leaves_the_old_tree_running_and_the_blackboard_as_it_was(file: Path) -> None:
    old = btcore.load(file, clock=btcore.SimClock())
    old.tick_once()
    save(file, SECOND.replace("<ScriptCondition", '<Switch2 variable="{new_key}"/><ScriptCondition'))
    with pytest.raises(TreeError):
        reloaded(old, file)
    assert old.root.status is Status.RUNNING
    assert set(old.blackboard) == {"x"}
