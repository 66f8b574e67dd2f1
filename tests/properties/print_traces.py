"""Ticks the trees on standard input, and tells what happened: a JSON line in, a JSON line out.

The first line out says which build of the engine it was. Run by test_builds_agree.py.
"""

import json
import sys

import btcore
from btcore import Blackboard, NodeExecutionError, Registry, SimClock, builds
from btcore.testing import Harness, Outcomes, with_mock_leaves
from btcore.testing.tree_generator import SCRIPT_KEYS

NODES = with_mock_leaves(Registry.standard())


def retold(text: str, entries: list[str], ticks: int) -> list[object]:
    clock = SimClock()
    board = Blackboard(clock=clock)
    for key in SCRIPT_KEYS:
        board[key] = 0
    harness = Harness(btcore.loads(text, nodes=NODES, blackboard=board, clock=clock))
    told: list[object] = []
    try:
        Outcomes(*entries).drive(harness.tree, ticks)
    except NodeExecutionError as error:
        told.append(str(error))
    harness.halt()
    for step in harness.trace:
        results = {path: [one.name for one in gave] for path, gave in step.results.items()}
        changes = [str(change) for change in step.changes]
        told.append([str(step), changes, results, step.halted, step.written, list(step.statuses.values())])
    return told


if __name__ == "__main__":
    print(builds.active_build())
    for line in sys.stdin:
        print(json.dumps(retold(*json.loads(line))))
