"""Statistics of a running tree, counted as by BehaviorTree.CPP's TreeObserver."""

from collections.abc import Callable

import pytest

from btcore import BtcoreError, Registry, SimClock, Status, SyncAction, Tree
from btcore_recorder import NodeStatistics, TreeObserver

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = Status


class SaysSkipped(SyncAction):
    def tick(self) -> Status:
        self.set_status(Status.SKIPPED)
        return Status.SKIPPED


def test_results_are_counted_by_node(sample: Tree) -> None:
    with TreeObserver(sample) as observer:
        for _ in range(3):
            sample.tick_while_running()
    counted = {
        path: (node.transitions_count, node.success_count, node.failure_count, node.last_result)
        for path, node in observer.statistics().items()
    }
    assert counted == {
        "root_seq": (6, 2, 1, FAILURE),
        "Script::2": (3, 3, 0, SUCCESS),
        "Fallback::3": (6, 2, 1, FAILURE),
        "AlwaysFailure::4": (3, 1, 2, FAILURE),
        "cnt": (3, 1, 1, FAILURE),
        "Sub::6": (4, 2, 0, SUCCESS),
        "Sub::6/Sequence::7": (4, 2, 0, SUCCESS),
        "Sub::6/Script::8": (2, 2, 0, SUCCESS),
        "Sub::6/Count::9": (4, 2, 0, SUCCESS),
        "AlwaysSuccess::10": (0, 0, 0, IDLE),
    }


def test_current_status_and_last_timestamp_are_kept(small: Callable[..., Tree]) -> None:
    clock = SimClock(9_000_000_000)
    tree = small('<Sequence><Sleep name="wait" msec="100"/></Sequence>', clock=clock)
    with TreeObserver(tree) as observer:
        assert observer.get_statistics("wait") == NodeStatistics()
        tree.tick_once()
        assert observer.get_statistics("wait").current_status is RUNNING
        clock.advance(0.25)
        tree.tick_once()
        wait = observer.get_statistics(2)
        assert (wait.current_status, wait.last_result) == (IDLE, SUCCESS)
        assert wait.last_timestamp == observer.epoch + 250_000_000


def test_halt_updates_the_last_timestamp(small: Callable[..., Tree]) -> None:
    clock = SimClock()
    tree = small('<Sleep msec="100"/>', clock=clock)
    with TreeObserver(tree) as observer:
        tree.tick_once()
        clock.advance(0.05)
        tree.halt()
    assert observer.get_statistics(1).last_timestamp == observer.epoch + 50_000_000
    assert observer.get_statistics(1).transitions_count == 1


def test_node_that_sets_skipped_is_counted(small: Callable[..., Tree]) -> None:
    nodes = Registry.standard()
    nodes.add(SaysSkipped)
    tree = small("<Sequence><SaysSkipped/></Sequence>", nodes=nodes)
    with TreeObserver(tree) as observer:
        tree.tick_once()
    skipped = observer.get_statistics("SaysSkipped::2")
    assert (skipped.skip_count, skipped.transitions_count, skipped.last_result) == (1, 1, IDLE)


def test_paths_and_uids_are_mapped_both_ways(sample: Tree) -> None:
    with TreeObserver(sample) as observer:
        assert observer.path_to_uid["Sub::6/Count::9"] == 9
        assert observer.uid_to_path[5] == "cnt"


def test_equal_paths_are_distinguished_by_number(small: Callable[..., Tree]) -> None:
    tree = small('<Sequence><AlwaysSuccess name="a"/><AlwaysFailure name="a"/></Sequence>')
    with TreeObserver(tree) as observer:
        tree.tick_once()
    assert observer.get_statistics("a#1").success_count == 1
    assert observer.get_statistics("a#2").failure_count == 1
    with pytest.raises(BtcoreError, match="'a' is the path of 2 nodes; use a#1 or a#2"):
        observer.get_statistics("a")


def test_an_unknown_node_raises_with_a_suggestion(sample: Tree) -> None:
    observer = TreeObserver(sample)
    with pytest.raises(BtcoreError, match="the tree has no node 'root_sq'; did you mean 'root_seq'\\?"):
        observer.get_statistics("root_sq")
    with pytest.raises(BtcoreError, match="the tree has no node 11; its nodes are 1 to 10"):
        observer.get_statistics(11)
    observer.close()


def test_returned_statistics_do_not_change(small: Callable[..., Tree]) -> None:
    tree = small("<AlwaysSuccess/>")
    with TreeObserver(tree) as observer:
        before = observer.get_statistics(1)
        tree.tick_once()
        assert before == NodeStatistics()
        observer.reset_statistics()
        tree.tick_once()
        assert observer.get_statistics(1).success_count == 1
    tree.tick_once()  # the observer is closed
    assert observer.get_statistics(1).success_count == 1
