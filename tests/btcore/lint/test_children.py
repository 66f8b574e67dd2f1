"""Warnings about children: never reached, too many or too few, or halted by each other."""

from collections.abc import Callable

import pytest

import btcore
from btcore import NodeSpec, Registry, StatefulAction, Status, SyncAction
from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import children, dedented, tree

# --- W105: never reached


@pytest.mark.parametrize(
    ("body", "line", "tag", "why"),
    [
        (children("Sequence", "<AlwaysFailure/>", "<Drive/>", "<Grasp/>"), 5, "Drive",
         "<AlwaysFailure> before it (line 4) never succeeds"),
        (children("Fallback", "<BatteryOk/>", "<AlwaysSuccess/>", "<Grasp/>"), 6, "Grasp",
         "<AlwaysSuccess> before it (line 5) never fails"),
        (children("Fallback", "<Inverter><AlwaysFailure/></Inverter>", "<Drive/>"), 5, "Drive",
         "<Inverter> before it (line 4) never fails"),
        (children("Fallback", "<ForceSuccess><ScriptCondition code='true'/></ForceSuccess>", "<Grasp/>"), 5,
         "Grasp", "<ForceSuccess> before it (line 4) never fails"),
        (children("Sequence", "<KeepRunningUntilFailure><Drive/></KeepRunningUntilFailure>", "<Grasp/>"), 5,
         "Grasp", "<KeepRunningUntilFailure> before it (line 4) never succeeds"),
        (children("Sequence", '<Repeat num_cycles="-1"><Delay delay_msec="1"><AlwaysSuccess/></Delay>'
                  "</Repeat>", "<Drive/>"), 5, "Drive",
         "<Repeat> before it (line 4) never ends"),
        (children("Fallback", '<RetryUntilSuccessful num_attempts="-1"><Delay delay_msec="1">'
                  '<WasEntryUpdated entry="x"/></Delay></RetryUntilSuccessful>', "<Drive/>"), 5, "Drive",
         "<RetryUntilSuccessful> before it (line 4) never fails"),
        (children("ReactiveSequence", "<AlwaysFailure/>", "<Drive/>"), 5, "Drive",
         "<AlwaysFailure> before it (line 4) never succeeds"),
        (children("IfThenElse", "<AlwaysSuccess/>", "<Drive/>", "<Grasp/>"), 6, "Grasp",
         "the condition <AlwaysSuccess> never fails"),
        (children("WhileDoElse", "<AlwaysFailure/>", "<Drive/>", "<Grasp/>"), 5, "Drive",
         "the condition <AlwaysFailure> never succeeds"),
        (children("TryCatch", "<AlwaysSuccess/>", "<Drive/>"), 5, "Drive",
         "the children before it never fail"),
    ],
)  # fmt: skip
def test_unreachable_child_is_reported(check: Checker, body: str, line: int, tag: str, why: str) -> None:
    assert check(body, given=["x"]) == dedented(
        f"""
        t.xml:{line}:7: W105 <{tag}> is never ticked: {why}
           {line} |        <{tag}/>
             |        {"^" * len(f"<{tag}")}
              remove it, or the cause
        """
    )


@pytest.mark.parametrize(
    "body",
    [
        children("Sequence", "<BatteryOk/>", "<Drive/>"),
        children("Sequence", '<AlwaysFailure _skipIf="1 == 2"/>', "<Drive/>"),
        children("Sequence", '<AlwaysFailure _successIf="1 == 2"/>', "<Drive/>"),
        children("Fallback", '<AlwaysSuccess _while="true"/>', "<Drive/>"),
        children("Sequence", '<Repeat num_cycles="3"><BatteryOk/></Repeat>', "<Drive/>"),
        children("Sequence", '<Repeat num_cycles="-1"><Delay delay_msec="9"><BatteryOk/></Delay></Repeat>',
                 "<Drive/>"),
        children("Fallback", "<RunOnce><AlwaysSuccess/></RunOnce>", "<Drive/>"),
        children("Fallback", '<Precondition if="true"><AlwaysSuccess/></Precondition>', "<Drive/>"),
        children("Parallel", "<AlwaysFailure/>", "<Drive/>"),
        children("IfThenElse", "<BatteryOk/>", "<Drive/>", "<Grasp/>"),
        children("TryCatch", "<BatteryOk/>", "<Drive/>"),
        children('TryCatch catch_on_halt="true"', "<AlwaysSuccess/>", "<Drive/>"),
        children("Fallback", '<Timeout msec="5"><Sleep msec="9"/></Timeout>', "<Drive/>"),
    ],
)  # fmt: skip
def test_reachable_child_is_not_reported(check: Checker, body: str) -> None:
    assert check(body) == ""


