"""Observers receive transitions, ticks and errors, and never disturb the tree."""

import logging
import threading
from collections.abc import Callable

import pytest

from btcore import NodeExecutionError, Observer, SimClock, Status, SyncAction, Transition, Transitions, Tree
from btcore.tree.hooks import Hook
from tests.btcore.conftest import TreeFactory

BODY = '<Sequence name="s"><Act name="a" outcomes="S"/><Act name="b" outcomes="RS"/></Sequence>'


class Listener(Observer):
    def __init__(self) -> None:
        self.changes: list[Transition] = []
        self.ticks: list[tuple[int, int, Status]] = []
        self.durations: list[int] = []
        self.errors: list[str] = []

    def transition(self, change: Transition) -> None:
        self.changes.append(change)

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        self.ticks.append((tick, stamp, status))
        self.durations.append(duration_ns)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        self.errors.append(error.path)


class Broken(Observer):
    """Raises at every notification."""

    def transition(self, change: Transition) -> None:
        raise RuntimeError("the wire is cut")

    ticked = raised = transition  # type: ignore[assignment]


def test_every_status_change_is_a_transition_in_order(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    listener = Listener()
    tree.subscribe(listener)
    tree.tick_exactly_once()
    tree.tick_exactly_once()
    names = {node.uid: node.name for node in tree}
    reported = [(names[one.uid], one.previous.name, one.status.name) for one in listener.changes]
    assert reported == [
        ("s", "IDLE", "RUNNING"),
        ("a", "IDLE", "SUCCESS"),
        ("b", "IDLE", "RUNNING"),
        ("b", "RUNNING", "SUCCESS"),
        ("a", "SUCCESS", "IDLE"),
        ("b", "SUCCESS", "IDLE"),
        ("s", "RUNNING", "SUCCESS"),
        ("s", "SUCCESS", "IDLE"),
    ]


def test_transitions_are_numbered_and_carry_time_and_tick(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree(BODY)
    listener = Listener()
    tree.subscribe(listener)
    tree.tick_while_running(period=0.25)
    tree.tick_once()
    tree.halt()
    assert [one.number for one in listener.changes] == list(range(1, len(listener.changes) + 1))
    assert [(one.tick, one.stamp) for one in listener.changes] == (
        [(1, 0)] * 3 + [(2, 250_000_000)] * 5 + [(3, 250_000_000)] * 6
    )


def test_late_subscriber_receives_the_next_transition_number(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    early, late = Listener(), Listener()
    tree.subscribe(early)
    tree.tick_exactly_once()
    tree.subscribe(late)
    tree.tick_exactly_once()
    assert late.changes == early.changes[3:]
    assert (late.changes[0].number, {one.tick for one in late.changes}) == (4, {2})
    assert [tick for tick, _, _ in late.ticks] == [2]


def test_end_of_every_root_tick_is_reported_with_status_and_duration(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    listener = Listener()
    tree.subscribe(listener)
    tree.tick_while_running(period=0.1)
    assert listener.ticks == [(1, 0, Status.RUNNING), (2, 100_000_000, Status.SUCCESS)]
    assert all(duration > 0 for duration in listener.durations)


def test_unsubscribed_observer_receives_nothing_and_may_unsubscribe_twice(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    stays, goes = Listener(), Listener()
    tree.subscribe(stays)
    unsubscribe = tree.subscribe(goes)
    tree.tick_exactly_once()
    unsubscribe()
    unsubscribe()
    tree.tick_exactly_once()
    assert len(goes.changes) == 3
    assert len(stays.changes) == 8


def test_unsubscribing_within_a_notification_does_not_disturb_others(make_tree: TreeFactory) -> None:
    class Once(Listener):
        def transition(self, change: Transition) -> None:
            super().transition(change)
            unsubscribe()

    tree = make_tree(BODY)
    once, after = Once(), Listener()
    unsubscribe = tree.subscribe(once)
    tree.subscribe(after)
    tree.tick_exactly_once()
    assert len(once.changes) == 1
    assert len(after.changes) == 3


def test_observer_that_raises_is_unsubscribed_with_a_single_warning(
    make_tree: TreeFactory, caplog: pytest.LogCaptureFixture
) -> None:
    tree = make_tree(BODY)
    before, after = Listener(), Listener()
    tree.subscribe(before)
    tree.subscribe(Broken())
    tree.subscribe(after)
    with caplog.at_level(logging.WARNING, logger="btcore"):
        assert tree.tick_exactly_once() is Status.RUNNING
        assert tree.tick_exactly_once() is Status.SUCCESS
    assert len(before.changes) == len(after.changes) == 8
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "Broken" in caplog.text
    assert "is unsubscribed" in caplog.text
    assert "the wire is cut" in caplog.text


def test_an_observer_that_raises_at_tick_end_does_not_stop_the_tree(
    make_tree: TreeFactory, caplog: pytest.LogCaptureFixture
) -> None:
    class LateBroken(Broken):
        def transition(self, change: Transition) -> None:
            pass

    tree = make_tree('<Act outcomes="S|X"/>')
    tree.subscribe(LateBroken())
    assert tree.tick_once() is Status.SUCCESS
    tree.subscribe(LateBroken())
    with pytest.raises(NodeExecutionError, match="the outcome of"):
        tree.tick_once()
    assert len(caplog.records) == 2


class Keeper(Observer):
    """Keeps the batches of transitions that it receives."""

    def __init__(self) -> None:
        self.reported: list[Transitions] = []

    def transitions(self, changes: Transitions) -> None:
        self.reported.append(changes)


def test_transitions_arrive_at_end_of_each_tick_and_after_halt(
    make_tree: TreeFactory, clock: SimClock
) -> None:
    tree = make_tree(BODY)
    listener, keeper = Listener(), Keeper()
    tree.subscribe(listener)
    tree.subscribe(keeper)
    tree.tick_while_running(period=0.25)
    tree.tick_once()
    tree.halt()
    assert [list(one) for one in keeper.reported] == [
        [change for change in listener.changes if change.tick == 1],
        [change for change in listener.changes if change.tick == 2],
        listener.changes[8:11],
        listener.changes[11:],
    ]
    assert [(len(one), one.first, one.tick, one[0]) for one in keeper.reported] == [
        (3, 1, 1, listener.changes[0]),
        (5, 4, 2, listener.changes[3]),
        (3, 9, 3, listener.changes[8]),
        (3, 12, 3, listener.changes[11]),
    ]


def test_transitions_before_an_error_arrive_before_it_and_the_halt_after_it(make_tree: TreeFactory) -> None:
    order: list[str] = []

    class Both(Observer):
        def transitions(self, changes: Transitions) -> None:
            order.append("->".join(change.status.name for change in changes))

        def raised(self, error: NodeExecutionError, stamp: int) -> None:
            order.append(error.path)

    tree = make_tree('<Sequence><Act name="x" outcomes="X"/></Sequence>')
    tree.subscribe(Both())
    with pytest.raises(NodeExecutionError):
        tree.tick_once()
    assert order == ["RUNNING", "x", "IDLE"]


def test_observer_unsubscribed_within_a_tick_receives_the_earlier_transitions(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    keeper = Keeper()

    class Leaving(Observer):
        def transition(self, change: Transition) -> None:
            if change.number == 2:
                leave()

    leave = tree.subscribe(keeper)
    tree.subscribe(Leaving())
    tree.tick_exactly_once()
    tree.flush_observers()
    assert [change.number for one in keeper.reported for change in one] == [1, 2]


def test_observer_that_raises_on_transitions_is_removed_and_others_are_notified(
    make_tree: TreeFactory, caplog: pytest.LogCaptureFixture
) -> None:
    class Cut(Observer):
        def transitions(self, changes: Transitions) -> None:
            raise RuntimeError("the disk is full")

    tree = make_tree(BODY)
    keeper = Keeper()
    tree.subscribe(Cut())
    tree.subscribe(keeper)
    tree.tick_exactly_once()
    tree.tick_exactly_once()
    assert [len(one) for one in keeper.reported] == [3, 5]
    assert len(caplog.records) == 1


# --- subscribing, unsubscribing and halting within a tick


class Doing(Observer):
    """Calls *act* once: at transition number *at*, or at the first batch."""

    def __init__(self, act: Callable[[], object], at: int = 0) -> None:
        self.act = act
        self.at = at

    def transition(self, change: Transition) -> None:
        if change.number == self.at:
            self.act()

    def transitions(self, changes: Transitions) -> None:
        if not self.at:
            self.at = -1
            self.act()


def numbers(keeper: Keeper) -> list[int]:
    return [change.number for one in keeper.reported for change in one]


def test_observer_subscribed_within_a_tick_receives_the_following_transitions(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    listener, keeper = Listener(), Keeper()
    tree.subscribe(Doing(lambda: (tree.subscribe(listener), tree.subscribe(keeper)), at=2))
    tree.tick_exactly_once()
    assert numbers(keeper) == [change.number for change in listener.changes] == [3]
    assert listener.ticks == [(1, 0, Status.RUNNING)]


def test_first_observer_subscribed_within_a_tick_receives_its_error(make_tree: TreeFactory) -> None:
    listener, keeper = Listener(), Keeper()

    class Calling(SyncAction):
        tree: Tree

        def tick(self) -> bool:
            self.tree.subscribe(listener)
            self.tree.subscribe(keeper)
            return True

    tree = make_tree('<Sequence><Calling/><Act name="x" outcomes="X"/></Sequence>', Calling)
    tree.find(Calling)[0].tree = tree
    with pytest.raises(NodeExecutionError):
        tree.tick_once()
    assert (listener.errors, listener.ticks) == (["x"], [])
    assert [change.status.name for change in listener.changes] == ["SUCCESS", "IDLE", "IDLE"]
    assert [list(one) for one in keeper.reported] == [listener.changes[:1], listener.changes[1:]]


def test_tree_halted_by_an_observer_notifies_all_observers_in_order(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    first, last = Keeper(), Keeper()
    tree.subscribe(first)
    tree.subscribe(Doing(tree.halt))
    tree.subscribe(last)
    tree.tick_exactly_once()
    assert numbers(first) == numbers(last) == [1, 2, 3, 4, 5, 6]
    assert all(node.status is Status.IDLE for node in tree)


def test_observer_raising_or_unsubscribing_in_halt_is_harmless(
    make_tree: TreeFactory, clock: SimClock
) -> None:
    tree = make_tree(BODY)
    listener, keeper = Listener(), Keeper()

    class Cut(Observer):
        def transition(self, change: Transition) -> None:
            if change.status is Status.IDLE:
                raise RuntimeError("the wire is cut")

    tree.subscribe(Cut())
    leave = tree.subscribe(keeper)
    tree.subscribe(listener)
    tree.subscribe(Doing(leave, at=4))
    tree.tick_exactly_once()
    tree.halt()
    assert [change.number for change in listener.changes] == [1, 2, 3, 4, 5, 6]
    assert numbers(keeper) == [1, 2, 3, 4]
    assert all(node.status is Status.IDLE for node in tree)


def test_observers_may_be_equal(make_tree: TreeFactory) -> None:
    class Alike(Keeper):
        def __eq__(self, other: object) -> bool:
            return isinstance(other, Alike)

        __hash__ = None  # type: ignore[assignment]

    tree = make_tree(BODY)
    one, other = Alike(), Alike()
    tree.subscribe(one)
    tree.subscribe(other)()
    tree.tick_exactly_once()
    assert (numbers(one), numbers(other)) == ([1, 2, 3], [])


def test_flush_at_a_breakpoint_delivers_the_transitions_so_far(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    keeper = Keeper()
    tree.subscribe(keeper)
    seen: list[list[int]] = []

    def look(hook: Hook) -> None:
        tree.flush_observers()
        seen.append(numbers(keeper))
        threading.Thread(target=tree.hooks.unlock, args=(hook.uid,)).start()

    tree.hooks.insert(Hook(tree.node("b").uid))
    tree.hooks.subscribe(look)
    tree.tick_exactly_once()
    assert seen == [[1, 2]]
    assert numbers(keeper) == [1, 2, 3]


def test_transitions_are_a_sequence_that_is_built_only_once(make_tree: TreeFactory) -> None:
    tree = make_tree(BODY)
    keeper = Keeper()
    tree.subscribe(keeper)
    tree.tick_exactly_once()
    (reported,) = keeper.reported
    assert reported.to_list() is reported.to_list()
    assert (reported[-1], list(reported), len(reported)) == (reported[2], reported.to_list(), 3)
    assert reported[0] == Transition(1, 0, 1, 1, Status.IDLE, Status.RUNNING)
    assert isinstance(reported[0], Transition)
    with pytest.raises(IndexError):
        reported[3]
