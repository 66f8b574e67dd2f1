"""The first difference between two runs: by node, status, order, and optionally time."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from btcore import Status
from btcore.logs import read_btlog
from btcore_monitor.logs import read_fbl, read_sqlite
from btcore_recorder import Divergence, Step, find_divergence, steps

IDLE, RUNNING, SUCCESS, FAILURE, _ = Status
A = [Step(0, "a", IDLE, RUNNING), Step(5, "b", IDLE, SUCCESS), Step(9, "a", RUNNING, SUCCESS)]

step = st.builds(Step, st.integers(0, 9), st.sampled_from("ab"), st.just(IDLE), st.sampled_from(Status))


def test_one_run_in_two_formats_has_no_divergence(captures: Path) -> None:
    first, second = read_btlog(captures / "v4_sample.btlog"), read_sqlite(captures / "v4_sample.db3")
    assert find_divergence(steps(first), steps(second)) is None
    assert find_divergence(steps(first), steps(second), tolerance=1_000_000) is None
    by_a_microsecond = find_divergence(steps(first), steps(second), tolerance=0)
    assert by_a_microsecond is None or by_a_microsecond.by_time


def test_different_trees_diverge_at_the_first_different_node(captures: Path) -> None:
    first, second = read_btlog(captures / "v4_sample.btlog"), read_fbl(captures / "v3_sample.fbl")
    found = find_divergence(steps(first), steps(second))
    assert found is not None
    assert (found.common, found.first.path, found.second.path) == (1, "Script::2", "SetBlackboard::2")


def test_different_status_or_order_or_a_shorter_run_is_a_divergence() -> None:
    other = [A[0], A[1]._replace(status=FAILURE), A[2]]
    assert find_divergence(A, other) == Divergence(1, A[1], other[1])
    assert find_divergence(A, [A[0], A[2], A[1]]) == Divergence(1, A[1], A[2])
    assert find_divergence(A, A[:2]) == Divergence(2, A[2], None)
    assert find_divergence([], A) == Divergence(0, None, A[0])


def test_times_are_compared_only_with_a_tolerance() -> None:
    late = [*A[:2], A[2]._replace(since=20)]
    assert find_divergence(A, late) is None
    assert find_divergence(A, late, tolerance=11) is None
    assert find_divergence(A, late, tolerance=10) == Divergence(2, A[2], late[2], by_time=True)


def test_transitions_to_idle_can_be_ignored(captures: Path) -> None:
    recording = read_btlog(captures / "v4_sample.btlog")
    kept = steps(recording, idle=False)
    assert 0 < len(kept) < len(recording.transitions)
    assert all(change.status is not IDLE for change in kept)


@given(st.lists(step), st.lists(step), st.lists(step))
def test_common_part_is_longest_beginning(common: list[Step], first: list[Step], second: list[Step]) -> None:
    found = find_divergence(common + first, common + second)
    back = find_divergence(common + second, common + first)
    if found is None:
        assert [change[1:] for change in first] == [change[1:] for change in second]
        assert back is None
    else:
        assert back == Divergence(found.common, found.second, found.first)
        assert found.common >= len(common)
