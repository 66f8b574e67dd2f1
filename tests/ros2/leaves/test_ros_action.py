"""`RosAction` on a server in another process, whose behavior is part of each goal."""

import asyncio
import itertools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from planned_server import Answer, Cancel, End, Plan, ServerProcess, start_planned_server
from test_msgs.action import Fibonacci

import btcore
from btcore import In, NodeExecutionError, Registry, Status, Tree, TreeError
from btcore_ros2.leaves import ActionErrorCode, RosAction
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

S, F, R = Status.SUCCESS, Status.FAILURE, Status.RUNNING
OWN = '<Planned action_name="/{}/planned" order="{}"/>'
TAGS = itertools.count(1)


class Planned(RosAction):
    """Send a goal, and remember what happened."""

    action_name = "planned"
    action_type = Fibonacci
    server_timeout = 60_000
    wait_for_server_timeout = 60_000

    order: In[int]

    def on_start(self) -> Any:
        self.errors: list[ActionErrorCode] = []
        self.feedbacks: list[int] = []
        return super().on_start()

    def make_goal(self) -> Any:
        return Fibonacci.Goal(order=self.order) if self.order >= 0 else None

    def on_feedback(self, feedback: Any) -> Any:
        self.feedbacks += feedback.sequence

    def on_failure(self, error: ActionErrorCode) -> Any:
        self.errors.append(error)
        return F


class ShortTimeout(Planned):
    server_timeout = 100


class Unknown(Planned):
    action_type = "test_msgs/action/Fibonacci"
    action_name = "planed"
    wait_for_server_timeout = 300


class Stops(Planned):
    """End the goal at its second feedback."""

    def on_feedback(self, feedback: Any) -> Any:
        return feedback.sequence[0] == 1 or R


class Unnamed(Planned):
    action_name = ""


class Unfinished(Planned):
    def on_result(self, result: Any) -> Any:
        return R


class WrongGoal(Planned):
    def make_goal(self) -> Any:
        return Fibonacci.Result()


class Misspelled(Planned):
    action_type = "test_msgs/action/Fibonaci"


class WithoutType(Planned):
    action_type = None


NODES = (Planned, ShortTimeout, Unknown, Stops, Unnamed, Unfinished, WrongGoal, Misspelled, WithoutType)


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    with start_planned_server() as process:
        yield process


@pytest.fixture(scope="module")
def session(server: ServerProcess) -> Iterator[RosSession]:
    with RosSession("leaves") as session:
        tree = load(session, '<Planned order="0"/>')  # its client is used by all trees
        wait_until_known(session, "planned")
        yield session
        del tree


def load(session: RosSession, body: str, **entries: Any) -> Tree:
    nodes = Registry.standard()
    nodes.add(*NODES)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    board = btcore.Blackboard()
    for key, value in entries.items():
        board[key] = value
    return btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock, blackboard=board)


def leaf_of(tree: Tree) -> Any:
    return next(node for node in tree if isinstance(node, RosAction))


def run(session: RosSession, plan: Plan, tag: str = "Planned") -> tuple[Status, Any]:
    """Run a tree with one goal. Return its result and its leaf."""
    tree = load(session, f'<{tag} order="{plan.order}"/>')
    return tree.tick_while_running(period=0.01), leaf_of(tree)


