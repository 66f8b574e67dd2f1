"""The tree server: trees that run as goals of an action, as by BehaviorTree.ROS2's TreeExecutionServer."""

import gc
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

from btcore import Blackboard, BtcoreError, Registry, Status, Tree, make
from btcore.blackboard.ports import UNSET
from btcore.clock import NS_PER_S, Clock
from btcore.json_text import load_json
from btcore.loading.json_export import import_blackboard
from btcore.loading.load import registry_or_standard
from btcore.registry.resources import Resources
from btcore.suggestions import did_you_mean
from btcore.xml.plan.plan import plan_document
from btcore_ros2.action_server import RosActionServer, ServerGoal
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import load_interface
from btcore_ros2.parameters import declare_parameter
from btcore_ros2.session import RosSession

if TYPE_CHECKING:
    from btcore.xml.read.document import Document

__all__ = ["LoadedTrees", "TreeServer"]

PAYLOAD = "payload"
"""The key of the entry in which a tree finds the payload of its goal."""

JSON_PREFIX = "json:"
"""The prefix of a payload that sets several entries."""

FIXED_NAME = "read-only, because clients use this name until the server ends"

STOPPED = "the server was stopped"

IDLE_NS = 10_000_000
"""The longest wait (ns) for a goal between two checks whether the server has to stop."""

COLLECT_GOALS = 20
"""After how many goals the objects of the past trees are freed, which takes some ten milliseconds.

Python would not do it: a new tree is moved to the oldest generation, whose collections this does not cause.
"""


@runtime_checkable
class RecoverableRobot(Protocol):
    """A robot that may fail and become available again, such as `RosRobot`."""

    def raise_failure(self) -> None:
        """Raise a RosError if the robot has failed."""

    def recover(self, error: RosError, is_cancelled: Callable[[], bool]) -> None:
        """Wait until the robot is available again; see `RosRobot.recover`."""


