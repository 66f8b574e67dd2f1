"""The batch engine behaves as the C++ engine, with one agent and with several, for the nodes it supports.

Results, calls of leaves, stored statuses, the blackboard and exceptions are compared tick by tick; the
batch engine does not report single transitions.
"""

import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from btcore import In, Registry, SimClock, Status, TreeError
from btcore.registry.outcome_grammar import LETTERS
from tests.conformance.recorded_cases import CallLog, read_cases, recorded_value

np = pytest.importorskip("numpy")
import btcore_batch as batch  # noqa: E402
from btcore_batch import (  # noqa: E402
    BatchNodeError,
    BatchTree,
    Mask,
    Texts,
)

DATA = Path(__file__).parent / "data"

Case = dict[str, Any]


class CallLogs(list[CallLog]):
    """The calls of each agent's leaves."""


class Planned(batch.StatefulAction):
    """Common base of the mock leaves."""

    def __init__(self, calls: CallLogs) -> None:
        self.calls = calls
        self.starts = [0] * self.agents
        self.segments = [""] * self.agents
        self.letters = [0] * self.agents

    def note(self, mask: Mask, what: str) -> None:
        for at in np.flatnonzero(mask):
            self.calls[at].record(self.name, what)


class PlanAction(Planned):
    plan: In[Texts]

    def on_start(self, mask: Mask) -> object:
        plans = self.plan
        for at in np.flatnonzero(mask):
            segments = plans[at].split("|")
            self.segments[at] = segments[self.starts[at] % len(segments)]
            self.starts[at] += 1
            self.letters[at] = 0
        return self._next(mask, "start")

    def on_running(self, mask: Mask) -> object:
        return self._next(mask, "running")

    def on_halted(self, mask: Mask) -> None:
        self.note(mask, "halted")

    def _next(self, mask: Mask, what: str) -> object:
        self.note(mask, what)
        found = np.zeros(self.agents, dtype=np.uint8)
        for at in np.flatnonzero(mask):
            segment = self.segments[at]
            index = min(self.letters[at], len(segment) - 1)
            self.letters[at] += 1
            found[at] = LETTERS.get(segment[index], 0) if index >= 0 else 0
        return found


class TickedPlan:
    """The letters of a plan, one letter per tick, for each agent and node."""

    def __init__(self) -> None:
        self.counts: dict[tuple[str, int], int] = {}

    def next(self, name: str, plans: Any, mask: Mask) -> object:
        found = np.zeros(len(mask), dtype=np.uint8)
        for at in np.flatnonzero(mask):
            count = self.counts.get((name, at), 0)
            self.counts[name, at] = count + 1
            plan = plans[at]
            found[at] = LETTERS.get(plan[count % len(plan)], 0) if plan else 0
        return found


@batch.condition(ID="PlanCondition")
def plan_condition(
    plan: In[Texts], mask: Mask, ticks: TickedPlan, calls: CallLogs, name: batch.NodeName
) -> object:
    for at in np.flatnonzero(mask):
        calls[at].record(name, "tick")
    return ticks.next(name, plan, mask)


@batch.action(ID="PlanSync")
def plan_sync(
    plan: In[Texts], mask: Mask, ticks: TickedPlan, calls: CallLogs, name: batch.NodeName
) -> object:
    return plan_condition(plan, mask, ticks, calls, name)


NODES = Registry.standard()
LEAVES = (PlanAction, plan_condition, plan_sync)


@cache
def recorded(name: str) -> list[Case]:
    return list(read_cases(DATA / f"{name}.jsonl.gz"))


def tick_results(tree: BatchTree, calls: CallLogs, statuses: Any) -> list[dict[str, Any]]:
    """Return what a recorded case contains of a tick, for each agent."""
    stored = {node.name: node.status for node in tree}
    found = []
    for at in range(tree.agents):
        board = {}
        for key in sorted(tree.blackboard.scope.local_entries()):
            column = tree.columns.column(tree.blackboard.scope, key)
            own = tree.blackboard.scope.local_entries()[key]
            if tree.columns.column_of(own, key).exists >> at & 1:
                board[key] = None if column is None else recorded_value(column.objects(1 << at)[at])
        found.append(
            {
                "status": Status(statuses[at]).name,
                "bb": board,
                "calls": calls[at].take(),
                "nodes": {name: Status(some[at]).name for name, some in stored.items()},
            }
        )
    return found


def difference(case: Case, agents: int) -> str | None:
    """Return the first difference from the recording, or None. Raises TreeError for unsupported nodes."""
    calls = CallLogs(CallLog() for _ in range(agents))
    tree = BatchTree.loads(
        case["xml"],
        agents,
        LEAVES,
        nodes=NODES,
        resources=[calls, TickedPlan()],
        tree=case.get("tree"),
        blackboard=case.get("bb", {}),
        clock=SimClock(),
    )
    step = tree.tick_once if case.get("tick") == "once" else tree.tick
    for number, expected in enumerate(case["expect"]["ticks"], start=1):
        try:
            statuses = step()
        except BatchNodeError:
            return None if "exception" in expected else f"tick {number} raises"
        if "exception" in expected:
            return f"tick {number} does not raise"
        for at, got in enumerate(tick_results(tree, calls, statuses)):
            for key, value in got.items():
                if expected[key] != value:
                    return f"tick {number}, agent {at}: {key}: expected {expected[key]}, got {value}"
    return None


# Of the larger files every fourth case: tests/properties/test_batch_engine.py compares further random trees.
@pytest.mark.parametrize(
    ("name", "step", "run"),
    [
        ("v4_control", 4, 200),
        ("v4_full", 4, 186),
        ("v4_once", 1, 249),
        ("v4_scopes", 1, 243),
        ("v4_mutated", 1, 249),
    ],
)
def test_batch_matches_the_recorded_trees(name: str, step: int, run: int) -> None:
    differences = {}
    compared = 0
    for number, case in enumerate(recorded(name)[::step]):
        if "ticks" not in case["expect"] or "<Inc " in case["xml"]:
            continue
        named = re.findall(r' name="([^"]*)"', case["xml"])
        if len(named) > len(set(named)):
            continue  # the plan of a condition is counted by its name
        try:
            found = difference(case, agents=3 if number % 4 == 0 else 1)
        except TreeError:
            continue  # a node that a batch does not support
        compared += 1
        if found:
            differences[case["id"]] = found
    assert differences == {}
    assert compared == run