def tick_until(session: RosSession, tree: Tree, condition: Callable[[], Any]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end
        assert tree.tick_once() is R
        session.clock.wait_until(session.clock.now() + 5_000_000, threading.Event())


# --- results and callbacks


def test_result_and_feedback(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    status, leaf = run(session, Plan(feedback=3, work_slots=5, tag=tag))
    assert status is S
    assert leaf.feedbacks == [0, 1, 2]
    assert list(leaf.last_result.sequence) == [tag]
    assert (leaf.errors, leaf.error_message) == ([], "")


def test_feedback_ends_the_goal_and_cancels_it(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    status, _ = run(session, Plan(feedback=3, work_slots=9, end=End.NEVER, tag=tag), "Stops")
    assert status is S
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)


@pytest.mark.parametrize(
    ("plan", "code", "message"),
    [
        (Plan(answer=Answer.REJECT), ActionErrorCode.GOAL_REJECTED_BY_SERVER, "'planned' rejected the goal"),
        (Plan(end=End.ABORT), ActionErrorCode.ACTION_ABORTED, "'planned' aborted the goal"),
        (Plan(end=End.CANCEL), ActionErrorCode.ACTION_CANCELLED, "by its server or by another client"),
    ],
)
def test_failed_goals(
    server: ServerProcess,
    session: RosSession,
    plan: Plan,
    code: ActionErrorCode,
    message: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    status, leaf = run(session, plan)
    assert (status, leaf.errors) == (F, [code])
    assert message in leaf.error_message
    assert f"Planned::1: {code.name}: {leaf.error_message}" in caplog.messages


@pytest.mark.parametrize("plan", [Plan(answer=Answer.REJECT), Plan(work_slots=2)])
def test_client_forgets_a_goal_that_has_ended(server: ServerProcess, session: RosSession, plan: Plan) -> None:
    _, leaf = run(session, plan)
    client = leaf._endpoint.get()
    assert session.wait_for(lambda: not client._futures, LIMIT_S)
    assert client._feedback_callbacks == {}


def test_invalid_goal_is_not_sent(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Planned order="-1"/>')
    assert tree.tick_once() is F
    assert leaf_of(tree).errors == [ActionErrorCode.INVALID_GOAL]


def test_result_of_a_callback_must_be_a_result(server: ServerProcess, session: RosSession) -> None:
    with pytest.raises(
        NodeExecutionError, match=r"on_result\(\) must return SUCCESS or FAILURE .*not RUNNING"
    ):
        run(session, Plan(), "Unfinished")


def test_goal_of_another_type(server: ServerProcess, session: RosSession) -> None:
    with pytest.raises(
        NodeExecutionError, match=r"must return a Fibonacci.Goal or None, not a Fibonacci_Res"
    ):
        run(session, Plan(), "WrongGoal")


def test_two_leaves_on_one_server(server: ServerProcess, session: RosSession) -> None:
    first, second = Plan(tag=next(TAGS), work_slots=20), Plan(tag=next(TAGS), work_slots=5, end=End.ABORT)
    tree = load(
        session,
        f'<ParallelAll max_failures="2"><Planned order="{first.order}"/><Planned order="{second.order}"/>'
        "</ParallelAll>",
    )
    assert tree.tick_while_running(period=0.01) is S
    first_leaf, second_leaf = (node for node in tree if isinstance(node, Planned))
    assert (first_leaf.errors, second_leaf.errors) == ([], [ActionErrorCode.ACTION_ABORTED])
    assert list(first_leaf.last_result.sequence) == [first.tag]


# --- names


def test_name_of_entry_is_read_when_leaf_starts(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, f'<Planned action_name="{{name}}" order="{Plan().order}"/>', name="planned")
    assert tree.tick_while_running(period=0.01) is S
    tree.blackboard["name"] = "elsewhere"
    assert tree.tick_once() is R
    assert leaf_of(tree)._endpoint.name == "elsewhere"
    tree.halt()
    tree.blackboard["name"] = "planned"
    assert tree.tick_while_running(period=0.01) is S


@pytest.mark.parametrize("name", ["", "__default__placeholder__"])
def test_name_that_stands_for_the_default(server: ServerProcess, session: RosSession, name: str) -> None:
    tree = load(session, f'<Planned action_name="{name}" order="{Plan().order}"/>')
    assert leaf_of(tree)._endpoint.name == "planned"
    assert tree.tick_while_running(period=0.01) is S


def test_name_is_remapped(server: ServerProcess) -> None:
    with RosSession("remapped", arguments=["-r", "navigate:=planned"]) as session:
        tree = load(session, f'<Planned action_name="navigate" order="{Plan().order}"/>')
        wait_until_known(session, "planned")
        assert tree.tick_while_running(period=0.01) is S


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<Unnamed order="0"/>', "give the class Unnamed a default"),
        ('<Planned action_name="a b" order="0"/>', "port .action_name. = 'a b' is not a valid ROS name"),
        ('<Misspelled order="0"/>', "action_type of the class Misspelled: 'test_msgs/action/Fibonaci'"),
        ('<WithoutType order="0"/>', "action_type of the class WithoutType is not set"),
    ],
)
def test_mistakes_are_reported_when_the_tree_is_loaded(session: RosSession, body: str, message: str) -> None:
    with pytest.raises(TreeError, match=message):
        load(session, body)


# --- time-outs, cancellation and lost servers


def test_absent_server(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Unknown order="0"/>')
    assert tree.tick_while_running(period=0.01) is F
    leaf = leaf_of(tree)
    assert leaf.errors == [ActionErrorCode.SERVER_UNREACHABLE]
    assert "no action server 'planed' (test_msgs/action/Fibonacci): start it" in leaf.error_message
    assert "did you mean '/planned'?" in leaf.error_message
    # The time for the server to appear is over: the next goal fails at once.
    assert tree.tick_once() is F


def test_goal_that_is_answered_too_late_is_cancelled(
    server: ServerProcess, session: RosSession, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    tag = next(TAGS)
    status, leaf = run(session, Plan(answer_slots=100, end=End.NEVER, tag=tag), "ShortTimeout")
    assert (status, leaf.errors) == (F, [ActionErrorCode.SEND_GOAL_TIMEOUT])
    assert "'planned' did not answer the goal within 100 ms" in leaf.error_message
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)
    message = "ShortTimeout::1: the goal on 'planned' was cancelled: it ended as CANCELED"
    assert session.wait_for(lambda: message in caplog.messages, LIMIT_S)


def test_halt_cancels_in_the_background(
    server: ServerProcess, session: RosSession, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    tag = next(TAGS)
    plan = Plan(end=End.NEVER, tag=tag, cancel=Cancel.ACCEPT_LATE)
    tree = load(session, f'<Planned order="{plan.order}"/>')
    tick_until(session, tree, lambda: "executing" in server.of(tag))
    drains: list[None] = []
    end = session.after_drain(lambda: drains.append(None))
    tree.halt()
    assert not drains  # it waited for nothing
    end()
    assert leaf_of(tree).status is Status.IDLE
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)
    message = "Planned::1: the goal on 'planned' was cancelled: it ended as CANCELED"
    assert session.wait_for(lambda: message in caplog.messages, LIMIT_S)
    assert caplog.messages.count(message) == 1


def test_halt_before_the_goal_is_accepted(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    plan = Plan(answer_slots=10, end=End.NEVER, tag=tag)
    tree = load(session, f'<Planned order="{plan.order}"/>')
    tick_until(session, tree, lambda: "goal" in server.of(tag))
    tree.halt()
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)


def test_goal_whose_acceptance_was_lost_is_cancelled(
    server: ServerProcess, session: RosSession, caplog: pytest.LogCaptureFixture
) -> None:
    from rclpy.task import Future

    caplog.set_level(logging.INFO)
    tag = next(TAGS)
    tree = load(session, f'<ShortTimeout order="{Plan(end=End.NEVER, tag=tag).order}"/>')
    leaf = leaf_of(tree)
    while leaf._goal is None:
        assert tree.tick_once() is R
    (_, read_acceptance), *_ = leaf._goal._open
    leaf._goal._open = [(Future(), read_acceptance)]  # as if ROS had dropped the answer
    assert tree.tick_while_running(period=0.01) is F
    assert leaf.errors == [ActionErrorCode.SEND_GOAL_TIMEOUT]
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)
    message = "ShortTimeout::1: the goal on 'planned' was cancelled: it ended as CANCELED"
    assert session.wait_for(lambda: message in caplog.messages, LIMIT_S)


def test_cancellation_of_goal_unknown_to_the_server(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    # The answer arrives after the goal was first cancelled by its ID.
    status, _ = run(session, Plan(answer_slots=100, end=End.NEVER, tag=tag), "ShortTimeout")
    assert status is F
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)


def test_session_is_closed_after_the_cancellation_was_sent(server: ServerProcess) -> None:
    tag = next(TAGS)
    plan = Plan(answer_slots=5, end=End.NEVER, tag=tag)
    with RosSession("leaving") as session:
        tree = load(session, f'<Planned order="{plan.order}"/>')
        tick_until(session, tree, lambda: "goal" in server.of(tag))
        tree.halt()
    with RosSession("waiting") as session:
        assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)


def test_refused_cancellation_is_reported(
    server: ServerProcess, session: RosSession, caplog: pytest.LogCaptureFixture
) -> None:
    tag = next(TAGS)
    plan = Plan(end=End.NEVER, tag=tag, cancel=Cancel.REFUSE)
    tree = load(session, f'<Planned order="{plan.order}"/>')
    tick_until(session, tree, lambda: "executing" in server.of(tag))
    tree.halt()
    message = "'planned' refused to cancel the goal, and continues to work on it"
    assert session.wait_for(lambda: message in caplog.text, LIMIT_S)
    # The leaf can be used again meanwhile, and is not confused by the previous goal.
    assert run(session, Plan(tag=next(TAGS)))[0] is S


def test_server_that_is_started_again_has_lost_the_goal(session: RosSession) -> None:
    with start_planned_server("/own") as own:
        tag = next(TAGS)
        tree = load(session, OWN.format("own", Plan(end=End.NEVER, tag=tag).order))
        wait_until_known(session, "/own/planned")
        tick_until(session, tree, lambda: "executing" in own.of(tag))
        own.kill()
        own.start()
        assert tree.tick_while_running(period=0.01) is F
        leaf = leaf_of(tree)
        assert leaf.errors == [ActionErrorCode.SERVER_UNREACHABLE]
        assert "'/own/planned' disappeared while it worked on the goal" in leaf.error_message
        wait_until_known(session, "/own/planned")
        assert load(session, OWN.format("own", Plan().order)).tick_while_running(period=0.01) is S


def test_server_of_another_type(server: ServerProcess) -> None:
    from test_msgs.action import NestedMessage

    class OtherType(Planned):
        action_type = NestedMessage
        wait_for_server_timeout = 300

        def make_goal(self) -> Any:
            return NestedMessage.Goal()

    nodes = Registry.standard()
    nodes.add(OtherType)
    text = '<root BTCPP_format="4"><BehaviorTree ID="T"><OtherType order="1"/></BehaviorTree></root>'
    # A ROS node cannot use both types for a name.
    with RosSession("other_type") as session:
        tree = btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)
        assert session.wait_for(lambda: session.node.count_publishers("/planned/_action/status"), LIMIT_S)
        assert tree.tick_while_running(period=0.01) is F
    assert leaf_of(tree).error_message == (
        "no action server 'planned' (test_msgs/action/NestedMessage): "
        "'/planned' has the type test_msgs/action/Fibonacci"
    )