class TreeServer:
    """Offers the trees of XML files as the action `btcpp_ros2_interfaces/ExecuteTree`.

    Each goal gets a new instance of its tree, which is created from the files as they are at this time. Its
    blackboard has the parent `blackboard`, whose entries stay between goals (`@key` in the XML). The payload
    is the entry `payload`; a payload `json:{…}` also sets one entry for each member of the object.

    Trees run one at a time, in the order of their goals: a goal that arrives meanwhile is accepted and waits.
    A goal ends as SUCCEEDED if its tree ends in SUCCESS, as CANCELED if it was cancelled, otherwise as
    ABORTED; the result contains the status of the tree and a message. The service `get_loaded_trees` returns
    the IDs of the trees.

    If a `RosRobot` among the resources fails, the goal in progress is aborted with the error. The server
    waits until the robot is available again, and then executes the goals that arrived meanwhile.

    Subclasses may override the methods from `read_trees` to `on_completed`.

    Args:
        session: The session, whose ROS node has the parameters `action_name` and `tick_frequency`.
        files: XML files, and folders, of which all XML files are read.
        nodes: The nodes that the trees may use; default `Registry.standard`.
        action_name: The name of the action, unless the ROS parameter `action_name` is given.
        tick_frequency: Ticks per second (Hz), unless the ROS parameter `tick_frequency` is given. A change of
            the parameter takes effect with the next goal.
        resources: Objects that leaves get by the types of their parameters. The session is among them.
        clock: The clock of the trees; default the clock of the session.

    Attributes:
        blackboard: The global blackboard.
        tree: The tree that runs, or ran last; None before the first goal.

    Raises:
        RosError: The messages of the action are not installed, a folder has no XML file, a resource that the
            trees need is missing, or a ROS parameter is invalid.
        TreeError: The files have errors.
    """

    def __init__(
        self,
        session: RosSession,
        files: Sequence[Path],
        *,
        nodes: Registry | None = None,
        action_name: str = "bt_execution",
        tick_frequency: float = 100.0,
        resources: Sequence[object] = (),
        clock: Clock | None = None,
    ) -> None:
        self._action = load_interface("btcpp_ros2_interfaces/action/ExecuteTree", "action")
        get_trees = load_interface("btcpp_ros2_interfaces/srv/GetTrees", "srv")
        self.session = session
        self.tree: Tree | None = None
        self._files = files
        self._nodes = registry_or_standard(nodes)
        self._resources = Resources(resources)
        self._resources.insert(0, session)
        self._robot = next(
            (resource for resource in resources if isinstance(resource, RecoverableRobot)), None
        )
        self._clock = clock if clock is not None else session.clock
        self.blackboard = Blackboard(clock=self._clock)
        self._trees = self.read_trees()
        for wanted in self._trees.check():
            if self._resources.first_of(wanted, "the trees") is UNSET:
                raise RosError(f"the trees need a resource of the type {wanted.__name__}, and none is given")
        self._tick_frequency = tick_frequency
        self._period = self._read_period()
        self._goal: ServerGoal[Any, Any, Any] | None = None
        self._wake = threading.Event()
        self._is_stopping = False
        self._is_closed = False
        self._server: RosActionServer[Any, Any, Any] = RosActionServer(
            session,
            self._action,
            declare_parameter(session.node, "action_name", action_name, fixed=FIXED_NAME),
            reject_reason=lambda goal: self.reject_reason(goal.target_tree, goal.payload),
            untaken_result=self._result(Status.IDLE, "the tree was not started"),
        )
        self._service = session.node.create_service(
            get_trees,
            "get_loaded_trees",
            self._answer_trees,
            callback_group=session.callback_group,
        )
        self._unsubscribe = session.after_drain(self._notice_requests)

    @property
    def action_name(self) -> str:
        """The name of the action."""
        return self._server.name

    @property
    def tree_ids(self) -> list[str]:
        """The sorted IDs of the trees in the files, as they were when the last goal began."""
        return sorted(self._trees.documents)

    # --- for subclasses

    def read_trees(self) -> "LoadedTrees":
        """Return the trees as they are now. Called when the server is created, and for each goal."""
        return LoadedTrees(self._files, self._nodes)

    def reject_reason(self, tree_id: str, payload: str) -> str:
        """Return why a new goal is rejected, or "" to accept it; C++: `onGoalReceived`.

        Args:
            tree_id: The ID of the requested tree, which may be unknown.
            payload: The payload of the goal.
        """
        return ""

    def on_tree_created(self, tree: Tree, payload: str) -> None:
        """Prepare a new tree before its first tick, for example its blackboard; C++: `onTreeCreated`.

        Args:
            tree: The tree.
            payload: The payload of the goal.
        """

    def on_before_tick(self) -> Status | None:
        """Prepare a tick; C++: `onLoopBeforeTick`.

        Returns:
            None to tick the tree, or a status: the tree is halted, and its goal is aborted with this status.
        """
        return None

    def on_tick(self, status: Status) -> Status | None:
        """Handle the result of a tick; C++: `onLoopAfterTick`.

        Returns:
            None to continue, or a status: the tree is halted, and its goal is aborted with this status.
        """
        return None

    def feedback(self) -> str | None:
        """Return the feedback after a tick, or None to send none; C++: `onLoopFeedback`."""
        return None

    def on_completed(self, status: Status, was_cancelled: bool) -> str | None:
        """Handle the end of a tree; C++: `onTreeExecutionCompleted`.

        Args:
            status: The status of the tree.
            was_cancelled: Whether the goal was cancelled, or `on_before_tick` or `on_tick` ended the tree.

        Returns:
            The message of the result; None for the default message.
        """
        return None

    # --- running

    def run(self) -> None:
        """Execute goals until `stop` is called."""
        ended = 0
        while not self._is_stopping:
            try:
                goal = self._next_goal()
            except RosError as error:
                if self._robot is None:
                    raise
                self._robot.recover(error, lambda: self._is_stopping)
                continue
            if goal is None:
                continue
            self._goal = goal
            try:
                self._execute(goal)
            finally:
                self._goal = None
            ended += 1
            if ended % COLLECT_GOALS == 0:
                gc.collect()

    def _next_goal(self) -> ServerGoal[Any, Any, Any] | None:
        """Return the next goal, or wait a moment and return None. Raise RosError if the robot has failed."""
        if self._robot is not None:
            self._robot.raise_failure()
        goal = self._server.take()
        if goal is None:
            self._wake.clear()
            if not self._is_stopping:
                self._clock.wait_until(self._clock.now() + IDLE_NS, self._wake)
        return goal

    def stop(self) -> None:
        """End `run` after the present tick; its goal is aborted. For signal handlers and other threads."""
        self._is_stopping = True
        if self.tree is not None:
            self.tree.interrupt()
        # In a paused simulation no time passes, so that the wait for a goal would not end. In a thread, since
        # a signal handler may have interrupted code that holds the lock of the event.
        threading.Thread(target=self._wake.set, daemon=True).start()

    def close(self) -> None:
        """Abort waiting goals, and remove the action and the service. Further calls have no effect."""
        if self._is_closed:
            return
        self._is_closed = True
        self._unsubscribe()
        self._server.close()
        self._release()
        self.session.node.destroy_service(self._service)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _notice_requests(self) -> None:
        """End the wait between two ticks or goals if a client has requested something."""
        if self._goal is None:
            if self._server.waiting:
                self._wake.set()
        elif self._goal.cancel_requested and self.tree is not None:
            self.tree.wake()

    def _answer_trees(self, request: object, response: Any) -> Any:
        response.tree_ids = self.tree_ids
        return response

    def _execute(self, goal: ServerGoal[Any, Any, Any]) -> None:
        """Run the tree of *goal* to its end, and end the goal."""
        status, message, end = Status.IDLE, "", goal.abort
        try:
            self.tree = tree = self._create(goal.request.target_tree, goal.request.payload)
            try:
                status, message, end = self._tick(tree, goal)
            finally:
                tree.halt()
        except Exception as error:  # the methods of a subclass may raise any exception
            prefix = "" if isinstance(error, BtcoreError) else f"{type(error).__name__}: "
            status, message, end = Status.IDLE, f"{prefix}{error}", goal.abort
        except BaseException:
            goal.abort(self._result(Status.IDLE, STOPPED))
            raise
        logger = self.session.node.get_logger()
        text = f"{goal.request.target_tree}: {message}"
        # rclpy identifies the place of a log call, which may have only one severity.
        if end == goal.succeed:
            logger.info(text)
        else:
            logger.warning(text)
        end(self._result(status, message))

    def _create(self, tree_id: str, payload: str) -> Tree:
        """Create the tree of a goal from the files."""
        self._period = self._read_period()
        self._trees = trees = self.read_trees()
        self._release()
        tree = trees.create(tree_id, self._resources, Blackboard(self.blackboard), self._clock)
        tree.blackboard[PAYLOAD] = payload
        if payload.startswith(JSON_PREFIX):
            import_blackboard(tree.blackboard, _members(payload), tree.registry.types)
        self.on_tree_created(tree, payload)
        return tree

    def _read_period(self) -> int:
        """Return the time (ns) between two ticks."""
        frequency: float = declare_parameter(
            self.session.node, "tick_frequency", float(self._tick_frequency), check=_check_frequency
        )
        return round(NS_PER_S / frequency)

    def _release(self) -> None:
        """Let the session destroy the ROS entities of the last tree, unless the next tree takes them over."""
        if self.tree is not None:
            self.session.entities.release(self.tree)

    def _tick(self, tree: Tree, goal: ServerGoal[Any, Any, Any]) -> tuple[Status, str, Any]:
        """Tick until *tree* or *goal* ends. Return the status, the message and how the goal ends."""
        status, due = Status.RUNNING, self._clock.now()
        while status is Status.RUNNING:
            if goal.cancel_requested:
                tree.halt()
                message = self.on_completed(status, True)
                return status, message or "cancelled: the tree was halted", goal.canceled
            if self._is_stopping:
                return status, STOPPED, goal.abort
            replaced, method = self.on_before_tick(), "on_before_tick"
            if replaced is None:
                status = tree.tick_exactly_once()
                replaced, method = self.on_tick(status), "on_tick"
            if replaced is not None:
                tree.halt()
                message = self.on_completed(replaced, True)
                return replaced, message or f"ended by {method}: the tree was halted", goal.abort
            feedback = self.feedback()
            if feedback is not None:
                goal.publish_feedback(self._action.Feedback(message=feedback))
            if status is Status.RUNNING:
                due = max(due + self._period, self._clock.now())
                tree.context.wait_until(due)
        message = self.on_completed(status, False)
        end = goal.succeed if status is Status.SUCCESS else goal.abort
        return status, message or f"the tree ended in {status.name}", end

    def _result(self, status: Status, message: str) -> Any:
        result = self._action.Result(return_message=message)
        result.node_status.status = status.value  # the numbers are those of BehaviorTree.CPP
        return result