def test_possible_results_of_a_subtree_are_considered(check: Checker) -> None:
    body = children("Sequence", '<SubTree ID="Doomed"/>', "<Drive/>")
    assert check(body, tree("Doomed", "<AlwaysFailure/>")).startswith(
        't.xml:5:7: W105 <Drive> is never ticked: <SubTree ID="Doomed"> before it (line 4) never succ'
    )
    assert check(body, tree("Doomed", "<BatteryOk/>")) == ""


def test_replaced_built_in_node_has_unknown_results(check: Checker, palette: Registry) -> None:
    class AlwaysFailure(SyncAction):
        def tick(self) -> Status:
            return Status.SUCCESS

    palette.replace(AlwaysFailure=AlwaysFailure)
    assert check(children("Sequence", "<AlwaysFailure/>", "<Drive/>")) == ""


# --- E119: numbers of children that fail at the first tick


@pytest.mark.parametrize(
    ("body", "has"),
    [
        (children("IfThenElse", *["<BatteryOk/>"] * 4),
         "<IfThenElse> has 4 children; it needs 2 or 3: a condition, and one or two branches"),
        (children("WhileDoElse", "<BatteryOk/>"),
         "<WhileDoElse> has 1 child; it needs 2 or 3: a condition, and one or two branches"),
        (children("Switch2", "<BatteryOk/>", "<BatteryOk/>").replace("<Switch2>", '<Switch2 variable="1">'),
         "<Switch2> has 2 children; it needs 3: one for each case, and a default"),
        (children("ParallelAll", "<BatteryOk/>").replace("<ParallelAll>", '<ParallelAll max_failures="2">'),
         "<ParallelAll> has 1 child, too few for 2 failures"),
        (children("Parallel", "<BatteryOk/>").replace("<Parallel>", '<Parallel success_count="3">'),
         "<Parallel> has 1 child, too few for 3 successes"),
    ],
)  # fmt: skip
def test_wrong_number_of_children_is_an_error_but_the_tree_can_be_loaded(
    check: Checker, palette: Registry, document: Callable[..., str], body: str, has: str
) -> None:
    reported = [one for one in check.found(body) if one.is_error]
    assert [(one.code, one.line, one.message) for one in reported] == [("E119", 3, has)]
    tree = btcore.loads(document(body), nodes=palette)
    with pytest.raises(btcore.NodeExecutionError):
        tree.tick_once()


@pytest.mark.parametrize("body", ["<Inverter/>", "<Sequence/>", children("TryCatch", "<Drive/>")])
def test_a_number_of_children_that_cannot_be_loaded_is_reported_once(check: Checker, body: str) -> None:
    assert [one.code for one in check.found(body) if one.is_error] == ["E104"]


def test_in_format_3_a_decorator_in_the_tag_of_a_leaf_loads_without_a_child(
    check: Checker, palette: Registry, document: Callable[..., str]
) -> None:
    body = '<Action ID="Inverter"/>'
    reported = [(one.code, one.message) for one in check.found(body, format=3) if one.is_error]
    assert reported == [("E119", "<Inverter> has no child; a decorator has exactly 1")]
    tree = btcore.loads(document(body), nodes=palette, format=3)
    assert next(iter(tree)).children == []
    with pytest.raises(btcore.NodeExecutionError, match="<Inverter> has no child to tick"):
        tree.tick_once()
    assert [one.code for one in check.found(body) if one.is_error] == ["E104"]


def test_children_of_a_subtree_plus_are_checked_but_ignored(
    check: Checker, palette: Registry, document: Callable[..., str]
) -> None:
    others = '<BehaviorTree ID="Inner"><AlwaysSuccess/></BehaviorTree>'
    body = '<SubTreePlus ID="Inner">{}</SubTreePlus>'
    (reported,) = check.found(body.format("<AlwaysFailure/>"), others, format=3)
    assert (reported.code, reported.message) == (
        "W105",
        'the children of <SubTreePlus ID="Inner"> are ignored',
    )
    tree = btcore.loads(document(body.format("<AlwaysFailure/>"), others), nodes=palette, format=3)
    assert tree.tick_once() is Status.SUCCESS
    assert [node.id for node in tree] == ["SubTreePlus", "AlwaysSuccess"]
    assert "E101" in [one.code for one in check.found(body.format("<Unknown/>"), others, format=3)]


def test_in_format_3_while_do_else_needs_both_branches_and_reactive_may_be_empty(check: Checker) -> None:
    while_do = children("WhileDoElse", "<BatteryOk/>", "<Drive/>")
    assert [one.message for one in check.found(while_do, format=3)] == [
        "<WhileDoElse> has 2 children; it needs 3: a condition, and two branches"
    ]
    assert [one.message for one in check.found("<IfThenElse/>", format=3)] == [
        "<IfThenElse> has no child; it needs 2 or 3: a condition, and one or two branches"
    ]
    assert check.found("<ReactiveSequence/>", format=3) == []


