"""Taking what has arrived for a ROS node without an executor, by parts of rclpy that are not documented.

rclpy's executor builds a wait set for each call, which costs 0.3 ms for ten subscriptions without a message.
`DirectTake` takes from the queue of each entity instead, which costs 2 µs for an empty queue. No other module
uses undocumented parts of rclpy; `missing_parts` names those that another version of rclpy lacks.
"""

import time
from collections.abc import Callable, Coroutine, Generator, Iterable, Sequence
from types import CoroutineType, coroutine
from typing import TYPE_CHECKING, Any

from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.waitable import Waitable

from btcore_ros2.executor_take import MAX_CALLBACKS, ExecutorTake

if TYPE_CHECKING:
    from rclpy.node import Node

EVENTS_NS = 500_000_000
"""The time (ns) between two rounds of the executor, for events such as an incompatible QoS."""

REST_NS = 10_000_000
"""The longest time (ns) between two calls of `take` while a caller waits for a client or a service."""

# The queues of an action client in the order of taking: the flag that `take_data` tests, and the attribute
# that is empty if no item is expected. Feedback comes before the result of its goal.
_CLIENT_QUEUES = {
    "_is_goal_response_ready": "_pending_goal_requests",
    "_is_feedback_ready": "_feedback_callbacks",
    "_is_status_ready": "_goal_handles",
    "_is_cancel_response_ready": "_pending_cancel_requests",
    "_is_result_response_ready": "_pending_result_requests",
}
_SERVER_QUEUES = ("_is_goal_request_ready", "_is_cancel_request_ready", "_is_result_request_ready")
_SERVER_FLAGS = (*_SERVER_QUEUES, "_is_goal_expired")  # the executor's rounds remove expired goals

_PARTS: Sequence[tuple[Any, str]] = (
    (rclpy_implementation, "InvalidHandle"),
    (rclpy_implementation.Subscription, "take_message"),
    (rclpy_implementation.Client, "take_response"),
    (rclpy_implementation.Service, "service_take_request"),
    (rclpy_implementation.Timer, "is_timer_ready"),
    (rclpy_implementation.WaitSet, "wait"),
    (Executor, "_take_timer"),
    (Future, "_set_executor"),
    (Subscription, "CallbackType"),
    (Client, "get_pending_request"),
    (ActionClient, "take_data"),
    (ActionServer, "take_data"),
)
_ATTRIBUTES: Sequence[tuple[Any, str]] = (
    (Client, "_pending_requests"),
    (Executor, "_tasks"),
    (Executor, "_tasks_lock"),
    (Waitable, "_futures"),
    *((ActionClient, name) for name in _CLIENT_QUEUES.values()),
)


def action_clients(node: "Node") -> Sequence[tuple[ActionClient, str, type]]:
    """Return the action clients of *node*, each with the name and the type of its action."""
    clients = [waitable for waitable in node.waitables if isinstance(waitable, ActionClient)]
    try:
        return [(client, client._action_name, client._action_type) for client in clients]
    except AttributeError:  # another version of rclpy
        return []


def send_goal(
    client: ActionClient, message: Any, goal_id: Any, on_feedback: Callable[[Any], None]
) -> Future[Any]:
    """Send a goal with *client*, and return the future of the answer.

    Args:
        message: The goal message.
        goal_id: The ID of the goal, a message.
        on_feedback: Called with each message of feedback.
    """
    futures = getattr(client, "_futures", [])
    count = len(futures)
    answer = client.send_goal_async(message, feedback_callback=on_feedback, goal_uuid=goal_id)
    # rclpy of Kilted creates a second future, which it neither uses nor removes.
    for future in futures[count:]:
        if future is not answer:
            client.remove_future(future)
    return answer


def forget_goal(client: ActionClient, goal_id: Any, requests: Iterable[Future[Any]]) -> None:
    """Remove from *client* what it keeps of a goal: its feedback callback, and unanswered requests.

    Args:
        goal_id: The ID of the goal, a message.
        requests: The requests for the goal, which may be answered.
    """
    getattr(client, "_feedback_callbacks", {}).pop(bytes(goal_id.uuid), None)
    for request in requests:
        if not request.done():
            request.cancel()


