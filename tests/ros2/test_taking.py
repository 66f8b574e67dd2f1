"""The session takes what arrives for its ROS node: directly, and with rclpy's executor."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy, qos_profile_action_status_default
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci

from btcore.clock import NS_PER_S
from btcore_ros2 import direct_take
from btcore_ros2.executor_take import MAX_CALLBACKS
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

KEEP_ALL = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL, reliability=QoSReliabilityPolicy.RELIABLE)


@pytest.fixture(scope="module", params=["direct", "executor"])
def shared_session(request: pytest.FixtureRequest) -> Iterator[RosSession]:
    """A session that takes in each of the two ways."""
    with RosSession("test", use_executor=request.param == "executor") as session:
        yield session


@pytest.fixture(scope="module")
def shared_other() -> Iterator[RosSession]:
    """A second session in this process."""
    with RosSession("other") as session:
        yield session


def entities(session: RosSession) -> set[Any]:
    """Return all entities of the ROS node."""
    node = session.node
    parts = (node.publishers, node.subscriptions, node.clients, node.services, node.timers, node.guards)
    return {entity for part in parts for entity in part} | {
        waitable for waitable in node.waitables if isinstance(waitable, ActionClient | ActionServer)
    }


@contextmanager
def without_traces(session: RosSession) -> Iterator[RosSession]:
    """Destroy the entities that are created in the context: discovering a new session takes seconds."""
    before = entities(session)
    yield session
    node = session.node
    for entity in entities(session) - before:
        for destroy in (
            node.destroy_publisher,
            node.destroy_subscription,
            node.destroy_client,
            node.destroy_service,
            node.destroy_timer,
            node.destroy_guard_condition,
        ):
            destroy(entity)  # without effect for entities of another type
        if isinstance(entity, ActionClient | ActionServer):
            entity.destroy()


@pytest.fixture
def session(shared_session: RosSession) -> Iterator[RosSession]:
    """The first session, whose entities are destroyed after the test."""
    with without_traces(shared_session):
        yield shared_session


@pytest.fixture
def other(shared_other: RosSession) -> Iterator[RosSession]:
    """The second session, whose entities are destroyed after the test."""
    with without_traces(shared_other):
        yield shared_other


def publisher(session: RosSession, other: RosSession, topic: str, qos: Any = 10) -> Callable[[str], None]:
    """Return a function with which *other* publishes a text for *session*, which has subscribed to it."""
    publisher = other.node.create_publisher(String, topic, qos)
    assert session.wait_for(lambda: publisher.get_subscription_count() > 0, LIMIT_S)
    return lambda text: publisher.publish(String(data=text))


def arrives(session: RosSession, condition: Callable[[], Any]) -> None:
    """Drain *session* until *condition* is met."""
    assert session.wait_for(condition, LIMIT_S)


def test_messages_of_a_process_arrive_in_order(session: RosSession, server: None) -> None:
    received: list[str] = []
    session.node.create_subscription(String, "echo", lambda message: received.append(message.data), 100)
    words = session.node.create_publisher(String, "words", 100)
    arrives(session, lambda: words.get_subscription_count() and session.node.count_publishers("echo"))
    sent = [str(number) for number in range(50)]
    arrives(session, lambda: words.publish(String(data="?")) or received)
    for word in sent:
        words.publish(String(data=word))
    arrives(session, lambda: received[-1] == sent[-1])
    assert received[-50:] == sent


def test_flood_neither_delays_a_drain_nor_another_topic(session: RosSession, other: RosSession) -> None:
    flood: list[str] = []
    rare: list[str] = []
    session.node.create_subscription(String, "flood", lambda message: flood.append(message.data), KEEP_ALL)
    session.node.create_subscription(String, "rare", lambda message: rare.append(message.data), 10)
    publish, publish_rare = publisher(session, other, "flood", KEEP_ALL), publisher(session, other, "rare")
    sent = [str(number) for number in range(6 * MAX_CALLBACKS)]
    for text in sent:
        publish(text)
    publish_rare("now")
    largest = 0
    seen_after = None

    def complete() -> bool:
        nonlocal largest, seen_after, before
        largest = max(largest, len(flood) - before)
        before = len(flood)
        if rare and seen_after is None:
            seen_after = len(flood)
        return len(flood) == len(sent)

    before = 0
    arrives(session, complete)
    assert flood == sent
    assert largest <= MAX_CALLBACKS + 2, "a drain is bounded"
    assert seen_after is not None
    assert seen_after < 5 * MAX_CALLBACKS, "the other topic is not taken last"


def test_callback_with_message_info(session: RosSession, other: RosSession) -> None:
    received: list[tuple[str, int]] = []
    session.node.create_subscription(
        String, "topic", lambda message, info: received.append((message.data, info["source_timestamp"])), 10
    )
    publisher(session, other, "topic")("hello")
    arrives(session, lambda: received)
    assert received[0][0] == "hello"
    assert received[0][1] > 0


def test_service_of_a_process_answers(session: RosSession, server: None) -> None:
    client = session.node.create_client(SetBool, "set_bool")
    arrives(session, client.service_is_ready)
    wait_until_known(session, "fibonacci")
    seen: list[str] = []
    futures = [client.call_async(SetBool.Request(data=bool(number % 2))) for number in range(6)]
    for future in futures:
        future.add_done_callback(lambda done: seen.append(done.result().message))
    arrives(session, lambda: len(seen) == 6)
    assert sorted(seen) == ["reset"] * 3 + ["set"] * 3
    assert [future.result().success for future in futures] == [False, True] * 3


def test_response_to_a_removed_request_is_ignored(session: RosSession, server: None) -> None:
    client = session.node.create_client(SetBool, "set_bool")
    arrives(session, client.service_is_ready)
    wait_until_known(session, "fibonacci")
    removed = client.call_async(SetBool.Request())
    client.remove_pending_request(removed)
    kept = client.call_async(SetBool.Request(data=True))
    arrives(session, kept.done)
    assert kept.result().success
    assert not removed.done()


def test_waiting_for_a_response_drains_rarely(server: None, monkeypatch: pytest.MonkeyPatch) -> None:
    with RosSession("test") as session:
        client = session.node.create_client(SetBool, "set_bool")
        arrives(session, client.service_is_ready)
        wait_until_known(session, "fibonacci")
        drains: list[None] = []
        session.after_drain(lambda: drains.append(None))
        assert not session.wait_for(lambda: False, 0.1, client)
        assert len(drains) < 20
        assert session.wait_for(lambda: len(drains) > 20, LIMIT_S, client)
        drains.clear()
        monkeypatch.setattr(direct_take, "REST_NS", LIMIT_S * NS_PER_S)
        for _ in range(10):
            assert session.wait_for(client.call_async(SetBool.Request()).done, LIMIT_S, client)
        assert len(drains) <= 20  # before and after the arrival of each response


def fibonacci(session: RosSession) -> ActionClient:
    """Return a client of the server's action, to which feedback arrives."""
    client = ActionClient(session.node, Fibonacci, "fibonacci")
    arrives(session, client.server_is_ready)
    seen: list[Any] = []
    while not seen:  # the server may be ready before its publisher of feedback has found the client
        goal = client.send_goal_async(Fibonacci.Goal(order=1), feedback_callback=seen.append)
        arrives(session, goal.done)
        arrives(session, goal.result().get_result_async().done)
    return client