class LoadedTrees:
    """The trees of XML files.

    Args:
        files: The files; of a folder all XML files.
        nodes: The nodes that the trees may use. The registry is not changed.

    Attributes:
        documents: The documents of the trees by ID.

    Raises:
        RosError: There is no XML file in a folder, or no tree in the files.
        TreeError: A file cannot be read or is not valid XML.
    """

    def __init__(self, files: Sequence[Path], nodes: Registry) -> None:
        self._nodes = nodes.copy()
        for file in files:
            found = sorted(file.glob("*.xml")) if file.is_dir() else [file]
            if not found:
                raise RosError(f"there is no XML file in the folder {file}")
            self._nodes.add_trees(*found)
        self.documents: dict[str, Document] = {
            id: document
            for document in self._nodes.documents
            for element in document.root.iterchildren("BehaviorTree")
            if (id := element.get("ID")) is not None
        }
        if not self.documents:
            raise RosError("there is no <BehaviorTree> with an ID in the files")

    def check(self) -> list[type]:
        """Check all trees.

        Returns:
            The types of the resources that their leaves need.

        Raises:
            TreeError: A tree has an error.
        """
        types: dict[type, None] = {}
        for id, document in self.documents.items():
            plans = plan_document(document, self._nodes, id)
            plans.diagnostics.raise_errors()
            types.update(dict.fromkeys(plans.required_resources()))
        return list(types)

    def create(self, tree_id: str, resources: Sequence[object], blackboard: Blackboard, clock: Clock) -> Tree:
        """Return a new instance of a tree.

        Args:
            tree_id: The ID of the tree.
            resources: Objects that leaves get by the types of their parameters.
            blackboard: The blackboard of the tree.
            clock: The clock of the tree.

        Raises:
            RosError: There is no such tree.
            TreeError: The files have errors.
        """
        if tree_id not in self.documents:
            raise RosError(f"unknown tree '{tree_id}'{did_you_mean(tree_id, self.documents)}")
        return make(tree_id, nodes=self._nodes, resources=resources, blackboard=blackboard, clock=clock)


def _members(payload: str) -> dict[str, Any]:
    """Return the object in a payload `json:{…}`."""
    try:
        members = load_json(payload.removeprefix(JSON_PREFIX))
    except ValueError as error:
        raise RosError(f"the payload is not valid JSON after '{JSON_PREFIX}': {error}") from error
    if not isinstance(members, dict):
        raise RosError(
            f"the payload is not an object after '{JSON_PREFIX}': write {JSON_PREFIX}{{\"key\": value}}"
        )
    return members


def _check_frequency(value: float) -> None:
    if not 0.0 < value <= 10_000.0:
        raise RosError(f"the ROS parameter tick_frequency has to be between 0 and 10000 (Hz), not {value:g}")
