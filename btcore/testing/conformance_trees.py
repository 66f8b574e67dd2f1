"""Runs one recorded tree case through the public API, and says where it differs."""

from collections.abc import Callable
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import LegacyBlackboard
from btcore.clock import SimClock
from btcore.engine.observers import Observer
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.load import loads
from btcore.registry.registry import Registry
from btcore.status import Status, Transition
from btcore.testing.conformance_values import recorded_blackboard
from btcore.testing.plan_leaves import CallLog, Inc, PlanAction, PlanCondition, PlanSync
from btcore.tree.tree import Tree


def conformance_registry() -> Registry:
    """The standard registry with the leaves of the recorded cases."""
    nodes = Registry.standard()
    nodes.add(PlanAction, PlanCondition, PlanSync, Inc)
    return nodes


class TickRecorder(Observer):
    """Keeps the events since the last step, and how the tree stood when a node raised."""

    def __init__(self, tree: Tree, journal: CallLog) -> None:
        self.tree = tree
        self.journal = journal
        self.names = {node.uid: node.name for node in tree}
        self.events: list[list[str]] = []
        self.at_error: dict[str, Any] | None = None

    def transition(self, change: Transition) -> None:
        """Keep it."""
        self.events.append([self.names[change.uid], change.previous.name, change.status.name])

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Take the picture before the tree is halted."""
        self.at_error = {"exception": str(error), **self.snapshot()}

    def snapshot(self) -> dict[str, Any]:
        """The step as the recorded cases describe one."""
        taken, self.events = self.events, []
        return {
            "bb": recorded_blackboard(self.tree.blackboard),
            "calls": self.journal.take(),
            "events": taken,
            "nodes": {node.name: node.status.name for node in self.tree},
        }


def run_case(case: dict[str, Any], nodes: Registry) -> dict[str, Any]:
    """What this engine does on *case*, in the form of its ``expect``."""
    journal = CallLog()
    board = LegacyBlackboard() if case["format"] == 3 else Blackboard()
    for key, value in case.get("bb", {}).items():
        board.set(key, value)
    try:
        tree = loads(
            case["xml"],
            nodes=nodes,
            resources=[journal],
            tree=case.get("tree"),
            blackboard=board,
            format=case["format"],
            clock=SimClock(),
        )
    except BtcoreError as refused:
        return {"load_error": str(refused)}
    recorder = TickRecorder(tree, journal)
    tree.subscribe(recorder)
    step: Callable[[], Status] = tree.tick_once if case.get("tick") == "once" else tree.tick_exactly_once
    ticks: list[dict[str, Any]] = []
    for _ in range(case["ticks"]):
        try:
            status = step()
        except NodeExecutionError:
            ticks.append(recorder.at_error or {})
            break
        ticks.append({"status": status.name, **recorder.snapshot()})
    return {"ticks": ticks}


def compare_tree_case(case: dict[str, Any], nodes: Registry) -> str | None:
    """The first difference between what was recorded and what happens here, or None."""
    wanted = case["expect"]
    found = run_case(case, nodes)
    if "load_error" in wanted:
        return None if "load_error" in found else "the tree is to be refused, but it loads"
    if "load_error" in found:
        return f"the tree is to load, but it is refused: {found['load_error']}"
    for number, (expected, got) in enumerate(zip(wanted["ticks"], found["ticks"], strict=False), start=1):
        if ("exception" in expected) != ("exception" in got):
            return f"tick {number}: expected {_ending(expected)}, got {_ending(got)}"
        for key in ("status", "calls", "events", "nodes", "bb"):
            if expected.get(key) != got.get(key):
                return f"tick {number}: {key}: expected {expected.get(key)}, got {got.get(key)}"
    if len(wanted["ticks"]) != len(found["ticks"]):
        return f"expected {len(wanted['ticks'])} ticks, got {len(found['ticks'])}"
    return None


def _ending(tick: dict[str, Any]) -> str:
    return f"an exception ({tick['exception']})" if "exception" in tick else str(tick.get("status"))