def test_action_of_a_process_reports_feedback_and_result(session: RosSession, server: None) -> None:
    client = fibonacci(session)
    seen: list[Any] = []
    goal = client.send_goal_async(
        Fibonacci.Goal(order=5), feedback_callback=lambda message: seen.append(len(message.feedback.sequence))
    )
    arrives(session, goal.done)
    assert goal.result().accepted
    # rclpy drops the feedback that it takes after the result, which the executor may take first.
    arrives(session, lambda: len(seen) >= 3)
    assert seen[:3] == [3, 4, 5]
    result = goal.result().get_result_async()
    arrives(session, result.done)
    assert result.result().status == GoalStatus.STATUS_SUCCEEDED
    assert list(result.result().result.sequence) == [0, 1, 1, 2, 3, 5, 8]


def test_feedback_that_waits_is_taken_before_the_result(server: None) -> None:
    with RosSession("test") as session:
        client = fibonacci(session)
        seen: list[Any] = []
        goal = client.send_goal_async(
            Fibonacci.Goal(order=3),
            feedback_callback=lambda message: seen.append(len(message.feedback.sequence)),
        )
        arrives(session, goal.done)
        result = goal.result().get_result_async()
        result.add_done_callback(lambda done: seen.append("result"))
        with RosSession("watch") as watch:
            ended: list[Any] = []
            watch.node.create_subscription(
                GoalStatusArray,
                "fibonacci/_action/status",
                lambda message: ended.extend(
                    goal for goal in message.status_list if goal.status == GoalStatus.STATUS_SUCCEEDED
                ),
                qos_profile_action_status_default,
            )
            identifier = goal.result().goal_id
            assert watch.wait_for(
                lambda: identifier in [status.goal_info.goal_id for status in ended], LIMIT_S
            )
            for _ in range(10):  # meanwhile everything arrives, unless the machine stops ten times
                assert not watch.wait_for(lambda: False, 0.05)
        arrives(session, lambda: len(seen) == 4)
        assert seen == [3, 4, 5, "result"]