@pytest.mark.parametrize(
    "body",
    [
        children("IfThenElse", "<BatteryOk/>", "<Drive/>"),
        children("WhileDoElse", "<BatteryOk/>", "<Drive/>", "<Grasp/>"),
        '<Switch2 variable="1" case_1="1" case_2="2"><BatteryOk/><Drive/><Grasp/></Switch2>',
        '<Parallel success_count="-1" failure_count="2"><BatteryOk/><Drive/></Parallel>',
        '<Sequence><Script code="n := 9"/><Parallel success_count="{n}"><Drive/></Parallel></Sequence>',
    ],
)
def test_correct_number_of_children_is_not_reported(check: Checker, body: str) -> None:
    assert check(body) == ""


# --- W106: asynchronous children of reactive nodes


def test_second_asynchronous_child_of_a_reactive_node_is_reported(check: Checker) -> None:
    assert check(children("ReactiveSequence", "<BatteryOk/>", "<Drive/>", "<Grasp/>")) == dedented(
        """
        t.xml:6:7: W106 <Grasp> is a second asynchronous child of <ReactiveSequence>: each tick begins with <Drive> (line 5), which halts <Grasp> unless it completes at once
           6 |        <Grasp/>
             |        ^^^^^^
              put both into a <Sequence>
        """  # noqa: E501 - a message is one line
    )


@pytest.mark.parametrize(
    ("node", "first", "second", "line_of_second"),
    [
        ("ReactiveFallback", "<Drive/>", "<Grasp/>", 5),
        ("ReactiveSequence", '<Sleep msec="10"/>', "<Drive/>", 5),
        ("ReactiveSequence", '<Delay delay_msec="5"><BatteryOk/></Delay>', "<Drive/>", 5),
        ("ReactiveSequence", "<Sequence><BatteryOk/><Drive/></Sequence>", "<Grasp/>", 5),
        ("ReactiveSequence", '<Repeat num_cycles="2"><AlwaysSuccess/></Repeat>', "<Grasp/>", 5),
        (
            "ReactiveSequence",
            "<AsyncSequence><AlwaysSuccess/><AlwaysSuccess/></AsyncSequence>",
            "<Grasp/>",
            5,
        ),
        ("ReactiveSequence", "<Drive/>", '<SubTree ID="Inner"/>', 5),
    ],
)
def test_nodes_that_may_run_are_asynchronous(
    check: Checker, node: str, first: str, second: str, line_of_second: int
) -> None:
    found = check(children(node, first, second), tree("Inner", "<Grasp/>") if "Inner" in second else "")
    label = second.replace("/>", ">")
    start = f"t.xml:{line_of_second}:7: W106 {label} is a second asynchronous child of <{node}>"
    assert found.startswith(start)


@pytest.mark.parametrize(
    "body",
    [
        children("ReactiveSequence", "<BatteryOk/>", "<Drive/>"),
        children("ReactiveSequence", "<Drive/>", "<BatteryOk/>"),
        # A priority list: the first child may fail immediately, before <Drive> starts.
        children("ReactiveFallback", "<Sequence><BatteryOk/><Drive/></Sequence>", "<Grasp/>"),
        # The first child may succeed immediately, without <Drive>.
        children("ReactiveSequence", "<Fallback><BatteryOk/><Drive/></Fallback>", "<Grasp/>"),
        children("ReactiveSequence", '<Drive _successIf="true"/>', "<Grasp/>"),
        children("ReactiveSequence", "<RunOnce><Drive/></RunOnce>", "<Grasp/>"),
        children("ReactiveSequence", '<Sleep msec="0"/>', "<Grasp/>"),
        children("Sequence", "<Drive/>", "<Grasp/>"),
    ],
)
def test_valid_reactive_nodes_are_not_reported(check: Checker, body: str) -> None:
    assert check(body) == ""


def test_asynchronous_leaf_may_declare_that_it_may_end_on_start(check: Checker, palette: Registry) -> None:
    class WaitForScan(StatefulAction):
        spec = NodeSpec(may_complete_on_start=True)

        def on_start(self) -> Status:
            return self.on_running()

        def on_running(self) -> Status:
            return Status.SUCCESS

    palette.add(WaitForScan)
    assert check(children("ReactiveSequence", "<WaitForScan/>", "<Drive/>")) == ""
    assert "W106" in check(children("ReactiveSequence", "<WaitForScan/>", "<Drive/>", "<Grasp/>"))
