"""A saved file replaces the tree between two ticks; a broken file does not."""

import os
from pathlib import Path

import pytest

import btcore
from btcore import Status, Tree, TreeError
from btcore.loading import hot_reload
from btcore.loading.hot_reload import FileWatcher, rebuild_tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file

FIRST = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Script code="x := 1"/><Sleep msec="3600000"/></Sequence></BehaviorTree></root>"""
SECOND = """<root BTCPP_format="4"><BehaviorTree ID="Main">
    <ScriptCondition code="x == 1"/></BehaviorTree></root>"""


def save(path: Path, text: str) -> None:
    """Save as an editor does, with a later modification time than before."""
    before = path.stat().st_mtime_ns if path.exists() else 0
    path.write_text(text)
    os.utime(path, ns=(before + 1_000_000_000, before + 1_000_000_000))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "tree.xml"
    save(path, FIRST)
    return path


@pytest.fixture(autouse=True)
def check_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hot_reload, "POLL_INTERVAL_S", 0.0)


def test_saved_file_is_reported_once_when_it_has_settled(file: Path) -> None:
    watch = FileWatcher(file)
    assert not watch.take_save()
    save(file, SECOND)
    assert not watch.take_save()
    save(file, SECOND + "\n")
    assert [watch.take_save() for _ in range(3)] == [False, True, False]


def test_missing_file_is_not_reported(file: Path) -> None:
    """Editors save by renaming."""
    watch = FileWatcher(file)
    for text in (FIRST, SECOND):
        file.unlink()
        assert not watch.take_save()
        save(file, text + "\n")
        assert not watch.take_save()
    file.unlink()
    assert not watch.take_save()
    save(file, text)
    assert [watch.take_save() for _ in range(3)] == [False, True, False]


def test_saved_include_is_reported_too(file: Path) -> None:
    part = file.parent / "part.xml"
    save(part, SECOND.replace("Main", "Part"))
    save(file, FIRST.replace('<BehaviorTree ID="Main"', '<include path="part.xml"/><BehaviorTree ID="Main"'))
    watch = FileWatcher(file)
    save(part, SECOND.replace("Main", "Part").replace("1", "2"))
    assert [watch.take_save() for _ in range(2)] == [False, True]


def rebuilt(tree: Tree, file: Path) -> Tree:
    return rebuild_tree(tree, plan_document(parse_file(file), tree.registry), ())


def test_the_new_tree_has_the_blackboard_of_the_old_tree(file: Path) -> None:
    old = btcore.load(file, clock=btcore.SimClock())
    assert old.tick_once() is Status.RUNNING
    save(file, SECOND)
    new = rebuilt(old, file)
    assert new.tick_once() is Status.SUCCESS
    assert new.blackboard is old.blackboard


def test_broken_file_keeps_the_old_tree_running_and_the_blackboard_unchanged(file: Path) -> None:
    old = btcore.load(file, clock=btcore.SimClock())
    old.tick_once()
    save(file, SECOND.replace("<ScriptCondition", '<Switch2 variable="{new_key}"/><ScriptCondition'))
    with pytest.raises(TreeError):
        rebuilt(old, file)
    assert old.root.status is Status.RUNNING
    assert set(old.blackboard) == {"x"}
