"""Explanations of recorded runs: a smallest set of changed inputs changes the outcome, no part of it does."""

import os
from collections.abc import Sequence
from itertools import combinations
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st

from btcore import FAILURE, RUNNING, SUCCESS, SimClock
from btcore_recorder import Answer, Explainer
from btcore_recorder.inputs import RunRecording
from btcore_recorder.tick_trace import TickTrace
from btcore_recorder.what_if import Change, ChangedReplay, RecordedRun, keys_of
from tests.tools.btcore_recorder.test_replay import DOCUMENTS, Run, act, random_tree
from tests.tools.btcore_recorder.test_what_if import ACTIONS

MISSING = (SUCCESS, FAILURE, RUNNING, None)
"""What nodes return for which nothing is recorded; None = the run ends there."""
RUNS = os.environ.get("BTCORE_RUNS")


def outcomes(recording: RunRecording, answer: Answer, uid: int, changes: Sequence[Change]) -> list[object]:
    """Return what the node may do in the tick of *answer*, in the whole run with *changes*."""
    run = RecordedRun(recording)
    position = next(i for i, step in enumerate(recording.steps) if step.tick == answer.chain[0].tick)
    return [_outcome(ChangedReplay(run, changes, missing=each), position, uid) for each in MISSING]


def _outcome(changed: ChangedReplay, position: int, uid: int) -> object:
    while changed.position < position:
        if not changed.step():
            return "ended", changed.status if uid == 1 else None
    trace = TickTrace(changed.tree)
    changed.step()
    trace.close()
    if changed.end == "no result is recorded":
        return changed.end
    visits = trace.visits_of(uid)
    return visits[-1].result if visits else "no tick", trace.halt_of(uid) is not None


@settings(max_examples=int(RUNS) // 4 if RUNS else settings().max_examples // 2)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32))
def test_the_smallest_set_changes_the_outcome(xml: str, actions: list[str], seed: int) -> None:
    source = Random(seed)
    run = Run(random_tree(xml, seed, SimClock()))
    for action in ["tick", *actions]:
        act(run.tree, action, source)
    recording = run.end()
    explainer = Explainer(recording)
    node = source.choice(["", *keys_of(run.tree)])
    answer = explainer.why(node)
    assert 1 <= len(answer.chain) <= 10
    assert str(answer)
    uid = keys_of(run.tree).index(node) + 1 if node else 1
    recorded = outcomes(recording, answer, uid, ())[0]
    if not answer.changes:
        return
    assert any(each != recorded for each in outcomes(recording, answer, uid, answer.changes)), answer
    for size in range(1, len(answer.changes)):
        for part in combinations(answer.changes, size):
            assert all(each == recorded for each in outcomes(recording, answer, uid, part)), answer