def test_action_of_a_process_rejects_and_cancels(session: RosSession, server: None) -> None:
    client = ActionClient(session.node, Fibonacci, "fibonacci")
    arrives(session, client.server_is_ready)
    wait_until_known(session, "fibonacci")
    rejected = client.send_goal_async(Fibonacci.Goal(order=-1))
    goal = client.send_goal_async(Fibonacci.Goal(order=100_000))
    arrives(session, lambda: rejected.done() and goal.done())
    assert not rejected.result().accepted
    result = goal.result().get_result_async()
    cancelled = goal.result().cancel_goal_async()
    arrives(session, lambda: cancelled.done() and result.done())
    assert len(cancelled.result().goals_canceling) == 1
    assert result.result().status == GoalStatus.STATUS_CANCELED


def test_service_and_action_of_the_session(session: RosSession, other: RosSession) -> None:
    def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = "answered"
        return response

    async def execute(goal: Any) -> Fibonacci.Result:
        await release
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.publish_feedback(Fibonacci.Feedback(sequence=[7]))
            goal.succeed()
        return Fibonacci.Result(sequence=[8])

    session.node.create_service(SetBool, "own_service", answer)
    server = ActionServer(
        session.node, Fibonacci, "own_action", execute, cancel_callback=lambda goal: CancelResponse.ACCEPT
    )
    caller = other.node.create_client(SetBool, "own_service")
    client = ActionClient(other.node, Fibonacci, "own_action")

    def both(condition: Callable[[], Any]) -> None:
        arrives(session, lambda: other.drain() or condition())

    both(lambda: caller.service_is_ready() and client.server_is_ready())
    response = caller.call_async(SetBool.Request())
    both(response.done)
    assert response.result().message == "answered"
    feedback: list[int] = []
    for expected in (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED):
        release = session.node.executor.create_future()
        feedback.clear()
        goal = client.send_goal_async(
            Fibonacci.Goal(), feedback_callback=lambda message: feedback.extend(message.feedback.sequence)
        )
        both(goal.done)
        result = goal.result().get_result_async()
        if expected == GoalStatus.STATUS_CANCELED:
            cancelled = goal.result().cancel_goal_async()
            both(cancelled.done)
        assert not result.done()
        release.set_result(None)
        both(result.done)
        assert result.result().status == expected
        assert list(result.result().result.sequence) == [8]
        if expected == GoalStatus.STATUS_SUCCEEDED:
            both(lambda: feedback == [7])
    server.destroy()


