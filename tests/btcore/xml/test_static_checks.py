"""Warnings about the shape of trees: children that are never reached, or halt each other; unused trees."""

from collections.abc import Callable
from textwrap import dedent
from typing import Any

import pytest

from btcore import Registry, StatefulAction, Status

Check = Callable[..., str]


def children(node: str, *of: str) -> str:
    """*node* with a child a line: they stand in lines 4, 5, 6 …"""
    return "\n      ".join((f"<{node}>", *of)) + f"\n    </{node.split()[0]}>"


def tree(ID: str, body: str = "<AlwaysSuccess/>") -> str:
    return f'  <BehaviorTree ID="{ID}">\n    {body}\n  </BehaviorTree>\n'


def said(text: str) -> str:
    return dedent(text).lstrip("\n")


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
        (children("Sequence", '<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>', "<Drive/>"), 5, "Drive",
         "<Repeat> before it (line 4) never ends"),
        (children("Fallback", '<RetryUntilSuccessful num_attempts="-1"><WasEntryUpdated entry="x"/>'
                  "</RetryUntilSuccessful>", "<Drive/>"), 5, "Drive",
         "<RetryUntilSuccessful> before it (line 4) never fails"),
        (children("ReactiveSequence", "<AlwaysFailure/>", "<Drive/>"), 5, "Drive",
         "<AlwaysFailure> before it (line 4) never succeeds"),
        (children("IfThenElse", "<AlwaysSuccess/>", "<Drive/>", "<Grasp/>"), 6, "Grasp",
         "the condition <AlwaysSuccess> never fails"),
        (children("WhileDoElse", "<AlwaysFailure/>", "<Drive/>", "<Grasp/>"), 5, "Drive",
         "the condition <AlwaysFailure> never succeeds"),
        (children("TryCatch", "<AlwaysSuccess/>", "<Drive/>"), 5, "Drive",
         "what it is to catch never fails"),
    ],
)  # fmt: skip
def test_a_child_that_no_tick_gets_to(check: Check, body: str, line: int, tag: str, why: str) -> None:
    assert check(body, given=["x"]) == said(
        f"""
        t.xml:{line}:7: W105 this <{tag}> is never ticked: {why}
           {line} |        <{tag}/>
             |        {"^" * len(f"<{tag}")}
              remove it, or what keeps the ticks from it
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
        children("Sequence", '<Repeat num_cycles="-1"><BatteryOk _skipIf="false"/></Repeat>', "<Drive/>"),
        children("Fallback", "<RunOnce><AlwaysSuccess/></RunOnce>", "<Drive/>"),
        children("Fallback", '<Precondition if="true"><AlwaysSuccess/></Precondition>', "<Drive/>"),
        children("Parallel", "<AlwaysFailure/>", "<Drive/>"),
        children("IfThenElse", "<BatteryOk/>", "<Drive/>", "<Grasp/>"),
        children("TryCatch", "<BatteryOk/>", "<Drive/>"),
        children('TryCatch catch_on_halt="true"', "<AlwaysSuccess/>", "<Drive/>"),
        children("Fallback", '<Timeout msec="5"><Sleep msec="9"/></Timeout>', "<Drive/>"),
    ],
)  # fmt: skip
def test_a_child_that_may_be_reached(check: Check, body: str) -> None:
    assert check(body) == ""


def test_what_a_subtree_may_result_in_counts(check: Check) -> None:
    body = children("Sequence", '<SubTree ID="Doomed"/>', "<Drive/>")
    assert check(body, tree("Doomed", "<AlwaysFailure/>")).startswith(
        't.xml:5:7: W105 this <Drive> is never ticked: <SubTree ID="Doomed"> before it (line 4) never succ'
    )
    assert check(body, tree("Doomed", "<BatteryOk/>")) == ""


def test_nothing_is_certain_of_a_node_that_was_replaced(check: Check, palette: Registry) -> None:
    class AlwaysFailure(StatefulAction):
        def on_start(self) -> Status:
            return Status.SUCCESS

    palette.replace(AlwaysFailure=AlwaysFailure)
    assert check(children("Sequence", "<AlwaysFailure/>", "<Drive/>")) == ""


# --- W106: asynchronous children of reactive nodes


def test_a_reactive_node_with_two_asynchronous_children(check: Check) -> None:
    assert check(children("ReactiveSequence", "<BatteryOk/>", "<Drive/>", "<Grasp/>")) == said(
        """
        t.xml:6:7: W106 <ReactiveSequence> has a second asynchronous child here: each tick begins with <Drive> (line 5), which halts this <Grasp> unless it ends at once
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
def test_what_takes_its_time_is_asynchronous(
    check: Check, node: str, first: str, second: str, line_of_second: int
) -> None:
    found = check(children(node, first, second), tree("Inner", "<Grasp/>") if "Inner" in second else "")
    assert found.startswith(f"t.xml:{line_of_second}:7: W106 <{node}> has a second asynchronous child here")


@pytest.mark.parametrize(
    "body",
    [
        children("ReactiveSequence", "<BatteryOk/>", "<Drive/>"),
        children("ReactiveSequence", "<Drive/>", "<BatteryOk/>"),
        # A priority list: while the battery holds, the first child fails at once.
        children("ReactiveFallback", "<Sequence><BatteryOk/><Drive/></Sequence>", "<Grasp/>"),
        # Once it was charged, the first child succeeds at once.
        children("ReactiveSequence", "<Fallback><BatteryOk/><Drive/></Fallback>", "<Grasp/>"),
        children("ReactiveSequence", '<Drive _successIf="true"/>', "<Grasp/>"),
        children("ReactiveSequence", "<RunOnce><Drive/></RunOnce>", "<Grasp/>"),
        children("ReactiveSequence", '<Sleep msec="0"/>', "<Grasp/>"),
        children("Sequence", "<Drive/>", "<Grasp/>"),
    ],
)
def test_reactive_nodes_that_are_fine(check: Check, body: str) -> None:
    assert check(body) == ""


def test_an_asynchronous_leaf_may_say_that_it_ends_at_once(check: Check, palette: Registry) -> None:
    class WaitForScan(StatefulAction):
        may_end_at_once = True

        def on_start(self) -> Status:
            return Status.SUCCESS

    palette.add(WaitForScan)
    assert check(children("ReactiveSequence", "<WaitForScan/>", "<Drive/>")) == ""
    assert "W106" in check(children("ReactiveSequence", "<WaitForScan/>", "<Drive/>", "<Grasp/>"))


# --- W104: unused trees


def test_a_tree_that_is_never_used(check: Check) -> None:
    assert check("<AlwaysSuccess/>", tree("Left")) == said(
        """
        t.xml:5:21: W104 the tree 'Left' is never used: 'Main' doesn't lead to it
           5 |    <BehaviorTree ID="Left">
             |                      ^^^^
              call it by <SubTree ID="Left"/>, or remove it
        """
    )


def test_of_unused_trees_that_call_each_other_the_first_is_named(check: Check) -> None:
    found = check("<AlwaysSuccess/>", tree("Left", '<SubTree ID="Right"/>') + tree("Right"))
    assert [line for line in found.splitlines() if "W104" in line] == [
        "t.xml:5:21: W104 the tree 'Left' is never used: 'Main' doesn't lead to it"
    ]


def test_trees_that_are_called_are_used(check: Check) -> None:
    assert check('<SubTree ID="Left"/>', tree("Left", '<SubTree ID="Right"/>') + tree("Right")) == ""


def test_a_library_of_trees_is_fine(check: Any) -> None:
    assert check.found_in(f'<root BTCPP_format="4">\n{tree("A")}{tree("B")}</root>') == []
