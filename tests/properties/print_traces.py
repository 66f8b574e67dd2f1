"""Tick the trees on standard input and print what happened: one JSON line in, one JSON line out.

The first line of the output names the build of the engine. Run by test_builds_agree.py.
"""

import json
import sys

import btcore
from btcore import Blackboard, NodeExecutionError, Registry, SimClock, builds
from btcore.testing import Harness, Outcomes, with_mock_leaves
from btcore.testing.tree_generator import SCRIPT_KEYS

NODES = with_mock_leaves(Registry.standard())


def trace_of_case(text: str, outcomes: str, ticks: int) -> list[object]:
    clock = SimClock()
    board = Blackboard(clock=clock)
    for key in SCRIPT_KEYS:
        board[key] = 0
    harness = Harness(btcore.loads(text, nodes=NODES, blackboard=board, clock=clock))
    reported: list[object] = []
    try:
        Outcomes(outcomes).drive(harness.tree, ticks)
    except NodeExecutionError as error:
        reported.append(str(error))
    harness.halt()
    for step in harness.trace:
        results = {path: [status.name for status in gave] for path, gave in step.results.items()}
        changes = [str(change) for change in step.changes]
        reported.append(
            [str(step), changes, results, step.halted, step.written, list(step.statuses.values())]
        )
    return reported


if __name__ == "__main__":
    print(builds.active_build())
    for line in sys.stdin:
        print(json.dumps(trace_of_case(*json.loads(line))))