def test_callbacks_create_and_destroy_entities(session: RosSession, other: RosSession) -> None:
    received: list[str] = []
    subscriptions: dict[str, Any] = {}

    def replace(message: String) -> None:
        received.append(f"first {message.data}")
        session.node.destroy_subscription(subscriptions.pop("first"))
        subscriptions["second"] = session.node.create_subscription(String, "topic", second, 10)

    def second(message: String) -> None:
        received.append(f"second {message.data}")

    subscriptions["first"] = session.node.create_subscription(String, "topic", replace, 10)
    publish = publisher(session, other, "topic")
    publish("a")
    publish("b")  # may arrive while the first subscription is destroyed, then it is lost
    arrives(session, lambda: received)
    assert received == ["first a"]
    arrives(session, lambda: publish("c") or "second c" in received)
    assert "first c" not in received


def test_entity_destroyed_by_the_callback_of_another(session: RosSession, other: RosSession) -> None:
    received: list[str] = []
    subscriptions: list[Any] = []

    def end(message: String) -> None:
        received.append(message.data)
        while subscriptions:
            session.node.destroy_subscription(subscriptions.pop())

    subscriptions += [session.node.create_subscription(String, "topic", end, 10) for _ in range(3)]
    publish = publisher(session, other, "topic")
    publish("a")
    arrives(session, lambda: received)
    session.drain()
    assert received == ["a"]


def test_exception_of_callback_is_raised_and_nothing_is_lost(session: RosSession, other: RosSession) -> None:
    received: list[str] = []

    def fail(message: String) -> None:
        received.append(message.data)
        raise ZeroDivisionError(message.data)

    for topic in ("one", "two"):
        session.node.create_subscription(String, topic, fail, 10)
    publishers = [publisher(session, other, topic) for topic in ("one", "two")]
    for publish in publishers:
        publish("a")
        publish("b")
    raised = 0

    def complete() -> bool:
        nonlocal raised
        while True:
            try:
                session.drain()
            except ZeroDivisionError:
                raised += 1
            else:
                return raised == 4

    with RosSession("wait") as wait:
        assert wait.wait_for(complete, LIMIT_S)
    assert sorted(received) == ["a", "a", "b", "b"]


def test_exceptions_of_other_callbacks_are_raised(session: RosSession, server: None) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    def fails() -> bool:
        try:
            session.drain()
        except ZeroDivisionError:
            return True
        return False

    with RosSession("wait") as wait:
        client = session.node.create_client(SetBool, "set_bool")
        arrives(session, client.service_is_ready)
        client.call_async(SetBool.Request()).add_done_callback(fail)
        assert wait.wait_for(fails, LIMIT_S)
        timer = session.node.create_timer(0.01, fail)
        assert wait.wait_for(fails, LIMIT_S)
        session.node.destroy_timer(timer)
        goal = fibonacci(session).send_goal_async(Fibonacci.Goal(order=1), feedback_callback=fail)
        assert wait.wait_for(fails, LIMIT_S)
        arrives(session, goal.done)
        result = goal.result().get_result_async()
        arrives(session, result.done)
        assert result.result().status == GoalStatus.STATUS_SUCCEEDED


def test_coroutine_callback_waits_for_a_service(session: RosSession, other: RosSession, server: None) -> None:
    received: list[str] = []
    client = session.node.create_client(SetBool, "set_bool", callback_group=ReentrantCallbackGroup())

    async def ask(message: String) -> None:
        received.append(f"begin {message.data}")
        response = await client.call_async(SetBool.Request(data=True))
        received.append(f"end {message.data} {response.message}")

    session.node.create_subscription(String, "topic", ask, 10)
    arrives(session, client.service_is_ready)
    publish = publisher(session, other, "topic")
    publish("a")
    publish("b")
    arrives(session, lambda: len(received) == 4)
    # The subscription's callback group is mutually exclusive.
    assert received == ["begin a", "end a set", "begin b", "end b set"]


