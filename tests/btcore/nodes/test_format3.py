"""Nodes and rules of format 3 only: BlackboardCheck…, SubTreePlus, and differences in reading."""

import pytest

from btcore import NodeExecutionError, Status, SyncAction, TreeError, action
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog

R, S, F = Status.RUNNING, Status.SUCCESS, Status.FAILURE


# --- BlackboardCheck


def check(kind: str, a: str, b: str, more: str = "", outcomes: str = "S") -> str:
    tag = f"BlackboardCheck{kind}"
    return f'<{tag} value_A="{a}" value_B="{b}" {more}><Act name="a" outcomes="{outcomes}"/></{tag}>'


@pytest.mark.parametrize(
    ("kind", "a", "b", "equal"),
    [
        ("Int", "7", "7", True),
        ("Int", "7", "8", False),
        ("Int", " 7", "+7", True),
        ("Double", "0.1", "0.10000001", True),
        ("Double", "0.1", "0.101", False),
        ("Double", "1", "1.0", True),
        ("String", "x", "x", True),
        ("String", "7", "7.0", False),
        ("Bool", "true", "1", True),
        ("Bool", "true", "0", False),
    ],
)
def test_the_child_is_ticked_if_both_values_are_equal_as_that_type(
    kind: str, a: str, b: str, equal: bool, make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(check(kind, a, b), format=3)
    assert tree.tick_once() is (S if equal else F)
    assert calls == (["a:start"] if equal else [])


@pytest.mark.parametrize("written", ["SUCCESS", "FAILURE", "RUNNING"])
def test_mismatch_returns_the_configured_status(written: str, make_tree: TreeFactory) -> None:
    tree = make_tree(check("Int", "1", "2", f'return_on_mismatch="{written}"'), format=3)
    assert tree.tick_once() is Status[written]


def test_mismatch_may_return_idle_which_a_sequence_refuses(make_tree: TreeFactory) -> None:
    body = check("Int", "1", "2", 'return_on_mismatch="IDLE"')
    tree = make_tree(f'<SubTree ID="Sub"/></BehaviorTree><BehaviorTree ID="Sub">{body}', format=3)
    assert tree.tick_once() is Status.IDLE
    assert {node.status for node in tree} == {Status.IDLE}
    with pytest.raises(NodeExecutionError, match="child 1 returned IDLE"):
        make_tree(f"<Sequence>{body}</Sequence>", format=3).tick_once()


def test_leaf_of_format_3_must_not_return_idle(make_tree: TreeFactory) -> None:
    @action(ID="Idle")
    def idle() -> Status:
        return Status.IDLE

    with pytest.raises(NodeExecutionError, match=r"must return RUNNING, .* not IDLE"):
        make_tree("<Idle/>", idle, format=3).tick_once()


@pytest.mark.parametrize("kind", ["Int", "Double", "String", "Bool"])
def test_a_missing_value_is_a_mismatch(kind: str, make_tree: TreeFactory) -> None:
    assert make_tree(check(kind, "{x}", "{y}"), format=3).tick_once() is F


def test_value_of_a_wrong_type_is_a_mismatch(make_tree: TreeFactory) -> None:
    assert make_tree(check("Int", "seven", "seven"), format=3).tick_once() is F
    assert make_tree(check("Bool", "yes", "yes"), format=3).tick_once() is F


def test_values_are_checked_while_the_child_runs_and_a_mismatch_halts_it(
    make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(check("Int", "{x}", "1", outcomes="RRR"), format=3)
    tree.blackboard["x"] = 1
    assert [tree.tick_once(), tree.tick_once()] == [R, R]
    tree.blackboard["x"] = 2
    assert tree.tick_once() is F
    assert calls == ["a:start", "a:running", "a:halted"]
    assert {node.status for node in tree} == {Status.IDLE}


# --- SubTreePlus

COUNT = (
    '<BehaviorTree ID="Count"><Sequence><Inc in="{n}" out="{n}"/>'
    '<SetBlackboard value="done" output_key="message"/></Sequence></BehaviorTree>'
)


class Keep(SyncAction):
    """Writes an entry that no port names."""

    def tick(self) -> Status:
        self.blackboard["kept"] = 5
        return S


def test_braces_connect_two_entries(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count" n="{outside}"/>', others=COUNT, format=3)
    tree.blackboard["outside"] = 41
    assert tree.tick_once() is S
    assert tree.blackboard["outside"] == 42
    assert "message" not in tree.blackboard


def test_other_attributes_are_constants_of_the_inner_tree(make_tree: TreeFactory) -> None:
    inner = '<BehaviorTree ID="Check"><Act outcomes="{letter}"/></BehaviorTree>'
    tree = make_tree('<SubTreePlus ID="Check" letter="F"/>', others=inner, format=3)
    assert tree.tick_once() is F
    assert "letter" not in tree.blackboard


def test_constant_is_a_text_even_if_it_looks_like_a_number(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count" n="41"/>', others=COUNT, format=3)
    assert tree.subtrees[1].blackboard["n"] == "41"


def test_inner_tree_is_isolated_without_autoremap(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count"/>', others=COUNT, format=3)
    tree.blackboard["n"] = 41
    assert tree.tick_once() is F
    assert tree.blackboard["n"] == 41


@pytest.mark.parametrize("written", ["true", "1"])
def test_autoremap_shares_entries_by_name(written: str, make_tree: TreeFactory) -> None:
    tree = make_tree(f'<SubTreePlus ID="Count" __autoremap="{written}"/>', others=COUNT, format=3)
    tree.blackboard["n"] = 41
    assert tree.tick_once() is S
    assert tree.blackboard["n"] == 42


def test_autoremap_shares_entries_that_no_port_points_to(make_tree: TreeFactory) -> None:
    inner = (
        '<BehaviorTree ID="Note"><Sequence><Keep/><SetBlackboard value="1" output_key="_bare"/></Sequence>'
        "</BehaviorTree>"
    )
    tree = make_tree('<SubTreePlus ID="Note" __autoremap="true"/>', Keep, others=inner, format=3)
    assert tree.tick_once() is S
    assert (tree.blackboard["_bare"], tree.blackboard["kept"]) == ("1", 5)


def test_constants_that_follow_autoremap_are_written_to_the_outer_tree(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count" a="1" __autoremap="true" b="2"/>', others=COUNT, format=3)
    assert "a" not in tree.blackboard
    assert tree.blackboard["b"] == "2"
    assert tree.subtrees[1].blackboard["a"] == "1"


def test_explicit_remapping_takes_precedence_over_autoremap(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count" __autoremap="true" n="{m}"/>', others=COUNT, format=3)
    tree.blackboard["n"] = 0
    tree.blackboard["m"] = 41
    tree.tick_once()
    assert (tree.blackboard["n"], tree.blackboard["m"]) == (0, 42)


def test_subtree_plus_node_has_the_name_of_its_tree(make_tree: TreeFactory) -> None:
    tree = make_tree('<SubTreePlus ID="Count" name="mine" n="{n}"/>', others=COUNT, format=3)
    assert tree.root.name == "Count"


# --- other differences of format 3


def test_bool_check_takes_every_integer_except_0_as_true(make_tree: TreeFactory) -> None:
    for number, expected in ((3, S), (-1, S), (0, F)):
        tree = make_tree(check("Bool", "true", "{n}"), format=3)
        tree.blackboard["n"] = number
        assert tree.tick_once() is expected


def test_dollar_braces_refer_to_an_entry_too(make_tree: TreeFactory) -> None:
    tree = make_tree('<Act outcomes="${letter}"/>', format=3)
    tree.blackboard["letter"] = "F"
    assert tree.tick_once() is F


def test_copied_entry_replaces_the_value_but_not_the_type(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="{a}" output_key="b"/>', format=3)
    tree.blackboard["a"] = 2.5
    tree.blackboard["b"] = 1
    assert tree.tick_once() is S
    assert tree.blackboard["b"] == 2.5
    entry = tree.blackboard.find("b")
    assert entry is not None
    assert entry.declared.name == "int"


def test_equals_sign_in_braces_copies_the_entry_with_this_name(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="{=}" output_key="b"/>', format=3)
    tree.blackboard["="] = 7
    assert tree.tick_once() is S
    assert tree.blackboard["b"] == 7


def test_while_do_else_requires_exactly_three_children(make_tree: TreeFactory) -> None:
    tree = make_tree("<WhileDoElse><AlwaysSuccess/><AlwaysSuccess/></WhileDoElse>", format=3)
    with pytest.raises(NodeExecutionError, match="two branches, not 2 children"):
        tree.tick_once()


def test_spaces_around_braces_make_the_value_a_text(make_tree: TreeFactory) -> None:
    for text, status in (("{letter}", F), (" {letter}", None), ("{letter} ", None)):
        tree = make_tree(f'<Act outcomes="{text}"/>', format=3)
        tree.blackboard["letter"] = "F"
        if status is None:
            with pytest.raises(NodeExecutionError, match=f"invalid outcomes '{text}'"):
                tree.tick_once()
        else:
            assert tree.tick_once() is status


def test_equals_sign_refers_to_the_entry_named_like_the_port(make_tree: TreeFactory) -> None:
    tree = make_tree('<Fallback><Act outcomes="="/><Inc in="1" out="="/></Fallback>', format=3)
    tree.blackboard["outcomes"] = "F"
    assert tree.tick_once() is S
    assert tree.blackboard["out"] == 2


def test_every_attribute_is_a_port_even_with_an_underscore(make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="_note"):
        make_tree('<AlwaysSuccess _note="1"/>', format=3)
    assert make_tree('<AlwaysSuccess _description="so"/>', format=3).tick_once() is S


def test_some_control_nodes_may_be_empty(make_tree: TreeFactory) -> None:
    assert make_tree("<ReactiveSequence/>", format=3).tick_once() is S
    for tag in ("Sequence", "SequenceStar", "Fallback"):
        with pytest.raises(TreeError, match=tag):
            make_tree(f"<{tag}/>", format=3)


@pytest.mark.parametrize("tag", ["RetryUntilSuccessful", "RetryUntilSuccesful"])
def test_retry_completes_in_a_single_tick(make_tree: TreeFactory, calls: CallLog, tag: str) -> None:
    """BehaviorTree.CPP 3 keeps the first spelling, which it calls a typo."""
    tree = make_tree(f'<{tag} num_attempts="3"><Act name="p" outcomes="F"/></{tag}>', format=3)
    assert tree.tick_exactly_once() is F
    assert calls == ["p:start"] * 3


def test_mismatch_result_missing_on_the_blackboard_is_a_failure(make_tree: TreeFactory) -> None:
    tree = make_tree(check("Int", "1", "2", 'return_on_mismatch="{result}"'), format=3)
    assert tree.tick_once() is F
    tree.blackboard["result"] = S
    assert tree.tick_once() is S