def missing_parts() -> Sequence[str]:
    """Return the names of the undocumented parts that this version of rclpy lacks."""
    missing = [f"{owner.__name__}.{name}" for owner, name in _PARTS if not hasattr(owner, name)]
    for owner, name in _ATTRIBUTES:
        if name not in owner.__init__.__code__.co_names:
            missing.append(f"{owner.__name__}.{name}")
    for waitable, flags in ((ActionClient, tuple(_CLIENT_QUEUES)), (ActionServer, _SERVER_FLAGS)):
        take_data = getattr(waitable, "take_data", None)
        used = take_data.__code__.co_names if take_data is not None else ()
        if {name for name in used if name.startswith("_is_")} != set(flags):
            missing.append(f"flags of {waitable.__name__}.take_data")
    return missing


def _flags(names: Sequence[str]) -> dict[str, dict[str, bool]]:
    """Return for each flag the values of all flags, of which that flag alone is True."""
    return {name: dict.fromkeys(names, False) | {name: True} for name in names}


_CLIENT_FLAG_VALUES = _flags(tuple(_CLIENT_QUEUES))
_SERVER_FLAG_VALUES = _flags(_SERVER_FLAGS)


@coroutine
def _suspend() -> Generator[None, None, None]:
    """Suspend a coroutine until the next call of `take`."""
    yield