def test_clean_shutdown_of_the_server_is_seen_at_once(session: RosSession) -> None:
    with start_planned_server("/clean") as own:
        tag = next(TAGS)
        tree = load(session, OWN.format("clean", Plan(end=End.NEVER, tag=tag).order))
        wait_until_known(session, "/clean/planned")
        tick_until(session, tree, lambda: "executing" in own.of(tag))
        own.terminate()
        began = time.monotonic()
        assert tree.tick_while_running(period=0.01) is F
        assert leaf_of(tree).errors == [ActionErrorCode.SERVER_UNREACHABLE]
        assert time.monotonic() - began < 15  # the DDS lease of a killed process takes 20 s


def test_timeout_ends_a_goal_that_never_ends(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    plan = Plan(end=End.NEVER, tag=tag)
    tree = load(session, f'<Timeout msec="500"><Planned order="{plan.order}"/></Timeout>')
    assert tree.tick_while_running(period=0.01) is F
    assert session.wait_for(lambda: "canceled" in server.of(tag), LIMIT_S)


def test_leaf_under_an_event_loop(server: ServerProcess, session: RosSession) -> None:
    tag = next(TAGS)
    tree = load(session, f'<Planned order="{Plan(tag=tag).order}"/>')
    assert asyncio.run(asyncio.wait_for(tree.run(), LIMIT_S)) is S
    assert list(leaf_of(tree).last_result.sequence) == [tag]
