"""The check of recorded transitions: each batch must be consistent with the nodes' statuses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_monitor.watch.recording_validator import (
    MissingTransitionsError,
    RecordingOverflowError,
    RecordingValidator,
    RobotClock,
)
from btcore_monitor.wire.groot2 import RecordedTransition, StatusRecord

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = range(5)
NODES = 4
START = {uid: StatusRecord(IDLE, 0) for uid in range(1, NODES + 1)}
WALK = st.lists(st.tuples(st.integers(1, NODES), st.integers(1, 4)), max_size=60)


class Robot:
    """Nodes that change, by the rule of the STATUS buffer."""

    def __init__(self) -> None:
        self.statuses = dict(START)

    def walk(self, steps: list[tuple[int, int]]) -> list[RecordedTransition]:
        """Each step adds 1 to 4 to a node's status, modulo 5, so that it always changes."""
        made = []
        for uid, more in steps:
            before = self.statuses[uid].status
            status = (before + more) % 5
            self.statuses[uid] = StatusRecord(status, before if status == IDLE else 0)
            made.append(RecordedTransition(len(made), uid, status))
        return made

    def snapshot(self) -> dict[int, StatusRecord]:
        return dict(self.statuses)


@given(WALK, WALK, WALK)
def test_a_complete_recording_passes_at_any_time_of_the_status_request(one, two, three):
    robot, validator = Robot(), RecordingValidator(START)
    batch = robot.walk(one)
    look = robot.snapshot()
    batch += robot.walk(two)
    assert [step for step, _ in validator.apply(look, batch)] == batch
    assert validator.statuses == robot.statuses
    batch = robot.walk(three)
    steps = validator.apply(robot.snapshot(), batch)
    assert validator.statuses == robot.statuses
    assert all(previous != step.status for step, previous in steps)


@given(WALK, WALK, WALK, st.data())
def test_after_a_loss_the_statuses_are_right_or_a_gap_is_reported(one, two, three, data):
    robot, validator = Robot(), RecordingValidator(START)
    batch = robot.walk(one)
    look = robot.snapshot()
    batch += robot.walk(two)
    kept = batch[data.draw(st.integers(0, len(batch))) :]
    told = False
    for found in (kept, robot.walk(three), []):
        try:
            validator.apply(look, found)
        except MissingTransitionsError:
            told = True
        look = robot.snapshot()
    now = {uid: record.status for uid, record in validator.statuses.items()}
    assert told or now == {uid: record.status for uid, record in robot.statuses.items()}


def test_a_missing_beginning_is_reported_as_a_gap():
    robot, validator = Robot(), RecordingValidator(START)
    batch = robot.walk([(1, 1), (1, 1), (2, 1)])
    with pytest.raises(MissingTransitionsError, match="do not lead to its statuses"):
        validator.apply(robot.snapshot(), batch[2:])
    assert validator.statuses == robot.statuses
    assert validator.apply(robot.snapshot(), []) == []


def test_a_transition_to_the_same_status_is_reported_as_a_gap():
    validator = RecordingValidator(START)
    twice = [RecordedTransition(0, 1, RUNNING), RecordedTransition(1, 1, RUNNING)]
    with pytest.raises(MissingTransitionsError, match="node 1 went twice to the same status"):
        validator.apply({**START, 1: StatusRecord(RUNNING, 0)}, twice)


def test_a_full_buffer_is_reported_as_an_overflow_even_if_consistent():
    robot, validator = Robot(), RecordingValidator(START)
    batch = robot.walk([(1, 1)] * 1000)
    with pytest.raises(RecordingOverflowError, match="keeps 1000 transitions"):
        validator.apply(robot.snapshot(), batch)
    assert validator.statuses[1].status == robot.statuses[1].status
    assert len(validator.apply(robot.snapshot(), robot.walk([(1, 1)] * 999))) == 999


def test_nodes_that_the_tree_does_not_have_are_not_reported():
    assert RecordingValidator(START).apply(START, [RecordedTransition(0, 99, RUNNING)]) == []


def test_the_robots_clock_is_ours_until_its_time_is_known():
    clock = RobotClock()
    then = clock.wall()
    clock.set(then - 3600 * 10**9, then)
    assert 0 <= clock.wall() - (then - 3600 * 10**9) < 60 * 10**9
    clock.begin(clock.wall())
    assert 0 <= clock.t(clock.wall()) < 60 * 10**9
