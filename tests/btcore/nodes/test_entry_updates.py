"""SkipUnlessUpdated, WaitValueUpdate and WasEntryUpdated."""

import pytest

from btcore import Status, TreeError
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog

R, S, F, K = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED

DECORATORS = [("SkipUnlessUpdated", K), ("WaitValueUpdate", R)]


@pytest.mark.parametrize("text", ["=", "{=}"])
def test_equals_sign_is_the_name_of_the_entry(text: str, make_tree: TreeFactory) -> None:
    tree = make_tree(f'<WasEntryUpdated entry="{text}"/>')
    tree.blackboard["entry"] = 1
    assert tree.tick_once() is F
    tree.blackboard["="] = 1
    assert tree.tick_once() is S


@pytest.mark.parametrize(("tag", "otherwise"), DECORATORS)
def test_child_is_ticked_only_if_the_entry_was_written_since_the_last_check(
    tag: str, otherwise: Status, make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(f'<{tag} entry="{{x}}"><Act name="p" outcomes="SF"/></{tag}>')
    assert tree.tick_once() is otherwise
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S
    assert tree.tick_once() is otherwise
    tree.blackboard["x"] = 1
    assert tree.tick_once() is F
    assert calls == ["p:start", "p:start"]


@pytest.mark.parametrize(("tag", "otherwise"), DECORATORS)
def test_halt_halts_the_child_and_keeps_the_last_seen_write(
    tag: str, otherwise: Status, make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(f'<{tag} entry="{{x}}"><Act name="a" outcomes="R"/></{tag}>')
    tree.blackboard["x"] = 1
    tree.tick_once()
    tree.halt()
    assert calls == ["a:start", "a:halted"]
    assert tree.tick_once() is otherwise


@pytest.mark.parametrize(("tag", "otherwise"), DECORATORS)
def test_the_entry_may_be_named_without_braces(tag: str, otherwise: Status, make_tree: TreeFactory) -> None:
    tree = make_tree(f'<{tag} entry="x"><AlwaysSuccess/></{tag}>')
    tree.blackboard["x"] = 1
    assert [tree.tick_once(), tree.tick_once()] == [S, otherwise]


@pytest.mark.parametrize(("tag", "otherwise"), DECORATORS)
def test_number_of_writes_is_compared(tag: str, otherwise: Status, make_tree: TreeFactory) -> None:
    tree = make_tree(f'<{tag} entry="{{x}}"><AlwaysSuccess/></{tag}>')
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S
    tree.blackboard.unset("x")
    assert tree.tick_once() is otherwise
    tree.blackboard["x"] = 2  # the first write of a new entry; one write was already seen
    assert tree.tick_once() is otherwise
    tree.blackboard["x"] = 2
    assert tree.tick_once() is S


@pytest.mark.parametrize("entry", ["", 'entry=""'])
@pytest.mark.parametrize(
    "node",
    [
        "<SkipUnlessUpdated {}><AlwaysSuccess/></SkipUnlessUpdated>",
        "<WaitValueUpdate {}><AlwaysSuccess/></WaitValueUpdate>",
        "<WasEntryUpdated {}/>",
    ],
)
def test_entry_port_is_required(node: str, entry: str, make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="entry"):
        make_tree(node.format(entry))


def test_two_nodes_check_independently(make_tree: TreeFactory) -> None:
    one = '<SkipUnlessUpdated entry="{x}"><AlwaysSuccess/></SkipUnlessUpdated>'
    tree = make_tree(f"<Sequence>{one}{one}</Sequence>")
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S


def test_was_entry_updated_succeeds_if_entry_was_written_since_last_check(
    make_tree: TreeFactory,
) -> None:
    tree = make_tree('<WasEntryUpdated entry="{x}"/>')
    assert tree.tick_once() is F
    tree.blackboard["x"] = 1
    assert [tree.tick_once(), tree.tick_once()] == [S, F]
    tree.blackboard["x"] = 1
    tree.blackboard["x"] = 2
    assert [tree.tick_once(), tree.tick_once()] == [S, F]


def test_was_entry_updated_follows_the_remapping_of_a_subtree(make_tree: TreeFactory) -> None:
    inner = '<BehaviorTree ID="Sub"><WasEntryUpdated entry="{inside}"/></BehaviorTree>'
    tree = make_tree('<SubTree ID="Sub" inside="{outside}"/>', others=inner)
    assert tree.tick_once() is F
    tree.blackboard["outside"] = 1
    assert [tree.tick_once(), tree.tick_once()] == [S, F]


def test_was_entry_updated_keeps_the_last_seen_write_after_a_halt(make_tree: TreeFactory) -> None:
    tree = make_tree('<WasEntryUpdated entry="{x}"/>')
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S
    tree.halt()
    assert tree.tick_once() is F
