"""Statistics of a recording: the results of each node, and its time in RUNNING."""

from collections.abc import Callable
from pathlib import Path

from btcore import NodeType, SimClock, Status, Tree
from btcore.logs import BtLog, LoggedTransition, RecordedNode, Recording, read_btlog
from btcore_monitor.logs import read_fbl
from btcore_recorder import RecordedStatistics, TreeObserver, recorded_statistics

SECOND = 10**9
IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = Status


def by_path(recording: Recording) -> dict[str, RecordedStatistics]:
    return {node.path: node for node in recorded_statistics(recording)}


def test_a_run_is_counted_and_timed(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Repeat num_cycles="3"><Sleep name="nap" msec="500"/></Repeat>', clock=SimClock())
    with BtLog(tree, tmp_path / "run.btlog"), TreeObserver(tree) as observer:
        tree.tick_while_running(period=0.1)
    nap = by_path(read_btlog(tmp_path / "run.btlog"))["nap"]
    assert nap.success == observer.get_statistics("nap").success_count == 3
    assert (nap.failure, nap.halted, nap.rate, nap.runs) == (0, 0, 1.0, 3)
    assert (nap.total, nap.mean, nap.longest) == (3 * SECOND // 2, SECOND // 2, SECOND // 2)
    assert not nap.running


def recording_of(changes: list[tuple[float, Status]]) -> Recording:
    """Return a recording of a single node with transitions of (seconds, status)."""
    last, recorded = IDLE, []
    for seconds, status in changes:
        recorded.append(LoggedTransition(round(seconds * SECOND), 1, last, status))
        last = status
    node = RecordedNode(1, "A", "A", NodeType.ACTION, "A::1", ())
    return Recording(Path("run.btlog"), "", 0, {1: node}, recorded)


def test_immediate_results_take_no_time() -> None:
    (node,) = recorded_statistics(
        recording_of([(1, SUCCESS), (1, IDLE), (2, FAILURE), (2, IDLE), (3, SKIPPED)])
    )
    assert (node.success, node.failure, node.skipped, node.results) == (1, 1, 1, 3)
    assert (node.runs, node.total, node.mean, node.rate) == (0, 0, 0.0, 0.5)


def test_a_halt_ends_a_run_without_a_result() -> None:
    (node,) = recorded_statistics(recording_of([(1, RUNNING), (4, IDLE), (5, RUNNING), (6, FAILURE)]))
    assert (node.halted, node.failure, node.runs) == (1, 1, 2)
    assert (node.total, node.longest) == (4 * SECOND, 3 * SECOND)


def test_node_running_at_the_end_is_timed_until_the_end(captures: Path) -> None:
    (node,) = recorded_statistics(recording_of([(1, RUNNING)]))
    assert (node.running, node.runs, node.total, node.rate) == (True, 1, 0, None)
    recorded = by_path(read_fbl(captures / "v3_sample.fbl"))
    assert recorded["root_seq"].running
    assert recorded["root_seq"].total == 456326_000