def test_exception_of_a_suspended_coroutine_is_raised(
    session: RosSession, other: RosSession, server: None
) -> None:
    client = session.node.create_client(SetBool, "set_bool", callback_group=ReentrantCallbackGroup())
    received: list[str] = []

    async def fail(message: String) -> None:
        await client.call_async(SetBool.Request(data=True))
        if message.data == "wrong":
            raise ZeroDivisionError
        received.append(message.data)

    session.node.create_subscription(String, "topic", fail, 10)
    arrives(session, client.service_is_ready)
    publish = publisher(session, other, "topic")
    publish("wrong")
    publish("right")
    with pytest.raises(ZeroDivisionError):
        session.wait_for(lambda: received, LIMIT_S)
    assert received == []
    arrives(session, lambda: received)  # the callback group was released


def test_timers_are_called_at_their_rate(session: RosSession) -> None:
    calls: list[int] = []
    session.node.create_timer(0.02, lambda: calls.append(session.clock.now()))
    cancelled = session.node.create_timer(0.001, lambda: calls.append(0))
    cancelled.cancel()
    arrives(session, lambda: len(calls) == 8)
    assert calls[-1] - calls[0] > 3 * 20_000_000  # ns; a late call does not delay the next


def test_guard_condition_is_called(session: RosSession) -> None:
    calls: list[str] = []
    guard = session.node.create_guard_condition(lambda: calls.append("called"))
    session.drain()
    assert calls == []
    guard.trigger()
    arrives(session, lambda: calls)
    session.drain()
    assert calls == ["called"]


def test_event_of_an_incompatible_qos_is_called(session: RosSession, other: RosSession) -> None:
    events: list[int] = []
    session.node.create_subscription(
        String,
        "topic",
        lambda message: None,
        QoSProfile(depth=10, reliability=QoSReliabilityPolicy.RELIABLE),
        event_callbacks=SubscriptionEventCallbacks(
            incompatible_qos=lambda event: events.append(event.total_count)
        ),
    )
    other.node.create_publisher(
        String, "topic", QoSProfile(depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    )
    arrives(session, lambda: events == [1])


def test_drain_within_a_callback_has_no_effect(session: RosSession, other: RosSession) -> None:
    received: list[str] = []

    def drain(message: String) -> None:
        received.append(f"begin {message.data}")
        session.drain()
        received.append(f"end {message.data}")

    session.node.create_subscription(String, "topic", drain, 10)
    publish = publisher(session, other, "topic")
    publish("a")
    publish("b")
    arrives(session, lambda: len(received) == 4)
    assert received == ["begin a", "end a", "begin b", "end b"]


def test_background_work_is_called_after_a_drain_until_it_ends(session: RosSession) -> None:
    calls: list[str] = []
    end = session.after_drain(lambda: calls.append("called"))
    session.drain()
    end()
    session.drain()
    assert calls == ["called"]


def test_rclpy_without_hidden_parts_gets_executor(monkeypatch: pytest.MonkeyPatch, other: RosSession) -> None:
    monkeypatch.delattr(direct_take.Executor, "_take_timer")
    with pytest.warns(UserWarning, match=r"lacks Executor\._take_timer: .* uses rclpy's executor"):
        session = RosSession("test")
    monkeypatch.undo()
    with session:
        received: list[str] = []
        session.node.create_subscription(String, "topic", lambda message: received.append(message.data), 10)
        publisher(session, other, "topic")("hello")
        arrives(session, lambda: received == ["hello"])


@pytest.mark.parametrize(
    ("owner", "code", "name"),
    [
        ("ActionClient", "take_data", "flags of ActionClient.take_data"),
        ("ActionServer", "take_data", "flags of ActionServer.take_data"),
        ("Client", "__init__", "Client._pending_requests"),
        ("Waitable", "__init__", "Waitable._futures"),
    ],
)
def test_renamed_parts_of_rclpy_are_detected(
    monkeypatch: pytest.MonkeyPatch, owner: str, code: str, name: str
) -> None:
    assert direct_take.missing_parts() == []
    monkeypatch.setattr(getattr(direct_take, owner), code, lambda self: None)
    assert name in direct_take.missing_parts()


def test_no_warning_with_this_version_of_rclpy() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RosSession("test").close()
