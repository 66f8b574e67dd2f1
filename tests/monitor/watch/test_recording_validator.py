"""The check of recorded transitions: each batch must be consistent with the nodes' statuses."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from btcore_monitor.watch.recording_validator import RecordingValidator, RobotClockEstimate
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
        recorded = []
        for uid, more in steps:
            before = self.statuses[uid].status
            status = (before + more) % 5
            self.statuses[uid] = StatusRecord(status, before if status == IDLE else 0)
            recorded.append(RecordedTransition(len(recorded), uid, status))
        return recorded

    def snapshot(self) -> dict[int, StatusRecord]:
        return dict(self.statuses)


def validator_of(robot: Robot) -> RecordingValidator:
    """A validator that has seen a complete batch, so that no node is uncertain."""
    validator = RecordingValidator(robot.statuses)
    validator.apply(robot.snapshot(), [])
    return validator


@given(WALK, WALK, WALK, WALK)
def test_a_complete_recording_passes_at_any_time_of_the_status_request(
    first: list[tuple[int, int]],
    second: list[tuple[int, int]],
    third: list[tuple[int, int]],
    fourth: list[tuple[int, int]],
) -> None:
    robot = Robot()
    validator = RecordingValidator(START)
    for before, after in ((first, second), (third, fourth)):
        batch = robot.walk(before)
        look = robot.snapshot()
        batch += robot.walk(after)
        checked = validator.apply(look, batch)
        assert checked.is_complete
        assert [step for step, _ in checked.steps] == batch
        assert all(previous != step.status for step, previous in checked.steps)
        # Only a node whose single transition led to IDLE may still have an unknown previous status.
        assert {uid: record.status for uid, record in validator.statuses.items()} == {
            uid: record.status for uid, record in robot.statuses.items()
        }
    assert validator.apply(robot.snapshot(), []).is_complete
    assert validator.statuses == robot.statuses


@given(WALK, WALK, WALK, st.data())
def test_after_a_loss_the_statuses_are_right_or_a_gap_is_reported(
    first: list[tuple[int, int]], second: list[tuple[int, int]], third: list[tuple[int, int]], data: Any
) -> None:
    robot = Robot()
    validator = validator_of(robot)
    batch = robot.walk(first)
    look = robot.snapshot()
    batch += robot.walk(second)
    kept = batch[data.draw(st.integers(0, len(batch))) :]
    reported = False
    for found in (kept, robot.walk(third), []):
        reported = reported or not validator.apply(look, found).is_complete
        look = robot.snapshot()
    now = {uid: record.status for uid, record in validator.statuses.items()}
    assert reported or now == {uid: record.status for uid, record in robot.statuses.items()}


@given(WALK, WALK, WALK, WALK, st.data())
def test_after_a_gap_a_complete_batch_makes_the_statuses_right(
    first: list[tuple[int, int]],
    second: list[tuple[int, int]],
    third: list[tuple[int, int]],
    fourth: list[tuple[int, int]],
    data: Any,
) -> None:
    robot = Robot()
    validator = validator_of(robot)
    batch = robot.walk(first)
    look = robot.snapshot()
    batch += robot.walk(second)
    validator.apply(look, batch[data.draw(st.integers(0, len(batch))) :])
    batch = robot.walk(third)
    look = robot.snapshot()
    batch += robot.walk(fourth)
    validator.apply(look, batch)
    validator.apply(robot.snapshot(), [])
    assert validator.statuses == robot.statuses
    assert validator.apply(robot.snapshot(), robot.walk([(1, 1), (2, 1)])).is_complete


def test_a_missing_beginning_is_reported_as_a_gap() -> None:
    robot = Robot()
    validator = validator_of(robot)
    batch = robot.walk([(1, 1), (1, 1), (2, 1)])
    checked = validator.apply(robot.snapshot(), batch[2:])
    assert not checked.is_complete
    assert not checked.is_overflow
    assert validator.statuses == robot.statuses
    assert validator.apply(robot.snapshot(), []).is_complete


def test_a_transition_to_the_same_status_is_reported_as_a_gap() -> None:
    validator = validator_of(Robot())
    twice = [RecordedTransition(0, 1, RUNNING), RecordedTransition(1, 1, RUNNING)]
    checked = validator.apply({**START, 1: StatusRecord(RUNNING, 0)}, twice)
    assert not checked.is_complete
    assert checked.steps == [(twice[0], IDLE)]


def test_a_full_buffer_is_an_overflow_whose_transitions_are_kept() -> None:
    robot = Robot()
    validator = validator_of(robot)
    dropped = robot.walk([(1, 1), (2, 1), (3, 1)])
    assert dropped
    batch = robot.walk([(1, 1)] * 1000)
    checked = validator.apply(START, batch)
    assert checked.is_overflow
    assert not checked.is_complete
    # From IDLE to SUCCESS: the dropped transition led to RUNNING.
    assert checked.steps == [(step, (step.status - 1) % 5 if at else IDLE) for at, step in enumerate(batch)]
    # The dropped transitions of the nodes 2 and 3 are seen in the next complete batch.
    checked = validator.apply(robot.snapshot(), robot.walk([(3, 1)]))
    assert checked.is_complete
    assert [checked.before[uid].status for uid in (2, 3)] == [RUNNING, RUNNING]
    assert validator.statuses == robot.statuses
    assert validator.apply(robot.snapshot(), robot.walk([(1, 1)] * 999)).is_complete


def test_nodes_that_the_tree_does_not_have_are_not_reported() -> None:
    assert RecordingValidator(START).apply(START, [RecordedTransition(0, 99, RUNNING)]).steps == []


def test_the_robots_clock_is_ours_until_its_time_is_known() -> None:
    clock = RobotClockEstimate()
    then = clock.wall()
    clock.set(then - 3600 * 10**9, then)
    assert 0 <= clock.wall() - (then - 3600 * 10**9) < 60 * 10**9
    clock.begin(clock.wall())
    assert 0 <= clock.stamp(clock.wall()) < 60 * 10**9
