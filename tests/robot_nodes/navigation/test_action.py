"""Goals of a server: order, cancellation, pre-emption and rejection."""

import pytest

from btcore_navigation.action import ActionServer, GoalHandle, GoalStatus


class CountingServer(ActionServer[int, int, int]):
    """A server that counts up to its goal, by 1 in each step."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self.stopped: list[int] = []
        self.preempted: list[int] = []

    def start(
        self, handle: GoalHandle[int, int, int], now: int, previous: GoalHandle[int, int, int] | None
    ) -> None:
        self.count = 0
        if previous is not None:
            self.preempted.append(previous.goal)
        if handle.goal < 0:
            handle.abort(7, "the goal is negative")

    def work(self, handle: GoalHandle[int, int, int], now: int) -> None:
        self.count += 1
        handle.feedback = self.count
        if self.count >= handle.goal:
            handle.succeed(self.count)

    def stop(self, handle: GoalHandle[int, int, int], now: int) -> None:
        self.stopped.append(handle.goal)


@pytest.fixture
def server() -> CountingServer:
    return CountingServer()


def test_a_goal_waits_for_the_next_step(server: CountingServer) -> None:
    handle = server.send_goal(2)
    assert (handle.status, server.is_busy) == (GoalStatus.UNKNOWN, True)
    server.step(0)
    assert (handle.status, handle.feedback) == (GoalStatus.EXECUTING, 1)
    server.step(1)
    assert (handle.status, handle.result.value, server.is_busy) == (GoalStatus.SUCCEEDED, 2, False)


def test_a_goal_can_end_as_it_starts(server: CountingServer) -> None:
    handle = server.send_goal(-1)
    server.step(0)
    assert (handle.status, handle.result.code, handle.feedback) == (GoalStatus.ABORTED, 7, None)


def test_a_newer_goal_pre_empts_without_a_stop(server: CountingServer) -> None:
    first = server.send_goal(5)
    server.step(0)
    second = server.send_goal(1)
    server.step(1)
    assert (first.status, second.status) == (GoalStatus.CANCELED, GoalStatus.SUCCEEDED)
    assert (server.preempted, server.stopped) == ([5], [])


def test_a_cancelled_goal_is_stopped_once(server: CountingServer) -> None:
    handle = server.send_goal(5)
    server.step(0)
    handle.cancel()
    assert handle.status == GoalStatus.CANCELING
    server.step(1)
    server.step(2)
    assert (handle.status, server.stopped) == (GoalStatus.CANCELED, [5])


def test_an_inactive_server_rejects_goals_and_aborts_the_goal_in_progress(server: CountingServer) -> None:
    running = server.send_goal(5)
    server.step(0)
    server.is_active = False
    rejected = server.send_goal(1)
    server.step(1)
    assert (running.status, rejected.status, server.stopped) == (GoalStatus.ABORTED, GoalStatus.ABORTED, [5])
    assert rejected.result.message == "server is not active"
    assert server.current is running
    server.step(2)
    assert server.send_goal(1) is server.current  # the reason why a tree fails
    server.is_active = True
    accepted = server.send_goal(1)
    server.step(3)
    assert accepted.status == GoalStatus.SUCCEEDED


def test_a_goal_cancelled_before_its_turn_never_starts(server: CountingServer) -> None:
    handle = server.send_goal(5)
    handle.cancel()
    server.step(0)
    assert (handle.status, handle.feedback, server.is_busy) == (GoalStatus.CANCELED, None, False)


def test_the_newer_of_two_goals_between_steps_is_executed(server: CountingServer) -> None:
    first, second = server.send_goal(5), server.send_goal(6)
    server.step(0)
    assert (first.status, second.status) == (GoalStatus.CANCELED, GoalStatus.EXECUTING)


def test_a_goal_that_has_ended_does_not_change(server: CountingServer) -> None:
    handle = server.send_goal(1)
    server.step(0)
    handle.cancel()
    handle.abort(3, "too late")
    assert (handle.status, handle.result.code) == (GoalStatus.SUCCEEDED, 0)
