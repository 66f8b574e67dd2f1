"""Recorded runs with another tree or other inputs."""

import os
from collections import deque
from random import Random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import btcore
from btcore import FAILURE, IDLE, RUNNING, SUCCESS, BtcoreError, Put, Registry, SimClock, Status, TreeError
from btcore_recorder.inputs import RunRecording
from btcore_recorder.what_if import SetEntry, SetResult, run_changed
from tests.tools.btcore_recorder.test_replay import DOCUMENTS, Run, act, random_tree

RUNS = os.environ.get("BTCORE_RUNS")
ACTIONS = st.lists(st.sampled_from(["tick"] * 6 + ["tick once", "halt", "write"]), min_size=1, max_size=10)
HELD = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Hold out="{out}"/></BehaviorTree></root>'
PATROL = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Measure name="scan" distance="{d}"/>
    <Fallback><ScriptCondition name="near" code="d &lt; 1.0"/><Drive name="drive"/></Fallback>
    <Script code="rounds += 1"/>
</Sequence></BehaviorTree></root>
"""


@settings(max_examples=int(RUNS) // 2 if RUNS else settings().max_examples // 2)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32))
@example(HELD, ["tick", "halt"], 4)  # the halt raises
def test_without_a_change_the_run_is_the_same(xml: str, actions: list[str], seed: int) -> None:
    run = Run(random_tree(xml, seed, SimClock()))
    for action in actions:
        act(run.tree, action, Random(seed))
    recording = run.end()
    again = run_changed(recording)
    assert (again.differs_from, again.assumed_from, again.end) == (None, None, None), again
    assert again.status is next((step.status for step in recording.steps[::-1] if step.tick), IDLE)


@btcore.action
def measure(distance: Put[float], distances: deque) -> bool:  # type: ignore[type-arg]
    """Write the next distance."""
    distance(distances.popleft())
    return True


@btcore.action
async def drive() -> bool:
    """Take two ticks."""
    await btcore.running()
    return True


@pytest.fixture
def recording() -> RunRecording:
    """Distances of 0.5, 3 and 0.8 m: near, driven in ticks 2 and 3, near."""
    return record_patrol([0.5, 3.0, 0.8], [SUCCESS, RUNNING, SUCCESS, SUCCESS])


def record_patrol(distances: list[float], expected: list[Status]) -> RunRecording:
    nodes = Registry.standard()
    nodes.add(measure, drive)
    board = btcore.Blackboard()
    board["rounds"] = 0
    resources = [deque(distances)]
    tree = btcore.loads(PATROL, nodes=nodes, resources=resources, clock=SimClock(), blackboard=board)
    run = Run(tree)
    assert [tree.tick_exactly_once() for _ in expected] == expected
    return run.end()


def test_another_tree_decides_differently(recording: RunRecording) -> None:
    edited = "patrol.xml", PATROL.replace("1.0", "0.6")
    changed = run_changed(recording, document=edited)
    assert changed.differs_from == 4
    assert (changed.recorded, changed.now) == ("'near' becomes SUCCESS", "'near' becomes FAILURE")
    assert (changed.end, changed.ended_at) == ("no result is recorded", "drive")
    assert changed.assumed_from is None


def test_a_leaf_without_a_recorded_result_has_outcomes(recording: RunRecording) -> None:
    edited = "patrol.xml", PATROL.replace("1.0", "0.6")
    changed = run_changed(recording, document=edited, outcomes={"drive": "RRS"})
    assert (changed.end, changed.status, changed.assumed_from) == (None, RUNNING, 4)
    failing = run_changed(recording, document=edited, outcomes={"drive": "F"})
    assert failing.status is FAILURE
    with pytest.raises(BtcoreError, match=r"no node 'drove' in the tree, .*did you mean 'drive'"):
        run_changed(recording, outcomes={"drove": "S"})


def test_outcomes_go_on_after_recorded_results() -> None:
    recording = record_patrol([0.5, 3.0, 0.8, 0.8], [SUCCESS, RUNNING, SUCCESS, SUCCESS, SUCCESS])
    edited = "patrol.xml", PATROL.replace("1.0", "0.6")
    changed = run_changed(recording, document=edited, outcomes={"drive": "RS"})
    assert (changed.end, changed.status, changed.ticks, changed.differs_from) == (None, SUCCESS, 5, 4)


def test_a_result_in_another_tick_is_assumed(recording: RunRecording) -> None:
    changed = run_changed(recording, document=("patrol.xml", PATROL.replace("1.0", "0.4")))
    assert (changed.differs_from, changed.assumed_from) == (1, 1)


def test_one_input_is_changed(recording: RunRecording) -> None:
    changed = run_changed(recording, [SetResult(1, "scan", FAILURE)])
    assert (changed.differs_from, changed.now, changed.end) == (1, "'scan' becomes FAILURE", None)
    assert changed.assumed_from is None
    changed = run_changed(recording, [SetResult(3, "drive", FAILURE)])
    assert (changed.differs_from, changed.recorded, changed.now) == (
        3,
        "'drive' becomes SUCCESS",
        "'drive' becomes FAILURE",
    )
    assert run_changed(recording, [SetEntry(3, "rounds", 10)]).differs_from is None


def test_a_renamed_node_is_matched(recording: RunRecording) -> None:
    edited = "patrol.xml", PATROL.replace('"scan"', '"laser"')
    assert run_changed(recording, document=edited).end == "no result is recorded"
    changed = run_changed(recording, document=edited, matches={"scan": "laser"})
    assert changed.end is None
    assert changed.assumed_from is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"changes": [SetResult(1, "scam", FAILURE)]}, "no node 'scam' in the tree, .*did you mean 'scan'"),
        ({"matches": {"scam": "x"}}, "no node 'scam' in the recorded tree; did you mean 'scan'"),
        ({"matches": {"scan": "x"}}, "no node 'x' in the tree"),
        ({"document": ("p.xml", PATROL.replace("<Drive", "<Dive"))}, "unknown node <Dive>"),
    ],
)
def test_mistakes_are_explained(recording: RunRecording, arguments: dict[str, object], message: str) -> None:
    with pytest.raises((BtcoreError, TreeError), match=message):
        run_changed(recording, **arguments)  # type: ignore[arg-type]