class DirectTake:
    """Takes from the queues of subscriptions, services, clients, actions and timers of a ROS node.

    Guard conditions and waitables of other types are left to the executor, as are events of QoS.

    Args:
        node: The ROS node.
        executor: The executor of *node*, or of *group*.
        group: Take for the entities of this callback group only; None = for all entities of *node*.
    """

    def __init__(self, node: "Node", executor: Executor, group: CallbackGroup | None = None) -> None:
        self._node = node
        self._executor = executor
        self._group = group
        self._rounds = ExecutorTake(executor)
        self._next_round = 0

    def take(self) -> None:
        """Take everything that has arrived, and call the callbacks, at most about `MAX_CALLBACKS`.

        Entities with several items take turns, so that a flood on one topic does not delay the others. An
        exception in a callback is raised here. What has not been taken then is taken by the next call.
        """
        node = self._node
        # The entities are listed first, because callbacks create and destroy entities.
        waiting: list[tuple[Callable[[Any], bool], Any]] = [
            (self._take_message, subscription) for subscription in self._own(node.subscriptions)
        ]
        clients = self._own(node.clients)
        waiting += [(self._take_response, client) for client in clients if client._pending_requests]
        waiting += [(self._take_request, service) for service in self._own(node.services)]
        others = next(iter(self._own(node.guards)), None) is not None
        for waitable in self._own(node.waitables):
            if isinstance(waitable, ActionClient):
                waiting.append((self._take_for_action_client, waitable))
            elif isinstance(waitable, ActionServer):
                waiting.append((self._take_for_action_server, waitable))
            else:
                others = others or not isinstance(waitable, EventHandler)
        for timer in tuple(self._own(node.timers)):
            self._call_timer(timer)
        called = 0
        while called < MAX_CALLBACKS:
            waiting = [(take, entity) for take, entity in waiting if take(entity)]
            count = len(waiting) + self._run_tasks()
            if not count:
                break
            called += count
        if others:
            self._rounds.take()
        elif (now := time.monotonic_ns()) >= self._next_round:
            self._next_round = now + EVENTS_NS
            self._rounds.take_once()

    def rest(self, entity: Client | Service, pause: float) -> None:
        """Sleep until something arrives for *entity*, at most for `REST_NS`.

        Args:
            entity: The client or service.
            pause: How long (s) to sleep instead if there are suspended callbacks, which `take` continues.
        """
        if self._executor._tasks:
            time.sleep(pause)
            return
        is_client = isinstance(entity, Client)
        context = self._node.context.handle
        with entity.handle, context:
            wait_set = rclpy_implementation.WaitSet(0, 0, 0, is_client, not is_client, 0, context)
            wait_set.clear_entities()
            if is_client:
                wait_set.add_client(entity.handle)
            else:
                wait_set.add_service(entity.handle)
            wait_set.wait(REST_NS)

    def _own(self, entities: Iterable[Any]) -> Iterable[Any]:
        """Return those of *entities* for which to take."""
        group = self._group
        return entities if group is None else [item for item in entities if item.callback_group is group]

    def _is_blocked(self, entity: Any) -> bool:
        """Whether a suspended callback of the same callback group excludes *entity*."""
        return bool(self._executor._tasks) and not self._executor.can_execute(entity)

    def _take_message(self, subscription: Subscription) -> bool:
        """Take a message and call the callback. Returns whether there was a message."""
        if self._is_blocked(subscription):
            return False
        handle = subscription.handle
        try:
            with handle:
                taken = handle.take_message(subscription.msg_type, subscription.raw)
        except rclpy_implementation.InvalidHandle:  # destroyed by a callback
            return False
        if taken is None:
            return False
        if subscription._callback_type is Subscription.CallbackType.MessageOnly:
            result = subscription.callback(taken[0])
        else:
            result = subscription.callback(*taken)
        if type(result) is CoroutineType:
            self._run(subscription, result)
        return True

    def _take_response(self, client: Client) -> bool:
        """Take a response and complete the future of its request. Returns whether there was a response."""
        if self._is_blocked(client):
            return False
        try:
            with client.handle:
                header, response = client.handle.take_response(client.srv_type.Response)
        except rclpy_implementation.InvalidHandle:
            return False
        if header is None:
            return False
        try:
            future = client.get_pending_request(header.request_id.sequence_number)
        except KeyError:  # the request was removed
            return True
        # The executor calls the callbacks of the future, and keeps their errors.
        future._set_executor(self._executor)
        future.set_result(response)
        return True

    def _take_request(self, service: Service) -> bool:
        """Take a request and answer it. Returns whether there was a request."""
        if self._is_blocked(service):
            return False
        try:
            with service.handle:
                request, header = service.handle.service_take_request(service.srv_type.Request)
        except rclpy_implementation.InvalidHandle:
            return False
        if header is None:
            return False
        self._run(service, _answer(service, request, header))
        return True

    def _take_for_action_client(self, client: ActionClient) -> bool:
        """Take a response, feedback or status. Returns whether there was an item."""
        if self._is_blocked(client):
            return False
        for flag, expected in _CLIENT_QUEUES.items():
            if getattr(client, expected) and self._take_flagged(client, _CLIENT_FLAG_VALUES[flag]):
                return True
        return False

    def _take_for_action_server(self, server: ActionServer) -> bool:
        """Take a request for a goal, a cancellation or a result. Returns whether there was a request."""
        if self._is_blocked(server):
            return False
        return any(self._take_flagged(server, _SERVER_FLAG_VALUES[flag]) for flag in _SERVER_QUEUES)

    def _take_flagged(self, waitable: Waitable, flags: dict[str, bool]) -> bool:
        """Take an item from the queue that *flags* select, and execute it. Returns whether there was one."""
        # Only one item at a time: an exception of its callback does not lose the items of other queues.
        waitable.__dict__.update(flags)
        try:
            with waitable:
                data = waitable.take_data()
        except rclpy_implementation.InvalidHandle:
            return False
        if not data:
            return False
        for future in waitable._futures:
            future._set_executor(self._executor)
        self._run(waitable, waitable.execute(data))
        return True

    def _call_timer(self, timer: Timer) -> None:
        """Call the callback of a timer if it is due."""
        if self._is_blocked(timer):
            return
        try:
            with timer.handle:
                if not timer.handle.is_timer_ready():
                    return
        except rclpy_implementation.InvalidHandle:
            return
        execute = self._executor._take_timer(timer)
        if execute is not None:
            self._run(timer, execute())

    def _run(self, entity: Any, execution: Coroutine[Any, Any, Any]) -> None:
        """Run *execution*, a coroutine for *entity*. If it is suspended, a task continues it."""
        try:
            execution.send(None)
        except StopIteration:
            return
        entity.callback_group.beginning_execution(entity)
        self._executor.create_task(_finish, entity, execution)

    def _run_tasks(self) -> int:
        """Run the executor's tasks once, and return how many are complete."""
        executor = self._executor
        completed = 0
        for item in tuple(executor._tasks):
            task = item[0]
            task()
            if task.done() or task.cancelled():
                with executor._tasks_lock:
                    executor._tasks = [other for other in executor._tasks if other is not item]
                completed += 1
                task.result()  # raises the exception of the callback
        return completed


async def _answer(service: Service, request: Any, header: Any) -> None:
    """Call the callback of *service* and send its response."""
    response = service.callback(request, service.srv_type.Response())
    if type(response) is CoroutineType:
        response = await response
    service.send_response(response, header)


async def _finish(entity: Any, execution: Coroutine[Any, Any, Any]) -> None:
    """Continue *execution* in each call of `take` until it ends, then release the callback group."""
    try:
        while True:
            try:
                execution.send(None)
            except StopIteration:
                return
            await _suspend()
    finally:
        entity.callback_group.ending_execution(entity)
