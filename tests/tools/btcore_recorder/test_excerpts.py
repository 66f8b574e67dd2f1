"""Parts of recordings: assertions about them pass or fail as the run did, and shrunk runs still fail."""

import os
from random import Random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from btcore import SimClock
from btcore_recorder import Replay, assert_does_not_fail, assert_runs_as_recorded
from btcore_recorder.excerpts import cut, shrink
from btcore_recorder.failures import Failure, FailureObserver
from btcore_recorder.files import save_recording
from btcore_recorder.inputs import RunRecording
from btcore_recorder.what_if import run_changed
from tests.tools.btcore_recorder.test_replay import DOCUMENTS, Run, act, random_tree
from tests.tools.btcore_recorder.test_what_if import ACTIONS, HELD

RUNS = os.environ.get("BTCORE_RUNS")


@settings(max_examples=int(RUNS) // 4 if RUNS else settings().max_examples // 2)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32), st.data())
def test_saved_test_passes_or_fails_as_the_run_did(
    tmp_path_factory: pytest.TempPathFactory, xml: str, actions: list[str], seed: int, data: st.DataObject
) -> None:
    run = Run(random_tree(xml, seed, SimClock()))
    failures: list[Failure] = []
    for action in actions:
        observer = FailureObserver(run.tree)
        unsubscribe = run.tree.subscribe(observer)
        act(run.tree, action, Random(seed))
        unsubscribe()
        if observer.found is not None:
            failures.append(observer.found)
    recording = run.end()
    times = sorted({(step.time - recording.head.time) / 1e9 for step in recording.steps if step.tick})
    if not times:
        return
    first, last = sorted([data.draw(st.sampled_from(times)), data.draw(st.sampled_from(times))])
    window = cut(recording, first, last)
    assert Replay(window).verify() is None
    file = tmp_path_factory.mktemp("run") / "run.btrec.txt"
    save_recording(file, window)
    assert_runs_as_recorded(file)
    kept = {step.tick for step in window.steps}
    failed = [failure for failure in failures if failure.tick in kept]
    if not failed:
        assert_does_not_fail(file)
        return
    with pytest.raises(AssertionError) as error:
        assert_does_not_fail(file)
    assert str(error.value) == str(failed[0])


def size(recording: RunRecording) -> int:
    return sum(1 + len(step.before) + len(step.inputs) for step in recording.steps)


@settings(max_examples=int(RUNS) // 4 if RUNS else settings().max_examples // 2)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32))
@example(HELD, ["tick", "halt"], 4)  # the halt raises, also without the tick before it
@example(
    HELD.replace("<Hold", "<OwnSequence><Hold").replace("/></Be", "/></OwnSequence></Be"),
    ["tick", "halt"],
    1064,
)
def test_shrunk_run_fails_at_the_same_node(xml: str, actions: list[str], seed: int) -> None:
    run = Run(random_tree(xml, seed, SimClock()))
    observer = FailureObserver(run.tree)
    run.tree.subscribe(observer)
    for action in actions:
        act(run.tree, action, Random(seed))
    failure, recording = observer.found, run.end()
    if failure is None:
        return
    shrunk = shrink(recording)
    assert size(shrunk.recording) <= size(recording)
    assert Replay(shrunk.recording).verify() is None
    # What was recorded of these steps among others is not true of them alone.
    assert {step[-2:] for step in shrunk.recording.steps} == {(None, None)}
    again = run_changed(shrunk.recording)
    assert again.is_same
    assert again.failure == shrunk.failure
    assert (shrunk.failure.node, shrunk.failure.error) == (failure.node, failure.error)
    assert shrink(shrunk.recording).recording == shrunk.recording
